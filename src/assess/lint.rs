//! Whether a material could exist: energy, reciprocity, mirror symmetry, and what goes on at the horizon.
//!
//! Looked at is what a renderer gets: values between bins, and what was filled in where nothing was measured.
//! Directions and quadratures are fixed, so that the same material gives the same findings.

mod measure;

use std::fmt;

use crate::base::budget::Budget;
use crate::base::error::Result;
use crate::brdf::Brdf;
use crate::decode::Reader;
use crate::table::grid::Grid;
use crate::table::parameterization::Parameterization;
#[cfg(feature = "encode")]
use crate::{assess::render::Texels, table::Table, table::horizon::Horizon as Elevations};
pub use measure::{Albedo, Deviation, Horizon};

/// Reciprocity is warned of above this rms of the log deviation: more than noise of a measurement.
pub const MOST_DEVIATION: f64 = 0.05;

/// The horizon is warned of where it gets this many times the light of all other directions.
pub const MOST_AT_HORIZON: f64 = 1.0;

/// What was found about a material.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Findings {
    /// Names of the channels that were looked at.
    pub channels: Vec<String>,
    /// At elevations from the normal to near the horizon.
    pub albedos: Vec<Albedo>,
    /// Between (wi, wo) and (wo, wi).
    pub reciprocity: Deviation,
    /// The grid has one bin for both, so that nothing can deviate.
    pub is_reciprocal_by_grid: bool,
    /// Between (wi, wo) and their mirror images; 0 if the material is isotropic without a sense of rotation.
    pub mirror: Deviation,
    /// Light towards the horizon, at elevations of wi up to 60 degrees.
    pub horizon: Vec<Horizon>,
    /// Where the entries come from.
    pub shares: Shares,
}

/// Entries of a table over all channels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Shares {
    /// Measured.
    pub measured: usize,
    /// Possible, but not measured.
    pub missing: usize,
    /// In bins wholly below the horizon.
    pub impossible: usize,
}

/// What a material that exists would not do.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// More light is reflected than arrives.
    Energy {
        /// Elevation of wi, degrees.
        theta_i: f64,
        /// Name of the channel.
        channel: String,
        /// Directional albedo.
        albedo: f64,
        /// Error of the quadrature.
        error: f64,
    },
    /// Light does not go back the way it came.
    Reciprocity(Deviation),
    /// Most light goes along the surface.
    Horizon(Horizon),
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Warning::Energy { theta_i, channel, albedo, error } => write!(
                f,
                "energy: reflects {albedo:.4} (+- {error:.4}) of the light in {channel} from {theta_i} degrees"
            ),
            Warning::Reciprocity(deviation) => write!(
                f,
                "reciprocity: (wi, wo) and (wo, wi) differ by {:.4} rms, {:.4} at most, in ln(f + {})",
                deviation.rms,
                deviation.max,
                measure::EPS
            ),
            Warning::Horizon(horizon) => write!(
                f,
                "horizon: for light from {} degrees, f cos(theta_o) beyond {} degrees is {:.2} times that elsewhere",
                horizon.theta_i,
                measure::NEAR_HORIZON,
                horizon.ratio
            ),
        }
    }
}

impl Findings {
    /// What is beyond the limits, the worst of its kind.
    pub fn warnings(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        let excess = |w: &Warning| match w {
            Warning::Energy { albedo, error, .. } => albedo - error,
            _ => 0.0,
        };
        let energies = self.albedos.iter().flat_map(|a| {
            let energy = |(channel, (&albedo, &error)): (&String, (&f64, &f64))| {
                let (theta_i, channel) = (a.theta_i, channel.clone());
                Warning::Energy { theta_i, channel, albedo, error }
            };
            self.channels.iter().zip(a.values.iter().zip(&a.errors)).map(energy)
        });
        warnings.extend(energies.max_by(|a, b| excess(a).total_cmp(&excess(b))).filter(|w| excess(w) > 1.0));
        if self.reciprocity.rms > MOST_DEVIATION {
            warnings.push(Warning::Reciprocity(self.reciprocity));
        }
        let horizon = self.horizon.iter().max_by(|a, b| a.ratio.total_cmp(&b.ratio));
        warnings.extend(horizon.filter(|h| h.ratio > MOST_AT_HORIZON).map(|h| Warning::Horizon(*h)));
        warnings
    }

