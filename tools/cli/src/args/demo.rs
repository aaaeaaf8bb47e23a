//! The arguments of `csbrdf demo`.

use std::path::PathBuf;

use clap::Args;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf demo
  csbrdf demo --out pictures";

/// Arguments of `demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Folder for the picture csbrdf-demo.png, made if it does not exist; if not given, the system's folder for temporary files
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace the picture if it exists in DIR
    #[arg(long, short)]
    pub force: bool,
}
