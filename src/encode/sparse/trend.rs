//! A smooth model of a whole table from few samples, taken out before the l1 recovery (encoder only).
//!
//! Towards grazing directions a BRDF varies with the elevations of light and sensor, whose lines of equal value cross
//! the grid of half and difference angles at a slant: no block of Fourier terms is sparse there. Microfacet models are
//! a product of factors of these angles (Cook and Torrance 1982; Bagher et al. 2016), so their log is a sum. The model
//! here is the sum of six tables over pairs of theta_h, theta_d, and the elevations of both directions; a table over
//! pairs also holds factors that are no products. Least squares with smooth tables (squared second differences),
//! conjugate gradients.
//!
//! Measured, log rms at 5 % / 1 % with weighted l1 on 15 x 15 x 60 windows, without -> with (theta_h, theta_d) +
//! (elevations) -> with all six: alum-bronze .078 / .228 -> .064 -> .018 / .040; chrome-steel .154 -> .018 -> .014; RGL golden
//! yellow .066 -> .061 -> .054 / .10. Pairs with phi_d change nothing.

use rayon::prelude::*;

use crate::codec::sample::SplitMix64;
use crate::table::grid::Grid;
use crate::table::parameterization::Parameterization;

/// Knots of the tables along an elevation.
const ELEVATION_KNOTS: usize = 48;

/// Knots at most along another angle.
const ANGLE_KNOTS: usize = 90;

/// Elevations are spaced as ln(z + this): fine near the horizon.
const HORIZON: f64 = 0.01;

/// Tables, by the coordinates that they are over: theta_h, theta_d, elevation of light, of sensor.
const PAIRS: [[usize; 2]; 6] = [[0, 1], [2, 3], [1, 2], [1, 3], [0, 2], [0, 3]];

/// Tables' entries that a position is interpolated from.
const TAPS: usize = 4 * PAIRS.len();

/// Samples at most that a model is fitted to: more add seconds, but nothing to so few unknowns.
const SAMPLES: usize = 100_000;

/// Keeps entries that no sample touches, nor a table's smoothness determines, at zero.
const RIDGE: f64 = 1e-4;

const ITERATIONS: usize = 400;

/// Squared residual, relative to the start, at which the fit is done.
const TOLERANCE: f64 = 1e-8;

/// Where the positions of a grid are in the tables.
pub(in crate::encode) struct Model {
    knots: [usize; 4],
    /// First unknown of each table.
    base: [usize; PAIRS.len()],
    unknowns: usize,
    shape: [usize; 4],
    /// Padded axis numbers of theta_h and theta_d and phi_d.
    axes: [usize; 3],
    /// Angles at the bin centres.
    angles: [Vec<f64>; 3],
}

/// Entries and weights that positions are interpolated from, [`TAPS`] each.
pub(in crate::encode) struct Design {
    taps: Vec<(u32, f32)>,
    /// Every n-th sample is used.
    stride: usize,
    positions: usize,
}

/// A fitted model of one component.
#[derive(Clone, Debug)]
pub(in crate::encode) struct Trend {
    mean: f64,
    entries: Vec<f64>,
}

impl Model {
    /// `None` unless the grid has half and difference angles, without a second azimuth.
    pub(in crate::encode) fn new(grid: &Grid) -> Option<Model> {
        let axes = Parameterization::elevation_axes(grid)?;
        if axes.iter().any(|&axis| grid.axes()[axis].len == 1) {
            return None;
        }
        if grid.axes().iter().filter(|axis| axis.len > 1).count() > axes.len() {
            return None;
        }
        let angles = axes.map(|axis| {
            let axis = &grid.axes()[axis];
            (0..axis.len).map(|i| axis.angle(i as f64 + 0.5)).collect::<Vec<f64>>()
        });
        let angle_knots = |axis: usize| angles[axis].len().min(ANGLE_KNOTS);
        let knots = [angle_knots(0), angle_knots(1), ELEVATION_KNOTS, ELEVATION_KNOTS];
        let mut unknowns = 0;
        let base = PAIRS.map(|[a, b]| {
            unknowns += knots[a] * knots[b];
            unknowns - knots[a] * knots[b]
        });
        let padding = 4 - grid.axes().len();
        Some(Model { knots, base, unknowns, shape: grid.shape(), axes: axes.map(|a| a + padding), angles })
    }

