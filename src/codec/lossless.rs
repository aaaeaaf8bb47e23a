//! What restores the source's bits from the decoded table (spec section 4.12): residuals of binary64 numbers as integers,
//! coded block by block.

use crate::codec::range::Coder;
use crate::codec::tone::inverse_tone_map_f64;

/// Errors of neighbours that a prediction is mended with: six in the channel, two in the channels before.
pub(crate) const TAPS: usize = 8;
/// Denominator of their weights.
const WEIGHT_ONE: f64 = 64.0;
/// Most common trailing zero bits that are left out: those of the mantissa.
const MAX_ZEROS: u32 = 52;
/// Bits below the leading one that have contexts.
const TOP: u32 = 3;

const MISSING: usize = 0;
const SIGN: usize = MISSING + 3;
const TOPS: usize = SIGN + 6;
const LENGTH: usize = TOPS + 64 * (1 << TOP);
const MISSING_LENGTH: usize = LENGTH + 64 * 64;
/// Number of contexts.
const CONTEXTS: usize = MISSING_LENGTH + 2 * 64;

/// Probabilities that a block's coder starts with.
pub(crate) fn probabilities() -> Vec<u16> {
    vec![1 << 15; CONTEXTS]
}

/// How the valid values of a channel of a block are written.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Form {
    /// Numbers are in 1/sr and divided by the scale in the end, not in the units of the source.
    pub(crate) per_sr: bool,
    /// Trailing zero bits that all of them have.
    pub(crate) zeros: u32,
    /// Of the errors of neighbours, in 1/64.
    pub(crate) weights: [i8; TAPS],
}

/// A decoded block, and what the file says of its channels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Decoded<'a> {
    pub(crate) shape: [usize; 4],
    /// `[channel][position]`
    pub(crate) valid: &'a [bool],
    /// `[channel][position]`
    pub(crate) log: &'a [f32],
    pub(crate) eps: f64,
    pub(crate) scales: &'a [f64],
    /// Bits of an entry that is not valid, by channel.
    pub(crate) missing: &'a [u64],
}

/// Buffers.
#[derive(Debug, Default)]
pub(crate) struct Walk {
    /// Relative errors of the predictions: this channel, that before, that before it.
    errors: [Vec<f64>; 3],
    /// Bit lengths of the residuals: this channel, that before; `NONE` where none was coded.
    lengths: [Vec<u8>; 2],
}

const NONE: u8 = u8::MAX;

/// Orders the binary64 numbers like integers, on the upper `width` bits.
fn map(bits: u64, width: u32) -> u64 {
    let sign = 1 << (width - 1);
    if bits & sign == 0 { bits | sign } else { !bits & (u64::MAX >> (64 - width)) }
}

fn unmap(mapped: u64, width: u32) -> u64 {
    let sign = 1 << (width - 1);
    if mapped & sign != 0 { mapped ^ sign } else { !mapped & (u64::MAX >> (64 - width)) }
}

/// A number in `bits`, coded as its difference from `near`, both of `width` bits; gives it and the difference's length.
fn code_near<C: Coder>(
    coder: &mut C,
    contexts: usize,
    set: usize,
    [bits, near]: [u64; 2],
    width: u32,
) -> Result<(u64, u32), &'static str> {
    let unused = 64 - width;
    let near = map(near, width);
    // As a signed number of `width` bits.
    let difference = (map(bits, width).wrapping_sub(near) << unused) as i64 >> unused;
    // Magnitude, less 1 for negative ones.
    let magnitude = (difference ^ (difference >> 63)) as u64;
    let length = code_length(coder, contexts, u64::BITS - magnitude.leading_zeros());
    if length >= width {
        return Err("a residual has too many bits");
    }
    let mut coded = u64::from(length > 0);
    let mut left = length.saturating_sub(1);
    let mut node = 1;
    while left > 0 && node < 1 << TOP {
        left -= 1;
        let bit = coder.bit(TOPS + length as usize * (1 << TOP) + node, magnitude >> left & 1 == 1);
        node = 2 * node + usize::from(bit);
        coded = coded << 1 | u64::from(bit);
    }
    while left > 0 {
        let bits = left.min(24);
        left -= bits;
        coded = coded << bits | u64::from(coder.raw((magnitude >> left) as u32 & ((1 << bits) - 1), bits));
    }
    let negative = coder.bit(SIGN + set * 3 + length.min(2) as usize, difference < 0);
    let difference = if negative { !coded } else { coded };
    Ok((unmap(near.wrapping_add(difference) & (u64::MAX >> unused), width), length))
}

