//! What an encode achieved.

use super::contract::Figures;
use crate::base::limits::Limits;

/// A finished file and how it came about.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Encoded {
    /// The bytes of the file.
    pub bytes: Vec<u8>,
    /// Sizes, errors and cost.
    pub report: Report,
}

/// What an encode achieved, measured with the decoder, and what it cost.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Report {
    /// Entries of all channels.
    pub entries: usize,
    /// Valid ones among them.
    pub valid: usize,
    /// Sampled ones among these.
    pub sampled: usize,
    /// Entries that were corrected, to keep a largest error.
    pub corrected: usize,
    /// The step that was asked for, or that a contract led to ([`Encoder::quality`](crate::Encoder::quality)). With dependent
    /// quantisation the file's own is 0.65 of it.
    pub step: f32,
    /// Blocks.
    pub blocks: usize,
    /// Root mean square error of ln(f + eps) over the valid entries.
    pub log_rms: f64,
    /// Largest error of ln(f + eps) over the valid entries.
    pub log_max: f64,
    /// l1 problems solved, their iterations, and how many ended above sigma.
    pub solves: usize,
    /// Iterations of all solves.
    pub iterations: usize,
    /// Solves that ended above their sigma.
    pub missed_sigma: usize,
    /// Wall seconds of the whole encode.
    pub seconds: f64,
}

impl Report {
    /// The number of values that readers must be allowed ([`Limits::table_values`], `csbrdf --limit`) to decode the file as a whole;
    /// `None` where they allow it by default.
    pub fn needs_limit(&self) -> Option<usize> {
        (self.entries > Limits::default().table_values).then_some(self.entries)
    }
}

impl Encoded {
    /// What contracts are about; without a render PSNR, which takes pictures.
    pub fn figures(&self) -> Figures {
        let Report { entries, log_rms, log_max, .. } = self.report;
        Figures { bytes: self.bytes.len() as u64, entries, log_rms, log_max, psnr: None }
    }
}
