//! Measurement plans: the bins that the encoder would sample, and directions at which to measure them.
//!
//! The draw is the encoder's (spec section 4.3): the same seed, ratio and block shape on a table whose valid entries
//! are [`measurable`] gives the same positions. All angles are in radians, all directions unit vectors as in
//! [`Brdf::eval`](crate::Brdf::eval).

use crate::base::error::{Error, Result};
use crate::base::limits::check_block;
use crate::codec::sample::{Sampling, block_seed, sample_positions};
use crate::table::block::{Partition, unravel};
pub use crate::table::coords::HalfDiff;
use crate::table::coords::directions;
use crate::table::grid::Grid;
use crate::table::horizon::Horizon;
use crate::table::parameterization::Parameterization;

/// Lowest `z` of a planned direction: 0.06 degrees above the horizon, so that no rounding puts it below.
pub const LOWEST: f64 = 1e-3;

/// Steps from the centre of a bin towards its highest point, and how near to its edges they end, in bins.
const STEPS: usize = 8;
const MARGIN: f64 = 0.02;

/// Orders rows by strips of this width, degrees.
///
/// Measured, 5 % of MERL's grid, mean over rows of the largest of the moves of theta_i, theta_o and phi_o: 2.75 degrees;
/// with strips of 2, 3, 5, 8 degrees 6.2, 3.4, 2.6, 3.6; by theta_i alone 68; at random 76. Below 5 degrees theta_i
/// moves less.
const STRIP: f64 = 4.0;

/// One measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// Bins along theta_h, theta_d and phi_d.
    pub bin: [usize; 3],
    /// Angles within the bin; `phi_h` is such that `wi` has azimuth 0.
    pub angles: HalfDiff,
    /// Direction to the light, in the x-z plane: `y` is 0, `x` not negative.
    pub wi: [f64; 3],
    /// Direction to the sensor.
    pub wo: [f64; 3],
}

impl Measurement {
    /// Elevations from the normal and azimuths, as instruments want them: theta_i, phi_i, theta_o, phi_o.
    pub fn instrument_angles(&self) -> [f64; 4] {
        let theta = |w: [f64; 3]| w[0].hypot(w[1]).atan2(w[2]);
        let phi = |w: [f64; 3]| w[1].atan2(w[0]).rem_euclid(std::f64::consts::TAU);
        [theta(self.wi), phi(self.wi), theta(self.wo), phi(self.wo)]
    }

    /// The measurement of a bin: at its centre (bin coordinate `i + 0.5`, as [`Parameterization::coordinates`]
    /// counts) if both directions there are above the horizon by [`LOWEST`], else at the nearest of eight points from
    /// there to the bin's highest one; `None` if none of them is.
    fn of_bin(grid: &Grid, bin: [usize; 3]) -> Option<Measurement> {
        let start: [f64; 3] = bin.map(|i| i as f64 + 0.5);
        // The horizon is farthest where theta_h and theta_d are small and phi_d is near a quarter turn.
        let mut highest = bin.map(|i| i as f64 + MARGIN);
        let abs_cos = |u: f64| grid.axes()[2].angle(u).cos().abs();
        if abs_cos(start[2] + 0.5 - MARGIN) < abs_cos(highest[2]) {
            highest[2] = start[2] + 0.5 - MARGIN;
        }
        (0..=STEPS).find_map(|step| {
            let share = step as f64 / STEPS as f64;
            let angle = |k: usize| grid.axes()[k].angle(start[k] + share * (highest[k] - start[k]));
            let angles = HalfDiff { theta_h: angle(0), phi_h: 0.0, theta_d: angle(1), phi_d: angle(2) };
            let (wi, wo) = directions(angles);
            (wi[2].min(wo[2]) >= LOWEST).then(|| Measurement { bin, angles, wi, wo }.turned())
        })
    }

