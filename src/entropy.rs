//! Context modelling of a block's quantised coefficients (spec section 4.6).
//!
//! Per channel: whether any coefficient but the first is nonzero; extents along each axis; per row along the last
//! axis within the extents, whether it holds any; per coefficient of such a row, whether it is nonzero, its
//! magnitude, its sign. The contexts are magnitudes already coded: lower frequencies along each axis, and the same
//! place in the channel before. The coefficient at index 0 is kept in the file's index.

use crate::dependent::{Quantization, State};
use crate::fourier::Extents;
use crate::range::Coder;
#[cfg(feature = "encode")]
use crate::range::Costs;

/// Largest magnitude of a quantised coefficient.
pub(crate) const MAX_MAGNITUDE: u32 = 1 << 24;

/// Channels beyond this share their contexts.
const CHANNEL_CLASSES: usize = 3;
const LEVELS: usize = 12;
const POSITIONS: usize = 4;
const SISTERS: usize = 3;
/// Magnitudes less one have at most 24 bits.
const EXPONENTS: usize = 25;
/// Contexts that each part of a number takes.
pub(crate) const MAX_NUMBER_BITS: usize = EXPONENTS;
const MAGNITUDE_LEVELS: usize = 8;

const ANY: usize = 0;
const EXTENT: usize = ANY + CHANNEL_CLASSES;
const ROW: usize = EXTENT + CHANNEL_CLASSES * 4 * 16;
pub(crate) const SIGNIFICANT: usize = ROW + CHANNEL_CLASSES * 3 * 3 * 3;
const EXPONENT: usize = SIGNIFICANT + CHANNEL_CLASSES * SISTERS * POSITIONS * LEVELS;
const MANTISSA: usize = EXPONENT + CHANNEL_CLASSES * MAGNITUDE_LEVELS * EXPONENTS;
/// Number of contexts for coefficients, but those for states of odd multiples.
pub(crate) const CONTEXTS: usize = MANTISSA + EXPONENTS;
/// First context of whether a coefficient is nonzero where the state has the odd multiples: after all others of a record.
/// Contexts of their own for the magnitudes there saved less than their probabilities took.
pub(crate) const SIGNIFICANT_ODD: usize = 1633;
/// Number of contexts from there.
pub(crate) const ODD_CONTEXTS: usize = EXPONENT - SIGNIFICANT;

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

/// Chooses the integers of a row just before they are coded.
pub(crate) trait Rows {
    /// The integers from [`Row::first`] on are to be chosen.
    fn choose(&mut self, row: &Row, line: &mut [i32]);
}

/// The integers stay what they are.
struct AsGiven;

impl Rows for AsGiven {
    #[inline(always)]
    fn choose(&mut self, _: &Row, _: &mut [i32]) {}
}

/// A row about to be coded, and what is known of its surroundings.
pub(crate) struct Row<'a> {
    walk: &'a Walk,
    /// Place of the row's first position in the padded magnitudes.
    start: usize,
    neighbours: &'a Neighbours,
    pub(crate) channel: usize,
    /// Place of the row's first position in the channel.
    pub(crate) position: usize,
    /// First index of the row that is coded with it.
    pub(crate) first: usize,
    /// Context of whether the row holds any nonzero.
    pub(crate) any: usize,
}

/// What the contexts of a coefficient depend on, but for those before it on its row.
#[derive(Clone, Copy)]
pub(crate) struct Surroundings {
    class: usize,
    place: usize,
    /// Weighted sum of the neighbours' magnitudes on rows coded before.
    sum: u32,
    /// Magnitude at the same place in the channel before.
    sister: u32,
}

impl Row<'_> {
    #[cfg(feature = "encode")]
    pub(crate) fn surroundings(&self, l: usize) -> Surroundings {
        self.walk.surroundings(self.channel, self.start + l, l, self.neighbours)
    }
}

impl Surroundings {
    /// The same with the two magnitudes before on the row.
    #[inline(always)]
    pub(crate) fn after(self, one: u32, two: u32) -> Surroundings {
        Surroundings { sum: self.sum + 2 * one + two, ..self }
    }

    /// Context of whether the coefficient is nonzero.
    #[inline(always)]
    pub(crate) fn significant(&self, state: State) -> usize {
        let base = if state.is_odd() { SIGNIFICANT_ODD } else { SIGNIFICANT };
        let level = usize::from(LEVEL[self.sum.min(255) as usize]);
        base + ((self.class * SISTERS + self.sister.min(2) as usize) * POSITIONS + self.place) * LEVELS + level
    }

