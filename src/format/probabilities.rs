//! The section PROB (spec section 3.5): where the contexts of the range coder start.

use std::sync::OnceLock;

use crate::base::bits::ByteReader;
use crate::base::error::Result;
use crate::base::portable::exp64;
use crate::codec::contexts::NUMBER_BITS;
use crate::codec::entropy::code_number;
use crate::codec::range::{Coder, Decoder};
use crate::format::directory::PROBABILITIES;
use crate::format::{is_compact, is_dependent};

/// Contexts of the coder within the section: whether a probability follows, by whether the two before did; then those of
/// the differences between codes.
const UNARY: usize = 4;
const MANTISSA: usize = UNARY + NUMBER_BITS;
const CONTEXTS: usize = MANTISSA + NUMBER_BITS;

/// Codes of probabilities of a one: 32768 * 2^(-c / 12) in 1/65536 for c below 128, and the rest to 1 for c - 128.
pub(crate) fn decode_probability(code: u8) -> u16 {
    const TWELFTH: f64 = std::f64::consts::LN_2 / 12.0;
    let small = (32768.0 * exp64(-f64::from(code & 127) * TWELFTH) + 0.5) as u16;
    if code < 128 { small } else { (65536 - u32::from(small)) as u16 }
}

/// Those of all codes, computed once: opening a file asks for hundreds.
fn decode_probabilities() -> &'static [u16; 256] {
    static DECODED: OnceLock<[u16; 256]> = OnceLock::new();
    DECODED.get_or_init(|| std::array::from_fn(|code| decode_probability(code as u8)))
}

/// The codes in the order of what they stand for: -127 is the smallest probability, 0 one half.
fn rank(code: u8) -> i32 {
    if code < 128 { -i32::from(code) } else { i32::from(code) - 128 }
}

fn code_of(rank: i32) -> Option<u8> {
    let code = if rank <= 0 { -rank } else { rank + 128 };
    (rank.abs() < 128).then_some(code as u8)
}

/// Codes the section's entries; a decoder finds them empty and leaves them filled. `None` if a rank is out of range.
fn code_entries<C: Coder>(coder: &mut C, codes: &mut [Option<u8>]) -> Option<()> {
    let (mut before, mut last) = (0, 0);
    for code in codes {
        let stored = coder.bit(before, code.is_some());
        before = before << 1 & 2 | usize::from(stored);
        if !stored {
            continue;
        }
        let change = code.map_or(0, rank) - last;
        let size = code_number(coder, UNARY, MANTISSA, change.unsigned_abs()).ok()? as i32;
        let negative = size > 0 && coder.raw(u32::from(change < 0), 1) == 1;
        last += if negative { -size } else { size };
        *code = Some(code_of(last)?);
    }
    Some(())
}

/// Probabilities of a one in each context, decoded at first use: opening does not wait for what only records need.
pub(crate) struct Probabilities {
    coded: Vec<u8>,
    /// Offset of the section within the file.
    offset: u64,
    contexts: usize,
    draft: u16,
    decoded: OnceLock<Vec<u16>>,
}

impl Probabilities {
    /// Those that a section holds.
    pub(crate) fn of_section(r: ByteReader, contexts: usize, draft: u16) -> Probabilities {
        let offset = r.offset();
        Probabilities { coded: r.rest().to_vec(), offset, contexts, draft, decoded: OnceLock::new() }
    }

    /// Fails if what the section holds is out of range: its checksum was right.
    pub(crate) fn get(&self) -> Result<&[u16]> {
        if let Some(decoded) = self.decoded.get() {
            return Ok(decoded);
        }
        let section = ByteReader::new(&self.coded, self.offset, PROBABILITIES);
        let decoded = read_probabilities(section, self.contexts, self.draft)?;
        Ok(self.decoded.get_or_init(|| decoded))
    }
}

impl From<Vec<u16>> for Probabilities {
    fn from(probabilities: Vec<u16>) -> Probabilities {
        let (contexts, decoded) = (probabilities.len(), OnceLock::from(probabilities));
        Probabilities { coded: Vec::new(), offset: 0, contexts, draft: 0, decoded }
    }
}

fn read_probabilities(mut r: ByteReader, contexts: usize, draft: u16) -> Result<Vec<u16>> {
    // Number of contexts, fixed by the entropy coder.
    let count = usize::from(r.u16()?);
    if count != contexts {
        return Err(r.corrupt(format!("{count} contexts, the entropy coder has {contexts}")));
    }
    if is_dependent(draft) {
        // Output of the range coder.
        let place = r.clone();
        let coded = r.bytes(r.left())?;
        let mut decoder = Decoder::new(&[1 << 15; CONTEXTS], coded);
        let mut codes = vec![None; contexts];
        if code_entries(&mut decoder, &mut codes).is_none() {
            return Err(place.corrupt("a probability is out of range"));
        }
        if decoder.unread() > 0 {
            return Err(place.corrupt("bytes are left over at its end"));
        }
        let decoded = decode_probabilities();
        return Ok(codes.into_iter().map(|code| code.map_or(1 << 15, |code| decoded[usize::from(code)])).collect());
    }
    // One bit a context, low bit first: whether its probability follows; the others start at one half.
    let used = r.bytes(contexts.div_ceil(8))?;
    let mut probabilities = vec![1 << 15; contexts];
    for (i, probability) in probabilities.iter_mut().enumerate() {
        if used[i / 8] >> (i % 8) & 1 == 0 {
            continue;
        }
        // Code of the probability of a one; before draft 3 the probability in 1/65536, 1 and up.
        *probability = if is_compact(draft) { decode_probability(r.u8()?) } else { r.u16()? };
        if *probability == 0 {
            return Err(r.corrupt(format!("probability of context {i} is zero")));
        }
    }
    if (contexts..8 * used.len()).any(|i| used[i / 8] >> (i % 8) & 1 == 1) {
        return Err(r.corrupt("bits beyond the last context are set"));
    }
    r.finish()?;
    Ok(probabilities)
}

