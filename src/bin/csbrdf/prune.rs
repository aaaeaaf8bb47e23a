//! `csbrdf prune`: a smaller file for the scenes of some traces, or of some channels.

use std::path::{Path, PathBuf};

use csbrdf::grid::Channel;
use csbrdf::prune::Pruner;
use csbrdf::touched::Touched;

use crate::args::PruneArgs;
use crate::failure::{Failure, Outcome, note};
use crate::guard::Guard;
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
    let guard = Guard::new(args.force, args.replace_source).input(&args.input).inputs(&args.trace);
    let guard = guard.source_of(&args.input, &reader);
    target.check(&guard)?;
    let mut touched: Option<Touched> = None;
    for path in &args.trace {
        let trace = read_trace(path)?;
        match &mut touched {
            Some(touched) => touched.merge(&trace).map_err(|e| Failure::in_file(path, &e))?,
            None => touched = Some(trace),
        }
    }
    let mut pruner = Pruner::new().detail(args.detail);
    if let Some(touched) = &touched {
        pruner = pruner.blocks(touched);
    }
    let channels = reader.grid().channels();
    let mut kept = channels.len();
    if !args.channels.is_empty() {
        let chosen = numbers(&args.channels, channels)
            .map_err(|what| Failure::usage(format!("{}: {what}", label(&args.input))))?;
        kept = chosen.len();
        pruner = pruner.channels(&chosen);
    }
    let pruned = pruner.prune(&reader).map_err(|e| Failure::in_file(&args.input, &e))?;
    target.write(&guard, |out| Ok(out.write_all(&pruned.bytes)?))?;
    input::note_needed_limit(&target, reader.grid().positions() * kept);
    if !quiet {
        let (before, after) = (reader.directory().file_length(), pruned.bytes.len());
        let of_channels =
            if kept < channels.len() { format!(", {kept} of {} channels", channels.len()) } else { String::new() };
        note(&format!(
            "{} -> {}: {} bytes of {} ({}), {} blocks of {}{of_channels}",
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

/// Most names that a message lists.
const MAX_LISTED: usize = 8;

/// Channels by name, or by number where none has that name.
fn numbers(texts: &[String], channels: &[Channel]) -> Result<Vec<usize>, String> {
    let number = |text: &String| {
        let named: Vec<usize> = (0..channels.len()).filter(|&c| channels[c].name == *text).collect();
        match named[..] {
            [channel] => Ok(channel),
            [first, second, ..] => {
                Err(format!("several channels are named `{text}`, {first} and {second} among them; give their numbers"))
            }
            [] => text.parse().ok().filter(|channel| *channel < channels.len()).ok_or_else(|| {
                let mut names: Vec<&str> = channels.iter().take(MAX_LISTED).map(|c| c.name.as_str()).collect();
                names.extend((channels.len() > MAX_LISTED).then_some("..."));
                format!("no channel `{text}`; there are {}, or by number 0 to {}", names.join(", "), channels.len() - 1)
            }),
        }
    };
    texts.iter().map(number).collect()
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

/// Writes what a scene touched, and says so.
pub fn write_trace(path: &Path, touched: &Touched, guard: &Guard, quiet: bool) -> Outcome {
    let target = Target::File(PathBuf::from(path));
    target.write(guard, |out| Ok(out.write_all(touched.to_text().as_bytes())?))?;
    target.tell(None, quiet);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_have_names_and_numbers() {
        let channel = |name: &&str| Channel { name: name.to_string(), wavelength: None, scale: 1.0 };
        let channels: Vec<Channel> = ["R", "1", "B", "B", ""].iter().map(channel).collect();
        let of = |text: &str| numbers(&text.split(',').map(String::from).collect::<Vec<_>>(), &channels);
        assert_eq!(of("R,2,1,0,"), Ok(vec![0, 2, 1, 0, 4]));
        assert!(of("B").unwrap_err().contains("several channels are named `B`, 2 and 3"));
        for unknown in ["G", "5", "-1", "r", "0.5"] {
            assert!(of(unknown).unwrap_err().contains("there are R, 1, B, B, , or by number 0 to 4"), "{unknown}");
        }
    }
}
