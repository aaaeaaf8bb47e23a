//! One axis by dense products of folded lines, for groups of lines side by side.
//!
//! A line is folded first: positions with equal or opposite basis values are replaced by their sum and difference. That
//! parts the basis in an even half, which sums serve, and an odd half: half the products. The even half of a DCT of even
//! length is a DCT of half the length and is folded again. Each part is then a small dense product.

use std::f64::consts::PI;
use std::ops::Range;

use crate::base::real::Real;
use crate::base::simd::multiply_add;
use crate::codec::fourier::Basis;

/// Most outputs of a product summed side by side: 6 x 8 lanes fill 12 of the 16 registers of AVX2.
const ROWS: usize = 6;

/// An axis of length n.
pub(super) struct Dense<T> {
    n: usize,
    /// Folds of the positions: sum to the first, difference to the second.
    first: Vec<[usize; 2]>,
    /// Positions that the first folds leave alone: the middle, and for a DFT 0.
    alone: Vec<usize>,
    /// Folds of what the first ones gave, in order.
    more: Vec<[usize; 2]>,
    parts: Vec<Part<T>>,
}

/// Coefficients that depend on a range of the folded line.
struct Part<T> {
    coefficients: Vec<usize>,
    folded: Range<usize>,
    analysis: Matrix<T>,
    synthesis: Matrix<T>,
}

/// A square matrix by groups of up to [`ROWS`] rows: `[group][column][row of the group]`.
struct Matrix<T> {
    groups: Vec<usize>,
    entries: Vec<T>,
}

/// Lines side by side: entry `i` of lane `w` is at `i * stride + at + w`.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) stride: usize,
    pub(super) at: usize,
}

/// Entries of a line, side by side; aligned to the lines of the cache.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Lanes<T, const W: usize>(pub(super) [T; W]);

impl Place {
    #[inline(always)]
    fn get<T, const W: usize>(self, lines: &[T], i: usize) -> &[T; W] {
        lines[i * self.stride + self.at..].first_chunk().expect("W lanes")
    }

    #[inline(always)]
    fn set<T: Copy, const W: usize>(self, lines: &mut [T], i: usize, value: [T; W]) {
        *lines[i * self.stride + self.at..].first_chunk_mut().expect("W lanes") = value;
    }
}

impl<T: Real> Dense<T> {
    pub(super) fn new(basis: Basis, n: usize) -> Dense<T> {
        // The basis value that a folded entry is multiplied by: that of the position whose sign was kept.
        let mut position: Vec<usize> = (0..n).collect();
        let (mut first, mut more, mut parts) = (Vec::new(), Vec::new(), Vec::new());
        let mut part = |coefficients: Vec<usize>, folded: Range<usize>, position: &[usize]| {
            let entry = |k: usize, i: usize| value(basis, n, coefficients[k], position[folded.start + i]);
            let m = coefficients.len();
            let analysis = Matrix::new(m, entry);
            let synthesis = Matrix::new(m, |i, k| entry(k, i));
            parts.push(Part { coefficients, folded, analysis, synthesis });
        };
        match basis {
            Basis::Dct => {
                let (mut length, mut step) = (n, 1);
                loop {
                    for i in 0..length / 2 {
                        let fold = [i, length - 1 - i];
                        position[fold[1]] = i;
                        if step == 1 { first.push(fold) } else { more.push(fold) }
                    }
                    let half = length.div_ceil(2);
                    if length > 1 {
                        part((step..n).step_by(2 * step).collect(), half..length, &position);
                    }
                    let again = length.is_multiple_of(2) && half > 1;
                    (length, step) = (half, 2 * step);
                    if !again {
                        part((0..n).step_by(step).collect(), 0..length, &position);
                        break;
                    }
                }
            }
            Basis::Dft => {
                for i in 1..n.div_ceil(2) {
                    first.push([i, n - i]);
                    position[n - i] = i;
                }
                let cosines = (0..n).filter(|&j| j == 0 || j % 2 == 1).collect();
                part(cosines, 0..n / 2 + 1, &position);
                part((2..n).step_by(2).collect(), n / 2 + 1..n, &position);
            }
        }
        let alone = (0..n).filter(|i| !first.iter().flatten().any(|f| f == i)).collect();
        Dense { n, first, alone, more, parts }
    }

    /// Length of the axis.
    pub(super) fn len(&self) -> usize {
        self.n
    }

    /// First half of an analysis: folds lines.
    #[inline(always)]
    pub(super) fn fold<const W: usize>(&self, lines: &[T], place: Place, folded: &mut [Lanes<T, W>]) {
        let folded = &mut folded[..self.n];
        for &i in &self.alone {
            folded[i].0 = *place.get(lines, i);
        }
        for &[i, j] in &self.first {
            let (a, b) = (place.get(lines, i), place.get(lines, j));
            (folded[i].0, folded[j].0) = sum_and_difference(a, b);
        }
        for &[i, j] in &self.more {
            (folded[i].0, folded[j].0) = sum_and_difference(&folded[i].0, &folded[j].0);
        }
    }

