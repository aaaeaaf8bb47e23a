//! Mean reflectance by theta_h, theta_d and a coarse phi_d, from one pass over the blocks of a file.

use std::f64::consts::FRAC_PI_2;

use crate::base::budget::lengthen;
use crate::base::error::{Error, Result};
use crate::decode::{Reader, Scratch};
use crate::table::block::Block;
use crate::table::coords::{Lookup, neighbours_on};
use crate::table::grid::Axis;
use crate::table::horizon::Horizon;
use crate::table::parameterization::Parameterization;

/// Parts of phi_d, folded to a quarter turn: an isotropic, reciprocal material repeats in the other three.
const SECTORS: usize = 4;

/// Most bins of an elevation; longer axes are summed to this many. Three times the rings that the means are for.
const MAX_BINS: usize = 256;

/// Operations of adding a value up.
const WORK: u64 = 2;

/// Weight of a bin below the horizon, which counts where its cell has no other.
const IMPOSSIBLE: f64 = 1e-9;

/// A pair of directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    /// Elevation of the half vector, radians.
    pub(super) theta_h: f64,
    /// Angle between it and either direction, radians.
    pub(super) theta_d: f64,
    /// |cos(phi_d)|.
    pub(super) cos_phi_d: f64,
}

/// Means over all channels, 1/sr, `[theta_h][theta_d][sector of phi_d]`.
#[derive(Debug)]
pub(super) struct Marginal {
    /// The axes of the means.
    theta_h: Axis,
    /// `None` where the grid has no such axis.
    theta_d: Option<Axis>,
    values: Vec<f64>,
}

impl Marginal {
    /// `None` if the grid is not one of half and difference angles with theta_h.
    pub(super) fn of<D: AsRef<[u8]>>(reader: &Reader<D>) -> Result<Option<Marginal>> {
        let grid = reader.grid();
        let Ok(parameterization) = Parameterization::of(grid) else { return Ok(None) };
        let Some(angles) = parameterization.half_difference() else { return Ok(None) };
        let Some(h) = angles.theta_h() else { return Ok(None) };
        reader.check_table_size()?;
        let coarse = |axis: Axis| Axis { len: axis.len.min(MAX_BINS), ..axis };
        let theta_h = coarse(grid.axes()[h]);
        let theta_d = angles.theta_d().map(|d| coarse(grid.axes()[d]));
        let row = theta_d.map_or(1, |axis| axis.len) * SECTORS;
        let mut sums = Sums {
            // Small by a constant: four sectors of 256 bins of each elevation.
            cells: vec![[0.0; 2]; theta_h.len * row],
            offsets: std::array::from_fn(|_| vec![0]),
            weights: Vec::new(),
        };
        let places = sums.offsets[4 - grid.axes().len()..].iter_mut().zip(grid.axes());
        for (number, (offsets, axis)) in places.enumerate() {
            let (of, bins) = (Some(number), coarse(*axis).len);
            let offset = |i: usize| match of {
                of if of == angles.theta_h() => i * bins / axis.len * row,
                of if of == angles.theta_d() => i * bins / axis.len * SECTORS,
                of if of == angles.phi_d() => sector(axis.angle(i as f64 + 0.5).cos().abs()),
                _ => 0,
            };
            *offsets = (0..axis.len).map(offset).collect();
        }
        let horizon = Horizon::new(grid);
        let mut scratch = Scratch::default();
        let (mut values, call) = (Vec::new(), reader.call());
        for block in 0..reader.block_count() {
            let size = reader.block_values(block)?;
            // With the weights of its positions.
            let _held = call.holding(12 * size as u64)?;
            call.spend(WORK * size as u64)?;
            values.truncate(size);
            lengthen(&mut values, size, 0.0)?;
            match reader.block_within(block, &mut scratch, &mut values, &call) {
                // Left out because nobody looks there: as if its bins were not on the grid.
                Err(Error::Pruned { .. } | Error::Lost { .. }) => continue,
                result => result?,
            }
            if let Some(place) = reader.partition().block(block) {
                sums.add(&place, horizon.as_ref(), &values);
            }
        }
        let scale = 1.0 / grid.channels().len() as f64;
        Ok(Some(Marginal { theta_h, theta_d, values: sums.means(scale) }))
    }

    /// Mean reflectance, 1/sr, linear in both elevations.
    pub(super) fn at(&self, pair: Pair) -> f64 {
        let (h, next_h, along_h) = neighbours_on(&self.theta_h, self.theta_h.coordinate(pair.theta_h), Lookup::Linear);
        let (d, next_d, along_d) = match &self.theta_d {
            Some(axis) => neighbours_on(axis, axis.coordinate(pair.theta_d), Lookup::Linear),
            None => (0, 0, 0.0),
        };
        let (sector, row) = (sector(pair.cos_phi_d), self.values.len() / self.theta_h.len);
        let value = |h: usize, d: usize| self.values[h * row + d * SECTORS + sector];
        let along = |h: usize| value(h, d) * (1.0 - along_d) + value(h, next_d) * along_d;
        along(h) * (1.0 - along_h) + along(next_h) * along_h
    }
}

struct Sums {
    /// Weighted sum and weight.
    cells: Vec<[f64; 2]>,
    /// What a bin of each axis adds to the number of the cell.
    offsets: [Vec<usize>; 4],
    /// Of the bins of the block at hand.
    weights: Vec<f64>,
}

impl Sums {
    /// Adds a block's values, `[channel][position]`.
    fn add(&mut self, place: &Block, horizon: Option<&Horizon>, values: &[f32]) {
        let n = place.positions();
        self.weights.clear();
        match horizon {
            Some(horizon) => {
                horizon.for_each(place, |height| self.weights.push(if height > 0.0 { 1.0 } else { IMPOSSIBLE }))
            }
            None => self.weights.resize(n, 1.0),
        }
        let bins: [&[usize]; 4] =
            std::array::from_fn(|a| &self.offsets[a][place.origin[a]..place.origin[a] + place.shape[a]]);
        let mut position = 0;
        for i in bins[0] {
            for j in bins[1] {
                for k in bins[2] {
                    for l in bins[3] {
                        let sum: f64 = values[position..].iter().step_by(n).map(|v| f64::from(*v)).sum();
                        let [total, weight] = &mut self.cells[i + j + k + l];
                        *total += self.weights[position] * sum;
                        *weight += self.weights[position];
                        position += 1;
                    }
                }
            }
        }
    }

    /// Times `scale`; a cell that no bin fell into has the mean of the others at its elevations.
    fn means(self, scale: f64) -> Vec<f64> {
        let mean = |[total, weight]: [f64; 2]| if weight > 0.0 { total / weight * scale } else { 0.0 };
        let row = |cells: &[[f64; 2]]| {
            let all = cells.iter().fold([0.0; 2], |sum, cell| [sum[0] + cell[0], sum[1] + cell[1]]);
            cells.iter().map(|cell| mean(if cell[1] > 0.0 { *cell } else { all })).collect::<Vec<_>>()
        };
        self.cells.chunks_exact(SECTORS).flat_map(row).collect()
    }
}

/// Which part of the quarter turn.
fn sector(cos_phi_d: f64) -> usize {
    ((cos_phi_d.min(1.0).acos() / FRAC_PI_2 * SECTORS as f64) as usize).min(SECTORS - 1)
}
