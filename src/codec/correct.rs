//! Corrections of decoded log values: what keeps each entry within a largest error (spec section 4.11).
//!
//! Per channel: whether there is any; per row along the last axis, whether it holds any; per valid entry of such a row,
//! whether it has one, its magnitude, its sign. Outliers are few, cluster where the decoded values change fast, and are
//! mostly common to the channels: the contexts are those three things.

use crate::base::budget::refill;
use crate::codec::contexts::{CORRECTION_ANY, CORRECTION_EXPONENT, CORRECTION_MANTISSA, CORRECTION_PRESENT, CORRECTION_ROW, CORRECTION_SIGN, CORRECTION_SLOPES, NUMBER_BITS};
use crate::codec::entropy::{OutOfRange, code_number};
use crate::codec::range::Coder;

/// Lower ends of the classes of slopes but the first, in correction steps.
const SLOPE_ENDS: [f32; CORRECTION_SLOPES - 1] = [0.25, 0.5, 1.0, 2.0];

/// Scratch of the walk, padded so that every neighbour exists.
#[derive(Debug, Default)]
pub(crate) struct Walk {
    /// Of the channel, the one before, and the one before that.
    planes: [Plane; 3],
}

#[derive(Debug, Default)]
struct Plane {
    /// Corrections, held within -2 and 2.
    corrections: Vec<i8>,
    /// Whether a row holds any.
    rows: Vec<u8>,
}

impl Plane {
    fn clear(&mut self, rows: usize, row_len: usize) -> Result<(), OutOfRange> {
        refill(&mut self.corrections, rows * row_len, 0).map_err(|_| OutOfRange)?;
        refill(&mut self.rows, rows, 0).map_err(|_| OutOfRange)
    }
}

/// Rows of a channel and their length, padded.
fn padded([n0, n1, n2, n3]: [usize; 4]) -> [usize; 2] {
    [n0 * (n1 + 1) * (n2 + 1), n3 + 1]
}

/// Bytes that a walk over a block takes.
pub(crate) fn bytes_of_walk(shape: [usize; 4]) -> usize {
    let [rows, length] = padded(shape);
    3 * rows * (length + 1)
}

/// A block as the walk sees it.
#[derive(Clone, Copy)]
pub(crate) struct Decoded<'a> {
    pub(crate) shape: [usize; 4],
    /// Validity, `[channel][position]` or one for all channels.
    pub(crate) masks: &'a [bool],
    /// Log values before correction, `[channel][position]`.
    pub(crate) log: &'a [f32],
    /// Correction step.
    pub(crate) step: f32,
}

impl Walk {
    /// What its buffers take in memory.
    pub(crate) fn bytes(&self) -> usize {
        self.planes.iter().map(|plane| plane.corrections.capacity() + plane.rows.capacity()).sum()
    }

