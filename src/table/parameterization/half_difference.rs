//! Half and difference angles (Rusinkiewicz 1998), with or without phi_h; MERL's grid is over theta_h, theta_d, phi_d.

use std::f64::consts::{FRAC_PI_2, PI};

use super::Angles;
use crate::table::coords::pair::Pair;
use crate::table::coords::{Batch, HalfDiff, closes, directions, on_turn};
use crate::table::grid::{Axis, AxisName, Grid};

/// A grid over any of theta_h, phi_h, theta_d, phi_d.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct HalfDifference {
    axes: Vec<Axis>,
}

/// The axes of theta_h, theta_d and phi_d, if a grid has all three.
pub(super) fn elevation_axes(grid: &Grid) -> Option<[usize; 3]> {
    Some([grid.find(AxisName::ThetaH)?, grid.find(AxisName::ThetaD)?, grid.find(AxisName::PhiD)?])
}

impl HalfDifference {
    pub(super) fn of(grid: &Grid) -> Option<HalfDifference> {
        let known = [AxisName::ThetaH, AxisName::PhiH, AxisName::ThetaD, AxisName::PhiD];
        let fits = grid.axes().iter().all(|axis| known.contains(&axis.name));
        fits.then(|| HalfDifference { axes: grid.axes().to_vec() })
    }

    fn find(&self, name: AxisName) -> Option<usize> {
        self.axes.iter().position(|axis| axis.name == name)
    }

    /// Number of the axis of theta_h.
    pub(crate) fn theta_h(&self) -> Option<usize> {
        self.find(AxisName::ThetaH)
    }

    /// Number of the axis of theta_d.
    pub(crate) fn theta_d(&self) -> Option<usize> {
        self.find(AxisName::ThetaD)
    }

    /// Number of the axis of phi_d.
    pub(crate) fn phi_d(&self) -> Option<usize> {
        self.find(AxisName::PhiD)
    }

    /// The angles at coordinates; those without an axis as far from the horizon as they can be.
    pub(crate) fn angles(&self, coordinates: [f64; 4]) -> HalfDiff {
        let mut angles = HalfDiff { theta_h: 0.0, phi_h: 0.0, theta_d: 0.0, phi_d: FRAC_PI_2 };
        for (axis, u) in self.axes.iter().zip(&coordinates[4 - self.axes.len()..]) {
            *match axis.name {
                AxisName::ThetaH => &mut angles.theta_h,
                AxisName::PhiH => &mut angles.phi_h,
                AxisName::ThetaD => &mut angles.theta_d,
                _ => &mut angles.phi_d,
            } = axis.angle(*u);
        }
        angles
    }

    #[inline(always)]
    fn place(&self, angle: impl Fn(AxisName) -> f64) -> Option<[f64; 4]> {
        let mut coordinates = [0.5; 4];
        let padding = 4 - self.axes.len();
        for (coordinate, axis) in coordinates[padding..].iter_mut().zip(&self.axes) {
            let own = angle(axis.name);
            *coordinate = match axis.name {
                AxisName::PhiH | AxisName::PhiD => on_turn(axis, own, false)?,
                _ => axis.coordinate(own),
            };
        }
        Some(coordinates)
    }
}

impl Angles for HalfDifference {
    fn name(&self) -> &'static str {
        "half and difference angles"
    }

    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    #[inline]
    fn coordinates(&self, wi: [f64; 3], wo: [f64; 3]) -> Option<[f64; 4]> {
        let pair = Pair::new(wi, wo)?;
        self.place(|name| match name {
            AxisName::ThetaH => pair.theta_h(),
            AxisName::ThetaD => pair.theta_d(),
            AxisName::PhiH => pair.phi_h(),
            _ => pair.phi_d(),
        })
    }

    #[inline]
    fn batch_coordinates(&self, batch: &Batch, i: usize, wi: [f64; 3], wo: [f64; 3]) -> Option<[f64; 4]> {
        let [theta_h, theta_d, phi_d] = batch.angles(i);
        if theta_h.is_nan() {
            return self.coordinates(wi, wo);
        }
        self.place(|name| match name {
            AxisName::ThetaH => theta_h,
            AxisName::ThetaD => theta_d,
            _ => phi_d,
        })
    }

    fn takes_batches(&self) -> bool {
        self.find(AxisName::PhiH).is_none()
    }

    fn directions(&self, coordinates: [f64; 4]) -> Option<([f64; 3], [f64; 3])> {
        Some(directions(self.angles(coordinates)))
    }

    fn is_isotropic(&self) -> bool {
        self.find(AxisName::PhiH).is_none()
    }

    /// Exchanging the directions, theta_h and theta_d stay and phi_d turns by pi: the grid must not keep these apart.
    fn folds_by_reciprocity(&self) -> bool {
        self.phi_d().map(|axis| self.axes[axis]).is_none_or(|axis| closes(&axis) && axis.end - axis.start < 1.5 * PI)
    }

    fn half_difference(&self) -> Option<&HalfDifference> {
        Some(self)
    }
}
