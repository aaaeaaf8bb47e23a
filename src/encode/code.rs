//! From quantised blocks to the file: models, records, checks with the decoder, sections.

use rayon::prelude::*;

use super::bound::Bound;
use super::gather::{gather_log, gather_valid, gather_values};
use super::quantised::Quantized;
use crate::base::budget::Budget;
use crate::base::error::{Error, Result};
use crate::codec::dependent::Quantization;
use crate::codec::lossless;
use crate::codec::range::{Coder, Counter, Encoder};
use crate::blocks::code::{Coding as RecordBuffers, Contents};
use crate::blocks::lossless::decode_bits;
use crate::blocks::{BlockCodec, Scratch, without_zeros};
use crate::codec::contexts::{CONTEXTS, contexts};
use crate::format::directory;
use crate::format::file::{write_file, write_file_with_spare};
use crate::format::header::{Coding, write_coding, write_grid, write_partition};
use crate::format::index::{Entry, encode_error, write_index};
use crate::format::lossless::write_lossless;
use crate::format::probabilities::{decode_probability, encode_probability, write_probabilities};
use crate::format::profile::{CodedProfile, write_profile};
use crate::format::record::{Record, ValidityClass};
use crate::base::limits::MAX_MEANS;
use crate::base::version::VERSION;
use crate::table::Table;
use crate::table::block::{Block, Partition};

/// Bits that a stored probability must save: it takes eight, and records adapt without it.
const PROBABILITY_BITS: f64 = 16.0;

/// A file but for its metadata.
pub(super) struct Packed {
    pub(super) log_rms: f64,
    pub(super) log_max: f64,
    /// Entries with a correction.
    pub(super) corrected: usize,
    grid: Vec<u8>,
    coding: Vec<u8>,
    partition: Vec<u8>,
    probabilities: Vec<u8>,
    profile: Option<Vec<u8>>,
    index: Vec<u8>,
    records: Vec<u8>,
    exact: Option<Vec<u8>>,
}

/// Error of one block over its valid entries, all channels.
#[derive(Clone, Copy, Default)]
struct BlockError {
    squares: f64,
    count: usize,
    max: f64,
}

impl BlockError {
    fn rms(&self) -> f64 {
        if self.count == 0 { 0.0 } else { (self.squares / self.count as f64).sqrt() }
    }

    fn plus(self, other: &BlockError) -> BlockError {
        BlockError {
            squares: self.squares + other.squares,
            count: self.count + other.count,
            max: self.max.max(other.max),
        }
    }
}

/// Codes of a file's probabilities after what was counted, and the probabilities that they stand for.
pub(crate) fn fit_probabilities(counter: &Counter, quantization: Quantization) -> (Vec<Option<u8>>, Vec<u16>) {
    let mut codes: Vec<Option<u8>> =
        counter.probabilities(PROBABILITY_BITS).into_iter().map(|p| p.map(encode_probability)).collect();
    codes.truncate(contexts(quantization));
    let probabilities = codes.iter().map(|code| code.map_or(1 << 15, decode_probability)).collect();
    (codes, probabilities)
}

/// Class and the masks that go into the record.
pub(crate) fn classify(codec: &BlockCodec, block: &Block, valid: &[bool]) -> (ValidityClass, Vec<bool>) {
    let n = block.positions();
    if valid.iter().all(|v| *v) {
        (ValidityClass::All, Vec::new())
    } else if !valid.contains(&true) {
        (ValidityClass::None, Vec::new())
    } else if valid.chunks_exact(n).any(|mask| *mask != valid[..n]) {
        (ValidityClass::MaskPerChannel, valid.to_vec())
    } else if codec.mask_model().predict(block) == valid[..n] {
        (ValidityClass::Horizon, Vec::new())
    } else {
        (ValidityClass::Mask, valid[..n].to_vec())
    }
}

/// Buffers of a thread.
#[derive(Default)]
struct Buffers {
    coding: RecordBuffers,
    scratch: Scratch,
    lossless: lossless::Walk,
}

/// What a record holds besides its coefficients.
struct Validity {
    class: ValidityClass,
    /// Validity, `[channel][position]`.
    valid: Vec<bool>,
    /// Exact zeros, if the file stores them.
    zeros: Vec<bool>,
}

