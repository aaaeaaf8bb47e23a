//! The arguments of `csbrdf repair`.

use std::path::PathBuf;

use clap::Args;
use csbrdf::edit::salvage::WANTED;

use super::values::evidence;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf repair damaged.csbrdf                         damaged.repaired.csbrdf
  csbrdf repair damaged.csbrdf --evidence 28           accept what fewer bits prove";

/// Arguments of `repair`.
///
/// Where nothing is lost the file is again what it was, byte for byte. Blocks that are lost become pruned ones: their means are left,
/// decode --coarse gives them out. What was found is listed. Exits with 3 if anything is lost.
#[derive(Debug, Args)]
pub struct RepairArgs {
    /// A .csbrdf file, or - for standard input
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// Output file, - for standard output; if not given, the input's name with .repaired.csbrdf, beside it
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Accept changes that checksums prove to this many bits; a wrong one gets by with a probability of 2^-BITS. Exits with 3 then
    #[arg(long, value_name = "BITS", default_value_t = WANTED, value_parser = evidence())]
    pub evidence: u32,
    /// Replace the file if it exists
    #[arg(long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(long)]
    pub replace_source: bool,
}
