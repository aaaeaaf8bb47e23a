//! Context modelling of a block's quantised coefficients (spec section 4.6).
//!
//! Per channel: whether any coefficient but the first is nonzero; extents along each axis; per row along the last
//! axis within the extents, whether it holds any; per coefficient of such a row, whether it is nonzero, its
//! magnitude, its sign. The contexts are magnitudes already coded: lower frequencies along each axis, and the same
//! place in the channel before. The coefficient at index 0 is kept in the file's index.

mod coefficients;
mod surroundings;

pub(crate) use self::coefficients::Coefficients;
pub(crate) use self::surroundings::WIDTH;
use self::surroundings::{Neighbours, Step, quarters};
use crate::base::budget::{self, Budget, Fault};
use crate::base::error::{Error, Result};
use crate::codec::contexts::{ANY, CLASSES, EXTENT, MANTISSA, NUMBER_BITS, ROW};
use crate::codec::dependent::{Quantization, State};
#[cfg(feature = "encode")]
use crate::codec::range::Costs;
use crate::codec::range::{Coder, Decoder};

/// Largest magnitude of a quantised coefficient.
pub(crate) const MAX_MAGNITUDE: u32 = 1 << 24;

/// Along each axis, the coefficients at this index and beyond are zero.
pub(crate) type Extents = [usize; 4];

/// The integers of a channel.
pub(crate) trait Rows {
    /// Their extents, the first integer left aside; a decoder's are not looked at.
    fn extents(&self, shape: [usize; 4]) -> Extents;
    /// Called with a row just before it is coded: its integers may be chosen yet.
    #[inline(always)]
    fn choose(&mut self, _: &Around, _length: usize) {}
    /// The one at a position; a decoder's is not looked at.
    fn get(&self, position: usize) -> i32;
    /// Called with the number of rows that are gone through.
    #[inline(always)]
    fn pass(&mut self, _rows: usize) {}
    /// Called with the number of integers that a decoder may find on the row that comes, so that there is room.
    #[inline(always)]
    fn expect(&mut self, _length: usize) -> Result<(), OutOfRange> {
        Ok(())
    }
    /// Called with each integer that a decoder finds not to be zero.
    #[inline(always)]
    fn find(&mut self, _position: usize, _q: i32) {}
}

/// Coded as they are.
impl Rows for &[i32] {
    fn extents(&self, shape: [usize; 4]) -> Extents {
        find_extents(shape, self)
    }

    #[inline(always)]
    fn get(&self, position: usize) -> i32 {
        self[position]
    }
}

/// To be found.
impl Rows for Coefficients {
    fn extents(&self, _: [usize; 4]) -> Extents {
        [0; 4]
    }

    #[inline(always)]
    fn get(&self, _: usize) -> i32 {
        0
    }

    #[inline(always)]
    fn pass(&mut self, rows: usize) {
        self.count_steps(rows);
    }

    #[inline(always)]
    fn expect(&mut self, length: usize) -> Result<(), OutOfRange> {
        self.make_room(length)
    }

    #[inline(always)]
    fn find(&mut self, position: usize, q: i32) {
        self.push(position, q);
    }
}

/// A row about to be coded, and what is known of its surroundings.
pub(crate) struct Around<'a> {
    #[cfg_attr(not(feature = "encode"), expect(dead_code, reason = "decoders choose nothing"))]
    walk: &'a Walk,
    pub(crate) row: Row,
}

/// A row of coefficients along the last axis.
#[derive(Clone, Copy)]
pub(crate) struct Row {
    pub(crate) channel: usize,
    /// Place of the first in the channel.
    pub(crate) position: usize,
    /// First index that is coded with it.
    pub(crate) first: usize,
    /// Context of whether it holds any nonzero.
    pub(crate) any: usize,
    /// Place of the first in the padded magnitudes.
    start: usize,
    neighbours: Neighbours,
    /// Sum of the frequencies along the axes before.
    frequency: usize,
}

#[cfg(feature = "encode")]
impl Around<'_> {
    /// What is known of the coefficients from one on.
    pub(crate) fn step(&self, l: usize) -> Step {
        self.walk.step(self.row, l)
    }
}

/// What contexts need to know of a channel: padded so that every neighbour exists, and zero wherever no row was coded.
#[derive(Debug, Default)]
struct Coded {
    /// Magnitudes, or indices, capped at 255.
    magnitudes: Vec<u8>,
    /// Whether the row holds any nonzero.
    rows: Vec<u8>,
    /// Rows that were coded, and where their magnitudes are.
    touched: Vec<(usize, std::ops::Range<usize>)>,
}

impl Coded {
    /// All zero again, at the cost of what was coded.
    fn clear(&mut self) {
        for (row, magnitudes) in self.touched.drain(..) {
            self.rows[row] = 0;
            self.magnitudes[magnitudes].fill(0);
        }
    }

