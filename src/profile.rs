//! The grazing profile: what the logarithm does near the horizon of either direction (spec section 4.10).
//!
//! Towards grazing directions a BRDF follows the elevations of light and sensor (masking, shadowing, 1 / cos), whose
//! lines of equal value cross the grid of half and difference angles at a slant: no block of Fourier terms is sparse
//! there. Tables over (theta_h, elevation) and (theta_d, elevation) take that part out; they take a few hundred bytes.

use crate::block::Block;
use crate::exact::sin_cos;
use crate::format::profile::{MAX_KNOTS, TABLES};
use crate::grid::{AxisName, Grid};
use crate::simd::{Level, Task};

/// Tables of a profile and the angles of the grid that it is for.
#[derive(Debug)]
pub(crate) struct Profile {
    knots: usize,
    /// Elevations times this are squares of the place among the knots.
    scale: f32,
    /// Over theta_h, the same for both directions and opposite for them; likewise over theta_d.
    /// `[group of components][bin][knot]`.
    tables: [Vec<Lanes>; TABLES],
    /// (sin, cos) at the bin centres.
    theta_h: Vec<(f64, f64)>,
    theta_d: Vec<(f64, f64)>,
    /// cos of phi_d at the bin centres.
    phi_d: Vec<f32>,
}

/// Bins of theta_h and theta_d of a grid that can have a profile: its axes are theta_h, theta_d, phi_d in this order.
pub(crate) fn bins(grid: &Grid) -> Option<[usize; 2]> {
    let names: Vec<AxisName> = grid.axes().iter().map(|axis| axis.name).collect();
    let fits = names == [AxisName::ThetaH, AxisName::ThetaD, AxisName::PhiD];
    fits.then(|| [grid.axes()[0].len, grid.axes()[1].len])
}

/// Place of a direction among the knots, of a root that [`Profile::roots`] gives: the knot below, the number of knots less 1
/// where the profile is zero, and how far it is to the next.
#[inline(always)]
pub(crate) fn place(root: f32) -> (u8, f32) {
    let knot = root as u8;
    (knot, root - f32::from(knot))
}

