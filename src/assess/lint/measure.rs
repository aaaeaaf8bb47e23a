//! The measurements: integrals and comparisons over fixed directions.

use std::f64::consts::{PI, TAU};

use crate::base::error::Result;
use crate::brdf::importance::geometry::Given;

/// Elevations of wi for albedos, degrees.
const ELEVATIONS: [f64; 7] = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0];
/// The last of them for which a peak beyond [`NEAR_HORIZON`] is out of place.
const LAST_STEEP: f64 = 60.0;
/// Azimuths of wi where the material is not isotropic.
pub(super) const AZIMUTHS: usize = 6;

/// Half vectors of an albedo's quadrature along theta_h and phi_h; the error is estimated with half as many.
const HALF_VECTORS: [usize; 2] = [192, 64];

/// Pairs of directions of a comparison, and the elevation that they stay below, degrees.
const PAIRS: usize = 4096;
const MOST_ELEVATION: f64 = 85.0;
/// Constant of log deviations, 1/sr.
pub(super) const EPS: f64 = 1e-3;

/// Elevation of wo beyond which the horizon begins, degrees.
pub(super) const NEAR_HORIZON: f64 = 80.0;
/// Directions along theta_o beyond and before it, and along phi_o.
const AT_HORIZON: usize = 20;
const ELSEWHERE: usize = 80;
const AROUND: usize = 64;
/// Where nothing goes elsewhere.
const MOST_RATIO: f64 = 1e6;

/// Share of the light from a direction that is reflected, by channel.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Albedo {
    /// Elevation of wi, degrees.
    pub theta_i: f64,
    /// Integral of f cos(theta_o) over the hemisphere of wo; of an anisotropic material the largest of six azimuths of
    /// wi.
    pub values: Vec<f64>,
    /// What half as many directions change in each of them.
    pub errors: Vec<f64>,
}

/// Difference of ln(f + 0.001/sr) between pairs of directions that should reflect alike.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Deviation {
    /// Over 4096 pairs below 85 degrees, even in azimuth and in solid angle, and all channels.
    pub rms: f64,
    /// The largest absolute difference.
    pub max: f64,
    /// The directions of it.
    pub wi: [f64; 3],
    /// The other one.
    pub wo: [f64; 3],
}

/// How much light goes along the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Horizon {
    /// Elevation of wi, degrees.
    pub theta_i: f64,
    /// Largest f cos(theta_o), mean of the channels, beyond 80 degrees over the largest before, at most 1e6; 0 if both
    /// are.
    pub ratio: f64,
}

/// `eval(wi, wo, values)`, one value a channel.
pub(super) struct Look<'a, F> {
    pub(super) channels: usize,
    pub(super) azimuths: usize,
    pub(super) eval: &'a mut F,
}

