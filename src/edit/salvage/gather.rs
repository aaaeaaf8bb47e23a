//! Puts together what is left of a file: section by section, block by block, each as far as it is proven.

use std::ops::Range;

use super::evidence::{WANTED, evidence_of_bit, outcome};
use super::head::{self, Head, Mended, Table};
use super::index::Records;
use super::{Damage, MIN_RECORD, Options, Outcome, Salvaged, lossless, usual};
use crate::base::budget::{Budget, with_room};
use crate::base::error::{Error, Result};
use crate::base::limits::MAX_MEANS;
use crate::base::version::FINAL;
use crate::blocks::BlockCodec;
use crate::decode::{PrunedPolicy, Reader, Scratch, read_header};
use crate::format::directory::{self, Directory, Section};
use crate::format::index::{Entry, Index, LOST};
use crate::format::is_compact;
use crate::format::record::{ValidityClass, checksum};
use crate::table::block::Partition;

/// Blocks that are given out beside those that the bytes of the file have room for: lost ones take memory as well.
const FEW_BLOCKS: usize = 1 << 16;

/// Sections that no block can be decoded without, besides INDX.
const HEAD: [&str; 5] =
    [directory::GRID, directory::CODING, directory::PARTITION, directory::PROBABILITIES, directory::PROFILE];

/// Records that are decoded to see whether PART and PROB are right, and what one that decodes proves: of wrong ones a fifth does.
const TRIALS: usize = 64;
const BITS_A_TRIAL: u32 = 2;
/// Most bits that records prove together: wrong bytes at the end of PROB change contexts that few records use. Of 9,809 forged sections
/// of final-profile.csbrdf two passed all 13 records, where as many records on their own would have let one in 2^26 pass.
const MOST_TRIAL_BITS: u32 = 8;
/// Coded bytes from which on a record proves anything.
const LEAST_CODED: usize = 12;

/// A section in which one bit was flipped back.
struct Flipped {
    section: Section,
    name: &'static str,
    /// Its place in the list of damage.
    row: usize,
}

/// A gathering that is under way.
struct Gathering<'a> {
    data: &'a [u8],
    options: &'a Options,
    budget: Budget<'static>,
    head: Head<'a>,
    image: Image,
    damage: Vec<Damage>,
    flipped: Vec<Flipped>,
    lost: Vec<usize>,
}

pub(super) fn gather(data: &[u8], options: &Options) -> Result<Salvaged> {
    let budget = Budget::new(&options.limits, data.len());
    budget.hold(2 * data.len() as u64)?;
    let (head, table) = Head::find(data)?;
    let mut gathering = Gathering {
        data,
        options,
        budget,
        head,
        image: Image::default(),
        damage: Vec::new(),
        flipped: Vec::new(),
        lost: Vec::new(),
    };
    gathering.file(&table);
    let codec = gathering.header()?;
    let components = codec.grid.channels().len();
    gathering.check_size(&codec.partition, components)?;
    let entries = gathering.index(&codec.partition, components)?;
    gathering.metadata();
    let known_means = entries.len();
    let (start, entries) = gathering.records(&codec.partition, components, entries)?;
    let lost_source = gathering.source_values(codec.partition.block_count(), components);
    gathering.others();
    let index = Index::of(&entries, start, components);
    gathering.finish(codec, index, known_means, lost_source, &table)
}

