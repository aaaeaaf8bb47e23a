//! The encoder: table in, bytes of a file out (spec section 6).

mod adapt;
mod blocks;
mod bound;
mod choose;
pub mod contract;
mod dense;
mod effort;
mod estimate;
mod fill;
mod grazing;
mod guess;
pub mod l1;
mod pack;
mod recover;
mod search;
mod shape;
mod stages;
mod tiles;
pub mod trace;
mod trellis;
mod trend;

use std::time::Instant;

use rayon::prelude::*;
use serde_json::{Value, json};

use crate::base::error::{Error, Result};
use crate::codec::channel::ChannelTransform;
use crate::codec::dependent::Quantization;
use crate::codec::fourier::Basis;
use crate::codec::sample::Sampling;
use crate::codec::tone::tone_map;
use crate::format::header::Coding;
use crate::format::metadata::Metadata;
use crate::format::{EPS_RANGE, Limits, STEP_RANGE};
use crate::table::Table;
use crate::table::block::Partition;
use blocks::{Quantized, fill_empty_means, shrink};
use bound::Bound;
use choose::fit_horizon;
use contract::Contract;
use dense::Dense;
pub use effort::Effort;
use estimate::{Estimate, Estimator, Stiffness};
pub(crate) use pack::{classify, fit_probabilities};
use recover::Solves;

/// Rms error of the quantiser in steps, about: most coefficients are zero and lose what they are.
const QUANTISER_RMS: f64 = 0.07;

/// Named sets of settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// The source paper's: DFT, 15 x 15 x 15 blocks, plain l1 recovery from 5 % of the entries.
    Paper,
    /// As few samples as the paper's, recovered as well as is known: a trend over the whole table, then weighted l1 with the
    /// DCT on windows longer than the blocks. Measured at 1 to 5 %: 3 to 29 % of the paper's error.
    Sparse,
    /// Every valid entry is a sample; DCT; one step for all.
    Archive,
}

/// Whether colour channels are coded together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// Each channel alone.
    Separate,
    /// Three channels through the opponent transform, other numbers each alone.
    Opponent,
}

/// How the grid is cut.
#[derive(Clone, Debug)]
enum Blocks {
    /// The cheapest of the candidate shapes.
    Cheapest,
    Shape(Vec<usize>),
    Partition(Partition),
}

/// Settings of an encode, then [`Encoder::encode`].
#[derive(Clone, Debug)]
pub struct Encoder {
    basis: Basis,
    blocks: Blocks,
    sampling: Sampling,
    /// Of the sampling of each block, in place of `sampling`: rms error over samples held out, log domain.
    target: Option<f64>,
    seed: u64,
    step: f32,
    rounding: f64,
    /// `None`: a tenth of the step.
    sigma: Option<f64>,
    iterations: usize,
    weighting: f64,
    trend: bool,
    profile: bool,
    effort: Effort,
    eps: f64,
    channels: Channels,
    contract: Option<Contract>,
    lossless: bool,
    spare: Option<bool>,
    metadata: Metadata,
}

/// A finished file and how it came about.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// The bytes of the file.
    pub bytes: Vec<u8>,
    /// Sizes, errors and cost.
    pub report: Report,
}

/// What an encode achieved, measured with the decoder, and what it cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Entries of all channels.
    pub entries: usize,
    /// Valid ones among them.
    pub valid: usize,
    /// Sampled ones among these.
    pub sampled: usize,
    /// Entries that were corrected, to keep a largest error.
    pub corrected: usize,
    /// The step that was asked for, or that a contract led to ([`Encoder::quality`]). With dependent quantisation the file's own is
    /// 0.65 of it.
    pub step: f32,
    /// Blocks.
    pub blocks: usize,
    /// Root mean square error of ln(f + eps) over the valid entries.
    pub log_rms: f64,
    /// Largest error of ln(f + eps) over the valid entries.
    pub log_max: f64,
    /// l1 problems solved, their iterations, and how many ended above sigma.
    pub solves: usize,
    /// Iterations of all solves.
    pub iterations: usize,
    /// Solves that ended above their sigma.
    pub missed_sigma: usize,
    /// Wall seconds of the whole encode.
    pub seconds: f64,
}

impl Report {
    /// The number of values that readers must be allowed ([`Limits::table_values`], `csbrdf --limit`) to decode the file as a whole;
    /// `None` where they allow it by default.
    pub fn needs_limit(&self) -> Option<usize> {
        (self.entries > Limits::default().table_values).then_some(self.entries)
    }
}

