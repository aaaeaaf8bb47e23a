//! From the products of real bases along the axes to the real layout of a DFT, and back.
//!
//! Along each axis the index of frequency f holds the real part C of z = exp(-i 2 pi f x / n) and that of -f its
//! imaginary part S. A coefficient belongs to a product of such z and their conjugates, so the 2^m products of frequencies
//! along m axes give the 2^m coefficients of these frequencies with all signs. They are combined axis after axis, from
//! the last to the first: z_a = C + i S times z = R + i I of the axes after a gives Re CR - SI, Im CI + SR, and z_a times
//! the conjugate of z gives Re CR + SI, Im SR - CI. R is where the leading frequency of the axes after a is positive, I
//! at the partner. With the factor 1 / sqrt 2 each of these steps is orthonormal.

use std::f64::consts::FRAC_1_SQRT_2;

use super::simd::Task;

/// The steps of one block shape.
pub(super) struct Conjugates {
    /// One for each axis that has others longer than 1 after it.
    steps: Vec<Step>,
}

struct Step {
    n: usize,
    /// Indices over the axes after: R and I.
    pairs: Vec<[u32; 2]>,
    /// Number of values over the axes after.
    inner: usize,
}

impl Conjugates {
    pub(super) fn new(shape: [usize; 4]) -> Conjugates {
        let mut steps = Vec::new();
        for axis in (0..3).rev() {
            let inner: usize = shape[axis + 1..].iter().product();
            if shape[axis] > 2 && inner > 2 {
                let mut after = [1; 4];
                after[axis + 1..].copy_from_slice(&shape[axis + 1..]);
                let partners = super::super::partners(after);
                let pairs =
                    (0..).zip(partners).filter(|&(low, high)| low < high).map(|(low, high)| [low, high]).collect();
                steps.push(Step { n: shape[axis], pairs, inner });
            }
        }
        Conjugates { steps }
    }

    #[inline(always)]
    fn apply(&self, block: &mut [f64], forward: bool) {
        if forward {
            self.steps.iter().for_each(|s| s.apply(block, analysis));
        } else {
            self.steps.iter().rev().for_each(|s| s.apply(block, synthesis));
        }
    }
}

impl Step {
    #[inline(always)]
    fn apply(&self, block: &mut [f64], combine: impl Fn([f64; 4]) -> [f64; 4]) {
        for planes in block.chunks_exact_mut(self.n * self.inner) {
            // Pairs of planes C and S; the first plane, and the last of an even number, are real.
            for both in planes[self.inner..].chunks_exact_mut(2 * self.inner) {
                let (cos, sin) = both.split_at_mut(self.inner);
                for &[re, im] in &self.pairs {
                    let (re, im) = (re as usize, im as usize);
                    [cos[re], cos[im], sin[re], sin[im]] = combine([cos[re], cos[im], sin[re], sin[im]]);
                }
            }
        }
    }
}

/// From CR, CI, SR, SI.
#[inline(always)]
fn analysis([cr, ci, sr, si]: [f64; 4]) -> [f64; 4] {
    [cr - si, cr + si, sr - ci, ci + sr].map(|v| v * FRAC_1_SQRT_2)
}

/// The transpose of [`analysis`].
#[inline(always)]
fn synthesis([a, b, c, d]: [f64; 4]) -> [f64; 4] {
    [a + b, d - c, c + d, b - a].map(|v| v * FRAC_1_SQRT_2)
}

/// All steps over a block.
pub(super) struct Combine<'a> {
    pub(super) conjugates: &'a Conjugates,
    pub(super) block: &'a mut [f64],
    pub(super) forward: bool,
}

impl Task for Combine<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        self.conjugates.apply(self.block, self.forward);
    }
}
