//! A table as the renderers read it.

use crate::table::Table;
use crate::table::coords::{Batch, Lookup, Taps, taps};
use crate::table::grid::Grid;
use crate::table::parameterization::Parameterization;

/// The colours of a table side by side, in 1/sr: a lookup touches a third of the memory that it does in planes.
///
/// Missing entries are left out of the interpolation and the weights of the others raised; where all are missing, and
/// on grids whose axes are no angles of directions, nothing is reflected. Channels named R, G, B give the
/// colours; of others those nearest to 610, 550 and 465 nm, or else the first, the middle and the last.
#[derive(Clone, Debug)]
pub struct Texels {
    grid: Grid,
    /// `None` where directions have no place on the grid.
    parameterization: Option<Parameterization>,
    /// NaN marks missing entries.
    values: Vec<[f32; 3]>,
}

impl Texels {
    /// A copy of the table's colours.
    pub fn new(table: &Table) -> Texels {
        let grid = table.grid().clone();
        let channels = colour_channels(&grid);
        let values = (0..grid.positions())
            .map(|p| {
                channels.map(|c| {
                    let value = (table.plane(c)[p] * grid.channels()[c].scale) as f32;
                    if table.valid_plane(c)[p] { value.min(f32::MAX) } else { f32::NAN }
                })
            })
            .collect();
        Texels { parameterization: Parameterization::of(&grid).ok(), grid, values }
    }

    /// The BRDF in 1/sr, red, green, blue, interpolated linearly; `wi` and `wo` above the horizon, z along the normal.
    pub fn eval(&self, wi: [f64; 3], wo: [f64; 3]) -> [f32; 3] {
        let coordinates = self.parameterization.as_ref().and_then(|p| p.coordinates(wi, wo));
        coordinates.map_or([0.0; 3], |coordinates| self.mix(&taps(&self.grid, coordinates, Lookup::Linear)))
    }

    /// The positions that pairs of directions lie between, with their weights, by the number of the pair; leaves out those that have no
    /// place on the grid. At most a batch of pairs.
    pub(super) fn each_taps(&self, wi: &[[f64; 3]], wo: &[[f64; 3]], mut with: impl FnMut(usize, &Taps)) {
        let Some(parameterization) = &self.parameterization else { return };
        let mut batch = Batch::new();
        let batches = parameterization.takes_batches();
        if batches {
            batch.fill(wi, wo);
        }
        for (i, (&wi, &wo)) in wi.iter().zip(wo).enumerate() {
            let coordinates = match batches {
                true => parameterization.batch_coordinates(&batch, i, wi, wo),
                false => parameterization.coordinates(wi, wo),
            };
            if let Some(coordinates) = coordinates {
                with(i, &taps(&self.grid, coordinates, Lookup::Linear));
            }
        }
    }

    /// The colours at positions of this grid, by their weights.
    pub(super) fn mix(&self, taps: &Taps) -> [f32; 3] {
        let (mut sums, mut weights) = ([0.0; 3], [0.0; 3]);
        for &(position, weight) in taps.as_slice() {
            for k in 0..3 {
                let value = self.values[position][k];
                if !value.is_nan() {
                    sums[k] += weight * f64::from(value);
                    weights[k] += weight;
                }
            }
        }
        std::array::from_fn(|k| if weights[k] > 0.0 { (sums[k] / weights[k]) as f32 } else { 0.0 })
    }
}

/// The channels shown as red, green and blue.
fn colour_channels(grid: &Grid) -> [usize; 3] {
    let channels = grid.channels();
    let named = ["R", "G", "B"].map(|name| channels.iter().position(|c| c.name == name));
    if let [Some(r), Some(g), Some(b)] = named {
        return [r, g, b];
    }
    if channels.iter().all(|c| c.wavelength.is_some()) {
        return [610.0, 550.0, 465.0].map(|target: f64| {
            let away = |c: usize| channels[c].wavelength.map_or(f64::INFINITY, |w| (w - target).abs());
            (0..channels.len()).min_by(|a, b| away(*a).total_cmp(&away(*b))).unwrap_or(0)
        });
    }
    let last = channels.len() - 1;
    [0, last / 2, last]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_come_from_names_or_wavelengths() {
        let axes = Grid::merl().axes()[..1].to_vec();
        let channels = |names: &[&str], wavelengths: &[Option<f64>]| {
            let channel = |(n, w): (&&str, &Option<f64>)| crate::table::grid::Channel {
                name: n.to_string(),
                wavelength: *w,
                scale: 1.0,
            };
            Grid::new(axes.clone(), names.iter().zip(wavelengths).map(channel).collect()).unwrap()
        };
        assert_eq!(colour_channels(&channels(&["B", "G", "R"], &[None; 3])), [2, 1, 0]);
        let wavelengths = [Some(400.0), Some(470.0), Some(540.0), Some(600.0), Some(700.0)];
        assert_eq!(colour_channels(&channels(&["a", "b", "c", "d", "e"], &wavelengths)), [3, 2, 1]);
        assert_eq!(colour_channels(&channels(&["luminance"], &[None])), [0, 0, 0]);
    }
}
