//! BRDF values at pairs of directions, straight from a compressed file.

use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use arc_swap::ArcSwapOption;

use crate::base::budget::{Budget, filled};
use crate::base::error::{Error, Result};
use crate::brdf::touched::Touched;
use crate::decode::point::Sparse;
use crate::decode::{Reader, Scratch};
use crate::table::block::unravel;
use crate::table::coords::{Around, BATCH, Batch, Lookup, batch_coordinates, grid_coordinates, neighbours};
use crate::table::grid::AxisName;

/// Most blocks whose coefficients are kept.
const SPARSE_BLOCKS: usize = 4096;

/// Most places of the cache: eight bytes each, empty or not.
const CACHE_BLOCKS: usize = 1 << 16;

/// Of the cache's bytes, coefficients get one in so many; most materials need 0.2 MB.
const SPARSE_SHARE: usize = 4;

/// Values of a block whose rebuilding takes about as long as one look-up from its coefficients: 6 ns a value, 10 us.
const VALUES_A_LOOKUP: usize = 2048;
/// Operations of such a look-up as `cost` counts them, three for a nanosecond here. A dearer one counts as several: look-ups in a block
/// never take much longer than rebuilding it.
const LOOKUP: u64 = 36_864;

/// Operations of decoding that each look-up brings with it, if it needs them. So renderers may go on for ever with a cache that is too
/// small for an ordinary file, and no file takes longer than this for a look-up in the long run.
const FREE: u64 = 1 << 16;

/// Bytes of the buffers of decodes that are kept for the next one.
const KEPT_SCRATCHES: usize = 16 << 20;

/// Bytes of decoded blocks that are kept unless the caller says otherwise.
const DEFAULT_BYTES: usize = 64 << 20;

/// Channels whose sums fit on the stack.
const MAX_STACK: usize = 16;

/// A decoded block.
struct Cached {
    block: usize,
    /// `[position][channel]`: a look-up wants all channels of few positions.
    values: Vec<f32>,
    /// Looked at since the clock's hand came by.
    used: AtomicBool,
}

impl Cached {
    fn bytes(&self) -> usize {
        size_of::<Cached>() + self.values.capacity() * size_of::<f32>()
    }
}

/// Evaluates a file at directions; rebuilds blocks when that pays and keeps some of them.
///
/// A block is first looked up by its coefficients; once that has taken as long as rebuilding it would, it is rebuilt. So a scene
/// that touches few values of a block does not pay for it, and a cache that is too small costs no more than twice what it must.
///
/// Shared between threads by reference: finding a block in the cache takes no lock.
///
/// What it decodes counts towards [`Limits::operations`](crate::format::Limits::operations) over its whole life, less 65 us for each look-up that finds nothing in the
/// cache: a file whose blocks are too large for the cache ends in `LimitExceeded`, where it would be rebuilt for ever. Of a reader with
/// [one budget](Reader::with_one_budget) that discount grows with the bytes of the file, and files below 128 kB have none.
pub struct Brdf<D> {
    reader: Reader<D>,
    lookup: Lookup,
    /// Block b lives at b modulo the length. Blocks leave by the clock rule: in turn, but those used meanwhile a round later.
    cache: Vec<ArcSwapOption<Cached>>,
    cache_bytes: AtomicUsize,
    cache_most: usize,
    hand: AtomicUsize,
    /// Coefficients of blocks, likewise.
    sparse: Vec<ArcSwapOption<Sparse>>,
    /// Bytes of them, and the most that are kept.
    sparse_bytes: AtomicUsize,
    sparse_most: usize,
    /// Blocks that were looked at, a bit each.
    touched: Vec<AtomicU64>,
    /// How often a block was rebuilt.
    rebuilt: AtomicUsize,
    /// Buffers of decodes, as many as [`KEPT_SCRATCHES`] hold.
    scratch: Mutex<Scratches>,
    /// Of all look-ups together, where the reader has none.
    budget: Budget<'static>,
    /// Operations that a look-up brings with it.
    free: u64,
}

/// Buffers that nobody uses at the moment, and their bytes.
#[derive(Default)]
struct Scratches {
    list: Vec<Scratch>,
    bytes: usize,
}

/// What a look-up draws on.
#[derive(Clone, Copy)]
struct Means<'a> {
    budget: &'a Budget<'a>,
    /// Operations that it brings with it.
    free: u64,
}

impl Means<'_> {
    /// Counts the part of some work that a look-up does not bring with it.
    fn spend(self, work: u64) -> Result<()> {
        match work.saturating_sub(self.free) {
            0 => Ok(()),
            more => self.budget.spend(more),
        }
    }
}

