//! DCT-II synthesis by dense products, axis after axis from the last to the first.
//!
//! For each axis, position i and its mirror image share their products: the sum E over the even frequencies and
//! the sum O over the odd ones, both ascending and from zero, give E + O at i and E - O at the mirror. Adding a
//! zero term changes no sum, so frequencies beyond the extents are left out.

use super::{AxisTable, Extents};
use crate::simd::Task;

/// Lanes that go side by side through an axis, and how many positions share their loads: eight sums are under way, as many
/// as it takes to hide the latency of an addition with the registers of AVX2.
const LANES: usize = 32;
const POSITIONS: usize = 2;
/// Lanes of what is left over.
const FEW: usize = 8;

/// Replaces the coefficients below the extents by the values of the block, whatever stands beyond.
pub(super) struct Synthesize<'a> {
    pub(super) axes: [&'a AxisTable; 4],
    pub(super) extents: Extents,
    pub(super) values: &'a mut [f32],
    pub(super) scratch: &'a mut Vec<f32>,
}

impl Task for Synthesize<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Synthesize { axes, extents, values, scratch } = self;
        let shape = axes.map(|a| a.n);
        let total: usize = shape.iter().product();
        if extents.contains(&0) {
            values[..total].fill(0.0);
            return;
        }
        if extents == [1; 4] {
            // One value, by what the sums below come to.
            let along = axes.iter().rev().filter(|table| table.n > 1);
            let value = along.fold(values[0], |value, table| (0.0 + value * table.cos[0]) + 0.0);
            values[..total].fill(value);
            return;
        }
        let mut used = Used::default();
        for axis in (0..4).rev() {
            let table = axes[axis];
            if table.n == 1 {
                // The one coefficient of a single position is its value.
                continue;
            }
            let inner: usize = shape[axis + 1..].iter().product();
            // Of the axes before, only what is below the extents is not zero yet.
            let before: [usize; 3] = std::array::from_fn(|a| if a < axis { extents[a] } else { 1 });
            let strides: [usize; 3] = std::array::from_fn(|a| shape[a + 1..].iter().product());
            for i in 0..before[0] {
                for j in 0..before[1] {
                    for k in 0..before[2] {
                        let start = i * strides[0] + j * strides[1] + k * strides[2];
                        let lines = &mut values[start..start + table.n * inner];
                        if inner == 1 {
                            row(table, extents[axis], lines, scratch);
                        } else {
                            used.find(extents[axis], inner, lines);
                            bundle(table, &used, inner, lines, scratch);
                        }
                    }
                }
            }
        }
    }
}

/// One line along the last axis.
#[inline(always)]
fn row(table: &AxisTable, used: usize, line: &mut [f32], scratch: &mut Vec<f32>) {
    let n = table.n;
    let half = n.div_ceil(2);
    if !any_nonzero(&line[..used]) {
        line.fill(0.0);
        return;
    }
    if scratch.len() < 2 * half {
        scratch.resize(2 * half, 0.0);
    }
    let (even, odd) = scratch[..2 * half].split_at_mut(half);
    even.fill(0.0);
    odd.fill(0.0);
    for (k, &s) in line[..used].iter().enumerate().filter(|(_, s)| **s != 0.0) {
        let sum = if k % 2 == 0 { &mut *even } else { &mut *odd };
        for (sum, c) in sum.iter_mut().zip(&table.cos[k * half..][..half]) {
            *sum += s * c;
        }
    }
    let (front, back) = line.split_at_mut(half);
    for ((value, e), o) in back.iter_mut().rev().zip(even.iter()).zip(odd.iter()) {
        *value = e - o;
    }
    for ((value, e), o) in front.iter_mut().zip(even).zip(odd) {
        *value = *e + *o;
    }
}

/// Frequencies at which some lane is not zero, even and odd ones, each with its place in the source. Most coefficients below
/// the extents are zero, and often whole lines and slabs of them.
#[derive(Default)]
struct Used([Vec<(usize, usize)>; 2]);

