//! The section EXCT (spec section 3.10): what restores the source's bits, block by block.

use std::ops::Range;

use crate::base::bits::{ByteReader, read_uint};
use crate::base::budget::with_room;
use crate::base::error::{Error, Result};
use crate::format::directory::{self, Section, check_crc};
use crate::format::record::checksum;

/// Bytes of a checksum.
const CRC: usize = 4;

/// Where the parts of the blocks are.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LosslessIndex {
    /// Bits of entries that are not valid, by channel.
    pub(crate) missing: Vec<u64>,
    /// Offset of each block's part within the file, then the end of the last.
    offsets: Vec<usize>,
}

impl LosslessIndex {
    /// Reads all of the section but the parts of the blocks; `data` is the file.
    pub(crate) fn read(data: &[u8], section: &Section, blocks: usize, channels: usize) -> Result<LosslessIndex> {
        // Of a file that was cut, what is there.
        let bytes = &data[section.range.start.min(data.len())..section.range.end.min(data.len())];
        let offset = section.range.start as u64;
        let mut r = ByteReader::new(bytes, offset, directory::LOSSLESS);
        // Number of blocks.
        let count = r.u32()?;
        if count as usize != blocks {
            return Err(r.corrupt(format!("{count} blocks, the partition has {blocks}")));
        }
        // Bits of entries that are not valid, a channel each.
        let missing = (0..channels).map(|_| r.u64()).collect::<Result<_>>()?;
        // Length of each block's part.
        let lengths = r.bytes(blocks.saturating_mul(4))?;
        // CRC-32 of the section up to here.
        let head = (r.offset() - offset) as usize;
        check_crc(directory::LOSSLESS, offset, r.u32()?, crc32fast::hash(&bytes[..head]))?;
        // As many as lengths were read.
        let mut offsets = with_room(blocks + 1)?;
        let mut at = r.offset();
        offsets.push(at as usize);
        for length in lengths.chunks_exact(4) {
            let length = read_uint(length, 4);
            at += u64::from(length);
            if (length as usize) < CRC || at > section.range.end as u64 {
                return Err(r.corrupt(format!("the part of block {} has {length} bytes", offsets.len() - 1)));
            }
            offsets.push(at as usize);
        }
        if at != section.range.end as u64 {
            return Err(r.corrupt(format!("the blocks' parts end at {at}, the section at {}", section.range.end)));
        }
        Ok(LosslessIndex { missing, offsets })
    }

    /// Bytes of a block's part within the file.
    pub(crate) fn part(&self, block: usize) -> Range<usize> {
        self.offsets[block]..self.offsets[block + 1]
    }

    /// Whether a block's part stands for one that was lost before the file was repaired: no bytes, and the complement of their checksum.
    pub(crate) fn is_lost(&self, data: &[u8], block: usize) -> bool {
        data.get(self.part(block)).is_some_and(|part| part == lost_part(block as u32))
    }

    /// Output of the range coder for a block, its checksum verified.
    pub(crate) fn coded<'a>(&self, data: &'a [u8], block: usize) -> Result<&'a [u8]> {
        let part = self.part(block);
        if self.is_lost(data, block) {
            return Err(self.corrupt(block, "its source values were lost before the file was repaired"));
        }
        let Some((coded, crc)) = data.get(part.clone()).and_then(<[u8]>::split_last_chunk::<CRC>) else {
            return Err(self.corrupt(block, "the file ends before it does"));
        };
        let (place, crc) = (part.start as u64, u32::from_le_bytes(*crc));
        check_crc(directory::LOSSLESS, place, crc, checksum(block as u32, coded))?;
        Ok(coded)
    }

    /// An error in a block's part.
    pub(crate) fn corrupt(&self, block: usize, what: &str) -> Error {
        Error::corrupt(directory::LOSSLESS, self.part(block).start as u64, format!("block {block}: {what}"))
    }
}

/// The part of a block whose source values are lost.
pub(crate) fn lost_part(block: u32) -> [u8; CRC] {
    (!checksum(block, &[])).to_le_bytes()
}

#[cfg(feature = "encode")]
pub(crate) use write::write_lossless;

#[cfg(feature = "encode")]
mod write {
    use super::*;
    use crate::base::bits::ByteWriter;

    /// The section, of what the range coder gave for each block.
    pub(crate) fn write_lossless(missing: &[u64], coded: &[&[u8]]) -> Vec<u8> {
        let mut w = ByteWriter::default();
        w.u32(coded.len() as u32);
        missing.iter().for_each(|&bits| w.u64(bits));
        coded.iter().for_each(|coded| w.u32((coded.len() + CRC) as u32));
        w.u32(crc32fast::hash(&w.0));
        for (block, coded) in coded.iter().enumerate() {
            w.bytes(coded);
            w.u32(checksum(block as u32, coded));
        }
        w.0
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    fn read(bytes: &[u8], blocks: usize) -> Result<LosslessIndex> {
        let section = Section { id: *b"EXCT", skippable: true, range: 0..bytes.len(), crc: 0 };
        LosslessIndex::read(bytes, &section, blocks, 1)
    }

    /// Spec section 3.10 byte for byte; the sums are those of Python's zlib.
    #[test]
    fn bytes_are_those_of_the_specification() {
        let bytes = write_lossless(&[0x0807_0605_0403_0201], &[&[0xAA], &[]]);
        let head = [&[2, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8][..], &[5, 0, 0, 0, 4, 0, 0, 0]].concat();
        let sums = [0x91BD_1F4D_u32, 0xF021_BDEB_u32, 0x99F8_B879_u32].map(u32::to_le_bytes);
        assert_eq!(bytes, [&head[..], &sums[0], &[0xAA], &sums[1], &sums[2]].concat());
    }

    #[test]
    fn round_trip_and_damage() {
        let bytes = write_lossless(&[7], &[&[1, 2, 3], &[], &[9]]);
        let index = read(&bytes, 3).unwrap();
        assert_eq!(index.missing, [7]);
        assert_eq!([0, 1, 2].map(|b| index.coded(&bytes, b).unwrap()), [&[1, 2, 3][..], &[], &[9]]);
        assert!(read(&bytes, 2).is_err() && read(&bytes, 4).is_err());
        for cut in 0..bytes.len() {
            assert!(read(&bytes[..cut], 3).is_err());
        }
        for bit in 0..8 * bytes.len() {
            let mut bad = bytes.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(read(&bad, 3).and_then(|index| (0..3).try_for_each(|b| index.coded(&bad, b).map(|_| ()))).is_err());
        }
    }
}