impl<D: AsRef<[u8]>> Brdf<D> {
    /// An evaluator with linear lookup and a cache of 64 MiB.
    ///
    /// # Errors
    /// `InvalidArgument` if the axes of the file are not angles of directions.
    pub fn open(reader: Reader<D>) -> Result<Brdf<D>> {
        let up = [0.0, 0.0, 1.0];
        if grid_coordinates(reader.grid(), up, up).is_none() {
            let names: Vec<_> = reader.grid().axes().iter().map(|a| a.name.as_str()).collect();
            return Err(Error::InvalidArgument(format!("axes {names:?} do not say how directions map to the grid")));
        }
        let sparse = (0..reader.block_count().min(SPARSE_BLOCKS)).map(|_| ArcSwapOption::empty()).collect();
        let touched = (0..reader.block_count().div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        let budget = Budget::new(reader.limits(), reader.len());
        let free = if reader.one_budget().is_some() { (reader.len() as u64 >> 17 << 14).min(FREE) } else { FREE };
        let brdf = Brdf {
            budget,
            free,
            reader,
            lookup: Lookup::Linear,
            cache: Vec::new(),
            cache_bytes: AtomicUsize::new(0),
            cache_most: 0,
            hand: AtomicUsize::new(0),
            sparse,
            sparse_bytes: AtomicUsize::new(0),
            sparse_most: 0,
            touched,
            rebuilt: AtomicUsize::new(0),
            scratch: Mutex::default(),
        };
        Ok(brdf.with_cache_bytes(DEFAULT_BYTES))
    }

    /// The same with another lookup: nearest bin, or linear between bin centres.
    pub fn with_lookup(self, lookup: Lookup) -> Brdf<D> {
        Brdf { lookup, ..self }
    }

    /// The same with a cache of at most so many bytes: three quarters for decoded blocks, at least one of them, and the rest for
    /// coefficients of blocks. Where those do not fit, blocks are rebuilt without them.
    pub fn with_cache_bytes(self, bytes: usize) -> Brdf<D> {
        let sparse_most = bytes / SPARSE_SHARE;
        let cache_most = bytes - sparse_most;
        let sparse = self.sparse.iter().map(|_| ArcSwapOption::empty()).collect();
        let cache = (0..self.reader.block_count().min(CACHE_BLOCKS)).map(|_| ArcSwapOption::empty()).collect();
        let [cache_bytes, sparse_bytes, hand] = std::array::from_fn(|_| AtomicUsize::new(0));
        Brdf { cache, cache_bytes, cache_most, hand, sparse, sparse_bytes, sparse_most, ..self }
    }

    /// The file.
    pub fn reader(&self) -> &Reader<D> {
        &self.reader
    }

    /// Gives the file back; what was decoded of it is dropped, and [`Brdf::touched`] with it.
    pub fn into_reader(self) -> Reader<D> {
        self.reader
    }

    /// The blocks that were looked at so far; [`crate::brdf::touched`] says what for.
    pub fn touched(&self) -> Touched {
        let bit = |b: usize| self.touched[b / 64].load(Ordering::Relaxed) >> (b % 64) & 1 == 1;
        Touched::new((0..self.reader.block_count()).map(bit).collect(), self.reader.index_crc())
    }

    /// Bytes of the records of these blocks: what was read of the file besides its other sections.
    pub fn bytes_touched(&self) -> usize {
        let touched = self.touched();
        let lengths =
            touched.blocks().iter().enumerate().filter(|(_, t)| **t).map(|(b, _)| self.reader.record_length(b));
        lengths.sum()
    }

    /// How often a block was rebuilt so far, blocks that had left the cache again included.
    pub fn blocks_rebuilt(&self) -> usize {
        self.rebuilt.load(Ordering::Relaxed)
    }

    /// BRDF in 1/sr for light from `wi` and view to `wo`: vectors away from the surface in its frame, the normal
    /// along z; their length does not matter. 0 if one points below the horizon, is zero or not finite.
    ///
    /// # Errors
    /// `Corrupt` if a block that is needed is damaged; `InvalidArgument` if the file has not three channels.
    pub fn eval(&self, wi: [f64; 3], wo: [f64; 3]) -> Result<[f32; 3]> {
        let mut value = [0.0; 3];
        self.eval_into(wi, wo, &mut value)?;
        Ok(value)
    }

    /// As [`Brdf::eval`] for any number of channels.
    ///
    /// # Errors
    /// `Corrupt` if a block that is needed is damaged; `InvalidArgument` if `value` is not one value a channel.
    pub fn eval_into(&self, wi: [f64; 3], wo: [f64; 3], value: &mut [f32]) -> Result<()> {
        let grid = self.reader.grid();
        let channels = grid.channels().len();
        if value.len() != channels {
            return Err(Error::InvalidArgument(format!("the file has {channels} channels, not {}", value.len())));
        }
        self.at(grid_coordinates(grid, wi, wo), value, self.means())
    }

    /// As [`Brdf::eval_into`], all of it on the budget of a call that makes many look-ups.
    pub(crate) fn eval_within(&self, budget: &Budget, wi: [f64; 3], wo: [f64; 3], value: &mut [f32]) -> Result<()> {
        self.at(grid_coordinates(self.reader.grid(), wi, wo), value, Means { budget, free: 0 })
    }

    /// What look-ups of callers draw on.
    fn means(&self) -> Means<'_> {
        Means { budget: self.reader.one_budget().unwrap_or(&self.budget), free: self.free }
    }

