//! The first stage: what does not depend on the quantiser step and is done once, however many trials an encode takes.

use super::full::{self, FullTable};
use super::settings::{ChannelCoding, Encoder};
use super::sparse::Estimate;
use super::sparse::quantise::Sampled;
use crate::base::error::Result;
use crate::codec::channel::ChannelTransform;
use crate::codec::sample::Sampling;
use crate::table::Table;
use crate::table::horizon::{Horizon, fit_threshold, lowest_elevation};

/// A table made ready.
pub(super) struct Prepared<'a> {
    pub(super) table: &'a Table,
    pub(super) transform: ChannelTransform,
    /// Elevation (cosine) of the table's horizon.
    pub(super) horizon: Option<f64>,
    /// Where every valid entry counts; `None` where samples are few.
    pub(super) full: Option<FullTable>,
}

impl<'a> Prepared<'a> {
    pub(super) fn new(settings: &Encoder, table: &'a Table) -> Result<Prepared<'a>> {
        let transform = choose_transform(settings, table);
        let every = settings.sampling == Sampling::Every && !settings.whole_table();
        let full = every.then(|| full::prepare(table, &transform, settings)).transpose()?;
        Ok(Prepared { table, transform, horizon: fit_horizon(table), full })
    }

    /// Blocks that are recovered from samples.
    pub(super) fn sampled<'b>(&'b self, settings: &'b Encoder, estimate: Option<&'b Estimate>) -> Sampled<'b> {
        Sampled { settings, table: self.table, transform: &self.transform, estimate }
    }
}

/// The opponent transform needs three channels that are measured at the same places.
fn choose_transform(settings: &Encoder, table: &Table) -> ChannelTransform {
    let common_mask = || (1..3).all(|c| table.valid_plane(c) == table.valid_plane(0));
    match settings.channels {
        ChannelCoding::Opponent if table.grid().channels().len() == 3 && common_mask() => ChannelTransform::opponent(),
        _ => ChannelTransform::None,
    }
}

/// Elevation of the table's horizon, if the grid has one and predicting from it is better than not.
fn fit_horizon(table: &Table) -> Option<f64> {
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
