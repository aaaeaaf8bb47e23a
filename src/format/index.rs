//! The index section INDX (spec section 3.6): where each record is, its errors, and the blocks' means.

use std::ops::Range;

use crate::base::bits::{ByteReader, read_int, read_uint};
use crate::base::budget::with_room;
use crate::base::error::{Error, Result};
use crate::codec::entropy::{MAX_MAGNITUDE, code_low_bits};
use crate::codec::range::{Coder, Decoder};
use crate::base::limits::MAX_MEANS;
use crate::format::directory::Section;
use crate::table::block::Partition;

/// Bytes of a code for an error.
const ERROR_CODE: usize = 1;

/// The index of a file: a few bytes a block, all that opening reads of the blocks.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Index {
    /// Offset of each record within the file, then the end of the last.
    offsets: Vec<usize>,
    rms: Vec<u8>,
    max: Vec<u8>,
    /// Quantised first coefficients, `[block][component]`.
    means: Vec<i32>,
    components: usize,
}

/// What the index says of one block.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Entry {
    /// Bytes of the record.
    pub(crate) length: u32,
    /// Codes of the rms error and of the largest error.
    pub(crate) errors: [u8; 2],
    /// Quantised first coefficients, one a component.
    pub(crate) means: Vec<i32>,
}

/// Bits of a number at most.
const NUMBER_BITS: usize = 32;
/// Contexts of a number: bits in unary, then the bit after the leading one.
const NUMBER: usize = 2 * NUMBER_BITS + 1;
/// Sets of contexts for a record's length, by that of the length before; for each code of an error; for means, by the
/// component and the residual before.
const LENGTHS: usize = 4;
const ERRORS: usize = 2;
const MEANS: usize = 9;
/// Number of contexts of the index.
const CONTEXTS: usize = (LENGTHS + ERRORS + MEANS) * NUMBER;

/// Codes the entries of the blocks in order, each with the ones before in view (spec section 3.6).
#[derive(Clone)]
struct Chain {
    components: usize,
    previous: Entry,
    positions: usize,
    /// Bits of the residuals of the means before, by component.
    residuals: Vec<u32>,
}

fn bit_length(value: u32) -> u32 {
    u32::BITS - value.leading_zeros()
}

/// Small magnitudes of either sign to small numbers: 0, -1, 1, -2, ...
fn zigzag(value: i32) -> u32 {
    ((value << 1) ^ (value >> 31)) as u32
}

fn unzigzag(value: u32) -> i32 {
    (value >> 1) as i32 ^ -((value & 1) as i32)
}

/// The nearest integer, half away from zero, saturating: where the processor has no instruction for it, a call costs more than
/// the rest of a mean.
#[inline(always)]
fn round(x: f64) -> i32 {
    let whole = x as i32;
    let rest = x - f64::from(whole);
    whole.saturating_add(i32::from(rest >= 0.5)).saturating_sub(i32::from(rest <= -0.5))
}

/// A number: its count of bits in unary, then what [`code_low_bits`] codes.
fn code_number<C: Coder>(coder: &mut C, contexts: usize, value: u32) -> u32 {
    let bits = coder.unary(contexts, NUMBER_BITS as u32, bit_length(value));
    code_low_bits(coder, contexts + NUMBER_BITS, bits, value)
}

impl Chain {
    fn new(components: usize) -> Chain {
        let previous = Entry { length: 0, errors: [0; 2], means: vec![0; components] };
        Chain { components, previous, positions: 1, residuals: vec![0; components] }
    }

    /// Codes the entry of the next block, of `positions` positions; a decoder overwrites what it is given.
    fn code<C: Coder>(&mut self, coder: &mut C, positions: usize, entry: &mut Entry) {
        entry.length = self.code_length(coder, entry.length);
        self.code_rest(coder, positions, entry);
    }

    /// Codes the length of the next record.
    #[inline(always)]
    fn code_length<C: Coder>(&self, coder: &mut C, length: u32) -> u32 {
        let set = (bit_length(self.previous.length).saturating_sub(3) / 2).min(LENGTHS as u32 - 1) as usize;
        code_number(coder, set * NUMBER, length)
    }