    /// Codes the corrections of all channels, `[channel][position]`; a decoder finds them zero and leaves them filled.
    pub(crate) fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        contexts: usize,
        block: Decoded,
        corrections: &mut [i32],
    ) -> Result<(), OutOfRange> {
        let [n0, n1, n2, n3] = block.shape;
        let n = n0 * n1 * n2 * n3;
        let [rows, length] = padded(block.shape);
        // Most blocks have none and need no scratch.
        let mut prepared = false;
        let mut before = 0;
        for (channel, plane) in corrections.chunks_exact_mut(n).enumerate() {
            let any = coder.bit(contexts + CORRECTION_ANY + before, plane.iter().any(|&m| m != 0));
            before = 1 + usize::from(any);
            if any && !prepared {
                prepared = true;
                self.planes.iter_mut().try_for_each(|plane| plane.clear(rows, length))?;
            } else if prepared {
                self.planes.rotate_right(1);
                self.planes[0].clear(rows, length)?;
            }
            if any {
                let masks =
                    if block.masks.len() == n { block.masks } else { &block.masks[channel * n..(channel + 1) * n] };
                let log = &block.log[channel * n..(channel + 1) * n];
                self.channel(coder, contexts, channel, Decoded { masks, log, ..block }, plane)?;
            }
        }
        Ok(())
    }

    fn channel<C: Coder>(
        &mut self,
        coder: &mut C,
        contexts: usize,
        channel: usize,
        block: Decoded,
        plane: &mut [i32],
    ) -> Result<(), OutOfRange> {
        let [_, n1, n2, n3] = block.shape;
        for (number, line) in plane.chunks_exact_mut(n3).enumerate() {
            let at = number * n3;
            let mask = &block.masks[at..at + n3];
            if !mask.contains(&true) {
                continue;
            }
            // Rows are padded by one before along the second and third axis, entries by one along the last.
            let (i, j, k) = (number / n2 / n1, number / n2 % n1, number % n2);
            let row = (i * (n1 + 1) + j + 1) * (n2 + 1) + k + 1;
            let [above, before] = [row - 1, row - (n2 + 1)];
            let near = self.planes[0].rows[above] + self.planes[0].rows[before];
            let sister = if channel == 0 { 2 } else { self.planes[1].rows[row] };
            let any = line.iter().any(|&m| m != 0);
            if !coder.bit(contexts + CORRECTION_ROW + usize::from(near * 3 + sister), any) {
                continue;
            }
            self.planes[0].rows[row] = 1;
            let rows = [row, above, before].map(|row| row * (n3 + 1) + 1);
            for (l, place) in line.iter_mut().enumerate().filter(|(l, _)| mask[*l]) {
                let here = block.log[at + l];
                let slope = |there: bool, other: usize| if there { (here - block.log[other]).abs() } else { 0.0 };
                let along = slope(l > 0, (at + l).wrapping_sub(1)).max(slope(l + 1 < n3, at + l + 1));
                let across = slope(k > 0, (at + l).wrapping_sub(n3)).max(slope(k + 1 < n2, at + l + n3));
                let slope = along.max(across);
                let class = SLOPE_ENDS.iter().filter(|&end| slope >= end * block.step).count();
                self.entry(coder, contexts, channel, class, rows.map(|row| row + l), place)?;
            }
        }
        Ok(())
    }

    #[inline(always)]
    fn entry<C: Coder>(
        &mut self,
        coder: &mut C,
        contexts: usize,
        channel: usize,
        slope: usize,
        [at, above, before]: [usize; 3],
        place: &mut i32,
    ) -> Result<(), OutOfRange> {
        let [own, sister, elder] = &self.planes;
        let near = [own.corrections[at - 1], own.corrections[above], own.corrections[before]];
        let (sister, elder) = (sister.corrections[at], elder.corrections[at]);
        let size = usize::from(sister.unsigned_abs());
        let kind = match channel {
            0 => 0,
            1 => 1 + size,
            _ => 4 + 2 * size + usize::from(elder != 0),
        };
        let corrected = usize::from(near != [0; 3]);
        let m = *place;
        if !coder.bit(contexts + CORRECTION_PRESENT + (kind * CORRECTION_SLOPES + slope) * 2 + corrected, m != 0) {
            return Ok(());
        }
        let large = near.iter().chain([&sister]).any(|m| m.unsigned_abs() > 1);
        let exponent = contexts + CORRECTION_EXPONENT + usize::from(large) * NUMBER_BITS;
        let magnitude = 1 + code_number(coder, exponent, contexts + CORRECTION_MANTISSA, m.unsigned_abs().wrapping_sub(1))?;
        let sign = |m: i8| (m.signum() + 1) as usize;
        let nearest = near.into_iter().find(|&m| m != 0).unwrap_or(0);
        let negative = coder.bit(contexts + CORRECTION_SIGN + sign(sister) * 3 + sign(nearest), m < 0);
        *place = if negative { -(magnitude as i32) } else { magnitude as i32 };
        self.planes[0].corrections[at] = (*place).clamp(-2, 2) as i8;
        Ok(())
    }
}

