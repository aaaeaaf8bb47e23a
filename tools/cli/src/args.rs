//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use csbrdf::edit::salvage::WANTED;

const EXIT_CODES: &str = "\
Exit codes:
  0  done, and all of the output written
  1  an operation failed: a file is missing, exists already, cannot be read or written; a contract (--max-error,
     --rmse, --psnr, --ratio, --size) cannot be kept, verify --against shows that a file breaks its word, or lint --strict
     has warnings
  2  usage: the arguments are wrong
  3  an input is damaged or not of the expected format; also if decode --salvage or repair wrote what is left of it
  4  an input is of a version that this build does not read, or above its limits
  141  the reader of standard output closed it before all was written, as head does: as of SIGPIPE, without a message
With several inputs: the code of the first that failed.";

/// Compresses measured BRDFs and gives them back, whole, by block or by direction.
///
/// Results go to standard output or to files, figures and messages to standard error. `-` is standard input or
/// output. No file is replaced without --force, no input and no table that an input was made from without --replace-source, and
/// none appears under its name before it is complete.
#[derive(Debug, Parser)]
#[command(name = "csbrdf", version, after_help = EXIT_CODES, subcommand_required = true, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Threads to use; all processors if not given. The result does not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Most values of a table in a .csbrdf file, for files that are trusted: a number, or thousands, millions, billions of
    /// them with k, M, G [default: 268435456]. Above the default, the limits on the time and memory that a file may take
    /// grow with it
    #[arg(long, global = true, value_name = "VALUES[k|M|G]", value_parser = values)]
    pub limit: Option<usize>,
    /// No figures and no progress, only errors
    #[arg(long, short, global = true)]
    pub quiet: bool,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Compress MERL .binary tables, or a folder of them, into .csbrdf files
    #[command(after_help = EXIT_CODES)]
    Encode(EncodeArgs),
    /// List what to measure, for encode --samples
    #[command(after_help = EXIT_CODES)]
    Plan(PlanArgs),
    /// Write the table of a .csbrdf file, or one block of it
    #[command(after_help = EXIT_CODES)]
    Decode(DecodeArgs),
    /// Show what .csbrdf files or manifests hold
    #[command(after_help = EXIT_CODES)]
    Info(InfoArgs),
    /// Check every byte of .csbrdf files, or of all that a manifest lists
    #[command(after_help = EXIT_CODES)]
    Verify(VerifyArgs),
    /// Check that materials could exist: energy, reciprocity, the horizon
    #[command(after_help = EXIT_CODES)]
    Lint(LintArgs),
    /// Measure how far one table is from another
    #[command(after_help = EXIT_CODES)]
    Compare(CompareArgs),
    /// Evaluate the BRDF of a .csbrdf file for pairs of directions
    #[command(after_help = EXIT_CODES)]
    Eval(EvalArgs),
    /// Render a ball of a material, or two materials in a scene, straight from .csbrdf files
    #[command(after_help = EXIT_CODES)]
    Render(RenderArgs),
    /// Make a smaller .csbrdf file with only the blocks that scenes look at, or only some channels
    #[command(after_help = EXIT_CODES)]
    Prune(PruneArgs),
    /// Write a valid .csbrdf file with all that is left of a damaged one
    #[command(after_help = EXIT_CODES)]
    Repair(RepairArgs),
    /// Make a synthetic table
    #[command(after_help = EXIT_CODES)]
    Synth(SynthArgs),
    /// Plot error against time and bytes over the encoder's settings, and how its solves go
    #[command(after_help = EXIT_CODES)]
    Report(ReportArgs),
    /// See it work: makes a material, compresses it, shows figures and a picture
    #[command(after_help = EXIT_CODES)]
    Demo(DemoArgs),
    /// Repeat the source paper's study on a folder of tables: pictures, plots, CSV, and a page that shows them
    #[command(after_help = EXIT_CODES)]
    Study(StudyArgs),
}

