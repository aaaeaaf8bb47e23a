//! The command-line tool: encodes, decodes and examines measured BRDFs.

mod args;
mod compare;
mod decode;
mod demo;
mod encode;
mod eval;
mod failure;
mod formats;
mod gone;
mod guard;
mod info;
mod input;
mod lint;
mod names;
mod output;
mod path;
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
mod source;
mod stdout;
mod study;
mod synth;
mod text;
mod verify;

use std::process::ExitCode;

use clap::Parser;

use args::{Cli, Command};
use csbrdf::Limits;
use failure::{Failure, Outcome, note};

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

/// Most threads of the pool: more take memory and gain nothing on any machine that this was tried on.
const MOST_THREADS: usize = 256;

/// The names that the pool asks the environment for, in its order.
const THREADS_VARIABLES: [&str; 2] = ["RAYON_NUM_THREADS", "RAYON_RS_NUM_CPUS"];

/// Starts the pool with the threads asked for, by the option or the environment, but not with any number of them.
fn start_threads(asked: Option<u16>) -> Outcome {
    let of = |name: &'static str| Some((std::env::var(name).ok()?.parse::<usize>().ok()?, name));
    let asked = asked.map(|threads| (usize::from(threads), "--threads"));
    let Some((threads, source)) = asked.or_else(|| THREADS_VARIABLES.into_iter().find_map(of)) else { return Ok(()) };
    if threads > MOST_THREADS {
        note(&format!("csbrdf: {source} asks for {threads} threads; {MOST_THREADS} are started, the most that are"));
    }
    // 0 stands for as many as there are processors.
    let threads = threads.min(MOST_THREADS);
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|e| Failure::operation(format!("cannot start {threads} threads: {e}; ask for fewer with --threads")))
}

fn run(cli: Cli) -> Outcome {
    if let Some(values) = cli.limit {
        input::set_limits(Limits::of_table(values));
    }
    start_threads(cli.threads)?;
    match cli.command {
        Command::Plan(args) => plan::run(&args, cli.quiet),
        Command::Encode(args) => encode::run(&args, cli.threads, cli.quiet),
        Command::Decode(args) => decode::run(&args, cli.quiet),
        Command::Info(args) => info::run(&args),
        Command::Verify(args) => verify::run(&args, cli.quiet),
        Command::Lint(args) => lint::run(&args),
        Command::Compare(args) => compare::run(&args, cli.quiet),
        Command::Eval(args) => eval::run(&args, cli.quiet),
        Command::Render(args) => render::run(&args, cli.quiet),
        Command::Prune(args) => prune::run(&args, cli.quiet),
        Command::Repair(args) => repair::run(&args, cli.quiet),
        Command::Synth(args) => synth::run(&args, cli.quiet),
        Command::Report(args) => report::run(&args, cli.threads, cli.quiet),
        Command::Demo(args) => demo::run(&args),
        Command::Study(args) => study::run(&args, cli.quiet),
    }
}