    /// Codes the rest of an entry whose length is known.
    #[inline(always)]
    fn code_rest<C: Coder>(&mut self, coder: &mut C, positions: usize, entry: &mut Entry) {
        // Code of the rms error: the change. Code of the largest error: the change of how far it is above.
        let [rms, max] = self.previous.errors;
        let change = i32::from(entry.errors[0].wrapping_sub(rms) as i8);
        let change = unzigzag(code_number(coder, LENGTHS * NUMBER, zigzag(change)));
        entry.errors[0] = rms.wrapping_add(change as u8);
        let above = max.wrapping_sub(rms);
        let change = i32::from(entry.errors[1].wrapping_sub(entry.errors[0]).wrapping_sub(above) as i8);
        let change = unzigzag(code_number(coder, (LENGTHS + 1) * NUMBER, zigzag(change)));
        entry.errors[1] = entry.errors[0].wrapping_add(above).wrapping_add(change as u8);
        // Means: the difference from that of the block before, at equal value of the table.
        let grown = if positions == self.positions { 1.0 } else { (positions as f64 / self.positions as f64).sqrt() };
        for c in 0..self.components {
            let predicted = round(f64::from(self.previous.means[c]) * grown);
            let class = c.min(2) * 3 + (self.residuals[c] / 4).min(2) as usize;
            let contexts = (LENGTHS + ERRORS + class) * NUMBER;
            let residual = code_number(coder, contexts, zigzag(entry.means[c].wrapping_sub(predicted)));
            self.residuals[c] = bit_length(residual);
            entry.means[c] = predicted.wrapping_add(unzigzag(residual));
        }
        self.positions = positions;
        self.previous.clone_from(entry);
    }
}

impl Index {
    /// An index of no block yet, with room for `blocks`, within bounds: a file may claim any number.
    fn with_room(blocks: usize, start: usize, components: usize) -> Index {
        let room = blocks.min(1 << 12);
        let (rms, max) = (Vec::with_capacity(room), Vec::with_capacity(room));
        let mut offsets = Vec::with_capacity(room + 1);
        offsets.push(start);
        Index { offsets, rms, max, means: Vec::with_capacity(room * components.min(16)), components }
    }

    /// An index of no block yet, with room for `blocks`: they were compared with the bytes of their records.
    fn with_all_room(blocks: usize, start: usize, components: usize) -> Result<Index> {
        let mut offsets = with_room(blocks + 1)?;
        offsets.push(start);
        let (rms, max, means) = (with_room(blocks)?, with_room(blocks)?, with_room(blocks * components)?);
        Ok(Index { offsets, rms, max, means, components })
    }

    /// The index of drafts from 3 on.
    pub(crate) fn read(
        mut r: ByteReader,
        partition: &Partition,
        components: usize,
        records: &Section,
    ) -> Result<Index> {
        let blocks = partition.block_count();
        let base = r.offset();
        // Number of blocks, the partition's.
        let count = r.u32()? as usize;
        if count != blocks {
            return Err(r.corrupt(format!("index of {count} blocks, the partition has {blocks}")));
        }
        // The entries, range coded, to the end of the section.
        let coded = r.rest();
        let corrupt = |what: String| Err(Error::corrupt("INDX", base, what));
        // What range coded bytes stand for is not bounded by their number.
        if blocks > records.range.len() || blocks.saturating_mul(components) > MAX_MEANS {
            let bytes = records.range.len();
            return corrupt(format!("{blocks} blocks of {components} components, with records of {bytes} bytes"));
        }
        let mut decoder = Decoder::new(&[1 << 15; CONTEXTS], coded);
        let mut chain = Chain::new(components);
        let mut entry = chain.previous.clone();
        let mut end = records.range.start;
        let mut index = Index::with_all_room(blocks, end, components)?;
        for (number, positions) in partition.sizes().enumerate() {
            chain.code(&mut decoder, positions, &mut entry);
            end = end.saturating_add(entry.length as usize);
            if end > records.range.end {
                return corrupt(format!("record {number} ends beyond its section"));
            }
            if let Some(mean) = entry.means.iter().find(|m| m.unsigned_abs() > MAX_MAGNITUDE) {
                return corrupt(format!("mean {mean} is beyond {MAX_MAGNITUDE}"));
            }
            index.offsets.push(end);
            index.rms.push(entry.errors[0]);
            index.max.push(entry.errors[1]);
            index.means.extend_from_slice(&entry.means);
        }
        if end != records.range.end {
            return corrupt(format!("records end at {end}, their section at {}", records.range.end));
        }
        if decoder.unread() > 0 {
            return corrupt("bytes are left over after the last entry".into());
        }
        Ok(index)
    }

    /// The index of records that begin at an offset of the file.
    pub(crate) fn of(entries: &[Entry], start: usize, components: usize) -> Index {
        let mut index = Index::with_room(entries.len(), start, components);
        let mut end = start;
        for entry in entries {
            end += entry.length as usize;
            index.offsets.push(end);
            index.rms.push(entry.errors[0]);
            index.max.push(entry.errors[1]);
            index.means.extend_from_slice(&entry.means);
        }
        index
    }

