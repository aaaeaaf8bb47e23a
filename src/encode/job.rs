//! One encode at one quantiser step: the stages in their order.

use rayon::iter::ParallelIterator;

use super::bound::Bound;
use super::code::{self, Packed};
use super::contract::Contract;
use super::full::trellis;
use super::prepare::Prepared;
use super::progress::Progress;
use super::quantised::{Quantized, Solves, fill_empty_means, shrink};
use super::report::Report;
use super::settings::{Blocks, Encoder};
use super::sparse::{self, Estimate};
use crate::base::error::Result;
use crate::codec::dependent::Quantization;
use crate::codec::tone::tone_map;
use crate::format::header::Coding;
use crate::table::block::Partition;

/// What the choice of a partition takes of a job, where there is a choice.
const CHOICE: f64 = 0.5;

/// Settings and the table that they are for.
pub(super) struct Job<'a> {
    pub(super) settings: Encoder,
    pub(super) prepared: &'a Prepared<'a>,
}

/// A finished encode but for its metadata.
pub(super) struct Trial {
    pub(super) packed: Packed,
    pub(super) partition: Partition,
    /// Axes of the table, to name block shapes by.
    pub(super) axes: usize,
    pub(super) report: Report,
}

impl Job<'_> {
    /// Partition, fit, quantise, code.
    pub(super) fn run(&self, progress: Progress) -> Result<Trial> {
        let choice = if matches!(self.settings.blocks, Blocks::Cheapest) { CHOICE } else { 0.0 };
        let partition = self.prepared.choose_partition(&self.settings, progress.part(0.0, choice))?;
        let progress = progress.part(choice, 1.0);
        let estimate = self.fit(&partition, progress.part(0.0, 0.8));
        let share = if estimate.is_some() { 0.8 } else { 0.0 };
        let mut blocks = self.quantise(&partition, estimate.as_ref(), progress.part(share, 0.9))?;
        let trial = self.code(partition, &mut blocks, estimate.as_ref())?;
        progress.reach(1.0);
        Ok(trial)
    }

    /// The table recovered as a whole, if that is what the settings ask for.
    fn fit(&self, partition: &Partition, progress: Progress) -> Option<Estimate> {
        let Prepared { table, transform, .. } = self.prepared;
        self.settings.whole_table().then(|| sparse::recover_table(&self.settings, table, transform, partition, progress))
    }

    /// The quantised coefficients of all blocks, in their order.
    fn quantise(
        &self,
        partition: &Partition,
        estimate: Option<&Estimate>,
        progress: Progress,
    ) -> Result<Vec<Quantized>> {
        match &self.prepared.full {
            Some(full) => full.quantize_blocks(&self.settings, partition, progress),
            None => self.prepared.sampled(&self.settings, estimate).quantize_blocks(partition, self.settings.iterations, progress).collect(),
        }
    }

    /// The records and sections of the file, checked with the decoder, and what came of it.
    fn code(&self, partition: Partition, blocks: &mut [Quantized], estimate: Option<&Estimate>) -> Result<Trial> {
        let (table, full) = (self.prepared.table, self.prepared.full.as_ref());
        fill_empty_means(blocks, table.grid().channels().len());
        let coding = self.coding(blocks);
        let profile = full.and_then(|full| full.profile.clone());
        let lossless = self.settings.lossless;
        let packed = code::pack(table, coding, partition.clone(), profile, blocks, self.bound()?, lossless)?;
        let mut cost = estimate.map_or(Solves::default(), |estimate| estimate.cost);
        blocks.iter().for_each(|block| cost += block.cost);
        let report = Report {
            entries: table.values().len(),
            valid: table.valid_count(),
            sampled: if full.is_some() { table.valid_count() } else { blocks.iter().map(|b| b.sampled).sum() },
            corrected: packed.corrected,
            step: self.settings.step,
            blocks: blocks.len(),
            log_rms: packed.log_rms,
            log_max: packed.log_max,
            solves: cost.solves,
            iterations: cost.iterations,
            missed_sigma: cost.missed,
            seconds: 0.0,
        };
        Ok(Trial { packed, partition, axes: table.grid().axes().len(), report })
    }

    /// What all blocks share, for the file's head.
    fn coding(&self, blocks: &[Quantized]) -> Coding {
        let (settings, prepared) = (&self.settings, self.prepared);
        let (quantization, step) = match prepared.full {
            Some(_) => (Quantization::Dependent, trellis::STEP * settings.step),
            None => (Quantization::Scalar, settings.step),
        };
        Coding {
            basis: settings.basis,
            quantization,
            eps: settings.eps,
            sampling: settings.base_sampling(),
            seed: settings.seed,
            transform: prepared.transform.clone(),
            steps: vec![step; prepared.table.grid().channels().len()],
            shrink: shrink(blocks),
            horizon: prepared.horizon,
            zeros: prepared.full.as_ref().is_some_and(|full| full.zeros),
            correction: None,
        }
    }

    /// The largest error to keep by corrections, if that is the contract.
    fn bound(&self) -> Result<Option<Bound>> {
        let table = self.prepared.table;
        let Some(Contract::MaxError(max_error)) = self.settings.contract else { return Ok(None) };
        let n = table.grid().positions();
        let valid = table.values().iter().zip(table.valid()).enumerate().filter(|(_, (_, valid))| **valid);
        let scaled = valid.map(|(i, (value, _))| (value * table.grid().channels()[i / n].scale).min(f64::MAX));
        let (least, most) = scaled.fold((f64::INFINITY, 0f64), |(least, most), f| (least.min(f), most.max(f)));
        let largest = [least, most].map(|f| tone_map(f, self.settings.eps).abs()).into_iter().fold(0.0, f64::max);
        Bound::new(max_error, largest + max_error).map(Some)
    }
}
