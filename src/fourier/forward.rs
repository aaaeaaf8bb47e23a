//! Analysis and synthesis in double precision for the encoder and its solver.
//!
//! The decoder fixes every rounding; the encoder need not, so it takes the fastest way.

mod axis;
mod conjugate;
mod dense;
mod simd;

use super::Basis;
use axis::{Along, Scratch};
use conjugate::{Combine, Conjugates};
use dense::Dense;
use simd::Level;

/// Analysis and synthesis of blocks of one shape; holds its own scratch, so one a thread.
pub struct Transform {
    shape: [usize; 4],
    /// Those longer than 1, with the number of values from one entry to the next.
    axes: Vec<(Dense, usize)>,
    conjugates: Option<Conjugates>,
    scratch: Scratch,
    level: Level,
}

impl Transform {
    /// For blocks of the given shape.
    pub fn new(basis: Basis, shape: [usize; 4]) -> Transform {
        Transform::at_level(basis, shape, Level::detect())
    }

    fn at_level(basis: Basis, shape: [usize; 4], level: Level) -> Transform {
        let mut scratch = Scratch::default();
        let mut axes = Vec::new();
        for (axis, &n) in shape.iter().enumerate().filter(|&(_, &n)| n > 1) {
            scratch.reserve(n);
            axes.push((Dense::new(basis, n), shape[axis + 1..].iter().product()));
        }
        let conjugates = (basis == Basis::Dft).then(|| Conjugates::new(shape));
        Transform { shape, axes, conjugates, scratch, level }
    }

    /// Number of values of a block.
    pub fn positions(&self) -> usize {
        self.shape.iter().product()
    }

    /// Block values to coefficients, in place.
    pub fn analyze(&mut self, block: &mut [f64]) {
        let scratch = &mut self.scratch;
        for (axis, inner) in self.axes.iter().rev() {
            self.level.run(Along { axis, inner: *inner, block, scratch, forward: true });
        }
        if let Some(conjugates) = &self.conjugates {
            self.level.run(Combine { conjugates, block, forward: true });
        }
    }

    /// Coefficients to block values, in place: the inverse and the adjoint of [`Transform::analyze`].
    pub fn synthesize(&mut self, block: &mut [f64]) {
        let scratch = &mut self.scratch;
        if let Some(conjugates) = &self.conjugates {
            self.level.run(Combine { conjugates, block, forward: false });
        }
        for (axis, inner) in &self.axes {
            self.level.run(Along { axis, inner: *inner, block, scratch, forward: false });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fourier::{Synthesis, partners};
    use crate::sample::SplitMix64;

    const SHAPES: [[usize; 4]; 7] =
        [[1, 15, 15, 15], [1, 6, 10, 20], [1, 1, 1, 1], [2, 3, 4, 5], [1, 4, 3, 72], [1, 1, 1, 7], [3, 1, 2, 8]];

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut random = SplitMix64(seed);
        (0..n).map(|_| (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64 - 0.5).collect()
    }

    /// The coefficient of index `at` by its definition.
    fn by_definition(basis: Basis, shape: [usize; 4], values: &[f64], at: usize) -> f64 {
        use std::f64::consts::PI;
        let unravel = |mut i: usize| {
            let mut at = [0; 4];
            for a in (0..4).rev() {
                at[a] = i % shape[a];
                i /= shape[a];
            }
            at
        };
        let k = unravel(at);
        match basis {
            Basis::Dct => values.iter().enumerate().fold(0.0, |sum, (i, v)| {
                let x = unravel(i);
                sum + (0..4).fold(*v, |product, a| {
                    let n = shape[a] as f64;
                    let norm = (if k[a] == 0 { 1.0 } else { 2.0 } / n).sqrt();
                    product * norm * (PI * k[a] as f64 * (2 * x[a] + 1) as f64 / (2.0 * n)).cos()
                })
            }),
            Basis::Dft => {
                let partner = partners(shape)[at] as usize;
                let low = unravel(at.min(partner));
                let signed = |a: usize| {
                    let j = low[a] as f64;
                    if low[a] % 2 == 1 { (j + 1.0) / 2.0 } else { -j / 2.0 }
                };
                let (mut re, mut im) = (0.0, 0.0);
                for (i, v) in values.iter().enumerate() {
                    let x = unravel(i);
                    let turns: f64 = (0..4).map(|a| signed(a) * x[a] as f64 / shape[a] as f64).sum();
                    re += v * (2.0 * PI * turns).cos();
                    im -= v * (2.0 * PI * turns).sin();
                }
                let norm = (values.len() as f64).sqrt().recip();
                match at.cmp(&partner) {
                    std::cmp::Ordering::Equal => re * norm,
                    std::cmp::Ordering::Less => re * norm * 2f64.sqrt(),
                    std::cmp::Ordering::Greater => im * norm * 2f64.sqrt(),
                }
            }
        }
    }

    #[test]
    fn analysis_agrees_with_the_definition() {
        for basis in [Basis::Dct, Basis::Dft] {
            for shape in SHAPES {
                let n = shape.iter().product();
                let values = noise(n, 3);
                let mut coefficients = values.clone();
                Transform::new(basis, shape).analyze(&mut coefficients);
                for at in (0..n).step_by(1 + n / 50) {
                    let expected = by_definition(basis, shape, &values, at);
                    assert!((coefficients[at] - expected).abs() < 1e-12, "{basis:?} {shape:?} {at}");
                }
            }
        }
    }

    #[test]
    fn synthesis_undoes_analysis_and_keeps_norms() {
        for basis in [Basis::Dct, Basis::Dft] {
            for shape in SHAPES {
                let values = noise(shape.iter().product(), 5);
                let mut transform = Transform::new(basis, shape);
                let mut work = values.clone();
                transform.analyze(&mut work);
                let energy = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
                assert!((energy(&work) - energy(&values)).abs() < 1e-12 * energy(&values).max(1.0));
                transform.synthesize(&mut work);
                for (a, b) in work.iter().zip(&values) {
                    assert!((a - b).abs() < 1e-13, "{basis:?} {shape:?}");
                }
            }
        }
    }

    #[test]
    fn decoder_synthesis_agrees_to_single_precision() {
        for basis in [Basis::Dct, Basis::Dft] {
            for shape in SHAPES {
                let n: usize = shape.iter().product();
                let mut double = noise(n, 8);
                // Leave out the high frequencies, so that extents matter.
                let extents = shape.map(|n| n.div_ceil(2));
                let mut single = vec![0f32; n];
                for (i, (d, s)) in double.iter_mut().zip(&mut single).enumerate() {
                    let at = [
                        i / (shape[1] * shape[2] * shape[3]),
                        i / (shape[2] * shape[3]) % shape[1],
                        i / shape[3] % shape[2],
                        i % shape[3],
                    ];
                    if (0..4).any(|a| at[a] >= extents[a]) {
                        *d = 0.0;
                    }
                    *s = *d as f32;
                }
                Synthesis::new(basis, &shape).synthesize(shape, extents, &mut single, &mut Vec::new());
                Transform::new(basis, shape).synthesize(&mut double);
                for (s, d) in single.iter().zip(&double) {
                    assert!((f64::from(*s) - d).abs() < 2e-6, "{basis:?} {shape:?}: {s} {d}");
                }
            }
        }
    }
}
