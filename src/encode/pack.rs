//! From quantised blocks to the file: models, records, checks with the decoder, sections.

use rayon::prelude::*;

use super::blocks::{Quantized, gather_log};
use super::bound::Bound;
use crate::base::budget::Budget;
use crate::base::error::{Error, Result};
use crate::codec::correct::{self, Decoded};
use crate::codec::dependent::Quantization;
use crate::codec::entropy::Walk;
use crate::codec::lossless;
use crate::codec::range::{Coder, Counter, Encoder};
use crate::codec::zeros::code_zeros;
use crate::decode::lossless::decode_bits;
use crate::decode::{CONTEXTS, CORRECTIONS, Header, MASKS, Scratch, ZEROS, contexts, without_zeros};
use crate::format::directory::{self, write_file, write_file_with_spare};
use crate::format::header::{Coding, write_coding, write_grid, write_partition};
use crate::format::index::{Entry, encode_error, write_index};
use crate::format::lossless::write_exact;
use crate::format::probabilities::{decode_probability, encode_probability, write_probabilities};
use crate::format::profile::{CodedProfile, write_profile};
use crate::format::record::{Record, ValidityClass};
use crate::format::{MAX_MEANS, VERSION};
use crate::table::BrdfTable;
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

/// Codes of a file's probabilities after what was counted, and the probabilities that they stand for.
pub(crate) fn fit_probabilities(counter: &Counter, quantization: Quantization) -> (Vec<Option<u8>>, Vec<u16>) {
    let mut codes: Vec<Option<u8>> =
        counter.probabilities(PROBABILITY_BITS).into_iter().map(|p| p.map(encode_probability)).collect();
    codes.truncate(contexts(quantization));
    let probabilities = codes.iter().map(|code| code.map_or(1 << 15, decode_probability)).collect();
    (codes, probabilities)
}

/// Class and the masks that go into the record.
pub(crate) fn classify(header: &Header, block: &Block, valid: &[bool]) -> (ValidityClass, Vec<bool>) {
    let n = block.positions();
    if valid.iter().all(|v| *v) {
        (ValidityClass::All, Vec::new())
    } else if !valid.contains(&true) {
        (ValidityClass::None, Vec::new())
    } else if valid.chunks_exact(n).any(|mask| *mask != valid[..n]) {
        (ValidityClass::MaskPerChannel, valid.to_vec())
    } else if header.mask_model().predict(block) == valid[..n] {
        (ValidityClass::Horizon, Vec::new())
    } else {
        (ValidityClass::Mask, valid[..n].to_vec())
    }
}

/// Buffers of a thread.
#[derive(Default)]
struct Buffers {
    walk: Walk,
    correct: correct::Walk,
    scratch: Scratch,
    lossless: lossless::Walk,
}

/// What a record tells besides its coefficients.
struct Told {
    class: ValidityClass,
    /// Masks that go into the record.
    masks: Vec<bool>,
    /// Validity, `[channel][position]`.
    valid: Vec<bool>,
    /// Exact zeros, if the file tells them.
    zeros: Vec<bool>,
}

impl Told {
    fn new(table: &BrdfTable, header: &Header, block: &Block) -> Told {
        let n = block.positions();
        let valid = gather_valid(table, block);
        let mut zeros = Vec::new();
        if header.coding.zeros {
            zeros.resize(valid.len(), false);
            let mut values = vec![0.0; n];
            for (c, zeros) in zeros.chunks_exact_mut(n).enumerate() {
                block.gather(table.grid().shape(), table.plane(c), &mut values);
                zeros.iter_mut().zip(&values).zip(&valid[c * n..]).for_each(|((z, v), valid)| *z = *valid && *v == 0.0);
            }
        }
        let (class, masks) = classify(header, block, &valid);
        Told { class, masks, valid, zeros }
    }
}

/// A block before it is coded.
struct Uncoded<'a> {
    block: Block,
    told: &'a Told,
    quantized: &'a Quantized,
    means: &'a [i32],
}

