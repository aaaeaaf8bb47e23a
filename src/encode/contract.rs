//! What a file must keep, and the search for the quantiser step that keeps it at the least cost.
//!
//! A trial is one encode at one step; everything it says is measured on what the decoder gives. The file that a search
//! settles on is decoded once more as a whole and compared with the table ([`crate::assess::proof`]) before it is given out.

use serde_json::{Value, json};

use super::search::{Missed, least, nearest};
use super::{Blocks, Encoded, Encoder, Trial};
use crate::assess::proof::{PICTURE, prove};
use crate::assess::render::{Image, psnr, sphere_of_table};
use crate::base::error::{Error, Result};
use crate::decode::Reader;
use crate::format::STEP_RANGE;
use crate::table::BrdfTable;

/// What a file keeps, whatever the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Contract {
    /// No valid entry's ln(f + eps) is off by more than this; entries that the coefficients leave further off are
    /// corrected one by one. Of the binary64 values: a binary32 one adds its own rounding, some 1e-7 of f.
    MaxError(f64),
    /// Rms error of ln(f + eps) over the valid entries at most this.
    Rmse(f64),
    /// Render PSNR at least this, dB: of a lit sphere 128 pixels across, as [`crate::assess::render`] shows it.
    Psnr(f64),
    /// At most so many bytes, and as good as fits.
    Size(u64),
    /// At most the bytes of the table in binary64 over this, and as good as fits.
    Ratio(f64),
}

/// The figures of a file that contracts are about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Bytes.
    pub bytes: u64,
    /// Entries of the table, all channels.
    pub entries: usize,
    /// Rms error of ln(f + eps) over the valid entries.
    pub log_rms: f64,
    /// Largest error of ln(f + eps) over the valid entries.
    pub log_max: f64,
    /// Render PSNR in dB; `None` if it was not measured.
    pub psnr: Option<f64>,
}

impl Contract {
    /// The figure that the contract is about, of a file's figures.
    pub fn figure(self, figures: &Figures) -> f64 {
        match self {
            Contract::MaxError(_) => figures.log_max,
            Contract::Rmse(_) => figures.log_rms,
            Contract::Psnr(_) => figures.psnr.unwrap_or(f64::NEG_INFINITY),
            Contract::Size(_) => figures.bytes as f64,
            Contract::Ratio(_) => 8.0 * figures.entries as f64 / figures.bytes.max(1) as f64,
        }
    }

    /// What was asked for.
    pub fn asked(self) -> f64 {
        match self {
            Contract::MaxError(x) | Contract::Rmse(x) | Contract::Psnr(x) | Contract::Ratio(x) => x,
            Contract::Size(bytes) => bytes as f64,
        }
    }

    /// Whether figures keep the contract.
    pub fn kept(self, figures: &Figures) -> bool {
        match self {
            Contract::Psnr(_) | Contract::Ratio(_) => self.figure(figures) >= self.asked(),
            _ => self.figure(figures) <= self.asked(),
        }
    }

    /// How far figures are beyond the contract, in nepers of error or bytes: kept up to 0.
    fn excess(self, figures: &Figures) -> f64 {
        let ratio = |x: f64| x.max(f64::MIN_POSITIVE).ln();
        let excess = match self {
            Contract::MaxError(_) | Contract::Rmse(_) | Contract::Size(_) => {
                ratio(self.figure(figures)) - ratio(self.asked())
            }
            Contract::Ratio(_) => ratio(self.asked()) - ratio(self.figure(figures)),
            Contract::Psnr(_) => (self.asked() - self.figure(figures)) / (20.0 / std::f64::consts::LN_10),
        };
        // Infinities would stop the search's arithmetic.
        excess.clamp(-30.0, 30.0)
    }

    /// Name in metadata and messages.
    pub fn name(self) -> &'static str {
        match self {
            Contract::MaxError(_) => "max_error",
            Contract::Rmse(_) => "rmse",
            Contract::Psnr(_) => "psnr_db",
            Contract::Size(_) => "bytes",
            Contract::Ratio(_) => "ratio",
        }
    }

    /// As a sentence would name it.
    fn phrase(self, x: f64) -> String {
        match self {
            Contract::MaxError(_) => format!("a largest log error of {x:.4e}"),
            Contract::Rmse(_) => format!("a log rms error of {x:.4e}"),
            Contract::Psnr(_) => format!("a render PSNR of {x:.2} dB"),
            Contract::Size(_) => format!("a size of {x:.0} bytes"),
            Contract::Ratio(_) => format!("a ratio of {x:.2}"),
        }
    }

    /// For the metadata: what was asked and, where it is not the length of the file itself, achieved.
    pub(super) fn to_json(self, achieved: Option<f64>) -> Value {
        let mut value = json!({});
        value[self.name()] = match self {
            Contract::Size(bytes) => bytes.into(),
            _ => self.asked().into(),
        };
        if let Some(achieved) = achieved {
            value["achieved"] = achieved.into();
        }
        value
    }

    /// The contract that metadata state, with the figure achieved.
    pub(crate) fn from_json(value: &Value) -> Option<(Contract, Option<f64>)> {
        let x = |name: &str| value.get(name).and_then(Value::as_f64);
        let contract = (x("max_error").map(Contract::MaxError))
            .or_else(|| x("rmse").map(Contract::Rmse))
            .or_else(|| x("psnr_db").map(Contract::Psnr))
            .or_else(|| value.get("bytes").and_then(Value::as_u64).map(Contract::Size))
            .or_else(|| x("ratio").map(Contract::Ratio))?;
        Some((contract, x("achieved")))
    }

    pub(super) fn check(self) -> Result<()> {
        let asked = self.asked();
        if !(asked.is_finite() && asked > 0.0) {
            return Err(Error::InvalidArgument(format!("{} is {asked}, must be a number above 0", self.name())));
        }
        Ok(())
    }
}

