//! A file against the table that it was made from: what it states about its errors, measured again.

use rayon::prelude::*;

use crate::assess::render::{psnr, spheres_of_tables};
use crate::base::error::{Error, Result};
use crate::codec::tone::tone_map;
use crate::decode::Reader;
use crate::encode::contract::{Contract, Figures};
use crate::table::Table;

/// Pixels across the sphere of render PSNR.
pub const PICTURE: usize = 128;

/// What a comparison with the original has shown.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Proof {
    /// Measured: over the valid entries of the original, after conversion to its units in binary64.
    pub figures: Figures,
    /// The contract that the file states.
    pub contract: Option<Contract>,
    /// Statements of the file that do not hold, one a sentence; empty if all do.
    pub broken: Vec<String>,
}

/// A stated error holds for a measured one: ln and exp of another machine may differ in their last bits.
fn holds(measured: f64, stated: f64) -> bool {
    measured <= stated * (1.0 + 1e-9) + 1e-12
}

/// Decodes the whole table and checks each block's stated errors, the errors in the metadata and the file's contract; of a
/// lossless file also that every bit is restored.
/// Checksums are [`Reader::verify`]'s.
///
/// # Errors
/// `InvalidArgument` if the table has another grid than the file; those of [`Reader::decode_table`].
pub fn prove<D: AsRef<[u8]> + Sync>(original: &Table, reader: &Reader<D>) -> Result<Proof> {
    let grid = reader.grid();
    if grid != original.grid() {
        let shapes = (grid.shape(), original.grid().shape());
        return Err(Error::InvalidArgument(format!(
            "the file's grid {:?} is not the original's {:?}, or axes or channels differ",
            shapes.0, shapes.1
        )));
    }
    let decoded = reader.decode_table()?;
    let mut broken = Vec::new();
    let differ = original.valid().iter().zip(decoded.valid()).filter(|(a, b)| a != b).count();
    if differ > 0 {
        broken.push(format!("{differ} entries are valid in one of the tables only"));
    }
    let (log_rms, log_max) = check_blocks(original, &decoded, reader, &mut broken);
    let mut figures =
        Figures { bytes: reader.len() as u64, entries: original.values().len(), log_rms, log_max, psnr: None };
    if reader.is_lossless() {
        let exact = reader.source_table()?;
        let differ = original.values().iter().zip(&exact).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        if differ > 0 {
            broken.push(format!("{differ} entries are not restored bit by bit"));
        }
    }
    let encoder = reader.metadata()?.encoder.unwrap_or_default();
    for (name, measured) in [("log_rms", figures.log_rms), ("log_max", figures.log_max)] {
        if let Some(stated) = encoder.get(name).and_then(serde_json::Value::as_f64)
            && !holds(measured, stated)
        {
            broken.push(format!("{name} is {measured:.6e}, the metadata state {stated:.6e}"));
        }
    }
    let stated = encoder.get("contract").and_then(Contract::from_json);
    if let Some((contract, achieved)) = stated {
        if matches!(contract, Contract::Psnr(_)) {
            let images = spheres_of_tables(original, &decoded, PICTURE);
            figures.psnr = Some(psnr(&images[0], &images[1])?);
        }
        check_contract(contract, achieved, &figures, &mut broken);
    }
    Ok(Proof { figures, contract: stated.map(|(contract, _)| contract), broken })
}

/// Rms and largest error over the valid entries, and whether each block is within what the index states of it.
fn check_blocks<D: AsRef<[u8]> + Sync>(
    original: &Table,
    decoded: &Table,
    reader: &Reader<D>,
    broken: &mut Vec<String>,
) -> (f64, f64) {
    let blocks: Vec<(f64, f64, usize)> = (0..reader.block_count())
        .into_par_iter()
        .map(|number| block_errors(original, decoded, reader, number))
        .collect();
    let (mut squares, mut count, mut log_max) = (0.0, 0, 0f64);
    let (mut beyond, mut first) = (0, None);
    for (number, &(sum, max, valid)) in blocks.iter().enumerate() {
        let stated = reader.stated_errors(number);
        let rms = (sum / valid.max(1) as f64).sqrt();
        if !holds(rms, stated.0.into()) || !holds(max, stated.1.into()) {
            beyond += 1;
            first.get_or_insert(format!(
                "block {number}: rms {rms:.3e} of {:.3e}, largest {max:.3e} of {:.3e}",
                stated.0, stated.1
            ));
        }
        squares += sum;
        count += valid;
        log_max = log_max.max(max);
    }
    if let Some(first) = first {
        broken.push(format!("{beyond} blocks are further off than the index states ({first})"));
    }
    ((squares / count.max(1) as f64).sqrt(), log_max)
}

/// Whether a file's figures keep its contract, and what its metadata state as achieved.
fn check_contract(contract: Contract, achieved: Option<f64>, figures: &Figures, broken: &mut Vec<String>) {
    let (name, figure) = (contract.name(), contract.figure(figures));
    if !contract.kept(figures) {
        broken.push(format!("the contract is {name} {}, the file has {figure}", contract.asked()));
    }
    let better = |achieved: f64| match contract {
        Contract::Psnr(_) | Contract::Ratio(_) => holds(achieved, figure),
        _ => holds(figure, achieved),
    };
    if let Some(achieved) = achieved.filter(|&achieved| !better(achieved)) {
        broken.push(format!("the metadata state {name} {achieved} as achieved, the file has {figure}"));
    }
}

/// Sum of squared log errors, largest, and number of the valid entries of a block.
fn block_errors<D: AsRef<[u8]>>(
    original: &Table,
    decoded: &Table,
    reader: &Reader<D>,
    number: usize,
) -> (f64, f64, usize) {
    let block = reader.partition().block(number).expect("number is below the count");
    let (n, shape, eps) = (block.positions(), reader.grid().shape(), reader.coding().eps);
    let (mut a, mut b, mut valid) = (vec![0.0; n], vec![0.0; n], vec![false; n]);
    let (mut squares, mut max, mut count) = (0.0, 0f64, 0);
    for (c, channel) in reader.grid().channels().iter().enumerate() {
        block.gather(shape, original.plane(c), &mut a);
        block.gather(shape, decoded.plane(c), &mut b);
        block.gather(shape, original.valid_plane(c), &mut valid);
        for ((a, b), _) in a.iter().zip(&b).zip(&valid).filter(|(_, valid)| **valid) {
            let log = |value: f64| tone_map((value * channel.scale).min(f64::MAX), eps);
            let error = (log(*a) - log(*b)).abs();
            squares += error * error;
            max = max.max(error);
            count += 1;
        }
    }
    (squares, max, count)
}