impl<F: FnMut([f64; 3], [f64; 3], &mut [f32]) -> Result<()>> Look<'_, F> {
    pub(super) fn albedos(&mut self) -> Result<Vec<Albedo>> {
        let mut albedos = Vec::new();
        for theta_i in ELEVATIONS {
            let (mut values, mut errors) = (vec![0.0; self.channels], vec![0.0; self.channels]);
            for azimuth in 0..self.azimuths {
                let wi = direction(theta_i, azimuth as f64 / self.azimuths as f64 * TAU);
                let fine = self.albedo(wi, HALF_VECTORS)?;
                let coarse = self.albedo(wi, HALF_VECTORS.map(|n| n / 2))?;
                for (c, (fine, coarse)) in fine.iter().zip(coarse).enumerate() {
                    if *fine >= values[c] {
                        (values[c], errors[c]) = (*fine, (fine - coarse).abs());
                    }
                }
            }
            albedos.push(Albedo { theta_i, values, errors });
        }
        Ok(albedos)
    }

    /// Over half vectors that mirror `wi` to above the horizon: even in the root of theta_h or nearly so, as MERL's
    /// bins are, and in phi_h, so that lobes as narrow as a bin are seen.
    fn albedo(&mut self, wi: [f64; 3], [rows, columns]: [usize; 2]) -> Result<Vec<f64>> {
        let mut sums = vec![0.0; self.channels];
        let mut values = vec![0f32; self.channels];
        let Some(given) = Given::new(wi) else { return Ok(sums) };
        let t_max = given.t_max();
        for row in 0..rows {
            let x = (row as f64 + 0.5) / rows as f64;
            let t = t_max * x.powi(4);
            let phi_max = given.phi_max(t);
            let area = 4.0 * t_max * x.powi(3) / rows as f64 * 2.0 * phi_max / columns as f64;
            for column in 0..columns {
                let wo = given.mirror(t, phi_max * (2.0 * (column as f64 + 0.5) / columns as f64 - 1.0));
                (self.eval)(wi, wo, &mut values)?;
                let weight = area * 4.0 * given.half(wo).along * wo[2];
                sums.iter_mut().zip(&values).for_each(|(sum, v)| *sum += f64::from(*v) * weight);
            }
        }
        Ok(sums)
    }

    /// Between pairs of directions and what `other` makes of them.
    pub(super) fn deviation(
        &mut self,
        other: impl Fn([f64; 3], [f64; 3]) -> ([f64; 3], [f64; 3]),
    ) -> Result<Deviation> {
        let mut found = Deviation { rms: 0.0, max: 0.0, wi: [0.0; 3], wo: [0.0; 3] };
        let (mut one, mut two) = (vec![0f32; self.channels], vec![0f32; self.channels]);
        for pair in 0..PAIRS {
            // The additive recurrence of the root of x^5 = x + 1 (Roberts 2018).
            let at = |k: i32| (0.5 + (pair + 1) as f64 * 1.167_303_978_261_418_7_f64.powi(-k)).fract();
            let (wi, wo) = (below(at(1), at(2)), below(at(3), at(4)));
            let (wi2, wo2) = other(wi, wo);
            (self.eval)(wi, wo, &mut one)?;
            (self.eval)(wi2, wo2, &mut two)?;
            for (one, two) in one.iter().zip(&two) {
                let difference = ((f64::from(*one) + EPS) / (f64::from(*two) + EPS)).ln().abs();
                found.rms += difference * difference;
                if difference > found.max {
                    found = Deviation { max: difference, wi, wo, ..found };
                }
            }
        }
        found.rms = (found.rms / (PAIRS * self.channels) as f64).sqrt();
        Ok(found)
    }

    pub(super) fn horizon(&mut self) -> Result<Vec<Horizon>> {
        let mut found = Vec::new();
        for theta_i in ELEVATIONS.into_iter().filter(|theta| *theta <= LAST_STEEP) {
            let mut ratio = 0f64;
            for azimuth in 0..self.azimuths {
                let wi = direction(theta_i, azimuth as f64 / self.azimuths as f64 * TAU);
                // The mirror direction belongs to the others, however narrow its lobe is.
                let elsewhere = self.brightest(wi, [0.0, NEAR_HORIZON], ELSEWHERE)?.max(self.flux(wi, mirror(wi))?);
                let near = self.brightest(wi, [NEAR_HORIZON, 90.0], AT_HORIZON)?;
                ratio = ratio.max(if near > 0.0 { near / elsewhere.max(f64::MIN_POSITIVE) } else { 0.0 });
            }
            found.push(Horizon { theta_i, ratio: ratio.min(MOST_RATIO) });
        }
        Ok(found)
    }

    /// The largest f cos(theta_o) within elevations.
    fn brightest(&mut self, wi: [f64; 3], [from, to]: [f64; 2], rows: usize) -> Result<f64> {
        let turn = wi[1].atan2(wi[0]);
        let mut most = 0f64;
        for row in 0..rows {
            let theta = from + (to - from) * (row as f64 + 0.5) / rows as f64;
            for column in 0..AROUND {
                most = most.max(self.flux(wi, direction(theta, turn + column as f64 / AROUND as f64 * TAU))?);
            }
        }
        Ok(most)
    }

    fn flux(&mut self, wi: [f64; 3], wo: [f64; 3]) -> Result<f64> {
        let mut values = vec![0f32; self.channels];
        (self.eval)(wi, wo, &mut values)?;
        Ok(values.iter().map(|v| f64::from(*v)).sum::<f64>() / self.channels as f64 * wo[2])
    }
}

fn mirror([x, y, z]: [f64; 3]) -> [f64; 3] {
    [-x, -y, z]
}

/// Unit direction of an elevation in degrees and an azimuth in radians.
fn direction(theta: f64, phi: f64) -> [f64; 3] {
    let (sin, cos) = theta.to_radians().sin_cos();
    [sin * phi.cos(), sin * phi.sin(), cos]
}

/// Even in solid angle below the most elevation.
fn below(u: f64, v: f64) -> [f64; 3] {
    let z = 1.0 - u * (1.0 - MOST_ELEVATION.to_radians().cos());
    let (sin, phi) = ((1.0 - z * z).sqrt(), 2.0 * PI * v);
    [sin * phi.cos(), sin * phi.sin(), z]
}
