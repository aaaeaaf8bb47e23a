//! The arguments of `csbrdf eval`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::headings::OUTPUT;
use super::values::numbers;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf eval chrome.csbrdf --angles 30,0,35,180       theta_i, phi_i, theta_o, phi_o in degrees
  csbrdf eval chrome.csbrdf --wi 0.3,0,0.9 --wo=-0.5,0.1,0.8
  csbrdf eval chrome.csbrdf --pairs pairs.txt --trace scene.trace";

/// Arguments of `eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// A .csbrdf file
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// Direction to the light: x, y along the surface, z along its normal, of any length
    #[arg(long, value_name = "X,Y,Z", requires = "wo", allow_hyphen_values = true, value_parser = numbers::<3>)]
    pub wi: Option<[f64; 3]>,
    /// Direction to the viewer
    #[arg(long, value_name = "X,Y,Z", requires = "wi", allow_hyphen_values = true, value_parser = numbers::<3>)]
    pub wo: Option<[f64; 3]>,
    /// The two directions as theta_i,phi_i,theta_o,phi_o in degrees, theta from the normal
    #[arg(long, value_name = "TI,PI,TO,PO", allow_hyphen_values = true, conflicts_with_all = ["wi", "wo", "pairs"],
          value_parser = numbers::<4>)]
    pub angles: Option<[f64; 4]>,
    /// Pairs of directions from a file, - for standard input: wi and wo, six numbers a line. The default if no
    /// direction is given
    #[arg(long, value_name = "PAIRS", conflicts_with_all = ["wi", "wo"])]
    pub pairs: Option<PathBuf>,
    /// How to read between the centres of the bins
    #[arg(long, value_enum, default_value_t = LookupArg::Linear)]
    pub lookup: LookupArg,
    /// One JSON object a pair, one a line
    #[arg(long)]
    pub json: bool,
    /// The mean of a block in place of an error where the block was pruned
    #[arg(long)]
    pub coarse: bool,
    /// Write which blocks were looked at, for `csbrdf prune`
    #[arg(help_heading = OUTPUT, long, value_name = "TRACE")]
    pub trace: Option<PathBuf>,
    /// Replace the trace if it exists
    #[arg(help_heading = OUTPUT, long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(help_heading = OUTPUT, long)]
    pub replace_source: bool,
}

/// `--lookup`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LookupArg {
    /// The value of the bin, as MERL's own reader does
    Nearest,
    /// Interpolated
    Linear,
}
