//! The arguments of `csbrdf lint`.

use std::path::PathBuf;

use clap::Args;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf lint chrome.csbrdf
  csbrdf lint --strict *.binary";

/// Arguments of `lint`.
///
/// Looks at values as renderers get them: between bins, and filled in where nothing was measured. Warns of an albedo above 1 by more
/// than the error of its quadrature; of (wi, wo) and (wo, wi) that differ by more than 0.05 rms in ln(f + 0.001); and where light from
/// up to 60 degrees mostly goes along the surface, by f cos(theta_o).
#[derive(Debug, Args)]
pub struct LintArgs {
    /// .csbrdf files or MERL .binary tables, or - for standard input
    #[arg(required = true, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// One JSON object a file, one a line
    #[arg(long)]
    pub json: bool,
    /// Fail if there are warnings
    #[arg(long)]
    pub strict: bool,
}
