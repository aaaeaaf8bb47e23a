//! Elevations and azimuths of the two directions: gonioreflectometers, UTIA; isotropic with one of the azimuths or none.

use super::Angles;
use crate::base::portable::atan2;
use crate::table::coords::on_turn;
use crate::table::coords::pair::{Pair, azimuth};
use crate::table::grid::{Axis, AxisName, Grid};

/// A grid over any of theta_i, phi_i, theta_o, phi_o.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spherical {
    axes: Vec<Axis>,
    /// Both azimuths have an axis; one alone is the difference to the other.
    both: bool,
}

impl Spherical {
    pub(super) fn of(grid: &Grid) -> Option<Spherical> {
        let known = [AxisName::ThetaI, AxisName::PhiI, AxisName::ThetaO, AxisName::PhiO];
        let fits = grid.axes().iter().all(|axis| known.contains(&axis.name));
        let both = grid.find(AxisName::PhiI).is_some() && grid.find(AxisName::PhiO).is_some();
        fits.then(|| Spherical { axes: grid.axes().to_vec(), both })
    }
}

/// Elevation of a unit direction from the normal.
pub(super) fn elevation(w: [f64; 3]) -> f64 {
    atan2((w[0] * w[0] + w[1] * w[1]).sqrt(), w[2])
}

/// Its azimuth.
pub(super) fn turn(w: [f64; 3]) -> f64 {
    azimuth(w[1], w[0])
}

/// Coordinate on an azimuth of `here`, one of two directions: as it is if both have an axis, else from the other.
pub(super) fn on_azimuth(axis: &Axis, both: bool, here: [f64; 3], other: [f64; 3]) -> Option<f64> {
    if both { on_turn(axis, turn(here), false) } else { on_turn(axis, turn(here) - turn(other), true) }
}

impl Angles for Spherical {
    fn name(&self) -> &'static str {
        "elevations and azimuths of the directions"
    }

    fn axes(&self) -> &[Axis] {
        &self.axes
    }

    #[inline]
    fn coordinates(&self, wi: [f64; 3], wo: [f64; 3]) -> Option<[f64; 4]> {
        let Pair { wi, wo, .. } = Pair::new(wi, wo)?;
        let mut coordinates = [0.5; 4];
        let padding = 4 - self.axes.len();
        for (coordinate, axis) in coordinates[padding..].iter_mut().zip(&self.axes) {
            *coordinate = match axis.name {
                AxisName::ThetaI => axis.coordinate(elevation(wi)),
                AxisName::ThetaO => axis.coordinate(elevation(wo)),
                AxisName::PhiI => on_azimuth(axis, self.both, wi, wo)?,
                _ => on_azimuth(axis, self.both, wo, wi)?,
            };
        }
        Some(coordinates)
    }

    fn directions(&self, coordinates: [f64; 4]) -> Option<([f64; 3], [f64; 3])> {
        let (mut i, mut o) = ([0.0; 2], [0.0; 2]);
        for (axis, u) in self.axes.iter().zip(&coordinates[4 - self.axes.len()..]) {
            *match axis.name {
                AxisName::ThetaI => &mut i[0],
                AxisName::PhiI => &mut i[1],
                AxisName::ThetaO => &mut o[0],
                _ => &mut o[1],
            } = axis.angle(*u);
        }
        let direction = |[theta, phi]: [f64; 2]| [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        Some((direction(i), direction(o)))
    }

    fn is_isotropic(&self) -> bool {
        !self.both
    }
}
