//! The arguments of `csbrdf report`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::headings::OUTPUT;
use super::values::ratio;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf report chrome.binary --grid quick
  csbrdf report chrome.binary --encode \"--effort thorough\" --out chrome-report";

/// Arguments of `report`.
///
/// Writes report.html, report.csv and traces.csv. Encode seconds are of one run without reading and writing, decode
/// seconds the best of five of the whole table from memory, both on all threads: compare them within one report.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// MERL .binary tables
    #[arg(required = true, value_name = "TABLE")]
    pub tables: Vec<PathBuf>,
    /// Settings to try
    #[arg(long, value_enum, default_value_t = GridArg::Full)]
    pub grid: GridArg,
    /// Sampling ratios, with commas between them [default: 1%,5%,20%,50%; quick: 5%,20%]
    #[arg(long, value_name = "RATIOS", value_delimiter = ',', value_parser = ratio)]
    pub ratios: Vec<f64>,
    /// Options of `csbrdf encode` for every point, as one argument
    #[arg(long, value_name = "OPTIONS", default_value = "", hide_default_value = true, allow_hyphen_values = true)]
    pub encode: String,
    /// Blocks to follow the solves of, by number in the partition into 15 x 15 x 15 [default: the smooth, the glossy
    /// and the stiff one, of least, median and greatest log range among the blocks that are valid by half]
    #[arg(long, value_name = "N,N,...", value_delimiter = ',')]
    pub trace_blocks: Vec<usize>,
    /// Most iterations of a followed solve
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub trace_iterations: u32,
    /// Pixels across the picture for render PSNR; 0 for none
    #[arg(long, value_name = "SIZE", default_value_t = 64, value_parser = clap::value_parser!(u16).range(0..=2048))]
    pub render: u16,
    /// Folder for the report, made if it does not exist
    #[arg(help_heading = OUTPUT, long, short, value_name = "DIR", default_value = "csbrdf-report")]
    pub out: PathBuf,
    /// Replace the files of an earlier report
    #[arg(help_heading = OUTPUT, long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(help_heading = OUTPUT, long)]
    pub replace_source: bool,
}

/// `--grid`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum GridArg {
    /// Presets, sampling ratios, bases, block shapes, tolerances: minutes a table
    Full,
    /// Presets and a few points of the rest
    Quick,
}
