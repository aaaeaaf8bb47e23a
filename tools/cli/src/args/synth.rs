//! The arguments of `csbrdf synth`.

use std::path::PathBuf;

use clap::Args;

use super::headings::OUTPUT;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf synth --list
  csbrdf synth satin-paint --noise 0.003";

/// Arguments of `synth`.
#[derive(Debug, Args)]
pub struct SynthArgs {
    /// The material
    #[arg(required_unless_present = "list", value_name = "NAME")]
    pub name: Option<String>,
    /// Print the names of the materials
    #[arg(long, conflicts_with = "name")]
    pub list: bool,
    /// Sigma of the noise in the log domain
    #[arg(long, value_name = "SIGMA", default_value_t = 0.0)]
    pub noise: f64,
    /// Share of the possible entries that are missing, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub holes: f64,
    /// Seed of noise and holes
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Bins of phi_d: 180, or 360 without reciprocity
    #[arg(long, value_name = "BINS", default_value = "180", value_parser = ["180", "360"])]
    pub phi_d: String,
    /// Output file, - for standard output; if not given, NAME.binary
    #[arg(help_heading = OUTPUT, short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Replace the file if it exists
    #[arg(help_heading = OUTPUT, long, short)]
    pub force: bool,
}
