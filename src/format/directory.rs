//! Preamble and section table (spec section 3.1): what is where, checked before anything else is looked at.

use std::ops::Range;

use crate::base::bits::ByteReader;
use crate::base::error::{Error, Result};
use crate::base::limits::MAX_SECTIONS;
use crate::format::{END_MARKER, MAGIC, is_compact, reads_version};

/// Bytes before the section table.
pub(crate) const PREAMBLE: usize = 32;
/// Bytes of one entry of the section table.
pub(crate) const ENTRY: usize = 20;

/// Section identifiers that this version knows, in file order.
pub(crate) const GRID: &str = "GRID";
pub(crate) const CODING: &str = "CODE";
pub(crate) const PARTITION: &str = "PART";
pub(crate) const PROBABILITIES: &str = "PROB";
pub(crate) const PROFILE: &str = "GRAZ";
pub(crate) const INDEX: &str = "INDX";
pub(crate) const METADATA: &str = "META";
pub(crate) const RECORDS: &str = "RECS";
pub(crate) const LOSSLESS: &str = "EXCT";
pub(crate) const SPARE: &str = "SPAR";
/// All of them, in the order in which writers put them.
pub(crate) const KNOWN: [&str; 10] =
    [GRID, CODING, PARTITION, PROBABILITIES, PROFILE, INDEX, METADATA, RECORDS, LOSSLESS, SPARE];

/// Name used in errors for the bytes before the first section.
const DIRECTORY: &str = "section table";

/// Flag of sections that a reader may skip when it does not know them.
pub(crate) const SKIPPABLE: u32 = 1;

/// One section of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Section {
    /// Four ASCII characters.
    pub id: [u8; 4],
    /// True if a reader that does not know the section may go on.
    pub skippable: bool,
    /// Bytes of the section within the file.
    pub range: Range<usize>,
    /// CRC-32 of these bytes.
    pub crc: u32,
}

impl Section {
    /// The identifier as text.
    pub fn name(&self) -> String {
        self.id.escape_ascii().to_string()
    }
}

/// The sections of a file, by name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Directory {
    version: (u16, u16, u16),
    sections: Vec<Section>,
}

impl Directory {
    /// A directory of sections that are put together anew.
    pub(crate) fn of(version: (u16, u16, u16), sections: Vec<Section>) -> Directory {
        Directory { version, sections }
    }

    /// Reads preamble, section table and end marker; touches no section.
    pub(crate) fn read(data: &[u8]) -> Result<Directory> {
        // Magic: eight bytes that show text-mode damage.
        if !data.starts_with(&MAGIC) {
            return Err(not_csbrdf(data));
        }
        let mut preamble = ByteReader::new(data, 0, DIRECTORY);
        preamble.bytes(MAGIC.len())?;
        // Version: major, minor, draft number (0 in final versions).
        let found = (preamble.u16()?, preamble.u16()?, preamble.u16()?);
        if !reads_version(found) {
            return Err(Error::UnsupportedVersion { found });
        }
        // Number of sections.
        let count = usize::from(preamble.u16()?);
        if count == 0 || count > MAX_SECTIONS {
            return Err(preamble.corrupt(format!("{count} sections, allowed are 1 to {MAX_SECTIONS}")));
        }
        // Length of the whole file, so that truncation is certain to be seen.
        let length = preamble.u64()?;
        if (data.len() as u64) < length {
            return Err(Error::Truncated { section: "file", expected: length, got: data.len() as u64 });
        }
        if data.len() as u64 > length {
            return Err(Error::corrupt("file", length, format!("{} bytes follow the end", data.len() as u64 - length)));
        }
        // Reserved, zero.
        let reserved = preamble.u32()?;
        // CRC-32 of the preamble up to here and the section table.
        let crc = preamble.u32()?;
        let mut table = ByteReader::new(data, 0, DIRECTORY);
        table.bytes(PREAMBLE)?;
        let entries = table.bytes(count * ENTRY)?;
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&data[..PREAMBLE - 4]);
        hasher.update(entries);
        check_crc(DIRECTORY, 0, crc, hasher.finalize())?;
        if reserved != 0 {
            return Err(Error::corrupt(DIRECTORY, 24, format!("reserved field holds {reserved}, not 0")));
        }

