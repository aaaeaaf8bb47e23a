//! From quantised blocks to the file: models, records, checks with the decoder, sections.

use rayon::prelude::*;

use super::blocks::{Quantized, gather_log};
use crate::block::{Block, Partition};
use crate::decode::{CONTEXTS, Header, Scratch};
use crate::entropy::{self, Walk};
use crate::error::{Error, Result};
use crate::format::directory::{self, write_file};
use crate::format::header::{Coding, write_coding, write_grid, write_partition, write_probabilities};
use crate::format::index::{encode_error, write_index};
use crate::format::record::{Record, ValidityClass};
use crate::range::{Coder, Counter, Encoder};
use crate::table::BrdfTable;

/// A file but for its metadata.
pub(super) struct Packed {
    pub(super) log_rms: f64,
    pub(super) log_max: f64,
    grid: Vec<u8>,
    coding: Vec<u8>,
    partition: Vec<u8>,
    probabilities: Vec<u8>,
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

/// Codes a record's masks and coefficients.
fn code_record<C: Coder>(
    coder: &mut C,
    header: &Header,
    block: &Block,
    masks: &mut [bool],
    class: ValidityClass,
    coefficients: &[i32],
    walk: &mut Walk,
) {
    if class == ValidityClass::None {
        return;
    }
    header.mask_model().code(coder, entropy::CONTEXTS, block, masks);
    let coded = walk.code(coder, block.shape, &mut coefficients.to_vec(), &mut Vec::new());
    debug_assert!(coded.is_ok(), "the quantiser bounds the coefficients");
}

/// Codes the blocks, decodes them again and measures what came back.
pub(super) fn pack(table: &BrdfTable, coding: Coding, partition: Partition, blocks: &[Quantized]) -> Result<Packed> {
    let place = |number: usize| partition.block(number).expect("one entry a block");
    let flat = Header::new(table.grid().clone(), coding.clone(), partition.clone(), vec![1 << 15; CONTEXTS]);
    let means: Vec<i32> = blocks.iter().flat_map(|b| b.means.iter().map(|mean| mean.unwrap_or(0))).collect();
    let components = table.grid().channels().len();
    let classified: Vec<(ValidityClass, Vec<bool>)> = (0..blocks.len())
        .into_par_iter()
        .map(|number| {
            let block = place(number);
            classify(&flat, &block, &gather_log(table, &block, coding.eps).1)
        })
        .collect();

    let counter = (0..blocks.len())
        .into_par_iter()
        .fold(
            || (Counter::new(CONTEXTS), Walk::default()),
            |(mut counter, mut walk), number| {
                let (class, mut masks) = classified[number].clone();
                code_record(
                    &mut counter,
                    &flat,
                    &place(number),
                    &mut masks,
                    class,
                    &blocks[number].coefficients,
                    &mut walk,
                );
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
    let header = Header::new(table.grid().clone(), coding.clone(), partition.clone(), counter.probabilities());

    let coded: Vec<(Vec<u8>, BlockError)> = (0..blocks.len())
        .into_par_iter()
        .map_init(
            || (Walk::default(), Scratch::default()),
            |(walk, scratch), number| {
                let block = place(number);
                let (class, mut masks) = classified[number].clone();
                let mut coder = Encoder::new(&header.probabilities);
                code_record(&mut coder, &header, &block, &mut masks, class, &blocks[number].coefficients, walk);
                let coded = coder.finish();
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
    let lengths: Vec<u32> = coded.iter().map(|(record, _)| record.len() as u32).collect();
    let errors: Vec<(u8, u8)> = coded.iter().map(|(_, e)| (encode_error(rms(e)), encode_error(e.max))).collect();
    Ok(Packed {
        log_rms: rms(&total),
        log_max: total.max,
        grid: write_grid(&header.grid),
        coding: write_coding(&header.coding),
        partition: write_partition(&header.partition, header.grid.axes().len()),
        probabilities: write_probabilities(&header.probabilities),
        index: write_index(&lengths, &errors, &means),
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
        write_file(&[
            (directory::GRID, false, self.grid),
            (directory::CODING, false, self.coding),
            (directory::PARTITION, false, self.partition),
            (directory::PROBABILITIES, false, self.probabilities),
            (directory::INDEX, false, self.index),
            (directory::METADATA, true, metadata.to_vec()),
            (directory::RECORDS, false, self.records),
        ])
    }
}
