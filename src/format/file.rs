//! A whole file from its sections (spec section 3): preamble, section table, sections, end marker.

use crate::base::bits::ByteWriter;
use crate::format::directory::{ENTRY, PREAMBLE, RECORDS, SKIPPABLE, SPARE};
use crate::format::{END_MARKER, MAGIC, spare};

/// As [`write_file`], with a spare copy of the sections before RECS at the end.
pub(crate) fn write_file_with_spare<N: AsRef<[u8]>>(
    version: (u16, u16, u16),
    sections: &[(N, bool, Vec<u8>)],
) -> Vec<u8> {
    let mut sections: Vec<(&[u8], bool, Vec<u8>)> =
        sections.iter().map(|(name, skippable, bytes)| (name.as_ref(), *skippable, bytes.clone())).collect();
    let table = PREAMBLE + (sections.len() + 1) * ENTRY;
    let before = sections.iter().take_while(|(name, ..)| *name != RECORDS.as_bytes());
    let head = table + before.map(|(_, _, bytes)| bytes.len()).sum::<usize>();
    sections.push((SPARE.as_bytes(), true, vec![0; spare::length(head)]));
    let mut file = write_file(version, &sections);
    spare::fill(&mut file);
    file
}

/// A whole file of a version from its sections: four bytes of name, skippable, bytes.
pub(crate) fn write_file<N: AsRef<[u8]>>(version: (u16, u16, u16), sections: &[(N, bool, Vec<u8>)]) -> Vec<u8> {
    let body: usize = sections.iter().map(|s| s.2.len()).sum();
    let length = PREAMBLE + sections.len() * ENTRY + body + END_MARKER.len();
    let mut table = ByteWriter::default();
    for (name, skippable, bytes) in sections {
        debug_assert_eq!(name.as_ref().len(), 4, "a name");
        table.bytes(name.as_ref());
        table.u32(if *skippable { SKIPPABLE } else { 0 });
        table.u64(bytes.len() as u64);
        table.u32(crc32fast::hash(bytes));
    }
    let mut file = ByteWriter(Vec::with_capacity(length));
    file.bytes(&MAGIC);
    file.u16(version.0);
    file.u16(version.1);
    file.u16(version.2);
    file.u16(sections.len() as u16);
    file.u64(length as u64);
    file.u32(0);
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&file.0);
    hasher.update(&table.0);
    file.u32(hasher.finalize());
    file.bytes(&table.0);
    for (_, _, bytes) in sections {
        file.bytes(bytes);
    }
    file.bytes(&END_MARKER);
    file.0
}