impl Validity {
    fn new(table: &Table, codec: &BlockCodec, block: &Block) -> Validity {
        let valid = gather_valid(table, block);
        let mut zeros = Vec::new();
        if codec.coding.zeros {
            zeros.extend(gather_values(table, block).iter().zip(&valid).map(|(value, valid)| *valid && *value == 0.0));
        }
        let (class, _) = classify(codec, block, &valid);
        Validity { class, valid, zeros }
    }
}

/// A block before it is coded.
struct Uncoded<'a> {
    block: Block,
    validity: &'a Validity,
    quantized: &'a Quantized,
    means: &'a [i32],
}

impl Uncoded<'_> {
    /// Its log values before corrections, in the scratch.
    fn rebuild(&self, codec: &BlockCodec, scratch: &mut Scratch) {
        let rebuilt = codec.rebuild_uncoded(&self.block, &self.quantized.coefficients, self.means, scratch);
        debug_assert!(rebuilt.is_ok(), "the profile was decoded when it was fitted");
    }

    /// Codes masks, exact zeros, coefficients and, where the file has a correction step, corrections.
    fn code<C: Coder>(&self, coder: &mut C, codec: &BlockCodec, corrections: &[i32], buffers: &mut Buffers) {
        let Validity { class, valid, zeros, .. } = self.validity;
        let n = self.block.positions();
        let masks = if *class == ValidityClass::MaskPerChannel { valid } else { &valid[..n] };
        let mut none = Vec::new();
        let corrections = codec.coding.correction.map(|_| {
            if corrections.is_empty() {
                // The log values are not looked at where nothing is corrected.
                none.resize(valid.len(), 0);
                (&none[..], &buffers.scratch.log[..])
            } else {
                self.rebuild(codec, &mut buffers.scratch);
                (corrections, &buffers.scratch.log[..])
            }
        });
        let coefficients = &self.quantized.coefficients;
        let contents = Contents { class: *class, masks, zeros, coefficients, corrections };
        let coded = codec.code(coder, &self.block, &contents, &mut buffers.coding);
        debug_assert!(coded.is_ok(), "quantiser and bound keep the format's ranges, and a coder that writes takes no memory");
    }
}

/// The blocks of a table on their way into records.
struct Blocks<'a> {
    table: &'a Table,
    partition: &'a Partition,
    quantized: &'a [Quantized],
    /// `[block][component]`
    means: Vec<i32>,
    validity: Vec<Validity>,
}

/// A block's record, what its decoded values are off by, and what restores its source values (empty unless lossless).
struct Coded {
    record: Vec<u8>,
    error: BlockError,
    exact: Vec<u8>,
}

