//! Directions drawn where a material reflects: importance sampling for renderers.
//!
//! The table behind it holds, for some elevations of the given direction, how much is reflected by way of the half
//! vectors of each ring around the normal, and of parts of each ring. A ring is drawn by these weights, a part of it, a
//! half vector evenly within, and the given direction is mirrored in it. Half vectors whose mirror image is below the
//! horizon are cut off before the draw, not after: no draw is lost, and the density integrates to 1 over the hemisphere
//! whatever the weights are. They come from the means of the file over phi_d (and phi_h), so a density is close to the
//! BRDF times the cosine, but never the same.

pub(crate) mod geometry;
mod marginal;
mod rings;
#[cfg(test)]
mod tests;

use std::f64::consts::{PI, TAU};
use std::sync::PoisonError;

use crate::base::error::Result;
use crate::brdf::Brdf;
use crate::decode::Reader;
use crate::table::coords::upper_unit;
use geometry::Given;
use marginal::Marginal;
use rings::{Knots, Rings};

/// Share of the draws that follow the cosine alone. Where the means show less than there is, a draw weighs at most 1 /
/// share of what it would by the cosine alone. Measured: 0.02 takes a fifth off the noise of metals, but single draws on
/// felt weigh 18 times the mean, not 6; 0.1 adds noise everywhere.
const COSINE_SHARE: f64 = 0.05;

/// Largest number below 1.
const BELOW_ONE: f64 = 1.0 - f64::EPSILON / 2.0;

/// A direction that was drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Sample {
    /// Unit vector away from the surface, z along the normal, above the horizon (`z > 0`).
    pub wo: [f64; 3],
    /// Density of the draw there, 1/sr: what [`Importance::pdf`] says of `wo`, to the bit.
    pub pdf: f64,
}

/// Draws directions about in proportion to BRDF times cosine. Some 100 kB, independent of the file once made; shared
/// between threads by reference.
///
/// A BRDF is reciprocal: the given direction may be that of the view and the drawn one that of the light, or the other
/// way round. Draws depend on the arguments alone.
///
/// ```
/// # #[cfg(feature = "encode")] {
/// # use csbrdf::{Brdf, encode::Encoder, table::synth::Recipe};
/// # let table = Recipe::named("rough-metal").unwrap().merl()?;
/// # let brdf = Brdf::from_bytes(Encoder::new().block_shape(&[15, 15, 30]).encode(&table)?.bytes)?;
/// let importance = brdf.importance()?; // decodes the file once
/// let wi = [0.6, 0.0, 0.8];
/// let mut albedo = 0.0;
/// for i in 0..256 {
///     let u = [(i as f64 + 0.5) / 256.0, (i as f64 * 0.618_033_988_749_895).fract()];
///     if let Some(sample) = importance.sample(wi, u) {
///         let [red, ..] = brdf.eval(wi, sample.wo)?;
///         albedo += f64::from(red) * sample.wo[2] / sample.pdf / 256.0;
///     }
/// }
/// assert!((0.5..1.0).contains(&albedo));
/// # }
/// # Ok::<(), csbrdf::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Importance {
    /// `None`: by the cosine alone.
    rings: Option<Rings>,
}

impl Brdf {
    /// What draws directions for this file, as [`Importance::new`]: made with the first call, which decodes the file once, and kept.
    ///
    /// # Errors
    /// `Corrupt` if a block is damaged, `LimitExceeded` if the table is above the caller's limit or takes more than a call may.
    pub fn importance(&self) -> Result<&Importance> {
        if let Some(made) = self.importance.get() {
            return Ok(made);
        }
        // Others wait: the file is decoded once.
        let _making = self.making.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(made) = self.importance.get() {
            return Ok(made);
        }
        let new = Importance::new(&self.reader)?;
        Ok(self.importance.get_or_init(|| new))
    }

    /// Draws a direction about in proportion to BRDF times cosine: [`Importance::sample`]. The first call decodes the file once.
    ///
    /// # Errors
    /// As [`Brdf::importance`].
    pub fn sample(&self, wi: [f64; 3], u: [f64; 2]) -> Result<Option<Sample>> {
        Ok(self.importance()?.sample(wi, u))
    }

    /// Density of [`Brdf::sample`] at `wo`, 1/sr: [`Importance::pdf`]. The first call decodes the file once.
    ///
    /// # Errors
    /// As [`Brdf::importance`].
    pub fn pdf(&self, wi: [f64; 3], wo: [f64; 3]) -> Result<f64> {
        Ok(self.importance()?.pdf(wi, wo))
    }
}

