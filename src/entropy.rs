//! Context modelling of a block's quantised coefficients (spec section 4.6).
//!
//! Per channel: whether any coefficient but the first is nonzero; extents along each axis; per row along the last
//! axis within the extents, whether it holds any; per coefficient of such a row, whether it is nonzero, its
//! magnitude, its sign. The contexts are magnitudes already coded: lower frequencies along each axis, and the same
//! place in the channel before. The coefficient at index 0 is kept in the file's index.

use crate::fourier::Extents;
use crate::range::Coder;

/// Largest magnitude of a quantised coefficient.
pub(crate) const MAX_MAGNITUDE: u32 = 1 << 24;

/// Channels beyond this share their contexts.
const CHANNEL_CLASSES: usize = 3;
const LEVELS: usize = 12;
const POSITIONS: usize = 4;
const SISTERS: usize = 3;
/// Magnitudes less one have at most 24 bits.
const EXPONENTS: usize = 25;
const MAGNITUDE_LEVELS: usize = 8;

const ANY: usize = 0;
const EXTENT: usize = ANY + CHANNEL_CLASSES;
const ROW: usize = EXTENT + CHANNEL_CLASSES * 4 * 16;
const SIGNIFICANT: usize = ROW + CHANNEL_CLASSES * 3 * 3 * 3;
const EXPONENT: usize = SIGNIFICANT + CHANNEL_CLASSES * SISTERS * POSITIONS * LEVELS;
const MANTISSA: usize = EXPONENT + CHANNEL_CLASSES * MAGNITUDE_LEVELS * EXPONENTS;
/// Number of contexts for coefficients.
pub(crate) const CONTEXTS: usize = MANTISSA + EXPONENTS;

/// Level of a weighted sum of neighbouring magnitudes, 0 to 11.
const fn level_table() -> [u8; 256] {
    let mut table = [0; 256];
    let mut i = 0;
    while i < 256 {
        table[i] = match i {
            0..=6 => i as u8,
            7..=8 => 7,
            9..=11 => 8,
            12..=16 => 9,
            17..=28 => 10,
            _ => 11,
        };
        i += 1;
    }
    table
}
static LEVEL: [u8; 256] = level_table();

/// Scratch of the walk: magnitudes capped at 255, padded so that every neighbour exists.
#[derive(Debug, Default)]
pub(crate) struct Walk {
    magnitudes: Vec<u8>,
    sister: Vec<u8>,
    rows: Vec<u8>,
    sister_rows: Vec<u8>,
}

/// A decoded extent or magnitude that no coded block holds.
#[derive(Debug)]
pub(crate) struct OutOfRange;

