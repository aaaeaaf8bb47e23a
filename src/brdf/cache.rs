//! Blocks and coefficients that look-ups keep, and what they may cost.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};

use super::Brdf;
use crate::base::budget::{Budget, filled};
use crate::base::error::Result;
use crate::decode::Scratch;
use crate::decode::point::Sparse;

/// Most blocks whose coefficients are kept.
pub(super) const SPARSE_BLOCKS: usize = 4096;

/// Most places of the cache: eight bytes each, empty or not.
pub(super) const CACHE_BLOCKS: usize = 1 << 16;

/// Of the cache's bytes, coefficients get every n-th; most materials need 0.2 MB.
pub(super) const SPARSE_SHARE: usize = 4;

/// Operations of decoding that each look-up brings with it, if it needs them. So renderers may go on for ever with a cache that is too
/// small for an ordinary file, and no file takes longer than this for a look-up in the long run.
pub(super) const FREE: u64 = 1 << 16;

/// Bytes of the buffers of decodes that are kept for the next one.
pub(super) const KEPT_SCRATCHES: usize = 16 << 20;

/// Bytes of decoded blocks that are kept unless the caller says otherwise.
pub(super) const DEFAULT_BYTES: usize = 64 << 20;

/// A decoded block.
pub(super) struct Cached {
    pub(super) block: usize,
    /// `[position][channel]`: a look-up wants all channels of few positions.
    pub(super) values: Vec<f32>,
    /// Looked at since the clock's hand came by.
    pub(super) used: AtomicBool,
}

impl Cached {
    pub(super) fn bytes(&self) -> usize {
        size_of::<Cached>() + self.values.capacity() * size_of::<f32>()
    }
}

/// Buffers that nobody uses at the moment, and their bytes.
#[derive(Default)]
pub(super) struct Scratches {
    list: Vec<Scratch>,
    bytes: usize,
}

/// What a look-up draws on.
#[derive(Clone, Copy)]
pub(super) struct Means<'a> {
    pub(super) budget: &'a Budget<'a>,
    /// Operations that it brings with it.
    pub(super) free: u64,
}

impl Means<'_> {
    /// Counts the part of some work that a look-up does not bring with it.
    pub(super) fn spend(self, work: u64) -> Result<()> {
        match work.saturating_sub(self.free) {
            0 => Ok(()),
            more => self.budget.spend(more),
        }
    }
}

impl Brdf {
    /// Puts a block into the cache, and as many out as make room.
    pub(super) fn keep(&self, cached: Cached) {
        let (own, bytes) = (cached.block % self.cache.len(), cached.bytes());
        let replace = |place: usize, with: Option<Arc<Cached>>| {
            let before = self.cache[place].swap(with);
            self.cache_bytes.fetch_sub(before.map_or(0, |before| before.bytes()), Ordering::Relaxed);
        };
        self.cache_bytes.fetch_add(bytes, Ordering::Relaxed);
        replace(own, Some(Arc::new(cached)));
        // Two rounds at most: in the first, all may have been used.
        for _ in 0..2 * self.cache.len() {
            if self.cache_bytes.load(Ordering::Relaxed) <= self.cache_most {
                return;
            }
            let place = self.hand.fetch_add(1, Ordering::Relaxed) % self.cache.len();
            let used =
                self.cache[place].load().as_ref().is_none_or(|cached| cached.used.swap(false, Ordering::Relaxed));
            if place != own && !used {
                replace(place, None);
            }
        }
    }

    /// The coefficients of a block, if single values can be had from them and there is room to keep them.
    pub(super) fn sparse(&self, block: usize, means: Means) -> Result<Option<Arc<Sparse>>> {
        let slot = &self.sparse[block % self.sparse.len()];
        if let Some(sparse) = slot.load_full().filter(|sparse| sparse.block == block) {
            return Ok(Some(sparse));
        }
        if self.sparse_bytes.load(Ordering::Relaxed) + self.reader.likely_sparse_bytes(block) > self.sparse_most {
            return Ok(None);
        }
        let decode = |budget: &Budget| self.with_scratch(|scratch| self.reader.sparse_block(block, scratch, budget));
        let sparse = means.budget.with_free(means.free, decode)?.map(Arc::new);
        let bytes = sparse.as_ref().map_or(0, |sparse| sparse.bytes());
        if self.sparse_bytes.fetch_add(bytes, Ordering::Relaxed) + bytes > self.sparse_most {
            // Coefficients that are not kept would be decoded again for every look-up, and the block never rebuilt.
            self.sparse_bytes.fetch_sub(bytes, Ordering::Relaxed);
            return Ok(None);
        }
        let before = slot.swap(sparse.clone());
        self.sparse_bytes.fetch_sub(before.map_or(0, |before| before.bytes()), Ordering::Relaxed);
        Ok(sparse)
    }

    pub(super) fn with_scratch<T>(&self, work: impl FnOnce(&mut Scratch) -> T) -> T {
        let lock = || self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        let mut scratch = {
            let mut kept = lock();
            let scratch = kept.list.pop().unwrap_or_default();
            kept.bytes -= scratch.bytes();
            scratch
        };
        let result = work(&mut scratch);
        // One large block would leave hundreds of megabytes for good.
        let (mut kept, bytes) = (lock(), scratch.bytes());
        if kept.bytes + bytes <= KEPT_SCRATCHES {
            kept.bytes += bytes;
            kept.list.push(scratch);
        }
        result
    }

    pub(super) fn rebuild(&self, block: usize, means: Means) -> Result<Cached> {
        means.budget.with_free(means.free, |budget| {
            let size = self.reader.block_values(block)?;
            // What stays is the cache's, which the caller bounds.
            let _held = budget.holding(8 * size as u64)?;
            let mut planes = filled(0.0, size)?;
            self.with_scratch(|scratch| self.reader.block_within(block, scratch, &mut planes, budget))?;
            let channels = self.reader.grid().channels().len();
            let mut values = filled(0.0, size)?;
            for (c, plane) in planes.chunks_exact(planes.len() / channels).enumerate() {
                values[c..].iter_mut().step_by(channels).zip(plane).for_each(|(value, v)| *value = *v);
            }
            Ok(Cached { block, values, used: AtomicBool::new(false) })
        })
    }
}
