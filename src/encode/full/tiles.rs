//! Choice of the block shape of each tile (encoder only).
//!
//! No shape is best everywhere: blocks long in phi_d and wide win where a table is smooth, small ones at its edges.
//! Measured at step 0.1, bytes to log rms .01 by the slope of the curve (kB), one shape 9 x 9 x 60 -> tiles of 18 x 18 x 60 ->
//! of 18 x 18 x 180: alum-bronze 29 -> 26 -> 20; chrome-steel 34 -> 31 -> 24; RGL golden yellow 52 -> 48 -> 48; paper
//! white 14 -> 13 -> 13.5. So both tilings are tried.

use rayon::prelude::*;

use super::table::FullTable;
use crate::base::error::{Error, Result};
use crate::codec::dependent::Quantization;
use crate::codec::contexts::COEFFICIENTS;
use crate::codec::entropy::Walk;
use crate::codec::range::{Costs, Counter};
use crate::encode::effort::Effort;
use crate::encode::progress::Progress;
use crate::encode::settings::Encoder;
use crate::base::limits::check_block;
use crate::format::profile::write_profile;
use crate::table::block::{Block, Partition};
use crate::table::grid::Grid;

/// Bytes that each block costs in index and record besides its coefficients.
const OVERHEAD: f64 = 10.5;

/// Every fourth block of the first shape trains the costs by which the others are judged, and decides whether a profile pays.
const TRAINING: usize = 4;

/// Squared error that a bit buys, in squared steps: what changing the rounding does (alum-bronze, golden yellow).
const EXCHANGE: f64 = 0.07;

/// Wide tiles with shapes of their own, and narrow ones that divide them; by number of axes, slowest axis first. The first
/// narrow shape trains the cost of the others.
struct Tilings {
    wide: &'static [usize],
    wide_shapes: &'static [&'static [usize]],
    narrow: &'static [usize],
    narrow_shapes: &'static [&'static [usize]],
}

fn tilings(axes: usize) -> Tilings {
    match axes {
        1 => Tilings { wide: &[180], wide_shapes: &[&[180]], narrow: &[60], narrow_shapes: &[&[36], &[60], &[12]] },
        2 => Tilings {
            wide: &[18, 180],
            wide_shapes: &[&[18, 180], &[9, 180]],
            narrow: &[18, 60],
            narrow_shapes: &[&[9, 60], &[18, 60], &[9, 20]],
        },
        3 => Tilings {
            wide: &[18, 18, 180],
            wide_shapes: &[&[18, 18, 180], &[9, 9, 180], &[9, 18, 180], &[18, 9, 180]],
            narrow: &[18, 18, 60],
            narrow_shapes: &[&[9, 9, 60], &[18, 18, 60], &[9, 9, 20], &[6, 9, 60], &[9, 18, 60], &[18, 9, 60]],
        },
        _ => Tilings {
            wide: &[10, 12, 12, 36],
            wide_shapes: &[&[10, 6, 12, 36], &[5, 6, 12, 36]],
            narrow: &[10, 12, 12, 18],
            narrow_shapes: &[&[5, 6, 6, 18], &[5, 6, 12, 18], &[5, 6, 6, 9]],
        },
    }
}

/// The tiles of a tiling, and what each costs in each shape.
struct Tiles {
    /// Of a tile that is not cut short.
    shape: [usize; 4],
    tiles: Vec<Block>,
    shapes: Vec<[usize; 4]>,
    /// `[tile][shape]`, infinite where not tried.
    prices: Vec<Vec<f64>>,
}

impl Tiles {
    fn new(shape: [usize; 4], tiles: Vec<Block>, shapes: Vec<[usize; 4]>) -> Tiles {
        let prices = vec![vec![f64::INFINITY; shapes.len()]; tiles.len()];
        Tiles { shape, tiles, shapes, prices }
    }

    /// The tiles that begin in a box.
    fn inside(&self, place: &Block) -> Vec<usize> {
        let holds = |a: usize, b: &Block| (place.origin[a]..place.origin[a] + place.shape[a]).contains(&b.origin[a]);
        (0..self.tiles.len()).filter(|&i| (0..4).all(|a| holds(a, &self.tiles[i]))).collect()
    }

    /// Prices tiles in the shapes that are `wanted`, by tile and shape, and were not tried.
    fn price(
        &mut self,
        wanted: &dyn Fn(usize, usize) -> bool,
        costs: &Costs,
        price: impl Fn(&mut Walk, &mut Costs, &[Block]) -> Result<f64> + Sync,
    ) -> Result<()> {
        let pairs = (0..self.tiles.len()).flat_map(|t| (0..self.shapes.len()).map(move |s| (t, s)));
        let pairs: Vec<(usize, usize)> =
            pairs.filter(|&(t, s)| wanted(t, s) && self.prices[t][s].is_infinite()).collect();
        let prices: Vec<f64> = pairs
            .par_iter()
            .with_max_len(1)
            .map_init(
                || (Walk::default(), costs.clone()),
                |(walk, costs), &(t, s)| price(walk, costs, &cut(&self.tiles[t], self.shapes[s])),
            )
            .collect::<Result<_>>()?;
        pairs.iter().zip(prices).for_each(|(&(t, s), price)| self.prices[t][s] = price);
        Ok(())
    }
}

