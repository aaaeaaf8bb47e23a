//! Damaged files: what is left of them, and what is not.
//!
//! [`Reader::open`] refuses a file whose header or index is damaged, and so must an archive. [`salvage`] goes on with what checksums
//! prove to be intact, and tells all that it did. What damage costs, by where it is:
//!
//! - A record: its block. The block's mean is in the index.
//! - META: the metadata. EXCT: the exact values of a block, or of all if it is in the section's head.
//! - Section table, GRID, CODE, PART, PROB, GRAZ, INDX: nothing, if it is one bit, which the checksum tells, or if the file has a spare
//!   copy of them (section SPAR, `csbrdf encode --spare`). Otherwise all is lost, but for
//! - INDX: nothing if four neighbouring bytes at most are wrong; otherwise the blocks from there on. Which entries are right is proven
//!   by the checksums of the records. (Values are wrong without their block's mean, so records alone do not help.)
//! - GRAZ is needed for every value: the profile's extent over the table is in it.

mod exact;
mod head;
mod index;
mod mend;
#[cfg(feature = "encode")]
mod repair;

use std::borrow::Cow;
use std::ops::Range;

use crate::block::{Block, Partition};
use crate::decode::{Pruned, Reader, read_header};
use crate::error::{Error, Result};
use crate::format::directory::{self, Directory, Section};
use crate::format::index::{Entry, Index, UNKNOWN_ERROR};
use crate::format::record::{ValidityClass, checksum};
use crate::format::{FINAL, Limits, is_compact};
use head::Head;
use index::Records;
#[cfg(feature = "encode")]
pub use repair::{Repaired, repair};

/// Blocks that are given out beside those that the bytes of the file have room for: lost ones take memory as well.
const FEW_BLOCKS: usize = 1 << 16;
/// Bytes of a record at least.
const MIN_RECORD: usize = 5;

/// What damage cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing: the bytes are known.
    Restored,
    /// What was there.
    Lost,
}

/// One place of a file that is damaged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Section, or "section table", "end marker", "file".
    pub section: Cow<'static, str>,
    /// The block whose record, or whose exact values in the section EXCT, it is.
    pub block: Option<usize>,
    /// Bytes of the file; they may be beyond its end.
    pub bytes: Range<usize>,
    /// What is wrong, or what was done.
    pub what: Cow<'static, str>,
    /// What it cost.
    pub outcome: Outcome,
}

impl Damage {
    fn of_section(
        section: impl Into<Cow<'static, str>>,
        bytes: Range<usize>,
        what: impl Into<Cow<'static, str>>,
        outcome: Outcome,
    ) -> Damage {
        Damage { section: section.into(), block: None, bytes, what: what.into(), outcome }
    }

    fn of_block(section: &'static str, block: usize, bytes: Range<usize>, what: &'static str) -> Damage {
        let outcome = Outcome::Lost;
        Damage { section: section.into(), block: Some(block), bytes, what: what.into(), outcome }
    }
}

/// A file as far as it is intact.
pub struct Salvaged {
    reader: Reader<Vec<u8>>,
    damage: Vec<Damage>,
    /// Blocks without a record.
    lost: Vec<usize>,
    /// First block whose mean is lost as well, and that of all after it.
    known_means: usize,
    /// What the file was: version, sections in their order.
    #[cfg_attr(not(feature = "encode"), allow(dead_code))]
    was: Directory,
}

impl Salvaged {
    /// Reads it. Blocks that are lost are there as pruned ones, which decode to their mean: no entry counts as valid.
    pub fn reader(&self) -> &Reader<Vec<u8>> {
        &self.reader
    }

    /// All that is damaged, in the order of the file's parts; empty if the file is intact.
    pub fn damage(&self) -> &[Damage] {
        &self.damage
    }

    /// Numbers of the blocks that are lost.
    pub fn lost(&self) -> &[usize] {
        &self.lost
    }

    /// Place and shape of a block that is lost.
    pub fn place(&self, block: usize) -> Option<Block> {
        self.reader.partition().block(block)
    }

    /// Whether the mean of a block is known.
    pub fn has_mean(&self, block: usize) -> bool {
        block < self.known_means
    }

    /// Entries (positions times channels) of the blocks that are lost.
    pub fn lost_entries(&self) -> usize {
        let positions = |&block: &usize| self.place(block).map_or(0, |place| place.positions());
        self.lost.iter().map(positions).sum::<usize>() * self.reader.grid().channels().len()
    }
}

