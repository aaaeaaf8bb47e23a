//! The grazing profile: what the logarithm does near the horizon of either direction (spec section 4.10).
//!
//! Towards grazing directions a BRDF follows the elevations of light and sensor (masking, shadowing, 1 / cos), whose
//! lines of equal value cross the grid of half and difference angles at a slant: no block of Fourier terms is sparse
//! there. Tables over (theta_h, elevation) and (theta_d, elevation) take that part out; they take a few hundred bytes.

mod add;

use self::add::Add;
use crate::block::Block;
use crate::exact::sin_cos;
use crate::format::profile::TABLES;
use crate::grid::{AxisName, Grid};
use crate::simd::Level;

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
    let names: Vec<AxisName> = grid.axes().iter().map(|axis| axis.name).collect();
    let fits = names == [AxisName::ThetaH, AxisName::ThetaD, AxisName::PhiD];
    fits.then(|| [grid.axes()[0].len, grid.axes()[1].len])
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

/// Positions of a row that go together: a vector of AVX2.
const STEP: usize = 8;

/// Elevations along phi_d at a bin of theta_h and theta_d: what they have in common, and what its cosine times gives more to the
/// sensor and less to the light.
#[derive(Clone, Copy)]
struct Row {
    middle: f32,
    swing: f32,
}

impl Profile {
    /// Tables are `[component][bin][knot]`. `None` unless the grid can have a profile.
    pub(crate) fn new(grid: &Grid, knots: usize, zone: f32, tables: [Vec<f32>; TABLES]) -> Option<Profile> {
        let [bins_h, bins_d] = bins(grid)?;
        let side_by_side = |table: usize| -> Vec<Lanes> {
            let n = if table < 2 { bins_h } else { bins_d } * knots;
            let mut lanes = vec![[0.0; LANES]; tables[table].len().div_ceil(LANES * n) * n];
            for (i, value) in tables[table].iter().enumerate() {
                let component = i / n;
                lanes[component / LANES * n + i % n][component % LANES] = *value;
            }
            lanes
        };
        let angles = |axis: usize| {
            let axis = &grid.axes()[axis];
            (0..axis.len).map(|i| sin_cos(axis.angle(i as f64 + 0.5)))
        };
        let last = (knots - 1) as f32;
        let cosines: Vec<f32> = angles(2).map(|(_, cos)| cos as f32).collect();
        let extremes = |step: &[f32]| step.iter().fold([1f32, -1.0], |[low, high], c| [low.min(*c), high.max(*c)]);
        Some(Profile {
            knots,
            scale: last * last / zone,
            end: zone * 1.001,
            tables: std::array::from_fn(side_by_side),
            theta_h: angles(0).collect(),
            theta_d: angles(1).collect(),
            extremes: (0..cosines.len()).map(|p| extremes(&cosines[p..cosines.len().min(p + STEP)])).collect(),
            phi_d: [cosines, vec![0.0; STEP - 1]].concat(),
        })
    }

    /// None if the profile is zero on all of the row.
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
        let root = (if elevation > 0.0 { elevation } else { 0.0 } * self.scale).sqrt();
        if root < last { root } else { last }
    }

    /// Roots of the elevations of light and of sensor along phi_d; none if the profile is zero on all of the row.
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
}

#[cfg(test)]
mod tests {
    use super::*;

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
        for (p, at) in crate::block::positions(block.shape).enumerate() {
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

    #[test]
    fn only_half_difference_grids_have_profiles() {
        assert_eq!(bins(&Grid::merl()), Some([90, 90]));
        let mut axes = Grid::merl().axes().to_vec();
        axes.swap(0, 1);
        assert_eq!(bins(&Grid::new(axes, Grid::merl().channels().to_vec()).unwrap()), None);
    }
}