    /// The same pair turned about the normal until `wi` has azimuth 0: an isotropic material looks the same.
    fn turned(self) -> Measurement {
        let ([x, y, z], wo) = (self.wi, self.wo);
        let radius = x.hypot(y);
        if radius < 1e-12 {
            return self;
        }
        let (cos, sin) = (x / radius, y / radius);
        let turn = |w: [f64; 3]| [cos * w[0] + sin * w[1], cos * w[1] - sin * w[0], w[2]];
        let phi_h = (-sin).atan2(cos).rem_euclid(std::f64::consts::TAU);
        Measurement { angles: HalfDiff { phi_h, ..self.angles }, wi: [radius, 0.0, z], wo: turn(wo), ..self }
    }
}

/// Fails unless the grid has the axes theta_h, theta_d and phi_d and no others, in this order.
fn check_axes(grid: &Grid) -> Result<()> {
    match Parameterization::grazing_axes(grid) {
        Some(_) => Ok(()),
        None => {
            Err(Error::InvalidArgument("the grid must have the axes theta_h, theta_d, phi_d, as MERL's has".into()))
        }
    }
}

/// The measurement of every position of the grid; `None` where no pair of directions above the horizon falls into the
/// bin, or only pairs so near to it that no instrument keeps them apart from it.
///
/// On MERL's grid 1,112,344 of the 1,114,044 possible bins: 1,095,076 at their centres, 17,268 off them, near the horizon;
/// 1,700 are left out.
///
/// # Errors
/// `InvalidArgument` unless the axes are theta_h, theta_d, phi_d.
pub fn measurable(grid: &Grid) -> Result<Vec<Option<Measurement>>> {
    check_axes(grid)?;
    let horizon = Horizon::new(grid).expect("it has the axes");
    let at = |i: usize| {
        let position = unravel(i, grid.shape());
        let [_, h, d, p] = position;
        if horizon.is_impossible(position) { None } else { Measurement::of_bin(grid, [h, d, p]) }
    };
    Ok((0..grid.positions()).map(at).collect())
}

/// What to measure, and how it was drawn.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Plan {
    /// The grid of the table to come.
    pub grid: Grid,
    /// Share of the bins that is drawn.
    pub sampling: Sampling,
    /// Seed of the draw.
    pub seed: u64,
    /// Block lengths along theta_h, theta_d and phi_d.
    pub block_shape: [usize; 3],
    /// Bins that the draw chose from.
    pub candidates: usize,
    /// The measurements, in an order in which an instrument moves little.
    pub rows: Vec<Measurement>,
}

impl Plan {
    /// Draws among the measurable bins, or, where `valid` is given (one flag a position), among those that are also
    /// flagged.
    ///
    /// # Errors
    /// `InvalidArgument` unless the axes are theta_h, theta_d, phi_d, the block shape is within the format's limits,
    /// the ratio above 0, the flags one a position, and anything is left to measure.
    pub fn draw(
        grid: &Grid,
        sampling: Sampling,
        seed: u64,
        block_shape: [usize; 3],
        valid: Option<&[bool]>,
    ) -> Result<Plan> {
        let [h, d, p] = block_shape;
        let partition = Partition::uniform(grid.shape(), [1, h, d, p])?;
        for &shape in partition.shapes() {
            check_block(shape, grid.channels().len()).map_err(Error::InvalidArgument)?;
        }
        if sampling == (Sampling::Bernoulli { threshold: 0 }) {
            return Err(Error::InvalidArgument("a sampling ratio of zero leaves nothing to measure".into()));
        }
        let measurable = measurable(grid)?;
        if valid.is_some_and(|valid| valid.len() != measurable.len()) {
            return Err(Error::InvalidArgument(format!("{} bins need as many validity flags", measurable.len())));
        }
        let drawable: Vec<bool> =
            (0..measurable.len()).map(|i| measurable[i].is_some() && valid.is_none_or(|valid| valid[i])).collect();
        let mut drawn = vec![false; drawable.len()];
        for number in 0..partition.block_count() {
            let block = partition.block(number).expect("number is below the count");
            let mut valid = vec![false; block.positions()];
            block.gather(grid.shape(), &drawable, &mut valid);
            let mut taken = vec![false; block.positions()];
            for position in sample_positions(block_seed(seed, number as u32), sampling, &valid) {
                taken[position as usize] = true;
            }
            block.scatter(grid.shape(), &taken, &mut drawn);
        }
        let mut rows: Vec<Measurement> =
            measurable.iter().zip(&drawn).filter_map(|(m, drawn)| m.filter(|_| *drawn)).collect();
        if rows.is_empty() {
            return Err(Error::InvalidArgument(
                "no bin was drawn; raise the sampling ratio or give other tables".into(),
            ));
        }
        order(&mut rows);
        let candidates = drawable.iter().filter(|d| **d).count();
        Ok(Plan { grid: grid.clone(), sampling, seed, block_shape, candidates, rows })
    }