impl Walk {
    /// Codes the coefficients of all channels, `[channel][position]`; a decoder finds them zero and leaves them
    /// filled. Gives each channel's extents (all zero for none), the first coefficient left aside.
    pub(crate) fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        shape: [usize; 4],
        coefficients: &mut [i32],
        extents: &mut Vec<Extents>,
    ) -> Result<(), OutOfRange> {
        let [n0, n1, n2, n3] = shape;
        let padded = (n0 + 1) * (n1 + 1) * (n2 + 2) * (n3 + 3);
        let padded_rows = (n0 + 1) * (n1 + 1) * (n2 + 2);
        for buffer in [&mut self.magnitudes, &mut self.sister] {
            buffer.clear();
            buffer.resize(padded, 0);
        }
        for buffer in [&mut self.rows, &mut self.sister_rows] {
            buffer.clear();
            buffer.resize(padded_rows, 0);
        }
        extents.clear();
        let n: usize = shape.iter().product();
        for (channel, plane) in coefficients.chunks_exact_mut(n).enumerate() {
            if channel > 0 {
                std::mem::swap(&mut self.magnitudes, &mut self.sister);
                std::mem::swap(&mut self.rows, &mut self.sister_rows);
                self.magnitudes.fill(0);
                self.rows.fill(0);
            }
            extents.push(self.channel(coder, channel, shape, plane)?);
        }
        Ok(())
    }

    fn channel<C: Coder>(
        &mut self,
        coder: &mut C,
        channel: usize,
        shape: [usize; 4],
        plane: &mut [i32],
    ) -> Result<Extents, OutOfRange> {
        let class = channel.min(CHANNEL_CLASSES - 1);
        let found = find_extents(shape, plane);
        if !coder.bit(ANY + class, found[0] > 0) {
            return Ok([0; 4]);
        }
        let mut extents = [1; 4];
        for axis in 0..4 {
            let contexts = EXTENT + (class * 4 + axis) * 16;
            extents[axis] = 1 + code_below(coder, contexts, shape[axis], found[axis].saturating_sub(1))?;
        }
        let [_, n1, n2, n3] = shape;
        let row_len = n3 + 3;
        let rows = [(n1 + 1) * (n2 + 2), n2 + 2];
        for i in 0..extents[0] {
            for j in 0..extents[1] {
                for k in 0..extents[2] {
                    // Rows are padded by one before along three axes and one after along the third.
                    let row = (i + 1) * rows[0] + (j + 1) * rows[1] + k + 1;
                    let start = ((i * n1 + j) * n2 + k) * n3;
                    let line = &mut plane[start..start + n3];
                    let first = usize::from(start == 0);
                    let near = self.rows[row - 1] + self.rows[row - rows[1]];
                    let around = self.rows[row - rows[1] + 1] + self.rows[row - rows[0]];
                    let context = ROW
                        + ((class * 3 + usize::from(near)) * 3 + usize::from(around)) * 3
                        + usize::from(self.sister_rows[row] + u8::from(channel == 0) * 2);
                    let any = line[first..extents[3]].iter().any(|&q| q != 0);
                    if !coder.bit(context, any) {
                        continue;
                    }
                    self.rows[row] = 1;
                    let neighbours = Neighbours {
                        above: row_len,
                        before: rows[1] * row_len,
                        outer: rows[0] * row_len,
                        frequency: 4 * (i + j + k),
                        total: extents[0] + extents[1] + extents[2] + extents[3],
                    };
                    self.row(coder, class, &mut line[..extents[3]], first, row * row_len + 2, &neighbours)?;
                }
            }
        }
        Ok(extents)
    }

    #[inline(always)]
    fn row<C: Coder>(
        &mut self,
        coder: &mut C,
        class: usize,
        line: &mut [i32],
        first: usize,
        start: usize,
        n: &Neighbours,
    ) -> Result<(), OutOfRange> {
        for (l, place) in line.iter_mut().enumerate().skip(first) {
            let at = start + l;
            let m = |offset: usize| u32::from(self.magnitudes[offset]);
            let sum = 2 * (m(at - 1) + m(at - n.above) + m(at - n.before))
                + m(at - 2)
                + m(at - n.above + 1)
                + m(at - n.before + 1)
                + m(at - n.before + n.above)
                + m(at - n.outer);
            let sister = u32::from(self.sister[at]);
            let level = usize::from(LEVEL[sum.min(255) as usize]);
            let position = ((n.frequency + 4 * l) / n.total).min(POSITIONS - 1);
            let context =
                SIGNIFICANT + ((class * SISTERS + sister.min(2) as usize) * POSITIONS + position) * LEVELS + level;
            let q = *place;
            if !coder.bit(context, q != 0) {
                continue;
            }
            let local = (sum + 3 * sister).min(255) as usize;
            let level = (usize::from(LEVEL[local])).saturating_sub(3).min(MAGNITUDE_LEVELS - 1);
            let contexts = EXPONENT + (class * MAGNITUDE_LEVELS + level) * EXPONENTS;
            let magnitude = 1 + code_number(coder, contexts, MANTISSA, q.unsigned_abs().wrapping_sub(1))?;
            let negative = coder.raw(u32::from(q < 0), 1) == 1;
            *place = if negative { -(magnitude as i32) } else { magnitude as i32 };
            self.magnitudes[at] = magnitude.min(255) as u8;
        }
        Ok(())
    }
}

/// Offsets to the neighbouring rows in the padded magnitudes, and the row's place among the frequencies.
struct Neighbours {
    above: usize,
    before: usize,
    outer: usize,
    frequency: usize,
    total: usize,
}

