//! The encoder: table in, bytes of a file out (spec section 6).
//!
//! [`Encoder`] holds settings. An encode goes through these stages; where a contract is to be kept, all but the first run once for
//! each step that the search tries:
//!
//! | stage | file | what it does |
//! | --- | --- | --- |
//! | prepare | `prepare`, `full` | channel transform and horizon; with every valid entry a sample: logarithms, grazing profile, guesses for holes |
//! | partition | `partition`, `full/tiles`, `sparse/shape` | cuts the grid into blocks |
//! | fit | `sparse`, `sparse/estimate`, `sparse/trend` | from few samples: a trend over the table, windows by l1 recovery |
//! | quantise | `full/quantise`, `full/trellis`; `sparse/quantise` | coefficients of each block as integers |
//! | code | `code`, `bound` | corrections, contexts, records; each is decoded again and measured |
//! | finish | `finish` | metadata and sections |
//!
//! `job` runs them in this order. `fulfil` and `search` look for the step that keeps a contract, and prove it on the finished bytes.
//! `l1` holds the solvers, `solver_log` follows them.

mod bound;
mod code;
pub mod contract;
mod effort;
mod finish;
mod fulfil;
mod full;
mod gather;
mod job;
pub mod l1;
mod partition;
mod prepare;
mod progress;
mod quantised;
mod report;
mod search;
mod settings;
mod sparse;
#[cfg(any(test, feature = "unstable"))]
pub mod solver_log;

use std::time::Instant;

use crate::base::error::{Error, Result};
use crate::table::Table;
pub(crate) use code::{classify, fit_probabilities};
pub use effort::Effort;
use job::Job;
use prepare::Prepared;
use progress::Progress;
pub use report::{Encoded, Report};
pub use settings::{ChannelCoding, Encoder, Preset};

impl Encoder {
    /// Encodes a table. The same table, settings and seed give the same bytes, whatever the number of threads. (On
    /// another kind of machine the transforms may round differently; what a file decodes to is the same everywhere.)
    ///
    /// Missing entries are filled by the same recovery and stay marked as missing.
    ///
    /// # Errors
    /// `InvalidArgument` if a setting is out of range or no entry is valid; `ContractNotMet` if the contract cannot be
    /// kept, with the best that was reached.
    pub fn encode(&self, table: &Table) -> Result<Encoded> {
        self.encode_with(table, &|_| {})
    }

    /// As [`Encoder::encode`]; `progress` is called with the share of the work done, 0 to 1, from any thread.
    pub fn encode_with(&self, table: &Table, progress: &(dyn Fn(f64) + Sync)) -> Result<Encoded> {
        let start = Instant::now();
        self.check()?;
        if !table.valid().contains(&true) {
            return Err(Error::InvalidArgument(
                "the table has no valid entry: all are negative, NaN or infinite; nothing to encode".into(),
            ));
        }
        let progress = Progress::new(progress);
        let prepared = Prepared::new(self, table)?;
        let mut encoded = match self.contract {
            Some(contract) => fulfil::fulfil(self, contract, &prepared, progress)?,
            None => {
                let trial = Job { settings: self.clone(), prepared: &prepared }.run(progress)?;
                Encoded { bytes: self.finish(&trial, None)?, report: trial.report }
            }
        };
        encoded.report.seconds = start.elapsed().as_secs_f64();
        Ok(encoded)
    }
}

#[cfg(test)]
mod tests;
