//! From the products of real bases along the axes to the real layout of a DFT, and back.
//!
//! Along each axis the index of frequency f holds the real part C of z = exp(-i 2 pi f x / n) and that of -f its
//! imaginary part S. A coefficient belongs to a product of such z and their conjugates, so the 2^m products of frequencies
//! along m axes give the 2^m coefficients of these frequencies with all signs. They are combined axis after axis, from
//! the first to the last, where all but the last combine lines side by side: R + i I of the axes before, R at the lower
//! index of two partners and I at the higher one, times C + i S gives RC - IS and IC + RS, and times its conjugate
//! RC + IS and IC - RS. With the factor 1 / sqrt 2 each step is orthonormal.

use std::f64::consts::FRAC_1_SQRT_2;

use crate::base::real::Real;
use crate::base::simd::Task;
use crate::codec::fourier::partners;

/// The steps of one block shape.
pub(super) struct Conjugates {
    /// One for each axis that has others longer than 2 before it.
    steps: Vec<Step>,
}

struct Step {
    /// Length of the axis.
    n: usize,
    /// Indices over the axes before: R and I.
    pairs: Vec<[u32; 2]>,
    /// Number of values over the axes after.
    inner: usize,
}

impl Conjugates {
    pub(super) fn new(shape: [usize; 4]) -> Conjugates {
        let mut steps = Vec::new();
        for axis in 1..4 {
            let mut before = [1; 4];
            before[..axis].copy_from_slice(&shape[..axis]);
            let pairs: Vec<_> =
                (0..).zip(partners(before)).filter(|(low, high)| low < high).map(|(low, high)| [low, high]).collect();
            if shape[axis] > 2 && !pairs.is_empty() {
                steps.push(Step { n: shape[axis], pairs, inner: shape[axis + 1..].iter().product() });
            }
        }
        Conjugates { steps }
    }
}

/// All steps over a block.
pub(super) struct Combine<'a, T> {
    pub(super) conjugates: &'a Conjugates,
    pub(super) block: &'a mut [T],
    pub(super) forward: bool,
}

impl<T: Real> Task for Combine<'_, T> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        // Loops rather than closures: those would be compiled for the baseline.
        if self.forward {
            for step in &self.conjugates.steps {
                step.apply::<T, true>(self.block);
            }
        } else {
            for step in self.conjugates.steps.iter().rev() {
                step.apply::<T, false>(self.block);
            }
        }
    }
}

impl Step {
    #[inline(always)]
    fn apply<T: Real, const FORWARD: bool>(&self, block: &mut [T]) {
        let (inner, length) = (self.inner, self.n * self.inner);
        for &[re, im] in &self.pairs {
            let (before, after) = block.split_at_mut(im as usize * length);
            // Pairs of C and S; the first entry, and the last of an even number, are real.
            let re = &mut before[re as usize * length..][inner..length];
            let im = &mut after[inner..length];
            if inner == 1 {
                interleaved::<T, FORWARD>(re, im);
                continue;
            }
            for (re, im) in re.chunks_exact_mut(2 * inner).zip(im.chunks_exact_mut(2 * inner)) {
                let (rc, rs) = re.split_at_mut(inner);
                let (ic, is) = im.split_at_mut(inner);
                side_by_side::<T, FORWARD>(rc, rs, ic, is);
            }
        }
    }
}

/// Combines C and S that are neighbours.
#[inline(always)]
fn interleaved<T: Real, const FORWARD: bool>(re: &mut [T], im: &mut [T]) {
    let ((re, re_rest), (im, im_rest)) = (re.as_chunks_mut::<4>(), im.as_chunks_mut::<4>());
    for (re, im) in re.iter_mut().zip(im) {
        let (r, i) = (*re, *im);
        // The same sums as those of `combine`, in the order of vectors.
        let sums = |a: [T; 4], b: [T; 4]| {
            [a[0] - b[0], a[1] + b[1], a[2] - b[2], a[3] + b[3]].map(|v| v * T::of(FRAC_1_SQRT_2))
        };
        let (c, s) = (|v: [T; 4]| [v[0], v[0], v[2], v[2]], |v: [T; 4]| [v[1], v[1], v[3], v[3]]);
        if FORWARD {
            *re = sums(c(r), s(i));
            *im = sums(c(i), s(r));
        } else {
            *re = [r[0] + r[1], i[1] - i[0], r[2] + r[3], i[3] - i[2]].map(|v| v * T::of(FRAC_1_SQRT_2));
            *im = [i[0] + i[1], r[1] - r[0], i[2] + i[3], r[3] - r[2]].map(|v| v * T::of(FRAC_1_SQRT_2));
        }
    }
    for (re, im) in re_rest.chunks_exact_mut(2).zip(im_rest.chunks_exact_mut(2)) {
        [re[0], re[1], im[0], im[1]] = combine::<T, FORWARD>([re[0], re[1], im[0], im[1]]);
    }
}

/// Combines lines of C and S.
#[inline(always)]
fn side_by_side<T: Real, const FORWARD: bool>(rc: &mut [T], rs: &mut [T], ic: &mut [T], is: &mut [T]) {
    let ((rc, rc_rest), (rs, rs_rest)) = (rc.as_chunks_mut::<4>(), rs.as_chunks_mut::<4>());
    let ((ic, ic_rest), (is, is_rest)) = (ic.as_chunks_mut::<4>(), is.as_chunks_mut::<4>());
    for (((rc, rs), ic), is) in rc.iter_mut().zip(rs).zip(ic).zip(is) {
        let (mut a, mut b, mut c, mut d) = (*rc, *rs, *ic, *is);
        for w in 0..4 {
            [a[w], b[w], c[w], d[w]] = combine::<T, FORWARD>([a[w], b[w], c[w], d[w]]);
        }
        (*rc, *rs, *ic, *is) = (a, b, c, d);
    }
    for (((a, b), c), d) in rc_rest.iter_mut().zip(rs_rest).zip(ic_rest).zip(is_rest) {
        [*a, *b, *c, *d] = combine::<T, FORWARD>([*a, *b, *c, *d]);
    }
}

/// From RC, RS, IC, IS to the coefficients in their places, or by the transpose back.
#[inline(always)]
fn combine<T: Real, const FORWARD: bool>([a, b, c, d]: [T; 4]) -> [T; 4] {
    let combined = if FORWARD { [a - d, a + d, c - b, c + b] } else { [a + b, d - c, c + d, b - a] };
    combined.map(|v| v * T::of(FRAC_1_SQRT_2))
}
