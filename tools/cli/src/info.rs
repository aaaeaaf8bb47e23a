//! `csbrdf info`: what a file or a manifest holds, for people and for scripts.

mod blocks;
mod contents;
mod json;

use std::fmt::Write;

use csbrdf::codec::channel::ChannelTransform;
use csbrdf::table::grid::Mapping;

use crate::args::InfoArgs;
use crate::failure::{Failure, Outcome, each};
use crate::formats::Kind;
use crate::input;
use crate::output::print;
use crate::sets::manifest::Manifest;
use crate::sets::table;
use crate::text::{clean, error_figure, grouped, percent};
use contents::{Contents, ORIGINS, classes_of_blocks};

pub fn run(args: &InfoArgs) -> Outcome {
    each(&args.files, |i, file| {
        input::read(file, &[Kind::Csbrdf, Kind::Manifest]).and_then(|data| {
            if Manifest::is_likely(data.as_ref()) {
                return table::print(file, data.as_ref(), args, i > 0);
            }
            let contents = Contents::of(file, data)?;
            match args.json {
                true => json::print_object(&contents, args.blocks)?,
                false => {
                    let between = if i > 0 { "\n" } else { "" };
                    print(&format!("{between}{}", report(&contents)))?;
                    if args.blocks {
                        blocks::print_rows(&contents)?;
                    }
                }
            }
            match contents.damage.len() {
                0 => Ok(()),
                n => Err(Failure::bad_input(file, format!("{n} of its parts are damaged; fetch the file again"))),
            }
        })
    })
}

fn report(contents: &Contents) -> String {
    let reader = &contents.reader;
    let grid = reader.grid();
    let mut text = String::new();
    // Writing to a string cannot fail.
    let mut line = |name: &str, value: &str| {
        let _ = writeln!(text, "{name:<12} {}", clean(value));
    };
    line("file", &contents.name);
    let (major, minor, draft) = contents.version;
    let draft = if draft == 0 { String::new() } else { format!(", draft {draft}") };
    line("format", &format!("csbrdf {major}.{minor}{draft}"));
    let original = grid.positions() * grid.channels().len() * 8;
    let ratio = original as f64 / contents.bytes as f64;
    line("size", &format!("{} bytes, {ratio:.1}:1 to the table in float64", grouped(contents.bytes)));

    for (i, axis) in grid.axes().iter().enumerate() {
        let mapping = if axis.mapping == Mapping::Square { ", by squares" } else { "" };
        let (start, end) = (axis.start.to_degrees(), axis.end.to_degrees());
        let value = format!("{:<8} {:>4} bins, {start:.4} to {end:.4} degrees{mapping}", axis.name.as_str(), axis.len);
        line(if i == 0 { "axes" } else { "" }, &value);
    }
    let channel = |c: &csbrdf::table::grid::Channel| match c.wavelength {
        Some(wavelength) => format!("{} ({wavelength} nm)", c.name),
        None => c.name.clone(),
    };
    line("channels", &grid.channels().iter().map(channel).collect::<Vec<_>>().join(", "));

    let coding = reader.coding();
    let basis = coding.basis.as_str().to_uppercase();
    line("coding", &format!("{basis} of ln(f + {}), channels {}", coding.eps, transform_name(&coding.transform)));
    let steps = match coding.steps.iter().all(|s| *s == coding.steps[0]) {
        true => coding.steps[..1].to_vec(),
        false => coding.steps.clone(),
    };
    let steps: Vec<String> = steps.iter().map(f32::to_string).collect();
    let shrink = coding.shrink.map(|s| f64::from(s) / 256.0);
    let (quantization, steps) = (coding.quantization.as_str(), steps.join(", "));
    line("quantiser", &format!("{quantization}, step {steps}, shrink {:.3} and {:.3} of it", shrink[0], shrink[1]));
    let ratio = coding.sampling.ratio();
    let sampling = match ratio >= 1.0 {
        true => "every valid entry".into(),
        false => format!("{} % of the positions drawn", crate::text::nine_digits((100.0 * ratio) as f32)),
    };
    let most = contents.summary.ratio.max(ratio);
    let sampling = match most > ratio {
        true => format!("{sampling} and up, to {} % by block", crate::text::nine_digits((100.0 * most) as f32)),
        false => sampling,
    };
    line("sampling", &format!("{sampling}, seed {}", coding.seed));
    if let Some(horizon) = coding.horizon {
        line("horizon", &format!("valid from elevation {horizon:.6} (cosine)"));
    }
    line("blocks", &contents.partition_text());
    line(
        "side data",
        &format!("{:.1} bytes a block: all but coded coefficients, masks and exact bits", contents.side_per_block()),
    );
    if reader.is_lossless() {
        line("lossless", "every bit of the source is restored by decode --exact");
    }
    text.push('\n');
    text.push_str(&tables(contents));
    text.push_str(&metadata(contents));
    for damage in &contents.damage {
        let _ = writeln!(text, "damaged      {}", clean(damage));
    }
    text
}

