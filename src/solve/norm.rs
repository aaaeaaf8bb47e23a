//! The weighted l1 norm, of single coefficients or of the magnitudes of conjugate pairs.
//!
//! Coefficients are real vectors of an orthonormal representation. A Hermitian spectrum is held as pairs
//! (sqrt 2 Re, sqrt 2 Im) and real singles (DC, Nyquist); the l1 norm of its complex magnitudes is then a sum over
//! groups: weight |s_i| for a single, sqrt 2 weight hypot(s_i, s_j) for a pair. The Euclidean inner product stays the
//! plain one, so the dual norm is the largest group magnitude over group weight.

use super::vector::LANES;
use crate::error::{Error, Result};
use std::f64::consts::SQRT_2;

/// Range of the weights: squares and quotients of weights in it are finite and nonzero.
const WEIGHT_RANGE: std::ops::RangeInclusive<f64> = 1e-100..=1e100;

/// How far the weights of the two halves of a pair may differ, relative: rounding only.
const PAIR_TOLERANCE: f64 = 1e-9;

/// A weighted l1 norm ||W s||_1 over a fixed number of coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct Norm {
    groups: Groups,
    /// One weight per group, in the order of `groups`; that of a pair includes its sqrt 2.
    weights: Vec<f64>,
    /// 1 / weights
    inverses: Vec<f64>,
    cols: usize,
}

/// Which coefficients share a magnitude.
#[derive(Clone, Debug, PartialEq)]
enum Groups {
    /// Group i is coefficient i.
    Plain,
    /// The singles first, then the pairs.
    Paired { singles: Vec<u32>, pairs: Vec<[u32; 2]> },
}

impl Norm {
    /// The plain l1 norm of `cols` coefficients: all weights 1, no pairs.
    pub fn l1(cols: usize) -> Norm {
        Norm::from_groups(Groups::Plain, vec![1.0; cols], cols)
    }

    /// The norm of `cols` coefficients with `weights[i]` on coefficient i (all 1 if `None`) and `partner[i]` the other
    /// half of i's conjugate pair, i itself if there is none (no pairs at all if `None`).
    ///
    /// # Errors
    /// `InvalidArgument` where a length is not `cols`, a weight is outside 1e-100 to 1e100, `partner` is not its own
    /// inverse, or the two halves of a pair differ in weight.
    pub fn new(cols: usize, weights: Option<&[f64]>, partner: Option<&[u32]>) -> Result<Norm> {
        if let Some(w) = weights {
            if w.len() != cols {
                return invalid(format!("{} weights for {cols} coefficients", w.len()));
            }
            if let Some(i) = w.iter().position(|v| !WEIGHT_RANGE.contains(v)) {
                return invalid(format!("weight {i} is {}; weights are from 1e-100 to 1e100", w[i]));
            }
        }
        let weight = |i: usize| weights.map_or(1.0, |w| w[i]);
        let Some(partner) = partner else {
            return Ok(Norm::from_groups(Groups::Plain, (0..cols).map(weight).collect(), cols));
        };
        if partner.len() != cols {
            return invalid(format!("{} partners for {cols} coefficients", partner.len()));
        }
        let (mut singles, mut pairs) = (Vec::new(), Vec::new());
        let (mut single_weights, mut pair_weights) = (Vec::new(), Vec::new());
        for (i, &j) in partner.iter().enumerate() {
            let (other, i_word) = (j as usize, i as u32);
            if partner.get(other) != Some(&i_word) {
                return invalid(format!("partner of {i} is {j}, whose partner is not {i}"));
            }
            if other == i {
                singles.push(j);
                single_weights.push(weight(i));
            } else if i < other {
                if (weight(i) - weight(other)).abs() > PAIR_TOLERANCE * weight(i) {
                    return invalid(format!("pair {i}, {j} has weights {} and {}", weight(i), weight(other)));
                }
                pairs.push([i_word, j]);
                pair_weights.push(SQRT_2 * weight(i));
            }
        }
        single_weights.extend(pair_weights);
        Ok(Norm::from_groups(Groups::Paired { singles, pairs }, single_weights, cols))
    }

