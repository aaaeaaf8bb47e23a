//! Right checksums for changed bytes: what is changed is then seen by all that comes after a checksum, by the same reader that everybody has.

use std::borrow::Cow;
use std::ops::Range;

use csbrdf::decode::Reader;

const PREAMBLE: usize = 32;
const ENTRY: usize = 20;
/// After the copy in SPAR: its length, its checksum, the name.
const SPARE: &[u8] = b"SPAR";

/// The bytes as a body is to open them.
pub fn sealed(file: &[u8]) -> Cow<'_, [u8]> {
    seal(file).into()
}

/// Every checksum put right that can be found, whatever else is wrong.
pub fn seal(file: &[u8]) -> Vec<u8> {
    let mut file = file.to_vec();
    seal_sections(&mut file);
    // Records are found by the index, which must be right for that.
    if let Ok(reader) = Reader::open(&file[..]) {
        let parts = parts(&reader, &file);
        for (number, range) in parts {
            if range.len() >= 4 {
                let (body, end) = (range.start..range.end - 4, range.end - 4..range.end);
                let crc = crc32fast::hash(&[&number[..], &file[body]].concat());
                file[end].copy_from_slice(&crc.to_le_bytes());
            }
        }
        seal_sections(&mut file);
    }
    file
}

/// What ends in a checksum within the sections, with what stands before it in the sum: records and parts of EXCT by the
/// number of their block.
fn parts(reader: &Reader<&[u8]>, file: &[u8]) -> Vec<(Vec<u8>, Range<usize>)> {
    let number = |block: usize| (block as u32).to_le_bytes().to_vec();
    let blocks = 0..reader.block_count();
    let mut parts: Vec<_> =
        blocks.clone().map(|b| (number(b), reader.record_range(b).expect("an existing block"))).collect();
    if let Some(exact) = reader.directory().sections().iter().find(|s| s.name() == "EXCT") {
        let lengths = exact.range.start + 4 + 8 * reader.grid().channels().len();
        let mut at = lengths + 4 * blocks.len() + 4;
        if at <= exact.range.end {
            parts.push((Vec::new(), exact.range.start..at));
            for block in blocks {
                let entry = lengths + 4 * block;
                let length = u32::from_le_bytes(file[entry..entry + 4].try_into().expect("four bytes")) as usize;
                if at + length > exact.range.end {
                    break;
                }
                parts.push((number(block), at..at + length));
                at += length;
            }
        }
    }
    parts
}

/// Checksums of the sections that are within the file, then that of the preamble and the table.
fn seal_sections(file: &mut [u8]) {
    let Some(count) = file.get(14..16).map(|n| usize::from(u16::from_le_bytes([n[0], n[1]]))) else { return };
    let table = PREAMBLE..PREAMBLE + count * ENTRY;
    let mut start = table.end;
    for at in table.clone().step_by(ENTRY) {
        let Some(entry) = file.get(at..at + ENTRY) else { break };
        let (spare, length) = (&entry[..4] == SPARE, u64::from_le_bytes(entry[8..16].try_into().expect("eight bytes")));
        let end = usize::try_from(length).ok().and_then(|length| start.checked_add(length));
        let Some(section) = end.and_then(|end| file.get_mut(start..end)) else { break };
        if let Some(copy) = section.len().checked_sub(8).filter(|_| spare && section.ends_with(SPARE)) {
            let crc = crc32fast::hash(&section[..copy]);
            section[copy..copy + 4].copy_from_slice(&crc.to_le_bytes());
        }
        start += section.len();
        let crc = crc32fast::hash(section);
        file[at + 16..at + ENTRY].copy_from_slice(&crc.to_le_bytes());
    }
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&file[..file.len().min(PREAMBLE - 4)]);
    let Some(entries) = file.get(table) else { return };
    hasher.update(entries);
    file[PREAMBLE - 4..PREAMBLE].copy_from_slice(&hasher.finalize().to_le_bytes());
}