impl Used {
    #[inline(always)]
    fn find(&mut self, extent: usize, inner: usize, lines: &[f32]) {
        self.0.iter_mut().for_each(Vec::clear);
        let mut place = 0;
        for k in 0..extent {
            if any_nonzero(&lines[k * inner..(k + 1) * inner]) {
                self.0[k % 2].push((k, place));
                place += inner;
            }
        }
    }
}

/// In pieces without a branch inside, so that it vectorises.
#[inline(always)]
fn any_nonzero(values: &[f32]) -> bool {
    values.chunks(64).any(|piece| piece.iter().fold(false, |any, value| any | (*value != 0.0)))
}

/// `inner` lines side by side along an axis that is not the last.
#[inline(always)]
fn bundle(table: &AxisTable, used: &Used, inner: usize, lines: &mut [f32], scratch: &mut Vec<f32>) {
    let size = used.0.iter().map(|used| used.len() * inner).sum();
    if scratch.len() < size {
        scratch.resize(size, 0.0);
    }
    for &(k, place) in used.0.iter().flatten() {
        scratch[place..place + inner].copy_from_slice(&lines[k * inner..(k + 1) * inner]);
    }
    let mut at = 0;
    while inner - at >= LANES {
        lanes::<LANES>(table, used, inner, at, scratch, lines);
        at += LANES;
    }
    if inner - at > FEW && inner >= LANES {
        // Some of them once more, from the same source, rather than in steps of few.
        lanes::<LANES>(table, used, inner, inner - LANES, scratch, lines);
        return;
    }
    while inner - at >= FEW {
        lanes::<FEW>(table, used, inner, at, scratch, lines);
        at += FEW;
    }
    if at < inner && inner >= FEW {
        // Likewise.
        lanes::<FEW>(table, used, inner, inner - FEW, scratch, lines);
        return;
    }
    for at in at..inner {
        lanes::<1>(table, used, inner, at, scratch, lines);
    }
}

#[inline(always)]
fn lanes<const W: usize>(table: &AxisTable, used: &Used, inner: usize, at: usize, source: &[f32], target: &mut [f32]) {
    let half = table.n.div_ceil(2);
    let mut i = 0;
    while half - i >= POSITIONS {
        positions::<W, POSITIONS>(table, used, inner, at, i, source, target);
        i += POSITIONS;
    }
    if i < half {
        positions::<W, 1>(table, used, inner, at, i, source, target);
    }
}

#[inline(always)]
fn positions<const W: usize, const P: usize>(
    table: &AxisTable,
    used: &Used,
    inner: usize,
    at: usize,
    i: usize,
    source: &[f32],
    target: &mut [f32],
) {
    let n = table.n;
    let even = sums::<W, P>(table, &used.0[0], at, i, source);
    let odd = sums::<W, P>(table, &used.0[1], at, i, source);
    for p in 0..P {
        let (mut sum, mut difference) = ([0f32; W], [0f32; W]);
        for w in 0..W {
            sum[w] = even[p][w] + odd[p][w];
            difference[w] = even[p][w] - odd[p][w];
        }
        target[(n - 1 - i - p) * inner + at..][..W].copy_from_slice(&difference);
        // Last: the middle of an odd length is its own mirror image.
        target[(i + p) * inner + at..][..W].copy_from_slice(&sum);
    }
}

/// Sums over frequencies of lanes `at` and on, at positions `i` and on.
#[inline(always)]
fn sums<const W: usize, const P: usize>(
    table: &AxisTable,
    used: &[(usize, usize)],
    at: usize,
    i: usize,
    source: &[f32],
) -> [[f32; W]; P] {
    let half = table.n.div_ceil(2);
    let mut sums = [[0f32; W]; P];
    for &(k, place) in used {
        let lane = &source[place + at..][..W];
        let cos = &table.cos[k * half + i..][..P];
        for p in 0..P {
            for w in 0..W {
                sums[p][w] += lane[w] * cos[p];
            }
        }
    }
    sums
}
