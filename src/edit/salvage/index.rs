//! A damaged index: what of its entries the records prove.
//!
//! A record's checksum proves where it begins and ends. The index is one stream of a range coder: what is decoded behind damage is
//! arbitrary, first of all the length of the next record. So lengths that fit the records prove the stream before them, means included,
//! by as many bits as they take in the stream: where that is wrong, each of the decisions that make up a length falls by lot, with the
//! probability that its context states. (Damage that only turns a raw bit over and changes nothing behind it has to hit the one number
//! of 2^32 that the range is at that place.)

use super::MIN_RECORD;
use super::evidence::bits_to_choose;
use super::mend::{Patch, patches};
use crate::base::budget::{Budget, with_room};
use crate::base::error::Result;
use crate::format::index::{COUNT, Entry, EntryReader};
use crate::format::record::checksum;
use crate::table::block::Partition;

/// Records in a row that do not match, where the index is taken to be wrong.
const PATIENCE: usize = 3;
/// Bytes that the range coder reads ahead: as far behind a change it has led to other decisions, or it changes nothing.
const AHEAD: usize = 4;
/// Bits for the kinds of changes: one bit, and one to four bytes.
const KINDS: u32 = 2;
/// Bits of evidence that one change must have more than any other.
const CLEARLY: u32 = 8;
/// Operations that an entry takes, and each of its means.
const ENTRY: u64 = 400;
const MEAN: u64 = 40;

/// What the entries are measured against.
pub(super) struct Records<'a> {
    pub(super) components: usize,
    /// Bytes of RECS that are there.
    pub(super) bytes: &'a [u8],
    /// Bytes that it had.
    pub(super) length: usize,
    /// Positions of each block.
    sizes: Vec<u32>,
}

/// What is certain of a damaged section.
pub(super) struct Certain {
    /// All, or none where no change is proven.
    pub(super) entries: Vec<Entry>,
    /// The change that gave all of them, and the evidence for it.
    pub(super) change: Option<(Patch, u32)>,
    /// Whether there was no work left to look for a change everywhere.
    pub(super) cut_short: bool,
}

/// A place between two entries.
struct Place<'a> {
    reader: EntryReader<'a>,
    block: usize,
    /// Where the next record begins.
    end: usize,
}

/// One entry, held against the records.
enum Read {
    /// The record that it says is there is that of its block, which proves as many bits as this.
    Matches(u32),
    /// It is another.
    Differs,
    /// The file ends before it.
    Beyond,
}

