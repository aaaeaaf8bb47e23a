//! Right checksums for changed bytes. The decoder of the fuzz targets does not look at them; ordinary tests of the same
//! inputs, whatever flags they are built with, need them to get as far.

use std::borrow::Cow;

use csbrdf::decode::Reader;

use super::sections::{join, split};

/// The bytes as a body is to open them.
pub fn sealed(file: &[u8]) -> Cow<'_, [u8]> {
    if cfg!(all(fuzzing, not(test))) { file.into() } else { seal(file).unwrap_or_else(|| file.to_vec()).into() }
}

/// `None` if the file has no sections.
pub fn seal(file: &[u8]) -> Option<Vec<u8>> {
    let mut file = seal_sections(file)?;
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
        file = seal_sections(&file)?;
    }
    Some(file)
}

/// What ends in a checksum within the sections, with what stands before it in the sum: records and parts of EXCT by the
/// number of their block.
fn parts(reader: &Reader<&[u8]>, file: &[u8]) -> Vec<(Vec<u8>, std::ops::Range<usize>)> {
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

/// Checksums of the sections, then that of the preamble and the table.
fn seal_sections(file: &[u8]) -> Option<Vec<u8>> {
    let (preamble, mut sections) = split(file)?;
    sections.iter_mut().for_each(|s| s.crc = crc32fast::hash(&s.bytes).to_le_bytes());
    let mut sealed = join(preamble, &sections);
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&sealed[..28]);
    hasher.update(&sealed[32..32 + 20 * sections.len()]);
    sealed[28..32].copy_from_slice(&hasher.finalize().to_le_bytes());
    Some(sealed)
}