/// Arguments of `encode`.
#[derive(Debug, Args)]
pub struct EncodeArgs {
    /// MERL .binary tables, folders of them (not those in folders within), or - for standard input
    #[arg(required_unless_present = "samples", conflicts_with = "samples", value_name = "INPUT")]
    pub inputs: Vec<PathBuf>,
    /// A list of measurements in place of a table, or - for standard input: CSV as of `csbrdf plan` with columns r, g, b in
    /// 1/sr. All of it is sampled, all else filled in
    #[arg(long, value_name = "FILE", conflicts_with_all = ["sampling", "seed"])]
    pub samples: Option<PathBuf>,
    /// Bins of phi_d of the list: 180, or 360 without reciprocity [default: as the list's first line says, else 180]
    #[arg(long, value_name = "BINS", value_parser = ["180", "360"], conflicts_with = "inputs")]
    pub grid: Option<String>,
    /// Output file, - for standard output; if not given, the input's name with .csbrdf, beside it
    #[arg(short, long, value_name = "OUT", conflicts_with = "out_dir")]
    pub output: Option<PathBuf>,
    /// Folder for the outputs, made if it does not exist; needed if an input is a folder
    #[arg(long, value_name = "DIR")]
    pub out_dir: Option<PathBuf>,
    /// Write manifest.json into --out-dir, with the hashes, sources and errors of the files: for `csbrdf verify` and
    /// `csbrdf info`. Always if an input is a folder. A set that was interrupted is gone on with: what is finished is kept
    #[arg(long, requires = "out_dir", conflicts_with = "samples")]
    pub manifest: bool,
    /// Tables to encode at a time, some 100 to 300 MB each. The result does not depend on it [default: as many as
    /// threads, at most 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    pub jobs: Option<u16>,
    /// Settings to start from; the options below change them [default: archive, or sparse with --samples]
    #[arg(long, value_enum)]
    pub preset: Option<PresetArg>,
    /// Quantiser step in the log domain: smaller is better and larger [default: the preset's, 0.1]
    #[arg(long, value_name = "STEP", value_parser = positive::<f32>)]
    pub quality: Option<f32>,
    /// How long an encode of all valid entries may take for fewer bytes [default: standard]
    #[arg(long, value_enum)]
    pub effort: Option<EffortArg>,
    /// The same as --effort fast
    #[arg(long, conflicts_with = "effort")]
    pub fast: bool,
    /// Share of the entries to sample: 0 to 1, or with %; or auto: in each block as many as --rmse needs [default: the
    /// preset's]
    #[arg(long, value_name = "RATIO|auto", value_parser = sampling)]
    pub sampling: Option<SamplingArg>,
    /// Keep every valid entry's ln(f + eps) within this: what the coefficients leave further off is corrected entry by
    /// entry. Of the values in float64, as decode writes them to .binary; float32 ones add some 1e-7 of f
    #[arg(long, value_name = "E", value_parser = positive::<f64>, conflicts_with = "quality", group = "contract")]
    pub max_error: Option<f64>,
    /// Keep the rms error of ln(f + eps) over the valid entries within this, as near below as a few encodes come. With
    /// --sampling auto: rms error to sample for, log domain
    #[arg(long, value_name = "RMS", value_parser = positive::<f64>, required_if_eq("sampling", "auto"), group = "contract")]
    pub rmse: Option<f64>,
    /// Keep the render PSNR, as compare measures it, at this or above, dB
    #[arg(long, value_name = "DB", value_parser = positive::<f64>, conflicts_with = "quality", group = "contract")]
    pub psnr: Option<f64>,
    /// Keep the file at most this part of the table's bytes in float64: 300 for 300:1
    #[arg(long, value_name = "R", value_parser = positive::<f64>, conflicts_with = "quality", group = "contract")]
    pub ratio: Option<f64>,
    /// Keep the file within this size: bytes, or with k or M thousands or millions of them
    #[arg(long, value_name = "BYTES[k|M]", value_parser = size, conflicts_with = "quality", group = "contract")]
    pub size: Option<u64>,
    /// Also keep what restores every bit of the table, missing entries included, for decode --exact: for archives, half
    /// the table's size and more where its values have many digits
    #[arg(long, conflicts_with_all = ["size", "ratio"])]
    pub lossless: bool,
    /// Also keep a second copy of what no block can be decoded without, some 2 to 4 kB, for decode --salvage and repair.
    /// --lossless files always have it
    #[arg(long)]
    pub spare: bool,
    /// Seed of the sampling
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Basis of the coefficients [default: the preset's]
    #[arg(long, value_enum)]
    pub basis: Option<BasisArg>,
    /// Block lengths along theta_h, theta_d, phi_d [default: the preset's]
    #[arg(long, visible_alias = "block-shape", value_name = "I,J,K", value_parser = lengths)]
    pub block: Option<List>,
    /// Constant of the tone map ln(f + eps), 1/sr [default: the preset's]
    #[arg(long, value_parser = positive::<f64>)]
    pub eps: Option<f64>,
    /// Rms residual that the recovery may leave at the samples, log domain [default: the preset's]
    #[arg(long, value_parser = not_negative)]
    pub sigma: Option<f64>,
    /// Most iterations of one solve of the recovery [default: the preset's]
    #[arg(long, value_name = "N")]
    pub iterations: Option<u32>,
    /// Exponent p of the weights (1 + |k|)^p on the coefficients in the recovery, 0 to 4 [default: the preset's]
    #[arg(long, value_name = "P", value_parser = not_negative)]
    pub weighting: Option<f64>,
    /// Colour channels alone, or red, green and blue together [default: the preset's]
    #[arg(long, value_enum)]
    pub channels: Option<ChannelsArg>,
    /// Metadata to store, repeatable: name, uuid, version, instrument, date, licence, copyright, author, source, or any
    /// other key
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_value)]
    pub meta: Vec<(String, String)>,
    /// Replace files that exist. Of a set, make again all but what an interrupted run with these settings has finished
    #[arg(long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(long)]
    pub replace_source: bool,
}

