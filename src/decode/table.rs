//! The whole table, and every byte of a file.

use super::{Reader, Scratch};
use crate::base::budget::{Budget, with_room, zeroed};
use crate::base::error::{Error, Result};
use crate::codec::tone::inverse_tone_map_f64;
use crate::format::{directory, spare};
use crate::table::Table;
use crate::table::block::{Block, Place, Shares};

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
        let mut values = with_room(size)?;
        let places = &mut values.spare_capacity_mut()[..size];
        #[cfg(feature = "mmap")]
        crate::base::map::ask_for_large_pages(places);
        self.values_of_blocks(places)?;
        // SAFETY: the first `size` places are all in the memory of some block (`Shares::memory`, `for_each_block`), and without an error
        // every block was written to all of it (`values_to`).
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
        self.values_of_blocks(values)
    }

    /// Shares for the threads at hand: one for one, and some for each of many, so that they end at nearly the same time. Not more than
    /// needed: where shares part rows along the last axis, threads wait for each other's cache lines, a third of the time.
    pub(super) fn shares(&self) -> Shares<'_> {
        #[cfg(feature = "parallel")]
        let threads = rayon::current_num_threads();
        #[cfg(not(feature = "parallel"))]
        let threads = 1;
        Shares::new(self.partition(), self.grid().channels().len(), if threads == 1 { 1 } else { 4 * threads })
    }

    /// Blocks that may be rebuilt at a time: as many as their buffers are within the limit on bytes, and one at least. So what a file
    /// decodes to does not depend on the number of threads.
    pub(super) fn most_scratches(&self) -> usize {
        let each = self.codec.most_bytes_of_block().max(1);
        usize::try_from(self.whole_call().bytes_left() / each).unwrap_or(usize::MAX).max(1)
    }

    fn values_of_blocks<P: Place<f32> + Send>(&self, places: &mut [P]) -> Result<()> {
        let (shares, budget) = (self.shares(), self.whole_call());
        self.for_each_block(&shares, shares.memory(places), |scratch, block, place, memory| {
            self.values_to(block, scratch, memory.of_block(place), &budget)
        })
    }

    /// `work` on every block, with its place and the memory of the share that it is in; the first error ends it. Threads take the shares
    /// that take longest first, so that they end together.
    pub(super) fn for_each_block<M: Send>(
        &self,
        shares: &Shares,
        memory: Vec<M>,
        work: impl Fn(&mut Scratch, usize, &Block, &mut M) -> Result<()> + Sync + Send,
    ) -> Result<()> {
        let fill = |scratch: &mut Scratch, share: usize, mut memory: M| {
            let mut positions = 0;
            for (block, place) in shares.blocks(share) {
                work(scratch, block, &place, &mut memory)?;
                positions += place.positions();
            }
            // Blocks are disjoint: these are all of the share. Who hands in memory without values relies on it.
            assert_eq!(positions, shares.positions(share), "blocks cover their share");
            Ok(())
        };
        assert_eq!(memory.len(), shares.count(), "memory for each share");
        #[cfg(feature = "parallel")]
        if memory.len() > 1 {
            let bytes =
                |share: usize| shares.blocks(share).map(|(block, _)| self.index.record(block).len()).sum::<usize>();
            let mut queue: Vec<_> = memory.into_iter().enumerate().collect();
            queue.sort_by_cached_key(|(share, _)| std::cmp::Reverse(shares.positions(*share) + BYTE * bytes(*share)));
            return fill_in_order(queue, self.most_scratches(), fill);
        }
        let mut scratch = Scratch::default();
        memory.into_iter().enumerate().try_for_each(|(share, memory)| fill(&mut scratch, share, memory))
    }

    /// The whole table in double precision and the source's units, with the validity of its entries.
    ///
    /// # Errors
    /// As [`Reader::decode_all`].
    pub fn decode_table(&self) -> Result<Table> {
        let size = self.check_table_size()?;
        let (mut values, mut valid) = (zeros(size)?, zeroed(size)?);
        let eps = self.codec.coding.eps;
        let (shares, budget) = (self.shares(), self.whole_call());
        let memory = shares.memory(&mut values).into_iter().zip(shares.memory(&mut valid)).collect();
        self.for_each_block(&shares, memory, |scratch, block, place, (values, valid)| {
            self.decode_log(block, scratch, &budget)?;
            // In double precision, and its validity.
            let _held = budget.holding(9 * scratch.log.len() as u64)?;
            let mut decoded = with_room(scratch.log.len())?;
            for (log, channel) in scratch.log.chunks_exact(place.positions()).zip(self.grid().channels()) {
                // The scale is mostly below 1: what the tone map saturated would overflow again.
                let unscale = |log: f32| (inverse_tone_map_f64(log, eps) / channel.scale).min(f64::MAX);
                decoded.extend(log.iter().map(|&log| unscale(log)));
            }
            values.of_block(place).put_all(&decoded);
            valid.of_block(place).put_all(&self.codec.masks_of(place, scratch)?);
            Ok(())
        })?;
        Table::from_parts(self.grid().clone(), values, valid)
    }

    /// Checks every byte: all sections' checksums and, block by block, that each record and what restores its bits decodes.
    /// Returns what is damaged, not much more than the first 65,536 places; nothing if the file is intact. A table above the caller's limit is not looked at:
    /// that is the one error then.
    pub fn verify(&self) -> Vec<Error> {
        match self.check_table_size() {
            Ok(_) => self.verify_within(&self.whole_call()),
            Err(e) => vec![e],
        }
    }

    /// As [`Reader::verify`], on a budget in place of the limit on tables.
    pub(crate) fn verify_within(&self, budget: &Budget) -> Vec<Error> {
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
        let exact = match self.is_lossless().then(|| self.lossless_index()).transpose() {
            Ok(exact) => exact,
            Err(e) => {
                damage.push(e);
                None
            }
        };
        // Without it no record decodes.
        if let Err(e) = self.prepare(budget) {
            damage.push(e);
            return damage;
        }
        let check = |scratch: &mut Scratch, block: usize| {
            let record = self.record(block).and_then(|record| self.rebuild(block, &record, scratch, budget)).err();
            // What was lost and is marked so is no damage any more.
            let bits = exact.as_ref().filter(|exact| record.is_none() && !exact.is_lost(self.data.as_ref(), block));
            let bits = bits.and_then(|index| self.source_bits_within(index, block, scratch, budget).err());
            Ok([record, bits.filter(|e| !matches!(e, Error::Pruned { .. } | Error::Lost { .. }))])
        };
        // Some at a time: what is found of a block takes more memory than many a block.
        for first in (0..self.block_count()).step_by(MAX_LISTED) {
            let blocks = first..self.block_count().min(first + MAX_LISTED);
            match map_blocks(blocks, self.most_scratches(), check) {
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
fn zeros<T: Copy + Default>(size: usize) -> Result<Vec<T>> {
    #[allow(unused_mut)]
    let mut values = zeroed(size)?;
    #[cfg(feature = "mmap")]
    crate::base::map::ask_for_large_pages(&mut values);
    Ok(values)
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

/// `work` on every block, at most some at a time, in order of their numbers; the first error ends it.
#[cfg(feature = "parallel")]
pub(super) fn map_blocks<T: Send>(
    blocks: std::ops::Range<usize>,
    most: usize,
    work: impl Fn(&mut Scratch, usize) -> Result<T> + Sync + Send,
) -> Result<Vec<T>> {
    use rayon::prelude::*;
    let scratches = Scratches::default();
    // Blocks in as many runs at most.
    let run = if most < rayon::current_num_threads() { blocks.len().div_ceil(most) } else { 1 };
    blocks.into_par_iter().with_min_len(run).map(|block| scratches.lend(|scratch| work(scratch, block))).collect()
}

#[cfg(not(feature = "parallel"))]
pub(super) fn map_blocks<T>(
    blocks: std::ops::Range<usize>,
    _most: usize,
    work: impl Fn(&mut Scratch, usize) -> Result<T>,
) -> Result<Vec<T>> {
    let mut scratch = Scratch::default();
    blocks.map(|block| work(&mut scratch, block)).collect()
}

/// A byte of a record takes about as long as this many positions.
#[cfg(feature = "parallel")]
const BYTE: usize = 32;

#[cfg(feature = "parallel")]
fn fill_in_order<M: Send>(
    queue: Vec<(usize, M)>,
    most: usize,
    fill: impl Fn(&mut Scratch, usize, M) -> Result<()> + Sync + Send,
) -> Result<()> {
    use rayon::prelude::*;
    let count = queue.len();
    let queue = std::sync::Mutex::new(queue.into_iter());
    let next = || queue.lock().unwrap_or_else(std::sync::PoisonError::into_inner).next();
    let scratches = Scratches::default();
    if most < rayon::current_num_threads() {
        // A few at a time, each until nothing is left.
        let failed = std::sync::atomic::AtomicBool::new(false);
        return (0..most).into_par_iter().with_max_len(1).try_for_each(|_| {
            while let Some((share, memory)) = next().filter(|_| !failed.load(std::sync::atomic::Ordering::Relaxed)) {
                scratches.lend(|scratch| fill(scratch, share, memory)).inspect_err(|_| {
                    failed.store(true, std::sync::atomic::Ordering::Relaxed);
                })?;
            }
            Ok(())
        });
    }
    (0..count).into_par_iter().with_max_len(1).try_for_each(|_| match next() {
        Some((share, memory)) => scratches.lend(|scratch| fill(scratch, share, memory)),
        None => Ok(()),
    })
}
