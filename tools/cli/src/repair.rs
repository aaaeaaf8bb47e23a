//! `csbrdf repair`: a valid file from a damaged one.

use csbrdf::edit::salvage::{Options, repair_with};

use crate::args::RepairArgs;
use crate::failure::{Failure, Outcome, note};
use crate::formats::Kind;
use crate::guard::Guard;
use crate::input::{self, is_dash, label};
use crate::output::Target;
use crate::salvage::{list, verdict};
use crate::text::grouped;

pub fn run(args: &RepairArgs, quiet: bool) -> Outcome {
    if is_dash(&args.input) && args.output.is_none() {
        return Err(Failure::usage("standard input has no name to make the output's from; give -o"));
    }
    let output = args.output.clone().unwrap_or_else(|| args.input.with_extension("repaired.csbrdf"));
    let target = Target::of(&output);
    let guard = Guard::new(args.force, args.replace_source).input(&args.input);
    target.check(&guard)?;
    let bytes = input::read(&args.input, &[Kind::Damaged])?;
    let options = Options::default().limits(input::limits()).evidence(args.evidence);
    let repaired = repair_with(bytes.as_ref(), &options).map_err(|e| Failure::in_file(&args.input, &e))?;
    let guard = guard.source_of(&args.input, repaired.salvaged.reader());
    target.write(&guard, |out| Ok(out.write_all(&repaired.bytes)?))?;
    list(&args.input, &repaired.salvaged, quiet);
    if !quiet {
        note(&format!("{} -> {target}: {} bytes", label(&args.input), grouped(repaired.bytes.len())));
    }
    verdict(&args.input, &repaired.salvaged, &target)
}
