//! What blocks cannot be decoded without: the section table and the sections before RECS, mended as far as a checksum proves it.

use std::ops::Range;

use super::mend::one_bit;
use super::{Damage, Outcome};
use crate::bits::ByteReader;
use crate::error::{Error, Result};
use crate::format::directory::{self, Directory, ENTRY, PREAMBLE, Section, table_crc};
use crate::format::{END_MARKER, MAGIC, MAX_SECTIONS, reads_version, spare};

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

/// A section's bytes.
pub(super) struct Mended {
    pub(super) bytes: Vec<u8>,
    /// Whether its checksum is right.
    pub(super) sound: bool,
}

impl<'a> Head<'a> {
    /// Finds the section table: as it is, in the spare copy, or with one bit flipped back.
    pub(super) fn find(data: &'a [u8], damage: &mut Vec<Damage>) -> Result<Head<'a>> {
        let as_it_is = parse(data);
        let end = data.len().min(PREAMBLE + MAX_SECTIONS * ENTRY);
        let (version, length, sections, remedy) = match as_it_is {
            Ok((version, length, sections)) => (version, length, sections, None),
            // Intact, but of no version that is known.
            Err(e @ Error::UnsupportedVersion { .. }) if is_sealed(data) => return Err(e),
            Err(e) => {
                let spare = spare::find(data).and_then(spare::restore);
                let restored = spare.as_deref().and_then(|head| parse(head).ok());
                let restored = restored.map(|found| (found, "taken from the spare copy"));
                let flipped = || flip_back(&data[..end]).map(|found| (found, "one bit was flipped"));
                let Some(((version, length, sections), remedy)) = restored.or_else(flipped) else {
                    return Err(e);
                };
                (version, length, sections, Some(remedy))
            }
        };
        if let Some(what) = remedy {
            let table = 0..PREAMBLE + sections.len() * ENTRY;
            damage.push(Damage::of_section("section table", table, what, Outcome::Restored));
        }
        if data.len() != length {
            let what = format!("the file has {} bytes of {length}", data.len());
            let (a, b) = (data.len().min(length), data.len().max(length));
            damage.push(Damage::of_section("file", a..b, what, Outcome::Lost));
        }
        let marker = length - END_MARKER.len()..length;
        if data.get(marker.clone()).is_some_and(|bytes| bytes != END_MARKER) {
            damage.push(Damage::of_section("end marker", marker, "overwritten", Outcome::Restored));
        }
        let own = sections.iter().find(|s| s.id == directory::SPARE.as_bytes());
        let spare = own.and_then(|section| {
            let in_place = || data.get(section.range.clone()).and_then(spare::unchecked).map(<[u8]>::to_vec);
            spare::find(data).and_then(spare::restore).or_else(in_place)
        });
        Ok(Head { data, version, length, sections, spare })
    }

    pub(super) fn section(&self, name: &str) -> Option<&Section> {
        self.sections.iter().find(|s| s.id == name.as_bytes())
    }

    /// A section, mended if it has to be; `None` if the file has none or ends within it.
    pub(super) fn take(&self, name: &'static str, damage: &mut Vec<Damage>) -> Option<Mended> {
        let section = self.section(name)?;
        let range = section.range.clone();
        let found = self.data.get(range.clone());
        let crc = found.map(crc32fast::hash);
        if let Some(bytes) = found.filter(|_| crc == Some(section.crc)) {
            return Some(Mended { bytes: bytes.to_vec(), sound: true });
        }
        let copy = self.spare.as_ref().and_then(|head| head.get(range.clone()));
        if let Some(bytes) = copy.filter(|bytes| crc32fast::hash(bytes) == section.crc) {
            damage.push(Damage::of_section(name, range, "taken from the spare copy", Outcome::Restored));
            return Some(Mended { bytes: bytes.to_vec(), sound: true });
        }
        let Some(found) = found else {
            damage.push(Damage::of_section(name, range, "beyond the end of the file", Outcome::Lost));
            return None;
        };
        let mut bytes = found.to_vec();
        match one_bit(bytes.len(), section.crc ^ crc?) {
            Some(Some(patch)) => {
                patch.apply(&mut bytes);
                let at = range.start + patch.place();
                damage.push(Damage::of_section(name, at..at + 1, "one bit was flipped", Outcome::Restored));
                Some(Mended { bytes, sound: true })
            }
            _ => Some(Mended { bytes, sound: false }),
        }
    }
}

/// Bytes of a file beyond which nothing is believed: sums of places do not overflow.
const MAX_LENGTH: u64 = 1 << 48;

type Table = ((u16, u16, u16), usize, Vec<Section>);

/// Whether preamble and section table are those of their checksum.
fn is_sealed(data: &[u8]) -> bool {
    let stated = data.get(PREAMBLE - 4..PREAMBLE);
    stated.is_some_and(|crc| table_crc(data).is_some_and(|right| right.to_le_bytes() == crc))
}

/// The section table at the start of a file that may be longer or shorter than it says.
fn parse(data: &[u8]) -> Result<Table> {
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
    // Reserved, and the checksum.
    r.bytes(PREAMBLE - 24)?;
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
        let stop = usize::try_from(bytes).ok().and_then(|n| start.checked_add(n)).filter(|&stop| stop as u64 <= length);
        let stop = stop.ok_or_else(|| broken("a section is longer than any file"))?;
        sections.push(Section { id, skippable: flags & 1 != 0, range: start..stop, crc });
        start = stop;
    }
    if start.checked_add(END_MARKER.len()).map(|n| n as u64) != Some(length) {
        return Err(broken("the sections do not add up to the file"));
    }
    Ok((version, length as usize, sections))
}

fn broken(what: &str) -> Error {
    Error::corrupt("section table", 0, what)
}

/// The section table with the one bit flipped back that its checksum tells.
fn flip_back(head: &[u8]) -> Option<Table> {
    // In the number of sections, which says how far the checksum goes.
    for bit in 0..16 {
        let mut changed = head.to_vec();
        *changed.get_mut(14 + bit / 8)? ^= 1 << (bit % 8);
        if let Ok(table) = parse(&changed) {
            return Some(table);
        }
    }
    let (crc, stated) = (table_crc(head)?, head.get(..PREAMBLE)?.last_chunk()?);
    let difference = crc ^ u32::from_le_bytes(*stated);
    let count = usize::from(u16::from_le_bytes([head[14], head[15]]));
    let entries = PREAMBLE..PREAMBLE + count * ENTRY;
    let mut summed = [&head[..PREAMBLE - 4], &head[entries.clone()]].concat();
    let mut changed = head.to_vec();
    match one_bit(summed.len(), difference)? {
        Some(patch) => {
            patch.apply(&mut summed);
            let (preamble, table) = summed.split_at(PREAMBLE - 4);
            changed[..PREAMBLE - 4].copy_from_slice(preamble);
            changed[entries].copy_from_slice(table);
        }
        // In the checksum itself.
        None => changed[PREAMBLE - 4..PREAMBLE].copy_from_slice(&crc.to_le_bytes()),
    }
    parse(&changed).ok()
}

/// Where bytes of a range are in a file that has lost or gained bytes before them: at the same distance from its end.
pub(super) fn from_end(range: Range<usize>, stated: usize, length: usize) -> Option<Range<usize>> {
    let shift = |at: usize| (at + length).checked_sub(stated);
    Some(shift(range.start)?..shift(range.end)?)
}
