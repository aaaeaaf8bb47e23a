//! What blocks cannot be decoded without: the section table and the sections before RECS, mended as far as a checksum proves it.

use std::ops::Range;

use super::mend::one_bit;
use crate::base::bits::ByteReader;
use crate::base::error::{Error, Result};
use crate::base::limits::MAX_SECTIONS;
use crate::format::directory::{self, Directory, ENTRY, PREAMBLE, Section, table_crc};
use crate::format::{END_MARKER, MAGIC, reads_version, spare};

/// What errors and lists of damage call it.
pub(super) const TABLE: &str = "section table";

/// The section table of a damaged file, its checksum right.
pub(super) struct Head<'a> {
    data: &'a [u8],
    pub(super) version: (u16, u16, u16),
    /// Bytes of the file as it was.
    pub(super) length: usize,
    /// Where the sections were; maybe beyond the end of what is there.
    pub(super) sections: Vec<Section>,
    /// All before RECS, from the spare copy if there is one; sections of it may be damaged.
    spare: Option<Vec<u8>>,
}

/// Where the section table is from.
pub(super) enum Table {
    AsItIs,
    Copied,
    /// One bit was flipped back: in the entry of a section, or elsewhere.
    Flipped(Option<usize>),
}

/// A section's bytes.
pub(super) enum Mended {
    /// Its checksum is right.
    AsItIs(Vec<u8>),
    /// Those of the spare copy, where it is right.
    Copied(Vec<u8>),
    /// One bit was flipped back, in this byte: so it is right.
    Flipped(Vec<u8>, usize),
    /// It is wrong.
    Unsound(Vec<u8>),
}

impl Table {
    pub(super) fn remedy(&self) -> Option<&'static str> {
        match self {
            Table::AsItIs => None,
            Table::Copied => Some("taken from the spare copy"),
            Table::Flipped(_) => Some("one bit was flipped"),
        }
    }

    pub(super) fn flipped(&self) -> Option<Option<usize>> {
        if let Table::Flipped(entry) = self { Some(*entry) } else { None }
    }
}

impl Mended {
    /// The bytes, if their checksum is right.
    pub(super) fn sound(&self) -> Option<&[u8]> {
        match self {
            Mended::AsItIs(bytes) | Mended::Copied(bytes) | Mended::Flipped(bytes, _) => Some(bytes),
            Mended::Unsound(_) => None,
        }
    }
}

impl<'a> Head<'a> {
    /// Finds the section table: as it is, in the spare copy, or with one bit flipped back.
    pub(super) fn find(data: &'a [u8]) -> Result<(Head<'a>, Table)> {
        let end = data.len().min(PREAMBLE + MAX_SECTIONS * ENTRY);
        let ((version, length, sections), table) = match parse(data) {
            Ok(found) => (found, Table::AsItIs),
            // Intact, but of no version that is known.
            Err(e @ Error::UnsupportedVersion { .. }) if is_sealed(data) => return Err(e),
            Err(e) => {
                let spare = spare::find(data).and_then(spare::restore);
                let restored = spare.as_deref().and_then(|head| parse(head).ok()).map(|found| (found, Table::Copied));
                restored.or_else(|| flip_back(&data[..end])).ok_or(e)?
            }
        };
        let own = sections.iter().find(|s| s.id == directory::SPARE.as_bytes());
        let spare = own.and_then(|section| {
            let in_place = || data.get(section.range.clone()).and_then(spare::unchecked).map(<[u8]>::to_vec);
            spare::find(data).and_then(spare::restore).or_else(in_place)
        });
        Ok((Head { data, version, length, sections, spare }, table))
    }

    pub(super) fn section(&self, name: &str) -> Option<&Section> {
        self.sections.iter().find(|s| s.id == name.as_bytes())
    }

    /// Where the end marker should be, if there is something else.
    pub(super) fn overwritten_marker(&self) -> Option<Range<usize>> {
        let marker = self.length - END_MARKER.len()..self.length;
        self.data.get(marker.clone()).is_some_and(|bytes| bytes != END_MARKER).then_some(marker)
    }

    /// Whether names, order and flags of the sections and the version are those that writers have: such a field holds no wrong value by
    /// chance.
    pub(super) fn is_usual(&self) -> bool {
        let places = self.sections.iter().map(|s| directory::KNOWN.iter().position(|name| name.as_bytes() == s.id));
        let Some(places) = places.collect::<Option<Vec<_>>>() else { return false };
        let skippable = [directory::METADATA, directory::LOSSLESS, directory::SPARE];
        let flags = |s: &Section| s.skippable == skippable.iter().any(|name| name.as_bytes() == s.id);
        self.version.1 == 0 && places.is_sorted_by(|a, b| a < b) && self.sections.iter().all(flags)
    }

