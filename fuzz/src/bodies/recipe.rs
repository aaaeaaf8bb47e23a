//! A golden file with some of its fields changed, by a recipe of a few bytes: lengths, index and checksums agree again afterwards, so that
//! a reader gets as far as the change. The first byte chooses the file, six bytes a change follow.

use csbrdf::codec::sample::SplitMix64;
use csbrdf::decode::Reader;

use super::fields::{Field, Kind, fields};
use super::golden::chosen;
use super::index::{self, Entry};
use super::seal::seal;
use super::sections::{Section, join, split};

/// Bytes of a change.
const CHANGE: usize = 6;
/// Most changes of one file.
const MOST: usize = 6;

/// A file taken apart.
struct Parts {
    preamble: Vec<u8>,
    sections: Vec<Section>,
    axes: usize,
    channels: usize,
    /// Positions of each block.
    positions: Vec<usize>,
    records: Vec<Vec<u8>>,
    entries: Vec<Entry>,
    /// Whether the index has the plain form of drafts 1 and 2.
    plain: bool,
    /// Parts of EXCT by block; none if there is no such section.
    exact: Vec<Vec<u8>>,
    /// What was changed by hand stays as it was changed.
    keep: Vec<[u8; 4]>,
}

/// The changed file.
pub fn make(recipe: &[u8]) -> Option<Vec<u8>> {
    let (&file, changes) = recipe.split_first()?;
    let mut parts = Parts::of(chosen(file));
    changes.as_chunks::<CHANGE>().0.iter().take(MOST).for_each(|change| parts.change(*change));
    Some(seal(&parts.join()))
}

impl Parts {
    fn of(file: &[u8]) -> Parts {
        let reader = Reader::open(file).expect("golden files open");
        let (preamble, sections) = split(file).expect("golden files have sections");
        let blocks = 0..reader.block_count();
        let place = |block| reader.partition().block(block).expect("a block");
        let positions: Vec<usize> = blocks.clone().map(|block| place(block).positions()).collect();
        let records: Vec<_> = blocks.map(|block| file[reader.record_range(block).expect("a block")].to_vec()).collect();
        let (axes, channels) = (reader.grid().axes().len(), reader.grid().channels().len());
        let bytes = |id: &[u8]| sections.iter().find(|s| s.id() == id).map(|s| &s.bytes[..]);
        let plain = (1..3).contains(&reader.version().2);
        let coded = &bytes(b"INDX").expect("it was opened")[4..];
        let mut entries = if plain { Vec::new() } else { index::read(coded, &positions, channels) };
        for (entry, record) in entries.iter_mut().zip(&records) {
            assert_eq!(entry.length as usize, record.len(), "the index is read wrongly");
            // From now on by how much it differs from the record's.
            entry.length = 0;
        }
        let exact = bytes(b"EXCT").map(|bytes| lossless_parts(bytes, channels, records.len())).unwrap_or_default();
        let preamble = preamble.to_vec();
        Parts { preamble, sections, axes, channels, positions, records, entries, plain, exact, keep: Vec::new() }
    }

    /// Lengths of records and exact parts in their sections, but where these were changed by hand.
    fn join(mut self) -> Vec<u8> {
        let lengths: Vec<u32> = self.records.iter().map(|record| record.len() as u32).collect();
        let (records, blocks) = (self.records.concat(), self.records.len());
        let index = if self.plain {
            let mut bytes = self.bytes(b"INDX").to_vec();
            let width = usize::from(bytes.get(4).copied().unwrap_or(0)).clamp(1, 4);
            for (place, length) in bytes.get_mut(8..).unwrap_or_default().chunks_exact_mut(width).zip(&lengths) {
                place.copy_from_slice(&length.to_le_bytes()[..width]);
            }
            bytes
        } else {
            let mut entries = self.entries.clone();
            entries
                .iter_mut()
                .zip(&lengths)
                .for_each(|(entry, length)| entry.length = entry.length.wrapping_add(*length));
            index::write(&self.positions, &entries)
        };
        let exact = (!self.exact.is_empty()).then(|| {
            let head = 4 + 8 * self.channels;
            let mut bytes = self.bytes(b"EXCT").get(..head).unwrap_or_default().to_vec();
            self.exact.iter().for_each(|part| bytes.extend((part.len() as u32).to_le_bytes()));
            bytes.extend([0; 4]);
            assert_eq!(self.exact.len(), blocks);
            bytes.extend(self.exact.concat());
            bytes
        });
        for section in &mut self.sections {
            if !self.keep.iter().any(|id| id == section.id()) {
                match section.id() {
                    b"RECS" => section.bytes.clone_from(&records),
                    b"INDX" => section.bytes.clone_from(&index),
                    b"EXCT" if exact.is_some() => section.bytes = exact.clone().expect("just asked"),
                    _ => (),
                }
            }
        }
        join(&self.preamble, &self.sections)
    }

