//! Horizon geometry of half/difference grids: which bins can hold a pair of directions at all (spec section 4.8).
//!
//! With h the half vector, cos_i and cos_o are cos(theta_h) cos(theta_d) -+ sin(theta_h) sin(theta_d) cos(phi_d);
//! the smaller of the two is the elevation of a bin. Measured sets keep the bins whose centre is not below some
//! elevation (MERL: all but 2 of 1,458,000 bins follow -0.061), so one number stands for the whole mask.

use crate::base::portable::sin_cos;
use crate::table::block::Block;
use crate::table::grid::Grid;
use crate::table::parameterization::Parameterization;

/// Sines and cosines along the axes of a half/difference grid.
#[derive(Clone, Debug)]
pub(crate) struct Horizon {
    /// Padded axis numbers of theta_h, theta_d, phi_d.
    axes: [usize; 3],
    /// At bin centres: (sin, cos) of theta_h and theta_d, |cos| of phi_d.
    theta_h: Vec<(f64, f64)>,
    theta_d: Vec<(f64, f64)>,
    phi_d: Vec<f64>,
    /// The same where in each bin the elevation is largest.
    theta_h_edge: Vec<(f64, f64)>,
    theta_d_edge: Vec<(f64, f64)>,
    phi_d_edge: Vec<f64>,
}

impl Horizon {
    /// `None` unless the grid has the axes theta_h, theta_d and phi_d.
    pub(crate) fn new(grid: &Grid) -> Option<Horizon> {
        let [h, d, p] = Parameterization::elevation_axes(grid)?;
        let sampled = |axis: usize, shift: f64| -> Vec<(f64, f64)> {
            let axis = &grid.axes()[axis];
            (0..axis.len).map(|i| sin_cos(axis.angle(i as f64 + shift))).collect()
        };
        let cos = |shift: f64| -> Vec<f64> { sampled(p, shift).iter().map(|(_, cos)| *cos).collect() };
        // Within a bin the cosine is smallest at an edge, or zero where it changes sign.
        let smallest = |(a, b): (f64, f64)| if a * b < 0.0 { 0.0 } else { a.abs().min(b.abs()) };
        let padding = 4 - grid.axes().len();
        Some(Horizon {
            axes: [h + padding, d + padding, p + padding],
            theta_h: sampled(h, 0.5),
            theta_d: sampled(d, 0.5),
            phi_d: cos(0.5).iter().map(|c| c.abs()).collect(),
            theta_h_edge: sampled(h, 0.0),
            theta_d_edge: sampled(d, 0.0),
            phi_d_edge: cos(0.0).into_iter().zip(cos(1.0)).map(smallest).collect(),
        })
    }

    /// The smaller of cos_i and cos_o at the centre of the bin at `position`.
    #[cfg(feature = "encode")]
    fn elevation(&self, position: [usize; 4]) -> f64 {
        let [h, d, p] = self.axes.map(|axis| position[axis]);
        elevation(self.theta_h[h], self.theta_d[d], self.phi_d[p])
    }

    /// Calls `each` with the smaller of cos_i and cos_o at the centre of every bin of a block, in order.
    #[inline(always)]
    pub(crate) fn for_each(&self, block: &Block, mut each: impl FnMut(f64)) {
        let [o0, o1, o2, o3] = block.origin;
        let [n0, n1, n2, n3] = block.shape;
        for i in o0..o0 + n0 {
            for j in o1..o1 + n1 {
                for k in o2..o2 + n2 {
                    if self.axes == [1, 2, 3] {
                        // The usual order: phi_d along the row.
                        let ((sin_h, cos_h), (sin_d, cos_d)) = (self.theta_h[j], self.theta_d[k]);
                        let (middle, swing) = (cos_h * cos_d, sin_h * sin_d);
                        self.phi_d[o3..o3 + n3].iter().for_each(|cos_p| each(middle - swing * cos_p));
                        continue;
                    }
                    for l in o3..o3 + n3 {
                        let [h, d, p] = self.axes.map(|axis| [i, j, k, l][axis]);
                        each(elevation(self.theta_h[h], self.theta_d[d], self.phi_d[p]));
                    }
                }
            }
        }
    }

    /// The elevations of a grid.
    #[cfg(feature = "encode")]
    fn elevations(&self, shape: [usize; 4]) -> Vec<f64> {
        use rayon::prelude::*;
        let slab: usize = shape[2..].iter().product();
        let mut elevations = vec![0.0; shape.iter().product()];
        elevations.par_chunks_mut(slab.max(1)).enumerate().for_each(|(s, slab)| {
            let block = Block { origin: [s / shape[1], s % shape[1], 0, 0], shape: [1, 1, shape[2], shape[3]] };
            let mut places = slab.iter_mut();
            self.for_each(&block, |elevation| places.by_ref().take(1).for_each(|place| *place = elevation));
        });
        elevations
    }

    /// True if every pair of directions in the bin has one below the horizon.
    pub(crate) fn is_impossible(&self, position: [usize; 4]) -> bool {
        let [h, d, p] = self.axes.map(|axis| position[axis]);
        elevation(self.theta_h_edge[h], self.theta_d_edge[d], self.phi_d_edge[p]) < 1e-12
    }
}

fn elevation((sin_h, cos_h): (f64, f64), (sin_d, cos_d): (f64, f64), abs_cos_p: f64) -> f64 {
    cos_h * cos_d - sin_h * sin_d * abs_cos_p
}

