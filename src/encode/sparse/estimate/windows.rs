//! The boxes that are recovered one by one.

use crate::encode::quantised::Solves;
use crate::encode::sparse::recover::Recoverer;
use crate::table::block::{Block, positions, unravel};

/// Boxes that cover a grid, all of one shape; the last along an axis may overlap the one before.
pub(super) struct Windows {
    grid: [usize; 4],
    shape: [usize; 4],
    per_axis: [usize; 4],
}

impl Windows {
    pub(super) fn new(grid: [usize; 4]) -> Windows {
        let used = grid.iter().filter(|n| **n > 1).count();
        let lengths: [usize; 4] = match used {
            0 | 1 => [1, 1, 1, 240],
            2 => [1, 1, 60, 60],
            3 => [1, 15, 15, 60],
            _ => [6, 10, 10, 20],
        };
        // The lengths are of the axes that have one.
        let mut next = 4 - used;
        let shape = grid.map(|n| {
            let length = if n > 1 { lengths[next] } else { 1 };
            next += usize::from(n > 1);
            length.min(n)
        });
        Windows { grid, shape, per_axis: std::array::from_fn(|a| grid[a].div_ceil(shape[a])) }
    }

    /// Positions of the grid.
    pub(super) fn positions(&self) -> usize {
        self.grid.iter().product()
    }

    pub(super) fn count(&self) -> usize {
        self.per_axis.iter().product()
    }

    /// The window as a block of the grid, and how much of its start the ones before it cover already.
    fn place(&self, window: usize) -> (Block, [usize; 4]) {
        let at = unravel(window, self.per_axis);
        let wanted: [usize; 4] = std::array::from_fn(|a| at[a] * self.shape[a]);
        let origin: [usize; 4] = std::array::from_fn(|a| wanted[a].min(self.grid[a] - self.shape[a]));
        (Block { origin, shape: self.shape }, std::array::from_fn(|a| wanted[a] - origin[a]))
    }

    /// The values of a window from the samples in `plane`, which is NaN elsewhere.
    pub(super) fn solve(&self, recoverer: &mut Recoverer, window: usize, plane: &[f64]) -> (Vec<f64>, Solves) {
        let (block, _) = self.place(window);
        let mut cost = Solves::default();
        let mut values = vec![0.0; block.positions()];
        block.gather(self.grid, plane, &mut values);
        let (positions, samples): (Vec<u32>, Vec<f64>) =
            (0u32..).zip(values).filter(|(_, value)| !value.is_nan()).unzip();
        if samples.len() == block.positions() {
            // Nothing to recover.
            return (samples, cost);
        }
        (recoverer.fill(self.shape, &positions, &samples, &mut cost), cost)
    }

    /// Adds a window's values to the plane where no window before it covers it.
    pub(super) fn add(&self, window: usize, values: &[f64], plane: &mut [f64]) {
        let (block, skip) = self.place(window);
        let mut present = vec![0.0; values.len()];
        block.gather(self.grid, plane, &mut present);
        for ((at, value), present) in positions(self.shape).zip(values).zip(&mut present) {
            if (0..4).all(|a| at[a] >= skip[a]) {
                *present += value;
            }
        }
        block.scatter(self.grid, &present, plane);
    }

    /// Whether two sets of samples differ within a window.
    pub(super) fn differs(&self, window: usize, one: &[bool], other: &[bool]) -> bool {
        let (block, _) = self.place(window);
        let [one, other] = [one, other].map(|flags| {
            let mut mask = vec![false; block.positions()];
            block.gather(self.grid, flags, &mut mask);
            mask
        });
        one != other
    }

    /// Squared error of a window's values at the entries of `truth` that are not NaN.
    pub(super) fn squared_error(&self, window: usize, values: &[f64], truth: &[f64]) -> f64 {
        let (block, _) = self.place(window);
        let mut wanted = vec![0.0; values.len()];
        block.gather(self.grid, truth, &mut wanted);
        values.iter().zip(&wanted).filter(|(_, w)| !w.is_nan()).map(|(v, w)| (v - w).powi(2)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_position_is_added_to_once() {
        for grid in [[1, 90, 90, 180], [1, 20, 16, 61], [1, 1, 1, 7], [1, 1, 70, 9], [7, 11, 10, 23]] {
            let windows = Windows::new(grid);
            let mut plane = vec![0.0; windows.positions()];
            let ones = vec![1.0; windows.shape.iter().product()];
            (0..windows.count()).for_each(|window| windows.add(window, &ones, &mut plane));
            assert!(plane.iter().all(|v| *v == 1.0), "{grid:?}");
        }
    }
}
