//! The arguments of `csbrdf encode`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::headings::{EXPERT, KEEP, OUTPUT, QUALITY, SAMPLES};
use super::values::{List, key_value, lengths, not_negative, positive, ratio, size};

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf encode chrome.binary                          chrome.csbrdf, some one per cent of error
  csbrdf encode chrome.binary --rmse 0.02              as small as that error allows
  csbrdf encode chrome.binary --max-error 0.05         a bound on every entry
  csbrdf encode chrome.binary --size 20k               as good as fits
  csbrdf encode chrome.binary --lossless               every bit comes back
  csbrdf encode brdfs --out-dir set                    a folder of tables, with a manifest
  csbrdf encode --samples list.csv -o chrome.csbrdf    from few measurements, see csbrdf plan";

/// Arguments of `encode`.
#[derive(Debug, Args)]
pub struct EncodeArgs {
    /// MERL .binary tables, folders of them (not those in folders within), or - for standard input
    #[arg(required_unless_present = "samples", conflicts_with = "samples", value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// Settings to start from; the options below change them [default: archive, or sparse with --samples]
    #[arg(help_heading = QUALITY, long, value_enum)]
    pub preset: Option<PresetArg>,
    /// Quantiser step in the log domain: smaller is better and larger [default: the preset's, 0.1]
    #[arg(help_heading = QUALITY, long, value_name = "STEP", value_parser = positive::<f32>)]
    pub quality: Option<f32>,
    /// How long an encode of all valid entries may take for fewer bytes [default: standard]
    #[arg(help_heading = QUALITY, long, value_enum)]
    pub effort: Option<EffortArg>,
    /// The same as --effort fast
    #[arg(help_heading = QUALITY, long, conflicts_with = "effort")]
    pub fast: bool,
    /// Keep every valid entry's ln(f + eps) within this: what the coefficients leave further off is corrected entry by
    /// entry. Of the values in float64, as decode writes them to .binary; float32 ones add some 1e-7 of f
    #[arg(help_heading = QUALITY, long, value_name = "E", value_parser = positive::<f64>, conflicts_with = "quality", group = "contract")]
    pub max_error: Option<f64>,
    /// Keep the rms error of ln(f + eps) over the valid entries within this, as near below as a few encodes come. With
    /// --sampling auto: rms error to sample for, log domain
    #[arg(help_heading = QUALITY, long, value_name = "RMS", value_parser = positive::<f64>, required_if_eq("sampling", "auto"), group = "contract")]
    pub rmse: Option<f64>,
    /// Keep the render PSNR, as compare measures it, at this or above, dB
    #[arg(help_heading = QUALITY, long, value_name = "DB", value_parser = positive::<f64>, conflicts_with = "quality", group = "contract")]
    pub psnr: Option<f64>,
    /// Keep the file at most this part of the table's bytes in float64: 300 for 300:1
    #[arg(help_heading = QUALITY, long, value_name = "R", value_parser = positive::<f64>, conflicts_with = "quality", group = "contract")]
    pub ratio: Option<f64>,
    /// Keep the file within this size: bytes, or with k or M thousands or millions of them
    #[arg(help_heading = QUALITY, long, value_name = "BYTES[k|M]", value_parser = size, conflicts_with = "quality", group = "contract")]
    pub size: Option<u64>,
    /// Also keep what restores every bit of the table, missing entries included, for decode --exact: for archives, half
    /// the table's size and more where its values have many digits
    #[arg(help_heading = KEEP, long, conflicts_with_all = ["size", "ratio"])]
    pub lossless: bool,
    /// Also keep a second copy of what no block can be decoded without, some 2 to 4 kB, for decode --salvage and repair.
    /// --lossless files always have it
    #[arg(help_heading = KEEP, long)]
    pub spare: bool,
    /// Metadata to store, repeatable: name, uuid, version, instrument, date, licence, copyright, author, source, or any
    /// other key
    #[arg(help_heading = KEEP, long, value_name = "KEY=VALUE", value_parser = key_value)]
    pub meta: Vec<(String, String)>,
    /// A list of measurements in place of a table, or - for standard input: CSV as of `csbrdf plan` with columns r, g, b in
    /// 1/sr. All of it is sampled, all else filled in
    #[arg(help_heading = SAMPLES, long, value_name = "FILE", conflicts_with_all = ["sampling", "seed"])]
    pub samples: Option<PathBuf>,
    /// Bins of phi_d of the list: 180, or 360 without reciprocity [default: as the list's first line says, else 180]
    #[arg(help_heading = SAMPLES, long, value_name = "BINS", value_parser = ["180", "360"], conflicts_with = "inputs")]
    pub grid: Option<String>,
    /// Share of the entries to sample: 0 to 1, or with %; or auto: in each block as many as --rmse needs [default: the
    /// preset's]
    #[arg(help_heading = SAMPLES, long, value_name = "RATIO|auto", value_parser = sampling)]
    pub sampling: Option<SamplingArg>,
    /// Seed of the sampling
    #[arg(help_heading = SAMPLES, long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Output file, - for standard output; if not given, the input's name with .csbrdf, beside it
    #[arg(help_heading = OUTPUT, short, long, value_name = "OUT", conflicts_with = "out_dir")]
    pub output: Option<PathBuf>,
    /// Folder for the outputs, made if it does not exist; needed if an input is a folder
    #[arg(help_heading = OUTPUT, long, value_name = "DIR")]
    pub out_dir: Option<PathBuf>,
    /// Write manifest.json into --out-dir, with the hashes, sources and errors of the files: for `csbrdf verify` and
    /// `csbrdf info`. Always if an input is a folder. A set that was interrupted is gone on with: what is finished is kept
    #[arg(help_heading = OUTPUT, long, requires = "out_dir", conflicts_with = "samples")]
    pub manifest: bool,
    /// Tables to encode at a time, some 100 to 300 MB each. The result does not depend on it [default: as many as
    /// threads, at most 4]
    #[arg(help_heading = OUTPUT, long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub jobs: Option<u16>,
    /// Replace files that exist. Of a set, make again all but what an interrupted run with these settings has finished
    #[arg(help_heading = OUTPUT, long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(help_heading = OUTPUT, long)]
    pub replace_source: bool,
    /// Basis of the coefficients [default: the preset's]
    #[arg(help_heading = EXPERT, long, value_enum)]
    pub basis: Option<BasisArg>,
    /// Block lengths along theta_h, theta_d, phi_d [default: the preset's]
    #[arg(help_heading = EXPERT, long, visible_alias = "block-shape", value_name = "I,J,K", value_parser = lengths)]
    pub block: Option<List>,
    /// Constant of the tone map ln(f + eps), 1/sr [default: the preset's]
    #[arg(help_heading = EXPERT, long, value_parser = positive::<f64>)]
    pub eps: Option<f64>,
    /// Rms residual that the recovery may leave at the samples, log domain [default: the preset's]
    #[arg(help_heading = EXPERT, long, value_parser = not_negative)]
    pub sigma: Option<f64>,
    /// Most iterations of one solve of the recovery [default: the preset's]
    #[arg(help_heading = EXPERT, long, value_name = "N")]
    pub iterations: Option<u32>,
    /// Exponent p of the weights (1 + |k|)^p on the coefficients in the recovery, 0 to 4 [default: the preset's]
    #[arg(help_heading = EXPERT, long, value_name = "P", value_parser = not_negative)]
    pub weighting: Option<f64>,
    /// Colour channels alone, or red, green and blue together [default: the preset's]
    #[arg(help_heading = EXPERT, long, value_enum)]
    pub channels: Option<ChannelsArg>,
}

