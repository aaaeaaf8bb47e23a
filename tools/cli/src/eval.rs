//! `csbrdf eval`: BRDF values at pairs of directions.

use std::io::{BufRead, BufReader, BufWriter, IsTerminal, Read, Write};
use std::path::{Path, PathBuf};

use csbrdf::brdf::eval::Brdf;
use csbrdf::table::coords::Lookup;
use serde_json::json;

use crate::args::{EvalArgs, LookupArg, numbers};
use crate::failure::{Failure, Outcome};
use crate::guard::Guard;
use crate::input::{self, Bytes, is_dash};
use crate::output::Target;
use crate::prune::write_trace;
use crate::quote;
use crate::source::{self, Source};
use crate::stdout;
use crate::text::nine_digits;

/// Longest line of a file of pairs.
const MAX_LINE: u64 = 4096;

/// Directions to the light and to the viewer.
type Pair = ([f64; 3], [f64; 3]);

pub fn run(args: &EvalArgs, quiet: bool) -> Outcome {
    let single = match (args.wi, args.wo, args.angles) {
        (Some(wi), Some(wo), _) => Some((wi, wo)),
        (_, _, Some([ti, pi, to, po])) => Some((direction(ti, pi), direction(to, po))),
        _ => None,
    };
    let dash = PathBuf::from("-");
    let pairs = args.pairs.as_ref().unwrap_or(&dash);
    if single.is_none() && is_dash(pairs) {
        if is_dash(&args.input) {
            return Err(Failure::usage(
                "standard input holds the file; give the directions as --wi and --wo, or --pairs FILE",
            ));
        }
        if args.pairs.is_none() && std::io::stdin().is_terminal() {
            return Err(Failure::usage("no directions; give --wi and --wo, --angles, or pairs on standard input"));
        }
    }
    let reader = input::open(&args.input)?.with_pruned(input::pruned(args.coarse));
    let trace = args.trace.clone().map(Target::File);
    let guard = Guard::new(args.force, args.replace_source).input(&args.input).inputs(&args.pairs);
    let guard = guard.source_of(&args.input, &reader);
    trace.iter().try_for_each(|trace| trace.check(&guard))?;
    let lookup = match args.lookup {
        LookupArg::Nearest => Lookup::Nearest,
        LookupArg::Linear => Lookup::Linear,
    };
    let brdf = Brdf::open(reader).map_err(|e| Failure::in_file(&args.input, &e))?.with_lookup(lookup);
    let mut printer = Printer {
        input: &args.input,
        json: args.json,
        values: vec![0.0; brdf.reader().grid().channels().len()],
        names: brdf.reader().grid().channels().iter().map(|c| c.name.clone()).collect(),
        brdf,
        out: BufWriter::new(stdout::lock()?),
    };
    match single {
        Some(pair) => printer.print(pair)?,
        None if is_dash(pairs) => each_pair(pairs, std::io::stdin().lock(), |pair| printer.print(pair))?,
        None => {
            // Line by line, each of bounded length: a pipe may go on for ever.
            let from: Box<dyn Read> = match source::open(pairs)? {
                Source::Regular { file, .. } => Box::new(file),
                Source::Stream(from) => from,
            };
            each_pair(pairs, BufReader::new(from), |pair| printer.print(pair))?;
        }
    }
    printer.out.flush().map_err(|e| Failure::stdout(&e))?;
    args.trace.iter().try_for_each(|trace| write_trace(trace, &printer.brdf.touched(), &guard, quiet))
}

/// Unit direction of an elevation from the normal and an azimuth, degrees.
fn direction(theta: f64, phi: f64) -> [f64; 3] {
    let (sin, cos) = theta.to_radians().sin_cos();
    let (sin_phi, cos_phi) = phi.to_radians().sin_cos();
    [sin * cos_phi, sin * sin_phi, cos]
}

/// Calls `work` for every line of six numbers; blank lines and those that begin with # are skipped.
fn each_pair(path: &Path, mut from: impl BufRead, mut work: impl FnMut(Pair) -> Outcome) -> Outcome {
    let mut line = Vec::new();
    for number in 1.. {
        line.clear();
        let read = from.by_ref().take(MAX_LINE + 1).read_until(b'\n', &mut line).map_err(|e| Failure::io(path, &e))?;
        if read == 0 {
            break;
        }
        if read as u64 > MAX_LINE {
            let what = format!("line {number} has more than {MAX_LINE} bytes; six numbers take less");
            return Err(Failure::bad_input(path, what));
        }
        let text = String::from_utf8_lossy(&line);
        let text = text.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let six = numbers::<6>(text).ok();
        let Some([ix, iy, iz, ox, oy, oz]) = six else {
            let what = format!("line {number}: expected six numbers, x y z of wi and of wo");
            return Err(Failure::bad_input(path, what));
        };
        work(([ix, iy, iz], [ox, oy, oz]))?;
    }
    Ok(())
}

struct Printer<'a, W: Write> {
    input: &'a Path,
    brdf: Brdf<Bytes>,
    names: Vec<String>,
    values: Vec<f32>,
    json: bool,
    out: W,
}

impl<W: Write> Printer<'_, W> {
    fn print(&mut self, (wi, wo): Pair) -> Outcome {
        self.brdf.eval_into(wi, wo, &mut self.values).map_err(|e| Failure::in_file(self.input, &e))?;
        let line = if self.json {
            let object = json!({"wi": wi, "wo": wo, "channels": self.names, "values": self.values, "unit": "1/sr"});
            quote::json(&object.to_string())
        } else {
            self.values.iter().map(|v| nine_digits(*v)).collect::<Vec<_>>().join(" ")
        };
        writeln!(self.out, "{line}").map_err(|e| Failure::stdout(&e))
    }
}
