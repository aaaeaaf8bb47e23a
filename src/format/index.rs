//! The index section INDX (spec section 3.6): where each record is, its errors, and the blocks' means.

use std::ops::Range;

use crate::bits::{ByteReader, read_int, read_uint};
use crate::entropy::MAX_MAGNITUDE;
use crate::error::{Error, Result};
use crate::format::directory::Section;

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

impl Index {
    pub(crate) fn read(mut r: ByteReader, blocks: usize, components: usize, records: &Section) -> Result<Index> {
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

    /// Quantised first coefficients of a block, one a component.
    pub(crate) fn means(&self, block: usize) -> &[i32] {
        &self.means[block * self.components..(block + 1) * self.components]
    }
}

/// `2^(i / 8)` rounded to single precision.
const EIGHTHS: [f32; 8] =
    [1.0, 1.090_507_7, 1.189_207_1, 1.296_839_6, std::f32::consts::SQRT_2, 1.542_210_8, 1.681_792_9, 1.834_008];

/// An error from its code: 0 is none, c is `2^((c - 192) / 8)`, 255 is unknown or more.
pub(crate) fn decode_error(code: u8) -> f32 {
    match code {
        0 => 0.0,
        255 => f32::INFINITY,
        c => EIGHTHS[usize::from(c % 8)] * f32::from_bits((u32::from(c / 8) + 127 - 24) << 23),
    }
}

#[cfg(feature = "encode")]
pub(crate) use write::{encode_error, write_index};

#[cfg(feature = "encode")]
mod write {
    use super::decode_error;
    use crate::bits::{ByteWriter, int_width, uint_width};

    /// Code of the smallest representable bound that is not below `error`.
    pub(crate) fn encode_error(error: f64) -> u8 {
        if error == 0.0 {
            return 0;
        }
        (1..255).find(|&c| f64::from(decode_error(c)) >= error).unwrap_or(255)
    }

    /// The section from record lengths, error codes and means, `[block][component]`.
    pub(crate) fn write_index(lengths: &[u32], errors: &[(u8, u8)], means: &[i32]) -> Vec<u8> {
        let length_width = lengths.iter().map(|&n| uint_width(n)).max().unwrap_or(1);
        let mean_width = means.iter().map(|&m| int_width(m)).max().unwrap_or(1);
        let mut w = ByteWriter::default();
        w.u32(lengths.len() as u32);
        w.u8(length_width as u8);
        w.u8(mean_width as u8);
        w.u16(0);
        lengths.iter().for_each(|&n| w.uint(n, length_width));
        errors.iter().for_each(|e| w.u8(e.0));
        errors.iter().for_each(|e| w.u8(e.1));
        means.iter().for_each(|&m| w.int(m, mean_width));
        w.0
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    fn section(range: Range<usize>) -> Section {
        Section { id: *b"RECS", skippable: false, range, crc: 0 }
    }

    /// Spec section 3.6 byte for byte.
    #[test]
    fn bytes_are_those_of_the_specification() {
        let bytes = write_index(&[300, 7], &[(1, 2), (3, 4)], &[-400, 5]);
        let header = [2, 0, 0, 0, 2, 2, 0, 0];
        assert_eq!(bytes, [&header[..], &[44, 1, 7, 0], &[1, 3], &[2, 4], &[0x70, 0xFE, 5, 0]].concat());
    }

    #[test]
    fn round_trip_and_contradictions() {
        let bytes = write_index(&[300, 0, 7], &[(1, 2), (3, 4), (255, 0)], &[-40000, 1, 2, 3, 4, 5]);
        let read =
            |bytes: &[u8], blocks, end| Index::read(ByteReader::new(bytes, 50, "INDX"), blocks, 2, &section(1000..end));
        let index = read(&bytes, 3, 1307).unwrap();
        assert_eq!(index.record(2), 1300..1307);
        assert_eq!(index.means(0), [-40000, 1]);
        assert_eq!(index.errors(2), (f32::INFINITY, 0.0));
        assert!(read(&bytes, 4, 1307).is_err());
        assert!(read(&bytes, 3, 1306).is_err());
        assert!(read(&bytes, 3, 1308).is_err());
        for cut in 0..bytes.len() {
            assert!(read(&bytes[..cut], 3, 1307).is_err());
        }
        for (at, value) in [(4, 0), (4, 5), (5, 9), (6, 1)] {
            let mut bad = bytes.clone();
            bad[at] = value;
            assert!(read(&bad, 3, 1307).is_err());
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