/// A few components side by side: what a profile has at a knot, and how much more at the next.
const LANES: usize = 4;
type Lanes = [f32; LANES];
type Knot = (Lanes, Lanes);

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
        Some(Profile {
            knots,
            scale: last * last / zone,
            tables: std::array::from_fn(side_by_side),
            theta_h: angles(0).collect(),
            theta_d: angles(1).collect(),
            phi_d: angles(2).map(|(_, cos)| cos as f32).collect(),
        })
    }

    /// Square roots of the elevations of light and of sensor at the positions of a row along phi_d, in knots; none if the
    /// profile is zero on all of it.
    #[inline(always)]
    pub(crate) fn roots(&self, h: usize, d: usize, phi: std::ops::Range<usize>, out: &mut [Vec<f32>; 2]) {
        out.iter_mut().for_each(Vec::clear);
        let ((sin_h, cos_h), (sin_d, cos_d)) = (self.theta_h[h], self.theta_d[d]);
        let (middle, swing) = ((cos_h * cos_d) as f32, (sin_h * sin_d) as f32);
        let last = (self.knots - 1) as f32;
        // Cosines are at most 1, and rounding keeps the order: no elevation of the row is lower.
        if ((middle - swing.abs()).max(0.0) * self.scale).sqrt() >= last {
            return;
        }
        let [light, sensor] = out;
        light.resize(phi.len(), 0.0);
        sensor.resize(phi.len(), 0.0);
        for ((light, sensor), cos) in light.iter_mut().zip(sensor).zip(&self.phi_d[phi]) {
            *light = ((middle - swing * cos).max(0.0) * self.scale).sqrt().min(last);
            *sensor = ((middle + swing * cos).max(0.0) * self.scale).sqrt().min(last);
        }
    }

    /// The part of a row outside of which a side has no profile.
    #[inline(always)]
    fn within(&self, roots: &[f32]) -> std::ops::Range<usize> {
        let last = (self.knots - 1) as f32;
        let start = roots.iter().position(|root| *root < last).unwrap_or(roots.len());
        let end = roots.iter().rposition(|root| *root < last).map_or(start, |i| i + 1);
        start..end
    }

    /// Adds the profile to the components of a block, `[component][position]`.
    pub(crate) fn add(&self, level: Level, block: &Block, values: &mut [f32]) {
        level.run(Add { profile: self, block, values });
    }

    #[inline(always)]
    fn add_inline(&self, block: &Block, values: &mut [f32]) {
        let [_, oh, od, op] = block.origin;
        let [_, nh, nd, np] = block.shape;
        let n = block.positions();
        let mut roots = [Vec::new(), Vec::new()];
        let mut sides = [[([0f32; LANES], [0f32; LANES]); MAX_KNOTS]; 2];
        let mut sums: Vec<Lanes> = Vec::new();
        for i in 0..nh {
            for j in 0..nd {
                self.roots(oh + i, od + j, op..op + np, &mut roots);
                if roots[0].is_empty() {
                    continue;
                }
                let start = (i * nd + j) * np;
                // Mostly the sides are low at different ends of the row.
                let places = roots.each_ref().map(|roots| self.within(roots));
                let any = places[0].start.min(places[1].start)..places[0].end.max(places[1].end);
                for (group, planes) in values.chunks_mut(LANES * n).enumerate() {
                    self.row(group, oh + i, od + j, &mut sides);
                    sums.clear();
                    sums.resize(np, [0.0; LANES]);
                    for ((side, roots), places) in sides.iter().zip(&roots).zip(&places) {
                        for (sum, root) in sums[places.clone()].iter_mut().zip(&roots[places.clone()]) {
                            let more = interpolate(side, *root);
                            for lane in 0..LANES {
                                sum[lane] += more[lane];
                            }
                        }
                    }
                    for (lane, plane) in planes.chunks_exact_mut(n).enumerate() {
                        let row = &mut plane[start..start + np][any.clone()];
                        for (value, sum) in row.iter_mut().zip(&sums[any.clone()]) {
                            *value += sum[lane];
                        }
                    }
                }
            }
        }
    }

    /// Profiles of a few components over the elevation of light and of sensor at a bin of theta_h and theta_d, zero from the
    /// last knot on.
    #[inline(always)]
    fn row(&self, group: usize, h: usize, d: usize, sides: &mut [[Knot; MAX_KNOTS]; 2]) {
        let k = self.knots;
        let of_bin = |table: usize, bins: usize, bin: usize| &self.tables[table][(group * bins + bin) * k..][..k];
        let (nh, nd) = (self.theta_h.len(), self.theta_d.len());
        let (h_even, h_odd, d_even, d_odd) = (of_bin(0, nh, h), of_bin(1, nh, h), of_bin(2, nd, d), of_bin(3, nd, d));
        let [light, sensor] = sides;
        for e in 0..k - 1 {
            for lane in 0..LANES {
                let (even, odd) = (h_even[e][lane] + d_even[e][lane], h_odd[e][lane] + d_odd[e][lane]);
                light[e].0[lane] = even + odd;
                sensor[e].0[lane] = even - odd;
            }
        }
        for side in sides {
            side[k - 1] = ([0.0; LANES], [0.0; LANES]);
            for e in 0..k - 1 {
                for lane in 0..LANES {
                    side[e].1[lane] = side[e + 1].0[lane] - side[e].0[lane];
                }
            }
        }
    }
}

#[inline(always)]
fn interpolate(side: &[Knot; MAX_KNOTS], root: f32) -> Lanes {
    let (knot, fraction) = place(root);
    // At most the last: the remainder saves a check.
    let (value, more) = &side[usize::from(knot) % MAX_KNOTS];
    let mut sum = [0f32; LANES];
    for lane in 0..LANES {
        sum[lane] = value[lane] + more[lane] * fraction;
    }
    sum
}

struct Add<'a> {
    profile: &'a Profile,
    block: &'a Block,
    values: &'a mut [f32],
}

impl Task for Add<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        self.profile.add_inline(self.block, self.values);
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
