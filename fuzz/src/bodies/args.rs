//! The tool's command line from arbitrary text, one argument a line: parsed or refused with a message, and never run.

use std::cell::RefCell;

use clap::{Command as Parser, CommandFactory, FromArgMatches};

#[allow(dead_code, unused_imports, reason = "only what reads a command line is used")]
#[path = "../../../tools/cli/src/args/mod.rs"]
mod cli;

use cli::{Cli, Command};

thread_local! {
    /// Made once: that takes longer than most command lines.
    static PARSER: RefCell<Parser> = RefCell::new(Cli::command());
}

pub fn run(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    let words = ["csbrdf"].into_iter().chain(text.lines());
    let matches = PARSER.with_borrow_mut(|parser| parser.try_get_matches_from_mut(words));
    match matches.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => checked(&cli),
        Err(refused) => assert!([0, 2].contains(&refused.exit_code()) && !refused.to_string().is_empty()),
    }
}

/// What the commands take for granted.
fn checked(cli: &Cli) {
    assert!(cli.threads.is_none_or(|threads| threads > 0));
    match &cli.command {
        Command::Encode(args) => {
            let positive = |x: f64| x.is_finite() && x > 0.0;
            let contracts = [args.max_error, args.rmse, args.psnr, args.ratio, args.size.map(|bytes| bytes as f64)];
            assert!(contracts.iter().flatten().count() <= 1 && contracts.into_iter().flatten().all(positive));
            assert!(args.quality.is_none_or(|step| positive(step.into())) && args.eps.is_none_or(positive));
            assert!(args.block.as_ref().is_none_or(|list| list.0.len() == 3 && !list.0.contains(&0)));
            assert!(args.inputs.is_empty() == args.samples.is_some());
            args.preset();
        }
        Command::Plan(args) => assert!(args.sampling > 0.0 && args.sampling <= 1.0 && args.block.0.len() == 3),
        Command::Decode(args) => {
            assert!(args.block.as_ref().is_none_or(|list| (1..=4).contains(&list.0.len())));
        }
        Command::Eval(args) => {
            let given = [args.wi, args.wo].into_iter().flatten().flatten().chain(args.angles.into_iter().flatten());
            assert!(given.into_iter().all(f64::is_finite));
        }
        Command::Report(args) => assert!(args.ratios.iter().all(|ratio| *ratio > 0.0 && *ratio <= 1.0)),
        Command::Study(args) => assert!(args.ratios.iter().all(|ratio| *ratio > 0.0 && *ratio <= 1.0)),
        _ => {}
    }
}