    /// What it says of one block.
    pub(crate) fn entry(&self, block: usize) -> Entry {
        let means = self.means(block).to_vec();
        Entry { length: self.record(block).len() as u32, errors: [self.rms[block], self.max[block]], means }
    }

    /// The index of drafts 1 and 2.
    pub(crate) fn read_plain(mut r: ByteReader, blocks: usize, components: usize, records: &Section) -> Result<Index> {
        // Number of blocks, the partition's.
        let count = r.u32()? as usize;
        if count != blocks {
            return Err(r.corrupt(format!("index of {count} blocks, the partition has {blocks}")));
        }
        // Bytes a record length, bytes a mean, two reserved bytes.
        let widths = [r.u8()?, r.u8()?].map(usize::from);
        if widths.iter().any(|w| !(1..=4).contains(w)) {
            return Err(r.corrupt(format!("field widths {widths:?}, allowed are 1 to 4")));
        }
        let reserved = r.u16()?;
        if reserved != 0 {
            return Err(r.corrupt(format!("reserved field holds {reserved}, not 0")));
        }
        // Record lengths; the records fill their section.
        let base = r.offset();
        let mut offsets = Vec::with_capacity(blocks.min(1 << 16) + 1);
        let mut end = records.range.start;
        offsets.push(end);
        for length in r.bytes(blocks * widths[0])?.chunks_exact(widths[0]) {
            // At most 2^24 blocks of 2^32 bytes: no overflow of 64 bits, checked for narrower machines.
            end = end.saturating_add(read_uint(length, widths[0]) as usize);
            if end > records.range.end {
                let what = format!("record {} ends beyond its section", offsets.len() - 1);
                return Err(Error::corrupt("INDX", base, what));
            }
            offsets.push(end);
        }
        if end != records.range.end {
            let what = format!("records end at {end}, their section at {}", records.range.end);
            return Err(Error::corrupt("INDX", base, what));
        }
        // Codes of each block's rms error and largest error.
        let rms = r.bytes(blocks * ERROR_CODE)?.to_vec();
        let max = r.bytes(blocks * ERROR_CODE)?.to_vec();
        // Quantised means, block after block.
        let bytes = r.bytes(blocks.saturating_mul(components).saturating_mul(widths[1]))?;
        let means: Vec<i32> = bytes.chunks_exact(widths[1]).map(|b| read_int(b, widths[1])).collect();
        if let Some(mean) = means.iter().find(|m| m.unsigned_abs() > MAX_MAGNITUDE) {
            return Err(r.corrupt(format!("mean {mean} is beyond {MAX_MAGNITUDE}")));
        }
        r.finish()?;
        Ok(Index { offsets, rms, max, means, components })
    }

    /// Bytes of a block's record within the file.
    pub(crate) fn record(&self, block: usize) -> Range<usize> {
        self.offsets[block]..self.offsets[block + 1]
    }

    /// Bounds on a block's rms and largest error, log domain.
    pub(crate) fn errors(&self, block: usize) -> (f32, f32) {
        (decode_error(self.rms[block]), decode_error(self.max[block]))
    }

    /// The codes of these.
    pub(crate) fn error_codes(&self, block: usize) -> [u8; 2] {
        [self.rms[block], self.max[block]]
    }

    /// Quantised first coefficients of a block, one a component.
    pub(crate) fn means(&self, block: usize) -> &[i32] {
        &self.means[block * self.components..(block + 1) * self.components]
    }
}

/// Reads the entries of a section from draft 3 on, one after the other, whatever its bytes are.
pub(crate) struct EntryReader<'a> {
    decoder: Decoder<'a>,
    chain: Chain,
    entry: Entry,
    /// Bits that the length of the last entry took in the stream.
    length_bits: u32,
}

/// Bytes of a section from draft 3 on before the coded ones: the number of blocks.
pub(crate) const COUNT: usize = 4;