impl Gathering<'_> {
    fn compact(&self) -> bool {
        is_compact(self.head.version.2)
    }

    /// What is wrong with the section table and the ends of the file. What that cost is known last.
    fn file(&mut self, table: &Table) {
        if let Some(what) = table.remedy() {
            let range = 0..head::table_length(self.head.sections.len());
            self.damage.push(Damage::of_section(head::TABLE, range, what, Outcome::Restored));
        }
        let (is, was) = (self.data.len(), self.head.length);
        if is > was {
            let what = format!("{} bytes follow its end; they are left out", is - was);
            self.damage.push(Damage::of_section("file", was..is, what, Outcome::Restored));
        } else if is < was {
            let what = format!("it has {is} bytes of {was}");
            self.damage.push(Damage::of_section("file", is..was, what, Outcome::Lost));
        }
        if let Some(marker) = self.head.overwritten_marker() {
            self.damage.push(Damage::of_section("end marker", marker, "overwritten", Outcome::Restored));
        }
    }

    /// A section as it is, from the spare copy, or with one bit flipped back, which is yet to be proven; says so. `None` if the file has none
    /// or ends within it.
    fn take(&mut self, name: &'static str, flips: bool) -> Option<Mended> {
        let section = self.head.section(name)?.clone();
        let mended = self.head.take(&section, flips);
        let row = |what: &'static str, bytes, outcome| Damage::of_section(name, bytes, what, outcome);
        match &mended {
            None => self.damage.push(row("beyond the end of the file", section.range.clone(), Outcome::Lost)),
            Some(Mended::Copied(_)) => {
                self.damage.push(row("taken from the spare copy", section.range.clone(), Outcome::Restored));
            }
            Some(Mended::Flipped(_, at)) => {
                let at = section.range.start + at;
                self.flipped.push(Flipped { section: section.clone(), name, row: self.damage.len() });
                self.damage.push(row("one bit was flipped", at..at + 1, Outcome::Restored));
            }
            Some(Mended::AsItIs(_) | Mended::Unsound(_)) => {}
        }
        mended
    }

    fn header(&mut self) -> Result<BlockCodec> {
        for name in HEAD {
            let Some(section) = self.head.section(name).cloned() else { continue };
            let mended = self.take(name, true);
            match mended.as_ref().and_then(Mended::sound) {
                Some(bytes) => self.image.push(&section, bytes),
                None => return Err(needed(name, &section)),
            }
        }
        let directory = Directory::of(self.head.version, self.image.sections.clone());
        read_header(&self.image.bytes, &directory, &self.options.limits)
    }

    /// Blocks that the file never had are not made up: the section table and PART contradict each other, or more was cut off than is left.
    fn check_size(&self, partition: &Partition, components: usize) -> Result<()> {
        let blocks = partition.block_count();
        let records = self.head.section(directory::RECORDS).map_or(0, |section| section.range.len());
        if blocks > records / MIN_RECORD || self.compact() && blocks.saturating_mul(components) > MAX_MEANS {
            let what = format!("{blocks} blocks of {components} components, with records of {records} bytes");
            let at = self.head.section(directory::INDEX).map_or(0, |section| section.range.start);
            return Err(Error::corrupt("INDX", at as u64, what));
        }
        let (got, limit) = (blocks as u64, (self.data.len() / MIN_RECORD + FEW_BLOCKS) as u64);
        if got > limit {
            return Err(Error::LimitExceeded { what: "blocks of a damaged file", got, limit });
        }
        // Entries, their list once more, and the index.
        self.budget.hold(got * (3 * 4 * components as u64 + 2 * size_of::<Entry>() as u64 + 64))
    }

    /// The entries of the index: all of them, or none where it is damaged and no change is proven.
    fn index(&mut self, partition: &Partition, components: usize) -> Result<Vec<Entry>> {
        let missing = |name| Error::corrupt("section table", 0, format!("section {name} is missing"));
        let records = self.head.section(directory::RECORDS).ok_or_else(|| missing("RECS"))?.clone();
        let section = self.head.section(directory::INDEX).ok_or_else(|| missing("INDX"))?.clone();
        let blocks = partition.block_count();
        // A flipped bit of the coded form is proven like any other change; of the plain one by its checksum alone.
        let mended = self.take(directory::INDEX, !self.compact()).ok_or_else(|| needed(directory::INDEX, &section))?;
        if let Some(bytes) = mended.sound() {
            self.image.push(&section, bytes);
            let directory = Directory::of(self.head.version, self.image.sections.clone());
            let reader = directory.open(&self.image.bytes, directory::INDEX)?;
            let index = match self.compact() {
                true => Index::read(reader, partition, components, &records)?,
                false => Index::read_plain(reader, blocks, components, &records)?,
            };
            return Ok((0..blocks).map(|block| index.entry(block)).collect());
        }
        let Mended::Unsound(bytes) = mended else { return Err(needed(directory::INDEX, &section)) };
        if !self.compact() {
            return Err(needed(directory::INDEX, &section));
        }
        self.damaged_index(&section, &bytes, partition, components, &records)
    }

    fn damaged_index(
        &mut self,
        section: &Section,
        bytes: &[u8],
        partition: &Partition,
        components: usize,
        records: &Section,
    ) -> Result<Vec<Entry>> {
        let there = records.range.start.min(self.data.len())..records.range.end.min(self.data.len());
        let lengths = Records::new(partition, components, &self.data[there], records.range.len())?;
        let difference = section.crc ^ crc32fast::hash(bytes);
        let certain = lengths.certain(bytes, difference, self.options.evidence, &self.budget)?;
        let range = section.range.clone();
        let (bytes, what, outcome) = match certain.change {
            Some((patch, bits)) => {
                let mut mended = bytes.to_vec();
                patch.apply(&mut mended);
                self.image.push(section, &mended);
                let at = range.start + patch.place();
                let what = format!("{}, which the records behind prove to {bits} bits", patch.describe());
                (at..(at + 4).min(range.end), what, outcome(bits))
            }
            None => {
                let cut = if certain.cut_short { "; not all changes could be tried within the limits" } else { "" };
                let what = format!("none of {} entries is certain{cut}", partition.block_count());
                (range, what, Outcome::Lost)
            }
        };
        self.damage.push(Damage::of_section(directory::INDEX, bytes, what, outcome));
        Ok(certain.entries)
    }

    /// The metadata, if they are intact, or one bit apart from it where the caller takes the evidence of that.
    fn metadata(&mut self) {
        let Some(section) = self.head.section(directory::METADATA).cloned() else { return };
        let Some(mended) = self.take(directory::METADATA, true) else { return };
        let lost = "damaged; the metadata are lost";
        let range = section.range.clone();
        match &mended {
            Mended::Flipped(bytes, _) => {
                let bits = evidence_of_bit(range.len());
                let row = self.flipped.pop().map_or(0, |flipped| flipped.row);
                if bits >= self.options.evidence {
                    self.damage[row].outcome = outcome(bits);
                    self.image.push(&section, bytes);
                } else {
                    self.damage[row] = Damage::of_section(directory::METADATA, range, lost, Outcome::Lost);
                }
            }
            Mended::AsItIs(bytes) | Mended::Copied(bytes) => self.image.push(&section, bytes),
            Mended::Unsound(_) => {
                self.damage.push(Damage::of_section(directory::METADATA, range, lost, Outcome::Lost));
            }
        }
    }

    /// Copies the records that are intact, with a pruned one in place of each other. Gives where they begin, and what the index says of them.
    fn records(
        &mut self,
        partition: &Partition,
        components: usize,
        mut entries: Vec<Entry>,
    ) -> Result<(usize, Vec<Entry>)> {
        let section = self.head.section(directory::RECORDS).cloned().ok_or_else(|| needed("INDX", &EMPTY))?;
        let range = section.range.clone();
        let (known, blocks) = (entries.len(), partition.block_count());
        let mut kept = with_room(range.len().min(self.data.len() + MIN_RECORD * blocks))?;
        entries.try_reserve(blocks - known).map_err(|_| Error::OutOfMemory { bytes: blocks as u64 * 64 })?;
        let mut at = range.start;
        for block in 0..blocks {
            if block < known {
                let place = at..at.saturating_add(entries[block].length as usize);
                at = place.end;
                if let Some(record) = self.find(place.clone(), block) {
                    kept.extend_from_slice(record);
                    continue;
                }
                let beyond = place.end > self.data.len();
                let what = if beyond { "beyond the end of the file" } else { "the checksum is wrong" };
                Damage::of_block(&mut self.damage, directory::RECORDS, block, place, what);
            } else {
                entries.push(like_the_one_before(partition, components, entries.last(), block));
                let what = "place and mean are not known";
                Damage::of_block(&mut self.damage, directory::RECORDS, block, at..range.end, what);
            }
            self.lost.push(block);
            let record = pruned_record(block as u32);
            entries[block].length = record.len() as u32;
            entries[block].errors = LOST;
            kept.extend_from_slice(&record);
        }
        let start = self.image.bytes.len();
        self.image.push(&section, &kept);
        Ok((start, entries))
    }

    /// The record of a block, where it should be, or at the same distance from the end of a file of another length.
    fn find(&self, place: Range<usize>, block: usize) -> Option<&[u8]> {
        let (is, was) = (self.data.len(), self.head.length);
        let shifted = head::from_end(place.clone(), was, is).filter(|_| is != was);
        let mut found = [Some(place), shifted].into_iter().flatten().filter_map(|place| self.data.get(place));
        found.find(|record| is_record(record, block))
    }

    /// The source values that are intact; gives how many blocks have none.
    fn source_values(&mut self, blocks: usize, channels: usize) -> usize {
        let Some(section) = self.head.section(directory::LOSSLESS).filter(|_| self.compact()).cloned() else {
            return 0;
        };
        let wanted = self.options.evidence;
        let taken = lossless::take(self.data, &section, [blocks, channels], &self.lost, wanted, &mut self.damage);
        let Some((bytes, lost)) = taken else { return blocks };
        self.image.push(&section, &bytes);
        lost
    }

    /// The spare copy, and sections of unknown names.
    fn others(&mut self) {
        let known =
            [&HEAD[..], &[directory::INDEX, directory::METADATA, directory::RECORDS, directory::LOSSLESS]].concat();
        for section in self.head.sections.iter().filter(|s| !known.contains(&&s.name()[..])) {
            if self.data.get(section.range.clone()).map(crc32fast::hash) == Some(section.crc) {
                continue;
            }
            let name = section.name();
            // The copy is made anew.
            let outcome = if name == directory::SPARE { Outcome::Restored } else { Outcome::Lost };
            self.damage.push(Damage::of_section(name, section.range.clone(), "damaged", outcome));
        }
    }

    /// The file that was put together, once all that was changed is proven.
    fn finish(
        mut self,
        codec: BlockCodec,
        index: Index,
        known_means: usize,
        lost_source: usize,
        table: &Table,
    ) -> Result<Salvaged> {
        let was = Directory::of(self.head.version, self.head.sections.clone());
        // Lost blocks are pruned ones, which the final version has.
        let draft = if self.lost.is_empty() { self.head.version.2 } else { FINAL };
        let version = (self.head.version.0, self.head.version.1, draft);
        let image = std::mem::take(&mut self.image);
        let directory = Directory::of(version, image.sections);
        let reader =
            Reader::of(image.bytes, self.options.limits, directory, codec, index).with_pruned(PrunedPolicy::Coarse);
        for Flipped { section, name, row } in std::mem::take(&mut self.flipped) {
            let bits = self.evidence_of(&reader, name, &section)?;
            if bits < self.options.evidence {
                return Err(unproven(name, &section, bits));
            }
            self.damage[row].outcome = outcome(bits);
        }
        self.judge_table(table);
        // A file that was cut and is whole again lost nothing.
        let others = self.damage.iter().all(|d| d.outcome == Outcome::Restored || d.section == "file");
        if let Some(file) = self.damage.iter_mut().find(|d| d.section == "file" && others) {
            file.outcome = Outcome::Restored;
        }
        let Gathering { damage, lost, .. } = self;
        Ok(Salvaged { reader, damage, lost, known_means, lost_source, was })
    }

    /// Evidence for the bit of a section that was flipped back.
    fn evidence_of(&self, reader: &Reader<Vec<u8>>, name: &'static str, section: &Section) -> Result<u32> {
        let alone = evidence_of_bit(section.range.len());
        Ok(match name {
            directory::GRID => usual::of_grid(reader.grid()).max(alone),
            directory::CODING => usual::of_coding(reader.coding(), reader.grid()).max(alone),
            directory::PARTITION | directory::PROBABILITIES => {
                (alone + self.trials(reader, name, section)?).min(WANTED)
            }
            _ => alone,
        })
    }

    /// Bits that decoding the records proves: with wrong probabilities, or blocks of another shape, few would end where they do.
    fn trials(&self, reader: &Reader<Vec<u8>>, name: &'static str, section: &Section) -> Result<u32> {
        let (mut bits, mut trials, mut scratch) = (0, 0, Scratch::default());
        for block in 0..reader.block_count() {
            let record = reader.record(block)?;
            if trials >= TRIALS || record.class.is_mean_only() || record.coded.len() < LEAST_CODED {
                continue;
            }
            match reader.decode_log(block, &mut scratch, &self.budget) {
                Ok(_) => {}
                Err(e @ (Error::LimitExceeded { .. } | Error::OutOfMemory { .. })) => return Err(e),
                Err(_) => return Err(needed(name, section)),
            }
            trials += 1;
            bits = (bits + BITS_A_TRIAL).min(MOST_TRIAL_BITS);
        }
        Ok(bits)
    }

    /// What is left of the evidence for the bit of the section table that was flipped back. No value hangs on it: the sections that it names
    /// have checksums of their own.
    fn judge_table(&mut self, table: &Table) {
        let Some(entry) = table.flipped() else { return };
        // The checksum and the length of a section are right if it has them. All else has one value, or few.
        let is_sound = |section: &Section| {
            let intact = self.data.get(section.range.clone()).map(crc32fast::hash) == Some(section.crc);
            let mut rows = self.damage.iter().filter(|d| d.section == section.name());
            intact || section.id != *directory::SPARE.as_bytes() && rows.any(|row| row.outcome == Outcome::Restored)
        };
        let sections = &self.head.sections;
        let sound = match entry {
            Some(entry) => is_sound(&sections[entry]),
            None => sections.iter().all(is_sound),
        };
        let alone = evidence_of_bit(head::table_length(sections.len()));
        let bits = if sound && self.head.is_usual() { WANTED } else { alone };
        let row = self.damage.iter_mut().find(|d| d.section == head::TABLE);
        if let Some(row) = row {
            row.outcome = if bits >= self.options.evidence { outcome(bits) } else { Outcome::Lost };
        }
    }
}