/// An encode but for its metadata.
struct Trial {
    packed: pack::Packed,
    partition: Partition,
    /// Of the table, to name block shapes by.
    axes: usize,
    report: Report,
}

impl Default for Encoder {
    fn default() -> Self {
        Encoder::new()
    }
}

impl Encoder {
    /// An encoder with the settings of [`Preset::Archive`].
    pub fn new() -> Encoder {
        Encoder {
            basis: Basis::Dct,
            blocks: Blocks::Cheapest,
            sampling: Sampling::Every,
            target: None,
            seed: 0,
            step: 0.1,
            rounding: 0.4,
            sigma: None,
            iterations: 200,
            weighting: 1.0,
            trend: false,
            profile: true,
            effort: Effort::Standard,
            eps: 1e-3,
            channels: Channels::Opponent,
            contract: None,
            lossless: false,
            spare: None,
            metadata: Metadata::default(),
        }
    }

    /// All settings but seed, metadata, [`Encoder::lossless`] and [`Encoder::spare`] from a preset.
    pub fn preset(self, preset: Preset) -> Encoder {
        let base = Encoder {
            seed: self.seed,
            metadata: self.metadata,
            lossless: self.lossless,
            spare: self.spare,
            ..Encoder::new()
        };
        match preset {
            Preset::Archive => base,
            Preset::Paper => Encoder {
                basis: Basis::Dft,
                blocks: Blocks::Shape(vec![15, 15, 15]),
                sampling: Sampling::from_ratio(0.05).expect("within the range"),
                sigma: Some(1e-3),
                iterations: 300,
                weighting: 0.0,
                channels: Channels::Separate,
                ..base
            },
            Preset::Sparse => Encoder {
                blocks: Blocks::Shape(vec![15, 15, 15]),
                sampling: Sampling::from_ratio(0.05).expect("within the range"),
                sigma: Some(0.005),
                trend: true,
                ..base
            },
        }
    }

    /// Basis of the coefficients.
    pub fn basis(self, basis: Basis) -> Encoder {
        Encoder { basis, ..self }
    }

    /// Block length along each axis of the table, slowest first; clipped to the grid. A shape with fewer entries
    /// than the table has axes is padded in front with ones. Without a call several shapes are tried.
    pub fn block_shape(self, shape: &[usize]) -> Encoder {
        Encoder { blocks: Blocks::Shape(shape.to_vec()), ..self }
    }

    /// Tiles and block shapes of the caller's choice; the partition must be of the table's grid.
    pub fn partition(self, partition: Partition) -> Encoder {
        Encoder { blocks: Blocks::Partition(partition), ..self }
    }

    /// Share of the entries to sample.
    pub fn sampling(self, sampling: Sampling) -> Encoder {
        Encoder { sampling, target: None, ..self }
    }

    /// Samples each block until the recovery tells samples that it has not seen with an rms error of at most this, log
    /// domain; the ratio starts at 1/128 and is doubled as often as needed, at least once: what was held out counts.
    /// Includes [`Encoder::trend`].
    pub fn sampling_for(self, rms: f64) -> Encoder {
        Encoder { target: Some(rms), ..self }
    }

    /// Seed of the sampling.
    pub fn seed(self, seed: u64) -> Encoder {
        Encoder { seed, ..self }
    }

    /// Quantiser step in the log domain: smaller is better and larger. The rms error of a noiseless table comes to
    /// about a tenth of it. Where every entry is a sample, quantisation is dependent, and the file's step is 0.65 of this:
    /// every other multiple of it is allowed, at about the same error.
    pub fn quality(self, step: f32) -> Encoder {
        Encoder { step, ..self }
    }

    /// Magnitudes are rounded up from this fraction of a step, 0 to 0.5; where every entry is a sample, in trials only: there
    /// squared error and bits decide.
    pub fn rounding(self, rounding: f64) -> Encoder {
        Encoder { rounding, ..self }
    }

    /// Constant of the tone map ln(f + eps), 1/sr; below it values lose relative precision.
    pub fn eps(self, eps: f64) -> Encoder {
        Encoder { eps, ..self }
    }

    /// Rms residual that the l1 recovery may leave at the samples, log domain; a tenth of the step if not set. Without effect where
    /// every entry is a sample.
    pub fn sigma(self, sigma: f64) -> Encoder {
        Encoder { sigma: Some(sigma), ..self }
    }

    /// Exponent p of the weights (1 + |k|)^p on the coefficients in the l1 norm of the recovery from samples, k in half periods a
    /// block; 0 is the plain norm, at most 4.
    pub fn weighting(self, weighting: f64) -> Encoder {
        Encoder { weighting, ..self }
    }