    /// First context of its magnitude.
    #[inline(always)]
    pub(crate) fn exponents(&self) -> usize {
        let sum = (self.sum + 3 * self.sister).min(255) as usize;
        let level = usize::from(LEVEL[sum]).saturating_sub(3).min(MAGNITUDE_LEVELS - 1);
        EXPONENT + (self.class * MAGNITUDE_LEVELS + level) * EXPONENTS
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
    fn reserve(&mut self, rows: usize, length: usize) {
        self.clear();
        self.rows.resize(rows.max(self.rows.len()), 0);
        self.magnitudes.resize((rows * length).max(self.magnitudes.len()), 0);
    }
}

/// Scratch of the walk.
#[derive(Debug, Default)]
pub(crate) struct Walk {
    now: Coded,
    /// Of the channel before.
    sister: Coded,
}

/// A decoded extent or magnitude that no coded block holds.
#[derive(Debug)]
pub(crate) struct OutOfRange;

impl Walk {
    /// Codes the coefficients of all channels, `[channel][position]`; a decoder writes those below the extents and leaves the
    /// others alone. Gives each channel's extents (all zero for none), the first coefficient left aside.
    pub(crate) fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        quantization: Quantization,
        shape: [usize; 4],
        coefficients: &mut [i32],
        extents: &mut Vec<Extents>,
    ) -> Result<(), OutOfRange> {
        self.code_rows(coder, quantization, shape, coefficients, extents, &mut AsGiven)
    }

    /// The same of coefficients that are chosen row by row; those given tell the extents.
    pub(crate) fn code_rows<C: Coder>(
        &mut self,
        coder: &mut C,
        quantization: Quantization,
        shape: [usize; 4],
        coefficients: &mut [i32],
        extents: &mut Vec<Extents>,
        rows: &mut impl Rows,
    ) -> Result<(), OutOfRange> {
        let [n0, n1, n2, n3] = shape;
        let rows_padded = (n0 + 1) * (n1 + 1) * (n2 + 2);
        self.now.reserve(rows_padded, n3 + 3);
        self.sister.reserve(rows_padded, n3 + 3);
        extents.clear();
        let n: usize = shape.iter().product();
        for (channel, plane) in coefficients.chunks_exact_mut(n).enumerate() {
            if channel > 0 {
                std::mem::swap(&mut self.now, &mut self.sister);
                self.now.clear();
            }
            extents.push(match quantization {
                Quantization::Scalar => self.channel::<_, false>(coder, channel, shape, plane, rows)?,
                Quantization::Dependent => self.channel::<_, true>(coder, channel, shape, plane, rows)?,
            });
        }
        Ok(())
    }

