//! One axis of a block: all its lines, in groups that fill the vectors.

use super::dense::{Dense, Lanes, Place};
use crate::base::real::Real;
use crate::base::simd::Task;

/// Scratch of dense axes. `WIDE` lanes of a group are two vectors of AVX2, so that every entry of a matrix that is loaded
/// serves both; `NARROW` are taken where no more remain.
pub(super) struct Scratch<T, const WIDE: usize, const NARROW: usize> {
    folded: Vec<Lanes<T, WIDE>>,
    /// The last group of a bundle, of either width.
    wide: Vec<Lanes<T, WIDE>>,
    narrow: Vec<Lanes<T, NARROW>>,
    /// Lines brought side by side.
    gathered: Vec<T>,
}

impl<T: Real, const WIDE: usize, const NARROW: usize> Scratch<T, WIDE, NARROW> {
    pub(super) fn new() -> Self {
        Scratch { folded: Vec::new(), wide: Vec::new(), narrow: Vec::new(), gathered: Vec::new() }
    }

    /// For axes of up to n entries.
    pub(super) fn reserve(&mut self, n: usize) {
        if n > self.folded.len() {
            self.folded.resize(n, Lanes([T::zero(); WIDE]));
            self.wide.resize(n, Lanes([T::zero(); WIDE]));
            self.narrow.resize(n, Lanes([T::zero(); NARROW]));
            self.gathered.resize(n * WIDE, T::zero());
        }
    }
}

/// The transform of a block along one axis, in place, analysis or synthesis: two functions, since the compiler's time grows faster than
/// what it inlines into one.
pub(super) struct Along<'a, T, const WIDE: usize, const NARROW: usize, const FORWARD: bool> {
    pub(super) axis: &'a Dense<T>,
    /// Number of values from one entry of the axis to the next.
    pub(super) inner: usize,
    pub(super) block: &'a mut [T],
    pub(super) scratch: &'a mut Scratch<T, WIDE, NARROW>,
}

impl<T: Real, const WIDE: usize, const NARROW: usize, const FORWARD: bool> Task
    for Along<'_, T, WIDE, NARROW, FORWARD>
{
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Along { axis, inner, block, scratch } = self;
        along::<T, WIDE, NARROW, FUSED, FORWARD>(axis, inner, block, scratch);
    }
}

#[inline(always)]
fn along<T: Real, const WIDE: usize, const NARROW: usize, const FUSED: bool, const FORWARD: bool>(
    axis: &Dense<T>,
    inner: usize,
    block: &mut [T],
    scratch: &mut Scratch<T, WIDE, NARROW>,
) {
    let n = axis.len();
    if inner < WIDE {
        return gathered::<T, WIDE, NARROW, FUSED, FORWARD>(axis, inner, block, scratch);
    }
    for lines in block.chunks_exact_mut(n * inner) {
        // A last group that is not full overlaps the one before: it reads first and writes last.
        let full = inner / WIDE * WIDE;
        let rest = inner - full;
        let at = |at| Place { stride: inner, at };
        if rest > NARROW {
            begin::<T, WIDE, FUSED, FORWARD>(axis, lines, at(inner - WIDE), &mut scratch.wide);
        } else if rest > 0 {
            begin::<T, NARROW, FUSED, FORWARD>(axis, lines, at(inner - NARROW), &mut scratch.narrow);
        }
        for lane in (0..full).step_by(WIDE) {
            begin::<T, WIDE, FUSED, FORWARD>(axis, lines, at(lane), &mut scratch.folded);
            end::<T, WIDE, FUSED, FORWARD>(axis, &mut scratch.folded, lines, at(lane));
        }
        if rest > NARROW {
            end::<T, WIDE, FUSED, FORWARD>(axis, &mut scratch.wide, lines, at(inner - WIDE));
        } else if rest > 0 {
            end::<T, NARROW, FUSED, FORWARD>(axis, &mut scratch.narrow, lines, at(inner - NARROW));
        }
    }
}

