//! The whole table, and every byte of a file.

use super::values::Place;
use super::{Reader, Scratch};
use crate::block::Partition;
use crate::error::{Error, Result};
use crate::format::{directory, spare};
use crate::table::BrdfTable;
use crate::tone::inverse_tone_map_f64;

/// Places that a verification lists, and blocks that it looks at together.
const MAX_LISTED: usize = 1 << 16;

impl<D: AsRef<[u8]> + Sync> Reader<D> {
    /// The whole table: BRDF values in 1/sr, one plane per channel, last axis fastest. Missing entries hold what
    /// the recovery filled in. With the feature `mmap` Linux is asked for large pages, which it hands out in less time.
    ///
    /// # Errors
    /// `Corrupt` if a record is damaged, `LimitExceeded` if the table is above the caller's limit.
    #[allow(unsafe_code)]
    pub fn decode_all(&self) -> Result<Vec<f32>> {
        let size = self.check_table_size()?;
        if self.has_short_rows() {
            let mut values = zeroed(size);
            self.decode_all_into(&mut values)?;
            return Ok(values);
        }
        let mut values = Vec::with_capacity(size);
        let places = &mut values.spare_capacity_mut()[..size];
        #[cfg(feature = "mmap")]
        crate::map::ask_for_large_pages(places);
        let rows = self.partition().rows_by_block(places);
        for_each_block(self.partition(), rows, |scratch, block, rows| self.values_in_rows(block, scratch, rows))?;
        // SAFETY: the first `size` places are all in some block's rows (`rows_by_block`), and without an error every block (`for_each_block`)
        // was written to all of its rows (`values_in_rows`).
        unsafe { values.set_len(size) };
        Ok(values)
    }

    /// As [`Reader::decode_all`], into the caller's memory: positions times channels values.
    ///
    /// # Errors
    /// As [`Reader::decode_all`], with some of `values` written; `InvalidArgument` if its length is another.
    pub fn decode_all_into(&self, values: &mut [f32]) -> Result<()> {
        let expected = self.check_table_size()?;
        if values.len() != expected {
            return Err(Error::InvalidArgument(format!("the table has {expected} values, not {}", values.len())));
        }
        if self.has_short_rows() {
            let decode = |scratch: &mut Scratch, block| {
                self.decode_log(block, scratch)?;
                Ok(self.header.values(scratch).to_vec())
            };
            return self.in_batches(decode, |block, decoded| self.scatter(block, &decoded, values));
        }
        for_each_block(self.partition(), self.partition().rows_by_block(values), |scratch, block, rows| {
            self.values_in_rows(block, scratch, rows)
        })
    }

    /// The whole table in double precision and the source's units, with the validity of its entries.
    ///
    /// # Errors
    /// As [`Reader::decode_all`].
    pub fn decode_table(&self) -> Result<BrdfTable> {
        let size = self.check_table_size()?;
        let (mut values, mut valid) = (zeroed(size), vec![false; size]);
        let eps = self.header.coding.eps;
        let decode = |scratch: &mut Scratch, block| {
            let place = self.decode_log(block, scratch)?;
            let mut decoded = Vec::with_capacity(scratch.log.len());
            for (log, channel) in scratch.log.chunks_exact(place.positions()).zip(self.grid().channels()) {
                // The scale is mostly below 1: what the tone map saturated would overflow again.
                let unscale = |log: f32| (inverse_tone_map_f64(log, eps) / channel.scale).min(f64::MAX);
                decoded.extend(log.iter().map(|&log| unscale(log)));
            }
            Ok((decoded, self.header.masks_of(&place, scratch)))
        };
        if self.has_short_rows() {
            self.in_batches(decode, |block, (decoded, masks)| {
                self.scatter(block, &decoded, &mut values);
                self.scatter(block, &masks, &mut valid);
            })?;
            return BrdfTable::from_parts(self.grid().clone(), values, valid);
        }
        let partition = self.partition();
        let blocks = partition.rows_by_block(&mut values).into_iter().zip(partition.rows_by_block(&mut valid));
        for_each_block(partition, blocks.collect(), |scratch, block, (values, valid)| {
            let (decoded, masks) = decode(scratch, block)?;
            copy_rows(values, &decoded);
            copy_rows(valid, &masks);
            Ok(())
        })?;
        BrdfTable::from_parts(self.grid().clone(), values, valid)
    }

