//! Directions, half/difference angles, and the bins around grid coordinates.
//!
//! Directions are unit vectors `[x, y, z]` that point away from the surface, z along its normal, x along its tangent.
//! Half and difference angles are those of Rusinkiewicz, "A New Change of Variables for Efficient BRDF Representation"
//! (1998), with the signs of the MERL reference reader (`BRDFRead.cpp`): the half vector is turned onto the normal by
//! `-phi_h` about the normal and `-theta_h` about the bi-normal; the difference angles are those of `wi` after that.
//! All angles are in radians.

pub(super) mod pair;

use std::f64::consts::{PI, TAU};

use crate::table::grid::{Axis, AxisName, Grid};
pub(crate) use pair::upper_unit;
pub(crate) use pair::{BATCH, Batch};
use pair::Pair;

/// Half and difference angles of a pair of directions, radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfDiff {
    /// Elevation of the half vector from the normal, 0 to pi/2.
    pub theta_h: f64,
    /// Azimuth of the half vector, 0 to 2 pi (2 pi excluded); 0 where the half vector is the normal.
    pub phi_h: f64,
    /// Angle between the half vector and either direction, 0 to pi/2.
    pub theta_d: f64,
    /// Azimuth of `wi` about the half vector, 0 to 2 pi (2 pi excluded); 0 where `wi` equals `wo`.
    pub phi_d: f64,
}

/// Half and difference angles of the directions `wi` and `wo`, which need not have unit length.
///
/// `None` if a direction is zero, not finite or below the horizon (`z < 0`), or if the two are opposite, so that
/// there is no half vector.
pub fn half_diff(wi: [f64; 3], wo: [f64; 3]) -> Option<HalfDiff> {
    let pair = Pair::new(wi, wo)?;
    Some(HalfDiff { theta_h: pair.theta_h(), phi_h: pair.phi_h(), theta_d: pair.theta_d(), phi_d: pair.phi_d() })
}

/// The unit directions `(wi, wo)` of half and difference angles, the inverse of [`half_diff`].
///
/// Not every set of angles has both directions above the horizon; `z` is negative where one is below it.
pub fn directions(angles: HalfDiff) -> ([f64; 3], [f64; 3]) {
    let (sin_h, cos_h) = angles.theta_h.sin_cos();
    let (sin_ph, cos_ph) = angles.phi_h.sin_cos();
    let (sin_d, cos_d) = angles.theta_d.sin_cos();
    let (sin_pd, cos_pd) = angles.phi_d.sin_cos();
    let turn = |x: f64, y: f64, z: f64| {
        let (x, z) = (cos_h * x + sin_h * z, cos_h * z - sin_h * x);
        [cos_ph * x - sin_ph * y, sin_ph * x + cos_ph * y, z]
    };
    (turn(sin_d * cos_pd, sin_d * sin_pd, cos_d), turn(-sin_d * cos_pd, -sin_d * sin_pd, cos_d))
}

/// How a value is read between bin centres.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Lookup {
    /// The bin that holds the position, as the MERL reference reader does.
    Nearest,
    /// Linear between bin centres on every axis.
    Linear,
}

/// The grid positions that a lookup reads, at most 16, with weights that sum to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taps {
    pairs: [(usize, f64); 16],
    len: usize,
}

impl Taps {
    /// Pairs of a position (linear index into the padded row-major [`Grid::shape`]) and its weight in (0, 1].
    pub fn as_slice(&self) -> &[(usize, f64)] {
        &self.pairs[..self.len]
    }
}

/// The positions and weights of a lookup at the bin coordinates that [`Parameterization::coordinates`](crate::Parameterization::coordinates) gives.
///
/// Bin `i` is centred at `i + 0.5`. Azimuths that close on themselves wrap; the others end at the centres of their
/// first and last bins. Coordinates outside `0..=len` (or NaN) go to the nearest end.
pub fn taps(grid: &Grid, coordinates: [f64; 4], lookup: Lookup) -> Taps {
    let mut taps = Taps { pairs: [(0, 1.0); 16], len: 1 };
    let padding = 4 - grid.axes().len();
    let around = neighbours(grid, coordinates, lookup);
    for (axis, around) in grid.axes().iter().zip(&around[padding..]) {
        for i in 0..taps.len {
            let (row, share) = taps.pairs[i];
            taps.pairs[i] = (row * axis.len + around.near, share * (1.0 - around.weight));
            if around.weight > 0.0 {
                taps.pairs[taps.len + i] = (row * axis.len + around.far, share * around.weight);
            }
        }
        taps.len *= if around.weight > 0.0 { 2 } else { 1 };
    }
    taps
}