/// What can be had of a file, with the usual limits.
///
/// # Errors
/// As [`Reader::open`], where nothing can: no section table, or a section that all blocks need is damaged. `UnsupportedVersion`,
/// `LimitExceeded`.
pub fn salvage(data: &[u8]) -> Result<Salvaged> {
    salvage_with_limits(data, Limits::default())
}

/// As [`salvage`], with the caller's limits. Takes memory for the bytes of the file once more, and some 200 bytes a block that its bytes
/// have room for, and of 65536 blocks; time for some passes over the file.
///
/// # Errors
/// As [`salvage`].
pub fn salvage_with_limits(data: &[u8], limits: Limits) -> Result<Salvaged> {
    let mut damage = Vec::new();
    let head = Head::find(data, &mut damage)?;
    let compact = is_compact(head.version.2);
    let mut image = Image::default();
    for name in [directory::GRID, directory::CODING, directory::PARTITION, directory::PROBABILITIES, directory::PROFILE]
    {
        let Some(section) = head.section(name) else { continue };
        match head.take(name, &mut damage).filter(|mended| mended.sound) {
            Some(mended) => image.push(section, &mended.bytes),
            None => return Err(needed(name, section)),
        }
    }
    let header = read_header(&image.bytes, &Directory::of(head.version, image.sections.clone()), &limits)?;
    let (blocks, components) = (header.partition.block_count(), header.grid.channels().len());
    let limit = data.len() / MIN_RECORD + FEW_BLOCKS;
    if blocks > limit {
        let limit = limit as u64;
        return Err(Error::LimitExceeded { what: "blocks of a damaged file", got: blocks as u64, limit });
    }

    // The index: sound, or its entries as far as the records prove them.
    let missing = |name| Error::corrupt("section table", 0, format!("section {name} is missing"));
    let records = head.section(directory::RECORDS).ok_or_else(|| missing("RECS"))?.clone();
    let section = head.section(directory::INDEX).ok_or_else(|| missing("INDX"))?.clone();
    let mended = head.take(directory::INDEX, &mut damage).ok_or_else(|| needed(directory::INDEX, &section))?;
    let entries: Vec<Entry> = if mended.sound {
        image.push(&section, &mended.bytes);
        let directory = Directory::of(head.version, image.sections.clone());
        let reader = directory.open(&image.bytes, directory::INDEX)?;
        let index = match compact {
            true => Index::read(reader, &header.partition, components, &records)?,
            false => Index::read_plain(reader, blocks, components, &records)?,
        };
        (0..blocks).map(|block| index.entry(block)).collect()
    } else if compact {
        let there = records.range.start.min(data.len())..records.range.end.min(data.len());
        let (partition, length) = (&header.partition, records.range.len());
        let there = Records { partition, components, bytes: &data[there], length };
        let entries = there.trusted(&mended.bytes, section.crc ^ crc32fast::hash(&mended.bytes));
        let (what, outcome) = if entries.len() == blocks {
            ("four bytes were mended, which the records prove right".to_string(), Outcome::Restored)
        } else {
            (format!("{} entries of {blocks} are certain", entries.len()), Outcome::Lost)
        };
        damage.push(Damage::of_section(directory::INDEX, section.range.clone(), what, outcome));
        entries
    } else {
        return Err(needed(directory::INDEX, &section));
    };

    // Metadata, if they are intact.
    let mended = head.section(directory::METADATA);
    let mended = mended.and_then(|section| Some((section, head.take(directory::METADATA, &mut damage)?)));
    if let Some((section, mended)) = mended {
        if mended.sound {
            image.push(section, &mended.bytes);
        } else {
            let what = "damaged; the metadata are lost";
            damage.push(Damage::of_section(directory::METADATA, section.range.clone(), what, Outcome::Lost));
        }
    }

    let known_means = entries.len();
    let (mut kept, mut lost) = (Vec::with_capacity(records.range.len().min(data.len())), Vec::new());
    let entries =
        records_of(data, &head, &header.partition, components, entries, &mut kept, &mut |block, range, what| {
            damage.push(Damage::of_block(directory::RECORDS, block, range, what));
            lost.push(block);
        });
    let start = image.bytes.len();
    image.push(&records, &kept);
    if let Some(section) = head.section(directory::EXACT).filter(|_| compact) {
        let bytes = exact::take(data, section, blocks, components, &lost, &mut damage);
        bytes.into_iter().for_each(|bytes| image.push(section, &bytes));
    }
    check_others(data, &head, &mut damage);
    let index = Index::of(&entries, start, components);
    let was = Directory::of(head.version, head.sections.clone());
    // Lost blocks are pruned ones, which the final version has.
    let draft = if lost.is_empty() { head.version.2 } else { FINAL };
    let directory = Directory::of((head.version.0, head.version.1, draft), image.sections);
    let reader = Reader::of(image.bytes, limits, directory, header, index).with_pruned(Pruned::Coarse);
    Ok(Salvaged { reader, damage, lost, known_means, was })
}

