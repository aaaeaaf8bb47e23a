//! What the records of a file's blocks have in common, and how a record becomes log values (spec section 1.4).

use std::borrow::Cow;
use std::sync::OnceLock;

use super::buffer::Buffer;
use crate::base::budget::{Budget, Fault, lengthen, make_room, refill, repeated, with_room};
use crate::base::error::Result;
use crate::base::simd::Level;
use crate::codec::contexts::{CORRECTIONS, MASKS, ZEROS};
use crate::codec::correct::{self, Decoded, correct};
use crate::codec::entropy::{Coefficients, Walk};
use crate::codec::fourier::{AxisTable, Lines, Synthesis, Term};
use crate::codec::mask::MaskModel;
use crate::codec::profile::Profile;
use crate::codec::quantize::{Quantizer, dequantize_mean};
use crate::codec::range::Decoder;
use crate::codec::zeros::code_zeros;
use crate::format::header::Coding;
use crate::format::probabilities::Probabilities;
use crate::format::profile::CodedProfile;
use crate::format::record::{Record, ValidityClass};
use crate::table::block::{Block, Partition};
use crate::table::grid::Grid;
use crate::table::horizon::Horizon;

/// What coding a block needs besides its record. The reader, the encoder (before there is a file) and pruning have the same.
pub(crate) struct BlockCodec {
    pub(crate) grid: Grid,
    pub(crate) coding: Coding,
    pub(crate) partition: Partition,
    pub(crate) probabilities: Probabilities,
    pub(crate) synthesis: Synthesis,
    pub(crate) level: Level,
    horizon: OnceLock<Option<Horizon>>,
    mask: OnceLock<MaskModel>,
    pub(crate) coded_profile: Option<CodedProfile>,
    profile: OnceLock<Result<Profile, &'static str>>,
}

/// Buffers of a decode, for callers that rebuild many blocks on a thread. They keep the memory of the largest block.
#[derive(Debug, Default)]
pub struct Scratch {
    pub(crate) coefficients: Coefficients,
    /// Those of a component, dequantised.
    pub(crate) terms: Vec<Term>,
    pub(crate) walk: Walk,
    pub(crate) class: ValidityClass,
    /// Empty where the class says enough and the values do not depend on them.
    pub(crate) masks: Vec<bool>,
    /// Exact zeros, `[channel][position]`; empty if the record says that the block has none.
    pub(crate) zeros: Vec<bool>,
    /// Log values, `[channel][position]`.
    pub(crate) log: Buffer<f32>,
    /// Values on their way to short rows.
    pub(crate) values: Buffer<f32>,
    pub(crate) lines: Lines,
    /// Of the block that was rebuilt last, if the file has a correction step; `[channel][position]`.
    pub(crate) corrections: Vec<i32>,
    pub(crate) correct: correct::Walk,
}

impl BlockCodec {
    pub(crate) fn new(grid: Grid, coding: Coding, partition: Partition, probabilities: Probabilities) -> BlockCodec {
        let synthesis = Synthesis::new(coding.basis, &partition.axis_lengths());
        BlockCodec {
            grid,
            coding,
            partition,
            probabilities,
            synthesis,
            level: Level::detect(),
            horizon: OnceLock::new(),
            mask: OnceLock::new(),
            coded_profile: None,
            profile: OnceLock::new(),
        }
    }

    /// The same with a grazing profile.
    pub(crate) fn with_profile(self, coded_profile: Option<CodedProfile>) -> BlockCodec {
        BlockCodec { coded_profile, ..self }
    }

