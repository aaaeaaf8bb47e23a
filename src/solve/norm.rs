//! The weighted l1 norm, of single coefficients or of the magnitudes of conjugate pairs.
//!
//! Coefficients are real vectors of an orthonormal representation. A Hermitian spectrum is held as pairs
//! (sqrt 2 Re, sqrt 2 Im) and real singles (DC, Nyquist); the l1 norm of its complex magnitudes is then a sum over
//! groups: weight |s_i| for a single, sqrt 2 weight hypot(s_i, s_j) for a pair. The Euclidean inner product stays the
//! plain one, so the dual norm is the largest group magnitude over group weight.

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
        Norm { groups: Groups::Plain, weights: vec![1.0; cols], cols }
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
            return Ok(Norm { groups: Groups::Plain, weights: (0..cols).map(weight).collect(), cols });
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
        Ok(Norm { groups: Groups::Paired { singles, pairs }, weights: single_weights, cols })
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
        let mut sums = [0.0; 4];
        let mut lane = 0;
        self.for_each(s, |magnitude, weight| {
            sums[lane] += weight * magnitude;
            lane = (lane + 1) % 4;
        });
        sums.iter().sum()
    }

    /// The dual norm: the largest group magnitude over group weight, max { <g, s> : ||W s||_1 <= 1 }.
    /// Zero where there are no coefficients; NaN entries are passed over.
    pub fn dual(&self, g: &[f64]) -> f64 {
        let mut largest = [0.0f64; 4];
        let mut lane = 0;
        self.for_each(g, |magnitude, weight| {
            largest[lane] = largest[lane].max(magnitude / weight);
            lane = (lane + 1) % 4;
        });
        largest.iter().fold(0.0, |a, &b| a.max(b))
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
                    let magnitude = pair_magnitude(s[i], s[j]);
                    let kept = (magnitude - lambda * w).max(0.0);
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
                for (m, &[i, j]) in of_pairs.iter_mut().zip(pairs) {
                    *m = pair_magnitude(s[i as usize], s[j as usize]);
                }
            }
        }
    }

    /// Calls `f(magnitude, weight)` for every group.
    #[inline(always)]
    fn for_each(&self, s: &[f64], mut f: impl FnMut(f64, f64)) {
        assert_eq!(s.len(), self.cols);
        match &self.groups {
            Groups::Plain => s.iter().zip(&self.weights).for_each(|(v, &w)| f(v.abs(), w)),
            Groups::Paired { singles, pairs } => {
                let (single_weights, pair_weights) = self.weights.split_at(singles.len());
                singles.iter().zip(single_weights).for_each(|(&i, &w)| f(s[i as usize].abs(), w));
                for (&[i, j], &w) in pairs.iter().zip(pair_weights) {
                    f(pair_magnitude(s[i as usize], s[j as usize]), w);
                }
            }
        }
    }
}

/// sqrt(a^2 + b^2); the slow, scaled form only where squares would leave the range.
#[inline]
fn pair_magnitude(a: f64, b: f64) -> f64 {
    let squared = a * a + b * b;
    if (1e-280..=1e300).contains(&squared) { squared.sqrt() } else { a.hypot(b) }
}

fn invalid<T>(what: String) -> Result<T> {
    Err(Error::InvalidArgument(what))
}