/// How near a search comes to what was asked before it is content, in nepers: 2 % of an error or size, 0.2 dB.
const TOLERANCE: f64 = 0.02;

/// A step chosen anew for a partition if it is further than this from the one that the partition was chosen for.
const FAR: f32 = 3.0;

/// Encodes so that the contract is kept.
pub(super) fn fulfil(
    encoder: &Encoder,
    contract: Contract,
    table: &BrdfTable,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<Encoded> {
    let reference = match contract {
        Contract::Psnr(_) => Some(sphere_of_table(table, PICTURE)),
        _ => None,
    };
    // What does not depend on the step is done once.
    let dense = encoder.dense(table, &encoder.choose_transform(table))?;
    let mut done = 0;
    let mut partition = None;
    let mut trial = |step: f32| -> Result<(Encoded, f64)> {
        let mut settings = Encoder { step, ..encoder.clone() };
        if let Some((chosen, at)) = &partition {
            let far = step / at;
            if (1.0 / FAR..FAR).contains(&far) {
                settings.blocks = Blocks::Partition(Clone::clone(chosen));
            }
        }
        // The number of trials is not known: the first gets half, each further one half of the rest.
        let (before, share) = (1.0 - 0.5f64.powi(done), 0.5f64.powi(done + 1));
        let trial = settings.trial(table, dense.as_ref(), &|now| progress(before + share * now))?;
        done += 1;
        if !matches!(&settings.blocks, Blocks::Partition(_)) {
            partition = Some((trial.partition.clone(), step));
        }
        let (encoded, figures) = measure(&settings, contract, trial, reference.as_ref())?;
        Ok((encoded, contract.excess(&figures)))
    };
    let (steps, asked) = (STEP_RANGE, contract.asked());
    let within = |step: f64| (step as f32).clamp(*steps.start(), *steps.end());
    let found = match contract {
        Contract::MaxError(_) => {
            let mut size = |step| {
                trial(step).map(|(encoded, _)| {
                    let bytes = encoded.bytes.len() as f64;
                    (encoded, bytes.ln())
                })
            };
            least(within(FIRST_STEP * asked), &mut size)
        }
        // The rms error of a table with little noise is a tenth of the step.
        Contract::Rmse(_) => nearest(within(11.0 * asked), 1.0, TOLERANCE, &mut trial),
        Contract::Psnr(_) => nearest(encoder.step, 1.0, TOLERANCE, &mut trial),
        Contract::Size(_) | Contract::Ratio(_) => nearest(encoder.step, -1.0, TOLERANCE, &mut trial),
    };
    let encoded = found.map_err(|missed| match missed {
        Missed::Failed(error) => error,
        Missed::Best { excess, step, trials } => {
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
    })?;
    confirm(contract, table, &encoded)?;
    progress(1.0);
    Ok(encoded)
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
fn confirm(contract: Contract, table: &BrdfTable, encoded: &Encoded) -> Result<()> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contracts_pass_through_metadata() {
        let all = [
            Contract::MaxError(0.05),
            Contract::Rmse(1e-3),
            Contract::Psnr(60.5),
            Contract::Size(1 << 40),
            Contract::Ratio(300.0),
        ];
        for contract in all {
            assert_eq!(Contract::from_json(&contract.to_json(Some(0.5))), Some((contract, Some(0.5))));
            assert_eq!(Contract::from_json(&contract.to_json(None)), Some((contract, None)));
        }
        assert_eq!(Contract::from_json(&json!({"other": 1})), None);
    }

    #[test]
    fn excess_is_above_zero_where_a_contract_is_broken() {
        let figures = Figures { bytes: 1000, entries: 12_500, log_rms: 0.01, log_max: 0.1, psnr: Some(60.0) };
        let cases = [
            (Contract::MaxError(0.1), Contract::MaxError(0.09)),
            (Contract::Rmse(0.01), Contract::Rmse(0.009)),
            (Contract::Psnr(60.0), Contract::Psnr(61.0)),
            (Contract::Size(1000), Contract::Size(999)),
            (Contract::Ratio(100.0), Contract::Ratio(101.0)),
        ];
        for (kept, broken) in cases {
            assert!(kept.kept(&figures) && kept.excess(&figures).abs() < 1e-12, "{kept:?}");
            assert!(!broken.kept(&figures) && broken.excess(&figures) > 0.0, "{broken:?}");
        }
    }
}
