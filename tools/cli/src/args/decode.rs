//! The arguments of `csbrdf decode`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use csbrdf::edit::salvage::WANTED;

use super::headings::OUTPUT;
use super::values::{List, evidence, indices};

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf decode chrome.csbrdf                          chrome.decoded.binary, as MERL's tables
  csbrdf decode chrome.csbrdf -o chrome.npy            float32, [channels, axes...], 1/sr
  csbrdf decode chrome.csbrdf --block 7 --format csv -o -
  csbrdf decode chrome.csbrdf --exact                  the source's bytes, of a lossless file
  csbrdf decode damaged.csbrdf --salvage               what is left";

/// Arguments of `decode`.
#[derive(Debug, Args)]
pub struct DecodeArgs {
    /// A .csbrdf file, or - for standard input
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// Only this block: its number, as info --blocks lists it. Where the blocks form a regular grid, as those of encode
    /// --block 15,15,15 (not those of archive files by default), also its place along each axis
    #[arg(long, value_name = "I,J,K|N", value_parser = indices)]
    pub block: Option<List>,
    /// Write what the recovery filled in where nothing was measured, not -1
    #[arg(long)]
    pub fill: bool,
    /// The mean of a block in place of an error where the block was pruned
    #[arg(long)]
    pub coarse: bool,
    /// The very bytes of the MERL .binary table that the file was made from, if it was encoded with --lossless
    #[arg(long, conflicts_with_all = ["fill", "block"])]
    pub exact: bool,
    /// Write all that is intact of a damaged file, -1 for the rest, and list what is damaged. Exits with 3 if anything is lost
    #[arg(long, conflicts_with_all = ["fill", "block", "coarse"])]
    pub salvage: bool,
    /// With --salvage: accept changes that checksums prove to this many bits; a wrong one gets by with a probability of 2^-BITS
    #[arg(long, value_name = "BITS", default_value_t = WANTED, value_parser = evidence(), requires = "salvage")]
    pub evidence: u32,
    /// Output file, - for standard output; if not given, the input's name with .decoded.binary, .decoded.npy or
    /// .block-I-J-K.npy, beside it: no source has such a name
    #[arg(help_heading = OUTPUT, short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// binary: as MERL's tables; npy: float32, [channels, axes...], 1/sr; csv: rows of one block. [default: by the
    /// output's extension, else binary, or npy with --block]
    #[arg(help_heading = OUTPUT, long, value_enum)]
    pub format: Option<FormatArg>,
    /// Replace the file if it exists
    #[arg(help_heading = OUTPUT, long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(help_heading = OUTPUT, long)]
    pub replace_source: bool,
}

/// `--format`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FormatArg {
    /// MERL's
    Binary,
    /// NumPy's
    Npy,
    /// Text
    Csv,
}