impl<'a> Blocks<'a> {
    fn new(
        table: &'a Table,
        codec: &BlockCodec,
        partition: &'a Partition,
        quantized: &'a [Quantized],
    ) -> Result<Blocks<'a>> {
        let means: Vec<i32> = quantized.iter().flat_map(|b| b.means.iter().map(|mean| mean.unwrap_or(0))).collect();
        if means.len() > MAX_MEANS {
            let (blocks, components) = (quantized.len(), table.grid().channels().len());
            let what = format!("{blocks} blocks of {components} components, the format has {MAX_MEANS} means");
            return Err(Error::InvalidArgument(format!("{what} at most; give a larger block shape")));
        }
        let place = |number: usize| partition.block(number).expect("one entry a block");
        let validity =
            (0..quantized.len()).into_par_iter().map(|number| Validity::new(table, codec, &place(number))).collect();
        Ok(Blocks { table, partition, quantized, means, validity })
    }

    fn components(&self) -> usize {
        self.table.grid().channels().len()
    }

    fn block(&self, number: usize) -> Uncoded<'_> {
        Uncoded {
            block: self.partition.block(number).expect("one entry a block"),
            validity: &self.validity[number],
            quantized: &self.quantized[number],
            means: &self.means[number * self.components()..(number + 1) * self.components()],
        }
    }

    /// Corrections of each block, found on what the decoder makes of its coefficients; empty where none is needed.
    fn corrections(&self, codec: &BlockCodec, bound: Option<Bound>) -> Result<Vec<Vec<i32>>> {
        let Some(bound) = bound else { return Ok(vec![Vec::new(); self.quantized.len()]) };
        let (eps, step) = (codec.coding.eps, codec.coding.steps[0]);
        (0..self.quantized.len())
            .into_par_iter()
            .map_init(Scratch::default, |scratch, number| {
                let block = self.block(number);
                block.rebuild(codec, scratch);
                let (log, _) = gather_log(self.table, &block.block, eps);
                let correctable = without_zeros(&block.validity.valid, &block.validity.zeros)?;
                bound.corrections(&log, &correctable, &scratch.log, cuts(eps)).map_err(|left| {
                    Error::ContractNotMet(format!(
                        "step {step} is too coarse for the largest error: {left:.2e} is left"
                    ))
                })
            })
            .collect()
    }

    /// How often each context sees a one and a zero.
    fn count(&self, codec: &BlockCodec, corrections: &[Vec<i32>]) -> Counter {
        let fresh = || (Counter::new(CONTEXTS), Buffers::default());
        let counted = (0..self.quantized.len()).into_par_iter().fold(fresh, |(mut counter, mut buffers), number| {
            self.block(number).code(&mut counter, codec, &corrections[number], &mut buffers);
            (counter, buffers)
        });
        let sum = |mut a: Counter, b: Counter| {
            a.add(&b);
            a
        };
        counted.map(|(counter, _)| counter).reduce(|| Counter::new(CONTEXTS), sum)
    }

    /// The records, each decoded again and measured; with `missing`, the usual bits of entries that are not valid, also the
    /// lossless layer.
    fn records(&self, codec: &BlockCodec, corrections: &[Vec<i32>], missing: Option<&[u64]>) -> Result<Vec<Coded>> {
        (0..self.quantized.len())
            .into_par_iter()
            .map_init(Buffers::default, |buffers, number| {
                let block = self.block(number);
                let mut coder = Encoder::new(codec.probabilities.get()?);
                block.code(&mut coder, codec, &corrections[number], buffers);
                let coded = coder.finish();
                // Nothing to sample, nothing to double.
                let class = block.validity.class;
                let doublings = if class == ValidityClass::None { 0 } else { block.quantized.doublings };
                let record = Record { class, doublings, coded: &coded };
                let decoded =
                    codec.rebuild(&block.block, &record, block.means, &mut buffers.scratch, &Budget::unbounded());
                decoded.map_err(|fault| {
                    fault.error(|what| Error::InvalidArgument(format!("block {number} does not decode: {what}")))
                })?;
                let error = measure(self.table, &block.block, codec.coding.eps, &buffers.scratch.log);
                let exact = match missing {
                    Some(missing) => code_source(self.table, codec, &block, missing, buffers)
                        .map_err(|what| Error::InvalidArgument(format!("block {number} is not restored: {what}")))?,
                    None => Vec::new(),
                };
                Ok(Coded { record: record.write(number as u32), error, exact })
            })
            .collect()
    }

    /// What INDX says of each block.
    fn entries(&self, coded: &[Coded]) -> Vec<Entry> {
        let entry = |(coded, means): (&Coded, &[i32])| Entry {
            length: coded.record.len() as u32,
            errors: [encode_error(coded.error.rms()), encode_error(coded.error.max)],
            means: means.to_vec(),
        };
        coded.iter().zip(self.means.chunks_exact(self.components())).map(entry).collect()
    }
}

/// Codes the blocks, corrects what is off by more than the bound, decodes them again and measures what came back.
///
/// Corrections are found on what the decoder makes of the coefficients; what is measured is what it makes of the record.
pub(super) fn pack(
    table: &Table,
    mut coding: Coding,
    partition: Partition,
    profile: Option<CodedProfile>,
    quantized: &[Quantized],
    bound: Option<Bound>,
    lossless: bool,
) -> Result<Packed> {
    coding.correction = bound.map(|bound| bound.step);
    let with = |probabilities: Vec<u16>| {
        BlockCodec::new(table.grid().clone(), coding.clone(), partition.clone(), probabilities.into())
            .with_profile(profile.clone())
    };
    // Contexts are counted from even probabilities, which do not depend on the counts.
    let even = with(vec![1 << 15; CONTEXTS]);
    let blocks = Blocks::new(table, &even, &partition, quantized)?;
    let corrections = blocks.corrections(&even, bound)?;
    let (codes, probabilities) = fit_probabilities(&blocks.count(&even, &corrections), coding.quantization);
    let codec = with(probabilities);
    let missing = lossless.then(|| usual_missing(table));
    let coded = blocks.records(&codec, &corrections, missing.as_deref())?;
    let total = coded.iter().fold(BlockError::default(), |sum, coded| sum.plus(&coded.error));
    Ok(Packed {
        log_rms: total.rms(),
        log_max: total.max,
        corrected: corrections.iter().flatten().filter(|m| **m != 0).count(),
        grid: write_grid(&codec.grid),
        coding: write_coding(&codec.coding),
        partition: write_partition(&codec.partition, codec.grid.axes().len()),
        probabilities: write_probabilities(&codes),
        profile: profile.as_ref().map(write_profile),
        index: write_index(&codec.partition, &blocks.entries(&coded)),
        exact: missing.map(|missing| {
            let parts: Vec<&[u8]> = coded.iter().map(|coded| &coded.exact[..]).collect();
            write_lossless(&missing, &parts)
        }),
        records: coded.into_iter().flat_map(|coded| coded.record).collect(),
    })
}