    /// The grazing profile, decoded at first use: opening does not wait for it.
    pub(crate) fn profile(&self) -> Result<Option<&Profile>, &'static str> {
        let Some(coded) = &self.coded_profile else { return Ok(None) };
        self.profile.get_or_init(|| coded.decode(&self.grid)).as_ref().map(Some).map_err(|what| *what)
    }

    /// What decoding the profile will take; `None` where there is none, or it was decoded.
    pub(crate) fn cost_of_profile(&self) -> Option<[u64; 2]> {
        let coded = self.coded_profile.as_ref().filter(|_| self.profile.get().is_none())?;
        let shapes = coded.shapes(&self.grid)?;
        let synthesis = Synthesis::new(crate::codec::fourier::Basis::Dct, &[]);
        Some(super::head_cost::of_profile(coded, &self.grid, &synthesis, shapes))
    }

    pub(crate) fn mask_model(&self) -> &MaskModel {
        self.mask.get_or_init(|| MaskModel::new(self.horizon().cloned(), self.coding.horizon))
    }

    pub(crate) fn horizon(&self) -> Option<&Horizon> {
        self.horizon.get_or_init(|| Horizon::new(&self.grid)).as_ref()
    }

    /// Decodes a record's masks and coefficients into the scratch. Masks: `[channel][position]` or one for all.
    pub(crate) fn decode_record(
        &self,
        block: &Block,
        class: ValidityClass,
        decoder: &mut Decoder,
        scratch: &mut Scratch,
        budget: &Budget,
    ) -> Result<(), Fault> {
        let channels = self.grid.channels().len();
        scratch.class = class;
        scratch.masks.clear();
        // What is only predicted is left until someone asks.
        if class != ValidityClass::Horizon || self.coding.correction.is_some() {
            self.decode_masks(block, class, decoder, &mut scratch.masks)?;
        }
        scratch.coefficients.clear();
        scratch.zeros.clear();
        if class.is_mean_only() {
            return Ok(());
        }
        if self.coding.zeros {
            let Scratch { masks, zeros, .. } = &mut *scratch;
            code_zeros(decoder, ZEROS, block.shape, channels, || self.stored_or_predicted(block, masks), zeros)?;
        }
        scratch.walk.decode(decoder, self.coding.quantization, block.shape, channels, &mut scratch.coefficients, budget)
    }

    /// The masks, or those that the horizon predicts if they were left.
    fn stored_or_predicted<'a>(&self, block: &Block, masks: &'a mut Vec<bool>) -> &'a [bool] {
        if masks.is_empty() {
            masks.extend(self.mask_model().predict(block));
        }
        masks
    }

    pub(crate) fn decode_masks(
        &self,
        block: &Block,
        class: ValidityClass,
        decoder: &mut Decoder,
        masks: &mut Vec<bool>,
    ) -> Result<()> {
        let n = block.positions();
        masks.clear();
        match class {
            ValidityClass::All => lengthen(masks, n, true)?,
            ValidityClass::None | ValidityClass::Pruned => lengthen(masks, n, false)?,
            ValidityClass::Horizon => masks.extend(self.mask_model().predict(block)),
            ValidityClass::Mask | ValidityClass::MaskPerChannel => {
                let per_channel = class == ValidityClass::MaskPerChannel;
                lengthen(masks, if per_channel { n * self.grid.channels().len() } else { n }, false)?;
                self.mask_model().code(decoder, MASKS, block, masks);
            }
        }
        Ok(())
    }

    /// Rebuilds a block's log values in `scratch.log`, `[channel][position]`; gives the masks on the side.
    pub(crate) fn rebuild(
        &self,
        block: &Block,
        record: &Record,
        means: &[i32],
        scratch: &mut Scratch,
        budget: &Budget,
    ) -> Result<(), Fault> {
        let mut decoder = self.components(block, record, means, scratch, budget)?;
        self.to_channels(&mut scratch.log);
        if let Some(step) = self.coding.correction.filter(|_| !record.class.is_mean_only()) {
            let Scratch { masks, zeros, log, corrections, .. } = scratch;
            refill(corrections, log.len(), 0)?;
            let correctable = without_zeros(masks, zeros)?;
            let decoded = Decoded { shape: block.shape, masks: &correctable, log, step };
            scratch
                .correct
                .code(&mut decoder, CORRECTIONS, decoded, corrections)
                .map_err(|_| "a correction is out of range")?;
            correct(log, corrections, step);
        }
        decoder.check_end()?;
        scratch.hide_zeros();
        Ok(())
    }

    /// Components of log values in `scratch.log`, exact zeros on the side; the decoder stands before the corrections.
    pub(crate) fn components<'a>(
        &self,
        block: &Block,
        record: &Record<'a>,
        means: &[i32],
        scratch: &mut Scratch,
        budget: &Budget,
    ) -> Result<Decoder<'a>, Fault> {
        let mut decoder =
            Decoder::new(self.probabilities.get().map_err(|_| "its probabilities are damaged")?, record.coded);
        self.decode_record(block, record.class, &mut decoder, scratch, budget)?;
        budget.spend(self.work_of_record(block, scratch) + self.work_of_synthesis(block, scratch))?;
        let _held = budget.holding(scratch.coefficients.bytes() as u64)?;
        self.synthesize(block, means, scratch)?;
        Ok(decoder)
    }

    /// Components of log values in `scratch.log`, from the coefficients in the scratch.
    pub(crate) fn synthesize(&self, block: &Block, means: &[i32], scratch: &mut Scratch) -> Result<(), Fault> {
        let n = block.positions();
        scratch.log.resize(means.len() * n)?;
        let Scratch { coefficients, terms, log, lines, .. } = scratch;
        for (component, (values, mean)) in log.chunks_exact_mut(n).zip(means).enumerate() {
            self.dequantize(component, coefficients.of_channel(component), *mean, terms)?;
            self.synthesis.synthesize(self.level, block.shape, terms, values, lines)?;
        }
        Ok(self.add_profile(block, log)?)
    }

    /// Components of log values of a block of means alone in `scratch.log`, one for each row along the last axis, `[component][row]`;
    /// false if they are not the same along each.
    pub(crate) fn rows_of_means(&self, block: &Block, means: &[i32], scratch: &mut Scratch) -> Result<bool> {
        let rows = block.positions() / block.shape[3];
        scratch.log.resize(means.len() * rows)?;
        for ((values, mean), step) in scratch.log.chunks_exact_mut(rows).zip(means).zip(&self.coding.steps) {
            let Some(value) = self.synthesis.constant(block.shape, dequantize_mean(*step, *mean)) else {
                return Ok(false);
            };
            values.fill(value);
        }
        Ok(match self.profile() {
            Ok(Some(profile)) => profile.add_to_rows(block, &mut scratch.log),
            Ok(None) => true,
            Err(_) => false,
        })
    }

    /// The coefficients of a component, that at index 0 first.
    pub(crate) fn dequantize(
        &self,
        component: usize,
        coefficients: &[(u32, i32)],
        mean: i32,
        terms: &mut Vec<Term>,
    ) -> Result<()> {
        let step = self.coding.steps[component];
        let quantizer = Quantizer { step, shrink: self.coding.shrink.map(|s| f32::from(s) / 256.0) };
        terms.clear();
        make_room(terms, 1 + coefficients.len())?;
        terms.push((0, dequantize_mean(step, mean)));
        terms.extend(coefficients.iter().map(|&(position, q)| (position, quantizer.dequantize(q))));
        Ok(())
    }

    /// Adds the profile, if the file has one, to the components of a block.
    pub(crate) fn add_profile(&self, block: &Block, values: &mut [f32]) -> Result<(), &'static str> {
        if let Some(profile) = self.profile()? {
            profile.add(self.level, block, values);
        }
        Ok(())
    }

    pub(crate) fn axes(&self, shape: [usize; 4]) -> [&AxisTable; 4] {
        shape.map(|n| self.synthesis.axis(n))
    }

    /// What [`BlockCodec::rebuild`] gives before corrections and zeros, of coefficients `[component][position]` that are not coded yet.
    #[cfg(feature = "encode")]
    pub(crate) fn rebuild_uncoded(
        &self,
        block: &Block,
        coefficients: &[i32],
        means: &[i32],
        scratch: &mut Scratch,
    ) -> Result<(), Fault> {
        scratch.coefficients = Coefficients::of_planes(coefficients, block.positions());
        self.synthesize(block, means, scratch)?;
        self.to_channels(&mut scratch.log);
        Ok(())
    }

    /// Masks of all channels of the block that was decoded last, `[channel][position]`.
    pub(crate) fn masks_of(&self, block: &Block, scratch: &Scratch) -> Result<Vec<bool>> {
        let channels = self.grid.channels().len();
        match scratch.class {
            ValidityClass::Horizon => repeated(&self.mask_model().predict(block), channels),
            ValidityClass::MaskPerChannel => repeated(&scratch.masks, 1),
            _ => repeated(&scratch.masks, channels),
        }
    }
}

/// Validity less exact zeros, which take no correction.
pub(crate) fn without_zeros<'a>(masks: &'a [bool], zeros: &[bool]) -> Result<Cow<'a, [bool]>> {
    if !zeros.contains(&true) {
        return Ok(masks.into());
    }
    let mut left = with_room(zeros.len())?;
    left.extend(zeros.iter().enumerate().map(|(i, zero)| masks[i % masks.len()] && !zero));
    Ok(left.into())
}