impl EncodeArgs {
    /// The preset given, or the usual one of what is encoded.
    pub fn preset(&self) -> PresetArg {
        let usual = if self.samples.is_some() { PresetArg::Sparse } else { PresetArg::Archive };
        self.preset.unwrap_or(usual)
    }
}

/// Arguments of `plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// Output file, - for standard output, the default. CSV: bins, angles in degrees, unit vectors with z along the normal
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Share of the bins to measure: 0 to 1, or with %
    #[arg(long, visible_alias = "ratio", value_name = "RATIO", default_value = "5%", value_parser = ratio)]
    pub sampling: f64,
    /// Seed of the draw
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Block lengths along theta_h, theta_d, phi_d: the draw is block by block, that of encode with the same lengths
    #[arg(long, visible_alias = "block-shape", value_name = "I,J,K", default_value = "15,15,15", value_parser = lengths)]
    pub block: List,
    /// Bins of phi_d: 180, or 360 without reciprocity [default: as the table given, else 180]
    #[arg(long, value_name = "BINS", value_parser = ["180", "360"])]
    pub grid: Option<String>,
    /// Only bins that this table has: a MERL .binary table or a .csbrdf file
    #[arg(long, value_name = "TABLE")]
    pub valid: Option<PathBuf>,
    /// Add the values of this table, -1 where it has none, as if they had been measured
    #[arg(long, value_name = "TABLE")]
    pub fill: Option<PathBuf>,
    /// Replace the file if it exists
    #[arg(long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(long)]
    pub replace_source: bool,
}

/// Arguments of `decode`.
#[derive(Debug, Args)]
pub struct DecodeArgs {
    /// A .csbrdf file, or - for standard input
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// Output file, - for standard output; if not given, the input's name with .decoded.binary, .decoded.npy or
    /// .block-I-J-K.npy, beside it: no source has such a name
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// binary: as MERL's tables; npy: float32, [channels, axes...], 1/sr; csv: rows of one block. [default: by the
    /// output's extension, else binary, or npy with --block]
    #[arg(long, value_enum)]
    pub format: Option<FormatArg>,
    /// Only this block: its place among the blocks along each axis, or its number
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
    /// Replace the file if it exists
    #[arg(long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(long)]
    pub replace_source: bool,
}

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

/// Arguments of `compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// The reference: a MERL .binary table or a .csbrdf file
    #[arg(value_name = "A")]
    pub reference: PathBuf,
    /// The other table
    #[arg(value_name = "B")]
    pub other: PathBuf,
    /// One JSON object; a ratio that is infinite, of equal tables, is null
    #[arg(long)]
    pub json: bool,
    /// Constant in the log error ln(b + eps) - ln(a + eps), 1/sr
    #[arg(long, default_value_t = csbrdf::assess::metrics::DEFAULT_EPS, value_parser = positive::<f64>)]
    pub eps: f64,
    /// Pixels across the pictures of the materials; 0 for none
    #[arg(long, value_name = "SIZE", default_value_t = 128, value_parser = clap::value_parser!(u16).range(0..=2048))]
    pub render: u16,
    /// Write a picture: reference, other, difference times 8, side by side
    #[arg(long, value_name = "OUT")]
    pub png: Option<PathBuf>,
    /// Replace the picture if it exists
    #[arg(long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(long)]
    pub replace_source: bool,
}