    /// Linear index of a row's bin into the planes of a table.
    pub fn position(&self, row: &Measurement) -> usize {
        let [_, _, d, p] = self.grid.shape();
        (row.bin[0] * d + row.bin[1]) * p + row.bin[2]
    }
}

/// Orders rows as a snake: the light in strips of theta_i, in each the sensor to and fro in strips of theta_o, in each
/// of these to and fro in phi_o.
fn order(rows: &mut [Measurement]) {
    rows.sort_by_cached_key(|row| {
        let [theta_i, _, theta_o, phi_o] = row.instrument_angles().map(f64::to_degrees);
        let strip = |angle: f64| (angle / STRIP) as i64;
        let (i, o) = (strip(theta_i), strip(theta_o));
        let o = if i % 2 == 0 { o } else { -o };
        // Micro-degrees: an ordered key of whole numbers.
        let phi = (phi_o * 1e6) as i64;
        (i, o, if (i + o) % 2 == 0 { phi } else { -phi }, row.bin)
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::{Origin, Reader};
    use crate::encode::Encoder;
    use crate::table::Table;
    use crate::table::coords::{Lookup, half_diff, taps};
    use crate::table::parameterization::grid_coordinates;
    use proptest::prelude::*;

    fn small() -> Grid {
        Grid::merl().with_lengths(&[20, 20, 36]).unwrap()
    }

    /// The bin that a lookup reads at the row's directions.
    fn bin_of(plan: &Plan, row: &Measurement) -> usize {
        let coordinates = grid_coordinates(&plan.grid, row.wi, row.wo).unwrap();
        taps(&plan.grid, coordinates, Lookup::Nearest).as_slice()[0].0
    }

    impl Measurement {
        fn angles_at(&self, axis: usize) -> f64 {
            [self.angles.theta_h, self.angles.theta_d, self.angles.phi_d][axis]
        }
    }

    fn check(plan: &Plan) {
        for row in &plan.rows {
            assert_eq!(bin_of(plan, row), plan.position(row), "{row:?}");
            let angles = half_diff(row.wi, row.wo).unwrap();
            let apart = |a: f64, b: f64| (a - b).abs().min(std::f64::consts::TAU - (a - b).abs());
            assert!((angles.theta_h - row.angles.theta_h).abs() < 1e-12, "{row:?} {angles:?}");
            assert!((angles.theta_d - row.angles.theta_d).abs() < 1e-12, "{row:?} {angles:?}");
            assert!(apart(angles.phi_d, row.angles.phi_d) < 1e-9, "{row:?} {angles:?}");
            assert!(apart(angles.phi_h, row.angles.phi_h) < 1e-9, "{row:?} {angles:?}");
            assert!(row.wi[2] >= LOWEST && row.wo[2] >= LOWEST && row.wi[1] == 0.0);
        }
    }

    #[test]
    fn every_measurable_bin_of_merl_is_found_again_from_its_directions() {
        for grid in [Grid::merl(), Grid::merl_360()] {
            let plan = Plan::draw(&grid, Sampling::Every, 0, [15, 15, 15], None).unwrap();
            check(&plan);
            let centred =
                |row: &&Measurement| (0..3).all(|k| row.angles_at(k) == grid.axes()[k].angle(row.bin[k] as f64 + 0.5));
            let centred = plan.rows.iter().filter(centred).count();
            let halves = grid.shape()[3] / 180;
            assert_eq!((plan.rows.len(), centred), (1_112_344 * halves, 1_095_076 * halves));
        }
    }

    #[test]
    fn the_positions_are_those_of_the_encoder() {
        let grid = small();
        let valid: Vec<bool> = measurable(&grid).unwrap().iter().map(Option::is_some).collect();
        let table = Table::from_parts(grid.clone(), vec![1.0; 3 * valid.len()], valid.repeat(3)).unwrap();
        let sampling = Sampling::from_ratio(0.1).unwrap();
        let plan = Plan::draw(&grid, sampling, 77, [7, 20, 15], None).unwrap();
        let encoder = Encoder::new().block_shape(&[7, 20, 15]).sampling(sampling).seed(77);
        let reader = Reader::open(encoder.encode(&table).unwrap().bytes).unwrap();
        let mut sampled = vec![false; grid.positions()];
        for number in 0..reader.block_count() {
            let block = reader.partition().block(number).unwrap();
            let origins: Vec<bool> =
                reader.block_origin(number).unwrap().iter().map(|o| *o == Origin::Sampled).collect();
            block.scatter(grid.shape(), &origins[..block.positions()], &mut sampled);
        }
        let mut planned = vec![false; grid.positions()];
        plan.rows.iter().for_each(|row| planned[plan.position(row)] = true);
        assert!(planned == sampled && plan.rows.len() == sampled.iter().filter(|s| **s).count());
        assert_eq!(plan.candidates, valid.iter().filter(|v| **v).count());
    }

    proptest! {
        #[test]
        fn any_seed_gives_rows_that_lead_back_to_their_bins(
            seed in any::<u64>(), ratio in 0.01f64..1.0, shape in prop::array::uniform3(1usize..40),
            holes in prop::option::of(any::<u64>()),
        ) {
            let grid = small();
            let valid: Option<Vec<bool>> = holes.map(|holes| {
                let mut random = crate::codec::sample::SplitMix64(holes);
                (0..grid.positions()).map(|_| !random.next_u64().is_multiple_of(3)).collect()
            });
            let plan = Plan::draw(&grid, Sampling::from_ratio(ratio).unwrap(), seed, shape, valid.as_deref()).unwrap();
            check(&plan);
            let mut bins: Vec<usize> = plan.rows.iter().map(|row| plan.position(row)).collect();
            prop_assert!(valid.is_none_or(|valid| bins.iter().all(|&b| valid[b])));
            bins.sort_unstable();
            bins.dedup();
            prop_assert_eq!(bins.len(), plan.rows.len());
        }
    }

    #[test]
    fn senseless_plans_are_refused() {
        let grid = small();
        let ratio = Sampling::from_ratio(0.5).unwrap();
        let none = vec![false; grid.positions()];
        let draw = |grid: &Grid, sampling, shape, valid| Plan::draw(grid, sampling, 0, shape, valid);
        assert!(draw(&Grid::merl(), Sampling::Every, [90, 90, 180], None).is_err(), "more than encode takes");
        assert!(draw(&grid, ratio, [0, 1, 1], None).is_err());
        assert!(draw(&grid, Sampling::Bernoulli { threshold: 0 }, [5, 5, 5], None).is_err());
        assert!(draw(&grid, ratio, [5, 5, 5], Some(&[true])).is_err());
        assert!(draw(&grid, ratio, [5, 5, 5], Some(&none)).is_err());
        let flat = Grid::new(grid.axes()[..2].to_vec(), grid.channels().to_vec()).unwrap();
        assert!(draw(&flat, ratio, [5, 5, 5], None).is_err());
    }
}