/// Adds the corrections to the log values.
pub(crate) fn correct(log: &mut [f32], corrections: &[i32], step: f32) {
    for (value, &m) in log.iter_mut().zip(corrections).filter(|(_, m)| **m != 0) {
        *value += m as f32 * step;
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::codec::contexts::CORRECTION_CONTEXTS;
    use crate::codec::entropy::MAX_MAGNITUDE;
    use crate::codec::range::{Decoder, Encoder};
    use proptest::prelude::*;

    /// Walks forward and back; gives the bytes.
    fn round_trip(block: Decoded, corrections: &[i32]) -> Vec<u8> {
        let probabilities = vec![9000u16; CORRECTION_CONTEXTS];
        let mut encoder = Encoder::new(&probabilities);
        let mut walk = Walk::default();
        let mut given = corrections.to_vec();
        walk.code(&mut encoder, 0, block, &mut given).unwrap();
        assert_eq!(given, corrections);
        let bytes = encoder.finish();
        let mut decoded = vec![0; corrections.len()];
        let mut decoder = Decoder::new(&probabilities, &bytes);
        walk.code(&mut decoder, 0, block, &mut decoded).unwrap();
        assert_eq!(decoded, corrections);
        assert_eq!(decoder.unread(), 0);
        bytes
    }

    proptest! {
        #[test]
        fn decoding_undoes_coding(
            shape in prop::array::uniform4(1usize..6), channels in 1usize..5, density in 0u64..100, common in any::<bool>(),
            seed in any::<u64>(), size in 1u32..25
        ) {
            let n: usize = shape.iter().product();
            let mut random = crate::codec::sample::SplitMix64(seed);
            let masks: Vec<bool> =
                (0..if common { n } else { channels * n }).map(|_| !random.next_u64().is_multiple_of(5)).collect();
            let log: Vec<f32> = (0..channels * n).map(|_| (random.next_u64() >> 56) as f32 * 0.01).collect();
            let corrections: Vec<i32> = (0..channels * n)
                .map(|i| {
                    let r = random.next_u64();
                    let present = r % 100 < density && masks[i % masks.len()];
                    let magnitude = ((r >> 8) as u32 & ((1 << size) - 1)).min(MAX_MAGNITUDE) as i32;
                    if present { if r >> 63 == 1 { -magnitude } else { magnitude } } else { 0 }
                })
                .collect();
            round_trip(Decoded { shape, masks: &masks, log: &log, step: 0.3 }, &corrections);
        }

        #[test]
        fn arbitrary_bytes_end(bytes in prop::collection::vec(any::<u8>(), 0..200), p in 0u16..) {
            let n = 5 * 6 * 7;
            let (masks, log) = (vec![true; n], vec![0.0; 2 * n]);
            let block = Decoded { shape: [1, 5, 6, 7], masks: &masks, log: &log, step: 1.0 };
            let probabilities = vec![p; CORRECTION_CONTEXTS];
            let mut decoder = Decoder::new(&probabilities, &bytes);
            let _ = Walk::default().code(&mut decoder, 0, block, &mut vec![0; 2 * n]);
        }
    }

    /// Spec section 4.11 byte for byte; the decoder written from the specification reads them so.
    #[test]
    fn bytes_are_those_of_the_specification() {
        let masks = [true, true, false, true, true, true];
        let log = [0.0, 0.1, 0.2, 5.0, 5.0, 5.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0];
        let block = Decoded { shape: [1, 1, 2, 3], masks: &masks, log: &log, step: 0.5 };
        assert_eq!(
            round_trip(block, &[0, -1, 0, 3, 0, 0, 0, -1, 0, 300, 0, 0]),
            [0, 189, 35, 195, 51, 172, 124, 53, 13, 96]
        );
        assert_eq!(round_trip(block, &[0; 12]), [128]);
    }

    #[test]
    fn corrections_are_added_in_single_precision() {
        let mut log = [0.1f32, -3.0, 7.0];
        correct(&mut log, &[2, 0, -1], 0.3);
        assert_eq!(log, [0.1 + 2.0 * 0.3f32, -3.0, 7.0 - 0.3f32]);
    }
}
