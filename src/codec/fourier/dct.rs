//! DCT-II synthesis by dense products, axis after axis from the last to the first.
//!
//! For each axis, position i and its mirror image share their products: the sum E over the even frequencies and
//! the sum O over the odd ones, both ascending and from zero, give E + O at i and E - O at the mirror. Adding a
//! zero term changes no sum, so coefficients that are zero, and lines of them, are left out.

use std::ops::Range;

use super::{AxisTable, Lines, Term};
use crate::base::simd::Task;

/// Lanes that go side by side through an axis, and how many positions share their loads. 2 to 4 positions and 16 to 64 lanes took 2 to
/// 4 % longer with AVX-512, as long with AVX2; 4 and 32 are beyond the compiler.
const LANES: usize = 32;
const POSITIONS: usize = 3;
const _: () = assert!(POSITIONS == 3, "`lanes` knows what may be left over");
/// Lanes of what is left over.
const FEW: usize = 8;

/// Numbers after the last of a table that may be read.
pub(super) const PADDING: usize = SUMS;

/// Writes the values of the block over whatever stands there.
pub(super) struct Synthesize<'a> {
    pub(super) axes: [&'a AxisTable; 4],
    /// That at index 0 first.
    pub(super) terms: &'a [Term],
    pub(super) values: &'a mut [f32],
    pub(super) lines: &'a mut Lines,
}

impl Task for Synthesize<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Synthesize { mut axes, terms, values, lines } = self;
        if let [(_, mean)] = *terms {
            return values.fill(constant(axes, mean));
        }
        // The last axis along which positions differ comes last.
        while axes[3].n == 1 {
            axes.rotate_right(1);
        }
        let (last, mut inner) = (axes[3], axes[3].n);
        let mut stages = axes[..3].iter().rev().filter(|table| table.n > 1).peekable();
        // From one buffer to the other, lines in use after each other, until the last stage writes the block.
        let Lines { buffers: [from, to], used: numbers, .. } = lines;
        let (mut from, mut to) = (from, to);
        if stages.peek().is_none() {
            return rows(last, terms, numbers, values);
        }
        // At most one for each.
        rows(last, terms, numbers, room(from, (terms.len() * inner).min(values.len())));
        let mut used = Used::default();
        while let Some(table) = stages.next() {
            let n = table.n;
            let bundles = numbers.chunk_by(|a, b| *a as usize / n == *b as usize / n).count();
            let target = if stages.peek().is_none() { &mut *values } else { room(to, bundles * n * inner) };
            let mut source = &from[..];
            let mut at = 0;
            for (bundle, lines) in target.chunks_exact_mut(n * inner).take(bundles).enumerate() {
                let number = numbers[at] as usize / n;
                let found = used.find(number * n..(number + 1) * n, inner, &numbers[at..]);
                side_by_side(table, &used, inner, source, lines);
                source = &source[found * inner..];
                at += found;
                numbers[bundle] = number as u32;
            }
            numbers.truncate(bundles);
            inner *= n;
            std::mem::swap(&mut from, &mut to);
        }
    }
}

/// Of a mean alone, by what the sums come to.
#[inline(always)]
pub(super) fn constant(axes: [&AxisTable; 4], mean: f32) -> f32 {
    let along = axes.iter().rev().filter(|table| table.n > 1);
    along.fold(mean, |value, table| (0.0 + value * table.cos[0]) + 0.0)
}

/// A buffer of `length` values, whatever stands in them.
#[inline(always)]
fn room(buffer: &mut Vec<f32>, length: usize) -> &mut [f32] {
    if buffer.len() < length {
        buffer.resize(length, 0.0);
    }
    &mut buffer[..length]
}

/// Most positions whose sums stay in registers while the terms of a line go by, as many for each of two sums. More take longer, 96 with
/// AVX-512 as well.
const SUMS: usize = 48;