const EMPTY: Section = Section { id: *b"RECS", skippable: false, range: 0..0, crc: 0 };

/// The error of a file of which nothing can be decoded.
fn needed(name: &'static str, section: &Section) -> Error {
    let what = "damaged beyond repair, and no value can be had without it; fetch the file again";
    Error::corrupt(name, section.range.start as u64, what)
}

/// The error of one of which all could be decoded, if a guess were right.
fn unproven(name: &'static str, section: &Section, bits: u32) -> Error {
    let what = format!(
        "damaged; one bit flipped back would explain it, but only {bits} bits of evidence of {WANTED} speak for that, and no value can be \
         had without it; fetch the file again, or accept the guess (--evidence {bits}, Options::evidence)"
    );
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

/// The entry of a block of which nothing is known: the mean of the block before, at equal value of the table.
fn like_the_one_before(partition: &Partition, components: usize, before: Option<&Entry>, block: usize) -> Entry {
    let positions = |block: usize| partition.block(block).map_or(1, |block| block.positions()) as f64;
    let grown = if block > 0 { (positions(block) / positions(block - 1)).sqrt() } else { 1.0 };
    let scaled = |mean: &i32| (f64::from(*mean) * grown).round().clamp(-16_777_216.0, 16_777_216.0) as i32;
    let means = before.map_or_else(|| vec![0; components], |before| before.means.iter().map(scaled).collect());
    Entry { length: 0, errors: LOST, means }
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
