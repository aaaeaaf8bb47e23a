//! The arguments of `csbrdf plan`.

use std::path::PathBuf;

use clap::Args;

use super::headings::OUTPUT;
use super::values::{List, lengths, ratio};

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf plan -o list.csv                              5 % of the bins
  csbrdf plan --sampling 1% --valid chrome.csbrdf -o list.csv";

/// Arguments of `plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// Share of the bins to measure: 0 to 1, or with %
    #[arg(long, visible_alias = "ratio", value_name = "RATIO", default_value = "5%", value_parser = ratio)]
    pub sampling: f64,
    /// Seed of the draw
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Block lengths along theta_h, theta_d, phi_d: the draw is block by block, that of encode with the same lengths
    #[arg(long, visible_alias = "block-shape", value_name = "I,J,K", default_value = "15,15,15", value_parser = lengths)]
    pub block: List,
    /// Bins of phi_d: 180, or 360 without reciprocity [default: as the table given, else 180]
    #[arg(long, value_name = "BINS", value_parser = ["180", "360"])]
    pub grid: Option<String>,
    /// Only bins that this table has: a MERL .binary table or a .csbrdf file
    #[arg(long, value_name = "TABLE")]
    pub valid: Option<PathBuf>,
    /// Add the values of this table, -1 where it has none, as if they had been measured
    #[arg(long, value_name = "TABLE")]
    pub fill: Option<PathBuf>,
    /// Output file, - for standard output, the default. CSV: bins, angles in degrees, unit vectors with z along the normal
    #[arg(help_heading = OUTPUT, short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Replace the file if it exists
    #[arg(help_heading = OUTPUT, long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(help_heading = OUTPUT, long)]
    pub replace_source: bool,
}