/// The two bins around a coordinate of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Around {
    pub(crate) near: usize,
    /// 0 where its weight is.
    pub(crate) far: usize,
    /// Of the far one, in [0, 1).
    pub(crate) weight: f64,
}

/// The bins around bin coordinates, padded in front like them.
pub(crate) fn neighbours(grid: &Grid, coordinates: [f64; 4], lookup: Lookup) -> [Around; 4] {
    let mut around = [Around { near: 0, far: 0, weight: 0.0 }; 4];
    let padding = 4 - grid.axes().len();
    for ((around, axis), u) in around[padding..].iter_mut().zip(grid.axes()).zip(&coordinates[padding..]) {
        let (near, far, weight) = neighbours_on(axis, *u, lookup);
        *around = Around { near, far, weight };
    }
    around
}

/// The two bins around coordinate `u` and the weight of the second, in [0, 1).
pub(crate) fn neighbours_on(axis: &Axis, u: f64, lookup: Lookup) -> (usize, usize, f64) {
    let last = axis.len - 1;
    let u = if u.is_nan() { 0.0 } else { u.clamp(0.0, axis.len as f64) };
    if lookup == Lookup::Nearest {
        return ((u as usize).min(last), 0, 0.0);
    }
    // The bin centre at or above `u`, 0 to len; the one below is its predecessor.
    let above = (u + 0.5) as usize;
    let weight = u + 0.5 - above as f64;
    if (1..=last).contains(&above) {
        return (above - 1, above, weight);
    }
    if last > 0 && closes(axis) {
        return (last, 0, weight);
    }
    (above.min(last), 0, 0.0)
}

/// True where the first and last bins of an azimuth are neighbours: it covers the whole turn, or half a turn of phi_d,
/// which repeats after pi by reciprocity.
pub(crate) fn closes(axis: &Axis) -> bool {
    // Ranges may have come through degrees or single precision.
    let covers = |period: f64| (axis.end - axis.start - period).abs() < 1e-5 * period;
    axis.name.is_periodic() && (covers(TAU) || axis.name == AxisName::PhiD && covers(PI))
}

/// Bin coordinate of an azimuth; `mirrored` azimuths may also be read with the other sign.
#[inline]
pub(super) fn on_turn(axis: &Axis, angle: f64, mirrored: bool) -> Option<f64> {
    let span = axis.end - axis.start;
    let period = if closes(axis) { span } else { TAU };
    let past = |angle: f64| {
        let past = angle - axis.start;
        // The usual cases first: the remainder is slow.
        if (0.0..period).contains(&past) {
            return past;
        }
        if (period..2.0 * period).contains(&past) {
            return past - period;
        }
        // Rounds a tiny negative angle up to the period itself.
        let past = past.rem_euclid(period);
        if past < period { past } else { 0.0 }
    };
    let slack = span * (1.0 + 1e-9);
    let sign = [1.0, -1.0].into_iter().take(1 + mirrored as usize).find(|sign| past(sign * angle) <= slack)?;
    Some(axis.coordinate(axis.start + past(sign * angle)))
}

