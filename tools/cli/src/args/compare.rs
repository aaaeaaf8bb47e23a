//! The arguments of `csbrdf compare`.

use std::path::PathBuf;

use clap::Args;

use super::headings::OUTPUT;
use super::values::positive;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf compare chrome.binary chrome.csbrdf --png difference.png";

/// Arguments of `compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The reference: a MERL .binary table or a .csbrdf file
    #[arg(value_name = "A")]
    pub reference: PathBuf,
    /// The other table
    #[arg(value_name = "B")]
    pub other: PathBuf,
    /// One JSON object; a ratio that is infinite, of equal tables, is null
    #[arg(long)]
    pub json: bool,
    /// Constant in the log error ln(b + eps) - ln(a + eps), 1/sr
    #[arg(long, default_value_t = csbrdf::assess::metrics::DEFAULT_EPS, value_parser = positive::<f64>)]
    pub eps: f64,
    /// Pixels across the pictures of the materials; 0 for none
    #[arg(long, value_name = "SIZE", default_value_t = 128, value_parser = clap::value_parser!(u16).range(0..=2048))]
    pub render: u16,
    /// Write a picture: reference, other, difference times 8, side by side
    #[arg(help_heading = OUTPUT, long, value_name = "OUT")]
    pub png: Option<PathBuf>,
    /// Replace the picture if it exists
    #[arg(help_heading = OUTPUT, long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(help_heading = OUTPUT, long)]
    pub replace_source: bool,
}
