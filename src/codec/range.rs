//! Adaptive binary range coder (spec section 4.7).
//!
//! One walk over the data serves both directions: code is written once against [`Coder`], whose decoder ignores
//! the value that it is given and returns the one in the stream.

/// Codes decisions under adaptive contexts. A loop over many holds its coder by value, the default in its place meanwhile: behind a
/// reference each decision would wait for the numbers of the one before to be stored, since the compiler does not know that the states are
/// elsewhere.
pub(crate) trait Coder: Default {
    /// Whether it is a decoder: the values that it is given mean nothing.
    const READS: bool = false;
    /// One decision under context `context`.
    fn bit(&mut self, context: usize, bit: bool) -> bool;
    /// The low `bits` (at most 31) bits of `value`, all equally likely, high bit first.
    fn raw(&mut self, value: u32, bits: u32) -> u32;
    /// `count` ones and a zero, none if it is `limit`; each under a context of its own, from `first` on.
    #[inline(always)]
    fn unary(&mut self, first: usize, limit: u32, count: u32) -> u32 {
        let mut ones = 0;
        while ones < limit && self.bit(first + ones as usize, ones < count) {
            ones += 1;
        }
        ones
    }
}

/// Probability of a one in 1/65536: the mean of a fast and a slow estimate, both started at the file's value.
#[derive(Clone, Copy, Debug)]
struct State {
    fast: u16,
    slow: u16,
}

const FAST: u32 = 4;
const SLOW: u32 = 7;

impl State {
    /// No file has a probability of zero.
    fn new(probability: u16) -> State {
        State { fast: probability, slow: probability }
    }

    /// Probability of a one, 1 to 65535 out of 65536: steps down are rounded down, so that no estimate falls below 1.
    #[inline(always)]
    fn probability(self) -> u32 {
        (u32::from(self.fast) + u32::from(self.slow)) >> 1
    }

    #[inline(always)]
    fn update(&mut self, bit: bool) {
        if bit {
            self.fast += (65535 - self.fast) >> FAST;
            self.slow += (65535 - self.slow) >> SLOW;
        } else {
            self.fast -= self.fast >> FAST;
            self.slow -= self.slow >> SLOW;
        }
    }

    /// A decoder's decision, from its range and what the stream holds above the range's bottom.
    #[inline(always)]
    fn decide(&mut self, range: &mut u32, code: &mut u32) -> bool {
        let bound = ((u64::from(*range) * u64::from(self.probability())) >> 16) as u32;
        let bit = *code < bound;
        if bit {
            *range = bound;
        } else {
            *code -= bound;
            *range -= bound;
        }
        self.update(bit);
        bit
    }
}

/// Reads decisions from a record; past its end it reads zeros.
#[derive(Clone, Default)]
pub(crate) struct Decoder<'a> {
    states: Vec<State>,
    data: &'a [u8],
    at: usize,
    range: u32,
    code: u32,
}

impl<'a> Decoder<'a> {
    pub(crate) fn new(probabilities: &[u16], data: &'a [u8]) -> Decoder<'a> {
        let states = probabilities.iter().map(|&p| State::new(p)).collect();
        let mut decoder = Decoder { states, data, at: 0, range: u32::MAX, code: 0 };
        for _ in 0..4 {
            decoder.code = decoder.code << 8 | decoder.next_byte();
        }
        decoder
    }

    #[inline(always)]
    fn next_byte(&mut self) -> u32 {
        let byte = self.data.get(self.at).copied().unwrap_or(0);
        self.at += 1;
        u32::from(byte)
    }

    #[inline(always)]
    fn normalize(&mut self) {
        while self.range < 1 << 24 {
            self.range <<= 8;
            self.code = self.code << 8 | self.next_byte();
        }
    }

    /// The same decoder over other bytes, which agree with its own as far as it has read.
    pub(crate) fn over<'b>(&self, data: &'b [u8]) -> Decoder<'b> {
        Decoder { states: self.states.clone(), data, at: self.at, range: self.range, code: self.code }
    }

    /// Whether the range is a power of two: all decisions so far were even.
    pub(crate) fn is_plain(&self) -> bool {
        self.range.is_power_of_two()
    }

    /// Bits that the decisions so far took in the stream, and a constant.
    pub(crate) fn information(&self) -> f64 {
        8.0 * self.at as f64 - f64::from(self.range).log2()
    }

    /// Bytes that were read so far, those beyond the end included.
    pub(crate) fn position(&self) -> usize {
        self.at
    }

    /// Bytes that the decisions read so far cannot account for.
    pub(crate) fn unread(&self) -> usize {
        self.data.len().saturating_sub(self.at)
    }

    /// Every byte must have had its use.
    pub(crate) fn check_end(&self) -> Result<(), &'static str> {
        if self.unread() > 0 { Err("bytes are left over at its end") } else { Ok(()) }
    }
}