    /// As [`Brdf::eval_into`] for many pairs, the same bits in less time: `values` is `[pair][channel]`.
    ///
    /// # Errors
    /// `Corrupt` if a block that is needed is damaged; `InvalidArgument` if the lengths do not fit.
    pub fn eval_many(&self, wi: &[[f64; 3]], wo: &[[f64; 3]], values: &mut [f32]) -> Result<()> {
        let grid = self.reader.grid();
        let channels = grid.channels().len();
        if wi.len() != wo.len() || values.len() != wi.len() * channels {
            return Err(Error::InvalidArgument(format!(
                "{} and {} directions and {} values do not fit; the file has {channels} channels",
                wi.len(),
                wo.len(),
                values.len()
            )));
        }
        let of_half =
            grid.axes().iter().all(|a| matches!(a.name, AxisName::ThetaH | AxisName::ThetaD | AxisName::PhiD));
        if !of_half {
            let pairs = wi.iter().zip(wo).zip(values.chunks_exact_mut(channels));
            return pairs.into_iter().try_for_each(|((wi, wo), value)| self.eval_into(*wi, *wo, value));
        }
        let (mut batch, means) = (Batch::new(), self.means());
        let pairs = wi.chunks(BATCH).zip(wo.chunks(BATCH)).zip(values.chunks_mut(BATCH * channels));
        for ((wi, wo), values) in pairs {
            batch.fill(wi, wo);
            for (i, value) in values.chunks_exact_mut(channels).enumerate() {
                self.at(batch_coordinates(grid, &batch, i, wi[i], wo[i]), value, means)?;
            }
        }
        Ok(())
    }

    /// The value at grid coordinates; 0 where there are none.
    #[inline]
    fn at(&self, coordinates: Option<[f64; 4]>, value: &mut [f32], means: Means) -> Result<()> {
        value.fill(0.0);
        let Some(coordinates) = coordinates else { return Ok(()) };
        self.sum(&neighbours(self.reader.grid(), coordinates, self.lookup), value, means)?;
        // Weights sum to one only up to rounding, and saturated values stand at the largest finite number.
        value.iter_mut().for_each(|v| *v = v.min(f32::MAX));
        Ok(())
    }

    /// Adds the weighted values of the bins around a place, at most sixteen.
    fn sum(&self, around: &[Around; 4], value: &mut [f32], means: Means) -> Result<()> {
        let near = around.map(|a| a.near);
        let Some(found) = self.reader.partition().find(near) else { return Ok(()) };
        let mut strides = [0; 4];
        let mut stride = 1;
        let mut index = 0;
        // Axes on which the far bin counts, and is not in the block of the near one.
        let mut leaves = [false; 4];
        for a in (0..4).rev() {
            let Around { near, far, weight } = around[a];
            index += found.within[a] * stride;
            leaves[a] = weight > 0.0 && (far != near + 1 || found.within[a] + 1 >= found.shape[a]);
            strides[a] = stride;
            stride *= found.shape[a];
        }
        if let Some(a) = leaves.iter().position(|leaves| *leaves) {
            // Both sides of the edge, each with its share. Few channels take no time worth counting.
            if value.len() > MAX_STACK {
                means.spend(value.len() as u64)?;
            }
            let [mut below, mut above] = [*around; 2];
            let Around { near, far, weight } = around[a];
            (below[a], above[a]) = (Around { near, far: 0, weight: 0.0 }, Around { near: far, far: 0, weight: 0.0 });
            let (mut stack, mut heap) = ([0f32; MAX_STACK], Vec::new());
            let side = scratch_values(value.len(), &mut stack, &mut heap);
            for (around, share) in [(below, 1.0 - weight), (above, weight)] {
                side.fill(0.0);
                self.sum(&around, side, means)?;
                value.iter_mut().zip(&*side).for_each(|(value, side)| *value += side * share as f32);
            }
            return Ok(());
        }
        // The axes on which two bins count.
        let mut taps = [(index, 1f32); 16];
        let mut count = 1;
        for a in 0..4 {
            let weight = around[a].weight as f32;
            if weight > 0.0 {
                for i in 0..count {
                    let (index, share) = taps[i];
                    taps[i].1 = share * (1.0 - weight);
                    taps[count + i] = (index + strides[a], share * weight);
                }
                count *= 2;
            }
        }
        self.sum_in_block(found.block, found.shape, &taps[..count], value, means)
    }

