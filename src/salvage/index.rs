//! An index that is damaged: what of its entries the records prove.
//!
//! A record's checksum proves where it begins and ends. The index is one stream of a range coder, in which damage spoils all that
//! follows, first the length of the next record.

use super::mend::patches;
use crate::bits::ByteReader;
use crate::block::Partition;
use crate::format::index::{Entry, read_entries};
use crate::format::record::checksum;

/// Raw bits that the lengths after an entry must be worth for it to be trusted.
const PROOF: u32 = 32;
/// Records in a row that do not match, where the index is taken to be wrong.
const PATIENCE: usize = 4;
/// Most entries that are decoded to find a change of four bytes.
const MAX_TRIES: usize = 1 << 22;

/// What the entries are measured against.
pub(super) struct Records<'a> {
    pub(super) partition: &'a Partition,
    pub(super) components: usize,
    /// Bytes of RECS that are there.
    pub(super) bytes: &'a [u8],
    /// Bytes that it had.
    pub(super) length: usize,
}

/// Entries as an index tells them.
struct Told {
    entries: Vec<Entry>,
    /// Whether the record that each says is there is that of its block.
    matches: Vec<bool>,
    /// Whether nothing contradicts them.
    complete: bool,
}

impl Records<'_> {
    /// Whether the bytes are a block's record.
    fn matches(&self, block: usize, start: usize, length: usize) -> bool {
        let Some((body, crc)) = self.bytes.get(start..start + length).and_then(|record| record.split_last_chunk::<4>())
        else {
            return false;
        };
        !body.is_empty() && checksum(block as u32, body) == u32::from_le_bytes(*crc)
    }

    fn read(&self, section: &[u8], patience: usize) -> Told {
        let (mut entries, mut matches): (Vec<Entry>, Vec<bool>) = (Vec::new(), Vec::new());
        let (mut end, mut wrong) = (0usize, 0);
        let unread = read_entries(ByteReader::new(section, 0, "INDX"), self.partition, self.components, |entry| {
            let start = end;
            end = end.saturating_add(entry.length as usize);
            if end > self.length {
                return false;
            }
            let found = self.matches(entries.len(), start, entry.length as usize);
            wrong = if found { 0 } else { wrong + 1 };
            entries.push(entry.clone());
            matches.push(found);
            wrong < patience
        });
        let complete = unread == Some(0) && entries.len() == self.partition.block_count() && end == self.length;
        Told { entries, matches, complete }
    }

    /// The entries of a damaged section that are certain, from the first on.
    pub(super) fn trusted(&self, section: &[u8], difference: u32) -> Vec<Entry> {
        let mended = self.mended(section, difference);
        let proven = self.read(section, usize::MAX).proven();
        if mended.len() > proven.len() { mended } else { proven }
    }

    /// The entries if four neighbouring bytes at most are wrong: for each place the checksum tells what they were, and the records
    /// tell which place it is. What several changes agree on, if the records do not decide.
    fn mended(&self, section: &[u8], difference: u32) -> Vec<Entry> {
        let blocks = self.partition.block_count();
        if section.len().saturating_mul(blocks) > MAX_TRIES {
            return Vec::new();
        }
        let mut common: Option<Vec<Entry>> = None;
        let mut bytes = section.to_vec();
        for patch in patches(section.len(), difference) {
            patch.apply(&mut bytes);
            let told = self.read(&bytes, PATIENCE);
            patch.apply(&mut bytes);
            let last = told.matches.iter().rposition(|m| *m);
            let matching = told.matches.iter().filter(|m| **m).count();
            if !told.complete || 2 * matching < blocks || last.is_none_or(|last| last + 1 + PATIENCE < blocks) {
                continue;
            }
            common = Some(match common {
                None => told.entries,
                Some(mut before) => {
                    let same = before.iter().zip(&told.entries).take_while(|(a, b)| a == b).count();
                    before.truncate(same);
                    before
                }
            });
        }
        common.unwrap_or_default()
    }
}

impl Told {
    /// The entries before lengths that are too unlikely to be right after damage.
    fn proven(mut self) -> Vec<Entry> {
        let raw_bits = |entry: &Entry| (u32::BITS - entry.length.leading_zeros()).saturating_sub(2);
        let mut last = self.matches.iter().rposition(|m| *m).map_or(0, |last| last + 1);
        let mut bits = 0;
        while last > 0 && bits < PROOF {
            last -= 1;
            bits += raw_bits(&self.entries[last]);
        }
        self.entries.truncate(last);
        self.entries
    }
}