    /// Whether a smooth model of the whole table is fitted to the samples first, and the l1 recovery, then on windows
    /// that do not depend on the blocks, left with what the model does not tell. For samples that are few; needs a grid
    /// of half and difference angles and has no effect on others but for the windows.
    pub fn trend(self, trend: bool) -> Encoder {
        Encoder { trend, ..self }
    }

    /// Whether the steep course near the horizon of either direction is taken out by a grazing profile (spec section
    /// 4.10), where every entry is a sample and the grid is one of half and difference angles.
    pub fn profile(self, profile: bool) -> Encoder {
        Encoder { profile, ..self }
    }

    /// How long an encode of all valid entries may take for fewer bytes.
    pub fn effort(self, effort: Effort) -> Encoder {
        Encoder { effort, ..self }
    }

    /// Most iterations of one l1 solve.
    pub fn iterations(self, iterations: usize) -> Encoder {
        Encoder { iterations, ..self }
    }

    /// Whether colour channels are coded together.
    pub fn channels(self, channels: Channels) -> Encoder {
        Encoder { channels, ..self }
    }

    /// What the file must keep: the step is then searched for, in up to some six encodes, and [`Encoder::quality`] is
    /// where the search begins at most. Errors count at all valid entries, sampled or not.
    pub fn contract(self, contract: Contract) -> Encoder {
        Encoder { contract: Some(contract), ..self }
    }

    /// Whether the file also restores every bit of the table, missing entries included: [`crate::decode::Reader::exact_table`].
    /// Readers that do not know how still read the rest. Not with a contract on the size.
    pub fn lossless(self, lossless: bool) -> Encoder {
        Encoder { lossless, ..self }
    }

    /// Whether the file also holds a spare copy of all that blocks cannot be decoded without, for [`crate::edit::salvage`]: some 2 to 4 kB.
    /// If not told, lossless files do.
    pub fn spare(self, spare: bool) -> Encoder {
        Encoder { spare: Some(spare), ..self }
    }

    /// Provenance to store; the encoder adds its settings and what it achieved.
    pub fn metadata(self, metadata: Metadata) -> Encoder {
        Encoder { metadata, ..self }
    }

    fn check(&self) -> Result<()> {
        let bad = |what: String| Err(Error::InvalidArgument(what));
        if !STEP_RANGE.contains(&self.step) {
            return bad(format!("quality (the quantiser step) is {}, must be within {STEP_RANGE:?}", self.step));
        }
        if !EPS_RANGE.contains(&self.eps) {
            return bad(format!("eps is {}, must be within {EPS_RANGE:?}", self.eps));
        }
        if self.sampling == (Sampling::Bernoulli { threshold: 0 }) {
            return bad("a sampling ratio of zero leaves nothing to recover from".into());
        }
        if self.target.is_some_and(|target| !(target.is_finite() && target > 0.0)) {
            return bad("the rms error to sample for must be finite and above 0".into());
        }
        let quantiser = QUANTISER_RMS * self.step_as_written();
        if let Some(target) = self.target.filter(|target| *target <= quantiser) {
            return bad(format!(
                "no sampling makes the rms error {target}, quantising alone makes about {quantiser:.2e}; \
                 give a quality (quantiser step) below {:.2e}, better half of that",
                target / QUANTISER_RMS
            ));
        }
        if !(0.0..=0.5).contains(&self.rounding) {
            return bad(format!("rounding is {}, must be within 0 to 0.5", self.rounding));
        }
        if !(0.0..=4.0).contains(&self.weighting) {
            return bad(format!("weighting is {}, must be within 0 to 4", self.weighting));
        }
        if self.sigma.is_some_and(|sigma| !(sigma.is_finite() && sigma >= 0.0)) {
            return bad("sigma must be finite and not negative".into());
        }
        if self.lossless && matches!(self.contract, Some(Contract::Size(_) | Contract::Ratio(_))) {
            return bad("a lossless file is as large as the table makes it; leave the contract on its size out".into());
        }
        self.contract.map_or(Ok(()), Contract::check)
    }

    /// Encodes a table. The same table, settings and seed give the same bytes, whatever the number of threads. (On
    /// another kind of machine the transforms may round differently; what a file decodes to is the same everywhere.)
    ///
    /// Missing entries are filled by the same recovery and stay marked as missing.
    ///
    /// # Errors
    /// `InvalidArgument` if a setting is out of range or no entry is valid; `ContractNotMet` if the contract cannot be
    /// kept, with the best that was reached.
    pub fn encode(&self, table: &Table) -> Result<Encoded> {
        self.encode_with(table, &|_| {})
    }

