//! `csbrdf info` of a manifest: a row for each file.

use std::fmt::Write;
use std::path::Path;

use super::manifest::Manifest;
use crate::args::InfoArgs;
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::path::label;
use crate::quote;
use crate::text::{clean, error_figure, grouped};

/// Widest column of names; longer ones move the rest of their row.
const WIDEST: usize = 60;

/// Prints a manifest: a table, or with --json the object itself on one line.
pub fn print(path: &Path, bytes: &[u8], args: &InfoArgs, apart: bool) -> Outcome {
    let manifest = super::read(path, bytes)?;
    if args.blocks {
        return Err(Failure::usage("--blocks is of one file; a manifest has none, name the .csbrdf file"));
    }
    if args.json {
        let text = serde_json::to_string(&manifest).map_err(|e| Failure::bad_input(path, e))?;
        return output::print(&quote::json(&(text + "\n")));
    }
    let text = text(path, &manifest);
    output::print(&if apart { format!("\n{text}") } else { text })
}

fn text(path: &Path, manifest: &Manifest) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{:<12} {}", "manifest", clean(&label(path)));
    let _ = writeln!(text, "{:<12} {}\n", "tool", clean(&manifest.tool));
    let names: Vec<String> = manifest.materials.iter().map(|m| clean(&m.name)).collect();
    let width = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).clamp(8, WIDEST);
    let _ = writeln!(text, "{:width$} {:>13} {:>10} {:>9} {:>9}", "material", "bytes", "ratio", "log rms", "max");
    for (name, m) in names.iter().zip(&manifest.materials) {
        let contract = m.contract.as_ref().map_or(String::new(), |kept| {
            format!("  {} {}, asked {}", clean(&kept.name), figure(kept.achieved), figure(kept.asked))
        });
        let _ = writeln!(
            text,
            "{name:width$} {:>13} {:>8.1}:1 {:>9} {:>9}{contract}",
            grouped(m.bytes as usize),
            m.ratio(),
            error_figure(m.log_rms),
            error_figure(m.log_max)
        );
    }
    let total = format!("{} files", manifest.materials.len());
    let bytes = grouped(manifest.bytes() as usize);
    let _ = writeln!(text, "{total:width$} {bytes:>13} {:>8.1}:1", manifest.ratio());
    text
}

/// A contract's figure: whole, or to five digits.
fn figure(x: f64) -> String {
    match x {
        x if x.fract() == 0.0 && x.abs() < 1e15 => format!("{x}"),
        x if x.abs() >= 1.0 => format!("{x:.2}"),
        x => error_figure(x),
    }
}
