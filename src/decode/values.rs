//! From the components of a block's log values to its values, in the rows of a table or of the block.

use std::mem::MaybeUninit;

use super::rebuild::{Header, Scratch};
use super::table::copy_rows;
use crate::channel::ChannelTransform;
use crate::exact::{FEWER_LANES, LANES, exp32_lanes};
use crate::simd::Task;
use crate::tone::inverse_tone_maps;

/// Memory that values are written to, be there one already or not.
pub(super) trait Place<T> {
    fn put(&mut self, value: T);
}

impl<T> Place<T> for T {
    #[inline(always)]
    fn put(&mut self, value: T) {
        *self = value;
    }
}

impl<T> Place<T> for MaybeUninit<T> {
    #[inline(always)]
    fn put(&mut self, value: T) {
        self.write(value);
    }
}

impl Scratch {
    /// Exact zeros in the log values: exp of what they get is zero, and so is the value.
    pub(super) fn hide_zeros(&mut self) {
        for (log, zero) in self.log.iter_mut().zip(&self.zeros) {
            *log = if *zero { f32::NEG_INFINITY } else { *log };
        }
    }
}

impl Header {
    /// Components to log values of channels, `[channel][position]`.
    pub(super) fn to_channels(&self, values: &mut [f32]) {
        let (transform, channels) = (&self.coding.transform, self.grid.channels().len());
        self.level.run(ToChannels { transform, channels, values });
    }

    /// BRDF values in place of the log values in the scratch.
    pub(super) fn values<'a>(&self, scratch: &'a mut Scratch) -> &'a [f32] {
        self.level.run(InverseToneMap { eps: self.coding.eps as f32, values: &mut scratch.log });
        &scratch.log
    }

    /// BRDF values in all of the rows of a block, `[channel][row]` and of one length, from the components in the scratch.
    pub(super) fn values_in_rows<P: Place<f32>>(&self, scratch: &mut Scratch, mut rows: Vec<&mut [P]>) {
        let (ChannelTransform::Matrix(matrix), 3) = (&self.coding.transform, self.grid.channels().len()) else {
            self.to_channels(&mut scratch.log);
            scratch.hide_zeros();
            return copy_rows(rows, self.values(scratch));
        };
        let (matrix, eps) = (&std::array::from_fn(|i| matrix[i]), self.coding.eps as f32);
        let (per_channel, length) = (rows.len() / 3, rows.first().map_or(1, |row| row.len()));
        // Who hands in memory without values relies on all of it being written.
        assert!(rows.len() == 3 * per_channel && rows.iter().all(|row| row.len() == length), "rows of one length");
        let count = (TOGETHER / length).max(1);
        let mut values = [[0f32; TOGETHER]; 3];
        let (red, rest) = rows.split_at_mut(per_channel);
        let (green, blue) = rest.split_at_mut(per_channel);
        let n = scratch.log.len() / 3;
        let mut at = 0;
        for ((red, green), blue) in red.chunks_mut(count).zip(green.chunks_mut(count)).zip(blue.chunks_mut(count)) {
            let len = red.len() * length;
            let planes = [0, n, 2 * n].map(|plane| plane + at..plane + at + len);
            let from = planes.clone().map(|here| &scratch.log[here]);
            let zeros = planes.map(|here| scratch.zeros.get(here).unwrap_or_default());
            at += len;
            if let ([red], [green], [blue]) = (&mut *red, &mut *green, &mut *blue) {
                self.level.run(Opponent { matrix, eps, from, zeros, to: [red, green, blue] });
                continue;
            }
            let [r, g, b] = &mut values;
            let to = [&mut r[..len], &mut g[..len], &mut b[..len]];
            self.level.run(Opponent { matrix, eps, from, zeros, to });
            for (rows, values) in [red, green, blue].into_iter().zip(&values) {
                copy_rows(rows.iter_mut().map(|row| &mut **row), &values[..]);
            }
        }
    }
}

/// Short rows are converted together, as many as have so many positions, and copied out: what is left over at the end of each would
/// be a third of the work, and memory takes many stores at once better than a few now and then.
const TOGETHER: usize = 1024;

struct ToChannels<'a> {
    transform: &'a ChannelTransform,
    channels: usize,
    values: &'a mut [f32],
}

impl Task for ToChannels<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        self.transform.inverse(self.values, self.channels);
    }
}

struct InverseToneMap<'a> {
    eps: f32,
    values: &'a mut [f32],
}

impl Task for InverseToneMap<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        inverse_tone_maps(self.values, self.eps);
    }
}