    /// As [`Encoder::encode`]; `progress` is called with the share of the work done, 0 to 1, from any thread.
    pub fn encode_with(&self, table: &Table, progress: &(dyn Fn(f64) + Sync)) -> Result<Encoded> {
        let start = Instant::now();
        self.check()?;
        if !table.valid().contains(&true) {
            return Err(Error::InvalidArgument(
                "the table has no valid entry: all are negative, NaN or infinite; nothing to encode".into(),
            ));
        }
        let mut encoded = match self.contract {
            Some(contract) => contract::fulfil(self, contract, table, progress)?,
            None => {
                let dense = self.dense(table, &self.choose_transform(table))?;
                let trial = self.trial(table, dense.as_ref(), progress)?;
                Encoded { bytes: self.finish(&trial, None)?, report: trial.report }
            }
        };
        encoded.report.seconds = start.elapsed().as_secs_f64();
        Ok(encoded)
    }

    /// The table made ready for blocks, if every valid entry counts: with a grazing profile where that costs less.
    fn dense(&self, table: &Table, transform: &ChannelTransform) -> Result<Option<Dense>> {
        if self.sampling != Sampling::Every || self.whole_table() {
            return Ok(None);
        }
        let grid = table.grid();
        let plain = Dense::new(table, self.eps, self.basis);
        let fitted = self.profile && self.basis == Basis::Dct;
        let guesses = plain.guesses();
        let steep = fitted.then(|| plain.with_profile(grid, transform, self)).flatten();
        let (plain, steep) = rayon::join(|| plain.filled(&guesses), || steep.map(|steep| steep.filled(&guesses)));
        let Some(steep) = steep else { return Ok(Some(plain)) };
        drop(guesses);
        let pays = self.profile_pays(&plain, &steep, transform, grid)?;
        Ok(Some(if pays { steep } else { plain }))
    }

    /// One encode at the encoder's step; `dense` is the table made ready for it, if that is to be.
    fn trial(&self, table: &Table, dense: Option<&Dense>, progress: &(dyn Fn(f64) + Sync)) -> Result<Trial> {
        let transform = self.choose_transform(table);
        let (partition, share) = self.choose_partition(table, &transform, dense, progress)?;
        self.encode_partition(table, transform, dense, partition, &|done| progress(share + (1.0 - share) * done))
    }

    /// The bytes of a trial's file, with what it says of its contract.
    fn finish(&self, trial: &Trial, contract: Option<Value>) -> Result<Vec<u8>> {
        let spare = self.spare.unwrap_or(self.lossless);
        Ok(trial.packed.finish(&self.describe(trial, contract)?.write()?, spare))
    }

