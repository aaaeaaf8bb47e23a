//! The arguments of `csbrdf prune`.

use std::path::PathBuf;

use clap::Args;

use super::headings::OUTPUT;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf prune chrome.csbrdf --trace scene.trace       chrome.pruned.csbrdf, the blocks of a scene
  csbrdf prune spectral.csbrdf --channels 550nm,560nm";

/// Arguments of `prune`.
#[derive(Debug, Args)]
pub struct PruneArgs {
    /// A .csbrdf file, or - for standard input
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// Which blocks to keep, as `csbrdf render --trace` or `csbrdf eval --trace` wrote it; several are joined [default: all,
    /// with --channels]
    #[arg(long, required_unless_present = "channels", value_name = "TRACE")]
    pub trace: Vec<PathBuf>,
    /// Channels to keep, by the names that `csbrdf info` shows, or by number from 0 where none has that name. They stay bit for
    /// bit, so the file must have its channels coded each alone: as all but three are, or by encode --channels separate
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub channels: Vec<String>,
    /// Rms error, in ln(f + eps), that each block may gain by losing its finest detail
    #[arg(long, value_name = "E", default_value_t = 0.0)]
    pub detail: f64,
    /// Output file, - for standard output; if not given, the input's name with .pruned.csbrdf, beside it
    #[arg(help_heading = OUTPUT, short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Replace the file if it exists
    #[arg(help_heading = OUTPUT, long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(help_heading = OUTPUT, long)]
    pub replace_source: bool,
}