/// Lines too few side by side, above all those of the last axis: gathered in groups.
#[inline(always)]
fn gathered<T: Real, const WIDE: usize, const NARROW: usize, const FUSED: bool, const FORWARD: bool>(
    axis: &Dense<T>,
    inner: usize,
    block: &mut [T],
    scratch: &mut Scratch<T, WIDE, NARROW>,
) {
    let n = axis.len();
    let lines = block.len() / n;
    let place = Place { stride: WIDE, at: 0 };
    for first in (0..lines).step_by(WIDE) {
        let used = WIDE.min(lines - first);
        let gathered = &mut scratch.gathered[..n * WIDE];
        if inner == 1 && used == WIDE && n >= 4 {
            let rows = &mut block[first * n..][..WIDE * n];
            transpose(rows, n, gathered, WIDE, WIDE, n);
            begin::<T, WIDE, FUSED, FORWARD>(axis, gathered, place, &mut scratch.folded);
            end::<T, WIDE, FUSED, FORWARD>(axis, &mut scratch.folded, gathered, place);
            transpose(gathered, WIDE, rows, n, n, WIDE);
            continue;
        }
        let start = |w: usize| {
            let line = first + w;
            line / inner * n * inner + line % inner
        };
        for w in 0..used {
            for i in 0..n {
                gathered[i * WIDE + w] = block[start(w) + i * inner];
            }
        }
        begin::<T, WIDE, FUSED, FORWARD>(axis, gathered, place, &mut scratch.folded);
        end::<T, WIDE, FUSED, FORWARD>(axis, &mut scratch.folded, gathered, place);
        for w in 0..used {
            for i in 0..n {
                block[start(w) + i * inner] = gathered[i * WIDE + w];
            }
        }
    }
}

/// `to[column * to_stride + row] = from[row * stride + column]` for at least 4 rows and 4 columns.
#[inline(always)]
fn transpose<T: Real>(from: &[T], stride: usize, to: &mut [T], to_stride: usize, rows: usize, columns: usize) {
    for row in tiles(rows) {
        for column in tiles(columns) {
            transpose_tile(&from[row * stride + column..], stride, &mut to[column * to_stride + row..], to_stride);
        }
    }
}

/// Starts of runs of 4 that cover n; the last one may overlap the one before.
#[inline(always)]
fn tiles(n: usize) -> impl Iterator<Item = usize> {
    (0..n.div_ceil(4)).map(move |t| (4 * t).min(n - 4))
}

/// 4 x 4 entries: pairs of rows, then halves. Tiles save a quarter of the last axis' time against single entries.
#[inline(always)]
fn transpose_tile<T: Real>(from: &[T], stride: usize, to: &mut [T], to_stride: usize) {
    let row = |r: usize| *from[r * stride..].first_chunk::<4>().expect("4 columns");
    let even = |x: [T; 4], y: [T; 4]| [x[0], y[0], x[2], y[2]];
    let odd = |x: [T; 4], y: [T; 4]| [x[1], y[1], x[3], y[3]];
    let low = |x: [T; 4], y: [T; 4]| [x[0], x[1], y[0], y[1]];
    let high = |x: [T; 4], y: [T; 4]| [x[2], x[3], y[2], y[3]];
    let (a, b, c, d) = (row(0), row(1), row(2), row(3));
    let (even_ab, odd_ab, even_cd, odd_cd) = (even(a, b), odd(a, b), even(c, d), odd(c, d));
    let columns = [low(even_ab, even_cd), low(odd_ab, odd_cd), high(even_ab, even_cd), high(odd_ab, odd_cd)];
    for (c, column) in columns.into_iter().enumerate() {
        *to[c * to_stride..].first_chunk_mut().expect("4 rows") = column;
    }
}

/// The half of a group's transform that reads the lines.
#[inline(always)]
fn begin<T: Real, const W: usize, const FUSED: bool, const FORWARD: bool>(
    axis: &Dense<T>,
    lines: &[T],
    place: Place,
    folded: &mut [Lanes<T, W>],
) {
    if FORWARD {
        axis.fold(lines, place, folded);
    } else {
        axis.folded::<W, FUSED>(lines, place, folded);
    }
}

/// The half of a group's transform that writes the lines.
#[inline(always)]
fn end<T: Real, const W: usize, const FUSED: bool, const FORWARD: bool>(
    axis: &Dense<T>,
    folded: &mut [Lanes<T, W>],
    lines: &mut [T],
    place: Place,
) {
    if FORWARD {
        axis.coefficients::<W, FUSED>(folded, lines, place);
    } else {
        axis.unfold(folded, lines, place);
    }
}
