//! BRDF values at pairs of directions, straight from a compressed file.

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};

use arc_swap::ArcSwapOption;

use crate::block::unravel;
use crate::coords::{Around, Lookup, grid_coordinates, neighbours};
use crate::decode::point::Sparse;
use crate::decode::{Reader, Scratch};
use crate::error::{Error, Result};

/// Most blocks whose coefficients are kept: eight bytes a coefficient that is not zero, and a byte an entry where the block has
/// exact zeros.
const SPARSE_BLOCKS: usize = 4096;

/// Values of a block whose rebuilding takes about as long as one look-up from its coefficients: 6 ns a value, 10 us.
const VALUES_A_LOOKUP: usize = 2048;

/// Bytes of decoded blocks that are kept unless the caller says otherwise.
const DEFAULT_BYTES: usize = 64 << 20;

/// Channels whose sums fit on the stack.
const MAX_STACK: usize = 16;

/// A decoded block.
struct Cached {
    block: usize,
    /// `[position][channel]`: a look-up wants all channels of few positions.
    values: Vec<f32>,
}

/// Evaluates a file at directions; rebuilds blocks when that pays and keeps some of them.
///
/// A block is first looked up by its coefficients; once that has taken as long as rebuilding it would, it is rebuilt. So a scene
/// that touches few values of a block does not pay for it, and a cache that is too small costs no more than twice what it must.
///
/// Shared between threads by reference: finding a block in the cache takes no lock.
pub struct Brdf<D> {
    reader: Reader<D>,
    lookup: Lookup,
    /// Direct-mapped: block b lives at b modulo the length.
    cache: Vec<ArcSwapOption<Cached>>,
    /// Coefficients of blocks, likewise.
    sparse: Vec<ArcSwapOption<Sparse>>,
    /// Buffers of decodes, one for each that ever went on at the same time.
    scratch: Mutex<Vec<Scratch>>,
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
        let brdf = Brdf { reader, lookup: Lookup::Linear, cache: Vec::new(), sparse, scratch: Mutex::default() };
        Ok(brdf.with_cache_bytes(DEFAULT_BYTES))
    }

    /// The same with another lookup: nearest bin, or linear between bin centres.
    pub fn with_lookup(self, lookup: Lookup) -> Brdf<D> {
        Brdf { lookup, ..self }
    }

    /// The same with a cache that holds at most so many bytes of decoded blocks, but always one block. The coefficients of up to
    /// 4096 blocks are kept besides: 0.2 MB for most materials, more where noise is coded or entries are exactly zero.
    pub fn with_cache_bytes(self, bytes: usize) -> Brdf<D> {
        let largest = self.reader.partition().largest_block() * self.reader.grid().channels().len();
        self.with_cache(bytes / (largest * size_of::<f32>()))
    }

    /// The same with a cache of at most `blocks` blocks, at least one.
    pub fn with_cache(self, blocks: usize) -> Brdf<D> {
        // An odd length keeps neighbours along the slower axes, often powers of two apart, from sharing a place.
        let odd = blocks.saturating_sub(1) | 1;
        let length = if blocks < self.reader.block_count() { odd } else { self.reader.block_count() };
        Brdf { cache: (0..length).map(|_| ArcSwapOption::empty()).collect(), ..self }
    }

    /// The file.
    pub fn reader(&self) -> &Reader<D> {
        &self.reader
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
        value.fill(0.0);
        let Some(coordinates) = grid_coordinates(grid, wi, wo) else { return Ok(()) };
        self.sum(&neighbours(grid, coordinates, self.lookup), value)?;
        // Weights sum to one only up to rounding, and saturated values stand at the largest finite number.
        value.iter_mut().for_each(|v| *v = v.min(f32::MAX));
        Ok(())
    }

    /// Adds the weighted values of the bins around a place, at most sixteen.
    fn sum(&self, around: &[Around; 4], value: &mut [f32]) -> Result<()> {
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
            // Both sides of the edge, each with its share.
            let [mut below, mut above] = [*around; 2];
            let Around { near, far, weight } = around[a];
            (below[a], above[a]) = (Around { near, far: 0, weight: 0.0 }, Around { near: far, far: 0, weight: 0.0 });
            let (mut stack, mut heap) = ([0f32; MAX_STACK], Vec::new());
            let side = scratch_values(value.len(), &mut stack, &mut heap);
            for (around, share) in [(below, 1.0 - weight), (above, weight)] {
                side.fill(0.0);
                self.sum(&around, side)?;
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
        self.sum_in_block(found.block, found.shape, &taps[..count], value)
    }

    /// Adds weighted values of positions of a block.
    fn sum_in_block(&self, block: usize, shape: [usize; 4], taps: &[(usize, f32)], value: &mut [f32]) -> Result<()> {
        let slot = &self.cache[block % self.cache.len()];
        let found = slot.load();
        if let Some(cached) = found.as_ref().filter(|cached| cached.block == block) {
            add(taps, &cached.values, value);
            return Ok(());
        }
        if let Some(sparse) = self.sparse(block)? {
            let most = shape.iter().product::<usize>() * value.len() / VALUES_A_LOOKUP;
            if (sparse.uses.fetch_add(1, Ordering::Relaxed) as usize) < most {
                let (mut stack, mut heap) = ([0f32; MAX_STACK], Vec::new());
                let point = scratch_values(value.len(), &mut stack, &mut heap);
                for &(index, share) in taps {
                    self.reader.point(&sparse, unravel(index, shape), point)?;
                    value.iter_mut().zip(&*point).for_each(|(sum, v)| *sum += v * share);
                }
                return Ok(());
            }
            sparse.uses.store(0, Ordering::Relaxed);
        }
        let cached = self.decode(block)?;
        add(taps, &cached.values, value);
        slot.store(Some(Arc::new(cached)));
        Ok(())
    }

    /// The coefficients of a block, if single values can be had from them.
    fn sparse(&self, block: usize) -> Result<Option<Arc<Sparse>>> {
        let slot = &self.sparse[block % self.sparse.len()];
        if let Some(sparse) = slot.load_full().filter(|sparse| sparse.block == block) {
            return Ok(Some(sparse));
        }
        let sparse = self.with_scratch(|scratch| self.reader.sparse_block(block, scratch))?.map(Arc::new);
        slot.store(sparse.clone());
        Ok(sparse)
    }

    fn with_scratch<T>(&self, work: impl FnOnce(&mut Scratch) -> T) -> T {
        let lock = || self.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        let mut scratch = lock().pop().unwrap_or_default();
        let result = work(&mut scratch);
        lock().push(scratch);
        result
    }

    fn decode(&self, block: usize) -> Result<Cached> {
        let mut planes = vec![0.0; self.reader.block_values(block)?];
        self.with_scratch(|scratch| self.reader.block_with(block, scratch, &mut planes))?;
        let channels = self.reader.grid().channels().len();
        let mut values = vec![0.0; planes.len()];
        for (c, plane) in planes.chunks_exact(planes.len() / channels).enumerate() {
            values[c..].iter_mut().step_by(channels).zip(plane).for_each(|(value, v)| *value = *v);
        }
        Ok(Cached { block, values })
    }
}

/// Adds weighted values, `[position][channel]`.
#[inline(always)]
fn add(taps: &[(usize, f32)], values: &[f32], sums: &mut [f32]) {
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
    use crate::coords::{HalfDiff, directions, taps};
    use crate::encode::Encoder;
    use crate::grid::{Axis, AxisName, Grid, Mapping};
    use crate::sample::SplitMix64;
    use crate::table::BrdfTable;
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
            // One place in the cache: every other block evicts.
            for cache in [1, 64] {
                let brdf = small_brdf().with_lookup(lookup).with_cache(cache);
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
    fn threads_agree() {
        let brdf = small_brdf().with_cache(2);
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