    /// A section: as it is, from the spare copy, or, if `flips`, with one bit flipped back. `None` if the file ends within it.
    pub(super) fn take(&self, section: &Section, flips: bool) -> Option<Mended> {
        let range = section.range.clone();
        let found = self.data.get(range.clone());
        let crc = found.map(crc32fast::hash);
        if let Some(bytes) = found.filter(|_| crc == Some(section.crc)) {
            return Some(Mended::AsItIs(bytes.to_vec()));
        }
        let copy = self.spare.as_ref().and_then(|head| head.get(range));
        if let Some(bytes) = copy.filter(|bytes| crc32fast::hash(bytes) == section.crc) {
            return Some(Mended::Copied(bytes.to_vec()));
        }
        let mut bytes = found?.to_vec();
        match one_bit(bytes.len(), section.crc ^ crc?).filter(|_| flips) {
            Some(Some(patch)) => {
                patch.apply(&mut bytes);
                Some(Mended::Flipped(bytes, patch.place()))
            }
            _ => Some(Mended::Unsound(bytes)),
        }
    }
}

/// Bytes of a file beyond which nothing is believed: sums of places do not overflow.
const MAX_LENGTH: u64 = 1 << 48;

/// Version, length of the file, sections.
type Parsed = ((u16, u16, u16), usize, Vec<Section>);

/// Bytes of preamble and section table.
pub(super) fn table_length(sections: usize) -> usize {
    PREAMBLE + sections * ENTRY
}

/// Whether preamble and section table are those of their checksum.
fn is_sealed(data: &[u8]) -> bool {
    let stated = data.get(PREAMBLE - 4..PREAMBLE);
    stated.is_some_and(|crc| table_crc(data).is_some_and(|right| right.to_le_bytes() == crc))
}

/// The section table at the start of a file that may be longer or shorter than it says.
fn parse(data: &[u8]) -> Result<Parsed> {
    if !data.starts_with(&MAGIC) || !is_sealed(data) {
        // The error that says what the bytes are instead.
        return Err(Directory::read(data).err().unwrap_or_else(|| broken("the section table is damaged")));
    }
    let mut r = ByteReader::new(data, 0, "section table");
    r.bytes(MAGIC.len())?;
    let version = (r.u16()?, r.u16()?, r.u16()?);
    if !reads_version(version) {
        return Err(Error::UnsupportedVersion { found: version });
    }
    let (count, length) = (usize::from(r.u16()?), r.u64()?);
    if r.u32()? != 0 {
        return Err(broken("the reserved field is not 0"));
    }
    // The checksum.
    r.u32()?;
    if count > MAX_SECTIONS {
        return Err(broken("too many sections"));
    }
    if length > MAX_LENGTH {
        return Err(broken("longer than any file"));
    }
    let mut sections = Vec::new();
    let mut start = PREAMBLE + count * ENTRY;
    for _ in 0..count {
        let id = r.array()?;
        let (flags, bytes, crc) = (r.u32()?, r.u64()?, r.u32()?);
        if flags & !directory::SKIPPABLE != 0 {
            return Err(broken("reserved flags are set"));
        }
        let stop = usize::try_from(bytes).ok().and_then(|n| start.checked_add(n)).filter(|&stop| stop as u64 <= length);
        let stop = stop.ok_or_else(|| broken("a section is longer than any file"))?;
        sections.push(Section { id, skippable: flags & directory::SKIPPABLE != 0, range: start..stop, crc });
        start = stop;
    }
    if start.checked_add(END_MARKER.len()).map(|n| n as u64) != Some(length) {
        return Err(broken("the sections do not add up to the file"));
    }
    // What a reader refuses of an intact file: a repaired one would have it still.
    Directory::of(version, sections.clone()).check_names()?;
    Ok((version, length as usize, sections))
}

fn broken(what: &str) -> Error {
    Error::corrupt("section table", 0, what)
}

/// The section table with the one bit flipped back that its checksum names.
fn flip_back(head: &[u8]) -> Option<(Parsed, Table)> {
    // In the number of sections, which says how far the checksum goes.
    for bit in 0..16 {
        let mut changed = head.to_vec();
        *changed.get_mut(14 + bit / 8)? ^= 1 << (bit % 8);
        if let Ok(parsed) = parse(&changed) {
            return Some((parsed, Table::Flipped(None)));
        }
    }
    let (crc, stated) = (table_crc(head)?, head.get(..PREAMBLE)?.last_chunk()?);
    let difference = crc ^ u32::from_le_bytes(*stated);
    let count = usize::from(u16::from_le_bytes([head[14], head[15]]));
    let entries = PREAMBLE..PREAMBLE + count * ENTRY;
    let mut summed = [&head[..PREAMBLE - 4], &head[entries.clone()]].concat();
    let mut changed = head.to_vec();
    let mut entry = None;
    match one_bit(summed.len(), difference)? {
        Some(patch) => {
            patch.apply(&mut summed);
            entry = patch.place().checked_sub(PREAMBLE - 4).map(|place| place / ENTRY);
            let (preamble, table) = summed.split_at(PREAMBLE - 4);
            changed[..PREAMBLE - 4].copy_from_slice(preamble);
            changed[entries].copy_from_slice(table);
        }
        // In the checksum itself.
        None => changed[PREAMBLE - 4..PREAMBLE].copy_from_slice(&crc.to_le_bytes()),
    }
    Some((parse(&changed).ok()?, Table::Flipped(entry)))
}

/// Where bytes of a range are in a file that has lost or gained bytes before them: at the same distance from its end.
pub(super) fn from_end(range: Range<usize>, stated: usize, length: usize) -> Option<Range<usize>> {
    let shift = |at: usize| (at + length).checked_sub(stated);
    Some(shift(range.start)?..shift(range.end)?)
}