/// 0 to 63, high bit first, each bit under those before.
fn code_length<C: Coder>(coder: &mut C, contexts: usize, length: u32) -> u32 {
    let mut node = 1;
    for i in (0..6).rev() {
        node = 2 * node + u32::from(coder.bit(contexts + node as usize, length >> i & 1 == 1));
    }
    node - 64
}

fn code_form<C: Coder>(coder: &mut C, form: Form) -> Result<Form, &'static str> {
    let per_sr = coder.raw(u32::from(form.per_sr), 1) == 1;
    let zeros = coder.raw(form.zeros, 6);
    if zeros > MAX_ZEROS {
        return Err("more trailing zeros than a mantissa has");
    }
    let mut weights = [0; TAPS];
    if coder.raw(u32::from(form.weights != weights), 1) == 1 {
        for (to, from) in weights.iter_mut().zip(form.weights) {
            *to = coder.raw(u32::from(from as u8), 8) as u8 as i8;
        }
    }
    Ok(Form { per_sr, zeros, weights })
}

/// `x` rounded to 24 significant bits.
fn single(x: f64) -> u64 {
    (x.to_bits().wrapping_add(1 << 28) >> 29) << 29
}

/// The number in the units of a form, of the bits in those of the source.
fn in_form(bits: u64, per_sr: bool, scale: f64) -> u64 {
    if per_sr { single(f64::from_bits(bits) * scale) } else { bits }
}

fn from_form(bits: u64, per_sr: bool, scale: f64) -> u64 {
    let x = f64::from_bits(bits);
    // What machines make of the quotient of a NaN differs.
    if per_sr && !x.is_nan() { (x / scale).to_bits() } else { bits }
}

/// What a channel is predicted with, in the units of a form.
#[derive(Clone, Copy)]
struct Units {
    per_sr: bool,
    scale: f64,
    eps: f64,
    /// eps in these units.
    floor: f64,
}

impl Units {
    fn new(decoded: &Decoded, channel: usize, per_sr: bool) -> Units {
        let (scale, eps) = (decoded.scales[channel], decoded.eps);
        Units { per_sr, scale, eps, floor: if per_sr { eps } else { (eps / scale).min(f64::MAX) } }
    }

    fn predict(self, log: f32) -> f64 {
        let f = inverse_tone_map_f64(log, self.eps);
        if self.per_sr { f } else { (f / self.scale).min(f64::MAX) }
    }

    /// How far a number is from its prediction, in parts of it and the floor; 0 if that is more than 1.
    fn error(self, x: f64, predicted: f64) -> f64 {
        let error = (x - predicted) / (predicted + self.floor);
        if error.abs() <= 1.0 { error } else { 0.0 }
    }

    /// The prediction with an error expected.
    fn mend(self, predicted: f64, error: f64) -> f64 {
        let mended = predicted + (predicted + self.floor) * error;
        if predicted > 0.0 && mended > 0.0 && mended <= f64::MAX { mended } else { predicted }
    }
}

/// Errors at the neighbours of position `i`: before it along axis 3, axis 2 and axis 1; two before along axis 3; before along
/// axis 2 and one back or on along axis 3; at the same place in the channel before and in the one before that.
#[inline(always)]
fn taps(errors: &[Vec<f64>; 3], [_, n1, n2, n3]: [usize; 4], i: usize) -> [f64; TAPS] {
    let (l, k, j) = (i % n3, i / n3 % n2, i / (n3 * n2) % n1);
    let at = |there: bool, back: usize| if there { errors[0][i - back] } else { 0.0 };
    [
        at(l >= 1, 1),
        at(k >= 1, n3),
        at(j >= 1, n2 * n3),
        at(l >= 2, 2),
        at(k >= 1 && l >= 1, n3 + 1),
        at(k >= 1 && l + 1 < n3, n3.wrapping_sub(1)),
        errors[1][i],
        errors[2][i],
    ]
}

