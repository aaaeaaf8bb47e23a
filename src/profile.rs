//! The grazing profile: what the logarithm does near the horizon of either direction (spec section 4.10).
//!
//! Towards grazing directions a BRDF follows the elevations of light and sensor (masking, shadowing, 1 / cos), whose
//! lines of equal value cross the grid of half and difference angles at a slant: no block of Fourier terms is sparse
//! there. Tables over (theta_h, elevation) and (theta_d, elevation) take that part out; they take a few hundred bytes.

use crate::block::Block;
use crate::exact::sin_cos;
use crate::format::profile::{MAX_KNOTS, TABLES};
use crate::grid::{AxisName, Grid};

/// Tables of a profile and the angles of the grid that it is for.
#[derive(Debug)]
pub(crate) struct Profile {
    knots: usize,
    /// Elevations times this are squares of the place among the knots.
    scale: f32,
    components: usize,
    /// Over theta_h, the same for both directions and opposite for them; likewise over theta_d.
    /// `[component][bin][knot]`.
    tables: [Vec<f32>; TABLES],
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

/// Place of a position's two directions among the knots: the knot below, and how far it is to the next.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Place {
    /// Knots below for light and sensor; the number of knots less 1 where the profile is zero.
    pub(crate) knot: [u8; 2],
    pub(crate) fraction: [f32; 2],
}

impl Profile {
    /// `None` unless the grid can have a profile.
    pub(crate) fn new(grid: &Grid, knots: usize, zone: f32, tables: [Vec<f32>; TABLES]) -> Option<Profile> {
        bins(grid)?;
        let angles = |axis: usize| {
            let axis = &grid.axes()[axis];
            (0..axis.len).map(|i| sin_cos(axis.angle(i as f64 + 0.5)))
        };
        let last = (knots - 1) as f32;
        Some(Profile {
            knots,
            scale: last * last / zone,
            components: grid.channels().len(),
            tables,
            theta_h: angles(0).collect(),
            theta_d: angles(1).collect(),
            phi_d: angles(2).map(|(_, cos)| cos as f32).collect(),
        })
    }

    /// Places of the positions of a row along phi_d; none if the profile is zero on all of it.
    pub(crate) fn places(&self, h: usize, d: usize, phi: std::ops::Range<usize>, out: &mut Vec<Place>) {
        out.clear();
        let ((sin_h, cos_h), (sin_d, cos_d)) = (self.theta_h[h], self.theta_d[d]);
        let (middle, swing) = ((cos_h * cos_d) as f32, (sin_h * sin_d) as f32);
        let last = (self.knots - 1) as f32;
        // Cosines are at most 1, and rounding keeps the order: no elevation of the row is lower.
        if ((middle - swing.abs()).max(0.0) * self.scale).sqrt() >= last {
            return;
        }
        out.extend(self.phi_d[phi].iter().map(|cos| {
            let mut place = Place::default();
            for (side, elevation) in [middle - swing * cos, middle + swing * cos].into_iter().enumerate() {
                let u = (elevation.max(0.0) * self.scale).sqrt().min(last);
                place.knot[side] = u as u8;
                place.fraction[side] = u - f32::from(place.knot[side]);
            }
            place
        }));
    }

    /// Adds the profile to the components of a block, `[component][position]`.
    pub(crate) fn add(&self, block: &Block, values: &mut [f32]) {
        let [_, oh, od, op] = block.origin;
        let [_, nh, nd, np] = block.shape;
        let n = block.positions();
        let mut places = Vec::new();
        let mut sides = [[0f32; MAX_KNOTS + 1]; 2];
        for i in 0..nh {
            for j in 0..nd {
                self.places(oh + i, od + j, op..op + np, &mut places);
                if places.is_empty() {
                    continue;
                }
                for component in 0..self.components {
                    self.row(component, oh + i, od + j, &mut sides);
                    let row = component * n + (i * nd + j) * np;
                    for (value, place) in values[row..row + np].iter_mut().zip(&places) {
                        let side = |s: usize| {
                            let (knot, table) = (usize::from(place.knot[s]), &sides[s]);
                            table[knot] + (table[knot + 1] - table[knot]) * place.fraction[s]
                        };
                        *value += side(0) + side(1);
                    }
                }
            }
        }
    }

    /// Profiles of a component over the elevation of light and of sensor at a bin of theta_h and theta_d, zero from the
    /// last knot on.
    fn row(&self, component: usize, h: usize, d: usize, sides: &mut [[f32; MAX_KNOTS + 1]; 2]) {
        let k = self.knots;
        let at = |table: usize, bins: usize, bin: usize| {
            let start = (component * bins + bin) * k;
            &self.tables[table][start..start + k]
        };
        let (nh, nd) = (self.theta_h.len(), self.theta_d.len());
        let (h_even, h_odd, d_even, d_odd) = (at(0, nh, h), at(1, nh, h), at(2, nd, d), at(3, nd, d));
        for e in 0..k - 1 {
            let (even, odd) = (h_even[e] + d_even[e], h_odd[e] + d_odd[e]);
            sides[0][e] = even + odd;
            sides[1][e] = even - odd;
        }
        for side in sides {
            side[k - 1..=k].fill(0.0);
        }
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
        let block = Block { origin: [0, 40, 60, 30], shape: [1, 20, 25, 90] };
        let n = block.positions();
        let mut values = vec![2f32; 3 * n];
        profile.add(&block, &mut values);
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
