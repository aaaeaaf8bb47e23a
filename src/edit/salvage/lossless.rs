//! The source values of a damaged lossless file, block by block (spec section 3.10).

use std::borrow::Cow;

use super::evidence::{WANTED, evidence_of_bit, of_one_bit, outcome};
use super::mend::one_bit;
use super::{Damage, Outcome, Salvaged};
use crate::base::budget::filled;
use crate::base::error::Result;
use crate::decode::Scratch;
use crate::format::directory::{self, Section};
use crate::format::lossless::{LosslessIndex, lost_part};

/// Bits that entries which are not valid usually have: of a MERL table, and of others.
const USUAL_MISSING: [f64; 5] = [-1.0, 0.0, f64::NAN, f64::NEG_INFINITY, -0.0];

/// The section with the parts that are intact, those of lost blocks and damaged ones marked so, and how many blocks have none of their own;
/// `None` if its head is damaged beyond what `wanted` bits of evidence prove.
pub(super) fn take(
    data: &[u8],
    section: &Section,
    [blocks, channels]: [usize; 2],
    lost: &[usize],
    wanted: u32,
    damage: &mut Vec<Damage>,
) -> Option<(Vec<u8>, usize)> {
    let range = section.range.clone();
    let head = 4 + 8 * channels + 4 * blocks;
    let (data, flipped) = mend_head(data, range.start, head);
    let row = damage.len();
    if flipped {
        let bytes = range.start..range.start + head + 4;
        damage.push(Damage::of_section(directory::LOSSLESS, bytes, "one bit was flipped", Outcome::Restored));
    }
    let index = match LosslessIndex::read(&data, section, blocks, channels) {
        Ok(index) => index,
        Err(e) => {
            damage.truncate(row);
            let what = format!("the source values are lost: {e}");
            damage.push(Damage::of_section(directory::LOSSLESS, range, what, Outcome::Lost));
            return None;
        }
    };
    let mut is_lost = vec![false; blocks];
    lost.iter().for_each(|&block| is_lost[block] = true);
    let parts = Parts::copy(&data, &index, &is_lost, damage);
    if flipped {
        let bits = evidence(&index, head, parts.damaged);
        if bits < wanted {
            damage.truncate(row);
            let what = format!(
                "the source values are lost: only {bits} bits of evidence of {WANTED} say which bit of its head was flipped"
            );
            damage.push(Damage::of_section(directory::LOSSLESS, range, what, Outcome::Lost));
            return None;
        }
        damage[row].outcome = outcome(bits);
    }
    let mut bytes = [&data[range.start..range.start + 4 + 8 * channels], &parts.lengths].concat();
    let crc = crc32fast::hash(&bytes);
    bytes.extend_from_slice(&crc.to_le_bytes());
    bytes.extend(parts.bytes);
    Some((bytes, parts.lost))
}

/// The file with the one bit of the section's head flipped back that its checksum names, if there is one.
fn mend_head(data: &[u8], start: usize, length: usize) -> (Cow<'_, [u8]>, bool) {
    let head = data.get(start..start + length + 4).and_then(<[u8]>::split_last_chunk::<4>);
    let Some((bytes, crc)) = head else { return (data.into(), false) };
    let right = crc32fast::hash(bytes);
    let difference = right ^ u32::from_le_bytes(*crc);
    let Some(change) = (difference != 0).then(|| one_bit(bytes.len(), difference)).flatten() else {
        return (data.into(), false);
    };
    let mut copy = data.to_vec();
    match change {
        Some(patch) => patch.apply(&mut copy[start..start + length]),
        None => copy[start + length..start + length + 4].copy_from_slice(&right.to_le_bytes()),
    }
    (copy.into(), true)
}

/// Evidence for that bit: checksums of the parts vouch for their lengths, the bits of missing entries are usual ones or not.
fn evidence(index: &LosslessIndex, head: usize, damaged: usize) -> u32 {
    let is_usual = |bits: &u64| USUAL_MISSING.iter().any(|usual| usual.to_bits() == *bits);
    if damaged > 0 {
        return evidence_of_bit(head);
    }
    match index.missing.iter().filter(|bits| !is_usual(bits)).count() as u64 {
        0 => WANTED,
        unusual => of_one_bit(64 * unusual, 64 * unusual),
    }
}

/// The parts of all blocks.
#[derive(Default)]
struct Parts {
    lengths: Vec<u8>,
    bytes: Vec<u8>,
    /// Blocks whose own part is damaged.
    damaged: usize,
    /// These, and those that have none since they are lost themselves.
    lost: usize,
}

impl Parts {
    /// Copies those that are intact, and marks the others.
    fn copy(data: &[u8], index: &LosslessIndex, is_lost: &[bool], damage: &mut Vec<Damage>) -> Parts {
        let mut parts = Parts::default();
        for (block, &is_lost) in is_lost.iter().enumerate() {
            let place = index.part(block);
            let intact = place.end <= data.len() && index.coded(data, block).is_ok();
            let known_lost = place.end <= data.len() && index.is_lost(data, block);
            if !intact && !known_lost {
                let what = if place.end > data.len() { "beyond the end of the file" } else { "the checksum is wrong" };
                Damage::of_block(damage, directory::LOSSLESS, block, place.clone(), what);
                parts.damaged += 1;
            }
            parts.lost += usize::from(!known_lost && (is_lost || !intact));
            let marker = lost_part(block as u32);
            let part = if intact && !is_lost { &data[place] } else { &marker[..] };
            parts.lengths.extend_from_slice(&(part.len() as u32).to_le_bytes());
            parts.bytes.extend_from_slice(part);
        }
        parts
    }
}

impl Salvaged {
    /// The source's values bit by bit as far as they are left, `missing` elsewhere, as
    /// [`Reader::source_table`](crate::decode::Reader::source_table); and how many blocks of it are missing.
    ///
    /// # Errors
    /// `InvalidArgument` if the file is not lossless or its source values are all lost, `LimitExceeded` if the table is above the
    /// caller's limit.
    pub fn source_table(&self, missing: f64) -> Result<(Vec<f64>, usize)> {
        let reader = self.reader();
        let index = reader.lossless_index()?;
        let mut values = filled(missing, reader.check_table_size()?)?;
        let (shape, n) = (reader.grid().shape(), reader.grid().positions());
        let (mut scratch, mut gone) = (Scratch::default(), 0);
        for block in 0..reader.block_count() {
            let Ok((place, bits)) = reader.source_bits(&index, block, &mut scratch) else {
                gone += 1;
                continue;
            };
            let exact: Vec<f64> = bits.into_iter().map(f64::from_bits).collect();
            for (plane, exact) in values.chunks_exact_mut(n).zip(exact.chunks_exact(place.positions())) {
                place.scatter(shape, exact, plane);
            }
        }
        Ok((values, gone))
    }
}