impl Walk {
    // Small by a constant: 26 bytes a position, of which a block has 2^21 at most (`MAX_BLOCK_POSITIONS`).
    fn start(&mut self, n: usize) {
        self.errors.iter_mut().for_each(|errors| refill(errors, n, 0.0));
        self.lengths.iter_mut().for_each(|lengths| refill(lengths, n, NONE));
    }

    /// The channel just done becomes that before.
    fn next_channel(&mut self, n: usize) {
        self.errors.rotate_right(1);
        refill(&mut self.errors[0], n, 0.0);
        self.lengths.rotate_right(1);
        refill(&mut self.lengths[0], n, NONE);
    }

    /// Mean length of the residuals around; `last` stands in where there is none.
    fn level(&self, [_, n1, n2, n3]: [usize; 4], i: usize, last: u8) -> usize {
        let (l, k, j) = (i % n3, i / n3 % n2, i / (n3 * n2) % n1);
        let at = |there: bool, back: usize| if there { self.lengths[0][i - back] } else { NONE };
        let around = [at(l >= 1, 1), at(k >= 1, n3), at(j >= 1, n2 * n3), self.lengths[1][i]];
        around.iter().map(|&length| usize::from(if length == NONE { last } else { length })).sum::<usize>().div_ceil(4)
    }

    /// Codes the bits of a block's entries in the units of the source, `[channel][position]`; a decoder overwrites what it is
    /// given, forms and bits.
    pub(crate) fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        decoded: Decoded,
        forms: &mut [Form],
        bits: &mut [u64],
    ) -> Result<(), &'static str> {
        let n: usize = decoded.shape.iter().product();
        self.start(n);
        for (channel, bits) in bits.chunks_exact_mut(n).enumerate() {
            let valid = &decoded.valid[channel * n..(channel + 1) * n];
            self.code_missing(coder, channel, decoded.missing[channel], valid, bits)?;
            if valid.contains(&true) {
                forms[channel] = code_form(coder, forms[channel])?;
                self.code_valid(coder, decoded, channel, forms[channel], bits)?;
            }
            self.next_channel(n);
        }
        Ok(())
    }

    /// Entries that are not valid.
    fn code_missing<C: Coder>(
        &mut self,
        coder: &mut C,
        channel: usize,
        missing: u64,
        valid: &[bool],
        bits: &mut [u64],
    ) -> Result<(), &'static str> {
        let holes = || (0..valid.len()).filter(|&i| !valid[i]);
        if holes().next().is_none() {
            return Ok(());
        }
        let usual = holes().all(|i| bits[i] == missing);
        if coder.bit(MISSING + channel.min(2), usual) {
            holes().for_each(|i| bits[i] = missing);
            return Ok(());
        }
        let mut other = 0;
        for i in holes() {
            let (coded, length) = code_near(coder, MISSING_LENGTH + other * 64, 1, [bits[i], missing], 64)?;
            bits[i] = coded;
            other = usize::from(length > 0);
        }
        Ok(())
    }

    fn code_valid<C: Coder>(
        &mut self,
        coder: &mut C,
        decoded: Decoded,
        channel: usize,
        form: Form,
        bits: &mut [u64],
    ) -> Result<(), &'static str> {
        let n = bits.len();
        let (valid, log) = (&decoded.valid[channel * n..], &decoded.log[channel * n..]);
        let units = Units::new(&decoded, channel, form.per_sr);
        let (zeros, width) = (form.zeros, 64 - form.zeros);
        let half = 1u64 << zeros >> 1;
        let mended = form.weights != [0; TAPS];
        let weights = form.weights.map(|weight| f64::from(weight) / WEIGHT_ONE);
        let mut last = 0;
        for i in (0..n).filter(|&i| valid[i]) {
            let predicted = units.predict(log[i]);
            let mut expected = predicted;
            if mended {
                let taps = taps(&self.errors, decoded.shape, i);
                let error = taps.iter().zip(&weights).fold(0.0, |sum, (tap, weight)| sum + tap * weight);
                expected = units.mend(predicted, error);
            }
            // Rounded to the grid of the form.
            let near = (expected.to_bits() + half) >> zeros;
            let level = self.level(decoded.shape, i, last);
            let source = in_form(bits[i], form.per_sr, units.scale) >> zeros;
            let (coded, length) = code_near(coder, LENGTH + level * 64, 0, [source, near], width)?;
            let coded = coded << zeros;
            bits[i] = from_form(coded, form.per_sr, units.scale);
            self.errors[0][i] = units.error(f64::from_bits(coded), predicted);
            last = length as u8;
            self.lengths[0][i] = last;
        }
        Ok(())
    }
}