/// Arguments of `eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// A .csbrdf file
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// Direction to the light: x, y along the surface, z along its normal, of any length
    #[arg(long, value_name = "X,Y,Z", requires = "wo", allow_hyphen_values = true, value_parser = numbers::<3>)]
    pub wi: Option<[f64; 3]>,
    /// Direction to the viewer
    #[arg(long, value_name = "X,Y,Z", requires = "wi", allow_hyphen_values = true, value_parser = numbers::<3>)]
    pub wo: Option<[f64; 3]>,
    /// The two directions as theta_i,phi_i,theta_o,phi_o in degrees, theta from the normal
    #[arg(long, value_name = "TI,PI,TO,PO", allow_hyphen_values = true, conflicts_with_all = ["wi", "wo", "pairs"],
          value_parser = numbers::<4>)]
    pub angles: Option<[f64; 4]>,
    /// Pairs of directions from a file, - for standard input: wi and wo, six numbers a line. The default if no
    /// direction is given
    #[arg(long, value_name = "PAIRS", conflicts_with_all = ["wi", "wo"])]
    pub pairs: Option<PathBuf>,
    /// How to read between the centres of the bins
    #[arg(long, value_enum, default_value_t = LookupArg::Linear)]
    pub lookup: LookupArg,
    /// One JSON object a pair, one a line
    #[arg(long)]
    pub json: bool,
    /// Write which blocks were looked at, for `csbrdf prune`
    #[arg(long, value_name = "TRACE")]
    pub trace: Option<PathBuf>,
    /// The mean of a block in place of an error where the block was pruned
    #[arg(long)]
    pub coarse: bool,
    /// Replace the trace if it exists
    #[arg(long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(long)]
    pub replace_source: bool,
}

/// Arguments of `render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// One .csbrdf file for a ball, two for a ball and a ring on a floor
    #[arg(required = true, num_args = 1..=2, value_name = "FILE")]
    pub files: Vec<PathBuf>,
    /// Output file (PNG), - for standard output; if not given, the first input's name with .png, beside it
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Pixels down; across as many for a ball, five thirds of them for the scene
    #[arg(long, value_name = "SIZE", default_value_t = 256, value_parser = clap::value_parser!(u16).range(1..=2048))]
    pub size: u16,
    /// Samples a pixel, of two directions each
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u16).range(1..=4096))]
    pub samples: u16,
    /// Seed of the samples
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Write which blocks of a file were looked at, for `csbrdf prune`; once for each file
    #[arg(long, value_name = "TRACE")]
    pub trace: Vec<PathBuf>,
    /// The mean of a block in place of an error where the block was pruned
    #[arg(long)]
    pub coarse: bool,
    /// Replace files that exist
    #[arg(long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(long)]
    pub replace_source: bool,
}

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
    /// Output file, - for standard output; if not given, the input's name with .pruned.csbrdf, beside it
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
    /// Rms error, in ln(f + eps), that each block may gain by losing its finest detail
    #[arg(long, value_name = "E", default_value_t = 0.0)]
    pub detail: f64,
    /// Replace the file if it exists
    #[arg(long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(long)]
    pub replace_source: bool,
}

/// Bits of evidence.
fn evidence() -> clap::builder::RangedI64ValueParser<u32> {
    clap::value_parser!(u32).range(1..=i64::from(WANTED))
}

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

/// Arguments of `synth`.
#[derive(Debug, Args)]
pub struct SynthArgs {
    /// The material
    #[arg(required_unless_present = "list", value_name = "NAME")]
    pub name: Option<String>,
    /// Print the names of the materials
    #[arg(long, conflicts_with = "name")]
    pub list: bool,
    /// Output file, - for standard output; if not given, NAME.binary
    #[arg(short, long, value_name = "OUT")]
    pub output: Option<PathBuf>,
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
    /// Replace the file if it exists
    #[arg(long, short)]
    pub force: bool,
}