impl EncodeArgs {
    /// The preset given, or the usual one of what is encoded.
    pub fn preset(&self) -> PresetArg {
        let usual = if self.samples.is_some() { PresetArg::Sparse } else { PresetArg::Archive };
        self.preset.unwrap_or(usual)
    }
}

/// `--effort`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum EffortArg {
    /// A few block shapes, holes filled in few steps
    Fast,
    /// Block shapes by tile
    Standard,
    /// The same with more steps wherever holes are filled
    Thorough,
}

/// `--preset`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PresetArg {
    /// Every valid entry is a sample, DCT
    Archive,
    /// The source paper's: 5 % of the entries, DFT, 15 x 15 x 15 blocks
    Paper,
    /// 5 % of the entries, recovered as well as is known: trend of the whole table, weighted DCT
    Sparse,
}

/// `--sampling`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SamplingArg {
    Ratio(f64),
    Auto,
}

fn sampling(text: &str) -> Result<SamplingArg, String> {
    if text == "auto" { Ok(SamplingArg::Auto) } else { ratio(text).map(SamplingArg::Ratio) }
}

/// `--basis`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BasisArg {
    /// Discrete cosine transform, type II
    Dct,
    /// Discrete Fourier transform
    Dft,
}

/// `--channels`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ChannelsArg {
    /// Each channel alone
    Separate,
    /// Brightness and two colour differences
    Opponent,
}