    /// The entries that the value at a position is interpolated from, and their weights.
    fn taps(&self, position: usize) -> [(u32, f32); TAPS] {
        let mut at = [0; 4];
        let mut rest = position;
        for axis in (0..4).rev() {
            at[axis] = rest % self.shape[axis];
            rest /= self.shape[axis];
        }
        let [h, d, p] = self.axes.map(|axis| at[axis]);
        let [light, sensor] = elevations(self.angles[0][h], self.angles[1][d], self.angles[2][p]);
        let along = |z: f64| ((z.max(0.0) / HORIZON).ln_1p() / (1.0 / HORIZON).ln_1p()).min(1.0);
        let fraction = |i: usize, axis: usize| i as f64 / (self.angles[axis].len() - 1) as f64;
        let coordinates = [fraction(h, 0), fraction(d, 1), along(light), along(sensor)];
        let cells: [(usize, f64); 4] = std::array::from_fn(|i| {
            let at = coordinates[i] * (self.knots[i] - 1) as f64;
            let cell = (at as usize).min(self.knots[i] - 2);
            (cell, at - cell as f64)
        });
        let mut taps = [(0, 0.0); TAPS];
        for ((&[a, b], base), taps) in PAIRS.iter().zip(self.base).zip(taps.chunks_exact_mut(4)) {
            let ((row, along_row), (column, along_column)) = (cells[a], cells[b]);
            let first = base + row * self.knots[b] + column;
            let (near, far) = (1.0 - along_row, along_row);
            taps[0] = (first as u32, (near * (1.0 - along_column)) as f32);
            taps[1] = (first as u32 + 1, (near * along_column) as f32);
            taps[2] = ((first + self.knots[b]) as u32, (far * (1.0 - along_column)) as f32);
            taps[3] = ((first + self.knots[b]) as u32 + 1, (far * along_column) as f32);
        }
        taps
    }

    /// The samples at `positions`, or evenly spread ones of many.
    pub(in crate::encode) fn design(&self, positions: &[u32]) -> Design {
        let stride = positions.len().div_ceil(SAMPLES).max(1);
        let taps = positions
            .iter()
            .enumerate()
            .filter(|(i, _)| one_of(*i, stride))
            .flat_map(|(_, &p)| self.taps(p as usize))
            .collect();
        Design { taps, stride, positions: self.shape.iter().product() }
    }

    /// The model nearest to samples, `values` in the order of the design's positions. `stiffness` weighs smoothness: 1 suits
    /// most tables.
    pub(in crate::encode) fn fit(&self, design: &Design, values: &[f64], stiffness: f64) -> Trend {
        let used = values.iter().enumerate().filter(|(i, _)| one_of(*i, design.stride));
        let values: Vec<f64> = used.map(|(_, v)| *v).collect();
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        // The weight of smoothness grows with the number of samples: best found at 1 % about 1, at 5 % about 5.
        let smooth = stiffness * 100.0 * values.len() as f64 / design.positions as f64;
        let mut right = vec![0.0; self.unknowns];
        let mut diagonal = vec![RIDGE; self.unknowns];
        for (taps, value) in design.taps.chunks_exact(TAPS).zip(&values) {
            for &(entry, weight) in taps {
                right[entry as usize] += f64::from(weight) * (value - mean);
                diagonal[entry as usize] += f64::from(weight).powi(2);
            }
        }
        // A second difference each way puts 1 + 4 + 1 on an entry.
        diagonal.iter_mut().for_each(|d| *d += 12.0 * smooth);
        let entries = conjugate_gradients(&right, &diagonal, |x, y| self.normal(design, smooth, x, y));
        Trend { mean, entries }
    }