    /// For a block whose padded rows have a length.
    fn reserve(&mut self, [rows, length, coded]: [usize; 3]) -> Result<()> {
        self.clear();
        budget::lengthen(&mut self.rows, rows, 0)?;
        budget::make_room(&mut self.touched, coded)?;
        // A step may read beyond the last.
        budget::lengthen(&mut self.magnitudes, rows * length + WIDTH + 1, 0)
    }

    fn bytes(&self) -> usize {
        self.magnitudes.capacity() + self.rows.capacity() + self.touched.capacity() * TOUCHED
    }
}

/// Bytes of an entry of the rows that were coded.
const TOUCHED: usize = size_of::<(usize, std::ops::Range<usize>)>();

/// Scratch of the walk.
#[derive(Debug, Default)]
pub(crate) struct Walk {
    now: Coded,
    /// Of the channel before.
    sister: Coded,
    /// Quarter of each sum of frequencies.
    quarters: Vec<u8>,
}

/// A decoded extent or magnitude that no coded block holds, or more integers than there is room for ([`Coefficients::refused`]).
#[derive(Debug)]
pub(crate) struct OutOfRange;

/// Rows of a block and their length, padded, and rows that may be coded.
fn padded([n0, n1, n2, n3]: [usize; 4]) -> [usize; 3] {
    [(n0 + 1) * (n1 + 1) * (n2 + 2), n3 + 3, n0 * n1 * n2]
}

/// Bytes that a walk over a block takes.
pub(crate) fn bytes_of_walk(shape: [usize; 4]) -> usize {
    let [rows, length, coded] = padded(shape);
    2 * (rows * (length + 1) + coded * TOUCHED)
}

impl Walk {
    /// Codes the coefficients of all channels, `[channel][position]`, but the first of each.
    #[cfg(feature = "encode")]
    pub(crate) fn code(
        &mut self,
        coder: &mut impl Coder,
        quantization: Quantization,
        shape: [usize; 4],
        planes: &[i32],
    ) -> Result<(), OutOfRange> {
        self.code_rows(coder, quantization, shape, planes.chunks_exact(shape.iter().product()))
    }

    /// The same of channels whose coefficients may be chosen row by row.
    #[cfg(feature = "encode")]
    pub(crate) fn code_rows(
        &mut self,
        coder: &mut impl Coder,
        quantization: Quantization,
        shape: [usize; 4],
        channels: impl Iterator<Item = impl Rows>,
    ) -> Result<(), OutOfRange> {
        self.reserve(shape).map_err(|_| OutOfRange)?;
        for (channel, mut rows) in channels.enumerate() {
            self.channel(coder, quantization, channel, shape, &mut rows)?;
        }
        Ok(())
    }

    /// Decodes those that are not zero, of as many channels.
    pub(crate) fn decode(
        &mut self,
        decoder: &mut Decoder,
        quantization: Quantization,
        shape: [usize; 4],
        channels: usize,
        coefficients: &mut Coefficients,
        budget: &Budget,
    ) -> Result<(), Fault> {
        self.reserve(shape)?;
        coefficients.begin(budget.bytes_left());
        for channel in 0..channels {
            if self.channel(decoder, quantization, channel, shape, coefficients).is_err() {
                let refused = coefficients.refused().map(|got| Error::LimitExceeded {
                    what: "bytes of the coefficients of a block",
                    got,
                    limit: budget.bytes_left(),
                });
                return Err(refused.map_or("an extent or a coefficient is out of range".into(), Fault::Refused));
            }
            coefficients.end_channel();
        }
        Ok(())
    }

    fn reserve(&mut self, shape: [usize; 4]) -> Result<()> {
        let padded = padded(shape);
        self.now.reserve(padded)?;
        self.sister.reserve(padded)
    }

    /// What its buffers take in memory.
    pub(crate) fn bytes(&self) -> usize {
        self.now.bytes() + self.sister.bytes() + self.quarters.capacity()
    }

    fn channel<C: Coder>(
        &mut self,
        coder: &mut C,
        quantization: Quantization,
        channel: usize,
        shape: [usize; 4],
        rows: &mut impl Rows,
    ) -> Result<(), OutOfRange> {
        if channel > 0 {
            std::mem::swap(&mut self.now, &mut self.sister);
            self.now.clear();
        }
        let mut held = std::mem::take(coder);
        let coded = match quantization {
            Quantization::Scalar => self.rows::<_, false>(&mut held, channel, shape, rows),
            Quantization::Dependent => self.rows::<_, true>(&mut held, channel, shape, rows),
        };
        *coder = held;
        coded
    }