/// The threshold on the elevation that predicts the given validity with the fewest errors, and their number.
///
/// `valid` in grid order. Predicted valid: elevation >= threshold.
#[cfg(feature = "encode")]
pub(crate) fn fit_threshold(horizon: &Horizon, shape: [usize; 4], valid: &[bool]) -> (f64, usize) {
    const BINS: usize = 1 << 14;
    let elevations = horizon.elevations(shape);
    let bin = |e: f64| ((e + 1.0) / 2.0 * BINS as f64).clamp(0.0, (BINS - 1) as f64) as usize;
    let mut counts = vec![[0usize; 2]; BINS];
    elevations.iter().zip(valid).for_each(|(&e, &valid)| counts[bin(e)][usize::from(valid)] += 1);
    // Wrong with the threshold below everything: all that is invalid. Each bin passed corrects or adds errors.
    let below: usize = counts.iter().map(|c| c[0]).sum();
    let (mut wrong, mut best, mut best_bin) = (below, below, 0);
    for (b, [invalid, valid]) in counts.iter().enumerate() {
        wrong = wrong + valid - invalid;
        if wrong < best {
            (best, best_bin) = (wrong, b + 1);
        }
    }
    // Refine among the entries of the bins on both sides of the best edge: start with all of them predicted
    // invalid, admit them from the highest down.
    let mut threshold = best_bin as f64 / BINS as f64 * 2.0 - 1.0;
    let beside: Vec<usize> = [best_bin.wrapping_sub(1), best_bin].into_iter().filter(|&b| b < BINS).collect();
    let inside: usize = beside.iter().map(|&b| counts[b][usize::from(b < best_bin)]).sum();
    let mut close: Vec<(f64, bool)> =
        elevations.iter().copied().zip(valid.iter().copied()).filter(|(e, _)| beside.contains(&bin(*e))).collect();
    close.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut wrong = best - inside + close.iter().filter(|(_, valid)| *valid).count();
    for (i, (e, valid)) in close.iter().enumerate().rev() {
        wrong = if *valid { wrong - 1 } else { wrong + 1 };
        let tied = i > 0 && close[i - 1].0 == *e;
        if !tied && wrong < best {
            (best, threshold) = (wrong, *e);
        }
    }
    (threshold, best)
}

/// The threshold for the mask of a sparse measurement: the elevation that all but a thousandth of the valid entries
/// reach. There the fewest errors are had by predicting nothing, which does not keep possible bins apart from impossible ones.
#[cfg(feature = "encode")]
pub(crate) fn lowest_elevation(horizon: &Horizon, shape: [usize; 4], valid: &[bool]) -> Option<f64> {
    use crate::table::block::positions;
    let seen = positions(shape).zip(valid).filter(|(_, valid)| **valid);
    let mut elevations: Vec<f64> = seen.map(|(p, _)| horizon.elevation(p)).collect();
    elevations.sort_by(f64::total_cmp);
    elevations.get(elevations.len() / 1000).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::block::positions;

    #[test]
    #[cfg_attr(miri, ignore = "whole tables of MERL's size")]
    fn impossible_share_of_the_merl_grid() {
        let grid = Grid::merl();
        let horizon = Horizon::new(&grid).unwrap();
        let impossible = positions(grid.shape()).filter(|&p| horizon.is_impossible(p)).count();
        // 20.976 % of the published tables is missing, and 38,130 of their values lie in bins wholly below the
        // horizon: 305,826 + 38,130.
        assert_eq!(impossible, 343_956);
        assert!(Horizon::new(&Grid::new(grid.axes()[..2].to_vec(), grid.channels().to_vec()).unwrap()).is_none());
    }

    #[cfg(feature = "encode")]
    #[test]
    fn threshold_is_found_among_random_holes() {
        let grid = Grid::merl();
        let horizon = Horizon::new(&grid).unwrap();
        let mut random = crate::codec::sample::SplitMix64(9);
        for (truth, holes) in [(-0.061, 0), (0.0, 0), (-0.061, 1000), (0.2, 100_000)] {
            let mut errors = 0;
            let valid: Vec<bool> = positions(grid.shape())
                .map(|p| {
                    let flip = random.next_u64() % 1_000_000 < holes;
                    errors += usize::from(flip);
                    (horizon.elevation(p) >= truth) != flip
                })
                .collect();
            let (threshold, wrong) = fit_threshold(&horizon, grid.shape(), &valid);
            assert!((threshold - truth).abs() < 2e-4, "{threshold} {truth}");
            assert!(wrong <= errors, "{wrong} {errors}");
            let counted =
                positions(grid.shape()).zip(&valid).filter(|(p, v)| (horizon.elevation(*p) >= threshold) != **v);
            assert_eq!(counted.count(), wrong);
        }
    }

    #[cfg(feature = "encode")]
    #[test]
    fn a_sparse_mask_leaves_the_threshold_at_the_horizon() {
        let grid = Grid::merl();
        let horizon = Horizon::new(&grid).unwrap();
        let mut random = crate::codec::sample::SplitMix64(5);
        let valid: Vec<bool> = positions(grid.shape())
            .map(|p| random.next_u64().is_multiple_of(100) && horizon.elevation(p) >= 0.0)
            .collect();
        let threshold = lowest_elevation(&horizon, grid.shape(), &valid).unwrap();
        assert!((0.0..0.005).contains(&threshold), "{threshold}");
        assert_eq!(lowest_elevation(&horizon, grid.shape(), &vec![false; valid.len()]), None);
    }
}