    fn bytes(&self, id: &[u8]) -> &[u8] {
        self.sections.iter().find(|s| s.id() == id).map_or(&[], |s| &s.bytes)
    }

    /// One change: what, which of it, how, and three bytes more.
    fn change(&mut self, [what, which, how, x, y, z]: [u8; CHANGE]) {
        let block = usize::from(which) % self.records.len();
        match what % 16 {
            0..6 => self.field(which, how, [x, y, z]),
            // Coded bytes of a record, but for its class and checksum.
            6..9 => inside(&mut self.records[block], 1, |bytes| change_bytes(bytes, how, [x, y, z])),
            9 => self.entry(block, how, [x, y, z]),
            10 if !self.exact.is_empty() => {
                inside(&mut self.exact[block], 0, |bytes| change_bytes(bytes, how, [x, y, z]))
            }
            11 => self.container(which, how, [x, y]),
            12 => self.table(which, how, x),
            // Class of validity and doublings.
            13 => self.records[block][0] = if how % 2 == 0 { x } else { self.records[block][0] ^ 1 << (x % 8) },
            14 => {
                let other = usize::from(x) % self.records.len();
                match how % 3 {
                    0 => self.records[block] = self.records[other].clone(),
                    1 => self.records.swap(block, other),
                    // Nothing but a class.
                    _ => self.records[block] = vec![y, 0, 0, 0, 0],
                }
            }
            // A whole record of other bytes.
            _ => {
                let mut random = SplitMix64(u64::from_le_bytes([which, how, x, y, z, 1, 2, 3]));
                let coded = (0..usize::from(z)).map(|_| random.next_u64() as u8);
                self.records[block] = [self.records[block][0]].into_iter().chain(coded).chain([0; 4]).collect();
            }
        }
    }

    /// What the index says of a block.
    fn entry(&mut self, block: usize, how: u8, [x, y, z]: [u8; 3]) {
        let number = i32::from(i16::from_le_bytes([x, y]));
        let Some(entry) = self.entries.get_mut(block) else { return };
        match how % 6 {
            0 => entry.length = i32::from(x as i8) as u32,
            1 => entry.errors = [x, y],
            _ => {
                let component = usize::from(z) % self.channels;
                let mean = &mut entry.means[component];
                *mean = match how % 6 {
                    2 => number,
                    3 => mean.wrapping_add(number),
                    4 => (1 << 24) + number.signum() * (number & 1),
                    _ => number.wrapping_mul(1 << 17),
                };
            }
        }
    }

