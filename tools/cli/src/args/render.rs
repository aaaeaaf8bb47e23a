//! The arguments of `csbrdf render`.

use std::path::PathBuf;

use clap::Args;

use super::headings::OUTPUT;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf render chrome.csbrdf                          chrome.png, a ball
  csbrdf render chrome.csbrdf felt.csbrdf -o scene.png --trace chrome.trace --trace felt.trace";

/// Arguments of `render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// One .csbrdf file for a ball, two for a ball and a ring on a floor
    #[arg(required = true, num_args = 1..=2, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Pixels down; across as many for a ball, five thirds of them for the scene
    #[arg(long, value_name = "SIZE", default_value_t = 256, value_parser = clap::value_parser!(u16).range(1..=2048))]
    pub size: u16,
    /// Samples a pixel, of two directions each
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub samples: u16,
    /// Seed of the samples
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// The mean of a block in place of an error where the block was pruned
    #[arg(long)]
    pub coarse: bool,
    /// Output file (PNG), - for standard output; if not given, the first input's name with .png, beside it
    #[arg(help_heading = OUTPUT, short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Write which blocks of a file were looked at, for `csbrdf prune`; once for each file
    #[arg(help_heading = OUTPUT, long, value_name = "TRACE")]
    pub trace: Vec<PathBuf>,
    /// Replace files that exist
    #[arg(help_heading = OUTPUT, long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(help_heading = OUTPUT, long)]
    pub replace_source: bool,
}