#[cfg(test)]
mod tests {
    use super::pair::norm;
    use super::*;
    use crate::table::grid::Mapping;
    use crate::table::parameterization::grid_coordinates;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    /// `rotate_vector` and `std_coords_to_half_diff_coords` of the MERL reference reader, transcribed.
    fn reference(wi: [f64; 3], wo: [f64; 3]) -> HalfDiff {
        fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        }
        fn rotate(v: [f64; 3], axis: [f64; 3], angle: f64) -> [f64; 3] {
            let (s, c) = angle.sin_cos();
            let mut out = v.map(|x| x * c);
            let temp = (v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2]) * (1.0 - c);
            let perpendicular = cross(axis, v);
            for k in 0..3 {
                out[k] += axis[k] * temp + perpendicular[k] * s;
            }
            out
        }
        let mut half: [f64; 3] = std::array::from_fn(|k| (wi[k] + wo[k]) / 2.0);
        let length = norm(half);
        half = half.map(|x| x / length);
        let (theta_h, phi_h) = (half[2].acos(), half[1].atan2(half[0]));
        let diff = rotate(rotate(wi, [0.0, 0.0, 1.0], -phi_h), [0.0, 1.0, 0.0], -theta_h);
        HalfDiff { theta_h, phi_h, theta_d: diff[2].acos(), phi_d: diff[1].atan2(diff[0]) }
    }

    fn direction(theta: f64, phi: f64) -> [f64; 3] {
        [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
    }

    fn turn_apart(a: f64, b: f64) -> f64 {
        let d = (a - b).rem_euclid(TAU);
        d.min(TAU - d)
    }

    fn axis(name: AxisName, len: usize, end: f64) -> Axis {
        Axis { name, len, mapping: Mapping::Linear, start: 0.0, end }
    }

    fn grid(axes: Vec<Axis>) -> Grid {
        Grid::new(axes, Grid::rgb_channels([1.0; 3])).unwrap()
    }

    proptest! {
        #[test]
        fn directions_survive_the_round_trip(ti in 0.0..FRAC_PI_2, pi in 0.0..TAU, to in 0.0..FRAC_PI_2, po in 0.0..TAU) {
            let (wi, wo) = (direction(ti, pi), direction(to, po));
            let angles = half_diff(wi, wo).unwrap();
            let (back_i, back_o) = directions(angles);
            for k in 0..3 {
                prop_assert!((back_i[k] - wi[k]).abs() < 1e-13 && (back_o[k] - wo[k]).abs() < 1e-13, "{angles:?}");
            }
        }

        #[test]
        fn angles_are_those_of_the_merl_reader(ti in 0.01..1.56f64, pi in 0.0..TAU, to in 0.01..1.56f64, po in 0.0..TAU) {
            let (wi, wo) = (direction(ti, pi), direction(to, po));
            let (ours, theirs) = (half_diff(wi, wo).unwrap(), reference(wi, wo));
            prop_assume!(ours.theta_d > 1e-3 && ours.theta_h > 1e-3);
            prop_assert!((ours.theta_h - theirs.theta_h).abs() < 1e-9);
            prop_assert!((ours.theta_d - theirs.theta_d).abs() < 1e-9);
            prop_assert!(turn_apart(ours.phi_h, theirs.phi_h) < 1e-9);
            prop_assert!(turn_apart(ours.phi_d, theirs.phi_d) < 1e-9);
        }

        #[test]
        fn swapped_directions_are_half_a_turn_of_phi_d_and_mirrored_ones_its_negative(
            ti in 0.0..1.57f64, pi in 0.0..TAU, to in 0.0..1.57f64, po in 0.0..TAU,
        ) {
            let a = half_diff(direction(ti, pi), direction(to, po)).unwrap();
            prop_assume!(a.theta_d > 1e-6 && a.theta_h > 1e-6);
            let swapped = half_diff(direction(to, po), direction(ti, pi)).unwrap();
            prop_assert!(turn_apart(swapped.phi_d, a.phi_d + PI) < 1e-8);
            let mirrored = half_diff(direction(ti, -pi), direction(to, -po)).unwrap();
            prop_assert!(turn_apart(mirrored.phi_d, -a.phi_d) < 1e-8);
            // On MERL's grid reciprocity leaves the position where it was.
            let merl = Grid::merl();
            let u = grid_coordinates(&merl, direction(ti, pi), direction(to, po)).unwrap();
            let v = grid_coordinates(&merl, direction(to, po), direction(ti, pi)).unwrap();
            let apart = (u[3] - v[3]).abs();
            prop_assert!(apart.min(180.0 - apart) < 1e-5, "{u:?} {v:?}");
        }

        #[test]
        fn weights_sum_to_one_and_positions_stay_inside(
            u in prop::array::uniform4(prop_oneof![-1.0..12.0f64, Just(f64::NAN), Just(0.0), Just(9.0), Just(f64::INFINITY)]),
            linear: bool,
        ) {
            let grid = grid(vec![
                axis(AxisName::ThetaH, 3, FRAC_PI_2), axis(AxisName::PhiH, 9, TAU),
                axis(AxisName::ThetaD, 1, FRAC_PI_2), axis(AxisName::PhiD, 5, PI),
            ]);
            let taps = taps(&grid, u, if linear { Lookup::Linear } else { Lookup::Nearest });
            let sum: f64 = taps.as_slice().iter().map(|t| t.1).sum();
            prop_assert!((sum - 1.0).abs() < 1e-14);
            prop_assert!(taps.as_slice().iter().all(|t| t.0 < grid.positions() && t.1 > 0.0));
        }
    }

    #[test]
    fn corner_cases_are_finite_or_none() {
        let up = [0.0, 0.0, 1.0];
        assert_eq!(half_diff(up, up), Some(HalfDiff { theta_h: 0.0, phi_h: 0.0, theta_d: 0.0, phi_d: 0.0 }));
        // Length does not matter, however extreme.
        assert_eq!(half_diff([0.0, 0.0, 1e300], [0.0, -0.0, 5e-324]), half_diff(up, up));
        let grazing = half_diff([1.0, 0.0, 0.0], [1.0, 0.0, -0.0]).unwrap();
        assert_eq!((grazing.theta_h, grazing.theta_d), (FRAC_PI_2, 0.0));
        let right = half_diff([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]).unwrap();
        assert!((right.theta_h - FRAC_PI_2).abs() < 1e-15 && (right.theta_d - PI / 4.0).abs() < 1e-15);
        assert!((right.phi_d - 1.5 * PI).abs() < 1e-15);
        // Directions one millionth apart keep their difference to ten digits; acos would keep four.
        let close = half_diff(direction(0.5, 0.3), direction(0.5 + 1e-6, 0.3)).unwrap();
        assert!((close.theta_d / 5e-7 - 1.0).abs() < 1e-9, "{close:?}");
        for bad in [[0.0; 3], [f64::NAN, 0.0, 1.0], [0.0, f64::INFINITY, 1.0], [0.0, 0.1, -1e-9], [1.0, 0.0, f64::NAN]]
        {
            assert_eq!(half_diff(bad, up), None);
            assert_eq!(half_diff(up, bad), None);
        }
        assert_eq!(half_diff([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]), None);
        assert_eq!(half_diff(direction(FRAC_PI_2, 0.7), direction(FRAC_PI_2, 0.7 + PI)), None);
    }

    #[test]
    fn merl_nearest_is_the_index_of_the_reference_reader() {
        let grid = Grid::merl();
        let (wi, wo) = (direction(0.6, 0.2), direction(0.9, 2.9));
        let r = reference(wi, wo);
        let phi_d = if r.phi_d < 0.0 { r.phi_d + PI } else { r.phi_d };
        let half = (((r.theta_h / FRAC_PI_2 * 90.0) * 90.0).sqrt()) as usize;
        let index = (phi_d / PI * 180.0) as usize + 180 * ((r.theta_d / FRAC_PI_2 * 90.0) as usize + 90 * half);
        let u = grid_coordinates(&grid, wi, wo).unwrap();
        assert_eq!(u[0], 0.5);
        assert_eq!(taps(&grid, u, Lookup::Nearest).as_slice(), &[(index, 1.0)]);
    }

    #[test]
    fn azimuths_wrap_and_elevations_end() {
        let grid = grid(vec![axis(AxisName::ThetaD, 4, FRAC_PI_2), axis(AxisName::PhiD, 8, PI)]);
        let at = |theta, phi| taps(&grid, [0.5, 0.5, theta, phi], Lookup::Linear).as_slice().to_vec();
        assert_eq!(at(0.2, 0.25), vec![(7, 0.25), (0, 0.75)]);
        assert_eq!(at(3.9, 7.75), vec![(31, 0.75), (24, 0.25)]);
        assert_eq!(at(1.0, 2.5), vec![(2, 0.5), (10, 0.5)]);
        assert_eq!(at(1.0, 8.0).len(), 4);
    }

    #[test]
    fn isotropic_tables_of_directions_use_the_azimuth_difference() {
        let third = |end| {
            grid(vec![
                axis(AxisName::ThetaI, 9, FRAC_PI_2),
                axis(AxisName::ThetaO, 9, FRAC_PI_2),
                axis(AxisName::PhiO, 18, end),
            ])
        };
        let (wi, wo) = (direction(0.3, 1.0), direction(0.7, 0.2));
        let whole = grid_coordinates(&third(TAU), wi, wo).unwrap();
        assert!((whole[3] - (TAU - 0.8) / TAU * 18.0).abs() < 1e-12);
        assert!((whole[1] - 0.3 / FRAC_PI_2 * 9.0).abs() < 1e-12 && (whole[2] - 0.7 / FRAC_PI_2 * 9.0).abs() < 1e-12);
        // Half a turn: mirror symmetry, and the ends are no neighbours.
        let half = grid_coordinates(&third(PI), wi, wo).unwrap();
        assert!((half[3] - 0.8 / PI * 18.0).abs() < 1e-12);
        assert_eq!(taps(&third(PI), [0.5, 0.5, 0.5, 0.1], Lookup::Linear).as_slice(), &[(0, 1.0)]);
        // Anisotropic: both azimuths as they are.
        let names = [AxisName::ThetaI, AxisName::PhiI, AxisName::ThetaO, AxisName::PhiO];
        let full = grid(names.map(|n| axis(n, 10, if n.is_periodic() { TAU } else { FRAC_PI_2 })).to_vec());
        let u = grid_coordinates(&full, wi, wo).unwrap();
        assert!((u[1] - 10.0 / TAU).abs() < 1e-12 && (u[3] - 2.0 / TAU).abs() < 1e-12);
        // No meaning, no answer.
        assert_eq!(grid_coordinates(&grid(vec![axis(AxisName::Other, 3, 1.0)]), wi, wo), None);
        assert_eq!(grid_coordinates(&grid(vec![axis(AxisName::PhiH, 3, 0.1)]), wi, wo), None);
    }
}
