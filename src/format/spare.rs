//! The section SPAR (spec section 3.11): a copy of all that blocks cannot be decoded without, at the other end of the file.

use crate::format::directory::{self, Directory, ENTRY, PREAMBLE};

/// Bytes after the copy: its length, checksum, name.
const TRAILER: usize = 12;
/// The last bytes of the section, by which it is found where the section table is lost.
const NAME: &[u8; 4] = b"SPAR";
/// Most places that are looked at for the section.
const MAX_FOUND: usize = 8;

/// The copy in a section, its checksum verified: the bytes of the file before RECS, the checksums at bytes 28 to 31 and of the section
/// itself as zero.
pub(crate) fn read(section: &[u8]) -> Option<&[u8]> {
    // The copy, its length, the CRC-32 of both, the section's name.
    let at = section.len().checked_sub(TRAILER)?;
    let sound = word(section, at)? as usize == at && section.ends_with(NAME);
    (sound && word(section, at + 4)? == crc32fast::hash(&section[..at + 4])).then_some(&section[..at])
}

/// The number at a place.
fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|word| u32::from_le_bytes(*word))
}

/// The copy in a section that may be damaged: what is taken from it has a checksum in the section table.
pub(crate) fn unchecked(section: &[u8]) -> Option<&[u8]> {
    section.get(..section.len().checked_sub(TRAILER)?)
}

/// The section of a file whose section table is lost: the last that there is.
pub(crate) fn find(data: &[u8]) -> Option<&[u8]> {
    let names = (TRAILER..=data.len()).rev().filter(|&end| data[end - 4..end] == *NAME).take(MAX_FOUND);
    names.into_iter().find_map(|end| {
        let length = word(data, end - TRAILER)? as usize;
        let section = &data[end.checked_sub(length.checked_add(TRAILER)?)?..end];
        read(section).map(|_| section)
    })
}

/// The bytes of the file before RECS, from a section.
pub(crate) fn restore(section: &[u8]) -> Option<Vec<u8>> {
    let mut head = read(section)?.to_vec();
    let entry = own_entry(&head)?;
    let crc = crc32fast::hash(section);
    head[entry + 16..entry + 20].copy_from_slice(&crc.to_le_bytes());
    seal(&mut head)?;
    Some(head)
}

/// Whether the section holds what it is a copy of.
pub(crate) fn agrees(data: &[u8], directory: &Directory) -> bool {
    let Some(section) = directory.find(directory::SPARE) else { return true };
    restore(&data[section.range.clone()]).is_some_and(|head| data.starts_with(&head))
}

/// Place of the section's own entry in the section table.
fn own_entry(head: &[u8]) -> Option<usize> {
    let count = usize::from(u16::from_le_bytes([*head.get(14)?, *head.get(15)?]));
    let places = (0..count).map(|i| PREAMBLE + i * ENTRY);
    places.into_iter().find(|&at| head.get(at..at + ENTRY).is_some_and(|entry| entry.starts_with(NAME)))
}

/// Writes the checksum of preamble and section table.
fn seal(head: &mut [u8]) -> Option<()> {
    let crc = directory::table_crc(head)?;
    head[PREAMBLE - 4..PREAMBLE].copy_from_slice(&crc.to_le_bytes());
    Some(())
}

/// Bytes of the section in a file with `head` bytes before RECS.
pub(crate) const fn length(head: usize) -> usize {
    head + TRAILER
}

/// Fills in the section of a file that was written with zeros in its place, as the last.
#[cfg(feature = "encode")]
pub(crate) fn fill(file: &mut [u8]) {
    let Some(entry) = own_entry(file) else { return };
    let reserved = u64::from_le_bytes(file[entry + 8..entry + 16].try_into().expect("eight bytes")) as usize;
    let (head, end) = (reserved - TRAILER, file.len() - crate::format::END_MARKER.len());
    let mut section = file[..head].to_vec();
    section[PREAMBLE - 4..PREAMBLE].fill(0);
    section[entry + 16..entry + 20].fill(0);
    section.extend_from_slice(&(head as u32).to_le_bytes());
    section.extend_from_slice(&crc32fast::hash(&section).to_le_bytes());
    section.extend_from_slice(NAME);
    file[entry + 16..entry + 20].copy_from_slice(&crc32fast::hash(&section).to_le_bytes());
    file[end - reserved..end].copy_from_slice(&section);
    seal(file).expect("a section table that was just written");
}

#[cfg(all(test, feature = "encode"))]
mod tests;