    fn from_groups(groups: Groups, weights: Vec<f64>, cols: usize) -> Norm {
        let inverses = weights.iter().map(|w| 1.0 / w).collect();
        Norm { groups, weights, inverses, cols }
    }

    /// Number of coefficients.
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Number of groups: coefficients, less one for each pair.
    pub fn groups(&self) -> usize {
        self.weights.len()
    }

    /// ||W s||_1. `s` has [`Norm::cols`] entries, as in all methods.
    ///
    /// # Panics
    /// This and all other methods panic where a slice's length is not [`Norm::cols`].
    pub fn primal(&self, s: &[f64]) -> f64 {
        self.fold(s, &self.weights, |sum, magnitude, weight| sum + weight * magnitude).iter().sum()
    }

    /// The dual norm: the largest group magnitude over group weight, max { <g, s> : ||W s||_1 <= 1 }.
    /// Zero where there are no coefficients; NaN entries are passed over.
    pub fn dual(&self, g: &[f64]) -> f64 {
        // Comparisons, not f64::max: they compile to one vector instruction.
        let larger = |a: f64, b: f64| if b > a { b } else { a };
        self.fold(g, &self.inverses, |largest, magnitude, inverse| larger(largest, magnitude * inverse))
            .into_iter()
            .fold(0.0, larger)
    }

    /// The proximal map of lambda ||W s||_1, in place: every group magnitude m becomes max(m - lambda weight, 0).
    pub fn soft_threshold(&self, s: &mut [f64], lambda: f64) {
        assert_eq!(s.len(), self.cols);
        match &self.groups {
            Groups::Plain => {
                for (v, &w) in s.iter_mut().zip(&self.weights) {
                    *v = (v.abs() - lambda * w).max(0.0).copysign(*v);
                }
            }
            Groups::Paired { singles, pairs } => {
                let (single_weights, pair_weights) = self.weights.split_at(singles.len());
                for (&i, &w) in singles.iter().zip(single_weights) {
                    let v = &mut s[i as usize];
                    *v = (v.abs() - lambda * w).max(0.0).copysign(*v);
                }
                for (&[i, j], &w) in pairs.iter().zip(pair_weights) {
                    let (i, j) = (i as usize, j as usize);
                    let threshold = lambda * w;
                    // Most pairs vanish, and this bound of the magnitude spares them the square root.
                    if s[i].abs() + s[j].abs() <= threshold {
                        (s[i], s[j]) = (0.0, 0.0);
                        continue;
                    }
                    let magnitude = pair_magnitude(s[i], s[j]);
                    let kept = magnitude - threshold;
                    let factor = if kept > 0.0 { kept / magnitude } else { 0.0 };
                    s[i] *= factor;
                    s[j] *= factor;
                }
            }
        }
    }

    /// Weight of every group, in the order of [`Norm::magnitudes`].
    pub(super) fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Writes every group's magnitude.
    pub(super) fn magnitudes(&self, s: &[f64], magnitudes: &mut [f64]) {
        assert_eq!(s.len(), self.cols);
        assert_eq!(magnitudes.len(), self.weights.len());
        match &self.groups {
            Groups::Plain => {
                for (m, v) in magnitudes.iter_mut().zip(s) {
                    *m = v.abs();
                }
            }
            Groups::Paired { singles, pairs } => {
                let (of_singles, of_pairs) = magnitudes.split_at_mut(singles.len());
                for (m, &i) in of_singles.iter_mut().zip(singles) {
                    *m = s[i as usize].abs();
                }
                let (m_lanes, m_rest) = of_pairs.as_chunks_mut::<LANES>();
                let (p_lanes, p_rest) = pairs.as_chunks::<LANES>();
                for (m, p) in m_lanes.iter_mut().zip(p_lanes) {
                    *m = pair_magnitudes(p, s);
                }
                for (m, &[i, j]) in m_rest.iter_mut().zip(p_rest) {
                    *m = pair_magnitude(s[i as usize], s[j as usize]);
                }
            }
        }
    }