fn refill<T: Copy>(buffer: &mut Vec<T>, n: usize, value: T) {
    buffer.clear();
    buffer.resize(n, value);
}

#[cfg(feature = "encode")]
mod fit {
    use super::*;

    impl Walk {
        /// Forms that make the residuals small.
        pub(crate) fn forms(&mut self, decoded: Decoded, bits: &[u64]) -> Vec<Form> {
            let n: usize = decoded.shape.iter().product();
            self.start(n);
            let mut forms = Vec::new();
            for (channel, bits) in bits.chunks_exact(n).enumerate() {
                let valid = &decoded.valid[channel * n..(channel + 1) * n];
                let log = &decoded.log[channel * n..(channel + 1) * n];
                let (per_sr, zeros) = grid(bits, valid, decoded.scales[channel]);
                let units = Units::new(&decoded, channel, per_sr);
                let mut normal = [[0.0; TAPS + 1]; TAPS];
                for i in (0..n).filter(|&i| valid[i]) {
                    let predicted = units.predict(log[i]);
                    let x = f64::from_bits(in_form(bits[i], per_sr, units.scale));
                    let error = units.error(x, predicted);
                    let taps = taps(&self.errors, decoded.shape, i);
                    for (row, a) in normal.iter_mut().zip(taps) {
                        row.iter_mut().zip(taps.iter().chain([&error])).for_each(|(sum, b)| *sum += a * b);
                    }
                    self.errors[0][i] = error;
                }
                let weights = solve(normal).map(|w| (w * WEIGHT_ONE).round().clamp(-127.0, 127.0) as i8);
                forms.push(Form { per_sr, zeros, weights });
                self.next_channel(n);
            }
            forms
        }
    }

    /// Units in which the valid numbers have most trailing zeros in common, and how many.
    fn grid(bits: &[u64], valid: &[bool], scale: f64) -> (bool, u32) {
        let valid = || bits.iter().zip(valid).filter(|(_, valid)| **valid).map(|(bits, _)| *bits);
        let zeros = |all: u64| all.trailing_zeros().min(MAX_ZEROS);
        let plain = zeros(valid().fold(0, |all, bits| all | bits));
        let mut all = 0;
        for bits in valid() {
            let rounded = in_form(bits, true, scale);
            if from_form(rounded, true, scale) != bits {
                return (false, plain);
            }
            all |= rounded;
        }
        if zeros(all) > plain { (true, zeros(all)) } else { (false, plain) }
    }