    /// Adds weighted values of positions of a block.
    #[inline(always)]
    fn sum_in_block(
        &self,
        block: usize,
        shape: [usize; 4],
        taps: &[(usize, f32)],
        value: &mut [f32],
        means: Means,
    ) -> Result<()> {
        let (word, bit) = (&self.touched[block / 64], 1 << (block % 64));
        // Read first: a write would take the cache line away from other threads.
        if word.load(Ordering::Relaxed) & bit == 0 {
            word.fetch_or(bit, Ordering::Relaxed);
        }
        let slot = &self.cache[block % self.cache.len()];
        let found = slot.load();
        if let Some(cached) = found.as_ref().filter(|cached| cached.block == block) {
            if !cached.used.load(Ordering::Relaxed) {
                cached.used.store(true, Ordering::Relaxed);
            }
            add(taps, &cached.values, value);
            return Ok(());
        }
        drop(found);
        self.sum_uncached(block, shape, taps, value, means)
    }

    /// The same of a block that is not in the cache: from its coefficients until that has taken as long as rebuilding it would.
    fn sum_uncached(
        &self,
        block: usize,
        shape: [usize; 4],
        taps: &[(usize, f32)],
        value: &mut [f32],
        means: Means,
    ) -> Result<()> {
        let mut paid = 1;
        if let Some(sparse) = self.sparse(block, means)? {
            let most = shape.iter().product::<usize>() * value.len() / VALUES_A_LOOKUP;
            let work = taps.len() as u64 * sparse.work;
            let uses = (work / LOOKUP).clamp(1, 1 << 30) as u32;
            let before = sparse.uses.fetch_add(uses, Ordering::Relaxed);
            if before as usize + uses as usize <= most {
                means.spend(work)?;
                let (mut stack, mut heap) = ([0f32; MAX_STACK], Vec::new());
                let point = scratch_values(value.len(), &mut stack, &mut heap);
                for &(index, share) in taps {
                    self.reader.point(&sparse, unravel(index, shape), point)?;
                    value.iter_mut().zip(&*point).for_each(|(sum, v)| *sum += v * share);
                }
                return Ok(());
            }
            // What these look-ups brought with them pays for the rebuilding as well.
            paid += u64::from(before);
            sparse.uses.store(0, Ordering::Relaxed);
        }
        let cached = self.decode(block, Means { free: means.free.saturating_mul(paid), ..means })?;
        self.rebuilt.fetch_add(1, Ordering::Relaxed);
        add(taps, &cached.values, value);
        self.keep(cached);
        Ok(())
    }