    /// Folds `f(so far, magnitude, weight)` over the groups and their `weights`, in independent lanes from 0.
    #[inline(always)]
    fn fold(&self, s: &[f64], weights: &[f64], f: impl Fn(f64, f64, f64) -> f64) -> [f64; LANES] {
        assert_eq!(s.len(), self.cols);
        let mut lanes = [0.0; LANES];
        match &self.groups {
            Groups::Plain => {
                let (s_lanes, s_rest) = s.as_chunks::<LANES>();
                let (w_lanes, w_rest) = weights.as_chunks::<LANES>();
                for (v, w) in s_lanes.iter().zip(w_lanes) {
                    for k in 0..LANES {
                        lanes[k] = f(lanes[k], v[k].abs(), w[k]);
                    }
                }
                for (v, &w) in s_rest.iter().zip(w_rest) {
                    lanes[0] = f(lanes[0], v.abs(), w);
                }
            }
            Groups::Paired { singles, pairs } => {
                let (single_weights, pair_weights) = weights.split_at(singles.len());
                for (&i, &w) in singles.iter().zip(single_weights) {
                    lanes[0] = f(lanes[0], s[i as usize].abs(), w);
                }
                let (p_lanes, p_rest) = pairs.as_chunks::<LANES>();
                let (w_lanes, w_rest) = pair_weights.as_chunks::<LANES>();
                for (p, w) in p_lanes.iter().zip(w_lanes) {
                    let magnitudes = pair_magnitudes(p, s);
                    for k in 0..LANES {
                        lanes[k] = f(lanes[k], magnitudes[k], w[k]);
                    }
                }
                for (&[i, j], &w) in p_rest.iter().zip(w_rest) {
                    lanes[0] = f(lanes[0], pair_magnitude(s[i as usize], s[j as usize]), w);
                }
            }
        }
        lanes
    }
}

/// sqrt(a^2 + b^2); the slow, scaled form only where a square would leave the range.
fn pair_magnitude(a: f64, b: f64) -> f64 {
    let squared = a * a + b * b;
    if squared > 1e-280 && squared < 1e300 { squared.sqrt() } else { a.hypot(b) }
}

/// [`pair_magnitude`] of several pairs.
#[inline(always)]
fn pair_magnitudes(pairs: &[[u32; 2]; LANES], s: &[f64]) -> [f64; LANES] {
    let (mut a, mut b, mut magnitudes) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for (k, &[i, j]) in pairs.iter().enumerate() {
        (a[k], b[k]) = (s[i as usize], s[j as usize]);
    }
    let mut exact = true;
    for k in 0..LANES {
        let squared = a[k] * a[k] + b[k] * b[k];
        exact &= (squared > 1e-280) & (squared < 1e300) | (a[k].abs() + b[k].abs() == 0.0);
        magnitudes[k] = squared.sqrt();
    }
    if !exact {
        for k in 0..LANES {
            magnitudes[k] = a[k].hypot(b[k]);
        }
    }
    magnitudes
}