    /// Second half of an analysis: coefficients of folded lines.
    #[inline(always)]
    pub(super) fn coefficients<const W: usize, const FUSED: bool>(
        &self,
        folded: &[Lanes<T, W>],
        lines: &mut [T],
        place: Place,
    ) {
        for part in &self.parts {
            let folded = &folded[part.folded.clone()];
            let mut rows = part.coefficients.iter();
            part.analysis.product::<W, FUSED>(folded.iter().map(|f| &f.0), |sum| {
                if let Some(&row) = rows.next() {
                    place.set(lines, row, sum);
                }
            });
        }
    }

    /// First half of a synthesis: folded lines from coefficients.
    #[inline(always)]
    pub(super) fn folded<const W: usize, const FUSED: bool>(
        &self,
        lines: &[T],
        place: Place,
        folded: &mut [Lanes<T, W>],
    ) {
        for part in &self.parts {
            let mut folded = folded[part.folded.clone()].iter_mut();
            let rows = part.coefficients.iter().map(|&row| place.get(lines, row));
            part.synthesis.product::<W, FUSED>(rows, |sum| {
                if let Some(folded) = folded.next() {
                    folded.0 = sum;
                }
            });
        }
    }

    /// Second half of a synthesis: a fold is its own adjoint.
    #[inline(always)]
    pub(super) fn unfold<const W: usize>(&self, folded: &mut [Lanes<T, W>], lines: &mut [T], place: Place) {
        let folded = &mut folded[..self.n];
        for &[i, j] in self.more.iter().rev() {
            (folded[i].0, folded[j].0) = sum_and_difference(&folded[i].0, &folded[j].0);
        }
        for &[i, j] in &self.first {
            let (a, b) = sum_and_difference(&folded[i].0, &folded[j].0);
            place.set(lines, i, a);
            place.set(lines, j, b);
        }
        for &i in &self.alone {
            place.set(lines, i, folded[i].0);
        }
    }
}

#[inline(always)]
fn sum_and_difference<T: Real, const W: usize>(a: &[T; W], b: &[T; W]) -> ([T; W], [T; W]) {
    let (mut sum, mut difference) = ([T::zero(); W], [T::zero(); W]);
    for w in 0..W {
        sum[w] = a[w] + b[w];
        difference[w] = a[w] - b[w];
    }
    (sum, difference)
}

impl<T: Real> Matrix<T> {
    fn new(m: usize, entry: impl Fn(usize, usize) -> f64) -> Matrix<T> {
        // Groups of nearly equal size: one of a single row would wait for its own sums.
        let count = m.div_ceil(ROWS);
        let groups: Vec<Range<usize>> = (0..count).map(|g| g * m / count..(g + 1) * m / count).collect();
        let entry = &entry;
        let entries = groups
            .iter()
            .flat_map(|rows| (0..m).flat_map(move |column| rows.clone().map(move |row| T::of(entry(row, column)))))
            .collect();
        let groups = groups.iter().map(|g| g.len()).collect();
        Matrix { groups, entries }
    }

    /// Products with the values of a line a column; sums in the order of rows.
    #[inline(always)]
    fn product<'a, const W: usize, const FUSED: bool>(
        &self,
        values: impl ExactSizeIterator<Item = &'a [T; W]> + Clone,
        mut store: impl FnMut([T; W]),
    ) {
        let mut rest = &self.entries[..];
        for &rows in &self.groups {
            let entries;
            (entries, rest) = rest.split_at(rows * values.len());
            match rows {
                1 => group::<T, 1, W, FUSED>(entries, values.clone(), &mut store),
                2 => group::<T, 2, W, FUSED>(entries, values.clone(), &mut store),
                3 => group::<T, 3, W, FUSED>(entries, values.clone(), &mut store),
                4 => group::<T, 4, W, FUSED>(entries, values.clone(), &mut store),
                5 => group::<T, 5, W, FUSED>(entries, values.clone(), &mut store),
                _ => group::<T, 6, W, FUSED>(entries, values.clone(), &mut store),
            }
        }
    }
}

#[inline(always)]
fn group<'a, T: Real, const R: usize, const W: usize, const FUSED: bool>(
    entries: &[T],
    values: impl Iterator<Item = &'a [T; W]>,
    store: &mut impl FnMut([T; W]),
) {
    let mut sums = [[T::zero(); W]; R];
    for (entries, values) in entries.as_chunks::<R>().0.iter().zip(values) {
        for r in 0..R {
            for w in 0..W {
                sums[r][w] = multiply_add::<T, FUSED>(entries[r], values[w], sums[r][w]);
            }
        }
    }
    for sum in sums {
        store(sum);
    }
}

/// Value at position `i` of basis function `k`; of a DFT, of the real and imaginary parts of exp(-i 2 pi f x / n).
pub(super) fn value(basis: Basis, n: usize, k: usize, i: usize) -> f64 {
    let single = (1.0 / n as f64).sqrt();
    let double = (2.0 / n as f64).sqrt();
    match basis {
        _ if k == 0 => single,
        Basis::Dct => double * (PI * (k * (2 * i + 1) % (4 * n)) as f64 / (2 * n) as f64).cos(),
        Basis::Dft => {
            let angle = 2.0 * PI * (k.div_ceil(2) * i % n) as f64 / n as f64;
            match k {
                k if k + 1 == n && n.is_multiple_of(2) => single * angle.cos(),
                k if k % 2 == 1 => double * angle.cos(),
                _ => -double * angle.sin(),
            }
        }
    }
}