    /// Checks every byte: all sections' checksums and, block by block, that each record and what restores its bits decodes.
    /// Returns what is damaged, not much more than the first 65,536 places; nothing if the file is intact. A table above the caller's limit is not looked at:
    /// that is the one error then.
    pub fn verify(&self) -> Vec<Error> {
        if let Err(e) = self.check_table_size() {
            return vec![e];
        }
        let mut damage = Vec::new();
        for section in self.directory.sections() {
            let bytes = &self.data.as_ref()[section.range.clone()];
            if crc32fast::hash(bytes) != section.crc {
                let what = format!("checksum of section {} is wrong", section.name());
                damage.push(Error::corrupt("file", section.range.start as u64, what));
                continue;
            }
            #[cfg(feature = "metadata")]
            if section.id == directory::METADATA.as_bytes() {
                damage.extend(self.metadata().err());
            }
        }
        if damage.is_empty() && !spare::agrees(self.data.as_ref(), &self.directory) {
            let offset = self.directory.find(directory::SPARE).map_or(0, |section| section.range.start as u64);
            damage.push(Error::corrupt(directory::SPARE, offset, "is no copy of the sections before RECS"));
        }
        let exact = match self.is_lossless().then(|| self.exact_index()).transpose() {
            Ok(exact) => exact,
            Err(e) => {
                damage.push(e);
                None
            }
        };
        // Without it no record decodes.
        if let Err(e) = self.prepare() {
            damage.push(e);
            return damage;
        }
        let check = |scratch: &mut Scratch, block: usize| {
            let record = self.record(block).and_then(|record| self.rebuild(block, &record, scratch)).err();
            // What was lost and is marked so is no damage any more.
            let bits = exact.as_ref().filter(|exact| record.is_none() && !exact.is_lost(self.data.as_ref(), block));
            let bits = bits.and_then(|index| self.exact_bits(index, block, scratch).err());
            Ok([record, bits.filter(|e| !matches!(e, Error::Pruned { .. }))])
        };
        // Some at a time: what is found of a block takes more memory than many a block.
        for first in (0..self.block_count()).step_by(MAX_LISTED) {
            match map_blocks(first..self.block_count().min(first + MAX_LISTED), check) {
                Ok(found) => damage.extend(found.into_iter().flatten().flatten().take(MAX_LISTED)),
                Err(e) => damage.push(e),
            }
            if damage.len() >= MAX_LISTED {
                break;
            }
        }
        damage
    }
}

/// Memory for a whole table.
fn zeroed<T: Copy + Default>(size: usize) -> Vec<T> {
    #[allow(unused_mut)]
    let mut values = vec![T::default(); size];
    #[cfg(feature = "mmap")]
    crate::map::ask_for_large_pages(&mut values);
    values
}

/// Scratches that threads share, as many as work at one time: rayon would make one anew for each block.
#[cfg(feature = "parallel")]
#[derive(Default)]
struct Scratches(std::sync::Mutex<Vec<Scratch>>);

#[cfg(feature = "parallel")]
impl Scratches {
    fn lend<T>(&self, work: impl FnOnce(&mut Scratch) -> T) -> T {
        // Nothing that panics runs while the list is held.
        let list = || self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let mut scratch = list().pop().unwrap_or_default();
        let result = work(&mut scratch);
        list().push(scratch);
        result
    }
}

/// `work` on every block, in order of their numbers; the first error ends it.
#[cfg(feature = "parallel")]
pub(super) fn map_blocks<T: Send>(
    blocks: std::ops::Range<usize>,
    work: impl Fn(&mut Scratch, usize) -> Result<T> + Sync + Send,
) -> Result<Vec<T>> {
    use rayon::prelude::*;
    let scratches = Scratches::default();
    blocks.into_par_iter().map(|block| scratches.lend(|scratch| work(scratch, block))).collect()
}

#[cfg(not(feature = "parallel"))]
pub(super) fn map_blocks<T>(
    blocks: std::ops::Range<usize>,
    work: impl Fn(&mut Scratch, usize) -> Result<T>,
) -> Result<Vec<T>> {
    let mut scratch = Scratch::default();
    blocks.map(|block| work(&mut scratch, block)).collect()
}

/// `work` on every block with what belongs to it; the first error ends it. Threads take the largest blocks first, so that they end
/// together.
#[cfg(feature = "parallel")]
pub(super) fn for_each_block<T: Send>(
    partition: &Partition,
    blocks: Vec<T>,
    work: impl Fn(&mut Scratch, usize, T) -> Result<()> + Sync + Send,
) -> Result<()> {
    use rayon::prelude::*;
    let count = blocks.len();
    let mut queue: Vec<_> = partition.sizes().zip(blocks.into_iter().enumerate()).collect();
    // Who hands in memory without values relies on it.
    assert_eq!(queue.len(), count, "a size for each block");
    queue.sort_by_key(|(size, _)| std::cmp::Reverse(*size));
    let queue = std::sync::Mutex::new(queue.into_iter());
    let next = || queue.lock().unwrap_or_else(std::sync::PoisonError::into_inner).next();
    let scratches = Scratches::default();
    (0..count).into_par_iter().with_max_len(1).try_for_each(|_| match next() {
        Some((_, (block, target))) => scratches.lend(|scratch| work(scratch, block, target)),
        None => Ok(()),
    })
}

#[cfg(not(feature = "parallel"))]
pub(super) fn for_each_block<T>(
    _: &Partition,
    blocks: Vec<T>,
    work: impl Fn(&mut Scratch, usize, T) -> Result<()>,
) -> Result<()> {
    let mut scratch = Scratch::default();
    blocks.into_iter().enumerate().try_for_each(|(block, target)| work(&mut scratch, block, target))
}

/// Copies the values of a block into its rows.
pub(super) fn copy_rows<'a, T: Copy, P: Place<T> + 'a>(rows: impl IntoIterator<Item = &'a mut [P]>, values: &[T]) {
    let mut left = values;
    for row in rows {
        let (values, rest) = left.split_at(row.len());
        row.iter_mut().zip(values).for_each(|(place, value)| place.put(*value));
        left = rest;
    }
}
