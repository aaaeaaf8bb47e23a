//! From quantised blocks to the file: models, records, checks with the decoder, sections.

use rayon::prelude::*;

use super::blocks::{Quantized, gather_log};
use crate::block::{Block, Partition};
use crate::decode::{CONTEXTS, Header, MASKS, Scratch, ZEROS};
use crate::entropy::Walk;
use crate::error::{Error, Result};
use crate::format::MAX_MEANS;
use crate::format::directory::{self, write_file};
use crate::format::header::{
    Coding, decode_probability, encode_probability, write_coding, write_grid, write_partition, write_probabilities,
};
use crate::format::index::{Entry, encode_error, write_index};
use crate::format::profile::{CodedProfile, write_profile};
use crate::format::record::{Record, ValidityClass};
use crate::range::{Coder, Counter, Encoder};
use crate::table::BrdfTable;
use crate::zeros::code_zeros;

/// Bits that a stored probability must save: it takes eight, and records adapt without it.
const PROBABILITY_BITS: f64 = 16.0;

/// A file but for its metadata.
pub(super) struct Packed {
    pub(super) log_rms: f64,
    pub(super) log_max: f64,
    grid: Vec<u8>,
    coding: Vec<u8>,
    partition: Vec<u8>,
    probabilities: Vec<u8>,
    profile: Option<Vec<u8>>,
    index: Vec<u8>,
    records: Vec<u8>,
}

/// Error of one block over its valid entries, all channels.
#[derive(Clone, Copy, Default)]
struct BlockError {
    squares: f64,
    count: usize,
    max: f64,
}

