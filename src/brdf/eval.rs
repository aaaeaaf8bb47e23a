//! BRDF values at pairs of directions, straight from a compressed file.

use std::sync::atomic::Ordering;

use super::Brdf;
use super::cache::Means;
use crate::base::budget::Budget;
use crate::base::error::{Error, Result};
use crate::table::block::unravel;
use crate::table::coords::{Around, BATCH, Batch, neighbours};
use crate::table::parameterization::{Parameterization, no_directions};

/// Values of a block whose rebuilding takes about as long as one look-up from its coefficients: 6 ns a value, 10 us.
const VALUES_A_LOOKUP: usize = 2048;
/// Operations of such a look-up as `cost` counts them, three for a nanosecond here. A dearer one counts as several: look-ups in a block
/// never take much longer than rebuilding it.
const LOOKUP: u64 = 36_864;

/// Channels whose sums fit on the stack.
const MAX_STACK: usize = 16;

impl Brdf {
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
        self.at(self.directions()?.coordinates(wi, wo), value, self.means())
    }

    /// As [`Brdf::eval_into`], all of it on the budget of a call that makes many look-ups.
    pub(crate) fn eval_within(&self, budget: &Budget, wi: [f64; 3], wo: [f64; 3], value: &mut [f32]) -> Result<()> {
        self.at(self.directions()?.coordinates(wi, wo), value, Means { budget, free: 0 })
    }

    /// Whether the file's axes are angles of directions, so that it can be evaluated; they always are but with
    /// [`BrdfOptions::any_axes`](super::BrdfOptions::any_axes).
    ///
    /// # Errors
    /// `InvalidArgument`, with the axes' names, if they are not.
    pub fn check_directions(&self) -> Result<()> {
        self.directions().map(|_| ())
    }

    /// How directions map to the file's grid.
    fn directions(&self) -> Result<&Parameterization> {
        match &self.parameterization {
            Some(parameterization) => Ok(parameterization),
            None => Err(no_directions(self.reader.grid())),
        }
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
        let parameterization = self.directions()?;
        if !parameterization.takes_batches() {
            let pairs = wi.iter().zip(wo).zip(values.chunks_exact_mut(channels));
            return pairs.into_iter().try_for_each(|((wi, wo), value)| self.eval_into(*wi, *wo, value));
        }
        let (mut batch, means) = (Batch::new(), self.means());
        let pairs = wi.chunks(BATCH).zip(wo.chunks(BATCH)).zip(values.chunks_mut(BATCH * channels));
        for ((wi, wo), values) in pairs {
            batch.fill(wi, wo);
            for (i, value) in values.chunks_exact_mut(channels).enumerate() {
                self.at(parameterization.batch_coordinates(&batch, i, wi[i], wo[i]), value, means)?;
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
        let cached = self.rebuild(block, Means { free: means.free.saturating_mul(paid), ..means })?;
        self.rebuilt.fetch_add(1, Ordering::Relaxed);
        add(taps, &cached.values, value);
        self.keep(cached);
        Ok(())
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
    use super::super::BrdfOptions;
    use super::super::cache::SPARSE_SHARE;
    use super::*;
    use crate::table::parameterization::grid_coordinates;
    use crate::codec::sample::SplitMix64;
    use crate::encode::Encoder;
    use crate::table::Table;
    use crate::table::coords::{HalfDiff, Lookup, directions, taps};
    use crate::table::grid::{Axis, AxisName, Grid, Mapping};
    use crate::table::synth::Recipe;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn small_brdf() -> Brdf {
        small_with(BrdfOptions::new())
    }

    fn small_with(options: BrdfOptions) -> Brdf {
        let bytes = Encoder::new().block_shape(&[7, 6, 10]).encode(&small_table()).unwrap().bytes;
        options.from_bytes(bytes).unwrap()
    }

    fn small_table() -> Table {
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
                let brdf = small_with(BrdfOptions::new().lookup(lookup).cache_bytes(cache));
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
        assert_eq!(Brdf::from_reader(reader).unwrap().eval(up, up).unwrap(), value);
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
        let brdf = Brdf::from_bytes(bytes).unwrap();
        let mut random = SplitMix64(9);
        let pairs: Vec<_> = (0..40).map(|_| (random_direction(&mut random), random_direction(&mut random))).collect();
        let all = |brdf: &Brdf| -> Vec<_> {
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
        let brdf = small_with(BrdfOptions::new().cache_bytes(20_000));
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