impl<'a> EntryReader<'a> {
    /// Before the first entry; `None` if the section ends before its coded bytes.
    pub(crate) fn new(section: &'a [u8], components: usize) -> Option<EntryReader<'a>> {
        let decoder = Decoder::new(&[1 << 15; CONTEXTS], section.get(COUNT..)?);
        let chain = Chain::new(components);
        Some(EntryReader { decoder, entry: chain.previous.clone(), chain, length_bits: 0 })
    }

    /// The same reader over a section that agrees with its own as far as it has read.
    pub(crate) fn over<'b>(&self, section: &'b [u8]) -> EntryReader<'b> {
        let decoder = self.decoder.over(section.get(COUNT..).unwrap_or_default());
        EntryReader { decoder, chain: self.chain.clone(), entry: self.entry.clone(), length_bits: self.length_bits }
    }

    /// The entry of the next block, which has this number of positions; `None` if a mean is out of range.
    pub(crate) fn next(&mut self, positions: usize) -> Option<&Entry> {
        let before = self.decoder.information();
        self.entry.length = self.chain.code_length(&mut self.decoder, 0);
        self.length_bits = (self.decoder.information() - before) as u32;
        self.chain.code_rest(&mut self.decoder, positions, &mut self.entry);
        let sound = self.entry.means.iter().all(|m| m.unsigned_abs() <= MAX_MAGNITUDE);
        sound.then_some(&self.entry)
    }

    /// Where in the section the coder leaves its plain start: while every context is new all decisions are even, the range is a power of
    /// two, and what is coded stands there bit by bit. Bits of a mean can change there without a trace in what is behind.
    pub(crate) fn plain_end(&self, sizes: &[u32]) -> usize {
        let mut reader = self.over_own();
        for &size in sizes {
            if reader.next(size as usize).is_none() || !reader.decoder.is_plain() {
                break;
            }
        }
        reader.position()
    }

    fn over_own(&self) -> EntryReader<'a> {
        EntryReader {
            decoder: self.decoder.clone(),
            chain: self.chain.clone(),
            entry: self.entry.clone(),
            length_bits: self.length_bits,
        }
    }

    /// Bits that the length of the last entry took, rounded down: a stream that is arbitrary has it with a probability of 2^-bits.
    pub(crate) fn length_bits(&self) -> u32 {
        self.length_bits
    }

    /// Bytes of the section that were read so far: those of the next entry, some of them, among them.
    pub(crate) fn position(&self) -> usize {
        COUNT + self.decoder.position()
    }

    /// Bytes of the section that are left over.
    pub(crate) fn unread(&self) -> usize {
        self.decoder.unread()
    }
}

/// Code of an error that is not known, or too large for the others.
pub(crate) const UNKNOWN_ERROR: u8 = 255;
/// Codes of both errors of a block that was pruned.
#[cfg(feature = "encode")]
pub(crate) const PRUNED: [u8; 2] = [UNKNOWN_ERROR; 2];
/// Codes of both errors of a block whose record is a pruned one because damage took its own.
pub(crate) const LOST: [u8; 2] = [UNKNOWN_ERROR - 1, UNKNOWN_ERROR];

/// `2^(i / 8)` rounded to single precision.
const EIGHTHS: [f32; 8] =
    [1.0, 1.090_507_7, 1.189_207_1, 1.296_839_6, std::f32::consts::SQRT_2, 1.542_210_8, 1.681_792_9, 1.834_008];

/// An error from its code: 0 is none, c is `2^((c - 192) / 8)`, 255 is unknown or more.
pub(crate) fn decode_error(code: u8) -> f32 {
    match code {
        0 => 0.0,
        UNKNOWN_ERROR => f32::INFINITY,
        c => EIGHTHS[usize::from(c % 8)] * f32::from_bits((u32::from(c / 8) + 127 - 24) << 23),
    }
}

#[cfg(feature = "encode")]
pub(crate) use write::{encode_error, write_index};

#[cfg(feature = "encode")]
mod write {
    use super::{CONTEXTS, Chain, Entry, decode_error};
    use crate::base::bits::ByteWriter;
    use crate::codec::range::Encoder;
    use crate::table::block::Partition;

    /// Code of the smallest representable bound that is not below `error`.
    pub(crate) fn encode_error(error: f64) -> u8 {
        if error == 0.0 {
            return 0;
        }
        (1..255).find(|&c| f64::from(decode_error(c)) >= error).unwrap_or(255)
    }