impl<'a> Records<'a> {
    pub(super) fn new(partition: &Partition, components: usize, bytes: &'a [u8], length: usize) -> Result<Records<'a>> {
        let mut sizes = with_room(partition.block_count())?;
        // A block has at most 2^21 positions.
        sizes.extend(partition.sizes().map(|n| n as u32));
        Ok(Records { components, bytes, length, sizes })
    }

    /// Holds an entry's length against the bytes that it says are the block's record.
    fn compare(&self, block: usize, record: std::ops::Range<usize>, bits: u32) -> Read {
        let Some(bytes) = self.bytes.get(record) else { return Read::Beyond };
        let Some((body, crc)) = bytes.split_last_chunk::<4>() else { return Read::Differs };
        match !body.is_empty() && checksum(block as u32, body) == u32::from_le_bytes(*crc) {
            true => Read::Matches(bits),
            false => Read::Differs,
        }
    }

    /// The next entry; `None` if it contradicts the format or the file.
    fn step(&self, place: &mut Place, budget: &Budget) -> Result<Option<Read>> {
        budget.spend(ENTRY + MEAN * self.components as u64)?;
        let Some(entry) = place.reader.next(self.sizes[place.block] as usize) else { return Ok(None) };
        let record = place.end..place.end.saturating_add(entry.length as usize);
        // No record is shorter than class and checksum.
        if record.end > self.length || record.len() < MIN_RECORD {
            return Ok(None);
        }
        budget.spend(record.len() as u64 / 4)?;
        let (block, end) = (place.block, record.end);
        (place.block, place.end) = (block + 1, end);
        Ok(Some(self.compare(block, record, place.reader.length_bits())))
    }

    fn start<'b>(&self, section: &'b [u8]) -> Option<Place<'b>> {
        Some(Place { reader: EntryReader::new(section, self.components)?, block: 0, end: 0 })
    }

    /// What is certain of a section whose checksum is off by `difference`.
    ///
    /// # Errors
    /// `LimitExceeded` if not even what is there can be read within the budget.
    pub(super) fn certain(&self, section: &[u8], difference: u32, wanted: u32, budget: &Budget) -> Result<Certain> {
        // Of the work that is left, half may go into the search.
        let search = budget.half();
        let (change, cut_short) = match self.change(section, difference, wanted, &search) {
            Ok(change) => (change, false),
            Err(_) => (None, true),
        };
        budget.spend(search.spent())?;
        let Some((patch, evidence)) = change else {
            // Without it nothing is: damage at the start of the coder, where bits stand as they are, shows in no length.
            return Ok(Certain { entries: Vec::new(), change: None, cut_short });
        };
        let mut bytes = section.to_vec();
        patch.apply(&mut bytes);
        let entries = self.entries(&bytes, self.sizes.len(), budget)?;
        Ok(Certain { entries, change: Some((patch, evidence)), cut_short })
    }

    /// The first entries of a section, as they are.
    fn entries(&self, section: &[u8], count: usize, budget: &Budget) -> Result<Vec<Entry>> {
        let Some(mut place) = self.start(section) else { return Ok(Vec::new()) };
        budget.spend(count as u64 * (ENTRY + MEAN * self.components as u64))?;
        let mut entries = with_room(count)?;
        entries.extend(self.sizes[..count].iter().map_while(|&size| place.reader.next(size as usize).cloned()));
        Ok(entries)
    }

    /// The one change of four neighbouring bytes at most that the records prove, and the evidence for it.
    ///
    /// # Errors
    /// `LimitExceeded` if there is no work left to look everywhere.
    fn change(&self, section: &[u8], difference: u32, wanted: u32, budget: &Budget) -> Result<Option<(Patch, u32)>> {
        let Some(mut base) = self.start(section) else { return Ok(None) };
        let mut next = self.after(&base, section, budget)?;
        let plain = base.reader.plain_end(&self.sizes);
        let mut changes: Vec<Patch> = with_room(section.len())?;
        changes.extend(patches(section.len(), difference));
        let mut bytes = section.to_vec();
        let (mut best, mut second) = (None, 0);
        for &patch in changes.iter().rev() {
            // Where fewer than four bytes change, several places have the same change.
            if patch.change[0] == 0 && patch.at + 4 < section.len() {
                continue;
            }
            // There bits stand as they are, and no length behind them depends on them.
            if patch.at + 4 > COUNT && patch.at < plain {
                continue;
            }
            // Up to the last entry that does not look at what changes, everything stays as it is.
            while let Some(place) = next.take_if(|next| next.reader.position() <= patch.at) {
                base = place;
                next = self.after(&base, section, budget)?;
            }
            patch.apply(&mut bytes);
            let proven = self.behind(&base, &bytes, patch, budget)?;
            patch.apply(&mut bytes);
            let Some(proven) = proven else { continue };
            let choice = patch.cost() + bits_to_choose(section.len() as u64) + KINDS;
            let evidence = (32 + proven).saturating_sub(choice);
            match best {
                Some((_, most)) if evidence <= most => second = second.max(evidence),
                _ => {
                    second = best.map_or(0, |(_, most)| most);
                    best = Some((patch, evidence));
                }
            }
        }
        // Of two that explain the sum neither is certain, unless one has much more in its favour.
        Ok(best.filter(|&(_, most)| most >= wanted && second + CLEARLY <= most))
    }

    /// The place one entry on, if there is one.
    fn after<'b>(&self, place: &Place, section: &'b [u8], budget: &Budget) -> Result<Option<Place<'b>>> {
        if place.block >= self.sizes.len() {
            return Ok(None);
        }
        let mut next = Place { reader: place.reader.over(section), ..*place };
        Ok(self.step(&mut next, budget)?.map(|_| next))
    }

    /// Bits that the lengths behind a change prove; `None` if something contradicts it.
    fn behind(&self, base: &Place, changed: &[u8], patch: Patch, budget: &Budget) -> Result<Option<u32>> {
        // The number of blocks, if it is that which changes.
        let count = u32::from_le_bytes(changed.first_chunk().copied().unwrap_or_default());
        if count as usize != self.sizes.len() {
            return Ok(None);
        }
        let mut place = match patch.at < COUNT + AHEAD {
            true => match self.start(changed) {
                Some(start) => start,
                None => return Ok(None),
            },
            false => Place { reader: base.reader.over(changed), ..*base },
        };
        let mut bits = if patch.at + 4 <= COUNT { 32 } else { 0u32 };
        let mut wrong = 0;
        while place.block < self.sizes.len() {
            let from = place.reader.position();
            let Some(read) = self.step(&mut place, budget)? else { return Ok(None) };
            match read {
                Read::Matches(_) => wrong = 0,
                Read::Differs => wrong += 1,
                Read::Beyond => {}
            }
            if wrong >= PATIENCE {
                return Ok(None);
            }
            if from >= patch.at + 4 + AHEAD {
                bits = bits.saturating_add(read.bits());
            }
        }
        Ok((place.reader.unread() == 0 && place.end == self.length).then_some(bits))
    }
}

impl Read {
    /// Bits that the length proves.
    fn bits(&self) -> u32 {
        if let Read::Matches(bits) = self { *bits } else { 0 }
    }
}