impl Coder for Decoder<'_> {
    const READS: bool = true;

    #[inline(always)]
    fn bit(&mut self, context: usize, _: bool) -> bool {
        let bit = self.states[context].decide(&mut self.range, &mut self.code);
        self.normalize();
        bit
    }

    #[inline(always)]
    fn raw(&mut self, _: u32, bits: u32) -> u32 {
        let (mut range, mut code) = (self.range, self.code);
        let mut value = 0;
        for _ in 0..bits {
            range >>= 1;
            // Without a branch: which way it goes is not predictable.
            let bit = u32::from(code < range);
            code -= range & bit.wrapping_sub(1);
            value = value << 1 | bit;
            if range < 1 << 24 {
                range <<= 8;
                code = code << 8 | self.next_byte();
            }
        }
        (self.range, self.code) = (range, code);
        value
    }
}

#[cfg(feature = "encode")]
pub(crate) use encoder::{Costs, Counter, Encoder};

#[cfg(feature = "encode")]
mod encoder {
    use super::{Coder, State};

    /// Writes decisions; the inverse of [`super::Decoder`].
    #[derive(Default)]
    pub(crate) struct Encoder {
        states: Vec<State>,
        low: u64,
        range: u32,
        out: Vec<u8>,
    }

    impl Encoder {
        pub(crate) fn new(probabilities: &[u16]) -> Encoder {
            // With zero it would never end.
            let states = probabilities.iter().map(|&p| State::new(p.max(1))).collect();
            Encoder { states, low: 0, range: u32::MAX, out: Vec::new() }
        }

        fn normalize(&mut self) {
            while self.range < 1 << 24 {
                self.shift();
                self.range <<= 8;
            }
        }

        /// Moves the top byte of `low` out, carrying into what was written.
        fn shift(&mut self) {
            self.carry();
            self.out.push((self.low >> 24) as u8);
            self.low = (self.low & 0x00FF_FFFF) << 8;
        }

        fn carry(&mut self) {
            if self.low > u64::from(u32::MAX) {
                for byte in self.out.iter_mut().rev() {
                    *byte = byte.wrapping_add(1);
                    if *byte != 0 {
                        break;
                    }
                }
                self.low &= u64::from(u32::MAX);
            }
        }

        /// The bytes: the shortest that decode to the same decisions, since the decoder reads zeros past the end.
        pub(crate) fn finish(mut self) -> Vec<u8> {
            let last = self.low + u64::from(self.range) - 1;
            let zeros = (0..=32).rev().find(|&z| (last >> z) << z >= self.low).unwrap_or(0);
            self.low = (last >> zeros) << zeros;
            for _ in 0..4 {
                self.shift();
            }
            while self.out.last() == Some(&0) {
                self.out.pop();
            }
            self.out
        }
    }

    impl Coder for Encoder {
        fn bit(&mut self, context: usize, bit: bool) -> bool {
            let state = &mut self.states[context];
            let bound = ((u64::from(self.range) * u64::from(state.probability())) >> 16) as u32;
            if bit {
                self.range = bound;
            } else {
                self.low += u64::from(bound);
                self.range -= bound;
            }
            state.update(bit);
            self.normalize();
            bit
        }

        fn raw(&mut self, value: u32, bits: u32) -> u32 {
            for i in (0..bits).rev() {
                self.range >>= 1;
                if value >> i & 1 == 0 {
                    self.low += u64::from(self.range);
                }
                self.normalize();
            }
            value
        }
    }

    /// Counts decisions by context: trains the file's probabilities and estimates sizes.
    #[derive(Clone, Default)]
    pub(crate) struct Counter {
        pub(crate) counts: Vec<[u32; 2]>,
        pub(crate) raw_bits: u64,
    }

    impl Counter {
        pub(crate) fn new(contexts: usize) -> Counter {
            Counter { counts: vec![[0; 2]; contexts], raw_bits: 0 }
        }

        pub(crate) fn add(&mut self, other: &Counter) {
            for (a, b) in self.counts.iter_mut().zip(&other.counts) {
                a[0] += b[0];
                a[1] += b[1];
            }
            self.raw_bits += other.raw_bits;
        }

        /// Contexts from `to` on count what those of a range did.
        pub(crate) fn copy(&mut self, from: std::ops::Range<usize>, to: usize) {
            self.counts.copy_within(from, to);
        }

        /// Probability of a one in each context; `None` where storing it would save fewer than `bits`.
        pub(crate) fn probabilities(&self, bits: f64) -> Vec<Option<f64>> {
            let probability = |&[zeros, ones]: &[u32; 2]| {
                let total = f64::from(zeros) + f64::from(ones);
                let saved = total - cost(zeros, total) - cost(ones, total);
                (saved >= bits).then(|| (f64::from(ones) + 0.4) / (total + 0.8))
            };
            self.counts.iter().map(probability).collect()
        }

