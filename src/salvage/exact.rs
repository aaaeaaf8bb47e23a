//! The exact values of a damaged lossless file, block by block (spec section 3.10).

use super::mend::one_bit;
use super::{Damage, Outcome, Salvaged};
use crate::decode::Scratch;
use crate::error::Result;
use crate::format::directory::{self, Section};
use crate::format::lossless::{ExactIndex, lost_part};

/// The section with the parts that are intact, those of lost blocks and damaged ones marked so; `None` if its head is damaged.
pub(super) fn take(
    data: &[u8],
    section: &Section,
    blocks: usize,
    channels: usize,
    lost: &[usize],
    damage: &mut Vec<Damage>,
) -> Option<Vec<u8>> {
    let range = section.range.clone();
    let head = range.start..range.start + 4 + 8 * channels + 4 * blocks;
    let mut copy;
    let (mut data, base) = (data, range.start);
    if let Some((bytes, crc)) = data.get(head.start..head.end + 4).and_then(|bytes| bytes.split_last_chunk::<4>()) {
        let difference = crc32fast::hash(bytes) ^ u32::from_le_bytes(*crc);
        if let Some(change) = (difference != 0).then(|| one_bit(bytes.len(), difference)).flatten() {
            copy = data.to_vec();
            match change {
                Some(patch) => patch.apply(&mut copy[head.clone()]),
                None => {
                    let right = crc32fast::hash(bytes).to_le_bytes();
                    copy[head.end..head.end + 4].copy_from_slice(&right);
                }
            }
            data = &copy;
            damage.push(Damage::of_section("EXCT", head.start..head.end + 4, "one bit was flipped", Outcome::Restored));
        }
    }
    let index = match ExactIndex::read(data, section, blocks, channels) {
        Ok(index) => index,
        Err(e) => {
            let what = format!("the exact values are lost: {e}");
            damage.push(Damage::of_section(directory::EXACT, range, what, Outcome::Lost));
            return None;
        }
    };
    let mut is_lost = vec![false; blocks];
    lost.iter().for_each(|&block| is_lost[block] = true);
    let (mut lengths, mut parts) = (Vec::new(), Vec::new());
    for (block, &is_lost) in is_lost.iter().enumerate() {
        let place = index.part(block);
        let intact = place.end <= data.len() && index.coded(data, block).is_ok();
        let known_lost = place.end <= data.len() && index.is_lost(data, block);
        if !intact && !known_lost {
            let what = if place.end > data.len() { "beyond the end of the file" } else { "the checksum is wrong" };
            damage.push(Damage::of_block(directory::EXACT, block, place.clone(), what));
        }
        let marker = lost_part(block as u32);
        let part = if intact && !is_lost { &data[place] } else { &marker[..] };
        lengths.extend_from_slice(&(part.len() as u32).to_le_bytes());
        parts.extend_from_slice(part);
    }
    let mut bytes = [&data[base..base + 4 + 8 * channels], &lengths].concat();
    let crc = crc32fast::hash(&bytes);
    bytes.extend_from_slice(&crc.to_le_bytes());
    bytes.extend(parts);
    Some(bytes)
}

impl Salvaged {
    /// The source's values bit by bit as far as they are left, `missing` elsewhere, as
    /// [`Reader::exact_table`](crate::decode::Reader::exact_table); and how many blocks of it are missing.
    ///
    /// # Errors
    /// `InvalidArgument` if the file is not lossless or its exact values are all lost, `LimitExceeded` if the table is above the
    /// caller's limit.
    pub fn exact_table(&self, missing: f64) -> Result<(Vec<f64>, usize)> {
        let reader = self.reader();
        let index = reader.exact_index()?;
        let mut values = vec![missing; reader.check_table_size()?];
        let (shape, n) = (reader.grid().shape(), reader.grid().positions());
        let (mut scratch, mut gone) = (Scratch::default(), 0);
        for block in 0..reader.block_count() {
            let Ok((place, bits)) = reader.exact_bits(&index, block, &mut scratch) else {
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
