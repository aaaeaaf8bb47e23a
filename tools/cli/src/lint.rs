//! `csbrdf lint`: whether materials could exist.

use std::fmt::Write;
use std::path::Path;

use csbrdf::assess::lint::{Deviation, Findings, Warning, lint_brdf, lint_table};
use csbrdf::brdf::Brdf;
use csbrdf::format::MAGIC;
use serde_json::{Value, json};

use crate::args::LintArgs;
use crate::failure::{Failure, Outcome, each};
use crate::formats::TABLE;
use crate::input::{self, label};
use crate::output::print;
use crate::quote;
use crate::text::{clean, error_figure, grouped, percent};

pub fn run(args: &LintArgs) -> Outcome {
    each(&args.files, |i, file| {
        look(file).and_then(|findings| {
            let warnings = findings.warnings();
            let between = if i > 0 && !args.json { "\n" } else { "" };
            print(&match args.json {
                true => quote::json(&format!("{}\n", object(file, &findings, &warnings))),
                false => format!("{between}{}", report(file, &findings, &warnings)),
            })?;
            match warnings.len() {
                n if n > 0 && args.strict => {
                    let plural = if n == 1 { "warning" } else { "warnings" };
                    Err(Failure::operation(format!("{}: {n} {plural}", label(file))))
                }
                _ => Ok(()),
            }
        })
    })
}

fn look(file: &Path) -> Result<Findings, Failure> {
    let bytes = input::read(file, TABLE)?;
    let found = if bytes.as_ref().starts_with(&MAGIC) {
        input::reader(bytes).and_then(Brdf::from_reader).and_then(|brdf| lint_brdf(&brdf))
    } else {
        input::read_table(bytes.as_ref()).and_then(|table| lint_table(&table))
    };
    found.map_err(|e| Failure::in_file(file, &e))
}

fn report(file: &Path, findings: &Findings, warnings: &[Warning]) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{}", clean(&label(file)));
    let mut row = |name: &str, cells: &mut dyn Iterator<Item = String>| {
        let cells: String = cells.map(|cell| format!(" {cell:>8}")).collect();
        let _ = writeln!(text, "  {:<20}{cells}", clean(name));
    };
    row("theta_i, degrees", &mut findings.albedos.iter().map(|a| a.theta_i.to_string()));
    for (c, name) in findings.channels.iter().enumerate() {
        row(&format!("albedo, {name}"), &mut findings.albedos.iter().map(|a| format!("{:.4}", a.values[c])));
    }
    row("towards the horizon", &mut findings.horizon.iter().map(|h| format!("{:.3}", h.ratio)));
    let mut line = |name: &str, value: &str| {
        let _ = writeln!(text, "  {name:<20} {value}");
    };
    let errors = findings.albedos.iter().flat_map(|a| &a.errors).copied().fold(0.0, f64::max);
    let largest = format!("{:.4}, quadrature error at most {}", findings.largest_albedo(), error_figure(errors));
    line("largest albedo", &largest);
    let by_grid = if findings.is_reciprocal_by_grid { " (the grid has no other way)" } else { "" };
    line("reciprocity", &format!("{}{by_grid}", deviation(&findings.reciprocity)));
    line("mirror image", &deviation(&findings.mirror));
    let shares = findings.shares;
    let all = shares.measured + shares.missing + shares.impossible;
    let share = |count: usize| format!("{} ({})", grouped(count), percent(count, all));
    let (measured, missing, impossible) = (share(shares.measured), share(shares.missing), share(shares.impossible));
    line("entries", &format!("measured {measured}, missing {missing}, impossible {impossible}"));
    for warning in warnings {
        line("warning", &clean(&warning.to_string()));
    }
    text
}

fn deviation(deviation: &Deviation) -> String {
    format!("log rms {}, largest {}", error_figure(deviation.rms), error_figure(deviation.max))
}

/// Keys stay; new ones may be added.
fn object(file: &Path, findings: &Findings, warnings: &[Warning]) -> Value {
    let deviation = |d: &Deviation| json!({"log_rms": d.rms, "log_max": d.max, "wi": d.wi, "wo": d.wo});
    let kind = |w: &Warning| match w {
        Warning::Energy { .. } => "energy",
        Warning::Reciprocity(_) => "reciprocity",
        Warning::Horizon(_) => "horizon",
        _ => "other",
    };
    json!({
        "file": label(file),
        "channels": findings.channels,
        "albedos": findings.albedos.iter().map(|a| json!({
            "theta_i_degrees": a.theta_i,
            "values": a.values,
            "errors": a.errors,
        })).collect::<Vec<_>>(),
        "largest_albedo": findings.largest_albedo(),
        "reciprocity": deviation(&findings.reciprocity),
        "reciprocal_by_grid": findings.is_reciprocal_by_grid,
        "mirror": deviation(&findings.mirror),
        "horizon": findings.horizon.iter().map(|h| json!({
            "theta_i_degrees": h.theta_i,
            "ratio": h.ratio,
        })).collect::<Vec<_>>(),
        "entries": {
            "measured": findings.shares.measured,
            "missing": findings.shares.missing,
            "impossible": findings.shares.impossible,
        },
        "warnings": warnings.iter().map(|w| json!({
            "kind": kind(w),
            "what": w.to_string(),
        })).collect::<Vec<_>>(),
    })
}