/// Three components to values, in one pass: the sums of [`ChannelTransform::inverse`].
struct Opponent<'a, P> {
    matrix: &'a [f32; 9],
    eps: f32,
    from: [&'a [f32]; 3],
    /// Which values are exactly zero, whatever the components say; empty where none are.
    zeros: [&'a [bool]; 3],
    to: [&'a mut [P]; 3],
}

/// Positions that go together where few are left.
const FEW: usize = 8;

impl<P: Place<f32>> Task for Opponent<'_, P> {
    #[inline(always)]
    fn run<const FUSED: bool>(mut self) {
        let len = self.to[0].len();
        let mut at = 0;
        while len - at >= LANES {
            self.convert::<LANES>(at);
            at += LANES;
        }
        while len - at >= FEWER_LANES {
            self.convert::<FEWER_LANES>(at);
            at += FEWER_LANES;
        }
        while len - at >= FEW {
            self.convert::<FEW>(at);
            at += FEW;
        }
        if at < len && len >= FEW {
            // Some of them once more.
            self.convert::<FEW>(len - FEW);
        } else {
            (at..len).for_each(|at| self.convert::<1>(at));
        }
    }
}

impl<P: Place<f32>> Opponent<'_, P> {
    /// Values from a position on, channel after channel: the exponentials of one in lockstep.
    #[inline(always)]
    fn convert<const W: usize>(&mut self, at: usize) {
        let (m, [x, y, z]) = (self.matrix, self.from);
        let (x, y, z) = (&x[at..at + W], &y[at..at + W], &z[at..at + W]);
        for (c, to) in self.to.iter_mut().enumerate() {
            let mut values = [0f32; W];
            for i in 0..W {
                values[i] = (x[i] * m[c] + y[i] * m[3 + c]) + z[i] * m[6 + c];
            }
            exp32_lanes(&mut values);
            if let Some(zeros) = self.zeros[c].get(at..at + W) {
                for i in 0..W {
                    values[i] = if zeros[i] { 0.0 } else { values[i] };
                }
            }
            for (place, value) in to[at..at + W].iter_mut().zip(values) {
                place.put((value - self.eps).max(0.0));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Level;
    use crate::tone::inverse_tone_map;

    /// Rows that end anywhere within the lanes that go together, in memory with and without values.
    #[test]
    fn rows_of_every_length_are_those_of_one_position_after_the_other() {
        let opponent = ChannelTransform::opponent();
        let ChannelTransform::Matrix(m) = &opponent else { unreachable!() };
        let matrix: &[f32; 9] = m.as_slice().try_into().unwrap();
        let eps = 1e-3;
        let few = [1, FEW + 1, LANES + FEWER_LANES + FEW + 3];
        for len in (0..3 * LANES).chain([TOGETHER - 1, TOGETHER]).filter(|len| !cfg!(miri) || few.contains(len)) {
            // Some so low that only eps is left, some beyond what a float holds.
            let plane =
                |c: usize| -> Vec<f32> { (0..len).map(|i| ((i * 37 + c * 11) % 101) as f32 * 1.9 - 95.0).collect() };
            let planes = [plane(0), plane(1), plane(2)];
            let from = [&planes[0][..], &planes[1][..], &planes[2][..]];
            let expected: Vec<Vec<f32>> = (0..3)
                .map(|c| {
                    let log = |i: usize| (from[0][i] * m[c] + from[1][i] * m[3 + c]) + from[2][i] * m[6 + c];
                    (0..len).map(|i| inverse_tone_map(log(i), eps)).collect()
                })
                .collect();
            for level in Level::all() {
                let mut rows = [vec![f32::NAN; len], vec![f32::NAN; len], vec![f32::NAN; len]];
                let [r, g, b] = &mut rows;
                level.run(Opponent { matrix, eps, from, zeros: [&[]; 3], to: [r, g, b] });
                let bits = |row: &Vec<f32>| row.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
                assert!(rows.iter().map(bits).eq(expected.iter().map(bits)), "{len}");
                let mut places = [(); 3].map(|()| vec![MaybeUninit::uninit(); len]);
                let [r, g, b] = &mut places;
                level.run(Opponent { matrix, eps, from, zeros: [&[]; 3], to: [r, g, b] });
                for (places, expected) in places.iter().zip(&expected) {
                    // SAFETY: each was written to, or this test fails under Miri.
                    #[allow(unsafe_code)]
                    let written: Vec<f32> = places.iter().map(|place| unsafe { place.assume_init() }).collect();
                    assert_eq!(&written, expected, "{len}");
                }
            }
        }
    }
}
