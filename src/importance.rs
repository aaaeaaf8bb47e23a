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

use crate::coords::upper_unit;
use crate::decode::Reader;
use crate::error::Result;
use crate::eval::Brdf;
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
pub struct Sample {
    /// Unit vector away from the surface, z along the normal, above the horizon (`z > 0`).
    pub wo: [f64; 3],
    /// Density of the draw there, 1/sr: what [`Importance::pdf`] says of `wo`.
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
/// # use csbrdf::{decode::Reader, encode::Encoder, eval::Brdf, table::synth::Recipe};
/// # let table = Recipe::named("rough-metal").unwrap().merl()?;
/// # let brdf = Brdf::open(Reader::open(Encoder::new().block_shape(&[15, 15, 30]).encode(&table)?.bytes)?)?;
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

impl<D: AsRef<[u8]>> Brdf<D> {
    /// What draws directions for this file: [`Importance::new`]. Nothing of it is kept here; keep it beside the `Brdf`.
    ///
    /// # Errors
    /// `Corrupt` if a block is damaged, `LimitExceeded` if the table is above the caller's limit or takes more than a call may.
    pub fn importance(&self) -> Result<Importance> {
        Importance::new(self.reader())
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
        let given = Given::new(upper_unit(wi)?)?;
        let [u, v] = u.map(|u| if u > 0.0 { u.min(BELOW_ONE) } else { 0.0 });
        let Some(knots) = self.knots(&given) else {
            let wo = by_cosine(u, v);
            return Some(Sample { wo, pdf: wo[2] / PI });
        };
        let wo = match u < COSINE_SHARE {
            true => by_cosine((u / COSINE_SHARE).min(BELOW_ONE), v),
            false => knots.draw(&given, ((u - COSINE_SHARE) / (1.0 - COSINE_SHARE)).min(BELOW_ONE), v),
        };
        Some(Sample { wo, pdf: density(&knots, &given, wo) })
    }

    /// Density of [`Importance::sample`] at `wo` for the given `wi`, 1/sr, per solid angle of `wo`; directions as in
    /// [`Brdf::eval`]. Over the hemisphere of `wo` it integrates to 1 for every `wi` above the horizon.
    ///
    /// 0 if one of them is zero, not finite, or not above the horizon (`z <= 0`). Always finite and not negative.
    pub fn pdf(&self, wi: [f64; 3], wo: [f64; 3]) -> f64 {
        let (Some(given), Some(wo)) = (upper_unit(wi).and_then(Given::new), upper_unit(wo)) else { return 0.0 };
        if wo[2] <= 0.0 {
            return 0.0;
        }
        self.knots(&given).map_or(wo[2] / PI, |knots| density(&knots, &given, wo))
    }

    /// `None` where the cosine alone decides.
    fn knots(&self, given: &Given) -> Option<Knots<'_>> {
        self.rings.as_ref().filter(|_| !given.is_grazing()).map(|rings| rings.knots(given))
    }
}

fn density(knots: &Knots, given: &Given, wo: [f64; 3]) -> f64 {
    COSINE_SHARE * wo[2] / PI + (1.0 - COSINE_SHARE) * knots.density(given, wo)
}

/// Malley's method: a disc, lifted to the hemisphere.
fn by_cosine(u: f64, v: f64) -> [f64; 3] {
    let (sin, cos) = (TAU * v).sin_cos();
    [u.sqrt() * cos, u.sqrt() * sin, (1.0 - u).sqrt()]
}