    /// One field of a section.
    fn field(&mut self, which: u8, how: u8, [x, y, z]: [u8; 3]) {
        let at = usize::from(which) % self.sections.len();
        let id: [u8; 4] = self.sections[at].id().try_into().expect("four bytes");
        if id == *b"RECS" {
            let block = usize::from(x) % self.records.len();
            return inside(&mut self.records[block], 1, |bytes| change_bytes(bytes, how, [y, z, x]));
        }
        let bytes = &mut self.sections[at].bytes;
        let list = fields(&id, bytes, self.axes, self.channels, self.records.len());
        let Some(field) = list.get(usize::from(x) % list.len().max(1)) else { return };
        match how % 16 {
            12 => drop(bytes.drain(field.range())),
            13 => drop(bytes.splice(field.at..field.at, bytes[field.range()].to_vec())),
            // As another field of its kind.
            14 => {
                let same: Vec<&Field> = list.iter().filter(|other| other.kind == field.kind).collect();
                let other = same[usize::from(y) % same.len()].range();
                bytes.copy_within(other, field.at);
            }
            _ => {
                let mut value = bytes[field.range()].to_vec();
                match field.kind {
                    Kind::Whole(_) => change_whole(&mut value, how, [y, z]),
                    Kind::Real(_) => change_real(&mut value, how, [y, z]),
                    Kind::Bytes(_) => change_bytes(&mut value, how, [y, z, x]),
                }
                bytes.splice(field.range(), value);
            }
        }
        self.keep.push(id);
    }

    /// Version, draft, reserved field; flags and names of sections.
    fn container(&mut self, which: u8, how: u8, [x, y]: [u8; 2]) {
        let number = [x, y];
        match how % 6 {
            0 => self.preamble[12..14].copy_from_slice(&[x % 8, 0]),
            1 => self.preamble[8 + usize::from(which % 4)] = x,
            2 => self.preamble[10..14].copy_from_slice(&[x % 4, 0, y % 8, 0]),
            3 => self.preamble[24..26].copy_from_slice(&number),
            4 => {
                let section = usize::from(which) % self.sections.len();
                self.sections[section].head[4..6].copy_from_slice(&[x, y & y >> 4]);
            }
            _ => {
                let section = usize::from(which) % self.sections.len();
                self.sections[section].head[usize::from(x % 4)] = y;
            }
        }
    }

    /// Sections taken out, doubled, moved, from another file, or of a name that nobody knows.
    fn table(&mut self, which: u8, how: u8, x: u8) {
        let (at, to) = (usize::from(which) % self.sections.len(), usize::from(x) % self.sections.len());
        match how % 5 {
            0 if self.sections.len() > 1 => drop(self.sections.remove(at)),
            1 => self.sections.insert(to, self.sections[at].clone()),
            2 => self.sections.swap(at, to),
            3 => {
                let donors = split(chosen(x)).expect("golden files have sections").1;
                if let Some(donor) = donors.into_iter().find(|donor| donor.id() == self.sections[at].id()) {
                    self.keep.push(donor.id().try_into().expect("four bytes"));
                    self.sections[at] = donor;
                }
            }
            _ => {
                let head = [b'X', b'T', b'R', b'A', x & 1, 0, 0, 0];
                self.sections.insert(at, Section { head, bytes: vec![x; usize::from(x)], crc: [0; 4] });
            }
        }
    }
}

/// The parts of EXCT, by block.
fn lossless_parts(bytes: &[u8], channels: usize, blocks: usize) -> Vec<Vec<u8>> {
    let lengths = 4 + 8 * channels;
    let mut at = lengths + 4 * blocks + 4;
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) as usize;
    let mut part = |block: usize| {
        let start = at;
        at += word(lengths + 4 * block);
        bytes[start..at].to_vec()
    };
    (0..blocks).map(&mut part).collect()
}

/// Changes what stands between the first bytes and the checksum.
fn inside(bytes: &mut Vec<u8>, head: usize, change: impl FnOnce(&mut Vec<u8>)) {
    let end = bytes.len().saturating_sub(4).max(head.min(bytes.len()));
    let (mut inner, tail) = (bytes[head.min(end)..end].to_vec(), bytes[end..].to_vec());
    change(&mut inner);
    bytes.truncate(head.min(end));
    bytes.extend(inner);
    bytes.extend(tail);
}