/// The spare copy, and sections of unknown names.
fn check_others(data: &[u8], head: &Head, damage: &mut Vec<Damage>) {
    let known =
        [directory::GRID, directory::CODING, directory::PARTITION, directory::PROBABILITIES, directory::PROFILE];
    let known = [&known[..], &[directory::INDEX, directory::METADATA, directory::RECORDS, directory::EXACT]].concat();
    for section in head.sections.iter().filter(|s| !known.contains(&&s.name()[..])) {
        if data.get(section.range.clone()).map(crc32fast::hash) == Some(section.crc) {
            continue;
        }
        let name = section.name();
        let outcome = if name == directory::SPARE { Outcome::Restored } else { Outcome::Lost };
        damage.push(Damage::of_section(name, section.range.clone(), "damaged", outcome));
    }
}

/// The error of a file of which nothing can be decoded.
fn needed(name: &'static str, section: &Section) -> Error {
    let what = "damaged beyond repair, and no value can be had without it; fetch the file again";
    Error::corrupt(name, section.range.start as u64, what)
}

/// Sections put together anew.
#[derive(Default)]
struct Image {
    bytes: Vec<u8>,
    sections: Vec<Section>,
}

impl Image {
    /// Appends a section with other bytes.
    fn push(&mut self, like: &Section, bytes: &[u8]) {
        let range = self.bytes.len()..self.bytes.len() + bytes.len();
        self.sections.push(Section { range, crc: crc32fast::hash(bytes), ..*like });
        self.bytes.extend_from_slice(bytes);
    }
}

/// Copies the records that are intact, with a pruned one in place of each other, and gives what the index says of these.
fn records_of(
    data: &[u8],
    head: &Head,
    partition: &Partition,
    components: usize,
    mut entries: Vec<Entry>,
    kept: &mut Vec<u8>,
    lost: &mut dyn FnMut(usize, Range<usize>, &'static str),
) -> Vec<Entry> {
    let range = head.section(directory::RECORDS).map_or(0..0, |section| section.range.clone());
    let (known, blocks) = (entries.len(), partition.block_count());
    let mut at = range.start;
    for block in 0..blocks {
        if block < known {
            let place = at..at.saturating_add(entries[block].length as usize);
            at = place.end;
            let shifted = head::from_end(place.clone(), head.length, data.len());
            let places = [Some(place.clone()), shifted.filter(|_| data.len() != head.length)];
            let mut found = places.into_iter().flatten().filter_map(|place| data.get(place));
            if let Some(record) = found.find(|record| is_record(record, block)) {
                kept.extend_from_slice(record);
                continue;
            }
            let what = if place.end > data.len() { "beyond the end of the file" } else { "the checksum is wrong" };
            lost(block, place, what);
        } else {
            // The mean is lost as well: that of the block before, at equal value of the table.
            let positions = |block: usize| partition.block(block).map_or(1, |block| block.positions()) as f64;
            let grown = if block > 0 { (positions(block) / positions(block - 1)).sqrt() } else { 1.0 };
            let before = entries.last().map(|entry| entry.means.clone());
            let scaled = |mean: i32| (f64::from(mean) * grown).round().clamp(-16_777_216.0, 16_777_216.0) as i32;
            let means = before.map_or_else(|| vec![0; components], |means| means.into_iter().map(scaled).collect());
            entries.push(Entry { length: 0, errors: [UNKNOWN_ERROR; 2], means });
            lost(block, at..range.end, "its place and its mean are not known");
        }
        let record = pruned_record(block as u32);
        entries[block].length = record.len() as u32;
        entries[block].errors = [UNKNOWN_ERROR; 2];
        kept.extend_from_slice(&record);
    }
    entries
}

fn is_record(bytes: &[u8], block: usize) -> bool {
    let Some((body, crc)) = bytes.split_last_chunk::<4>() else { return false };
    !body.is_empty() && checksum(block as u32, body) == u32::from_le_bytes(*crc)
}

/// The record of a block that is not known any more.
fn pruned_record(block: u32) -> [u8; 5] {
    let class = ValidityClass::Pruned as u8;
    let [a, b, c, d] = checksum(block, &[class]).to_le_bytes();
    [class, a, b, c, d]
}