impl Uncoded<'_> {
    /// Its log values before corrections, in the scratch.
    fn rebuild(&self, header: &Header, scratch: &mut Scratch) {
        let rebuilt = header.rebuild_uncoded(&self.block, &self.quantized.coefficients, self.means, scratch);
        debug_assert!(rebuilt.is_ok(), "the profile was decoded when it was fitted");
    }

    /// Codes masks, exact zeros, coefficients and, where the file has a correction step, corrections.
    fn code<C: Coder>(&self, coder: &mut C, header: &Header, corrections: &[i32], buffers: &mut Buffers) {
        let Told { class, masks, valid, zeros } = self.told;
        if *class == ValidityClass::None {
            return;
        }
        let shape = self.block.shape;
        header.mask_model().code(coder, MASKS, &self.block, &mut masks.clone());
        if header.coding.zeros {
            let n: usize = shape.iter().product();
            let masks = if *class == ValidityClass::MaskPerChannel { valid } else { &valid[..n] };
            let coded = code_zeros(coder, ZEROS, shape, valid.len() / n, || masks, &mut zeros.clone());
            debug_assert!(coded.is_ok(), "a coder that writes takes no memory");
        }
        let coded = buffers.walk.code(coder, header.coding.quantization, shape, &self.quantized.coefficients);
        debug_assert!(coded.is_ok(), "the quantiser bounds the coefficients");
        if let Some(step) = header.coding.correction {
            let mut corrections = corrections.to_vec();
            if corrections.is_empty() {
                corrections.resize(valid.len(), 0);
            } else {
                self.rebuild(header, &mut buffers.scratch);
            }
            let correctable = without_zeros(valid, zeros).expect("memory for a block's validity");
            let decoded = Decoded { shape, masks: &correctable, log: &buffers.scratch.log, step };
            let coded = buffers.correct.code(coder, CORRECTIONS, decoded, &mut corrections);
            debug_assert!(coded.is_ok(), "the bound bounds the corrections");
        }
    }
}

/// Codes the blocks, corrects what is off by more than the bound, decodes them again and measures what came back.
///
/// Corrections are found on what the decoder makes of the coefficients; what is measured is what it makes of the record.
pub(super) fn pack(
    table: &BrdfTable,
    mut coding: Coding,
    partition: Partition,
    profile: Option<CodedProfile>,
    blocks: &[Quantized],
    bound: Option<Bound>,
    lossless: bool,
) -> Result<Packed> {
    coding.correction = bound.map(|bound| bound.step);
    let place = |number: usize| partition.block(number).expect("one entry a block");
    let flat = Header::new(table.grid().clone(), coding.clone(), partition.clone(), vec![1 << 15; CONTEXTS].into())
        .with_profile(profile.clone());
    let means: Vec<i32> = blocks.iter().flat_map(|b| b.means.iter().map(|mean| mean.unwrap_or(0))).collect();
    let components = table.grid().channels().len();
    if means.len() > MAX_MEANS {
        let what = format!("{} blocks of {components} components, the format has {MAX_MEANS} means", blocks.len());
        return Err(Error::InvalidArgument(format!("{what} at most; give a larger block shape")));
    }
    let told: Vec<Told> =
        (0..blocks.len()).into_par_iter().map(|number| Told::new(table, &flat, &place(number))).collect();
    let uncoded = |number: usize| Uncoded {
        block: place(number),
        told: &told[number],
        quantized: &blocks[number],
        means: &means[number * components..(number + 1) * components],
    };
    let corrections: Vec<Vec<i32>> = match bound {
        None => vec![Vec::new(); blocks.len()],
        Some(bound) => (0..blocks.len())
            .into_par_iter()
            .map_init(Scratch::default, |scratch, number| {
                let block = uncoded(number);
                block.rebuild(&flat, scratch);
                let (log, _) = gather_log(table, &block.block, coding.eps);
                let correctable = without_zeros(&block.told.valid, &block.told.zeros)?;
                bound.corrections(&log, &correctable, &scratch.log, cuts(coding.eps)).map_err(|left| {
                    let what =
                        format!("step {} is too coarse for the largest error: {left:.2e} is left", coding.steps[0]);
                    Error::ContractNotMet(what)
                })
            })
            .collect::<Result<_>>()?,
    };

    let counter = (0..blocks.len())
        .into_par_iter()
        .fold(
            || (Counter::new(CONTEXTS), Buffers::default()),
            |(mut counter, mut buffers), number| {
                uncoded(number).code(&mut counter, &flat, &corrections[number], &mut buffers);
                (counter, buffers)
            },
        )
        .map(|(counter, _)| counter)
        .reduce(
            || Counter::new(CONTEXTS),
            |mut a, b| {
                a.add(&b);
                a
            },
        );
    let (codes, probabilities) = fit_probabilities(&counter, coding.quantization);
    let written_profile = profile.as_ref().map(write_profile);
    let header = Header::new(table.grid().clone(), coding.clone(), partition.clone(), probabilities.into())
        .with_profile(profile);

    let missing = lossless.then(|| usual_missing(table));
    let coded: Vec<(Vec<u8>, BlockError, Vec<u8>)> = (0..blocks.len())
        .into_par_iter()
        .map_init(Buffers::default, |buffers, number| {
            let block = uncoded(number);
            let mut coder = Encoder::new(header.probabilities.get()?);
            block.code(&mut coder, &header, &corrections[number], buffers);
            let coded = coder.finish();
            // Nothing to sample, nothing to double.
            let class = block.told.class;
            let doublings = if class == ValidityClass::None { 0 } else { blocks[number].doublings };
            let record = Record { class, doublings, coded: &coded };
            header.rebuild(&block.block, &record, block.means, &mut buffers.scratch, &Budget::unbounded()).map_err(
                |fault| fault.error(|what| Error::InvalidArgument(format!("block {number} does not decode: {what}"))),
            )?;
            let error = measure(table, &block.block, header.coding.eps, &buffers.scratch.log);
            let exact = match &missing {
                Some(missing) => code_exact(table, &header, &block, missing, buffers)
                    .map_err(|what| Error::InvalidArgument(format!("block {number} is not restored: {what}")))?,
                None => Vec::new(),
            };
            Ok((record.write(number as u32), error, exact))
        })
        .collect::<Result<_>>()?;

    let total = coded.iter().fold(BlockError::default(), |sum, (_, e, _)| BlockError {
        squares: sum.squares + e.squares,
        count: sum.count + e.count,
        max: sum.max.max(e.max),
    });
    let rms = |e: &BlockError| if e.count == 0 { 0.0 } else { (e.squares / e.count as f64).sqrt() };
    let entries: Vec<Entry> = coded
        .iter()
        .zip(means.chunks_exact(components))
        .map(|((record, error, _), means)| Entry {
            length: record.len() as u32,
            errors: [encode_error(rms(error)), encode_error(error.max)],
            means: means.to_vec(),
        })
        .collect();
    let exact = missing.map(|missing| {
        let parts: Vec<&[u8]> = coded.iter().map(|(.., exact)| &exact[..]).collect();
        write_exact(&missing, &parts)
    });
    Ok(Packed {
        log_rms: rms(&total),
        log_max: total.max,
        corrected: corrections.iter().flatten().filter(|m| **m != 0).count(),
        grid: write_grid(&header.grid),
        coding: write_coding(&header.coding),
        partition: write_partition(&header.partition, header.grid.axes().len()),
        probabilities: write_probabilities(&codes),
        profile: written_profile,
        index: write_index(&header.partition, &entries),
        records: coded.iter().flat_map(|(record, ..)| record.iter().copied()).collect(),
        exact,
    })
}

