//! The command-line tool: encodes, decodes and examines measured BRDFs.

mod args;
mod compare;
mod decode;
mod demo;
mod encode;
mod eval;
mod failure;
mod info;
mod input;
mod lint;
mod names;
mod output;
mod pending;
mod picture;
mod plan;
mod prune;
mod quote;
mod render;
mod repair;
mod report;
mod salvage;
mod samples;
mod sets;
mod stdout;
mod study;
mod synth;
mod text;
mod verify;

use std::process::ExitCode;

use clap::Parser;

use args::{Cli, Command};
use failure::{Failure, Outcome};

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // Help and version are errors of code 0 to clap.
        Err(error) => return stdout::clap(&error),
    };
    match run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            failure.report();
            ExitCode::from(failure.code())
        }
    }
}

fn run(cli: Cli) -> Outcome {
    if let Some(threads) = cli.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads.into())
            .build_global()
            .map_err(|e| Failure::operation(format!("cannot start {threads} threads: {e}; ask for fewer")))?;
    }
    match cli.command {
        Command::Plan(args) => plan::run(&args, cli.quiet),
        Command::Encode(args) => encode::run(&args, cli.threads, cli.quiet),
        Command::Decode(args) => decode::run(&args, cli.quiet),
        Command::Info(args) => info::run(&args),
        Command::Verify(args) => verify::run(&args, cli.quiet),
        Command::Lint(args) => lint::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Eval(args) => eval::run(&args),
        Command::Render(args) => render::run(&args, cli.quiet),
        Command::Prune(args) => prune::run(&args, cli.quiet),
        Command::Repair(args) => repair::run(&args, cli.quiet),
        Command::Synth(args) => synth::run(&args),
        Command::Report(args) => report::run(&args, cli.threads, cli.quiet),
        Command::Demo(args) => demo::run(&args),
        Command::Study(args) => study::run(&args, cli.quiet),
    }
}