    fn channel<C: Coder, const DEPENDENT: bool>(
        &mut self,
        coder: &mut C,
        channel: usize,
        shape: [usize; 4],
        plane: &mut [i32],
        chooser: &mut impl Rows,
    ) -> Result<Extents, OutOfRange> {
        let class = channel.min(CHANNEL_CLASSES - 1);
        let found = if C::READS { [0; 4] } else { find_extents(shape, plane) };
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
                    let coded = &self.now.rows;
                    let near = coded[row - 1] + coded[row - rows[1]];
                    let around = coded[row - rows[1] + 1] + coded[row - rows[0]];
                    let context = ROW
                        + ((class * 3 + usize::from(near)) * 3 + usize::from(around)) * 3
                        + usize::from(self.sister.rows[row] + u8::from(channel == 0) * 2);
                    let line = &mut line[..extents[3]];
                    let neighbours = &Neighbours {
                        above: row_len,
                        before: rows[1] * row_len,
                        outer: rows[0] * row_len,
                        frequency: 4 * (i + j + k),
                        total: extents[0] + extents[1] + extents[2] + extents[3],
                    };
                    let at = row * row_len + 2;
                    let about =
                        Row { walk: self, start: at, neighbours, channel, position: start, first, any: context };
                    chooser.choose(&about, line);
                    if C::READS {
                        line.fill(0);
                    }
                    let any = !C::READS && line[first..].iter().any(|&q| q != 0);
                    if !coder.bit(context, any) {
                        continue;
                    }
                    self.now.rows[row] = 1;
                    self.now.touched.push((row, at..at + line.len()));
                    self.row::<_, DEPENDENT>(coder, channel, line, first, at, neighbours)?;
                }
            }
        }
        Ok(extents)
    }

    #[inline(always)]
    fn row<C: Coder, const DEPENDENT: bool>(
        &mut self,
        coder: &mut C,
        channel: usize,
        line: &mut [i32],
        first: usize,
        start: usize,
        n: &Neighbours,
    ) -> Result<(), OutOfRange> {
        let mut state = State::default();
        for (l, place) in line.iter_mut().enumerate().skip(first) {
            let at = start + l;
            let before = [at - 1, at - 2].map(|before| u32::from(self.now.magnitudes[before]));
            let surroundings = self.surroundings(channel, at, l, n).after(before[0], before[1]);
            let q = *place;
            if !coder.bit(surroundings.significant(state), q != 0) {
                if DEPENDENT {
                    state = state.after(0);
                }
                continue;
            }
            let told = if DEPENDENT { state.index(q.unsigned_abs()) } else { q.unsigned_abs() };
            let index = 1 + code_number(coder, surroundings.exponents(), MANTISSA, told.wrapping_sub(1))?;
            let magnitude = if DEPENDENT { state.magnitude(index) } else { index };
            if magnitude > MAX_MAGNITUDE {
                return Err(OutOfRange);
            }
            let negative = coder.raw(u32::from(q < 0), 1) == 1;
            *place = if negative { -(magnitude as i32) } else { magnitude as i32 };
            self.now.magnitudes[at] = index.min(255) as u8;
            if DEPENDENT {
                state = state.after(index);
            }
        }
        Ok(())
    }

    /// Of a coefficient, by its place in the padded magnitudes and on its row.
    #[inline(always)]
    fn surroundings(&self, channel: usize, at: usize, l: usize, n: &Neighbours) -> Surroundings {
        let m = |offset: usize| u32::from(self.now.magnitudes[offset]);
        Surroundings {
            class: channel.min(CHANNEL_CLASSES - 1),
            place: ((n.frequency + 4 * l) / n.total).min(POSITIONS - 1),
            sum: 2 * (m(at - n.above) + m(at - n.before))
                + m(at - n.above + 1)
                + m(at - n.before + 1)
                + m(at - n.before + n.above)
                + m(at - n.outer),
            sister: u32::from(self.sister.magnitudes[at]),
        }
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
    let bits = coder.unary(unary, EXPONENTS as u32, u32::BITS - value.leading_zeros());
    if bits as usize == EXPONENTS {
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
    use crate::range::{Decoder, Encoder};
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
            shape in prop::array::uniform4(1usize..7), channels in 1usize..5, density in 0u32..100,
            seed in any::<u64>(), size in 1u32..25, dependent in any::<bool>()
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
            let quantization = if dependent { Quantization::Dependent } else { Quantization::Scalar };
            if dependent {
                allow(shape, &mut coefficients);
            }
            let original = coefficients.clone();
            let probabilities = vec![20000u16; SIGNIFICANT_ODD + ODD_CONTEXTS];
            let mut encoder = Encoder::new(&probabilities);
            let (mut walk, mut extents) = (Walk::default(), Vec::new());
            walk.code(&mut encoder, quantization, shape, &mut coefficients, &mut extents).unwrap();
            prop_assert_eq!(&coefficients, &original);
            let bytes = encoder.finish();
            let mut decoded = vec![0; channels * n];
            let mut decoder = Decoder::new(&probabilities, &bytes);
            let mut decoded_extents = Vec::new();
            walk.code(&mut decoder, quantization, shape, &mut decoded, &mut decoded_extents).unwrap();
            prop_assert_eq!(decoded, original);
            prop_assert_eq!(extents, decoded_extents);
            prop_assert_eq!(decoder.unread(), 0);
        }

        #[test]
        fn arbitrary_bytes_end(bytes in prop::collection::vec(any::<u8>(), 0..200), p in 0u16..) {
            for quantization in [Quantization::Scalar, Quantization::Dependent] {
                let mut coefficients = vec![0; 2 * 5 * 6 * 7];
                let mut decoder = Decoder::new(&vec![p; SIGNIFICANT_ODD + ODD_CONTEXTS], &bytes);
                let _ = Walk::default().code(
                    &mut decoder, quantization, [1, 5, 6, 7], &mut coefficients, &mut Vec::new());
                prop_assert!(coefficients.iter().all(|q| q.unsigned_abs() <= MAX_MAGNITUDE));
            }
        }
    }
}
