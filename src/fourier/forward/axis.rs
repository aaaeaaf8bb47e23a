//! One axis of a block: all its lines, in groups that fill the vectors.

use super::dense::{Dense, Place};
use super::simd::Task;

/// Lanes of a group: two vectors of AVX2, so that every entry of a matrix that is loaded serves both.
const WIDE: usize = 8;
/// Lanes of a group where no more remain.
const NARROW: usize = 4;

/// Scratch of dense axes.
#[derive(Default)]
pub(super) struct Scratch {
    folded: Vec<[f64; WIDE]>,
    wide: Vec<[f64; WIDE]>,
    narrow: Vec<[f64; NARROW]>,
    gathered: Vec<f64>,
}

impl Scratch {
    /// For axes of up to n entries.
    pub(super) fn reserve(&mut self, n: usize) {
        if n > self.folded.len() {
            self.folded.resize(n, [0.0; WIDE]);
            self.wide.resize(n, [0.0; WIDE]);
            self.narrow.resize(n, [0.0; NARROW]);
            self.gathered.resize(n * WIDE, 0.0);
        }
    }
}

/// The transform of a block along one axis, in place.
pub(super) struct Along<'a> {
    pub(super) axis: &'a Dense,
    /// Number of values from one entry of the axis to the next.
    pub(super) inner: usize,
    pub(super) block: &'a mut [f64],
    pub(super) scratch: &'a mut Scratch,
    pub(super) forward: bool,
}

impl Task for Along<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Along { axis, inner, block, scratch, forward } = self;
        if forward {
            along::<FUSED, true>(axis, inner, block, scratch);
        } else {
            along::<FUSED, false>(axis, inner, block, scratch);
        }
    }
}

#[inline(always)]
fn along<const FUSED: bool, const FORWARD: bool>(
    axis: &Dense,
    inner: usize,
    block: &mut [f64],
    scratch: &mut Scratch,
) {
    let n = axis.len();
    if inner < WIDE {
        return gathered::<FUSED, FORWARD>(axis, inner, block, scratch);
    }
    for lines in block.chunks_exact_mut(n * inner) {
        // A last group that is not full overlaps the one before: it reads first and writes last.
        let full = inner / WIDE * WIDE;
        let rest = inner - full;
        let at = |at| Place { stride: inner, at };
        if rest > NARROW {
            begin::<WIDE, FUSED, FORWARD>(axis, lines, at(inner - WIDE), &mut scratch.wide);
        } else if rest > 0 {
            begin::<NARROW, FUSED, FORWARD>(axis, lines, at(inner - NARROW), &mut scratch.narrow);
        }
        for lane in (0..full).step_by(WIDE) {
            begin::<WIDE, FUSED, FORWARD>(axis, lines, at(lane), &mut scratch.folded);
            end::<WIDE, FUSED, FORWARD>(axis, &mut scratch.folded, lines, at(lane));
        }
        if rest > NARROW {
            end::<WIDE, FUSED, FORWARD>(axis, &mut scratch.wide, lines, at(inner - WIDE));
        } else if rest > 0 {
            end::<NARROW, FUSED, FORWARD>(axis, &mut scratch.narrow, lines, at(inner - NARROW));
        }
    }
}

/// Lines too few side by side, above all those of the last axis: gathered by eight.
#[inline(always)]
fn gathered<const FUSED: bool, const FORWARD: bool>(
    axis: &Dense,
    inner: usize,
    block: &mut [f64],
    scratch: &mut Scratch,
) {
    let n = axis.len();
    let lines = block.len() / n;
    let place = Place { stride: WIDE, at: 0 };
    for first in (0..lines).step_by(WIDE) {
        let used = WIDE.min(lines - first);
        // Where a group is not full, its last line fills it up.
        let starts: [usize; WIDE] = std::array::from_fn(|w| {
            let line = first + w.min(used - 1);
            line / inner * n * inner + line % inner
        });
        let gathered = &mut scratch.gathered[..n * WIDE];
        for (w, start) in starts.into_iter().enumerate() {
            for i in 0..n {
                gathered[i * WIDE + w] = block[start + i * inner];
            }
        }
        begin::<WIDE, FUSED, FORWARD>(axis, gathered, place, &mut scratch.folded);
        end::<WIDE, FUSED, FORWARD>(axis, &mut scratch.folded, gathered, place);
        for (w, &start) in starts[..used].iter().enumerate() {
            for i in 0..n {
                block[start + i * inner] = gathered[i * WIDE + w];
            }
        }
    }
}

/// The half of a group's transform that reads the lines.
#[inline(always)]
fn begin<const W: usize, const FUSED: bool, const FORWARD: bool>(
    axis: &Dense,
    lines: &[f64],
    place: Place,
    folded: &mut [[f64; W]],
) {
    if FORWARD {
        axis.fold(lines, place, folded);
    } else {
        axis.folded::<W, FUSED>(lines, place, folded);
    }
}

/// The half of a group's transform that writes the lines.
#[inline(always)]
fn end<const W: usize, const FUSED: bool, const FORWARD: bool>(
    axis: &Dense,
    folded: &mut [[f64; W]],
    lines: &mut [f64],
    place: Place,
) {
    if FORWARD {
        axis.coefficients::<W, FUSED>(folded, lines, place);
    } else {
        axis.unfold(folded, lines, place);
    }
}
