//! DFT synthesis of real blocks by dense products.
//!
//! Along an axis of length n, index j stands for the signed frequency 0, 1, -1, 2, -2, ...; for even n the last
//! index is n/2. The half of the spectrum with non-negative frequency along the last axis is unpacked, summed over
//! the first three axes in complex arithmetic, then over the last one to real values.

use std::cmp::Ordering;
use std::f32::consts::FRAC_1_SQRT_2;

use super::AxisTable;
use crate::base::simd::Task;

/// Frequency (0..n, negative ones wrapped) at index `j`.
fn frequency(j: usize, n: usize) -> usize {
    match j {
        0 => 0,
        j if j % 2 == 1 => j.div_ceil(2),
        j => n - j / 2,
    }
}

/// Index of a wrapped frequency, the inverse of [`frequency`].
fn index_of(frequency: usize, n: usize) -> usize {
    match frequency {
        0 => 0,
        f if 2 * f <= n => 2 * f - 1,
        f => 2 * (n - f),
    }
}

/// Index of the conjugate along one axis.
fn negate(j: usize, n: usize) -> usize {
    index_of((n - frequency(j, n)) % n, n)
}

/// Linear index of the coefficient conjugate to each one; its own where the coefficient is real.
pub fn partners(shape: [usize; 4]) -> Vec<u32> {
    let mut partners = Vec::with_capacity(shape.iter().product());
    for a in 0..shape[0] {
        for b in 0..shape[1] {
            for c in 0..shape[2] {
                for d in 0..shape[3] {
                    let [a, b, c, d] = [(a, 0), (b, 1), (c, 2), (d, 3)].map(|(j, axis)| negate(j, shape[axis]));
                    partners.push((((a * shape[1] + b) * shape[2] + c) * shape[3] + d) as u32);
                }
            }
        }
    }
    partners
}

/// Replaces the coefficients by the values of the block.
pub(super) struct Synthesize<'a> {
    pub(super) axes: [&'a AxisTable; 4],
    pub(super) values: &'a mut [f32],
    pub(super) scratch: &'a mut Vec<f32>,
}

impl Task for Synthesize<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        synthesize(self.axes, self.values, self.scratch);
    }
}

/// Numbers that a synthesis takes: real and imaginary parts of half a spectrum, of a stage's input and of its output.
pub(super) fn sums([n0, n1, n2, n3]: [usize; 4]) -> usize {
    4 * n0 * n1 * n2 * (n3 / 2 + 1)
}

#[inline(always)]
fn synthesize(axes: [&AxisTable; 4], values: &mut [f32], scratch: &mut Vec<f32>) {
    let shape = axes.map(|a| a.n);
    let half = shape[3] / 2 + 1;
    let size = shape[0] * shape[1] * shape[2] * half;
    scratch.clear();
    scratch.resize(sums(shape), 0.0);
    let (mut from, mut to) = scratch.split_at_mut(2 * size);
    unpack(axes, values, from);
    for axis in (0..3).rev() {
        if shape[axis] > 1 {
            let inner = shape[axis + 1..3].iter().product::<usize>() * half;
            complex_axis(axes[axis], inner, from, to);
            std::mem::swap(&mut from, &mut to);
        }
    }
    let table = axes[3];
    let (re, im) = from.split_at(size);
    for ((row, re), im) in values.chunks_exact_mut(table.n).zip(re.chunks_exact(half)).zip(im.chunks_exact(half)) {
        row.fill(0.0);
        for f in 0..half {
            // Frequency f also stands for -f, unless the two are the same; doubling is exact.
            let both = if f == 0 || 2 * f == table.n { 1.0 } else { 2.0 };
            let (re, im) = (re[f] * both, im[f] * both);
            let (cos, sin) = (&table.cos[f * table.n..][..table.n], &table.sin[f * table.n..][..table.n]);
            for ((value, c), s) in row.iter_mut().zip(cos).zip(sin) {
                *value += re * c - im * s;
            }
        }
    }
}

/// The half spectrum, real parts then imaginary parts, from the packed coefficients.
#[inline(always)]
fn unpack(axes: [&AxisTable; 4], values: &[f32], spectrum: &mut [f32]) {
    let shape = axes.map(|a| a.n);
    let half = shape[3] / 2 + 1;
    let (re, im) = spectrum.split_at_mut(spectrum.len() / 2);
    let mut at = 0;
    for_half_spectrum(shape, half, |here, there| {
        (re[at], im[at]) = match here.cmp(&there) {
            Ordering::Equal => (values[here], 0.0),
            Ordering::Less => (values[here] * FRAC_1_SQRT_2, values[there] * FRAC_1_SQRT_2),
            Ordering::Greater => (values[there] * FRAC_1_SQRT_2, -(values[here] * FRAC_1_SQRT_2)),
        };
        at += 1;
    });
}

/// Calls `each` with the packed index of every entry of the half spectrum and that of its conjugate.
#[inline(always)]
fn for_half_spectrum(shape: [usize; 4], half: usize, mut each: impl FnMut(usize, usize)) {
    let [n0, n1, n2, n3] = shape;
    let pair = |f: usize, n: usize| (index_of(f, n), index_of((n - f) % n, n));
    for f0 in 0..n0 {
        let a = pair(f0, n0);
        for f1 in 0..n1 {
            let b = pair(f1, n1);
            let b = (a.0 * n1 + b.0, a.1 * n1 + b.1);
            for f2 in 0..n2 {
                let c = pair(f2, n2);
                let c = (b.0 * n2 + c.0, b.1 * n2 + c.1);
                for f3 in 0..half {
                    let d = pair(f3, n3);
                    each(c.0 * n3 + d.0, c.1 * n3 + d.1);
                }
            }
        }
    }
}

/// Sums over the frequencies of one of the first three axes, ascending from 0 in wrapped order.
#[inline(always)]
fn complex_axis(table: &AxisTable, inner: usize, from: &[f32], to: &mut [f32]) {
    let n = table.n;
    let (from_re, from_im) = from.split_at(from.len() / 2);
    let (to_re, to_im) = to.split_at_mut(to.len() / 2);
    to_re.fill(0.0);
    to_im.fill(0.0);
    for start in (0..from_re.len()).step_by(n * inner) {
        for i in 0..n {
            let out = start + i * inner;
            let (out_re, out_im) = (&mut to_re[out..out + inner], &mut to_im[out..out + inner]);
            for f in 0..n {
                let (c, s) = (table.cos[f * n + i], table.sin[f * n + i]);
                let at = start + f * inner;
                let source = from_re[at..at + inner].iter().zip(&from_im[at..at + inner]);
                for ((sum_re, sum_im), (re, im)) in out_re.iter_mut().zip(out_im.iter_mut()).zip(source) {
                    *sum_re += re * c - im * s;
                    *sum_im += re * s + im * c;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_and_frequencies_are_inverse() {
        for n in 1..20 {
            for j in 0..n {
                assert_eq!(index_of(frequency(j, n), n), j);
                assert_eq!(negate(negate(j, n), n), j);
            }
        }
        let listed: Vec<_> = (0..6).map(|j| frequency(j, 6)).collect();
        assert_eq!(listed, [0, 1, 5, 2, 4, 3]);
    }
}
