//! The weighted l1 norm, of single coefficients or of the magnitudes of groups of them.
//!
//! Coefficients are real vectors of an orthonormal representation. A Hermitian spectrum is held as pairs
//! (sqrt 2 Re, sqrt 2 Im) and real singles (DC, Nyquist); the l1 norm of its complex magnitudes is then a sum over
//! groups: weight |s_i| for a single, sqrt 2 weight hypot(s_i, s_j) for a pair. Channels that share their support are
//! coupled by the same means: the group of coefficient k holds those of all channels, and real and imaginary parts.
//! The Euclidean inner product stays the plain one, so the dual norm is the largest group magnitude over group weight.

use super::groups::{Class, Groups};
use super::vector::{max_abs, scale};
use crate::base::error::{Error, Result};
use std::f64::consts::SQRT_2;

/// Range of the weights: squares and quotients of weights in it are finite and nonzero.
const WEIGHT_RANGE: std::ops::RangeInclusive<f64> = 1e-100..=1e100;

/// How far the weights of the two halves of a pair may differ, relative: rounding only.
const PAIR_TOLERANCE: f64 = 1e-9;

/// A weighted l1 norm ||W s||_1 over a fixed number of coefficients.
#[derive(Clone, Debug, PartialEq)]
pub struct Norm {
    groups: Groups,
    cols: usize,
}

impl Norm {
    /// The plain l1 norm of `cols` coefficients: all weights 1, no pairs.
    pub fn l1(cols: usize) -> Norm {
        Norm::group(cols, 1, None, None).expect("no argument to refuse")
    }

    /// The norm of `cols` coefficients with `weights[i]` on coefficient i (all 1 if `None`) and `partner[i]` the other
    /// half of i's conjugate pair, i itself if there is none (no pairs at all if `None`).
    ///
    /// # Errors
    /// `InvalidArgument` where a length is not `cols`, a weight is outside 1e-100 to 1e100, `partner` is not its own
    /// inverse, or the two halves of a pair differ in weight.
    pub fn new(cols: usize, weights: Option<&[f64]>, partner: Option<&[u32]>) -> Result<Norm> {
        Norm::group(cols, 1, weights, partner)
    }

    /// The joint norm of `channels` times `cols` coefficients, `[channel][k]`: sum_k w_k ||(s_1k, .., s_Ck)||_2, which
    /// makes the channels share their support. `weights` and `partner` are those of one channel, as in [`Norm::new`];
    /// the group of a pair holds both its halves of all channels.
    ///
    /// # Errors
    /// As [`Norm::new`], and where `channels` is 0.
    pub fn group(cols: usize, channels: usize, weights: Option<&[f64]>, partner: Option<&[u32]>) -> Result<Norm> {
        if channels == 0 {
            return invalid("a norm over 0 channels".to_string());
        }
        if let Some(w) = weights {
            if w.len() != cols {
                return invalid(format!("{} weights for {cols} coefficients", w.len()));
            }
            if let Some(i) = w.iter().position(|v| !WEIGHT_RANGE.contains(v)) {
                return invalid(format!("weight {i} is {}; weights are from 1e-100 to 1e100", w[i]));
            }
        }
        let weight = |i: usize| weights.map_or(1.0, |w| w[i]);
        let (mut singles, mut pairs) = (Vec::new(), Vec::new());
        let (mut single_weights, mut pair_weights) = (Vec::new(), Vec::new());
        match partner {
            None => {
                singles.extend(0..cols as u32);
                single_weights.extend((0..cols).map(weight));
            }
            Some(partner) if partner.len() != cols => {
                return invalid(format!("{} partners for {cols} coefficients", partner.len()));
            }
            Some(partner) => {
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
            }
        }
        // Member after member: channel after channel, and of pairs the first halves before the second ones.
        let of_channel = |c: usize| move |&k: &u32| (c * cols) as u32 + k;
        let singles: Vec<Vec<u32>> = (0..channels).map(|c| singles.iter().map(of_channel(c)).collect()).collect();
        let pairs: Vec<Vec<u32>> =
            (0..2 * channels).map(|m| pairs.iter().map(|pair| of_channel(m / 2)(&pair[m % 2])).collect()).collect();
        let classes = [Class::new(singles, single_weights), Class::new(pairs, pair_weights)];
        let cols = cols * channels;
        Ok(Norm { groups: Groups::new(classes.into_iter().filter(|c| !c.is_empty()), cols), cols })
    }

    /// Number of coefficients, all channels counted.
    pub fn cols(&self) -> usize {
        self.cols
    }

    /// Number of groups.
    pub fn groups(&self) -> usize {
        self.groups.count()
    }

    /// The groups in the order in which the solver holds them.
    pub(super) fn packing(&self) -> &Groups {
        &self.groups
    }

    /// ||W s||_1. `s` has [`Norm::cols`] entries, as in all methods.
    ///
    /// # Panics
    /// This and all other methods panic where a slice's length is not [`Norm::cols`].
    pub fn primal(&self, s: &[f64]) -> f64 {
        let (packed, unit) = self.packed_unit(s);
        self.groups.primal(&packed) * unit
    }

    /// The dual norm: the largest group magnitude over group weight, max { <g, s> : ||W s||_1 <= 1 }.
    /// Zero where there are no coefficients.
    pub fn dual(&self, g: &[f64]) -> f64 {
        let (packed, unit) = self.packed_unit(g);
        self.groups.dual_and_square(&packed).0 * unit
    }

    /// The proximal map of lambda ||W s||_1, in place: every group magnitude m becomes max(m - lambda weight, 0).
    pub fn soft_threshold(&self, s: &mut [f64], lambda: f64) {
        let (mut packed, unit) = self.packed_unit(s);
        let mut magnitudes = vec![0.0; self.groups.slots()];
        self.groups.magnitudes(&packed, &mut magnitudes);
        self.groups.shrink(&mut packed, &magnitudes, lambda / unit);
        scale(&mut packed, unit);
        self.groups.unpack(&packed, s);
    }

    /// Flags the coefficients of the groups whose magnitude is above `threshold` times the largest one.
    pub(super) fn support(&self, s: &[f64], threshold: f64) -> Vec<bool> {
        let (packed, _) = self.packed_unit(s);
        let mut magnitudes = vec![0.0; self.groups.slots()];
        self.groups.magnitudes(&packed, &mut magnitudes);
        let largest = max_abs(&magnitudes);
        let mut flags = vec![1.0; self.groups.len()];
        self.groups.keep_above(&mut flags, &magnitudes, threshold * largest);
        let mut unpacked = vec![0.0; self.cols];
        self.groups.unpack(&flags, &mut unpacked);
        unpacked.iter().map(|&v| v != 0.0).collect()
    }

    /// `s` in the solver's order and divided by its largest magnitude, so that no square leaves the range; with it.
    fn packed_unit(&self, s: &[f64]) -> (Vec<f64>, f64) {
        assert_eq!(s.len(), self.cols);
        let largest = max_abs(s);
        let unit = if largest > 0.0 && largest.is_finite() { largest } else { 1.0 };
        let mut packed = vec![0.0; self.groups.len()];
        self.groups.pack(s, &mut packed);
        packed.iter_mut().for_each(|v| *v /= unit);
        (packed, unit)
    }
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
            assert!((norm.primal(&s) / size / (9.0 * SQRT_2 * SQRT_2) - 1.0).abs() < 1e-15);
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