/// Arguments of `report`.
///
/// Writes report.html, report.csv and traces.csv. Encode seconds are of one run without reading and writing, decode
/// seconds the best of five of the whole table from memory, both on all threads: compare them within one report.
#[derive(Debug, Args)]
pub struct ReportArgs {
    /// MERL .binary tables
    #[arg(required = true, value_name = "TABLE")]
    pub tables: Vec<PathBuf>,
    /// Folder for the report, made if it does not exist
    #[arg(long, short, value_name = "DIR", default_value = "csbrdf-report")]
    pub out: PathBuf,
    /// Settings to try
    #[arg(long, value_enum, default_value_t = GridArg::Full)]
    pub grid: GridArg,
    /// Sampling ratios, with commas between them [default: 1%,5%,20%,50%; quick: 5%,20%]
    #[arg(long, value_name = "RATIOS", value_delimiter = ',', value_parser = ratio)]
    pub ratios: Vec<f64>,
    /// Options of `csbrdf encode` for every point, as one argument
    #[arg(long, value_name = "OPTIONS", default_value = "", hide_default_value = true, allow_hyphen_values = true)]
    pub encode: String,
    /// Blocks to follow the solves of, by number in the partition into 15 x 15 x 15 [default: the smooth, the glossy
    /// and the stiff one, of least, median and greatest log range among the blocks that are valid by half]
    #[arg(long, value_name = "N,N,...", value_delimiter = ',')]
    pub trace_blocks: Vec<usize>,
    /// Most iterations of a followed solve
    #[arg(long, value_name = "N", default_value_t = 1000)]
    pub trace_iterations: u32,
    /// Pixels across the picture for render PSNR; 0 for none
    #[arg(long, value_name = "SIZE", default_value_t = 64, value_parser = clap::value_parser!(u16).range(0..=2048))]
    pub render: u16,
    /// Replace the files of an earlier report
    #[arg(long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(long)]
    pub replace_source: bool,
}

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

/// Arguments of `study`.
#[derive(Debug, Args)]
pub struct StudyArgs {
    /// Folder of MERL .binary tables
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// Folder for index.html, pictures, plots and CSV files; made if it does not exist
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
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
    /// Write into a folder that is not empty, replacing files
    #[arg(long, short)]
    pub force: bool,
    /// As --force, and replace also an input itself, or the table that an input was made from
    #[arg(long)]
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

/// `--effort`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum EffortArg {
    /// A few block shapes, holes filled in few steps
    Fast,
    /// Block shapes by tile
    Standard,
    /// The same with more steps wherever holes are filled
    Thorough,
}

/// `--preset`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PresetArg {
    /// Every valid entry is a sample, DCT
    Archive,
    /// The source paper's: 5 % of the entries, DFT, 15 x 15 x 15 blocks
    Paper,
    /// 5 % of the entries, recovered as well as is known: trend of the whole table, weighted DCT
    Sparse,
}

/// `--sampling`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SamplingArg {
    Ratio(f64),
    Auto,
}

fn sampling(text: &str) -> Result<SamplingArg, String> {
    if text == "auto" { Ok(SamplingArg::Auto) } else { ratio(text).map(SamplingArg::Ratio) }
}

/// `--grid`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum GridArg {
    /// Presets, sampling ratios, bases, block shapes, tolerances: minutes a table
    Full,
    /// Presets and a few points of the rest
    Quick,
}

/// `--basis`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum BasisArg {
    /// Discrete cosine transform, type II
    Dct,
    /// Discrete Fourier transform
    Dft,
}

/// `--channels`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ChannelsArg {
    /// Each channel alone
    Separate,
    /// Brightness and two colour differences
    Opponent,
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

/// `--lookup`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LookupArg {
    /// The value of the bin, as MERL's own reader does
    Nearest,
    /// Interpolated
    Linear,
}

/// One argument of several whole numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct List(pub Vec<usize>);

fn whole_numbers(text: &str, least: usize) -> Result<List, String> {
    let numbers: Vec<usize> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|n| *n >= least))
        .collect::<Option<_>>()
        .ok_or_else(|| format!("expected whole numbers from {least} up, with commas between them"))?;
    if numbers.len() > csbrdf::format::MAX_AXES {
        return Err(format!("{} numbers, tables have at most {} axes", numbers.len(), csbrdf::format::MAX_AXES));
    }
    Ok(List(numbers))
}

/// One length for each of the three axes of MERL's grid.
fn lengths(text: &str) -> Result<List, String> {
    let list = whole_numbers(text, 1)?;
    if list.0.len() == 3 { Ok(list) } else { Err("expected three lengths: theta_h, theta_d, phi_d".into()) }
}

fn indices(text: &str) -> Result<List, String> {
    whole_numbers(text, 0)
}

