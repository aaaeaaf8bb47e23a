//! What a file must keep.

use serde_json::{Value, json};

use crate::base::error::{Error, Result};

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
    /// At most this many bytes, and as good as fits.
    Size(u64),
    /// At most the bytes of the table in binary64 over this, and as good as fits.
    Ratio(f64),
}

/// The figures of a file that contracts are about.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
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
    pub(super) fn excess(self, figures: &Figures) -> f64 {
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
    pub(super) fn phrase(self, x: f64) -> String {
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
