//! Angles of both kinds on one grid, such as theta_h and theta_i: pairs have a place on it, its places no pair of their own.

use super::Angles;
use super::spherical::{elevation, on_azimuth};
use crate::table::coords::on_turn;
use crate::table::coords::pair::Pair;
use crate::table::grid::{Axis, AxisName, Grid};

/// A grid over any angles of directions.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Mixed {
    axes: Vec<Axis>,
    /// Both azimuths have an axis; one alone is the difference to the other.
    both: bool,
}

impl Mixed {
    pub(super) fn of(grid: &Grid) -> Option<Mixed> {
        let both = grid.find(AxisName::PhiI).is_some() && grid.find(AxisName::PhiO).is_some();
        let fits = grid.axes().iter().all(|axis| axis.name != AxisName::Other);
        fits.then(|| Mixed { axes: grid.axes().to_vec(), both })
    }
}

impl Angles for Mixed {
    fn name(&self) -> &'static str {
        "half and difference angles mixed with angles of the directions"
    }

    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    fn coordinates(&self, wi: [f64; 3], wo: [f64; 3]) -> Option<[f64; 4]> {
        let pair = Pair::new(wi, wo)?;
        let mut coordinates = [0.5; 4];
        let padding = 4 - self.axes.len();
        for (coordinate, axis) in coordinates[padding..].iter_mut().zip(&self.axes) {
            *coordinate = match axis.name {
                AxisName::ThetaH => axis.coordinate(pair.theta_h()),
                AxisName::ThetaD => axis.coordinate(pair.theta_d()),
                AxisName::ThetaI => axis.coordinate(elevation(pair.wi)),
                AxisName::ThetaO => axis.coordinate(elevation(pair.wo)),
                AxisName::PhiH => on_turn(axis, pair.phi_h(), false)?,
                AxisName::PhiD => on_turn(axis, pair.phi_d(), false)?,
                AxisName::PhiI => on_azimuth(axis, self.both, pair.wi, pair.wo)?,
                AxisName::PhiO => on_azimuth(axis, self.both, pair.wo, pair.wi)?,
                AxisName::Other => return None,
            };
        }
        Some(coordinates)
    }

    fn directions(&self, _: [f64; 4]) -> Option<([f64; 3], [f64; 3])> {
        None
    }

    fn is_isotropic(&self) -> bool {
        !self.both && self.axes.iter().all(|axis| axis.name != AxisName::PhiH)
    }
}