    /// The largest albedo of all elevations and channels.
    pub fn largest_albedo(&self) -> f64 {
        self.albedos.iter().flat_map(|a| &a.values).copied().fold(0.0, f64::max)
    }
}

/// Looks at a file. Most blocks are decoded; takes some tenths of a second.
///
/// # Errors
/// `Corrupt` if a block is damaged, `Pruned` if one was left out, `LimitExceeded` if the table is above the caller's limit or takes
/// more than a call may.
pub fn lint_brdf(brdf: &Brdf) -> Result<Findings> {
    let (reader, call) = (brdf.reader(), brdf.reader().call());
    let shares = shares_of(reader, &call)?;
    let work = work_of_lookup(reader.grid());
    look(reader.grid(), shares, |wi, wo, values| {
        call.spend(work)?;
        brdf.eval_within(&call, wi, wo, values)
    })
}

/// Operations of a look-up in a cached block, and of adding its values up.
fn work_of_lookup(grid: &Grid) -> u64 {
    let values = grid.channels().len() << grid.axes().len();
    300 + values as u64 / 4
}

/// Looks at a table: its colours, as [`Texels`] reads them.
///
/// # Errors
/// `InvalidArgument` if the axes of the table are not angles of directions.
#[cfg(feature = "encode")]
pub fn lint_table(table: &Table) -> Result<Findings> {
    let elevations = Elevations::new(table.grid());
    let mut shares = Shares::default();
    let positions = table.grid().positions();
    let all = crate::table::block::positions(table.grid().shape());
    for (i, position) in all.enumerate() {
        let impossible = elevations.as_ref().is_some_and(|e| e.is_impossible(position));
        for valid in table.valid()[i..].iter().step_by(positions) {
            *match (valid, impossible) {
                (true, _) => &mut shares.measured,
                (false, false) => &mut shares.missing,
                (false, true) => &mut shares.impossible,
            } += 1;
        }
    }
    let texels = Texels::new(table);
    // The colours alone, under the names that Texels gives them.
    let colours = Grid::new(table.grid().axes().to_vec(), Grid::rgb_channels([1.0; 3]))?;
    look(&colours, shares, |wi, wo, values| {
        values.copy_from_slice(&texels.eval(wi, wo));
        Ok(())
    })
}

fn look(
    grid: &Grid,
    shares: Shares,
    mut eval: impl FnMut([f64; 3], [f64; 3], &mut [f32]) -> Result<()>,
) -> Result<Findings> {
    let parameterization = Parameterization::of(grid)?;
    let channels: Vec<String> = grid.channels().iter().map(|c| c.name.clone()).collect();
    let azimuths = if parameterization.is_isotropic() { 1 } else { measure::AZIMUTHS };
    let mut look = measure::Look { channels: channels.len(), azimuths, eval: &mut eval };
    Ok(Findings {
        albedos: look.albedos()?,
        reciprocity: look.deviation(|wi, wo| (wo, wi))?,
        is_reciprocal_by_grid: parameterization.folds_by_reciprocity(),
        mirror: look.deviation(|wi, wo| (mirrored(wi), mirrored(wo)))?,
        horizon: look.horizon()?,
        channels,
        shares,
    })
}

fn mirrored([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, -y, z]
}