    #[inline(always)]
    fn rows<C: Coder, const DEPENDENT: bool>(
        &mut self,
        coder: &mut C,
        channel: usize,
        shape: [usize; 4],
        rows: &mut impl Rows,
    ) -> Result<(), OutOfRange> {
        let class = channel.min(CLASSES - 1);
        let given = rows.extents(shape);
        if !coder.bit(ANY + class, given[0] > 0) {
            return Ok(());
        }
        let mut extents = [1; 4];
        for axis in 0..4 {
            let contexts = EXTENT + (class * 4 + axis) * 16;
            extents[axis] = 1 + code_below(coder, contexts, shape[axis], given[axis].saturating_sub(1))?;
        }
        let [_, n1, n2, n3] = shape;
        let row_len = n3 + 3;
        let strides = [(n1 + 1) * (n2 + 2), n2 + 2];
        let neighbours = Neighbours { above: row_len, before: strides[1] * row_len, outer: strides[0] * row_len };
        quarters(extents, &mut self.quarters);
        rows.pass(extents[0] * extents[1] * extents[2]);
        for i in 0..extents[0] {
            for j in 0..extents[1] {
                for k in 0..extents[2] {
                    // Rows are padded by one before along three axes and one after along the third.
                    let row = (i + 1) * strides[0] + (j + 1) * strides[1] + k + 1;
                    let position = ((i * n1 + j) * n2 + k) * n3;
                    let first = usize::from(position == 0);
                    let coded = &self.now.rows;
                    let near = coded[row - 1] + coded[row - strides[1]];
                    let around = coded[row - strides[1] + 1] + coded[row - strides[0]];
                    let any = ROW
                        + ((class * 3 + usize::from(near)) * 3 + usize::from(around)) * 3
                        + usize::from(self.sister.rows[row] + u8::from(channel == 0) * 2);
                    let (start, frequency) = (row * row_len + 2, i + j + k);
                    let about = Row { channel, position, first, any, start, neighbours, frequency };
                    rows.choose(&Around { walk: self, row: about }, extents[3]);
                    let has_any = !C::READS && (first..extents[3]).any(|l| rows.get(position + l) != 0);
                    if !coder.bit(any, has_any) {
                        continue;
                    }
                    rows.expect(extents[3])?;
                    self.now.rows[row] = 1;
                    self.now.touched.push((row, start..start + extents[3]));
                    self.row::<_, DEPENDENT>(coder, about, extents[3], rows)?;
                }
            }
        }
        Ok(())
    }

    #[inline(always)]
    fn row<C: Coder, const DEPENDENT: bool>(
        &mut self,
        coder: &mut C,
        row: Row,
        length: usize,
        rows: &mut impl Rows,
    ) -> Result<(), OutOfRange> {
        let mut state = State::default();
        // Magnitudes of the two before.
        let mut before = [0; 2];
        let (mut from, mut at) = (0, row.first);
        while from < length {
            let step = self.step(row, from);
            for l in at..length.min(from + WIDTH) {
                let i = l % WIDTH;
                let q = rows.get(row.position + l);
                if !coder.bit(step.significant(i, before, state), q != 0) {
                    before = [0, before[0]];
                    if DEPENDENT {
                        state = state.after(0);
                    }
                    continue;
                }
                let index_coded = if DEPENDENT { state.index(q.unsigned_abs()) } else { q.unsigned_abs() };
                let index = 1 + code_number(coder, step.exponents(i, before), MANTISSA, index_coded.wrapping_sub(1))?;
                let magnitude = if DEPENDENT { state.magnitude(index) } else { index };
                if magnitude > MAX_MAGNITUDE {
                    return Err(OutOfRange);
                }
                let negative = coder.raw(u32::from(q < 0), 1) == 1;
                rows.find(row.position + l, if negative { -(magnitude as i32) } else { magnitude as i32 });
                before = [index.min(255), before[0]];
                self.now.magnitudes[row.start + l] = before[0] as u8;
                if DEPENDENT {
                    state = state.after(index);
                }
            }
            from += WIDTH;
            at = from;
        }
        Ok(())
    }

