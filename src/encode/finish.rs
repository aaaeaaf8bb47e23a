//! The last stage: metadata and sections make the file.

use serde_json::{Value, json};

use super::job::Trial;
use super::settings::Encoder;
use crate::base::error::Result;
use crate::codec::sample::Sampling;
use crate::format::metadata::Metadata;

impl Encoder {
    /// The bytes of a trial's file, with what it says of its contract.
    pub(super) fn finish(&self, trial: &Trial, contract: Option<Value>) -> Result<Vec<u8>> {
        let spare = self.spare.unwrap_or(self.lossless);
        Ok(trial.packed.finish(&self.describe(trial, contract)?.write()?, spare))
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
}
