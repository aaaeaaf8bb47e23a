//! The command line.

use clap::{Parser, Subcommand};

mod compare;
mod decode;
mod demo;
mod encode;
mod eval;
mod headings;
mod info;
mod lint;
mod plan;
mod prune;
mod render;
mod repair;
mod report;
mod study;
mod synth;
mod values;
mod verify;

pub use compare::CompareArgs;
pub use decode::{DecodeArgs, FormatArg};
pub use demo::DemoArgs;
pub use encode::{BasisArg, ChannelsArg, EffortArg, EncodeArgs, PresetArg, SamplingArg};
pub use eval::{EvalArgs, LookupArg};
use headings::EVERYWHERE;
pub use info::InfoArgs;
pub use lint::LintArgs;
pub use plan::PlanArgs;
pub use prune::PruneArgs;
pub use render::RenderArgs;
pub use repair::RepairArgs;
pub use report::{GridArg, ReportArgs};
pub use study::{FigureArg, StudyArgs};
pub use synth::SynthArgs;
pub use values::numbers;
pub use verify::VerifyArgs;

const SEE_HELP: &str = "csbrdf --help has the exit codes, csbrdf COMMAND --help examples of each command.";
const SEE: &str = "--help has more, and examples; exit codes: csbrdf --help.";

const EXIT_CODES: &str = "\
Exit codes:
  0    done, and all of the output written
  1    an operation failed: a file is missing, exists already, cannot be read or written;
       a contract (--max-error, --rmse, --psnr, --ratio, --size) cannot be kept;
       verify --against shows that a file breaks its word; lint --strict has warnings
  2    usage: the arguments are wrong
  3    an input is damaged or not of the expected format; also if decode --salvage or
       repair wrote what is left of it
  4    an input is of a version that this build does not read, or above its limits
  141  the reader of standard output closed it before all was written, as head does: as
       of SIGPIPE, without a message
With several inputs: the code of the first that failed.";

/// Compresses measured BRDFs and gives them back, whole, by block or by direction.
///
/// Results go to standard output or to files, figures and messages to standard error. `-` is standard input or
/// output. No file is replaced without --force, no input and no table that an input was made from without --replace-source, and
/// none appears under its name before it is complete.
#[derive(Debug, Parser)]
#[command(name = "csbrdf", version, after_help = SEE_HELP, after_long_help = EXIT_CODES, subcommand_required = true, arg_required_else_help = true)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Threads to use; all processors if not given. The result does not depend on it
    #[arg(help_heading = EVERYWHERE, long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Most values of a table in a .csbrdf file, for files that are trusted: a number, or thousands, millions, billions of
    /// them with k, M, G [default: 268435456]. Above the default, the limits on the time and memory that a file may take
    /// grow with it
    #[arg(help_heading = EVERYWHERE, long, global = true, value_name = "VALUES[k|M|G]", value_parser = values::values)]
    pub limit: Option<usize>,
    /// No figures and no progress, only errors
    #[arg(help_heading = EVERYWHERE, long, short, global = true)]
    pub quiet: bool,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Compress MERL .binary tables, or a folder of them, into .csbrdf files
    #[command(after_help = SEE, after_long_help = encode::EXAMPLES)]
    Encode(EncodeArgs),
    /// List what to measure, for encode --samples
    #[command(after_help = SEE, after_long_help = plan::EXAMPLES)]
    Plan(PlanArgs),
    /// Write the table of a .csbrdf file, or one block of it
    #[command(after_help = SEE, after_long_help = decode::EXAMPLES)]
    Decode(DecodeArgs),
    /// Show what .csbrdf files or manifests hold
    #[command(after_help = SEE, after_long_help = info::EXAMPLES)]
    Info(InfoArgs),
    /// Check every byte of .csbrdf files, or of all that a manifest lists
    #[command(after_help = SEE, after_long_help = verify::EXAMPLES)]
    Verify(VerifyArgs),
    /// Check that materials could exist: energy, reciprocity, the horizon
    #[command(after_help = SEE, after_long_help = lint::EXAMPLES)]
    Lint(LintArgs),
    /// Measure how far one table is from another
    #[command(after_help = SEE, after_long_help = compare::EXAMPLES)]
    Compare(CompareArgs),
    /// Evaluate the BRDF of a .csbrdf file for pairs of directions
    #[command(after_help = SEE, after_long_help = eval::EXAMPLES)]
    Eval(EvalArgs),
    /// Render a ball of a material, or two materials in a scene, straight from .csbrdf files
    #[command(after_help = SEE, after_long_help = render::EXAMPLES)]
    Render(RenderArgs),
    /// Make a smaller .csbrdf file with only the blocks that scenes look at, or only some channels
    #[command(after_help = SEE, after_long_help = prune::EXAMPLES)]
    Prune(PruneArgs),
    /// Write a valid .csbrdf file with all that is left of a damaged one
    #[command(after_help = SEE, after_long_help = repair::EXAMPLES)]
    Repair(RepairArgs),
    /// Make a synthetic table
    #[command(after_help = SEE, after_long_help = synth::EXAMPLES)]
    Synth(SynthArgs),
    /// Plot error against time and bytes over the encoder's settings, and how its solves go
    #[command(after_help = SEE, after_long_help = report::EXAMPLES)]
    Report(ReportArgs),
    /// See it work: makes a material, compresses it, shows figures and a picture
    #[command(after_help = SEE, after_long_help = demo::EXAMPLES)]
    Demo(DemoArgs),
    /// Repeat the source paper's study on a folder of tables: pictures, plots, CSV, and a page that shows them
    #[command(after_help = SEE, after_long_help = study::EXAMPLES)]
    Study(StudyArgs),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }
}
