//! From the components of a block's log values to its values, in the rows of a table or of the block.

use super::codec::{BlockCodec, Scratch};
use crate::base::error::Result;
use crate::base::portable::{FEWER_LANES, LANES, exp32_lanes};
use crate::base::simd::Task;
use crate::codec::channel::ChannelTransform;
use crate::codec::tone::inverse_tone_maps;
use crate::table::block::{Block, Place, Target};

impl Scratch {
    /// Exact zeros in the log values: exp of what they get is zero, and so is the value.
    pub(crate) fn hide_zeros(&mut self) {
        for (log, zero) in self.log.iter_mut().zip(&self.zeros) {
            *log = if *zero { f32::NEG_INFINITY } else { *log };
        }
    }
}

impl BlockCodec {
    /// Components to log values of channels, `[channel][position]`.
    pub(crate) fn to_channels(&self, values: &mut [f32]) {
        let (transform, channels) = (&self.coding.transform, self.grid.channels().len());
        self.level.run(ToChannels { transform, channels, values });
    }

    /// BRDF values in place of the log values in the scratch.
    pub(crate) fn values<'a>(&self, scratch: &'a mut Scratch) -> &'a [f32] {
        self.level.run(InverseToneMap { eps: self.coding.eps as f32, values: &mut scratch.log });
        &scratch.log
    }

    /// BRDF values in all of the memory of a block, from the components in the scratch.
    pub(crate) fn values_to<P: Place<f32>>(
        &self,
        place: &Block,
        scratch: &mut Scratch,
        mut target: Target<P>,
    ) -> Result<()> {
        let (ChannelTransform::Matrix(matrix), 3) = (&self.coding.transform, self.grid.channels().len()) else {
            self.to_channels(&mut scratch.log);
            scratch.hide_zeros();
            target.put_all(self.values(scratch));
            return Ok(());
        };
        let matrix = &std::array::from_fn(|i| matrix[i]);
        let n = place.positions();
        let Scratch { log, zeros, values, .. } = scratch;
        let planes = |at: usize, len: usize| {
            let planes = [0, n, 2 * n].map(|plane| plane + at..plane + at + len);
            (planes.clone().map(|here| &log[here]), planes.map(|here| zeros.get(here).unwrap_or_default()))
        };
        let length = target.length();
        if length >= LONG {
            let mut at = 0;
            while let Some(to) = target.next_row() {
                let (from, zeros) = planes(at, length);
                self.opponent(matrix, from, zeros, to);
                at += length;
            }
            return Ok(());
        }
        values.resize(3 * n)?;
        let (from, zeros) = planes(0, n);
        self.opponent(matrix, from, zeros, three(values));
        target.put_all(values);
        Ok(())
    }

    fn opponent<P: Place<f32>>(&self, matrix: &[f32; 9], from: [&[f32]; 3], zeros: [&[bool]; 3], to: [&mut [P]; 3]) {
        self.level.run(Opponent { matrix, eps: self.coding.eps as f32, from, zeros, to });
    }
}

/// Shorter rows are converted together and copied out: what is left over at the end of each would be a third of the work.
const LONG: usize = 512;

fn three<T>(values: &mut [T]) -> [&mut [T]; 3] {
    let (red, rest) = values.split_at_mut(values.len() / 3);
    let (green, blue) = rest.split_at_mut(rest.len() / 2);
    [red, green, blue]
}

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
        // What is left goes in few steps, with some of the positions before once more.
        if len - at > FEWER_LANES && len >= LANES {
            return self.convert::<LANES>(len - LANES);
        }
        while len - at >= FEWER_LANES {
            self.convert::<FEWER_LANES>(at);
            at += FEWER_LANES;
        }
        if at < len && len >= FEWER_LANES {
            return self.convert::<FEWER_LANES>(len - FEWER_LANES);
        }
        while len - at >= FEW {
            self.convert::<FEW>(at);
            at += FEW;
        }
        if at < len && len >= FEW {
            return self.convert::<FEW>(len - FEW);
        }
        (at..len).for_each(|at| self.convert::<1>(at));
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
    use std::mem::MaybeUninit;

    use crate::base::simd::Level;
    use crate::codec::tone::inverse_tone_map;

    /// Rows that end anywhere within the lanes that go together, in memory with and without values.
    #[test]
    fn rows_of_every_length_are_those_of_one_position_after_the_other() {
        let opponent = ChannelTransform::opponent();
        let ChannelTransform::Matrix(m) = &opponent else { unreachable!() };
        let matrix: &[f32; 9] = m.as_slice().try_into().unwrap();
        let eps = 1e-3;
        let few = [1, FEW + 1, LANES + FEWER_LANES + FEW + 3];
        for len in (0..3 * LANES).chain([LONG - 1, LONG]).filter(|len| !cfg!(miri) || few.contains(len)) {
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
