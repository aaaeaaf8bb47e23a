//! The grazing profile: what the logarithm does near the horizon of either direction (spec section 4.10).
//!
//! Towards grazing directions a BRDF follows the elevations of light and sensor (masking, shadowing, 1 / cos), whose
//! lines of equal value cross the grid of half and difference angles at a slant: no block of Fourier terms is sparse
//! there. Tables over (theta_h, elevation) and (theta_d, elevation) take that part out; they take a few hundred bytes.

mod add;

use self::add::Add;
use crate::base::budget::filled;
use crate::base::portable::sin_cos;
use crate::base::simd::Level;
use crate::table::block::Block;
use crate::table::grid::Grid;
use crate::table::parameterization::Parameterization;

/// Tables of a profile: over theta_h even and odd, over theta_d even and odd.
pub(crate) const TABLES: usize = 4;

/// Tables of a profile and the angles of the grid that it is for.
#[derive(Debug)]
pub(crate) struct Profile {
    knots: usize,
    /// Elevations times this are squares of the place among the knots.
    scale: f32,
    /// The profile is zero from this elevation on: rounding included, so that it need not be asked for.
    end: f32,
    /// Over theta_h, the same for both directions and opposite for them; likewise over theta_d.
    /// `[group of components][bin][knot]`.
    tables: [Vec<Lanes>; TABLES],
    /// (sin, cos) at the bin centres.
    theta_h: Vec<(f64, f64)>,
    theta_d: Vec<(f64, f64)>,
    /// cos of phi_d at the bin centres, and as many more numbers as a step may go beyond the last.
    phi_d: Vec<f32>,
    /// Least and largest of them in the step from each bin on.
    extremes: Vec<[f32; 2]>,
}

/// Bins of theta_h and theta_d of a grid that can have a profile: its axes are theta_h, theta_d, phi_d in this order.
pub(crate) fn bins(grid: &Grid) -> Option<[usize; 2]> {
    Parameterization::grazing_axes(grid).map(|[h, d, _]| [grid.axes()[h].len, grid.axes()[d].len])
}

/// Place of a direction among the knots, of its [`Profile::root`]: the knot below, the number of knots less 1 where the
/// profile is zero, and how far it is to the next.
#[inline(always)]
pub(crate) fn place(root: f32) -> (u32, f32) {
    // Adding and taking away 2^23 rounds to the nearest integer; conversions that watch their range would not vectorise.
    let nearest = (root + TWO_23) - TWO_23;
    let knot = if nearest > root { nearest - 1.0 } else { nearest };
    ((knot + TWO_23).to_bits() - TWO_23.to_bits(), root - knot)
}

const TWO_23: f32 = 8388608.0;

/// A few components side by side.
const LANES: usize = 4;
type Lanes = [f32; LANES];

/// Positions of a row whose elevations are bounded together.
const STEP: usize = 8;

/// Elevations along phi_d at a bin of theta_h and theta_d: light's is `middle - swing * cos(phi_d)`, the sensor's
/// `middle + swing * cos(phi_d)`.
#[derive(Clone, Copy)]
struct Row {
    middle: f32,
    swing: f32,
}