    /// Least squares from the normal equations, right side last; 0 for unknowns that follow from the others.
    fn solve(mut normal: [[f64; TAPS + 1]; TAPS]) -> [f64; TAPS] {
        let mut used = [true; TAPS];
        normal.iter_mut().enumerate().for_each(|(pivot, row)| row[pivot] *= 1.0 + 1e-6);
        let whole: [f64; TAPS] = std::array::from_fn(|i| normal[i][i]);
        for pivot in 0..TAPS {
            if !(normal[pivot][pivot] > 1e-5 * whole[pivot] && normal[pivot][pivot].is_normal()) {
                used[pivot] = false;
                continue;
            }
            for row in pivot + 1..TAPS {
                let factor = normal[row][pivot] / normal[pivot][pivot];
                let from = normal[pivot];
                normal[row].iter_mut().zip(from).for_each(|(x, y)| *x -= factor * y);
            }
        }
        let mut weights = [0.0; TAPS];
        for pivot in (0..TAPS).rev().filter(|&pivot| used[pivot]) {
            let known: f64 = (pivot + 1..TAPS).map(|i| normal[pivot][i] * weights[i]).sum();
            weights[pivot] = (normal[pivot][TAPS] - known) / normal[pivot][pivot];
        }
        weights
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::codec::range::{Decoder, Encoder};
    use proptest::prelude::*;

    fn round_trip(decoded: Decoded, bits: &[u64]) -> usize {
        let mut walk = Walk::default();
        let mut forms = walk.forms(decoded, bits);
        let mut encoder = Encoder::new(&probabilities());
        walk.code(&mut encoder, decoded, &mut forms, &mut bits.to_vec()).unwrap();
        let bytes = encoder.finish();
        let mut back = vec![0; bits.len()];
        let mut decoder = Decoder::new(&probabilities(), &bytes);
        walk.code(&mut decoder, decoded, &mut vec![Form::default(); forms.len()], &mut back).unwrap();
        assert_eq!(decoder.unread(), 0);
        assert!(back == bits);
        bytes.len()
    }

    #[test]
    fn numbers_keep_their_order() {
        let ordered = [f64::NEG_INFINITY, -1.5, -1e-310, -0.0, 0.0, 1e-310, 1.0, f64::MAX, f64::INFINITY];
        for zeros in [0, 29, 52] {
            let mapped: Vec<u64> = ordered.iter().map(|x| map(x.to_bits() >> zeros, 64 - zeros)).collect();
            assert!(mapped.is_sorted());
            ordered.iter().zip(&mapped).for_each(|(x, m)| assert_eq!(unmap(*m, 64 - zeros), x.to_bits() >> zeros));
        }
    }

    proptest! {
        #[test]
        fn any_bits_survive(
            bits in prop::collection::vec(prop_oneof![any::<u64>(), (0u64..4).prop_map(|x| (x as f64).to_bits()),
                any::<f32>().prop_map(|x| f64::from(x.abs()).to_bits())], 2 * 24),
            log in prop::collection::vec(prop_oneof![-90f32..800.0, Just(f32::NEG_INFINITY)], 2 * 24),
            scale in 1e-3f64..10.0,
            missing in any::<u64>(),
        ) {
            let valid: Vec<bool> =
                bits.iter().map(|&b| f64::from_bits(b)).map(|x| x.is_finite() && x >= 0.0).collect();
            let (scales, missing) = ([scale, 1.0], [missing, (-1f64).to_bits()]);
            let shape = [2, 3, 1, 4];
            round_trip(Decoded { shape, valid: &valid, log: &log, eps: 1e-3, scales: &scales, missing: &missing }, &bits);
        }
    }

    /// Of numbers with few bits in 1/sr only these are coded, whatever the scale does to them.
    #[test]
    fn scaled_short_numbers_are_short() {
        let n = 10 * 10 * 20;
        let (scale, eps) = (1.15 / 1500.0, 1e-3);
        let mut random = crate::codec::sample::SplitMix64(1);
        let log: Vec<f32> = (0..n).map(|i| (i as f32 * 0.001).sin()).collect();
        let exact = log.iter().map(|&l| f64::from(l) + (random.next_u64() % 1000) as f64 * 1e-5);
        let bits: Vec<u64> =
            exact.map(|l| (f64::from_bits((l.exp().to_bits() >> 41) << 41) / scale).to_bits()).collect();
        let decoded =
            Decoded { shape: [1, 10, 10, 20], valid: &vec![true; n], log: &log, eps, scales: &[scale], missing: &[0] };
        assert!(round_trip(decoded, &bits) < n);
    }
}