        /// Bits that the counted decisions cost at their average probabilities.
        pub(crate) fn bits(&self) -> f64 {
            let coded: f64 = self
                .counts
                .iter()
                .map(|&[zeros, ones]| {
                    let total = f64::from(zeros) + f64::from(ones);
                    cost(zeros, total) + cost(ones, total)
                })
                .sum();
            coded + self.raw_bits as f64
        }
    }

    /// Bits of a decision's outcome that came `n` times of `total`.
    fn cost(n: u32, total: f64) -> f64 {
        if n == 0 { 0.0 } else { f64::from(n) * (total / f64::from(n)).log2() }
    }

    /// Adds up what decisions cost at fixed probabilities.
    #[derive(Clone, Default)]
    pub(crate) struct Costs {
        /// Bits of a zero and of a one, by context.
        bits: Vec<[f32; 2]>,
        sum: f64,
    }

    impl Costs {
        /// At the shares counted.
        pub(crate) fn new(counter: &Counter) -> Costs {
            let bits = |&[zeros, ones]: &[u32; 2]| {
                let total = f64::from(zeros) + f64::from(ones) + 0.8;
                [zeros, ones].map(|n| (total / (f64::from(n) + 0.4)).log2() as f32)
            };
            Costs { bits: counter.counts.iter().map(bits).collect(), sum: 0.0 }
        }

        /// Bits of a decision.
        #[inline(always)]
        pub(crate) fn of(&self, context: usize, bit: bool) -> f32 {
            self.bits[context][usize::from(bit)]
        }

        /// The bits since the last call.
        pub(crate) fn take_bits(&mut self) -> f64 {
            std::mem::take(&mut self.sum)
        }
    }

    impl Coder for Costs {
        fn bit(&mut self, context: usize, bit: bool) -> bool {
            self.sum += f64::from(self.bits[context][usize::from(bit)]);
            bit
        }

        fn raw(&mut self, value: u32, bits: u32) -> u32 {
            self.sum += f64::from(bits);
            value
        }
    }

    impl Coder for Counter {
        fn bit(&mut self, context: usize, bit: bool) -> bool {
            self.counts[context][usize::from(bit)] += 1;
            bit
        }

        fn raw(&mut self, value: u32, bits: u32) -> u32 {
            self.raw_bits += u64::from(bits);
            value
        }
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[derive(Clone, Debug)]
    enum Symbol {
        Bit(usize, bool),
        Raw(u32, u32),
    }

    fn symbols() -> impl Strategy<Value = Vec<Symbol>> {
        prop::collection::vec(
            prop_oneof![
                8 => (0usize..5, 0u32..100).prop_map(|(c, x)| Symbol::Bit(c, x < [1, 50, 99, 0, 100][c])),
                1 => (0u32..32, any::<u32>()).prop_map(|(n, v)| Symbol::Raw(v & ((1u64 << n) - 1) as u32, n)),
            ],
            0..2000,
        )
    }

    proptest! {
        #[test]
        fn decoding_undoes_coding(symbols in symbols(), probabilities in prop::array::uniform5(1u16..)) {
            let mut encoder = Encoder::new(&probabilities);
            for symbol in &symbols {
                match *symbol {
                    Symbol::Bit(c, b) => { encoder.bit(c, b); }
                    Symbol::Raw(v, n) => { encoder.raw(v, n); }
                }
            }
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&probabilities, &bytes);
            for symbol in &symbols {
                match *symbol {
                    Symbol::Bit(c, b) => prop_assert_eq!(decoder.bit(c, false), b),
                    Symbol::Raw(v, n) => prop_assert_eq!(decoder.raw(0, n), v),
                }
            }
            prop_assert_eq!(decoder.unread(), 0);
        }
    }

    #[test]
    fn cost_approaches_the_entropy() {
        let mut random = crate::codec::sample::SplitMix64(1);
        let bits: Vec<bool> = (0..100_000).map(|_| random.next_u64().is_multiple_of(50)).collect();
        let mut encoder = Encoder::new(&[65536u32.div_ceil(50) as u16]);
        let mut counter = Counter::new(1);
        for &bit in &bits {
            encoder.bit(0, bit);
            counter.bit(0, bit);
        }
        let (coded, ideal) = (encoder.finish().len() as f64 * 8.0, counter.bits());
        // Adaptation costs; a coder without it would be within 0.1 %.
        assert!(coded > ideal * 0.99 && coded < ideal * 1.08, "{coded} bits for {ideal}");
    }
}
