//! Where samples are few: a trend over the whole table and windows of it, or blocks by themselves, recovered by l1 minimisation.

mod adapt;
mod estimate;
pub(super) mod quantise;
pub(super) mod recover;
pub(super) mod shape;
pub mod watch;
mod trend;

use super::progress::Progress;
use super::settings::{Encoder, QUANTISER_RMS};
use crate::codec::channel::ChannelTransform;
use crate::codec::sample::Sampling;
use crate::table::Table;
use crate::table::block::Partition;
pub(super) use estimate::Estimate;
use estimate::{Estimator, Stiffness};
use recover::Recovery;

/// The table recovered as a whole by trend and windows.
pub(super) fn recover_table(
    settings: &Encoder,
    table: &Table,
    transform: &ChannelTransform,
    partition: &Partition,
    progress: Progress,
) -> Estimate {
    let planes = estimate::log_planes(table, transform, settings.eps);
    let recovery = Recovery::new(settings, settings.iterations);
    let mut estimator = Estimator::new(table, &planes, partition, settings.seed, recovery);
    let doublings = match settings.target {
        Some(target) => {
            // The quantiser adds an error of its own.
            let quantiser = QUANTISER_RMS * settings.step_as_written();
            let target = (target.powi(2) - quantiser.powi(2)).max(0.0).sqrt().max(target / 2.0);
            adapt::doublings(&mut estimator, target, progress.part(0.0, 0.7))
        }
        None => vec![0; partition.block_count()],
    };
    let sampling: Vec<Sampling> = doublings.iter().map(|&d| settings.base_sampling().doubled(d)).collect();
    estimator.draw(&sampling);
    estimator.fit(Stiffness::HeldOut);
    progress.reach(0.85);
    estimator.finish(doublings, progress.part(0.85, 1.0))
}
