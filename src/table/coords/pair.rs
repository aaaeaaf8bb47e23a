//! Half and difference angles of pairs of directions: of one, or of a batch on vector lanes.

use std::f64::consts::TAU;

use crate::base::portable::atan2;
use crate::base::simd::{Level, Task};

/// Pairs of a batch.
pub(crate) const BATCH: usize = 64;

/// Least length of the sum of two unit vectors that still has a direction.
const LEAST_SUM: f64 = 8.0 * f64::EPSILON;

/// Two directions and what their half and difference angles are made of; an angle costs its `atan2` only when asked.
pub(in crate::table) struct Pair {
    pub(in crate::table) wi: [f64; 3],
    pub(in crate::table) wo: [f64; 3],
    /// `|wi + wo|` and `|wi - wo|`, 2 cos(theta_d) and 2 sin(theta_d).
    along: f64,
    across: f64,
    /// Length of `wi + wo` over the surface, and its height.
    radius: f64,
    height: f64,
    sin_phi_h: f64,
    cos_phi_h: f64,
}

impl Pair {
    pub(in crate::table) fn new(wi: [f64; 3], wo: [f64; 3]) -> Option<Pair> {
        let pair = Pair::of_units(upper_unit(wi)?, upper_unit(wo)?);
        (pair.along >= LEAST_SUM).then_some(pair)
    }

    #[inline(always)]
    fn of_units(wi: [f64; 3], wo: [f64; 3]) -> Pair {
        let sum: [f64; 3] = std::array::from_fn(|k| wi[k] + wo[k]);
        let across = norm(std::array::from_fn(|k| wi[k] - wo[k]));
        let along = norm(sum);
        let radius = (sum[0] * sum[0] + sum[1] * sum[1]).sqrt();
        // Squares of less than this lose digits; the half vector is the normal to any precision.
        let tilted = radius > 1e-140;
        let divisor = if tilted { radius } else { 1.0 };
        let sin_phi_h = if tilted { sum[1] / divisor } else { 0.0 };
        let cos_phi_h = if tilted { sum[0] / divisor } else { 1.0 };
        let radius = if tilted { radius } else { 0.0 };
        Pair { wi, wo, along, across, radius, height: sum[2], sin_phi_h, cos_phi_h }
    }

    #[inline(always)]
    pub(in crate::table) fn theta_h(&self) -> f64 {
        atan2(self.radius, self.height)
    }

    #[inline(always)]
    pub(in crate::table) fn phi_h(&self) -> f64 {
        azimuth(self.sin_phi_h, self.cos_phi_h)
    }

    /// The `atan2` keeps its digits at both ends, where the `acos` of the reference reader loses half of them.
    #[inline(always)]
    pub(in crate::table) fn theta_d(&self) -> f64 {
        atan2(self.across, self.along)
    }

    /// In the half vector's frame `wi - wo` is 2 sin(theta_d) times (cos(phi_d), sin(phi_d), 0).
    #[inline(always)]
    pub(in crate::table) fn phi_d(&self) -> f64 {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|k| self.wi[k] - self.wo[k]);
        let (sin_h, cos_h) = (self.radius / self.along, self.height / self.along);
        let tangent = cos_h * (self.cos_phi_h * x + self.sin_phi_h * y) - sin_h * z;
        azimuth(self.cos_phi_h * y - self.sin_phi_h * x, tangent)
    }
}

/// theta_h, theta_d and phi_d of up to [`BATCH`] pairs: the same bits as one by one.
pub(crate) struct Batch([[f64; BATCH]; 3]);

impl Batch {
    pub(crate) fn new() -> Batch {
        Batch([[f64::NAN; BATCH]; 3])
    }

    /// Fills the first places.
    pub(crate) fn fill(&mut self, wi: &[[f64; 3]], wo: &[[f64; 3]]) {
        Level::detect().run(Fill { wi, wo, out: &mut self.0 });
    }

    /// theta_h, theta_d and phi_d; NaN where [`Pair::new`] must be asked.
    pub(crate) fn angles(&self, i: usize) -> [f64; 3] {
        self.0.each_ref().map(|angles| angles[i])
    }
}

