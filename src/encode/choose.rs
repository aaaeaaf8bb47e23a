//! What the encoder settles before it begins: channel transform, partition, horizon.

use super::dense::Dense;
use super::{Blocks, Channels, Encoder, shape};
use crate::base::error::{Error, Result};
use crate::codec::channel::ChannelTransform;
use crate::format::check_block;
use crate::table::BrdfTable;
use crate::table::block::Partition;
use crate::table::horizon::{Horizon, fit_threshold, lowest_elevation};

impl Encoder {
    /// The opponent transform needs three channels that are measured at the same places.
    pub(super) fn choose_transform(&self, table: &BrdfTable) -> ChannelTransform {
        let common_mask = || (1..3).all(|c| table.valid_plane(c) == table.valid_plane(0));
        match self.channels {
            Channels::Opponent if table.grid().channels().len() == 3 && common_mask() => ChannelTransform::opponent(),
            _ => ChannelTransform::None,
        }
    }

    /// The partition to use, and the share of the work that went into its choice.
    pub(super) fn choose_partition(
        &self,
        table: &BrdfTable,
        transform: &ChannelTransform,
        dense: Option<&Dense>,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<(Partition, f64)> {
        let grid = table.grid().shape();
        let channels = table.grid().channels().len();
        let fits = |partition: &Partition| partition.shapes().iter().try_for_each(|&s| check_block(s, channels));
        let checked = |partition: Partition| match fits(&partition) {
            Ok(()) => Ok((partition, 0.0)),
            Err(what) => Err(Error::InvalidArgument(what)),
        };
        match &self.blocks {
            Blocks::Cheapest => {}
            Blocks::Shape(shape) => return checked(uniform(grid, shape)?),
            Blocks::Partition(partition) if partition.grid() == grid => return checked(partition.clone()),
            Blocks::Partition(partition) => {
                let other = partition.grid();
                return Err(Error::InvalidArgument(format!(
                    "a partition of the grid {other:?}, the table has {grid:?}"
                )));
            }
        }
        const TRIALS: f64 = 0.5;
        if let Some(dense) = dense {
            let tiles = self.choose_tiles(dense, transform, table.grid(), &|done| progress(TRIALS * done))?;
            return Ok((tiles, TRIALS));
        }
        let candidates = shape::candidates(table.grid().axes().len());
        let mut partitions = candidates.iter().map(|s| uniform(grid, s)).collect::<Result<Vec<_>>>()?;
        partitions.retain(|partition| fits(partition).is_ok());
        if partitions.is_empty() {
            return Err(Error::InvalidArgument(format!(
                "with {channels} channels no usual block shape is within the format's limits; give a smaller one"
            )));
        }
        let mut best = 0;
        let mut least = f64::INFINITY;
        for (i, partition) in partitions.iter().enumerate() {
            let share = |done| progress(TRIALS * (i as f64 + done) / partitions.len() as f64);
            let iterations = shape::ITERATIONS.min(self.iterations);
            let blocks = self.quantize_blocks(table, transform, partition, None, iterations, &share);
            let cost = shape::trial(partition, blocks, f64::from(self.step))?;
            if cost < least {
                (best, least) = (i, cost);
            }
        }
        Ok((partitions.into_iter().nth(best).expect("one of them"), TRIALS))
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

/// Elevation of the table's horizon, if the grid has one and predicting from it is better than not.
pub(super) fn fit_horizon(table: &BrdfTable) -> Option<f64> {
    let horizon = Horizon::new(table.grid())?;
    let n = table.grid().positions();
    let mut any = table.valid_plane(0).to_vec();
    for plane in table.valid().chunks_exact(n).skip(1) {
        any.iter_mut().zip(plane).for_each(|(any, valid)| *any |= valid);
    }
    let invalid = any.iter().filter(|v| !**v).count();
    let (threshold, wrong) = fit_threshold(&horizon, table.grid().shape(), &any);
    if 2 * wrong > any.len() - invalid {
        return lowest_elevation(&horizon, table.grid().shape(), &any).filter(|threshold| threshold.abs() <= 1.0);
    }
    // Rounding can put an elevation just above 1.
    (wrong < invalid && threshold.abs() <= 1.0).then_some(threshold)
}