/// Bits of entries that are not valid: those of the first, by channel.
fn usual_missing(table: &Table) -> Vec<u64> {
    let first = |c: usize| table.plane(c).iter().zip(table.valid_plane(c)).find(|(_, valid)| !**valid);
    (0..table.grid().channels().len()).map(|c| first(c).map_or(0, |(value, _)| value.to_bits())).collect()
}

/// What restores the source's bits of a block that was just rebuilt; decoded again as a proof.
fn code_source(
    table: &Table,
    codec: &BlockCodec,
    block: &Uncoded,
    missing: &[u64],
    buffers: &mut Buffers,
) -> Result<Vec<u8>, &'static str> {
    let bits: Vec<u64> = gather_values(table, &block.block).into_iter().map(f64::to_bits).collect();
    let scales: Vec<f64> = table.grid().channels().iter().map(|channel| channel.scale).collect();
    let decoded = lossless::Decoded {
        shape: block.block.shape,
        valid: &block.validity.valid,
        log: &buffers.scratch.log,
        eps: codec.coding.eps,
        scales: &scales,
        missing,
    };
    let mut forms = buffers.lossless.forms(decoded, &bits);
    let mut coder = Encoder::new(&lossless::probabilities());
    buffers.lossless.code(&mut coder, decoded, &mut forms, &mut bits.clone())?;
    let coded = coder.finish();
    let mut restored = vec![0; bits.len()];
    decode_bits(decoded, &coded, &mut restored)?;
    if restored != bits {
        return Err("other bits come back");
    }
    Ok(coded)
}

/// The inverse tone map gives neither negative nor infinite values: logs are cut off there.
fn cuts(eps: f64) -> [f64; 2] {
    [eps.ln(), f64::MAX.ln()]
}

fn measure(table: &Table, block: &Block, eps: f64, decoded: &[f32]) -> BlockError {
    let (log, valid) = gather_log(table, block, eps);
    let [floor, ceiling] = cuts(eps);
    let mut error = BlockError::default();
    for ((value, valid), decoded) in log.iter().zip(valid).zip(decoded) {
        if valid {
            let difference = (value - f64::from(*decoded).clamp(floor, ceiling)).abs();
            error.squares += difference * difference;
            error.count += 1;
            error.max = error.max.max(difference);
        }
    }
    error
}

impl Packed {
    /// The whole file, with a spare copy of its head if that is asked for.
    pub(super) fn finish(&self, metadata: &[u8], spare: bool) -> Vec<u8> {
        let mut sections = vec![
            (directory::GRID, false, self.grid.clone()),
            (directory::CODING, false, self.coding.clone()),
            (directory::PARTITION, false, self.partition.clone()),
            (directory::PROBABILITIES, false, self.probabilities.clone()),
        ];
        sections.extend(self.profile.clone().map(|profile| (directory::PROFILE, false, profile)));
        sections.extend([
            (directory::INDEX, false, self.index.clone()),
            (directory::METADATA, true, metadata.to_vec()),
            (directory::RECORDS, false, self.records.clone()),
        ]);
        sections.extend(self.exact.clone().map(|exact| (directory::LOSSLESS, true, exact)));
        match spare {
            true => write_file_with_spare(VERSION, &sections),
            false => write_file(VERSION, &sections),
        }
    }
}
