//! Changes to one section of a file, lengths kept right: bytes alone would seldom get past the section table.

use csbrdf::codec::sample::SplitMix64;
use libfuzzer_sys::fuzzer_mutate;

use crate::bodies::golden::chosen;
use crate::bodies::sections::{Section, join, split};

/// Mutates an input that is `head` bytes and a file: mostly one section, sometimes the head, sometimes anything.
pub fn sections(data: &mut [u8], size: usize, max_size: usize, seed: u32, head: usize) -> usize {
    let mut random = SplitMix64(seed.into());
    let mut below = |n: usize| (random.next_u64() % n as u64) as usize;
    let way = below(8);
    if size <= head || way == 0 {
        return fuzzer_mutate(data, size, max_size);
    }
    if head > 0 && way <= 2 {
        fuzzer_mutate(&mut data[..head], head, head);
        return size;
    }
    let Some((preamble, mut sections)) = split(&data[head..size]) else {
        // Not a file yet: made one.
        let file = chosen(below(256) as u8);
        return put(data, head, file, max_size).unwrap_or(size);
    };
    if sections.is_empty() {
        return fuzzer_mutate(data, size, max_size);
    }
    let preamble = preamble.to_vec();
    let at = below(sections.len());
    match below(16) {
        // The same section of another file, or all but this one.
        0 | 1 => {
            let (other, donors) = split(chosen(below(256) as u8)).expect("golden files have sections");
            if let Some(donor) = donors.iter().find(|donor| donor.id() == sections[at].id()) {
                sections[at] = donor.clone();
            }
            if below(4) == 0 {
                let mut mixed = donors.clone();
                if let Some(place) = mixed.iter_mut().find(|s| s.id() == sections[at].id()) {
                    *place = sections[at].clone();
                }
                return put(data, head, &join(other, &mixed), max_size).unwrap_or(size);
            }
        }
        2 => {
            sections.remove(at);
        }
        _ => change(&mut sections[at], &mut below),
    }
    put(data, head, &join(&preamble, &sections), max_size).unwrap_or(size)
}

/// The bytes of a section changed. What the index gives the place of keeps its length.
fn change(section: &mut Section, below: &mut impl FnMut(usize) -> usize) {
    let length = section.bytes.len();
    if [b"RECS", b"EXCT"].iter().any(|id| *id == section.id()) && length > 0 {
        let from = below(length);
        let window = &mut section.bytes[from..];
        let window = &mut window[..(1 + below(64)).min(length - from)];
        fuzzer_mutate(window, window.len(), window.len());
        return;
    }
    let most = length + 16;
    section.bytes.resize(most, 0);
    let changed = fuzzer_mutate(&mut section.bytes, length, most);
    section.bytes.truncate(changed);
}

/// The file behind the head, if it fits.
fn put(data: &mut [u8], head: usize, file: &[u8], max_size: usize) -> Option<usize> {
    let size = head + file.len();
    (size <= max_size).then(|| {
        data[head..size].copy_from_slice(file);
        size
    })
}