#[cfg(feature = "encode")]
pub(crate) use write::*;

#[cfg(feature = "encode")]
mod write {
    use super::{CONTEXTS, code_entries};
    use crate::base::bits::ByteWriter;
    use crate::codec::range::Encoder;

    /// Code of a probability, the nearest on a logarithmic scale.
    pub(crate) fn encode_probability(probability: f64) -> u8 {
        let code = |p: f64| (-12.0 * (2.0 * p).log2()).round().clamp(0.0, 127.0) as u8;
        let (small, side) = if probability <= 0.5 { (probability, 0) } else { (1.0 - probability, 128) };
        // One half has one code only.
        if code(small) == 0 { 0 } else { side + code(small) }
    }

    pub(crate) fn write_probabilities(codes: &[Option<u8>]) -> Vec<u8> {
        let mut w = ByteWriter::default();
        w.u16(codes.len() as u16);
        let mut encoder = Encoder::new(&[1 << 15; CONTEXTS]);
        let coded = code_entries(&mut encoder, &mut codes.to_vec());
        debug_assert!(coded.is_some(), "every code has a rank");
        w.bytes(&encoder.finish());
        w.0
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn reader(bytes: &[u8]) -> ByteReader<'_> {
        ByteReader::new(bytes, 0, "TEST")
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(codes in prop::collection::vec(prop::option::of(0u8..), 0..300)) {
            // The second code of one half is never written.
            let codes: Vec<Option<u8>> = codes.into_iter().map(|code| code.filter(|&code| code != 128)).collect();
            let bytes = write_probabilities(&codes);
            let expected: Vec<u16> = codes.iter().map(|code| code.map_or(1 << 15, decode_probability)).collect();
            prop_assert_eq!(read_probabilities(reader(&bytes), codes.len(), 4).unwrap(), expected);
            prop_assert!(read_probabilities(reader(&bytes), codes.len() + 1, 4).is_err());
            // More than all decisions could take.
            let longer = [&bytes[..], &[1; 4000]].concat();
            prop_assert!(read_probabilities(reader(&longer), codes.len(), 4).is_err());
        }

        #[test]
        fn arbitrary_bytes_end(bytes in prop::collection::vec(any::<u8>(), 0..100), draft in 1u16..5) {
            let bytes = [&[40, 0], &bytes[..]].concat();
            if let Ok(probabilities) = read_probabilities(reader(&bytes), 40, draft) {
                prop_assert!(probabilities.iter().all(|&p| p > 0));
            }
        }
    }

    /// Codes of spec section 3.5; the values were computed with Python's `round(32768 * 2 ** (-c / 12))`.
    #[test]
    fn probabilities_have_codes() {
        let expected =
            [(0, 32768), (1, 30929), (12, 16384), (100, 102), (127, 21), (128, 32768), (129, 34607), (255, 65515)];
        for (code, probability) in expected {
            assert_eq!(decode_probability(code), probability, "{code}");
        }
        for code in 1..=255u8 {
            let back = encode_probability(f64::from(decode_probability(code)) / 65536.0);
            assert!(decode_probability(back).abs_diff(decode_probability(code)) <= 1, "{code} {back}");
        }
    }

    /// The section byte for byte; what the bytes say was read by the `RangeDecoder` of spec/decode.py.
    #[test]
    fn bytes_are_those_of_the_specification() {
        let codes = [None, Some(12), Some(129), None, Some(0), Some(127), Some(255), None];
        let hex: String = write_probabilities(&codes).iter().map(|b| format!("{b:02x}")).collect();
        assert_eq!(hex, "080082a7fdb3e1739d10");
    }

    /// Bytes of drafts that have the list of codes, and the list of probabilities before it.
    #[test]
    fn older_drafts_are_read() {
        let bytes = [3, 0, 5, 12, 129];
        assert_eq!(read_probabilities(reader(&bytes), 3, 3).unwrap(), [16384, 1 << 15, 34607]);
        assert!(read_probabilities(reader(&[3, 0, 13, 12, 129]), 3, 3).is_err());
        assert_eq!(read_probabilities(reader(&[3, 0, 5, 7, 0, 1, 2]), 3, 2).unwrap(), [7, 1 << 15, 513]);
        assert!(read_probabilities(reader(&[1, 0, 1, 0, 0]), 1, 1).is_err());
    }
}
