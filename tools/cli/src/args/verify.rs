//! The arguments of `csbrdf verify`.

use std::path::PathBuf;

use clap::Args;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf verify chrome.csbrdf
  csbrdf verify chrome.csbrdf --against chrome.binary
  csbrdf verify set/manifest.json --against brdfs";

/// Arguments of `verify`.
#[derive(Debug, Args)]
pub struct VerifyArgs {
    /// .csbrdf files, or - for standard input; or the manifest.json of a set: its folder must hold the files that the
    /// manifest lists, byte for byte, and no other .csbrdf files
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Compare with the table that the file was made from: that each block's error is within what the index states, the
    /// errors within what the metadata state, and the contract kept; of a lossless file that every bit is restored; for one
    /// file. For a manifest: the folder of the tables, by the names that they had
    #[arg(long, value_name = "ORIGINAL")]
    pub against: Option<PathBuf>,
}
