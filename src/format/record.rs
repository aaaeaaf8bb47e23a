//! One block's record (spec section 3.8): class byte, coded masks and coefficients, CRC-32.

use crate::error::{Error, Result};
use crate::format::directory::check_crc;

/// Bytes of a record besides the coded ones: class and checksum.
const OVERHEAD: usize = 5;

/// Which entries of a block are valid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ValidityClass {
    /// All of them.
    #[default]
    All,
    /// None: the block holds its mean only.
    None,
    /// Those that the file's horizon predicts.
    Horizon,
    /// A mask in the record, common to all channels.
    Mask,
    /// A mask in the record for each channel.
    MaskPerChannel,
}

impl ValidityClass {
    /// All classes, in the order of their codes.
    pub const ALL: [ValidityClass; 5] = [
        ValidityClass::All,
        ValidityClass::None,
        ValidityClass::Horizon,
        ValidityClass::Mask,
        ValidityClass::MaskPerChannel,
    ];

    /// Name in reports.
    pub fn as_str(self) -> &'static str {
        ["all", "none", "horizon", "mask", "mask per channel"][self as usize]
    }
}

/// A record, its checksum verified.
#[derive(Debug)]
pub(crate) struct Record<'a> {
    pub(crate) class: ValidityClass,
    /// How often the file's sampling ratio is doubled for this block.
    pub(crate) doublings: u8,
    /// The range coder's bytes.
    pub(crate) coded: &'a [u8],
}

/// CRC-32 of the block's number and its bytes, so that a record in another's place is seen.
pub(crate) fn checksum(block: u32, bytes: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&block.to_le_bytes());
    hasher.update(bytes);
    hasher.finalize()
}

impl<'a> Record<'a> {
    /// `most_doublings`: 0 where the file's version or its sampling leave no choice.
    pub(crate) fn read(bytes: &'a [u8], block: u32, offset: u64, most_doublings: u8) -> Result<Record<'a>> {
        if bytes.len() < OVERHEAD {
            let what = format!("record of block {block} has {} bytes, at least {OVERHEAD} are needed", bytes.len());
            return Err(Error::corrupt("RECS", offset, what));
        }
        // The last four bytes: CRC-32 of the block number and all before.
        let (body, crc) = bytes.split_at(bytes.len() - 4);
        check_crc("RECS", offset, u32::from_le_bytes(crc.try_into().expect("four bytes")), checksum(block, body))?;
        // Class of validity in the lower three bits; higher values are reserved. Doublings of the ratio in the upper five.
        let (class, doublings) = (body[0] & 7, body[0] >> 3);
        let class = *ValidityClass::ALL.get(usize::from(class)).ok_or_else(|| {
            Error::corrupt("RECS", offset, format!("validity class {class} of block {block} is reserved"))
        })?;
        if doublings > most_doublings {
            let what =
                format!("block {block} doubles the sampling ratio {doublings} times, allowed are {most_doublings}");
            return Err(Error::corrupt("RECS", offset, what));
        }
        // Masks and coefficients in the range coder; nothing where nothing is valid.
        let coded = &body[1..];
        if class == ValidityClass::None && !coded.is_empty() {
            return Err(Error::corrupt("RECS", offset, format!("block {block} has no valid entry, but coefficients")));
        }
        Ok(Record { class, doublings, coded })
    }

    #[cfg(feature = "encode")]
    pub(crate) fn write(&self, block: u32) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.coded.len() + OVERHEAD);
        bytes.push(self.class as u8 | self.doublings << 3);
        bytes.extend_from_slice(self.coded);
        bytes.extend_from_slice(&checksum(block, &bytes).to_le_bytes());
        bytes
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    /// Spec section 3.8 byte for byte; the sum is that of Python's zlib.
    #[test]
    fn bytes_are_those_of_the_specification() {
        let bytes = Record { class: ValidityClass::Mask, doublings: 0, coded: &[0xAA, 0xBB] }.write(7);
        assert_eq!(bytes, [0x03, 0xAA, 0xBB, 0xCE, 0x61, 0xD6, 0x52]);
        let bytes = Record { class: ValidityClass::Mask, doublings: 5, coded: &[0xAA, 0xBB] }.write(7);
        assert_eq!(bytes[..3], [0x2B, 0xAA, 0xBB]);
    }

    #[test]
    fn round_trip_and_damage() {
        for class in ValidityClass::ALL {
            let coded: &[u8] = if class == ValidityClass::None { &[] } else { &[1, 2, 3] };
            let bytes = Record { class, doublings: 31, coded }.write(7);
            let back = Record::read(&bytes, 7, 0, 31).unwrap();
            assert_eq!((back.class, back.doublings, back.coded), (class, 31, coded));
            assert!(Record::read(&bytes, 7, 0, 0).is_err(), "doublings where there are none");
            assert!(Record::read(&bytes, 8, 0, 31).is_err(), "another block's place");
            for bit in 0..8 * bytes.len() {
                let mut bad = bytes.clone();
                bad[bit / 8] ^= 1 << (bit % 8);
                assert!(Record::read(&bad, 7, 0, 31).is_err());
            }
            for cut in 0..bytes.len() {
                assert!(Record::read(&bytes[..cut], 7, 0, 31).is_err());
            }
        }
        let none_with_data = Record { class: ValidityClass::None, doublings: 0, coded: &[1] }.write(0);
        assert!(Record::read(&none_with_data, 0, 0, 31).is_err());
    }
}
