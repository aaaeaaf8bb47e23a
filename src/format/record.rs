//! One block's record (spec section 3.8): class byte, coded masks and coefficients, CRC-32.

use crate::base::error::{Error, Result};
use crate::format::directory::check_crc;

/// Bytes of a record besides the coded ones: class and checksum.
const OVERHEAD: usize = 5;

/// Which entries of a block are valid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
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
    /// Not known any more: the block was pruned, and holds its mean only.
    Pruned,
}

impl ValidityClass {
    /// All classes, in the order of their codes.
    pub const ALL: [ValidityClass; 6] = [
        ValidityClass::All,
        ValidityClass::None,
        ValidityClass::Horizon,
        ValidityClass::Mask,
        ValidityClass::MaskPerChannel,
        ValidityClass::Pruned,
    ];

    /// Whether records of the class have nothing coded.
    pub(crate) fn is_mean_only(self) -> bool {
        matches!(self, ValidityClass::None | ValidityClass::Pruned)
    }

    /// Name in reports.
    pub fn as_str(self) -> &'static str {
        ["all", "none", "horizon", "mask", "mask per channel", "pruned"][self as usize]
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
    /// `most_doublings`: 0 where the file's version or its sampling leave no choice; `may_prune`: whether the version knows pruned
    /// blocks.
    pub(crate) fn read(
        bytes: &'a [u8],
        block: u32,
        offset: u64,
        most_doublings: u8,
        may_prune: bool,
    ) -> Result<Record<'a>> {
        let parts = bytes.split_last_chunk::<4>().and_then(|(body, crc)| Some((body, body.split_first()?, crc)));
        let Some((body, (first, coded), crc)) = parts else {
            let what = format!("record of block {block} has {} bytes, at least {OVERHEAD} are needed", bytes.len());
            return Err(Error::corrupt("RECS", offset, what));
        };
        // The last four bytes: CRC-32 of the block number and all before.
        check_crc("RECS", offset, u32::from_le_bytes(*crc), checksum(block, body))?;
        // Class of validity in the lower three bits; higher values are reserved. Doublings of the ratio in the upper five.
        let (class, doublings) = (first & 7, first >> 3);
        let known = ValidityClass::ALL.get(usize::from(class)).filter(|c| may_prune || **c != ValidityClass::Pruned);
        let class = *known.ok_or_else(|| {
            Error::corrupt("RECS", offset, format!("validity class {class} of block {block} is reserved"))
        })?;
        if doublings > most_doublings {
            let what =
                format!("block {block} doubles the sampling ratio {doublings} times, allowed are {most_doublings}");
            return Err(Error::corrupt("RECS", offset, what));
        }
        if class == ValidityClass::Pruned && doublings > 0 {
            let what = format!("block {block} was pruned, but doubles the sampling ratio {doublings} times");
            return Err(Error::corrupt("RECS", offset, what));
        }
        // Masks and coefficients in the range coder; nothing where nothing is valid.
        if class.is_mean_only() && !coded.is_empty() {
            let what = format!("block {block} holds its mean only ({}), but coefficients", class.as_str());
            return Err(Error::corrupt("RECS", offset, what));
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
            let coded: &[u8] = if class.is_mean_only() { &[] } else { &[1, 2, 3] };
            let doublings = if class == ValidityClass::Pruned { 0 } else { 31 };
            let bytes = Record { class, doublings, coded }.write(7);
            let back = Record::read(&bytes, 7, 0, 31, true).unwrap();
            assert_eq!((back.class, back.doublings, back.coded), (class, doublings, coded));
            let doubling = Record { class, doublings: 31, coded }.write(7);
            assert!(Record::read(&doubling, 7, 0, 0, true).is_err(), "doublings where there are none");
            assert_eq!(Record::read(&doubling, 7, 0, 31, true).is_err(), class == ValidityClass::Pruned);
            assert!(Record::read(&bytes, 8, 0, 31, true).is_err(), "another block's place");
            let known = Record::read(&bytes, 7, 0, 31, false).is_ok();
            assert_eq!(known, class != ValidityClass::Pruned, "pruned blocks where there are none");
            for bit in 0..8 * bytes.len() {
                let mut bad = bytes.clone();
                bad[bit / 8] ^= 1 << (bit % 8);
                assert!(Record::read(&bad, 7, 0, 31, true).is_err());
            }
            for cut in 0..bytes.len() {
                assert!(Record::read(&bytes[..cut], 7, 0, 31, true).is_err());
            }
        }
        let none_with_data = Record { class: ValidityClass::None, doublings: 0, coded: &[1] }.write(0);
        assert!(Record::read(&none_with_data, 0, 0, 31, true).is_err());
    }
}