/// Padded in front with ones and clipped.
fn clipped(shape: &[usize], within: [usize; 4]) -> [usize; 4] {
    let padding = 4 - shape.len();
    std::array::from_fn(|a| if a < padding { 1 } else { shape[a - padding].min(within[a]) })
}

/// The blocks of a box, in the order of the format.
fn cut(place: &Block, shape: [usize; 4]) -> Vec<Block> {
    let counts: [usize; 4] = std::array::from_fn(|a| place.shape[a].div_ceil(shape[a]));
    crate::table::block::positions(counts)
        .map(|at| Block {
            origin: std::array::from_fn(|a| place.origin[a] + at[a] * shape[a]),
            shape: std::array::from_fn(|a| shape[a].min(place.shape[a] - at[a] * shape[a])),
        })
        .collect()
}

/// The tilings of a table's grid, with the shapes that may be tried.
struct Candidates {
    wide: Tiles,
    narrow: Tiles,
    /// The narrow shape that leaves a tile uncut, or the first.
    uncut: usize,
    /// Numbers of the narrow tiles within each wide one.
    held: Vec<Vec<usize>>,
}

impl Candidates {
    fn new(grid: &Grid, effort: Effort) -> Result<Candidates> {
        let channels = grid.channels().len();
        let Tilings { wide, wide_shapes, narrow, narrow_shapes } = tilings(grid.axes().len());
        let (wide_tile, narrow_tile) = (clipped(wide, grid.shape()), clipped(narrow, grid.shape()));
        let usable = |shapes: &[&[usize]], tile: [usize; 4]| {
            let mut all: Vec<[usize; 4]> = Vec::new();
            for shape in shapes.iter().map(|shape| clipped(shape, tile)) {
                if check_block(shape, channels).is_ok() && !all.contains(&shape) {
                    all.push(shape);
                }
            }
            all
        };
        let mut narrow_shapes = usable(narrow_shapes, narrow_tile);
        let mut wide_shapes = usable(wide_shapes, wide_tile);
        if effort == Effort::Fast {
            narrow_shapes.truncate(4);
            wide_shapes.truncate(1);
        }
        wide_shapes.retain(|shape| !narrow_shapes.contains(shape));
        if narrow_shapes.is_empty() {
            return Err(Error::InvalidArgument(format!(
                "with {channels} channels no usual block shape is within the format's limits; give a smaller one"
            )));
        }
        let whole = Block { origin: [0; 4], shape: grid.shape() };
        let uncut = narrow_shapes.iter().position(|shape| *shape == narrow_tile).unwrap_or(0);
        let wide = Tiles::new(wide_tile, cut(&whole, wide_tile), wide_shapes);
        let narrow = Tiles::new(narrow_tile, cut(&whole, narrow_tile), narrow_shapes);
        let held = wide.tiles.iter().map(|tile| narrow.inside(tile)).collect();
        Ok(Candidates { wide, narrow, uncut, held })
    }

    /// What each wide tile costs uncut, over what the narrow ones in it cost uncut.
    fn ratios(&self) -> Vec<f64> {
        let ratio = |(t, held): (usize, &Vec<usize>)| {
            let uncut = self.wide.prices[t].first().copied().unwrap_or(f64::INFINITY);
            uncut / held.iter().map(|&i| self.narrow.prices[i][self.uncut]).sum::<f64>()
        };
        self.held.iter().enumerate().map(ratio).collect()
    }

    /// The partition of the cheaper tiling, each tile in its cheapest shape.
    fn cheapest(self, grid: &Grid) -> Result<Partition> {
        let least = |prices: &[f64]| {
            let best = (0..prices.len()).min_by(|&a, &b| prices[a].total_cmp(&prices[b])).unwrap_or(0);
            (best, prices[best])
        };
        let Candidates { wide, narrow, held, .. } = self;
        let narrow_choice: Vec<(usize, f64)> = narrow.prices.iter().map(|prices| least(prices)).collect();
        // A wide tile may also be cut by a shape of the narrow ones that it holds.
        let wide_choice: Vec<(usize, f64)> = wide
            .prices
            .iter()
            .zip(&held)
            .map(|(prices, held)| {
                let cut = (0..narrow.shapes.len()).map(|s| held.iter().map(|&i| narrow.prices[i][s]).sum::<f64>());
                least(&prices.iter().copied().chain(cut).collect::<Vec<f64>>())
            })
            .collect();
        let total = |choice: &[(usize, f64)]| choice.iter().map(|c| c.1).sum::<f64>();
        if total(&wide_choice) < total(&narrow_choice) {
            let shapes = [wide.shapes, narrow.shapes].concat();
            tiled(grid.shape(), wide.shape, &shapes, &wide_choice)
        } else {
            tiled(grid.shape(), narrow.shape, &narrow.shapes, &narrow_choice)
        }
    }
}

