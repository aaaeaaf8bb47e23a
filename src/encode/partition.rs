//! The second stage: how the grid is cut into blocks.

use super::full::tiles;
use super::prepare::Prepared;
use super::progress::Progress;
use super::settings::{Blocks, Encoder};
use super::sparse::shape;
use crate::base::error::{Error, Result};
use crate::base::limits::check_block;
use crate::table::block::Partition;

impl Prepared<'_> {
    /// The partition that the caller gave, or the cheapest.
    pub(super) fn choose_partition(&self, settings: &Encoder, progress: Progress) -> Result<Partition> {
        let grid = self.table.grid();
        match &settings.blocks {
            Blocks::Cheapest => match &self.full {
                Some(full) => tiles::choose(settings, full, grid, progress),
                None => self.cheapest_shape(settings, progress),
            },
            Blocks::Shape(shape) => self.checked(uniform(grid.shape(), shape)?),
            Blocks::Partition(partition) if partition.grid() == grid.shape() => self.checked(partition.clone()),
            Blocks::Partition(partition) => Err(Error::InvalidArgument(format!(
                "a partition of the grid {:?}, the table has {:?}",
                partition.grid(),
                grid.shape()
            ))),
        }
    }

    /// Whether the blocks are within the format's limits.
    fn fits(&self, partition: &Partition) -> std::result::Result<(), String> {
        let channels = self.table.grid().channels().len();
        partition.shapes().iter().try_for_each(|&shape| check_block(shape, channels))
    }

    fn checked(&self, partition: Partition) -> Result<Partition> {
        self.fits(&partition).map_err(Error::InvalidArgument)?;
        Ok(partition)
    }

    /// The cheapest of a few shapes for a table that is sampled, by short solves of all of it.
    fn cheapest_shape(&self, settings: &Encoder, progress: Progress) -> Result<Partition> {
        let grid = self.table.grid();
        let candidates = shape::candidates(grid.axes().len());
        let mut partitions =
            candidates.iter().map(|s| uniform(grid.shape(), s)).collect::<Result<Vec<_>>>()?;
        partitions.retain(|partition| self.fits(partition).is_ok());
        let (mut best, mut least) = (None, f64::INFINITY);
        for (i, partition) in partitions.iter().enumerate() {
            let iterations = shape::ITERATIONS.min(settings.iterations);
            let blocks =
                self.sampled(settings, None).quantize_blocks(partition, iterations, progress.step(i, partitions.len()));
            let cost = shape::trial(partition, blocks, f64::from(settings.step))?;
            if cost < least || best.is_none() {
                (best, least) = (Some(i), cost);
            }
        }
        match best {
            Some(best) => Ok(partitions.swap_remove(best)),
            None => Err(Error::InvalidArgument(format!(
                "with {} channels no usual block shape is within the format's limits; give a smaller one",
                grid.channels().len()
            ))),
        }
    }
}

/// Blocks of one shape, padded in front with ones and clipped to the grid.
fn uniform(grid: [usize; 4], shape: &[usize]) -> Result<Partition> {
    if shape.is_empty() || shape.len() > 4 {
        return Err(Error::InvalidArgument(format!("a block shape has 1 to 4 lengths, not {}", shape.len())));
    }
    let mut padded = [1; 4];
    padded[4 - shape.len()..].copy_from_slice(shape);
    Partition::uniform(grid, padded)
}
