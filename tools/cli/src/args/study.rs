//! The arguments of `csbrdf study`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::headings::OUTPUT;
use super::values::ratio;

pub(super) const EXAMPLES: &str = "\
Examples:
  csbrdf study brdfs --out study --quick
  csbrdf study brdfs --out study --only spheres,scene --environment sky.hdr";

/// Arguments of `study`.
#[derive(Debug, Args)]
pub struct StudyArgs {
    /// Folder of MERL .binary tables
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Materials for spheres, negative values and scene (the first two), by file name without .binary [default: the six
    /// of the built-in list that are in DIR, else its first six]
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub materials: Vec<String>,
    /// Sampling ratios of the spheres; the other figures take the one nearest to 5 %
    /// [default: 1%,2.5%,5%,10%,25%,50%; 5% with --quick]
    #[arg(long, value_name = "RATIO,...", value_delimiter = ',', value_parser = ratio)]
    pub ratios: Vec<f64>,
    /// Most materials on the contact sheet and in the Gini figure: those of --materials, then others by name
    /// [default: 24; 4 with --quick]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub sheet: Option<u16>,
    /// Pixels across a sphere; the scene is 2.5 times as wide [default: 192; 48 with --quick]
    #[arg(long, value_parser = clap::value_parser!(u16).range(8..=2048))]
    pub size: Option<u16>,
    /// Samples a pixel, of two directions each [default: 64; 16 with --quick]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=16384))]
    pub spp: Option<u16>,
    /// Seed of the encoders' sampling and of the renderer's
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Only these figures
    #[arg(long, value_enum, value_name = "FIGURE,...", value_delimiter = ',')]
    pub only: Vec<FigureArg>,
    /// Light: a latitude-longitude map, .hdr or .exr, zenith on top [default: a built-in sky with two area lights]
    #[arg(long, value_name = "FILE")]
    pub environment: Option<PathBuf>,
    /// A small study that shows that all works: two materials, one ratio, little pictures, a seventh of the blocks in
    /// the figure of negative values; other options go before it
    #[arg(long)]
    pub quick: bool,
    /// Folder for index.html, pictures, plots and CSV files; made if it does not exist
    #[arg(help_heading = OUTPUT, long, value_name = "DIR")]
    pub out: PathBuf,
    /// Write into a folder that is not empty, replacing files
    #[arg(help_heading = OUTPUT, long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(help_heading = OUTPUT, long)]
    pub replace_source: bool,
}

/// `--only`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FigureArg {
    /// Sparsity of the coefficients, raw and log
    Gini,
    /// Negative values after recovery, raw and log
    Negative,
    /// Spheres by sampling ratio
    Spheres,
    /// Contact sheet
    Sheet,
    /// Two materials in one scene
    Scene,
}