/// The cheapest partition of a table: bits and squared error at the exchange rate of the quantiser.
pub(in crate::encode) fn choose(
    settings: &Encoder,
    full: &FullTable,
    grid: &Grid,
    progress: Progress,
) -> Result<Partition> {
    let mut candidates = Candidates::new(grid, settings.effort)?;
    let whole = Block { origin: [0; 4], shape: grid.shape() };
    let training: Vec<Block> = cut(&whole, candidates.narrow.shapes[0]).into_iter().step_by(TRAINING).collect();
    let costs = Costs::new(&count(settings, full, &training)?.0);
    progress.reach(0.1);
    let price = |tiles: &mut Tiles, wanted: &dyn Fn(usize, usize) -> bool| {
        tiles.price(wanted, &costs, |walk, costs, blocks| price(settings, full, walk, costs, blocks))
    };
    // A wide tile uncut, and its narrow ones uncut: where one is far from the other, so are the shapes that go with it.
    let uncut = candidates.uncut;
    price(&mut candidates.narrow, &|_, s| s == uncut)?;
    price(&mut candidates.wide, &|_, s| s == 0)?;
    progress.reach(0.35);
    let (margin, ratios) = (settings.effort.tile_margin(), candidates.ratios());
    let mut holder = vec![0; candidates.narrow.tiles.len()];
    candidates.held.iter().enumerate().for_each(|(t, held)| held.iter().for_each(|&i| holder[i] = t));
    price(&mut candidates.narrow, &|i, _| ratios[holder[i]] * margin > 1.0)?;
    progress.reach(0.7);
    price(&mut candidates.wide, &|t, _| ratios[t] < margin)?;
    progress.reach(1.0);
    candidates.cheapest(grid)
}

/// Whether a table takes fewer bits with its profile taken out, in blocks of the first narrow shape; the squared error counts
/// at the exchange rate.
pub(in crate::encode) fn profile_pays(settings: &Encoder, plain: &FullTable, steep: &FullTable, grid: &Grid) -> Result<bool> {
    let shape = clipped(tilings(grid.axes().len()).narrow_shapes[0], grid.shape());
    let whole = Block { origin: [0; 4], shape: grid.shape() };
    let (touched, others): (Vec<Block>, Vec<Block>) =
        cut(&whole, shape).into_iter().step_by(TRAINING).partition(|block| steep.differs(plain, block));
    let others = count(settings, plain, &others)?;
    let step = f64::from(settings.step);
    let price = |full: &FullTable| -> Result<f64> {
        let (mut counter, squared_error) = count(settings, full, &touched)?;
        counter.add(&others.0);
        Ok(counter.bits() + squared_error / (EXCHANGE * step * step))
    };
    let profile = steep.profile.as_ref().map_or(0, |profile| 8 * write_profile(profile).len());
    let profile = (profile / TRAINING) as f64;
    Ok(price(steep)? + profile < price(plain)?)
}

/// Decisions of blocks by context, and the blocks' squared error.
fn count(settings: &Encoder, full: &FullTable, blocks: &[Block]) -> Result<(Counter, f64)> {
    let parts: Vec<(Counter, f64)> = blocks
        .par_iter()
        .map_init(Walk::default, |walk, block| {
            let quantized = full.quantize_trial(settings, block)?;
            let mut counter = Counter::new(COEFFICIENTS);
            let coded = walk.code(&mut counter, Quantization::Scalar, block.shape, &quantized.coefficients);
            debug_assert!(coded.is_ok(), "the quantiser bounds the coefficients");
            Ok((counter, quantized.squared_error))
        })
        .collect::<Result<_>>()?;
    // In the order of the blocks, so that sums do not depend on the number of threads.
    Ok(parts.into_iter().fold((Counter::new(COEFFICIENTS), 0.0), |(mut sum, errors), (counter, error)| {
        sum.add(&counter);
        (sum, errors + error)
    }))
}

/// Bits of blocks, with their squared error at the exchange rate.
fn price(
    settings: &Encoder,
    full: &FullTable,
    walk: &mut Walk,
    costs: &mut Costs,
    blocks: &[Block],
) -> Result<f64> {
    let mut price = 0.0;
    for block in blocks {
        let quantized = full.quantize_trial(settings, block)?;
        let coded = walk.code(costs, Quantization::Scalar, block.shape, &quantized.coefficients);
        debug_assert!(coded.is_ok(), "the quantiser bounds the coefficients");
        let step = f64::from(settings.step);
        price += costs.take_bits() + 8.0 * OVERHEAD + quantized.squared_error / (EXCHANGE * step * step);
    }
    Ok(price)
}

/// The partition with the shapes that some tile has.
fn tiled(grid: [usize; 4], tile: [usize; 4], shapes: &[[usize; 4]], choice: &[(usize, f64)]) -> Result<Partition> {
    let mut used: Vec<usize> = choice.iter().map(|c| c.0).collect();
    used.sort_unstable();
    used.dedup();
    let number = |shape: usize| used.iter().position(|&u| u == shape).expect("among those used") as u8;
    let choice = choice.iter().map(|c| number(c.0)).collect();
    Partition::tiled(grid, tile, used.iter().map(|&u| shapes[u]).collect(), choice)
}