fn invalid<T>(what: String) -> Result<T> {
    Err(Error::InvalidArgument(what))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// DC, two pairs, Nyquist.
    const PARTNER: [u32; 6] = [0, 5, 4, 3, 2, 1];

    fn is_invalid(result: Result<Norm>) -> bool {
        matches!(result, Err(Error::InvalidArgument(_)))
    }

    #[test]
    fn bad_arguments_are_refused() {
        assert!(is_invalid(Norm::new(2, Some(&[1.0]), None)));
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-101, 1e101] {
            assert!(is_invalid(Norm::new(2, Some(&[1.0, bad]), None)));
        }
        assert!(is_invalid(Norm::new(2, None, Some(&[0]))));
        assert!(is_invalid(Norm::new(2, None, Some(&[0, 2]))));
        assert!(is_invalid(Norm::new(3, None, Some(&[1, 2, 0]))));
        assert!(is_invalid(Norm::new(2, Some(&[1.0, 2.0]), Some(&[1, 0]))));
        assert_eq!(Norm::new(0, None, None).unwrap().dual(&[]), 0.0);
    }

    #[test]
    fn pairs_count_as_complex_magnitudes() {
        // A Hermitian spectrum of 6 samples: real DC and Nyquist, (re, im) at 1 and 2, their conjugates at 5 and 4.
        let (dc, nyquist, z1, z2) = (-3.0f64, 0.5, (1.0f64, -2.0f64), (0.25f64, 4.0f64));
        let s = [dc, SQRT_2 * z1.0, SQRT_2 * z2.0, nyquist, SQRT_2 * z2.1, SQRT_2 * z1.1];
        let weights = [1.0, 2.0, 3.0, 4.0, 3.0, 2.0];
        let (m1, m2) = (z1.0.hypot(z1.1), z2.0.hypot(z2.1));
        let norm = Norm::new(6, Some(&weights), Some(&PARTNER)).unwrap();
        assert_eq!(norm.groups(), 4);
        let complex = 1.0 * 3.0 + 4.0 * 0.5 + 2.0 * (2.0 * m1) + 2.0 * (3.0 * m2);
        assert!((norm.primal(&s) - complex).abs() < 1e-14 * complex);

        // The complex soft threshold z max(1 - lambda w / |z|, 0), in the same scaling.
        let mut shrunk = s;
        norm.soft_threshold(&mut shrunk, 0.6);
        let (f1, f2) = (1.0 - 0.6 * 2.0 / m1, 1.0 - 0.6 * 3.0 / m2);
        let expected = [-2.4, SQRT_2 * z1.0 * f1, SQRT_2 * z2.0 * f2, 0.0, SQRT_2 * z2.1 * f2, SQRT_2 * z1.1 * f1];
        for (a, b) in shrunk.iter().zip(expected) {
            assert!((a - b).abs() < 1e-14, "{shrunk:?}");
        }
    }

    #[test]
    fn extreme_magnitudes_survive() {
        let norm = Norm::new(18, None, Some(&(0..18u32).map(|i| i ^ 1).collect::<Vec<_>>())).unwrap();
        for size in [1e-300, 1e-160, 1.0, 1e160, 1e300] {
            let s = [size; 18];
            let mut magnitudes = [0.0; 9];
            norm.magnitudes(&s, &mut magnitudes);
            for m in magnitudes {
                assert!((m / size - SQRT_2).abs() < 1e-15);
            }
            assert!((norm.dual(&s) / size - 1.0).abs() < 1e-15);
        }
        let mut s = [0.0; 18];
        norm.soft_threshold(&mut s, 0.0);
        assert_eq!(s, [0.0; 18]);
    }

    proptest! {
        #[test]
        fn dual_norm_bounds_inner_products_and_is_attained(
            s in prop::collection::vec(-5.0..5.0f64, 40),
            g in prop::collection::vec(-5.0..5.0f64, 40),
            weights in prop::collection::vec(0.1..9.0f64, 20),
            paired: bool,
        ) {
            let weights: Vec<f64> = (0..40).map(|i| weights[i / 2]).collect();
            let partner: Vec<u32> = (0..40).map(|i| if i < 4 { i } else { i ^ 1 }).collect();
            let norm = Norm::new(40, Some(&weights), paired.then_some(&partner)).unwrap();
            let product: f64 = s.iter().zip(&g).map(|(a, b)| a * b).sum();
            prop_assert!(product <= norm.primal(&s) * norm.dual(&g) * (1.0 + 1e-14));
            // The group that attains the dual norm, alone and scaled to norm 1.
            let best = (0..40).map(|i| {
                let j = if paired { partner[i] as usize } else { i };
                let mut only = vec![0.0; 40];
                (only[i], only[j]) = (g[i], g[j]);
                only.iter().zip(&g).map(|(a, b)| a * b).sum::<f64>() / norm.primal(&only)
            });
            let best = best.fold(0.0, f64::max);
            prop_assert!((best - norm.dual(&g)).abs() < 1e-13 * best);
        }
    }
}