    /// Puts a block into the cache, and as many out as make room.
    fn keep(&self, cached: Cached) {
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
    fn sparse(&self, block: usize, means: Means) -> Result<Option<Arc<Sparse>>> {
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

    fn with_scratch<T>(&self, work: impl FnOnce(&mut Scratch) -> T) -> T {
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

    fn decode(&self, block: usize, means: Means) -> Result<Cached> {
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

/// Adds weighted values, `[position][channel]`.
#[inline(always)]
fn add(taps: &[(usize, f32)], values: &[f32], sums: &mut [f32]) {
    if let [r, g, b] = sums {
        // The common case, in registers.
        let mut sum = [*r, *g, *b];
        for &(index, share) in taps {
            if let [x, y, z] = values[3 * index..][..3] {
                sum = [sum[0] + x * share, sum[1] + y * share, sum[2] + z * share];
            }
        }
        [*r, *g, *b] = sum;
        return;
    }
    for &(index, share) in taps {
        let at = &values[index * sums.len()..][..sums.len()];
        sums.iter_mut().zip(at).for_each(|(sum, v)| *sum += v * share);
    }
}

/// A value a channel, on the stack where they are few.
fn scratch_values<'a>(channels: usize, stack: &'a mut [f32; MAX_STACK], heap: &'a mut Vec<f32>) -> &'a mut [f32] {
    if channels <= MAX_STACK {
        return &mut stack[..channels];
    }
    heap.resize(channels, 0.0);
    heap
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::codec::sample::SplitMix64;
    use crate::encode::Encoder;
    use crate::table::BrdfTable;
    use crate::table::coords::{HalfDiff, directions, taps};
    use crate::table::grid::{Axis, Grid, Mapping};
    use crate::table::synth::Recipe;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn small_brdf() -> Brdf<Vec<u8>> {
        let bytes = Encoder::new().block_shape(&[7, 6, 10]).encode(&small_table()).unwrap().bytes;
        Brdf::open(Reader::open(bytes).unwrap()).unwrap()
    }

    fn small_table() -> BrdfTable {
        let axis = |name, len, mapping, end| Axis { name, len, mapping, start: 0.0, end };
        let axes = vec![
            axis(AxisName::ThetaH, 18, Mapping::Square, FRAC_PI_2),
            axis(AxisName::ThetaD, 15, Mapping::Linear, FRAC_PI_2),
            axis(AxisName::PhiD, 24, Mapping::Linear, PI),
        ];
        let grid = Grid::new(axes, Grid::rgb_channels([1.0; 3])).unwrap();
        Recipe::named("satin-paint").unwrap().synthesise(&grid).unwrap()
    }

    fn random_direction(random: &mut SplitMix64) -> [f64; 3] {
        let mut uniform = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        let (z, phi) = (uniform(), 2.0 * PI * uniform());
        let r = (1.0 - z * z).sqrt();
        [r * phi.cos(), r * phi.sin(), z]
    }

    #[test]
    fn eval_is_the_weighted_sum_of_the_decoded_table() {
        for lookup in [Lookup::Nearest, Lookup::Linear] {
            // One place in the cache and no room for coefficients, one place and some room, room for all.
            for cache in [0, 20_000, 1 << 20] {
                let brdf = small_brdf().with_lookup(lookup).with_cache_bytes(cache);
                let table = brdf.reader().decode_all().unwrap();
                let n = brdf.reader().grid().positions();
                let mut random = SplitMix64(3);
                for _ in 0..300 {
                    let (wi, wo) = (random_direction(&mut random), random_direction(&mut random));
                    let value = brdf.eval(wi, wo).unwrap();
                    let at = grid_coordinates(brdf.reader().grid(), wi, wo).unwrap();
                    for (c, value) in value.iter().enumerate() {
                        let expected: f64 = taps(brdf.reader().grid(), at, lookup)
                            .as_slice()
                            .iter()
                            .map(|&(position, weight)| f64::from(table[c * n + position]) * weight)
                            .sum();
                        assert!((f64::from(*value) - expected).abs() <= 1e-5 * expected.abs() + 1e-7);
                    }
                }
                let held = |bytes: usize| {
                    brdf.sparse.iter().filter_map(|slot| slot.load_full()).fold(bytes, |n, s| n + s.bytes())
                };
                assert_eq!(held(0), brdf.sparse_bytes.load(Ordering::Relaxed));
                assert!(held(0) <= cache / SPARSE_SHARE);
                let blocks: Vec<_> = brdf.cache.iter().filter_map(|slot| slot.load_full()).collect();
                let bytes = blocks.iter().map(|block| block.bytes()).sum::<usize>();
                assert_eq!(bytes, brdf.cache_bytes.load(Ordering::Relaxed));
                assert!(bytes <= brdf.cache_most || blocks.len() == 1, "{bytes} bytes, {} blocks", blocks.len());
            }
        }
    }

    #[test]
    fn bin_centres_give_the_bins_value() {
        let brdf = small_brdf();
        let grid = brdf.reader().grid().clone();
        let table = brdf.reader().decode_all().unwrap();
        for (h, d, p) in [(0, 0, 0), (3, 5, 11), (9, 2, 23)] {
            let angle = |axis: usize, i: usize| grid.axes()[axis].angle(i as f64 + 0.5);
            let at = HalfDiff { theta_h: angle(0, h), phi_h: 0.3, theta_d: angle(1, d), phi_d: angle(2, p) };
            let (wi, wo) = directions(at);
            let expected = table[(h * 15 + d) * 24 + p];
            let got = brdf.eval(wi, wo).unwrap()[0];
            assert!((got / expected - 1.0).abs() < 1e-3, "{got} {expected}");
        }
    }

    #[test]
    fn the_reader_comes_back() {
        let up = [0.0, 0.0, 1.0];
        let brdf = small_brdf();
        let (value, crc) = (brdf.eval(up, up).unwrap(), brdf.reader().index_crc());
        let reader = brdf.into_reader();
        assert_eq!(reader.index_crc(), crc);
        assert_eq!(Brdf::open(reader).unwrap().eval(up, up).unwrap(), value);
    }

    #[test]
    fn edges_of_the_domain_are_finite() {
        let brdf = small_brdf();
        let up = [0.0, 0.0, 1.0];
        let graze = [1.0, 0.0, 0.0];
        for (wi, wo) in [(up, up), (graze, graze), (graze, [-1.0, 0.0, 1e-9]), (up, graze), ([1e-200, 0.0, 1e-200], up)]
        {
            assert!(brdf.eval(wi, wo).unwrap().iter().all(|v| v.is_finite() && *v >= 0.0));
        }
        let below = [0.0, 0.6, -0.8];
        for (wi, wo) in
            [(below, up), (up, below), (up, [f64::NAN, 0.0, 1.0]), ([0.0; 3], up), (up, [0.0, 0.0, f64::INFINITY])]
        {
            assert_eq!(brdf.eval(wi, wo).unwrap(), [0.0; 3]);
        }
        assert!(brdf.eval_into(up, up, &mut [0.0; 4]).is_err());
    }

    /// What comes from the coefficients and what comes from the rebuilt block are the same bits.
    #[test]
    fn a_block_is_rebuilt_when_that_pays_and_nothing_changes() {
        let bytes = Encoder::new().block_shape(&[18, 15, 24]).encode(&small_table()).unwrap().bytes;
        let brdf = Brdf::open(Reader::open(bytes).unwrap()).unwrap();
        let mut random = SplitMix64(9);
        let pairs: Vec<_> = (0..40).map(|_| (random_direction(&mut random), random_direction(&mut random))).collect();
        let all = |brdf: &Brdf<_>| -> Vec<_> {
            pairs.iter().map(|&(wi, wo)| brdf.eval(wi, wo).unwrap().map(f32::to_bits)).collect()
        };
        brdf.eval(pairs[0].0, pairs[0].1).unwrap();
        assert!(brdf.cache[0].load().is_none());
        let first = all(&brdf);
        assert!(brdf.cache[0].load().is_some());
        assert_eq!(all(&brdf), first);
    }

    #[test]
    fn many_are_each_one() {
        let brdf = small_brdf();
        let mut random = SplitMix64(11);
        let mut wi: Vec<_> = (0..2 * BATCH + 3).map(|_| random_direction(&mut random)).collect();
        let mut wo: Vec<_> = wi.iter().map(|_| random_direction(&mut random)).collect();
        (wi[0], wo[1], wi[2], wo[3]) = ([0.0, 0.6, -0.8], [f64::NAN, 0.0, 1.0], [0.0; 3], [1e-200, 0.0, 1e-200]);
        (wi[4], wo[4]) = ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]);
        let mut values = vec![7.0; 3 * wi.len()];
        brdf.eval_many(&wi, &wo, &mut values).unwrap();
        for (i, value) in values.chunks_exact(3).enumerate() {
            assert_eq!(value, brdf.eval(wi[i], wo[i]).unwrap(), "pair {i}");
        }
        assert!(brdf.eval_many(&wi, &wo[1..], &mut values).is_err());
        assert!(brdf.eval_many(&wi, &wo, &mut values[1..]).is_err());
        brdf.eval_many(&[], &[], &mut []).unwrap();
    }

    #[test]
    fn threads_agree() {
        let brdf = small_brdf().with_cache_bytes(20_000);
        let pairs: Vec<_> = {
            let mut random = SplitMix64(5);
            (0..200).map(|_| (random_direction(&mut random), random_direction(&mut random))).collect()
        };
        let expected: Vec<_> = pairs.iter().map(|&(wi, wo)| brdf.eval(wi, wo).unwrap()).collect();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for (&(wi, wo), expected) in pairs.iter().zip(&expected) {
                        assert_eq!(brdf.eval(wi, wo).unwrap(), *expected);
                    }
                });
            }
        });
    }
}