fn change_bytes(bytes: &mut Vec<u8>, how: u8, [x, y, z]: [u8; 3]) {
    let place = usize::from(u16::from_le_bytes([x, y]));
    let at = (place * bytes.len()) >> 16;
    let few = 1 + usize::from(z % 8);
    let mut random = SplitMix64(place as u64 | u64::from(z) << 16);
    let range = at..(at + few).min(bytes.len());
    match how % 8 {
        0 | 1 if !bytes.is_empty() => bytes[at] ^= 1 << (z % 8),
        2 if !bytes.is_empty() => bytes[at] = z,
        3 => bytes[range].iter_mut().for_each(|byte| *byte = random.next_u64() as u8),
        4 => bytes.truncate(bytes.len().saturating_sub(few)),
        5 => bytes.extend((0..few).map(|_| random.next_u64() as u8)),
        6 => drop(bytes.drain(range)),
        _ => drop(bytes.splice(at..at, std::iter::repeat_n(z, few))),
    }
}

/// Limits of the format and of machines.
#[rustfmt::skip]
const WHOLE: [u64; 32] = [
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 15, 16, 17, 63, 64, 65, 127, 128, 255, 256, 1023, 1024, 1025, 4096, 4097, 65535,
    65536, 65537, 1 << 21, (1 << 24) + 1, 1 << 31, u64::MAX,
];

fn change_whole(value: &mut [u8], how: u8, [y, z]: [u8; 2]) {
    let mut wide = [0; 8];
    wide[..value.len()].copy_from_slice(value);
    let old = u64::from_le_bytes(wide);
    let new = match how % 8 {
        0 | 1 => WHOLE[usize::from(y) % WHOLE.len()],
        2 => old.wrapping_add(1),
        3 => old.wrapping_sub(1),
        4 => u64::from(y),
        5 => u64::from(u16::from_le_bytes([y, z])),
        6 => old ^ 1 << (usize::from(y) % (8 * value.len())),
        _ => old.wrapping_add(i64::from(y as i8) as u64),
    };
    value.copy_from_slice(&new.to_le_bytes()[..value.len()]);
}

/// Limits of the format and of numbers.
#[rustfmt::skip]
const REAL: [f64; 32] = [
    0.0, -0.0, 1.0, -1.0, 0.5, 2.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE, 5e-324,
    1e-300, 1e-301, 1e30, 1e31, 1e-12, 1e6, 1e-6, 1.001, -1.001, 1e-45, 3.4e38, 1e-3, 1e-40, 100.0, -1e6, 1e300,
    std::f64::consts::FRAC_PI_2, std::f64::consts::PI, 1e-20, 89.0,
];

fn change_real(value: &mut [u8], how: u8, [y, z]: [u8; 2]) {
    let short = value.len() == 4;
    let old = if short {
        f64::from(f32::from_le_bytes(value.try_into().expect("four bytes")))
    } else {
        f64::from_le_bytes((&*value).try_into().expect("eight bytes"))
    };
    let part = f64::from(i16::from_le_bytes([y, z])) / 32768.0;
    let new = match how % 8 {
        0 | 1 => REAL[usize::from(y) % REAL.len()],
        2 => return value[usize::from(y) % value.len()] ^= 1 << (z % 8),
        3 => return value[0] = value[0].wrapping_add(y | 1),
        4 => old * (1.0 + part),
        5 => old * (part * 40.0).exp2(),
        6 => -old,
        _ => part,
    };
    // Of a limit in single precision its neighbours, too.
    if short {
        let bits = (new as f32).to_bits().wrapping_add(u32::from(z % 3)).wrapping_sub(1 - u32::from(z % 2));
        return value.copy_from_slice(&bits.to_le_bytes());
    }
    value.copy_from_slice(&new.to_le_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bodies::golden::GOLDEN;

    /// Taken apart and put together a file is the same, but for the last bytes of the index's coder.
    #[test]
    fn without_a_change_nothing_changes() {
        for (number, (name, file)) in GOLDEN.iter().enumerate() {
            let made = make(&[number as u8]).unwrap();
            let (a, b) = (Reader::open(*file).unwrap(), Reader::open(&made[..]).unwrap());
            assert_eq!(a.decode_all().ok(), b.decode_all().ok(), "{name}");
            for block in 0..a.block_count() {
                let info = |reader: &Reader<&[u8]>| reader.block_info(block).map(|info| (info.rms, info.max)).unwrap();
                assert_eq!(info(&a), info(&b), "{name}");
            }
        }
    }
}