struct Fill<'a> {
    wi: &'a [[f64; 3]],
    wo: &'a [[f64; 3]],
    out: &'a mut [[f64; BATCH]; 3],
}

impl Task for Fill<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let [theta_h, theta_d, phi_d] = self.out;
        for (i, (wi, wo)) in self.wi.iter().zip(self.wo).take(BATCH).enumerate() {
            let (i_length, o_length) = (norm(*wi), norm(*wo));
            let pair = Pair::of_units(wi.map(|c| c / i_length), wo.map(|c| c / o_length));
            // Comparisons are false where something is not finite.
            let usual = (wi[2] >= 0.0) & (wo[2] >= 0.0) & is_usual(i_length) & is_usual(o_length);
            let usual = usual & (pair.along >= LEAST_SUM);
            theta_h[i] = if usual { pair.theta_h() } else { f64::NAN };
            theta_d[i] = pair.theta_d();
            phi_d[i] = pair.phi_d();
        }
    }
}

/// `atan2` in 0..2 pi, 2 pi excluded; 0 where both are zero.
#[inline(always)]
pub(in crate::table) fn azimuth(y: f64, x: f64) -> f64 {
    let phi = atan2(y, x);
    let phi = if phi < 0.0 { phi + TAU } else { phi };
    if phi < TAU { phi } else { 0.0 }
}

#[inline(always)]
pub(in crate::table) fn norm(v: [f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

/// Whether the squares of components of a vector of this length neither overflow nor vanish.
#[inline(always)]
#[allow(clippy::manual_range_contains, reason = "without a branch")]
fn is_usual(length: f64) -> bool {
    (length >= 1e-100) & (length < 1e100)
}

/// The direction at unit length; `None` if zero, not finite or below the horizon.
pub(crate) fn upper_unit(w: [f64; 3]) -> Option<[f64; 3]> {
    if w.iter().any(|c| !c.is_finite()) || w[2] < 0.0 {
        return None;
    }
    let length = norm(w);
    if is_usual(length) {
        return Some(w.map(|c| c / length));
    }
    // Scaled first, so that neither huge nor denormal components are lost in their squares.
    let largest = w.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    let scaled = w.map(|c| c / largest);
    let length = norm(scaled);
    (largest > 0.0).then(|| scaled.map(|c| c / length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn component() -> impl Strategy<Value = f64> {
        prop_oneof![
            8 => -1.0..1.0,
            1 => prop::sample::select(vec![0.0, -0.0, 1.0, 1e-120, 1e-310, 1e200, f64::MAX, f64::INFINITY, f64::NAN]),
        ]
    }

    fn direction() -> impl Strategy<Value = [f64; 3]> {
        // Most of them above the horizon.
        (component(), component(), component()).prop_map(|(x, y, z)| [x, y, if z < 0.0 && z > -0.7 { -z } else { z }])
    }

    proptest! {
        /// At every level, whatever the directions; a batch may only ask where there is an answer of another kind.
        #[test]
        fn a_batch_gives_the_angles_of_each_pair(pairs in prop::collection::vec((direction(), direction()), 1..if cfg!(miri) { 5 } else { BATCH })) {
            let (wi, wo): (Vec<[f64; 3]>, Vec<[f64; 3]>) = pairs.iter().copied().unzip();
            for level in Level::all() {
                let mut batch = Batch::new();
                level.run(Fill { wi: &wi, wo: &wo, out: &mut batch.0 });
                for (i, &(wi, wo)) in pairs.iter().enumerate() {
                    let angles = batch.angles(i);
                    if let Some(pair) = Pair::new(wi, wo).filter(|_| !angles[0].is_nan()) {
                        let expected = [pair.theta_h(), pair.theta_d(), pair.phi_d()];
                        prop_assert_eq!(angles.map(f64::to_bits), expected.map(f64::to_bits));
                    } else {
                        prop_assert!(angles[0].is_nan());
                        let plain = |w: [f64; 3]| w[2] >= 0.0 && is_usual(norm(w));
                        let opposite = Pair::new(wi, wo).is_none();
                        prop_assert!(opposite || !plain(wi) || !plain(wo));
                    }
                }
            }
        }
    }
}
