//! `csbrdf prune`: a smaller file for the scenes of some traces, or of some channels.

use std::io::BufReader;
use std::path::{Path, PathBuf};

use csbrdf::base::excerpt::excerpt;
use csbrdf::brdf::touched::Touched;
use csbrdf::edit::prune::Pruner;
use csbrdf::table::grid::Channel;

use crate::args::PruneArgs;
use crate::failure::{Failure, Outcome, note};
use crate::guard::Guard;
use crate::input::{self, is_dash, label};
use crate::output::Target;
use crate::text::{grouped, percent};

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
        let failed = |e: csbrdf::Error| Failure::in_file(path, &e);
        let trace = read_trace(path)?;
        // Each by itself, so that the one that is of another file is named.
        trace.check(&reader).map_err(failed)?;
        match &mut touched {
            Some(touched) => touched.merge(&trace).map_err(failed)?,
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
    if !quiet && pruned.gone > 0 {
        note(&gone(&args.input, pruned.gone));
    }
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
                let mut names: Vec<_> = channels.iter().take(MAX_LISTED).map(|c| excerpt(&c.name)).collect();
                names.extend((channels.len() > MAX_LISTED).then_some("...".into()));
                format!("no channel `{text}`; there are {}, or by number 0 to {}", names.join(", "), channels.len() - 1)
            }),
        }
    };
    texts.iter().map(number).collect()
}

/// A warning, no error: a scene that was traced with `--coarse` looks at the means of blocks that are gone, and gets the very
/// same again from the new file. But nothing brings back what they stand for, so whoever meant to keep it must know.
fn gone(file: &Path, count: usize) -> String {
    let (blocks, they) = if count == 1 { ("block", "it is") } else { ("blocks", "they are") };
    format!(
        "{}: warning: the trace names {} {blocks} that this file holds only the mean of; {they} not kept, prune the file that has \
         all blocks to keep them",
        label(file),
        grouped(count)
    )
}

fn read_trace(path: &Path) -> Result<Touched, Failure> {
    let failed = |e: std::io::Error| Failure::io(path, &e);
    if std::fs::metadata(path).map_err(failed)?.is_dir() {
        return Err(Failure::operation(format!("{}: is a directory; name a trace", label(path))));
    }
    let file = std::fs::File::open(path).map_err(failed)?;
    Touched::read(BufReader::new(file)).map_err(|e| Failure::in_file(path, &e))
}

/// Writes what a scene touched, and says so.
pub fn write_trace(path: &Path, touched: &Touched, guard: &Guard, quiet: bool) -> Outcome {
    let target = Target::File(PathBuf::from(path));
    target.write(guard, |out| Ok(out.write_all(touched.to_text().as_bytes())?))?;
    target.announce(None, quiet);
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