    /// The section from the entries of all blocks.
    pub(crate) fn write_index(partition: &Partition, entries: &[Entry]) -> Vec<u8> {
        let mut w = ByteWriter::default();
        w.u32(entries.len() as u32);
        let mut encoder = Encoder::new(&[1 << 15; CONTEXTS]);
        let mut chain = Chain::new(entries.first().map_or(0, |entry| entry.means.len()));
        for (positions, entry) in partition.sizes().zip(entries) {
            chain.code(&mut encoder, positions, &mut entry.clone());
        }
        w.bytes(&encoder.finish());
        w.0
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    fn section(range: Range<usize>) -> Section {
        Section { id: *b"RECS", skippable: false, range, crc: 0 }
    }

    fn partition(blocks: usize) -> Partition {
        Partition::uniform([1, 1, 1, 4 * blocks], [1, 1, 1, 4]).unwrap()
    }

    fn entry(length: u32, errors: [u8; 2], means: &[i32]) -> Entry {
        Entry { length, errors, means: means.to_vec() }
    }

    /// Spec section 3.6 byte for byte. One block with a record of one byte, no errors and a mean of zero: a one and four
    /// zeros at even odds each; a one takes the lower half of the range, so the code is .01111 in binary.
    #[test]
    fn bytes_are_those_of_the_specification() {
        assert_eq!(write_index(&partition(1), &[entry(1, [0, 0], &[0])]), [1, 0, 0, 0, 0b0111_1000]);
    }

    #[test]
    fn round_trip_and_contradictions() {
        let entries =
            [entry(300, [1, 2], &[-40000, 1]), entry(0, [3, 4], &[2, 3]), entry(7, [255, 0], &[4, -(1 << 24)])];
        let bytes = write_index(&partition(3), &entries);
        let read = |bytes: &[u8], blocks, end| {
            Index::read(ByteReader::new(bytes, 50, "INDX"), &partition(blocks), 2, &section(1000..end))
        };
        let index = read(&bytes, 3, 1307).unwrap();
        assert_eq!(index.record(2), 1300..1307);
        assert_eq!(index.means(0), [-40000, 1]);
        assert_eq!(index.means(2), [4, -(1 << 24)]);
        assert_eq!(index.errors(2), (f32::INFINITY, 0.0));
        assert!(read(&bytes, 4, 1307).is_err());
        assert!(read(&bytes, 3, 1306).is_err());
        assert!(read(&bytes, 3, 1308).is_err());
        for cut in 0..bytes.len() {
            // Missing bytes are read as zeros, so the last entries may change; the section's checksum shows it.
            assert!(read(&bytes[..cut], 3, 1307).ok() != Some(index.clone()), "{cut}");
        }
        assert!(read(&[&bytes[..], &[0; 8]].concat(), 3, 1307).is_err());
    }

    #[test]
    fn numbers_of_every_size_round_trip() {
        use crate::codec::range::Encoder;
        let numbers: Vec<u32> =
            (0..32).flat_map(|b| [1u32 << b, (1u32 << b) - 1, 3 << b >> 1]).chain([u32::MAX]).collect();
        let mut encoder = Encoder::new(&[1 << 15; NUMBER]);
        for &number in &numbers {
            assert_eq!(code_number(&mut encoder, 0, number), number);
        }
        let bytes = encoder.finish();
        let mut decoder = Decoder::new(&[1 << 15; NUMBER], &bytes);
        for &number in &numbers {
            assert_eq!(code_number(&mut decoder, 0, 0), number);
        }
        for value in [0, 1, -1, i32::MAX, i32::MIN] {
            assert_eq!(unzigzag(zigzag(value)), value);
        }
    }

    /// The index of drafts 1 and 2, byte for byte.
    #[test]
    fn plain_indexes_are_read() {
        let header = [2, 0, 0, 0, 2, 2, 0, 0];
        let bytes = [&header[..], &[44, 1, 7, 0], &[1, 3], &[2, 4], &[0x70, 0xFE, 5, 0]].concat();
        let read = |bytes: &[u8]| Index::read_plain(ByteReader::new(bytes, 50, "INDX"), 2, 1, &section(1000..1307));
        let index = read(&bytes).unwrap();
        assert_eq!((index.record(1), index.means(0), index.means(1)), (1300..1307, &[-400][..], &[5][..]));
        for cut in 0..bytes.len() {
            assert!(read(&bytes[..cut]).is_err());
        }
        for (at, value) in [(4, 0), (4, 5), (5, 9), (6, 1)] {
            let mut bad = bytes.clone();
            bad[at] = value;
            assert!(read(&bad).is_err());
        }
    }

    #[test]
    fn error_codes_are_upper_bounds() {
        assert_eq!(encode_error(0.0), 0);
        assert_eq!(encode_error(1e9), 255);
        assert_eq!(encode_error(f64::NAN), 255);
        for i in 0..1000 {
            let error = 1e-6 * 1.015f64.powi(i);
            let bound = f64::from(decode_error(encode_error(error)));
            assert!(bound >= error, "{error} {bound}");
            if error > 1e-7 && error < 200.0 {
                assert!(bound <= error * 1.1, "{error} {bound}");
            }
        }
    }
}