/// Name of a channel transform.
fn transform_name(transform: &ChannelTransform) -> &'static str {
    match transform {
        ChannelTransform::None => "separate",
        matrix if *matrix == ChannelTransform::opponent() => "opponent",
        ChannelTransform::Matrix(_) => "mixed by a matrix",
        _ => "mixed",
    }
}

/// Sizes, validity and errors.
fn tables(contents: &Contents) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "{:<24} {:>12} {:>8}", "section", "bytes", "");
    for (name, bytes) in &contents.sections {
        let _ = writeln!(text, "  {:<22} {:>12} {:>8}", clean(name), grouped(*bytes), percent(*bytes, contents.bytes));
    }
    let _ = writeln!(text, "\n{:<24} {:>12} {:>8}", "validity of blocks", "blocks", "");
    for (class, count) in classes_of_blocks().zip(contents.summary.classes) {
        if count > 0 {
            let share = percent(count, contents.reader.block_count());
            let _ = writeln!(text, "  {:<22} {:>12} {share:>8}", class, grouped(count));
        }
    }
    let counts = contents.summary.origins;
    let entries = counts.iter().sum();
    let _ = writeln!(text, "\n{:<24} {:>12} {:>8}", "origin of entries", "entries", "");
    for ((name, _), count) in ORIGINS.iter().zip(counts) {
        let _ = writeln!(text, "  {:<22} {:>12} {:>8}", name, grouped(count), percent(count, entries));
    }
    let bounds = contents.error_bounds();
    let worst = contents.summary.worst.map_or(String::new(), |(block, _)| format!(" (block {block})"));
    let _ = writeln!(text, "\nlog error over the valid entries");
    if let Some((rms, max)) = contents.measured_errors() {
        let _ = writeln!(text, "  {:<22} rms {}, largest {}", "by the encoder", error_figure(rms), error_figure(max));
    }
    let _ = writeln!(
        text,
        "  {:<22} rms {}, largest {}{worst}",
        "bounds in the index",
        error_figure(bounds.0),
        error_figure(bounds.1)
    );
    text
}

/// The keys that OpenMATERIAL and the encoder know first, then the others, the encoder's report last.
fn metadata(contents: &Contents) -> String {
    const FIRST: [&str; 12] = [
        "name",
        "uuid",
        "version",
        "instrument",
        "date",
        "licence",
        "copyrights",
        "authors",
        "sources",
        "source_file",
        "source_sha256",
        "tool",
    ];
    let mut text = String::new();
    let serde_json::Value::Object(map) = &contents.metadata else { return text };
    if map.is_empty() {
        return text;
    }
    text.push_str("\nmetadata\n");
    let mut line = |key: &str, value: &str| {
        let _ = writeln!(text, "  {:<16} {}", clean(key), clean(value));
    };
    let others = map.keys().map(String::as_str).filter(|k| !FIRST.contains(k) && *k != "encoder");
    for key in FIRST.into_iter().chain(others) {
        match map.get(key) {
            Some(serde_json::Value::Array(list)) => list.iter().for_each(|value| line(key, &plain(value))),
            Some(value) => line(key, &plain(value)),
            None => {}
        }
    }
    match map.get("encoder") {
        Some(serde_json::Value::Object(fields)) => {
            line("encoder", "");
            fields.iter().for_each(|(key, value)| line(&format!("  {key}"), &plain(value)));
        }
        Some(other) => line("encoder", &plain(other)),
        None => {}
    }
    text
}

/// A JSON value without quotes around text.
fn plain(value: &serde_json::Value) -> String {
    match value {
        serde_json::Value::String(s) => s.clone(),
        other => other.to_string(),
    }
}
