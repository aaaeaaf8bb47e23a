use std::f64::consts::{FRAC_PI_2, PI, TAU};

use proptest::prelude::*;

use super::*;
use crate::table::grid::{AxisName, Mapping};

fn axis(name: AxisName, len: usize, end: f64) -> Axis {
    Axis { name, len, mapping: if name == AxisName::ThetaH { Mapping::Square } else { Mapping::Linear }, start: 0.0, end }
}

fn grid(axes: &[Axis]) -> Grid {
    Grid::new(axes.to_vec(), Grid::rgb_channels([1.0; 3])).unwrap()
}

/// Full and reduced grids of both kinds; none leaves open what its coordinates hang on.
fn grids() -> Vec<Grid> {
    let [h, d, i, o] = [AxisName::ThetaH, AxisName::ThetaD, AxisName::ThetaI, AxisName::ThetaO].map(|n| axis(n, 9, FRAC_PI_2));
    let turn = |name, end| axis(name, 13, end);
    let (phi_h, phi_i, phi_o) = (turn(AxisName::PhiH, TAU), turn(AxisName::PhiI, TAU), turn(AxisName::PhiO, TAU));
    vec![
        Grid::merl(),
        Grid::merl_360(),
        grid(&[h, phi_h, d, turn(AxisName::PhiD, TAU)]),
        grid(&[phi_h, turn(AxisName::PhiD, PI), d, h]),
        grid(&[h]),
        grid(&[d, h]),
        grid(&[i, phi_i, o, phi_o]),
        grid(&[o, i, phi_i]),
        grid(&[i, o, turn(AxisName::PhiO, PI)]),
        grid(&[i, o]),
    ]
}

fn apart(period: Option<f64>, axis: &Axis, u: f64, v: f64) -> f64 {
    let apart = (u - v).abs();
    if period.is_some() { apart.min(axis.len as f64 - apart) } else { apart }
}

fn close(map: &Parameterization, grid: &Grid, u: [f64; 4], v: [f64; 4]) -> bool {
    let padding = 4 - grid.axes().len();
    u[..padding] == v[..padding]
        && grid.axes().iter().enumerate().all(|(a, axis)| apart(map.period(a), axis, u[padding + a], v[padding + a]) < 1e-6)
}

proptest! {
    #[test]
    fn coordinates_become_a_pair_and_the_pair_the_coordinates(t in prop::array::uniform4(0.01f64..0.99)) {
        for grid in grids() {
            let map = Parameterization::of(&grid).unwrap();
            let mut u = [0.5; 4];
            let padding = 4 - grid.axes().len();
            for (a, axis) in grid.axes().iter().enumerate() {
                u[padding + a] = t[a] * axis.len as f64;
            }
            let (wi, wo) = map.directions(u).unwrap();
            prop_assert_eq!(map.is_below_horizon(u), wi[2] < 0.0 || wo[2] < 0.0);
            if map.is_below_horizon(u) {
                prop_assert_eq!(map.coordinates(wi, wo), None);
            } else {
                let back = map.coordinates(wi, wo).unwrap();
                prop_assert!(close(&map, &grid, u, back), "{:?} {u:?} {back:?}", grid.axes());
            }
        }
    }

    #[test]
    fn a_pair_and_that_at_its_coordinates_have_the_same(
        ti in 0.01..1.55f64, pi in 0.0..TAU, to in 0.01..1.55f64, po in 0.0..TAU
    ) {
        let direction = |theta: f64, phi: f64| [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        let (wi, wo) = (direction(ti, pi), direction(to, po));
        for grid in grids() {
            let map = Parameterization::of(&grid).unwrap();
            let u = map.coordinates(wi, wo).unwrap();
            let (wi2, wo2) = map.directions(u).unwrap();
            // Angles that the grid has no axis for are chosen above the horizon.
            if wi2[2] < 0.0 || wo2[2] < 0.0 {
                prop_assert!(wi2[2].min(wo2[2]) > -1e-9);
                continue;
            }
            let back = map.coordinates(wi2, wo2).unwrap();
            prop_assert!(close(&map, &grid, u, back), "{:?} {u:?} {back:?}", grid.axes());
            let swapped = map.coordinates(wo, wi).unwrap();
            prop_assert!(!map.folds_by_reciprocity() || close(&map, &grid, u, swapped), "{:?} {u:?} {swapped:?}", grid.axes());
            let turned = map.coordinates(direction(ti, pi + 1.0), direction(to, po + 1.0)).unwrap();
            prop_assert!(!map.is_isotropic() || close(&map, &grid, u, turned), "{:?} {u:?} {turned:?}", grid.axes());
        }
    }
}

#[test]
fn axes_say_what_they_are() {
    let of = |axes: &[Axis]| Parameterization::of(&grid(axes));
    let merl = Parameterization::of(&Grid::merl()).unwrap();
    assert_eq!([0, 1, 2, 3].map(|a| merl.period(a)), [None, None, Some(PI), None]);
    assert!(merl.folds_by_reciprocity() && merl.is_isotropic() && merl.takes_batches());
    let whole = Parameterization::of(&Grid::merl_360()).unwrap();
    assert!(whole.period(2) == Some(TAU) && !whole.folds_by_reciprocity());
    let (h, i) = (axis(AxisName::ThetaH, 9, FRAC_PI_2), axis(AxisName::ThetaI, 9, FRAC_PI_2));
    let mixed = of(&[h, i]).unwrap();
    assert!(mixed.directions([0.5; 4]).is_none() && mixed.coordinates([0.0, 0.0, 1.0], [0.6, 0.0, 0.8]).is_some());
    let names = [merl.name(), of(&[i]).unwrap().name(), mixed.name()];
    assert!(names.iter().enumerate().all(|(n, name)| !names[..n].contains(name)));
    let why = of(&[h, axis(AxisName::Other, 3, 1.0)]).unwrap_err().to_string();
    assert!(why.contains(r#"axes ["theta_h", "other"] do not say how directions map to the grid"#), "{why}");
}

#[test]
fn elevations_are_known_whatever_else_the_grid_has() {
    let merl = Grid::merl();
    assert_eq!(Parameterization::grazing_axes(&merl), Some([0, 1, 2]));
    let [h, d, p] = [0, 1, 2].map(|a| merl.axes()[a]);
    for (axes, elevations) in [
        (&[h, d, p, axis(AxisName::Other, 2, 1.0)][..], Some([0, 1, 2])),
        (&[d, p, h], Some([2, 0, 1])),
        (&[h, d], None),
    ] {
        assert_eq!(Parameterization::elevation_axes(&grid(axes)), elevations);
        assert_eq!(Parameterization::grazing_axes(&grid(axes)), None);
    }
}
