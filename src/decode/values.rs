//! From the components of a block's log values to its values, in the rows of a table or of the block.

use std::mem::MaybeUninit;

use super::rebuild::{Header, Scratch};
use super::table::copy_rows;
use crate::channel::ChannelTransform;
use crate::exact::{LANES, exp32_lanes};
use crate::simd::Task;
use crate::tone::{inverse_tone_map, inverse_tone_maps};

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

    /// BRDF values in all of the rows of a block, `[channel][row]`, from the components in the scratch.
    pub(super) fn values_in_rows<P: Place<f32>>(&self, scratch: &mut Scratch, mut rows: Vec<&mut [P]>) {
        if let (ChannelTransform::Matrix(matrix), 3) = (&self.coding.transform, self.grid.channels().len()) {
            let eps = self.coding.eps as f32;
            let long = rows.first().is_some_and(|row| row.len() >= LONG);
            let (components, rows) = (&scratch.log[..], &mut rows[..]);
            if long {
                self.level.run(OpponentRows::<P, true> { matrix, eps, components, rows });
            } else {
                self.level.run(OpponentRows::<P, false> { matrix, eps, components, rows });
            }
            let mut zeros = &scratch.zeros[..];
            for row in rows.iter_mut().filter(|_| !scratch.zeros.is_empty()) {
                let (here, rest) = zeros.split_at(row.len());
                if here.contains(&true) {
                    row.iter_mut().zip(here).filter(|(_, zero)| **zero).for_each(|(place, _)| place.put(0.0));
                }
                zeros = rest;
            }
            return;
        }
        self.to_channels(&mut scratch.log);
        scratch.hide_zeros();
        copy_rows(rows, self.values(scratch));
    }
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

/// Three components to values in the rows of a block, in one pass: the sums of [`ChannelTransform::inverse`].
struct OpponentRows<'a, 'b, P, const BY_CHANNEL: bool> {
    /// Of three channels.
    matrix: &'a [f32],
    eps: f32,
    components: &'a [f32],
    /// `[channel][row]`.
    rows: &'a mut [&'b mut [P]],
}

impl<P: Place<f32>, const BY_CHANNEL: bool> Task for OpponentRows<'_, '_, P, BY_CHANNEL> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let OpponentRows { matrix, eps, components, rows } = self;
        let m: [f32; 9] = std::array::from_fn(|i| matrix[i]);
        let (red, rest) = rows.split_at_mut(rows.len() / 3);
        let (green, blue) = rest.split_at_mut(red.len());
        let (mut first, rest) = components.split_at(components.len() / 3);
        let (mut second, mut third) = rest.split_at(first.len());
        for ((red, green), blue) in red.iter_mut().zip(green).zip(blue) {
            let len = red.len();
            // Closures over arrays would not be inlined.
            let (x, y, z);
            (x, first) = first.split_at(len);
            (y, second) = second.split_at(len);
            (z, third) = third.split_at(len);
            let many = if BY_CHANNEL { len / LANES * LANES } else { 0 };
            for at in (0..many).step_by(LANES) {
                channels::<P, LANES>(&m, eps, [x, y, z], [red, green, blue], at);
            }
            let whole = if len >= FEW { len / FEW * FEW } else { len };
            let from = x[many..whole].iter().zip(&y[many..whole]).zip(&z[many..whole]);
            let to = red[many..whole].iter_mut().zip(&mut green[many..whole]).zip(&mut blue[many..whole]);
            for (((r, g), b), ((x, y), z)) in to.zip(from) {
                r.put(inverse_tone_map((x * m[0] + y * m[3]) + z * m[6], eps));
                g.put(inverse_tone_map((x * m[1] + y * m[4]) + z * m[7], eps));
                b.put(inverse_tone_map((x * m[2] + y * m[5]) + z * m[8], eps));
            }
            if whole < len {
                // Some of them once more: one position at a time would take a third of short rows' time.
                channels::<P, FEW>(&m, eps, [x, y, z], [red, green, blue], len - FEW);
            }
        }
    }
}

/// Positions that are done together at the end of a row.
const FEW: usize = 8;

/// Positions from which channel after channel is faster, by 5 to 8 %. Short rows lie apart in memory, which takes stores in three
/// places at a time better: a table of 60 positions a row is decoded 4 % slower otherwise.
const LONG: usize = 256;

/// The values of a row from a position on, channel after channel.
#[inline(always)]
fn channels<P: Place<f32>, const W: usize>(m: &[f32; 9], eps: f32, from: [&[f32]; 3], to: [&mut [P]; 3], at: usize) {
    let [x, y, z] = from;
    let (x, y, z) = (&x[at..at + W], &y[at..at + W], &z[at..at + W]);
    for (c, to) in to.into_iter().enumerate() {
        let mut values = [0f32; W];
        for i in 0..W {
            values[i] = (x[i] * m[c] + y[i] * m[3 + c]) + z[i] * m[6 + c];
        }
        exp32_lanes(&mut values);
        for (place, value) in to[at..at + W].iter_mut().zip(values) {
            place.put((value - eps).max(0.0));
        }
    }
}