        let mut table = ByteReader::new(entries, PREAMBLE as u64, DIRECTORY);
        let mut sections = Vec::with_capacity(count);
        let mut start = PREAMBLE + entries.len();
        let end = data.len().saturating_sub(END_MARKER.len());
        for _ in 0..count {
            let at = table.offset();
            // Identifier, flags, length in bytes, CRC-32. Sections follow each other without gaps.
            let id = table.array()?;
            let flags = table.u32()?;
            let length = table.u64()?;
            let crc = table.u32()?;
            if flags & !SKIPPABLE != 0 {
                return Err(Error::corrupt(DIRECTORY, at + 4, format!("reserved flags {flags:#x} are set")));
            }
            let stop = usize::try_from(length).ok().and_then(|n| start.checked_add(n)).filter(|&stop| stop <= end);
            let Some(stop) = stop else {
                let what = format!("section {} of {length} bytes ends beyond the file", id.escape_ascii());
                return Err(Error::corrupt(DIRECTORY, at + 8, what));
            };
            sections.push(Section { id, skippable: flags & SKIPPABLE != 0, range: start..stop, crc });
            start = stop;
        }
        if start != end {
            let what = format!("sections end at {start}, the end marker begins at {end}");
            return Err(Error::corrupt(DIRECTORY, PREAMBLE as u64, what));
        }
        // End marker: the last eight bytes.
        if data[end..] != END_MARKER {
            return Err(Error::corrupt("end marker", end as u64, "missing; the file was cut or overwritten"));
        }
        let directory = Directory { version: found, sections };
        directory.check_names()?;
        Ok(directory)
    }

    /// Names are ASCII and occur once; what is unknown may be skipped.
    pub(crate) fn check_names(&self) -> Result<()> {
        for (i, section) in self.sections.iter().enumerate() {
            let refuse = |what: &str| {
                let place = (PREAMBLE + i * ENTRY) as u64;
                Err(Error::corrupt(DIRECTORY, place, format!("section {} {what}", section.name())))
            };
            if !section.id.is_ascii() {
                return refuse("has a name that is not ASCII");
            }
            if self.sections[..i].iter().any(|other| other.id == section.id) {
                return refuse("occurs twice");
            }
            if !self.knows(section) && !section.skippable {
                return refuse("is unknown and may not be skipped");
            }
        }
        Ok(())
    }

    /// Whether the specification of this version knows the section; EXCT came with draft 3 (A.2).
    fn knows(&self, section: &Section) -> bool {
        let known = KNOWN.iter().any(|name| name.as_bytes() == section.id);
        known && (section.id != LOSSLESS.as_bytes() || is_compact(self.version.2))
    }

    /// Major version, minor version, draft number.
    pub fn version(&self) -> (u16, u16, u16) {
        self.version
    }

    /// Bytes of the file.
    pub fn file_length(&self) -> usize {
        let last = self.sections.last().map_or(PREAMBLE, |section| section.range.end);
        last + END_MARKER.len()
    }

    /// All sections in file order.
    pub fn sections(&self) -> &[Section] {
        &self.sections
    }

    /// The section named so, if present.
    pub(crate) fn find(&self, name: &str) -> Option<&Section> {
        self.sections.iter().find(|s| s.id == name.as_bytes())
    }

    /// A reader over the section named so, its CRC checked.
    pub(crate) fn open<'a>(&self, data: &'a [u8], name: &'static str) -> Result<ByteReader<'a>> {
        let section = self.require(name)?;
        let bytes = &data[section.range.clone()];
        let offset = section.range.start as u64;
        check_crc(name, offset, section.crc, crc32fast::hash(bytes))?;
        Ok(ByteReader::new(bytes, offset, name))
    }

    /// The section named so.
    pub(crate) fn require(&self, name: &'static str) -> Result<&Section> {
        self.find(name).ok_or_else(|| Error::corrupt(DIRECTORY, PREAMBLE as u64, format!("section {name} is missing")))
    }
}

/// CRC-32 of the preamble and the section table at the start of a file, as it should be; `None` if the table is cut.
pub(crate) fn table_crc(head: &[u8]) -> Option<u32> {
    let count = usize::from(u16::from_le_bytes([*head.get(14)?, *head.get(15)?]));
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(head.get(..PREAMBLE - 4)?);
    hasher.update(head.get(PREAMBLE..PREAMBLE + count * ENTRY)?);
    Some(hasher.finalize())
}

/// Fails unless the checksums agree. No build goes past them, be it with `cfg(fuzzing)`: fuzz targets put them right instead.
pub(crate) fn check_crc(section: &'static str, offset: u64, expected: u32, got: u32) -> Result<()> {
    if expected == got {
        return Ok(());
    }
    let what = format!("checksum is {got:08x}, expected {expected:08x}; the bytes were damaged, fetch them again");
    Err(Error::corrupt(section, offset, what))
}

fn not_csbrdf(data: &[u8]) -> Error {
    let mut unix = MAGIC.to_vec();
    unix.remove(4);
    if !data.is_empty() && MAGIC.starts_with(data) {
        return Error::Truncated { section: DIRECTORY, expected: PREAMBLE as u64, got: data.len() as u64 };
    }
    let looks_like = match data {
        [] => "the file is empty",
        d if d.starts_with(&unix[..4]) => "line ends were converted: transfer the file in binary mode",
        d if d.len() > 3 && d[0] == MAGIC[0] & 0x7F && d[1..4] == MAGIC[1..4] => {
            "the high bit was stripped: transfer the file in binary mode"
        }
        [0x5A, 0, 0, 0, ..] => "it looks like a MERL table",
        d if d.starts_with(b"tensor_file") => "it looks like an RGL tensor file",
        d if d.iter().take(256).all(|&b| b.is_ascii_graphic() || b.is_ascii_whitespace()) => "it looks like text",
        _ => "unknown contents",
    };
    Error::NotCsbrdf { looks_like }
}

#[cfg(all(test, feature = "encode"))]
mod tests;
