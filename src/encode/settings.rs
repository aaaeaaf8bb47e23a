//! What a caller sets before an encode, and what follows from settings alone.

use super::contract::Contract;
use super::effort::Effort;
use crate::base::error::{Error, Result};
use crate::codec::fourier::Basis;
use crate::codec::sample::Sampling;
use crate::format::metadata::Metadata;
use crate::base::limits::{EPS_RANGE, STEP_RANGE};
use crate::table::block::Partition;

/// Rms error of the quantiser in steps, about: most coefficients are zero and lose what they are.
pub(super) const QUANTISER_RMS: f64 = 0.07;

/// The ratio that every block starts with where samples are drawn as needed; seven doublings on every entry is a sample.
pub(super) const ADAPTIVE_START: Sampling = Sampling::Bernoulli { threshold: 1 << 25 };

/// Named sets of settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
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
#[non_exhaustive]
pub enum ChannelCoding {
    /// Each channel alone.
    Separate,
    /// Three channels through the opponent transform, other numbers each alone.
    Opponent,
}

/// How the grid is cut.
#[derive(Clone, Debug)]
pub(super) enum Blocks {
    /// The cheapest of the candidate shapes.
    Cheapest,
    Shape(Vec<usize>),
    Partition(Partition),
}

/// Settings of an encode, then [`Encoder::encode`].
///
/// ```
/// use csbrdf::{Contract, Effort, Encoder, Grid, synth::Recipe};
///
/// let table = Recipe::named("matte").unwrap().synthesise(&Grid::merl().with_lengths(&[20, 20, 36])?)?;
/// let encoded = Encoder::new().effort(Effort::Fast).contract(Contract::Rmse(0.01)).encode(&table)?;
/// assert!(encoded.report.log_rms <= 0.01);
/// # Ok::<(), csbrdf::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Encoder {
    pub(super) basis: Basis,
    pub(super) blocks: Blocks,
    pub(super) sampling: Sampling,
    /// Of the sampling of each block, in place of `sampling`: rms error over samples held out, log domain.
    pub(super) target: Option<f64>,
    pub(super) seed: u64,
    pub(super) step: f32,
    pub(super) rounding: f64,
    /// `None`: a tenth of the step.
    pub(super) sigma: Option<f64>,
    pub(super) iterations: usize,
    pub(super) weighting: f64,
    pub(super) trend: bool,
    pub(super) profile: bool,
    pub(super) effort: Effort,
    pub(super) eps: f64,
    pub(super) channels: ChannelCoding,
    pub(super) contract: Option<Contract>,
    pub(super) lossless: bool,
    pub(super) spare: Option<bool>,
    pub(super) metadata: Metadata,
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
            channels: ChannelCoding::Opponent,
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
                channels: ChannelCoding::Separate,
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

    /// Samples each block until the recovery predicts samples that it has not seen with an rms error of at most this, log
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
    /// that do not depend on the blocks, left with what the model does not explain. For samples that are few; needs a grid
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
    pub fn channels(self, channels: ChannelCoding) -> Encoder {
        Encoder { channels, ..self }
    }

    /// What the file must keep: the step is then searched for, in up to some six encodes, and [`Encoder::quality`] is
    /// where the search begins at most. Errors count at all valid entries, sampled or not.
    pub fn contract(self, contract: Contract) -> Encoder {
        Encoder { contract: Some(contract), ..self }
    }

    /// Whether the file also restores every bit of the table, missing entries included: [`crate::decode::Reader::source_table`].
    /// Readers that do not know how still read the rest. Not with a contract on the size.
    pub fn lossless(self, lossless: bool) -> Encoder {
        Encoder { lossless, ..self }
    }

    /// Whether the file also holds a spare copy of all that blocks cannot be decoded without, for [`crate::edit::salvage`]: some 2 to 4 kB.
    /// Without a call, lossless files do.
    pub fn spare(self, spare: bool) -> Encoder {
        Encoder { spare: Some(spare), ..self }
    }

    /// Provenance to store; the encoder adds its settings and what it achieved.
    pub fn metadata(self, metadata: Metadata) -> Encoder {
        Encoder { metadata, ..self }
    }

    pub(super) fn check(&self) -> Result<()> {
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

    /// Whether the table is recovered as a whole, by trend and windows, before it is cut into blocks.
    pub(super) fn whole_table(&self) -> bool {
        self.trend || self.target.is_some()
    }

    /// The sampling that the file states; blocks may double it.
    pub(super) fn base_sampling(&self) -> Sampling {
        if self.target.is_some() { ADAPTIVE_START } else { self.sampling }
    }


    /// The error of a coefficient beyond what the format holds.
    pub(super) fn too_fine(&self) -> Error {
        let largest = crate::codec::entropy::MAX_MAGNITUDE;
        let step = self.step;
        Error::InvalidArgument(format!("quality {step} is too fine: a coefficient is beyond {largest} steps; raise it"))
    }

    /// The step as the caller wrote it, not as the nearest double of a single.
    pub(super) fn step_as_written(&self) -> f64 {
        self.step.to_string().parse().unwrap_or(self.step.into())
    }

    pub(super) fn sigma_rms(&self) -> f64 {
        // The rest is never nearer to the truth than the samples.
        let most = self.target.map_or(f64::INFINITY, |target| target / 3.0);
        self.sigma.unwrap_or((self.step_as_written() / 10.0).min(most))
    }
}