/// Extents of the nonzero coefficients, the first one left aside.
pub(crate) fn find_extents(shape: [usize; 4], plane: &[i32]) -> Extents {
    let mut extents = [0; 4];
    for (row, line) in plane.chunks_exact(shape[3]).enumerate() {
        let line = if row == 0 { &line[1..] } else { line };
        if let Some(last) = line.iter().rposition(|&q| q != 0) {
            let at =
                [row / shape[2] / shape[1], row / shape[2] % shape[1], row % shape[2], last + usize::from(row == 0)];
            for axis in 0..4 {
                extents[axis] = extents[axis].max(at[axis] + 1);
            }
        }
    }
    extents
}

/// A number below `n`: its upper four bits in a tree of 16 contexts, the rest raw.
fn code_below<C: Coder>(coder: &mut C, contexts: usize, n: usize, value: usize) -> Result<usize, OutOfRange> {
    let bits = usize::BITS - (n - 1).leading_zeros();
    let raw = bits.saturating_sub(4);
    let mut node = 1;
    for i in (raw..bits).rev() {
        node = node << 1 | usize::from(coder.bit(contexts + node, value >> i & 1 == 1));
    }
    let high = node - (1 << (bits - raw));
    let low = coder.raw((value & ((1 << raw) - 1)) as u32, raw) as usize;
    let number = high << raw | low;
    if number < n { Ok(number) } else { Err(OutOfRange) }
}

/// A number from 0: the count of its bits in unary, the second-highest bit under a context of its own, the rest raw.
pub(crate) fn code_number<C: Coder>(
    coder: &mut C,
    unary: usize,
    mantissa: usize,
    value: u32,
) -> Result<u32, OutOfRange> {
    let length = u32::BITS - value.leading_zeros();
    let mut bits = 0;
    while coder.bit(unary + bits as usize, bits < length) {
        bits += 1;
        if bits as usize == EXPONENTS {
            return Err(OutOfRange);
        }
    }
    if bits < 2 {
        return Ok(bits);
    }
    let second = coder.bit(mantissa + bits as usize, value >> (bits - 2) & 1 == 1);
    let low = coder.raw(value & ((1 << (bits - 2)) - 1), bits - 2);
    let decoded = (2 | u32::from(second)) << (bits - 2) | low;
    if decoded < MAX_MAGNITUDE { Ok(decoded) } else { Err(OutOfRange) }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::range::{Decoder, Encoder};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decoding_undoes_coding(
            shape in prop::array::uniform4(1usize..7), channels in 1usize..5, density in 0u32..100,
            seed in any::<u64>(), size in 1u32..25
        ) {
            let n: usize = shape.iter().product();
            let mut random = crate::sample::SplitMix64(seed);
            let mut coefficients: Vec<i32> = (0..channels * n)
                .map(|i| {
                    let r = random.next_u64();
                    let present = r % 100 < u64::from(density) && i % n != 0;
                    let magnitude = ((r >> 8) as u32 & ((1 << size) - 1)).min(MAX_MAGNITUDE) as i32;
                    if present { if r >> 63 == 1 { -magnitude } else { magnitude } } else { 0 }
                })
                .collect();
            let original = coefficients.clone();
            let probabilities = vec![20000u16; CONTEXTS];
            let mut encoder = Encoder::new(&probabilities);
            let (mut walk, mut extents) = (Walk::default(), Vec::new());
            walk.code(&mut encoder, shape, &mut coefficients, &mut extents).unwrap();
            prop_assert_eq!(&coefficients, &original);
            let bytes = encoder.finish();
            let mut decoded = vec![0; channels * n];
            let mut decoder = Decoder::new(&probabilities, &bytes);
            let mut decoded_extents = Vec::new();
            walk.code(&mut decoder, shape, &mut decoded, &mut decoded_extents).unwrap();
            prop_assert_eq!(decoded, original);
            prop_assert_eq!(extents, decoded_extents);
            prop_assert_eq!(decoder.unread(), 0);
        }

        #[test]
        fn arbitrary_bytes_end(bytes in prop::collection::vec(any::<u8>(), 0..200), p in 0u16..) {
            let mut coefficients = vec![0; 2 * 5 * 6 * 7];
            let _ = Walk::default().code(
                &mut Decoder::new(&vec![p; CONTEXTS], &bytes), [1, 5, 6, 7], &mut coefficients, &mut Vec::new());
        }
    }
}
