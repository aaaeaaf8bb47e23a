//! The search for the quantiser step that keeps a contract at the least cost.
//!
//! A trial is one encode at one step; everything it says is measured on what the decoder gives. The file that a search
//! settles on is decoded once more as a whole and compared with the table ([`crate::assess::proof`]) before it is given out.

use super::Encoded;
use super::contract::{Contract, Figures};
use super::job::{Job, Trial};
use super::prepare::Prepared;
use super::progress::Progress;
use super::search::{Missed, least, nearest};
use super::settings::{Blocks, Encoder};
use crate::assess::proof::{PICTURE, prove};
use crate::assess::render::{Image, psnr, sphere_of_table};
use crate::base::error::{Error, Result};
use crate::decode::Reader;
use crate::base::limits::STEP_RANGE;
use crate::table::Table;
use crate::table::block::Partition;

/// How near a search comes to what was asked before it is content, in nepers: 2 % of an error or size, 0.2 dB.
const TOLERANCE: f64 = 0.02;

/// A step chosen anew for a partition if it is further than this from the one that the partition was chosen for.
const FAR: f32 = 3.0;

/// Trials at steps that a search chooses.
struct Trials<'a> {
    encoder: &'a Encoder,
    contract: Contract,
    prepared: &'a Prepared<'a>,
    progress: Progress<'a>,
    /// The picture of the table, if the contract is about pictures.
    reference: Option<Image>,
    /// The partition chosen last, and the step that it was chosen for.
    partition: Option<(Partition, f32)>,
    done: i32,
}

impl Trials<'_> {
    /// One encode at a step, and how far its figures are beyond the contract.
    fn at(&mut self, step: f32) -> Result<(Encoded, f64)> {
        let mut settings = Encoder { step, ..self.encoder.clone() };
        if let Some((chosen, at)) = &self.partition
            && (1.0 / FAR..FAR).contains(&(step / at))
        {
            settings.blocks = Blocks::Partition(chosen.clone());
        }
        // The number of trials is not known: the first gets half, each further one half of the rest.
        let (before, share) = (1.0 - 0.5f64.powi(self.done), 0.5f64.powi(self.done + 1));
        let job = Job { settings, prepared: self.prepared };
        let trial = job.run(self.progress.part(before, before + share))?;
        self.done += 1;
        if !matches!(&job.settings.blocks, Blocks::Partition(_)) {
            self.partition = Some((trial.partition.clone(), step));
        }
        let (encoded, figures) = measure(&job.settings, self.contract, trial, self.reference.as_ref())?;
        Ok((encoded, self.contract.excess(&figures)))
    }

    /// The same, with the logarithm of the file's bytes for the excess.
    fn size_at(&mut self, step: f32) -> Result<(Encoded, f64)> {
        let (encoded, _) = self.at(step)?;
        let bytes = encoded.bytes.len() as f64;
        Ok((encoded, bytes.ln()))
    }
}

/// Encodes so that the contract is kept.
pub(super) fn fulfil(
    encoder: &Encoder,
    contract: Contract,
    prepared: &Prepared,
    progress: Progress,
) -> Result<Encoded> {
    let pictured = matches!(contract, Contract::Psnr(_));
    let reference = pictured.then(|| sphere_of_table(prepared.table, PICTURE));
    let mut trials = Trials { encoder, contract, prepared, progress, reference, partition: None, done: 0 };
    let asked = contract.asked();
    let within = |step: f64| (step as f32).clamp(*STEP_RANGE.start(), *STEP_RANGE.end());
    let mut trial = |step| trials.at(step);
    let found = match contract {
        Contract::MaxError(_) => least(within(FIRST_STEP * asked), &mut |step| trials.size_at(step)),
        // The rms error of a table with little noise is a tenth of the step.
        Contract::Rmse(_) => nearest(within(11.0 * asked), 1.0, TOLERANCE, &mut trial),
        Contract::Psnr(_) => nearest(encoder.step, 1.0, TOLERANCE, &mut trial),
        Contract::Size(_) | Contract::Ratio(_) => nearest(encoder.step, -1.0, TOLERANCE, &mut trial),
    };
    let encoded = found.map_err(|missed| missed_error(contract, missed))?;
    confirm(contract, prepared.table, &encoded)?;
    progress.reach(1.0);
    Ok(encoded)
}

/// What a search that kept nothing says.
fn missed_error(contract: Contract, missed: Missed) -> Error {
    let (excess, step, trials) = match missed {
        Missed::Failed(error) => return error,
        Missed::Best { excess, step, trials } => (excess, step, trials),
    };
    let asked = contract.asked();
    let best = match contract {
        Contract::Psnr(_) => asked - excess * 20.0 / std::f64::consts::LN_10,
        Contract::Ratio(_) => asked * (-excess).exp(),
        _ => asked * excess.exp(),
    };
    Error::ContractNotMet(format!(
        "{} cannot be kept: the best of {trials} encodes reaches {}, at step {step}",
        contract.phrase(asked),
        contract.phrase(best)
    ))
}

/// Step of the first trial in largest errors.
const FIRST_STEP: f64 = 5.0;

/// Finishes a trial and measures what its contract is about.
fn measure(
    settings: &Encoder,
    contract: Contract,
    trial: Trial,
    reference: Option<&Image>,
) -> Result<(Encoded, Figures)> {
    let report = &trial.report;
    let mut figures =
        Figures { bytes: 0, entries: report.entries, log_rms: report.log_rms, log_max: report.log_max, psnr: None };
    if let Some(reference) = reference {
        let table = Reader::open(settings.finish(&trial, None)?)?.decode_table()?;
        figures.psnr = Some(psnr(reference, &sphere_of_table(&table, PICTURE))?);
    }
    let achieved = match contract {
        Contract::Size(_) | Contract::Ratio(_) => None,
        _ => Some(contract.figure(&figures)).filter(|figure| figure.is_finite()),
    };
    let bytes = settings.finish(&trial, Some(contract.to_json(achieved)))?;
    figures.bytes = bytes.len() as u64;
    Ok((Encoded { bytes, report: trial.report }, figures))
}

/// The promise, checked on the finished bytes by the reader that users have.
fn confirm(contract: Contract, table: &Table, encoded: &Encoded) -> Result<()> {
    let reader = Reader::open(&encoded.bytes[..])?;
    if let Some(damage) = reader.verify().into_iter().next() {
        return Err(damage);
    }
    let proof = prove(table, &reader)?;
    if proof.contract != Some(contract) || !proof.broken.is_empty() {
        let what = proof.broken.first().cloned().unwrap_or_else(|| "the file does not state it".into());
        return Err(Error::ContractNotMet(format!("{}: {what}", contract.phrase(contract.asked()))));
    }
    Ok(())
}