/// The lines along the last axis that have a coefficient, and their numbers.
#[inline(always)]
fn rows(table: &AxisTable, mut terms: &[Term], numbers: &mut Vec<u32>, target: &mut [f32]) {
    let n = table.n;
    let half = n.div_ceil(2);
    numbers.clear();
    let mut lines = target.chunks_exact_mut(n);
    while let (Some(&(position, _)), Some(line)) = (terms.first(), lines.next()) {
        let row = position as usize / n;
        numbers.push(row as u32);
        let end = terms.iter().position(|&(position, _)| position as usize >= (row + 1) * n);
        let (of_row, rest) = terms.split_at(end.unwrap_or(terms.len()));
        terms = rest;
        match half {
            0..=16 => row_sums::<16>(table, of_row, row * n, 0, line),
            17..=32 => row_sums::<32>(table, of_row, row * n, 0, line),
            _ => {
                let mut at = 0;
                while half - at > SUMS {
                    row_sums::<SUMS>(table, of_row, row * n, at, line);
                    at += SUMS;
                }
                // Some of them once more.
                row_sums::<SUMS>(table, of_row, row * n, half.saturating_sub(SUMS), line);
            }
        }
    }
}

/// Positions `at` and on of a line, and their mirror images, from the terms of the line, which begins at `start`.
#[inline(always)]
fn row_sums<const W: usize>(table: &AxisTable, terms: &[Term], start: usize, at: usize, line: &mut [f32]) {
    let half = table.n.div_ceil(2);
    let (mut even, mut odd) = ([0f32; W], [0f32; W]);
    for &(position, value) in terms {
        let k = position as usize - start;
        // Tables go on for as many; what comes of that is not used.
        let cos = &table.cos[k * half + at..][..W];
        // A zero to the other sum, which does not change: which of the two comes next is not predictable.
        let (to_even, to_odd) = if k & 1 == 0 { (value, 0.0) } else { (0.0, value) };
        for w in 0..W {
            even[w] += to_even * cos[w];
            odd[w] += to_odd * cos[w];
        }
    }
    let (mut sum, mut difference) = ([0f32; W], [0f32; W]);
    for w in 0..W {
        sum[w] = even[w] + odd[w];
        difference[w] = even[w] - odd[w];
    }
    let (front, back) = line.split_at_mut(half);
    let mirrored = back.len().saturating_sub(at).min(W);
    let end = back.len() - at;
    back[end - mirrored..end].iter_mut().rev().zip(&difference).for_each(|(value, difference)| *value = *difference);
    let width = W.min(half - at);
    front[at..at + width].copy_from_slice(&sum[..width]);
}

/// Frequencies at which some lane is not zero, even and odd ones, each with its place in the source. Most coefficients are zero, and
/// often those of whole lines and slabs.
#[derive(Default)]
struct Used([Vec<(usize, usize)>; 2]);

impl Used {
    /// Of the lines of a range, by the numbers of those in use from the first of them on; gives how many these are.
    #[inline(always)]
    fn find(&mut self, range: Range<usize>, inner: usize, used: &[u32]) -> usize {
        self.0.iter_mut().for_each(Vec::clear);
        let mut found = 0;
        for line in used.iter().map(|line| *line as usize).take_while(|line| *line < range.end) {
            let k = line - range.start;
            self.0[k % 2].push((k, found * inner));
            found += 1;
        }
        found
    }
}

/// `inner` lines side by side along an axis that is not the last.
#[inline(always)]
fn side_by_side(table: &AxisTable, used: &Used, inner: usize, source: &[f32], lines: &mut [f32]) {
    let mut at = 0;
    while inner - at >= LANES {
        lanes::<LANES>(table, used, inner, at, source, lines);
        at += LANES;
    }
    if inner - at > FEW && inner >= LANES {
        // Some of them once more, from the same source, rather than in steps of few.
        lanes::<LANES>(table, used, inner, inner - LANES, source, lines);
        return;
    }
    while inner - at >= FEW {
        lanes::<FEW>(table, used, inner, at, source, lines);
        at += FEW;
    }
    if at < inner && inner >= FEW {
        // Likewise.
        lanes::<FEW>(table, used, inner, inner - FEW, source, lines);
        return;
    }
    for at in at..inner {
        lanes::<1>(table, used, inner, at, source, lines);
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
    // Two together take as long as one: each sum waits for its last term.
    match half - i {
        2 => positions::<W, 2>(table, used, inner, at, i, source, target),
        1 => positions::<W, 1>(table, used, inner, at, i, source, target),
        _ => {}
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
