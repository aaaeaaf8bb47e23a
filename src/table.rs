//! A measured table in memory.

pub mod block;
pub mod coords;
pub mod grid;
pub(crate) mod horizon;
pub mod parameterization;
#[cfg(feature = "encode")]
pub mod synth;

use crate::base::error::{Error, Result};
use crate::table::grid::Grid;

/// A table of reflectance: values and validity on a [`Grid`].
///
/// Layout: one plane per channel, each with the axes of the grid in order, the last axis fastest.
/// Values are in the units of the source; times the channel's `scale` they are BRDF values in 1/sr.
///
/// ```
/// use csbrdf::{Grid, Table};
///
/// let grid = Grid::merl().with_lengths(&[4, 4, 8])?;
/// let mut values = vec![0.3; 3 * 4 * 4 * 8];
/// values[5] = -1.0; // not measured
/// let table = Table::from_values(grid, values)?;
/// assert_eq!(table.valid_count(), 3 * 4 * 4 * 8 - 1);
/// # Ok::<(), csbrdf::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    grid: Grid,
    values: Vec<f64>,
    valid: Vec<bool>,
}

impl Table {
    /// A table of the given values; an entry is valid where it is finite and not negative.
    ///
    /// NaN, infinite and negative entries are how measured sets mark what could not be measured; they become
    /// missing entries, their values are kept as they are.
    ///
    /// # Errors
    /// `InvalidArgument` if the number of values is not positions times channels.
    pub fn from_values(grid: Grid, values: Vec<f64>) -> Result<Table> {
        let valid = values.iter().map(|v| v.is_finite() && *v >= 0.0).collect();
        Table::from_parts(grid, values, valid)
    }

    /// A table of values and validity, both positions times channels.
    ///
    /// # Errors
    /// `InvalidArgument` if a length is wrong or an entry marked valid is negative or not finite.
    pub fn from_parts(grid: Grid, values: Vec<f64>, valid: Vec<bool>) -> Result<Table> {
        let expected = grid.positions() * grid.channels().len();
        if values.len() != expected || valid.len() != expected {
            return Err(Error::InvalidArgument(format!(
                "the grid holds {expected} entries, got {} values and {} validity flags",
                values.len(),
                valid.len()
            )));
        }
        if let Some(i) = (0..expected).find(|&i| valid[i] && !(values[i].is_finite() && values[i] >= 0.0)) {
            return Err(Error::InvalidArgument(format!("entry {i} is marked valid but holds {}", values[i])));
        }
        Ok(Table { grid, values, valid })
    }

    /// Shape, axes and channels.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// All values in source units, invalid ones included.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Validity of all entries, laid out like the values.
    pub fn valid(&self) -> &[bool] {
        &self.valid
    }

    /// Values of one channel.
    pub fn plane(&self, channel: usize) -> &[f64] {
        let n = self.grid.positions();
        &self.values[channel * n..(channel + 1) * n]
    }

    /// Validity of one channel.
    pub fn valid_plane(&self, channel: usize) -> &[bool] {
        let n = self.grid.positions();
        &self.valid[channel * n..(channel + 1) * n]
    }

    /// Number of valid entries over all channels.
    pub fn valid_count(&self) -> usize {
        self.valid.iter().filter(|v| **v).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_inf_and_negative_entries_are_missing() {
        let mut grid = Grid::merl();
        grid = Grid::new(grid.axes()[..1].to_vec(), Grid::rgb_channels([1.0; 3])).unwrap();
        let mut values = vec![1.0; 270];
        values[..4].copy_from_slice(&[f64::NAN, f64::INFINITY, -1.0, -0.0]);
        let table = Table::from_values(grid.clone(), values.clone()).unwrap();
        assert_eq!(&table.valid()[..5], &[false, false, false, true, true]);
        assert_eq!(table.valid_count(), 267);
        assert!(Table::from_parts(grid.clone(), values.clone(), vec![true; 270]).is_err());
        values.pop();
        assert!(Table::from_values(grid, values).is_err());
    }
}