fn positive<T: std::str::FromStr + Into<f64> + Copy>(text: &str) -> Result<T, String> {
    let number = text.parse::<T>().ok().filter(|x| (*x).into().is_finite() && (*x).into() > 0.0);
    number.ok_or_else(|| "expected a number above 0".into())
}

fn not_negative(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|x: &f64| x.is_finite() && *x >= 0.0);
    number.ok_or_else(|| "expected a number, 0 or above".into())
}

/// A number of bytes.
fn size(text: &str) -> Result<u64, String> {
    let (number, unit) = match text.trim_end_matches(['B', 'b']) {
        n if n.ends_with(['k', 'K']) => (&n[..n.len() - 1], 1e3),
        n if n.ends_with('M') => (&n[..n.len() - 1], 1e6),
        n => (n, 1.0),
    };
    let bytes = number.trim().parse::<f64>().ok().map(|x| (x * unit).floor());
    let bytes = bytes.filter(|x| (1.0..9e15).contains(x)).map(|x| x as u64);
    bytes.ok_or_else(|| "expected bytes, or thousands with k, millions with M".into())
}

/// A number of values.
fn values(text: &str) -> Result<usize, String> {
    let (number, unit) = match text {
        n if n.ends_with(['k', 'K']) => (&n[..n.len() - 1], 1e3),
        n if n.ends_with('M') => (&n[..n.len() - 1], 1e6),
        n if n.ends_with('G') => (&n[..n.len() - 1], 1e9),
        n => (n, 1.0),
    };
    let values = number.trim().parse::<f64>().ok().map(|x| (x * unit).floor());
    let values = values.filter(|x| (1.0..9e15).contains(x)).map(|x| x as usize);
    values.ok_or_else(|| "expected a number of values, or thousands with k, millions with M, billions with G".into())
}

fn ratio(text: &str) -> Result<f64, String> {
    let (number, unit) = text.strip_suffix('%').map_or((text, 1.0), |n| (n, 100.0));
    let ratio = number.trim().parse::<f64>().ok().map(|x| x / unit);
    ratio.filter(|x| *x > 0.0 && *x <= 1.0).ok_or_else(|| "expected a share above 0, up to 1 (or 100%)".into())
}

/// `N` finite numbers between commas or blanks.
pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let parts = text.split(|c: char| c == ',' || c.is_whitespace()).filter(|part| !part.is_empty());
    let list: Option<Vec<f64>> = parts.map(|part| part.parse().ok().filter(|x: &f64| x.is_finite())).collect();
    list.and_then(|list| list.try_into().ok()).ok_or_else(|| format!("expected {N} numbers with commas between them"))
}

fn key_value(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => Ok((key.trim().into(), value.into())),
        _ => Err("expected KEY=VALUE".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn values_are_checked() {
        assert_eq!(ratio("5%"), Ok(0.05));
        assert_eq!(ratio("1"), Ok(1.0));
        assert!(["0", "101%", "-1", "nan", "", "%"].iter().all(|t| ratio(t).is_err()));
        assert_eq!(["60k", "1.5M", "777", "60 kB"].map(size), [Ok(60_000), Ok(1_500_000), Ok(777), Ok(60_000)]);
        assert!(["0", "-1", "k", "", "nan", "1e30", "5G"].iter().all(|t| size(t).is_err()));
        assert_eq!(
            ["300M", "1.5G", "7k", "268435456"].map(values),
            [Ok(300_000_000), Ok(1_500_000_000), Ok(7000), Ok(1 << 28)]
        );
        assert!(["0", "-1", "G", "", "inf", "1e30", "5T"].iter().all(|t| values(t).is_err()));
        assert_eq!(lengths("15, 15,15").unwrap().0, [15, 15, 15]);
        assert!(["", "0,1,1", "7", "1,2,3,4", "1,2,3,4,5", "a,1,1", "1,,2", "-1"].iter().all(|t| lengths(t).is_err()));
        assert_eq!(numbers::<3>("0,-0.5,1e0"), Ok([0.0, -0.5, 1.0]));
        assert!(["1,2", "1,2,3,4", "1,2,inf", "1,2,x"].iter().all(|t| numbers::<3>(t).is_err()));
        assert!(positive::<f32>("1e-60").is_err() && positive::<f64>("inf").is_err() && not_negative("0").is_ok());
        assert_eq!(key_value("a=b=c"), Ok(("a".into(), "b=c".into())));
        assert!(key_value("=x").is_err() && key_value("x").is_err());
    }
}