/// Bits of entries that are not valid: those of the first, by channel.
fn usual_missing(table: &BrdfTable) -> Vec<u64> {
    let first = |c: usize| table.plane(c).iter().zip(table.valid_plane(c)).find(|(_, valid)| !**valid);
    (0..table.grid().channels().len()).map(|c| first(c).map_or(0, |(value, _)| value.to_bits())).collect()
}

/// What restores the source's bits of a block that was just rebuilt; decoded again as a proof.
fn code_exact(
    table: &BrdfTable,
    header: &Header,
    block: &Uncoded,
    missing: &[u64],
    buffers: &mut Buffers,
) -> Result<Vec<u8>, &'static str> {
    let (n, channels) = (block.block.positions(), table.grid().channels());
    let mut values = vec![0f64; n * channels.len()];
    for (c, values) in values.chunks_exact_mut(n).enumerate() {
        block.block.gather(table.grid().shape(), table.plane(c), values);
    }
    let bits: Vec<u64> = values.into_iter().map(f64::to_bits).collect();
    let scales: Vec<f64> = channels.iter().map(|channel| channel.scale).collect();
    let decoded = lossless::Decoded {
        shape: block.block.shape,
        valid: &block.told.valid,
        log: &buffers.scratch.log,
        eps: header.coding.eps,
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

/// Validity of a block, `[channel][position]`.
fn gather_valid(table: &BrdfTable, block: &Block) -> Vec<bool> {
    let n = block.positions();
    let mut valid = vec![false; n * table.grid().channels().len()];
    for (channel, valid) in valid.chunks_exact_mut(n).enumerate() {
        block.gather(table.grid().shape(), table.valid_plane(channel), valid);
    }
    valid
}

fn measure(table: &BrdfTable, block: &Block, eps: f64, decoded: &[f32]) -> BlockError {
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
        sections.extend(self.exact.clone().map(|exact| (directory::EXACT, true, exact)));
        match spare {
            true => write_file_with_spare(VERSION, &sections),
            false => write_file(VERSION, &sections),
        }
    }
}
