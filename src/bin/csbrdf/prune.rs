//! `csbrdf prune`: a smaller file for the scenes of some traces.

use std::path::{Path, PathBuf};

use csbrdf::prune::prune;
use csbrdf::touched::Touched;

use crate::args::PruneArgs;
use crate::failure::{Failure, Outcome, note};
use crate::input::{self, is_dash, label};
use crate::output::Target;
use crate::text::{grouped, percent};

/// Longest trace that is read: all blocks of the largest file, one a line.
const MAX_TRACE: u64 = 1 << 28;

pub fn run(args: &PruneArgs, quiet: bool) -> Outcome {
    if is_dash(&args.input) && args.output.is_none() {
        return Err(Failure::usage("standard input has no name to make the output's from; give -o"));
    }
    let output = args.output.clone().unwrap_or_else(|| args.input.with_extension("pruned.csbrdf"));
    let target = Target::of(&output);
    let reader = input::open(&args.input)?;
    target.check(args.force)?;
    let mut traces = args.trace.iter().map(|path| read_trace(path).map(|trace| (path, trace)));
    let Some(first) = traces.next() else {
        return Err(Failure::usage("no trace; `csbrdf render --trace` or `csbrdf eval --trace` writes one"));
    };
    let (_, mut touched) = first?;
    for trace in traces {
        let (path, trace) = trace?;
        touched.merge(&trace).map_err(|e| Failure::in_file(path, &e))?;
    }
    let pruned = prune(&reader, &touched, args.detail).map_err(|e| Failure::in_file(&args.input, &e))?;
    target.write(args.force, |out| Ok(out.write_all(&pruned.bytes)?))?;
    if !quiet {
        let (before, after) = (reader.directory().file_length(), pruned.bytes.len());
        note(&format!(
            "{} -> {}: {} bytes of {} ({}), {} blocks of {}",
            label(&args.input),
            label(&output),
            grouped(after),
            grouped(before),
            percent(after, before),
            pruned.kept,
            pruned.kept + pruned.pruned
        ));
    }
    Ok(())
}

fn read_trace(path: &Path) -> Result<Touched, Failure> {
    let length = std::fs::metadata(path).map_err(|e| Failure::io(path, &e))?.len();
    if length > MAX_TRACE {
        return Err(Failure::unsupported(path, format!("a trace of {length} bytes, at most {MAX_TRACE} are read")));
    }
    let bytes = std::fs::read(path).map_err(|e| Failure::io(path, &e))?;
    let text = String::from_utf8(bytes).map_err(|_| Failure::bad_input(path, "is no text; give a trace"))?;
    Touched::from_text(&text).map_err(|e| Failure::in_file(path, &e))
}

/// Writes what a scene touched.
pub fn write_trace(path: &Path, touched: &Touched, force: bool) -> Outcome {
    Target::File(PathBuf::from(path)).write(force, |out| Ok(out.write_all(touched.to_text().as_bytes())?))
}