fn shares_of<D: AsRef<[u8]>>(reader: &Reader<D>, budget: &Budget) -> Result<Shares> {
    reader.check_table_size()?;
    let mut shares = Shares::default();
    for block in 0..reader.block_count() {
        let [sampled, measured, filled, impossible] = reader.origins(block, budget)?;
        shares.measured += sampled + measured;
        shares.missing += filled;
        shares.impossible += impossible;
    }
    Ok(shares)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::grid::{Axis, AxisName, Mapping};
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    fn findings(eval: impl Fn([f64; 3], [f64; 3]) -> f64) -> Findings {
        look(&Grid::merl(), Shares::default(), |wi, wo, values| {
            values.fill(eval(wi, wo) as f32);
            Ok(())
        })
        .unwrap()
    }

    #[test]
    #[cfg_attr(miri, ignore = "integrals of millions of points")]
    fn a_lambertian_surface_has_its_albedo_everywhere() {
        let found = findings(|_, _| 0.7 / PI);
        assert_eq!(found.albedos.len(), 7);
        for albedo in &found.albedos {
            assert!((albedo.values[1] - 0.7).abs() < 1e-3, "{albedo:?}");
            assert!(albedo.errors[1] < 2e-3 && (albedo.values[1] - 0.7).abs() <= albedo.errors[1], "{albedo:?}");
        }
        assert!(found.warnings().is_empty());
        assert_eq!((found.reciprocity.max, found.mirror.max), (0.0, 0.0));
        // Light at 80 degrees and beyond is at most cos(80) of that along the normal.
        assert!(found.horizon.iter().all(|h| (0.1..0.18).contains(&h.ratio)), "{:?}", found.horizon);
        let bright = findings(|_, _| 1.02 / PI).warnings();
        assert!(matches!(bright[..], [Warning::Energy { albedo, .. }] if (albedo - 1.02).abs() < 2e-3), "{bright:?}");
    }

    #[test]
    #[cfg_attr(miri, ignore = "integrals of millions of points")]
    fn a_narrow_lobe_is_integrated() {
        // A GGX lobe without masking and Fresnel, times 1 / (4 cos_i cos_o), reflects D cos(theta_h) integrated: 1 at
        // the normal.
        let alpha2 = 1e-6;
        let found = findings(|wi, wo| {
            let sum: [f64; 3] = std::array::from_fn(|k| wi[k] + wo[k]);
            let level = sum[0] * sum[0] + sum[1] * sum[1];
            let (sin2, cos2) = (level / (level + sum[2] * sum[2]), sum[2] * sum[2] / (level + sum[2] * sum[2]));
            let root = alpha2 * cos2 + sin2;
            alpha2 / (PI * root * root) / (4.0 * wi[2] * wo[2].max(1e-3))
        });
        assert!((found.albedos[0].values[0] - 1.0).abs() < 5e-3, "{:?}", found.albedos[0]);
    }

    #[test]
    #[cfg_attr(miri, ignore = "integrals of millions of points")]
    fn what_cannot_be_is_reported() {
        let one_way = findings(|wi, wo| 0.1 + if wi[2] > wo[2] { 0.02 } else { 0.0 });
        let [Warning::Reciprocity(deviation)] = one_way.warnings()[..] else { panic!("{one_way:?}") };
        assert!((deviation.max - (0.121f64 / 0.101).ln()).abs() < 1e-6, "{deviation:?}");
        assert_eq!(one_way.mirror.max, 0.0);
        // Handed, but reciprocal.
        let handed = findings(|wi, wo| {
            let across = wi[0] * wo[1] - wi[1] * wo[0];
            if across * (wi[2] - wo[2]) > 0.0 { 0.1 } else { 0.2 }
        });
        assert!(handed.warnings().is_empty() && handed.reciprocity.max == 0.0 && handed.mirror.max > 0.6);
        let glowing = findings(|_, wo| if wo[2] < 0.1 { 0.1 / (wo[2] + 1e-4) } else { 0.01 });
        assert!(glowing.warnings().iter().any(|w| matches!(w, Warning::Horizon(h) if h.ratio > 5.0)));
    }

    #[test]
    fn grids_say_what_they_cannot_tell_apart() {
        let of = |grid: &Grid| Parameterization::of(grid).unwrap();
        let (is_reciprocal, is_isotropic) =
            (|grid: &Grid| of(grid).folds_by_reciprocity(), |grid: &Grid| of(grid).is_isotropic());
        assert!(is_reciprocal(&Grid::merl()) && !is_reciprocal(&Grid::merl_360()) && is_isotropic(&Grid::merl()));
        let axis = |name, end| Axis { name, len: 8, mapping: Mapping::Linear, start: 0.0, end };
        let grid = |axes: &[Axis]| Grid::new(axes.to_vec(), Grid::rgb_channels([1.0; 3])).unwrap();
        let (i, o) = (axis(AxisName::ThetaI, FRAC_PI_2), axis(AxisName::ThetaO, FRAC_PI_2));
        let one = grid(&[i, o, axis(AxisName::PhiO, TAU)]);
        assert!(is_isotropic(&one) && !is_reciprocal(&one));
        let two = grid(&[i, axis(AxisName::PhiI, TAU), o, axis(AxisName::PhiO, TAU)]);
        assert!(!is_isotropic(&two));
        let turned = grid(&[axis(AxisName::PhiH, TAU), axis(AxisName::ThetaH, FRAC_PI_2)]);
        assert!(!is_isotropic(&turned) && is_reciprocal(&turned));
    }
}