    /// The table recovered as a whole, if that is what the settings ask for.
    fn estimate(
        &self,
        table: &Table,
        transform: &ChannelTransform,
        partition: &Partition,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Option<Estimate> {
        if !self.whole_table() {
            return None;
        }
        let planes = estimate::log_planes(table, transform, self.eps);
        let recovery = self.recovery(self.iterations);
        let mut estimator = Estimator::new(table, &planes, partition, self.seed, recovery);
        let doublings = match self.target {
            Some(target) => {
                // The quantiser adds an error of its own.
                let quantiser = QUANTISER_RMS * self.step_as_written();
                let target = (target.powi(2) - quantiser.powi(2)).max(0.0).sqrt().max(target / 2.0);
                adapt::doublings(&mut estimator, target, &|done| progress(0.7 * done))
            }
            None => vec![0; partition.block_count()],
        };
        let sampling: Vec<Sampling> = doublings.iter().map(|&d| self.base_sampling().doubled(d)).collect();
        estimator.draw(&sampling);
        estimator.fit(Stiffness::HeldOut);
        progress(0.85);
        Some(estimator.finish(doublings, &|done| progress(0.85 + 0.15 * done)))
    }

    /// Whether trend and windows come before the blocks.
    fn whole_table(&self) -> bool {
        self.trend || self.target.is_some()
    }

    /// The sampling that the file states; blocks may double it.
    fn base_sampling(&self) -> Sampling {
        if self.target.is_some() { adapt::START } else { self.sampling }
    }

    /// The encode once the partition is known.
    fn encode_partition(
        &self,
        table: &Table,
        transform: ChannelTransform,
        dense: Option<&Dense>,
        partition: Partition,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Trial> {
        let estimate = self.estimate(table, &transform, &partition, &|done| progress(0.8 * done));
        let share = if estimate.is_some() { 0.8 } else { 0.0 };
        let recover = |done| progress(share + (0.9 - share) * done);
        let mut blocks: Vec<Quantized> = match dense {
            Some(dense) => self.quantize_dense_blocks(dense, &transform, &partition, &recover)?,
            None => self
                .quantize_blocks(table, &transform, &partition, estimate.as_ref(), self.iterations, &recover)
                .collect::<Result<_>>()?,
        };
        fill_empty_means(&mut blocks, table.grid().channels().len());
        let (quantization, step) = match dense {
            Some(_) => (Quantization::Dependent, trellis::STEP * self.step),
            None => (Quantization::Scalar, self.step),
        };
        let coding = Coding {
            basis: self.basis,
            quantization,
            eps: self.eps,
            sampling: self.base_sampling(),
            seed: self.seed,
            transform,
            steps: vec![step; table.grid().channels().len()],
            shrink: shrink(&blocks),
            horizon: fit_horizon(table),
            zeros: dense.is_some_and(|dense| dense.zeros),
            correction: None,
        };
        let bound = self.bound(table)?;
        let profile = dense.and_then(|dense| dense.profile.clone());
        let packed = pack::pack(table, coding, partition.clone(), profile, &blocks, bound, self.lossless)?;
        let mut cost = estimate.map_or(Solves::default(), |estimate| estimate.cost);
        blocks.iter().for_each(|block| cost += block.cost);
        let report = Report {
            entries: table.values().len(),
            valid: table.valid_count(),
            sampled: if dense.is_some() { table.valid_count() } else { blocks.iter().map(|b| b.sampled).sum() },
            corrected: packed.corrected,
            step: self.step,
            blocks: blocks.len(),
            log_rms: packed.log_rms,
            log_max: packed.log_max,
            solves: cost.solves,
            iterations: cost.iterations,
            missed_sigma: cost.missed,
            seconds: 0.0,
        };
        progress(1.0);
        Ok(Trial { packed, partition, axes: table.grid().axes().len(), report })
    }

    /// The largest error to keep by corrections, if that is the contract.
    fn bound(&self, table: &Table) -> Result<Option<Bound>> {
        let Some(Contract::MaxError(max_error)) = self.contract else { return Ok(None) };
        let n = table.grid().positions();
        let valid = table.values().iter().zip(table.valid()).enumerate().filter(|(_, (_, valid))| **valid);
        let scaled = valid.map(|(i, (value, _))| (value * table.grid().channels()[i / n].scale).min(f64::MAX));
        let (least, most) = scaled.fold((f64::INFINITY, 0f64), |(least, most), f| (least.min(f), most.max(f)));
        let largest = [least, most].map(|f| tone_map(f, self.eps).abs()).into_iter().fold(0.0, f64::max);
        Bound::new(max_error, largest + max_error).map(Some)
    }

    /// The caller's metadata with the encoder's settings and results.
    fn describe(&self, trial: &Trial, contract: Option<Value>) -> Result<Metadata> {
        let report = &trial.report;
        let shapes: Vec<&[usize]> = trial.partition.shapes().iter().map(|s| &s[4 - trial.axes..]).collect();
        let tool = concat!("csbrdf ", env!("CARGO_PKG_VERSION"));
        let mut encoder = json!({
            "basis": self.basis.as_str(),
            "block_shapes": shapes,
            "sampling": self.base_sampling().ratio(),
            "quality": self.step_as_written(),
            "valid": report.valid,
            "sampled": report.sampled,
            "log_rms": report.log_rms,
            "log_max": report.log_max,
        });
        // What a recovery from samples depends on.
        if self.sampling != Sampling::Every || self.whole_table() {
            encoder["sampled_for"] = self.target.into();
            encoder["rounding"] = self.rounding.into();
            encoder["sigma"] = self.sigma_rms().into();
            encoder["weighting"] = self.weighting.into();
            encoder["trend"] = self.whole_table().into();
        }
        if self.lossless {
            encoder["lossless"] = true.into();
        }
        if let Some(contract) = contract {
            encoder["contract"] = contract;
            encoder["corrected"] = report.corrected.into();
        }
        Ok(Metadata { tool: Some(tool.into()), encoder: Some(encoder), ..self.metadata.clone() })
    }

    /// The step as the caller wrote it, not as the nearest double of a single.
    fn step_as_written(&self) -> f64 {
        self.step.to_string().parse().unwrap_or(self.step.into())
    }

    fn sigma_rms(&self) -> f64 {
        // Samples told no better than the target would not let the rest be told so.
        let most = self.target.map_or(f64::INFINITY, |target| target / 3.0);
        self.sigma.unwrap_or((self.step_as_written() / 10.0).min(most))
    }
}

#[cfg(test)]
mod tests;