impl Importance {
    /// Decodes the file once, block after block on the calling thread, for the means of its channels; keeps no block.
    ///
    /// Grids of half and difference angles only, with theta_h and any of theta_d, phi_d, phi_h; over phi_h, that is
    /// over the turn of the surface, the mean is taken. For all others the same as [`Importance::cosine`], and nothing
    /// is decoded.
    ///
    /// Blocks that were pruned from the file, unless the reader takes their means, count as if they were not on the
    /// grid: other weights than those of the whole file, and few draws lead there, but not none.
    ///
    /// # Errors
    /// `Corrupt` if a block is damaged, `LimitExceeded` if the table is above the caller's limit or takes more than a call may.
    pub fn new<D: AsRef<[u8]>>(reader: &Reader<D>) -> Result<Importance> {
        let marginal = Marginal::of(reader)?;
        Ok(Importance { rings: marginal.map(|marginal| Rings::new(|pair| marginal.at(pair))) })
    }

    /// Draws by the cosine alone, for any material: density `cos(theta_o) / pi`.
    pub fn cosine() -> Importance {
        Importance { rings: None }
    }

    /// Draws a direction for `wi` (away from the surface, z along the normal, of any length) by two numbers in [0, 1),
    /// which may be of a stratified or low-discrepancy set: near ones mostly give near directions. Numbers outside go
    /// to the nearer end, NaN to 0.
    ///
    /// `None` if and only if `wi` is zero, not finite, or not above the horizon (`z <= 0`).
    pub fn sample(&self, wi: [f64; 3], u: [f64; 2]) -> Option<Sample> {
        let given = Given::new(unit(wi)?)?;
        let [u, v] = u.map(|u| if u > 0.0 { u.min(BELOW_ONE) } else { 0.0 });
        let knots = self.knots(&given);
        let wo = match &knots {
            None => by_cosine(u, v),
            Some(_) if u < COSINE_SHARE => by_cosine((u / COSINE_SHARE).min(BELOW_ONE), v),
            Some(knots) => knots.draw(&given, ((u - COSINE_SHARE) / (1.0 - COSINE_SHARE)).min(BELOW_ONE), v),
        };
        // What `pdf` makes of it, to the bit: near the last azimuth above the horizon the density grows without bound, and
        // a direction that differs in its last digits may have another one in the fourth.
        let wo = unit(wo)?;
        Some(Sample { wo, pdf: density(knots.as_ref(), &given, wo) })
    }

    /// Density of [`Importance::sample`] at `wo` for the given `wi`, 1/sr, per solid angle of `wo`; directions as in
    /// [`Brdf::eval`]. Over the hemisphere of `wo` it integrates to 1 for every `wi` above the horizon.
    ///
    /// 0 if one of them is zero, not finite, or not above the horizon (`z <= 0`). Always finite and not negative.
    pub fn pdf(&self, wi: [f64; 3], wo: [f64; 3]) -> f64 {
        let (Some(given), Some(wo)) = (unit(wi).and_then(Given::new), unit(wo)) else { return 0.0 };
        if wo[2] <= 0.0 {
            return 0.0;
        }
        density(self.knots(&given).as_ref(), &given, wo)
    }

    /// `None` where the cosine alone decides.
    fn knots(&self, given: &Given) -> Option<Knots<'_>> {
        self.rings.as_ref().filter(|_| !given.is_grazing()).map(|rings| rings.knots(given))
    }
}

/// By the cosine alone without knots.
fn density(knots: Option<&Knots>, given: &Given, wo: [f64; 3]) -> f64 {
    let by_cosine = wo[2] / PI;
    knots.map_or(by_cosine, |knots| COSINE_SHARE * by_cosine + (1.0 - COSINE_SHARE) * knots.density(given, wo))
}

/// Squared lengths this near to 1 are those of unit vectors after rounding.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// The direction at unit length, `None` as of [`upper_unit`]; as it is if that is its length, so that once more changes
/// nothing.
fn unit(w: [f64; 3]) -> Option<[f64; 3]> {
    let square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
    if (square - 1.0).abs() <= ROUNDING && w[2] >= 0.0 {
        return Some(w);
    }
    let mut unit = upper_unit(w)?;
    if w[2] > 0.0 {
        // Above the horizon stays so, however little.
        unit[2] = unit[2].max(f64::MIN_POSITIVE);
    }
    Some(unit)
}

/// Malley's method: a disc, lifted to the hemisphere.
fn by_cosine(u: f64, v: f64) -> [f64; 3] {
    let (sin, cos) = (TAU * v).sin_cos();
    [u.sqrt() * cos, u.sqrt() * sin, (1.0 - u).sqrt()]
}
