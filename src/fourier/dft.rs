//! DFT synthesis of real blocks by dense products.
//!
//! Along an axis of length n, index j stands for the signed frequency 0, 1, -1, 2, -2, ...; for even n the last
//! index is n/2. The half of the spectrum with non-negative frequency along the last axis is unpacked, summed over
//! the first three axes in complex arithmetic, then over the last one to real values.

use super::AxisTable;

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

/// Where each entry of the half spectrum `[n0][n1][n2][n3 / 2 + 1]` (all axes in wrapped frequency order) finds its
/// coefficient: the index of the real part, that of the imaginary part and the sign of the latter (0 where real).
pub(super) fn half_spectrum_map(shape: [usize; 4]) -> Vec<(u32, u32, f32)> {
    let [n0, n1, n2, n3] = shape;
    let linear = |j: [usize; 4]| (((j[0] * n1 + j[1]) * n2 + j[2]) * n3 + j[3]) as u32;
    let mut map = Vec::with_capacity(n0 * n1 * n2 * (n3 / 2 + 1));
    for f0 in 0..n0 {
        for f1 in 0..n1 {
            for f2 in 0..n2 {
                for f3 in 0..n3 / 2 + 1 {
                    let here = [index_of(f0, n0), index_of(f1, n1), index_of(f2, n2), index_of(f3, n3)];
                    let there = std::array::from_fn(|axis| negate(here[axis], shape[axis]));
                    let (here, there) = (linear(here), linear(there));
                    map.push(match here.cmp(&there) {
                        std::cmp::Ordering::Equal => (here, here, 0.0),
                        std::cmp::Ordering::Less => (here, there, 1.0),
                        std::cmp::Ordering::Greater => (there, here, -1.0),
                    });
                }
            }
        }
    }
    map
}

pub(super) fn synthesize(axes: [&AxisTable; 4], values: &mut [f32], scratch: &mut Vec<f32>) {
    let shape = axes.map(|a| a.n);
    let half = shape[3] / 2 + 1;
    let size = shape[0] * shape[1] * shape[2] * half;
    // Two complex arrays: the stage's input and its output.
    scratch.clear();
    scratch.resize(4 * size, 0.0);
    let (mut from, mut to) = scratch.split_at_mut(2 * size);
    for (entry, (re, im, sign)) in from.chunks_exact_mut(2).zip(half_spectrum_map(shape)) {
        let (a, b) = (values[re as usize], values[im as usize]);
        (entry[0], entry[1]) = if sign == 0.0 {
            (a, 0.0)
        } else {
            (a * std::f32::consts::FRAC_1_SQRT_2, b * std::f32::consts::FRAC_1_SQRT_2 * sign)
        };
    }
    for axis in (0..3).rev() {
        let table = axes[axis];
        if table.n == 1 {
            continue;
        }
        let inner = 2 * shape[axis + 1..3].iter().product::<usize>() * half;
        for (source, target) in from.chunks_exact(table.n * inner).zip(to.chunks_exact_mut(table.n * inner)) {
            for (i, line) in target.chunks_exact_mut(inner).enumerate() {
                line.fill(0.0);
                for (f, source) in source.chunks_exact(inner).enumerate() {
                    let (c, s) = (table.cos[f * i % table.n], table.sin[f * i % table.n]);
                    for (sum, z) in line.chunks_exact_mut(2).zip(source.chunks_exact(2)) {
                        sum[0] = (sum[0] + z[0] * c) - z[1] * s;
                        sum[1] = (sum[1] + z[0] * s) + z[1] * c;
                    }
                }
            }
        }
        std::mem::swap(&mut from, &mut to);
    }
    let table = axes[3];
    for (row, source) in values.chunks_exact_mut(table.n).zip(from.chunks_exact(2 * half)) {
        for (i, value) in row.iter_mut().enumerate() {
            *value = 0.0;
            for (f, z) in source.chunks_exact(2).enumerate() {
                // Frequency f also stands for -f, unless the two are the same.
                let both = if f == 0 || 2 * f == table.n { 1.0 } else { 2.0 };
                let (c, s) = (table.cos[f * i % table.n], table.sin[f * i % table.n]);
                *value += (z[0] * c - z[1] * s) * both;
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