    /// y = (A^T A + smooth D^T D + ridge) x, A the design and D the second differences of the tables.
    fn normal(&self, design: &Design, smooth: f64, x: &[f64], y: &mut [f64]) {
        for (y, x) in y.iter_mut().zip(x) {
            *y = RIDGE * x;
        }
        for taps in design.taps.chunks_exact(TAPS) {
            let value: f64 = taps.iter().map(|&(entry, weight)| f64::from(weight) * x[entry as usize]).sum();
            for &(entry, weight) in taps {
                y[entry as usize] += f64::from(weight) * value;
            }
        }
        let mut bend = |at: usize, step: usize| {
            let second = smooth * (x[at - step] - 2.0 * x[at] + x[at + step]);
            y[at - step] += second;
            y[at] -= 2.0 * second;
            y[at + step] += second;
        };
        for (&[a, b], base) in PAIRS.iter().zip(self.base) {
            let (rows, columns) = (self.knots[a], self.knots[b]);
            for row in 0..rows {
                for column in 1..columns - 1 {
                    bend(base + row * columns + column, 1);
                }
            }
            for row in 1..rows - 1 {
                for column in 0..columns {
                    bend(base + row * columns + column, columns);
                }
            }
        }
    }

    /// The values of the components' models everywhere: `[component][position]`, zero where there is none.
    pub(in crate::encode) fn evaluate(&self, trends: &[Option<Trend>]) -> Vec<f64> {
        let positions: usize = self.shape.iter().product();
        let mut planes = vec![0.0; positions * trends.len()];
        if trends.iter().all(Option::is_none) {
            return planes;
        }
        const CHUNK: usize = 4096;
        let mut rows: Vec<Vec<&mut [f64]>> = (0..positions.div_ceil(CHUNK)).map(|_| Vec::new()).collect();
        for plane in planes.chunks_exact_mut(positions) {
            rows.iter_mut().zip(plane.chunks_mut(CHUNK)).for_each(|(row, chunk)| row.push(chunk));
        }
        rows.into_par_iter().enumerate().for_each(|(number, mut chunks)| {
            for i in 0..chunks[0].len() {
                let taps = self.taps(number * CHUNK + i);
                for (chunk, trend) in chunks.iter_mut().zip(trends) {
                    chunk[i] = trend.as_ref().map_or(0.0, |trend| trend.value(&taps));
                }
            }
        });
        planes
    }
}

impl Design {
    /// Residuals of samples, given in the order of the design's positions, all of which must be in it.
    pub(in crate::encode) fn subtract(&self, model: &Model, positions: &[u32], trend: &Trend, values: &mut [f64]) {
        for (i, (value, &position)) in values.iter_mut().zip(positions).enumerate() {
            *value -= match self.stride {
                1 => trend.value(&self.taps[i * TAPS..][..TAPS]),
                _ => trend.value(&model.taps(position as usize)),
            };
        }
    }
}

impl Trend {
    fn value(&self, taps: &[(u32, f32)]) -> f64 {
        self.mean + taps.iter().map(|&(entry, weight)| f64::from(weight) * self.entries[entry as usize]).sum::<f64>()
    }
}

/// Whether sample `i` is among one of `count`: scattered, since a stride would keep to a few bins of phi_d in a full table.
pub(in crate::encode) fn one_of(i: usize, count: usize) -> bool {
    SplitMix64(i as u64).next_u64().is_multiple_of(count as u64)
}

/// Cosines of the angles between the normal and the two directions.
fn elevations(theta_h: f64, theta_d: f64, phi_d: f64) -> [f64; 2] {
    let common = theta_h.cos() * theta_d.cos();
    let apart = theta_h.sin() * theta_d.sin() * phi_d.cos();
    [common - apart, common + apart]
}

