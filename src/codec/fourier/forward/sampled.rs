//! The last axis where few positions are sampled: a product per sample instead of one per line.

use super::dense::value;
use crate::base::real::Real;
use crate::base::simd::{Task, multiply_add};
use crate::codec::fourier::Basis;

/// Basis values of the last axis by position: `[i][k]`.
pub(super) struct Columns<T> {
    n: usize,
    values: Vec<T>,
}

impl<T: Real> Columns<T> {
    pub(super) fn new(basis: Basis, n: usize) -> Columns<T> {
        Columns { n, values: (0..n * n).map(|ik| T::of(value(basis, n, ik % n, ik / n))).collect() }
    }

    /// The start of a position's line and its basis values.
    #[inline(always)]
    fn at(&self, position: u32) -> (usize, &[T]) {
        let i = position as usize % self.n;
        (position as usize - i, &self.values[i * self.n..][..self.n])
    }
}

/// Analysis along the last axis of a block that is zero but for samples.
pub(super) struct Spread<'a, T> {
    pub(super) columns: &'a Columns<T>,
    pub(super) positions: &'a [u32],
    pub(super) samples: &'a [T],
    pub(super) block: &'a mut [T],
}

impl<T: Real> Task for Spread<'_, T> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        self.block.fill(T::zero());
        for (&position, &sample) in self.positions.iter().zip(self.samples) {
            let (line, column) = self.columns.at(position);
            for (sum, c) in self.block[line..].iter_mut().zip(column) {
                *sum = multiply_add::<T, FUSED>(sample, *c, *sum);
            }
        }
    }
}

/// Synthesis along the last axis of samples alone.
pub(super) struct Gather<'a, T> {
    pub(super) columns: &'a Columns<T>,
    pub(super) positions: &'a [u32],
    pub(super) samples: &'a mut [T],
    pub(super) block: &'a [T],
}

impl<T: Real> Task for Gather<'_, T> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        for (sample, &position) in self.samples.iter_mut().zip(self.positions) {
            let (line, column) = self.columns.at(position);
            let (columns, column_rest) = column.as_chunks::<4>();
            let (lines, line_rest) = self.block[line..][..column.len()].as_chunks::<4>();
            let mut sums = [T::zero(); 4];
            for (a, b) in columns.iter().zip(lines) {
                for w in 0..4 {
                    sums[w] = multiply_add::<T, FUSED>(a[w], b[w], sums[w]);
                }
            }
            let mut sum = (sums[0] + sums[1]) + (sums[2] + sums[3]);
            for (a, b) in column_rest.iter().zip(line_rest) {
                sum = multiply_add::<T, FUSED>(*a, *b, sum);
            }
            *sample = sum;
        }
    }
}