/// Class and the masks that go into the record.
fn classify(header: &Header, block: &Block, valid: &[bool]) -> (ValidityClass, Vec<bool>) {
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

/// What a record tells besides its coefficients.
#[derive(Clone)]
struct Told {
    class: ValidityClass,
    /// Masks that go into the record.
    masks: Vec<bool>,
    /// Validity, of all channels or of each.
    valid: Vec<bool>,
    /// Exact zeros, if the file tells them.
    zeros: Vec<bool>,
}

impl Told {
    fn new(table: &BrdfTable, header: &Header, block: &Block) -> Told {
        let n = block.positions();
        let (_, valid) = gather_log(table, block, header.coding.eps);
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
        let valid = if class == ValidityClass::MaskPerChannel { valid } else { valid[..n].to_vec() };
        Told { class, masks, valid, zeros }
    }

    /// Codes a record's masks, zeros and coefficients.
    fn code<C: Coder>(&self, coder: &mut C, header: &Header, block: &Block, coefficients: &[i32], walk: &mut Walk) {
        if self.class == ValidityClass::None {
            return;
        }
        header.mask_model().code(coder, MASKS, block, &mut self.masks.clone());
        if !self.zeros.is_empty() {
            code_zeros(coder, ZEROS, block.shape, &self.valid, &mut self.zeros.clone());
        }
        let coded = walk.code(coder, block.shape, &mut coefficients.to_vec(), &mut Vec::new());
        debug_assert!(coded.is_ok(), "the quantiser bounds the coefficients");
    }
}

/// Codes the blocks, decodes them again and measures what came back.
pub(super) fn pack(
    table: &BrdfTable,
    coding: Coding,
    partition: Partition,
    profile: Option<CodedProfile>,
    blocks: &[Quantized],
) -> Result<Packed> {
    let place = |number: usize| partition.block(number).expect("one entry a block");
    let flat = Header::new(table.grid().clone(), coding.clone(), partition.clone(), vec![1 << 15; CONTEXTS]);
    let means: Vec<i32> = blocks.iter().flat_map(|b| b.means.iter().map(|mean| mean.unwrap_or(0))).collect();
    let components = table.grid().channels().len();
    if means.len() > MAX_MEANS {
        let what = format!("{} blocks of {components} components, the format has {MAX_MEANS} means", blocks.len());
        return Err(Error::InvalidArgument(format!("{what} at most; give a larger block shape")));
    }
    let told: Vec<Told> =
        (0..blocks.len()).into_par_iter().map(|number| Told::new(table, &flat, &place(number))).collect();

    let counter = (0..blocks.len())
        .into_par_iter()
        .fold(
            || (Counter::new(CONTEXTS), Walk::default()),
            |(mut counter, mut walk), number| {
                told[number].code(&mut counter, &flat, &place(number), &blocks[number].coefficients, &mut walk);
                (counter, walk)
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
    let codes: Vec<Option<u8>> =
        counter.probabilities(PROBABILITY_BITS).into_iter().map(|p| p.map(encode_probability)).collect();
    let probabilities = codes.iter().map(|code| code.map_or(1 << 15, decode_probability)).collect();
    let written_profile = profile.as_ref().map(write_profile);
    let header =
        Header::new(table.grid().clone(), coding.clone(), partition.clone(), probabilities).with_profile(profile);

    let coded: Vec<(Vec<u8>, BlockError)> = (0..blocks.len())
        .into_par_iter()
        .map_init(
            || (Walk::default(), Scratch::default()),
            |(walk, scratch), number| {
                let block = place(number);
                let mut coder = Encoder::new(&header.probabilities);
                told[number].code(&mut coder, &header, &block, &blocks[number].coefficients, walk);
                let coded = coder.finish();
                let class = told[number].class;
                // Nothing to sample, nothing to double.
                let doublings = if class == ValidityClass::None { 0 } else { blocks[number].doublings };
                let record = Record { class, doublings, coded: &coded };
                header
                    .rebuild(&block, &record, &means[number * components..(number + 1) * components], scratch)
                    .map_err(|what| Error::InvalidArgument(format!("block {number} does not decode: {what}")))?;
                Ok((record.write(number as u32), measure(table, &block, header.coding.eps, &scratch.log)))
            },
        )
        .collect::<Result<_>>()?;

    let total = coded.iter().fold(BlockError::default(), |sum, (_, e)| BlockError {
        squares: sum.squares + e.squares,
        count: sum.count + e.count,
        max: sum.max.max(e.max),
    });
    let rms = |e: &BlockError| if e.count == 0 { 0.0 } else { (e.squares / e.count as f64).sqrt() };
    let entries: Vec<Entry> = coded
        .iter()
        .zip(means.chunks_exact(components))
        .map(|((record, error), means)| Entry {
            length: record.len() as u32,
            errors: [encode_error(rms(error)), encode_error(error.max)],
            means: means.to_vec(),
        })
        .collect();
    Ok(Packed {
        log_rms: rms(&total),
        log_max: total.max,
        grid: write_grid(&header.grid),
        coding: write_coding(&header.coding),
        partition: write_partition(&header.partition, header.grid.axes().len()),
        probabilities: write_probabilities(&codes),
        profile: written_profile,
        index: write_index(&header.partition, &entries),
        records: coded.iter().flat_map(|(record, _)| record.iter().copied()).collect(),
    })
}

fn measure(table: &BrdfTable, block: &Block, eps: f64, decoded: &[f32]) -> BlockError {
    let (log, valid) = gather_log(table, block, eps);
    let (floor, ceiling) = (eps.ln(), f64::MAX.ln());
    let mut error = BlockError::default();
    for ((value, valid), decoded) in log.iter().zip(valid).zip(decoded) {
        if valid {
            // The inverse tone map gives neither negative nor infinite values: the log is cut off there.
            let difference = (value - f64::from(*decoded).clamp(floor, ceiling)).abs();
            error.squares += difference * difference;
            error.count += 1;
            error.max = error.max.max(difference);
        }
    }
    error
}

impl Packed {
    /// The whole file.
    pub(super) fn finish(self, metadata: &[u8]) -> Vec<u8> {
        let mut sections = vec![
            (directory::GRID, false, self.grid),
            (directory::CODING, false, self.coding),
            (directory::PARTITION, false, self.partition),
            (directory::PROBABILITIES, false, self.probabilities),
        ];
        sections.extend(self.profile.map(|profile| (directory::PROFILE, false, profile)));
        sections.extend([
            (directory::INDEX, false, self.index),
            (directory::METADATA, true, metadata.to_vec()),
            (directory::RECORDS, false, self.records),
        ]);
        write_file(&sections)
    }
}