/// Solves N x = right for a symmetric positive definite N with the given diagonal, or comes as near as it gets.
fn conjugate_gradients(right: &[f64], diagonal: &[f64], mut apply: impl FnMut(&[f64], &mut [f64])) -> Vec<f64> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut x = vec![0.0; right.len()];
    let mut residual = right.to_vec();
    let mut scaled: Vec<f64> = residual.iter().zip(diagonal).map(|(r, d)| r / d).collect();
    let mut direction = scaled.clone();
    let mut image = vec![0.0; right.len()];
    let mut size = dot(&residual, &scaled);
    let enough = TOLERANCE * size;
    for _ in 0..ITERATIONS {
        if size <= enough {
            break;
        }
        apply(&direction, &mut image);
        let step = size / dot(&direction, &image);
        if !step.is_finite() {
            break;
        }
        for i in 0..x.len() {
            x[i] += step * direction[i];
            residual[i] -= step * image[i];
            scaled[i] = residual[i] / diagonal[i];
        }
        let next = dot(&residual, &scaled);
        let keep = next / size;
        size = next;
        for (d, s) in direction.iter_mut().zip(&scaled) {
            *d = s + keep * *d;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::grid::Axis;

    fn grid() -> Grid {
        let merl = Grid::merl();
        let axes: Vec<Axis> = merl.axes().iter().zip([18, 18, 36]).map(|(&axis, len)| Axis { len, ..axis }).collect();
        Grid::new(axes, merl.channels().to_vec()).unwrap()
    }

    /// What the model is for: a sum of functions of its angles is found from few samples, also where there are none.
    #[test]
    fn products_of_factors_come_back_from_few_samples() {
        let model = Model::new(&grid()).unwrap();
        let n: usize = model.shape.iter().product();
        let truth = |position: usize| {
            let (h, d, p) = (position / 648, position / 36 % 18, position % 36);
            let (h, d, p) = (model.angles[0][h], model.angles[1][d], model.angles[2][p]);
            let [i, o] = elevations(h, d, p);
            let masking = |z: f64| (z.max(0.0) + 0.05).ln();
            -8.0 * h * h + (1.0 - d.cos()).powi(3) - masking(i) - masking(o) + i.max(0.0) * o.max(0.0)
        };
        let positions: Vec<u32> = (0..n as u32).filter(|p| p % 13 == 0).collect();
        let values: Vec<f64> = positions.iter().map(|&p| truth(p as usize)).collect();
        let design = model.design(&positions);
        let trend = model.fit(&design, &values, 0.01);
        let mut residual = values.clone();
        design.subtract(&model, &positions, &trend, &mut residual);
        let planes = model.evaluate(&[None, Some(trend)]);
        assert!(planes[..n].iter().all(|v| *v == 0.0));
        for ((&p, r), value) in positions.iter().zip(&residual).zip(&values) {
            assert!((value - r - planes[n + p as usize]).abs() < 1e-9);
        }
        let rms = |f: &dyn Fn(usize) -> f64| ((0..n).map(|i| f(i).powi(2)).sum::<f64>() / n as f64).sqrt();
        let error = rms(&|i| planes[n + i] - truth(i));
        assert!(error < 0.03 * rms(&truth), "{error} of {}", rms(&truth));
    }

    #[test]
    fn conjugate_gradients_solve_a_system_known_by_hand() {
        let matrix = [[4.0, 1.0], [1.0, 3.0]];
        let x = conjugate_gradients(&[1.0, 2.0], &[4.0, 3.0], |x, y| {
            y.iter_mut().zip(&matrix).for_each(|(y, row)| *y = row[0] * x[0] + row[1] * x[1]);
        });
        assert!((x[0] - 1.0 / 11.0).abs() < 1e-9 && (x[1] - 7.0 / 11.0).abs() < 1e-9, "{x:?}");
    }

    #[test]
    fn nothing_and_constants_are_no_trouble() {
        let model = Model::new(&grid()).unwrap();
        let flat = model.fit(&model.design(&[5]), &[-3.5], 1.0);
        assert!(model.evaluate(&[Some(flat)]).iter().all(|v| (v + 3.5).abs() < 1e-12));
        let none = model.fit(&model.design(&[]), &[], 1.0);
        assert!(model.evaluate(&[Some(none)]).iter().all(|v| *v == 0.0));
    }
}
