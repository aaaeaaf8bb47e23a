//! The arguments of `csbrdf info`.

use std::path::PathBuf;

use clap::Args;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf info chrome.csbrdf
  csbrdf info chrome.csbrdf --blocks
  csbrdf info set/manifest.json --json";

/// Arguments of `info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// .csbrdf files or manifests, or - for standard input
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// One JSON object a file, one a line
    #[arg(long)]
    pub json: bool,
    /// A row for each block, and a map of their sizes
    #[arg(long)]
    pub blocks: bool,
}