impl Profile {
    /// Tables are `[component][bin][knot]`. Fails unless the grid can have a profile, and where there is no memory for it.
    pub(crate) fn new(
        grid: &Grid,
        knots: usize,
        zone: f32,
        tables: [Vec<f32>; TABLES],
    ) -> Result<Profile, &'static str> {
        let [bins_h, bins_d] = bins(grid).ok_or("the grid has no profile")?;
        let side_by_side = |table: usize| -> Result<Vec<Lanes>, &'static str> {
            let n = if table < 2 { bins_h } else { bins_d } * knots;
            let lanes = filled([0.0; LANES], tables[table].len().div_ceil(LANES * n) * n);
            let mut lanes = lanes.map_err(|_| "no memory for the profile")?;
            for (i, value) in tables[table].iter().enumerate() {
                let component = i / n;
                lanes[component / LANES * n + i % n][component % LANES] = *value;
            }
            Ok(lanes)
        };
        let angles = |axis: usize| {
            let axis = &grid.axes()[axis];
            (0..axis.len).map(|i| sin_cos(axis.angle(i as f64 + 0.5)))
        };
        let last = (knots - 1) as f32;
        let cosines: Vec<f32> = angles(2).map(|(_, cos)| cos as f32).collect();
        let extremes = |step: &[f32]| step.iter().fold([1f32, -1.0], |[low, high], c| [low.min(*c), high.max(*c)]);
        let [even_h, odd_h, even_d, odd_d] = std::array::from_fn(side_by_side);
        Ok(Profile {
            knots,
            scale: last * last / zone,
            end: zone * 1.001,
            tables: [even_h?, odd_h?, even_d?, odd_d?],
            theta_h: angles(0).collect(),
            theta_d: angles(1).collect(),
            extremes: (0..cosines.len()).map(|p| extremes(&cosines[p..cosines.len().min(p + STEP)])).collect(),
            phi_d: [cosines, vec![0.0; STEP - 1]].concat(),
        })
    }

    /// None only if the profile is zero on all of the row.
    #[inline(always)]
    fn row(&self, h: usize, d: usize) -> Option<Row> {
        let ((sin_h, cos_h), (sin_d, cos_d)) = (self.theta_h[h], self.theta_d[d]);
        let (middle, swing) = ((cos_h * cos_d) as f32, (sin_h * sin_d) as f32);
        // Cosines are at most 1, and rounding keeps the order: no elevation of the row is lower.
        (middle - swing.abs() < self.end).then_some(Row { middle, swing })
    }

    /// Square root of an elevation, in knots.
    #[inline(always)]
    fn root(&self, elevation: f32) -> f32 {
        let last = (self.knots - 1) as f32;
        let above = if elevation > 0.0 { elevation } else { 0.0 };
        let root = (above * self.scale).sqrt();
        if root < last { root } else { last }
    }

    /// Roots of the elevations of light and of sensor along phi_d; none only if the profile is zero on all of the row.
    #[cfg(feature = "encode")]
    pub(crate) fn roots(&self, h: usize, d: usize) -> Option<[Vec<f32>; 2]> {
        let Row { middle, swing } = self.row(h, d)?;
        let cos = &self.phi_d[..self.extremes.len()];
        Some([
            cos.iter().map(|cos| self.root(middle - swing * cos)).collect(),
            cos.iter().map(|cos| self.root(middle + swing * cos)).collect(),
        ])
    }

    /// Adds the profile to the components of a block, `[component][position]`.
    pub(crate) fn add(&self, level: Level, block: &Block, values: &mut [f32]) {
        level.run(Add { profile: self, block, values });
    }

    /// The same to components that are one along each row, `[component][row]`; false if they do not stay so, with anything in them.
    pub(crate) fn add_to_rows(&self, block: &Block, values: &mut [f32]) -> bool {
        add::add_to_rows(self, block, values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::grid::{Axis, AxisName, Mapping};
    use proptest::prelude::*;

    /// Tables that are all powers of the elevation's square root have a sum in closed form: between knots the interpolation
    /// of a line is the line.
    #[test]
    fn a_profile_linear_in_the_root_of_the_elevation_is_exact() {
        let grid = Grid::merl();
        let (knots, zone) = (9, 0.25f32);
        // even: 1 - u / 8, odd: half of it, over theta_h alone; zero at the last knot.
        let ramp = |factor: f32| -> Vec<f32> {
            (0..3 * 90 * knots).map(|i| factor * (1.0 - (i % knots) as f32 / 8.0)).collect()
        };
        let zero = vec![0.0; 3 * 90 * knots];
        let profile = Profile::new(&grid, knots, zone, [ramp(1.0), ramp(0.5), zero.clone(), zero]).unwrap();
        let shape = if cfg!(miri) { [1, 4, 5, 18] } else { [1, 20, 25, 90] };
        let block = Block { origin: [0, 40, 60, 30], shape };
        let n = block.positions();
        let mut values = vec![2f32; 3 * n];
        profile.add(Level::detect(), &block, &mut values);
        let mut inside = 0;
        for (p, at) in crate::table::block::positions(block.shape).enumerate() {
            let angle =
                |axis: usize, extra: usize| grid.axes()[axis].angle((block.origin[1 + axis] + extra) as f64 + 0.5);
            let (h, d, phi) = (angle(0, at[1]), angle(1, at[2]), angle(2, at[3]));
            let side = |sign: f64| {
                let elevation = h.cos() * d.cos() + sign * h.sin() * d.sin() * phi.cos();
                (1.0 - (elevation.max(0.0) / f64::from(zone)).sqrt()).max(0.0)
            };
            let expected = 2.0 + 1.5 * side(-1.0) + 0.5 * side(1.0);
            inside += usize::from(expected > 2.0);
            for c in 0..3 {
                assert!(
                    (f64::from(values[c * n + p]) - expected).abs() < 2e-5,
                    "{at:?} {} {expected}",
                    values[c * n + p]
                );
            }
        }
        assert!(inside > n / 10 && inside < n, "{inside} of {n}");
    }

    /// Section 4.10 of the specification, position by position.
    fn by_the_formula(grid: &Grid, knots: usize, zone: f32, tables: &[Vec<f32>; 4], block: &Block, values: &mut [f32]) {
        let axes = grid.axes();
        let scale = ((knots - 1) * (knots - 1)) as f32 / zone;
        let n = block.positions();
        for (p, at) in crate::table::block::positions(block.shape).enumerate() {
            let bins: [usize; 3] = std::array::from_fn(|a| block.origin[1 + a] + at[1 + a]);
            let [(sh, ch), (sd, cd), (_, c)] = std::array::from_fn(|a| sin_cos(axes[a].angle(bins[a] as f64 + 0.5)));
            let (middle, swing, c) = ((ch * cd) as f32, (sh * sd) as f32, c as f32);
            for component in 0..values.len() / n {
                let side = |z: f32, sign: f32| {
                    let u = (z.max(0.0) * scale).sqrt().min((knots - 1) as f32);
                    let (k, f) = (u.floor() as usize, u - u.floor());
                    let t = |e: usize| {
                        let of = |t: usize| tables[t][(component * axes[t / 2].len + bins[t / 2]) * knots + e];
                        if e + 1 >= knots { 0.0 } else { (of(0) + of(2)) + sign * (of(1) + of(3)) }
                    };
                    t(k) + (t(k + 1) - t(k)) * f
                };
                let (v0, v1) = (side(middle - swing * c, 1.0), side(middle + swing * c, -1.0));
                values[component * n + p] += v0 + v1;
            }
        }
    }

    proptest! {
        /// On grids of any angles, whatever is constant along a step.
        #[test]
        fn blocks_get_the_formulas_bits(
            ends in prop::array::uniform3((-200f64..200.0, 10f64..400.0)), lens in (1usize..30, 1usize..30, 1usize..200),
            knots in prop_oneof![Just(2usize), 2usize..64, Just(64)], zone in prop_oneof![Just(1e-6f32), 1e-3f32..1.0, Just(1.0)],
            components in 1usize..7, seed in any::<u64>(), cut in prop::array::uniform6(0f64..1.0)
        ) {
            let lens = <[usize; 3]>::from(lens);
            let names = [AxisName::ThetaH, AxisName::ThetaD, AxisName::PhiD];
            let axes = (0..3).map(|a| Axis {
                name: names[a],
                len: lens[a],
                start: ends[a].0.to_radians(),
                end: (ends[a].0 + ends[a].1).to_radians(),
                mapping: if a == 0 { Mapping::Square } else { Mapping::Linear },
            });
            let channel = Grid::merl().channels()[0].clone();
            let grid = Grid::new(axes.collect(), vec![channel; components]);
            prop_assume!(grid.is_ok());
            let grid = grid.unwrap();
            let mut random = crate::codec::sample::SplitMix64(seed);
            let mut number = || (random.next_u64() >> 40) as f32 / 4096.0 - 2048.0;
            let tables = [0, 0, 1, 1].map(|axis| (0..components * lens[axis] * knots).map(|_| number()).collect::<Vec<f32>>());
            let mut block = Block { origin: [0; 4], shape: [1; 4] };
            for a in 0..3 {
                block.origin[1 + a] = (cut[a] * lens[a] as f64) as usize;
                let left = lens[a] - block.origin[1 + a];
                block.shape[1 + a] = 1 + (cut[3 + a] * left as f64) as usize % left;
            }
            let before: Vec<f32> = (0..components * block.positions()).map(|_| number()).collect();
            let mut expected = before.clone();
            by_the_formula(&grid, knots, zone, &tables, &block, &mut expected);
            let profile = Profile::new(&grid, knots, zone, tables).unwrap();
            for level in Level::all() {
                let mut values = before.clone();
                profile.add(level, &block, &mut values);
                let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
                prop_assert_eq!(bits(&values), bits(&expected));
            }
            // Components that are one along each row.
            let mut rows: Vec<f32> = before.iter().step_by(block.shape[3]).copied().collect();
            let along = |rows: &[f32]| rows.iter().flat_map(|value| vec![value.to_bits(); block.shape[3]]).collect::<Vec<_>>();
            let mut expected: Vec<f32> = along(&rows).into_iter().map(f32::from_bits).collect();
            profile.add(Level::detect(), &block, &mut expected);
            if profile.add_to_rows(&block, &mut rows) {
                prop_assert_eq!(along(&rows), expected.iter().map(|value| value.to_bits()).collect::<Vec<_>>());
            }
        }
    }

    /// Towards grazing angles, near the plane of incidence: light is below the horizon and the sensor far above, then neither.
    #[test]
    fn rows_far_from_the_horizon_keep_one_value() {
        let grid = Grid::merl();
        let knots = 5;
        let table: Vec<f32> = (0..3 * 90 * knots).map(|i| 1.0 + i as f32).collect();
        let profile = Profile::new(&grid, knots, 0.15, std::array::from_fn(|_| table.clone())).unwrap();
        let rows = |phi: usize| {
            let block = Block { origin: [0, 80, 80, phi], shape: [1, 5, 7, 20] };
            let mut rows = vec![0f32; 3 * 5 * 7];
            profile.add_to_rows(&block, &mut rows).then_some(rows)
        };
        assert!(rows(0).is_some_and(|rows| rows.iter().all(|value| *value > 1.0)));
        assert!(rows(80).is_none());
        assert!(rows(160).is_some());
    }

    #[test]
    fn only_half_difference_grids_have_profiles() {
        assert_eq!(bins(&Grid::merl()), Some([90, 90]));
        let mut axes = Grid::merl().axes().to_vec();
        axes.swap(0, 1);
        assert_eq!(bins(&Grid::new(axes, Grid::merl().channels().to_vec()).unwrap()), None);
    }
}