    /// Of a row's coefficients from one on.
    #[inline(always)]
    fn step(&self, row: Row, l: usize) -> Step {
        let class = row.channel.min(CLASSES - 1);
        let quarters = &self.quarters[row.frequency + l..];
        Step::new(class, &self.now, &self.sister, row.start + l, row.neighbours, quarters)
    }
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
#[inline(always)]
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
#[inline(always)]
pub(crate) fn code_number<C: Coder>(
    coder: &mut C,
    unary: usize,
    mantissa: usize,
    value: u32,
) -> Result<u32, OutOfRange> {
    let bits = coder.unary(unary, NUMBER_BITS as u32, u32::BITS - value.leading_zeros());
    if bits as usize == NUMBER_BITS {
        return Err(OutOfRange);
    }
    let decoded = code_low_bits(coder, mantissa, bits, value);
    if decoded < MAX_MAGNITUDE { Ok(decoded) } else { Err(OutOfRange) }
}

/// The bits below the leading one of a number of `bits` bits: the first under a context of its own, from `contexts` on, the
/// rest raw.
#[inline(always)]
pub(crate) fn code_low_bits<C: Coder>(coder: &mut C, contexts: usize, bits: u32, value: u32) -> u32 {
    if bits < 2 {
        return bits;
    }
    let low = bits - 2;
    let second = coder.bit(contexts + bits as usize, value >> low & 1 == 1);
    (2 | u32::from(second)) << low | coder.raw(value & ((1 << low) - 1), low)
}

/// Bits of [`code_number`] under the contexts of a magnitude.
#[cfg(feature = "encode")]
pub(crate) fn price_number(costs: &Costs, unary: usize, value: u32) -> f32 {
    let bits = (u32::BITS - value.leading_zeros()) as usize;
    let ones: f32 = (0..bits).map(|i| costs.of(unary + i, true)).sum();
    let end = ones + costs.of(unary + bits, false);
    if bits < 2 {
        return end;
    }
    end + costs.of(MANTISSA + bits, value >> (bits - 2) & 1 == 1) + (bits - 2) as f32
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::codec::contexts::CONTEXTS;
    use crate::codec::range::{Decoder, Encoder};
    use proptest::prelude::*;

    /// Makes the coefficients such as dependent quantisation allows.
    fn allow(shape: [usize; 4], coefficients: &mut [i32]) {
        let n: usize = shape.iter().product();
        for plane in coefficients.chunks_exact_mut(n) {
            let extents = find_extents(shape, plane);
            for (row, line) in plane.chunks_exact_mut(shape[3]).enumerate() {
                let mut state = State::default();
                for q in line.iter_mut().take(extents[3]).skip(usize::from(row == 0)).filter(|_| extents[0] > 0) {
                    let index = state.index(q.unsigned_abs()).min(MAX_MAGNITUDE / 2);
                    let magnitude = if index == 0 { 0 } else { state.magnitude(index) as i32 };
                    *q = q.signum() * magnitude;
                    state = state.after(if *q == 0 { 0 } else { index });
                }
            }
        }
    }

    proptest! {
        #[test]
        fn decoding_undoes_coding(
            shape in (1usize..5, 1usize..5, 1usize..7, 1usize..40), channels in 1usize..5, density in 0u32..100,
            seed in any::<u64>(), size in 1u32..25, dependent in any::<bool>()
        ) {
            let shape = <[usize; 4]>::from(shape);
            let n: usize = shape.iter().product();
            let mut random = crate::codec::sample::SplitMix64(seed);
            let mut coefficients: Vec<i32> = (0..channels * n)
                .map(|i| {
                    let r = random.next_u64();
                    let present = r % 100 < u64::from(density) && i % n != 0;
                    let magnitude = ((r >> 8) as u32 & ((1 << size) - 1)).min(MAX_MAGNITUDE) as i32;
                    if present { if r >> 63 == 1 { -magnitude } else { magnitude } } else { 0 }
                })
                .collect();
            let quantization = if dependent { Quantization::Dependent } else { Quantization::Scalar };
            if dependent {
                allow(shape, &mut coefficients);
            }
            let original = coefficients.clone();
            let probabilities = vec![20000u16; CONTEXTS];
            let mut encoder = Encoder::new(&probabilities);
            let mut walk = Walk::default();
            walk.code(&mut encoder, quantization, shape, &coefficients).unwrap();
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&probabilities, &bytes);
            let mut decoded = Coefficients::of_planes(&[0, 1], 2);
            walk.decode(&mut decoder, quantization, shape, channels, &mut decoded, &Budget::unbounded()).unwrap();
            prop_assert_eq!(decoded.to_planes(channels, n).unwrap(), original);
            prop_assert_eq!(decoder.unread(), 0);
        }

        #[test]
        fn arbitrary_bytes_end(bytes in prop::collection::vec(any::<u8>(), 0..200), p in 0u16..) {
            for quantization in [Quantization::Scalar, Quantization::Dependent] {
                let mut coefficients = Coefficients::default();
                let mut decoder = Decoder::new(&vec![p; CONTEXTS], &bytes);
                let (mut walk, budget) = (Walk::default(), Budget::unbounded());
                let _ = walk.decode(&mut decoder, quantization, [1, 5, 6, 37], 2, &mut coefficients, &budget);
                let planes = coefficients.to_planes(2, 5 * 6 * 37).unwrap();
                prop_assert!(planes.iter().all(|q| q.unsigned_abs() <= MAX_MAGNITUDE));
            }
        }
    }
}
