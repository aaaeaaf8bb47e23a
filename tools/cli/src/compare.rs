//! `csbrdf compare`: error figures of one table against another, and a picture of both.

use std::fmt::Write;

use csbrdf::assess::metrics::{Comparison, Errors, compare_with_eps};
use csbrdf::assess::render::{channel_psnr, psnr, spheres_of_tables};
use serde_json::{Value, json};

use crate::args::CompareArgs;
use crate::failure::{Failure, Outcome};
use crate::guard::Guard;
use crate::input::{self, is_dash, label};
use crate::names;
use crate::output::{Target, print};
use crate::picture::Picture;
use crate::quote;
use crate::text::{clean, decibel, error_figure, grouped};

/// Render PSNR in dB: of all, and of red, green and blue.
#[derive(Clone, Copy)]
struct Render {
    overall: f64,
    channels: [f64; 3],
}

pub fn run(args: &CompareArgs, quiet: bool) -> Outcome {
    if is_dash(&args.reference) && is_dash(&args.other) {
        return Err(Failure::usage("only one of the two tables can come from standard input"));
    }
    let mut guard = Guard::new(args.force, args.replace_source).input(&args.reference).input(&args.other);
    let png = args.png.as_deref().map(Target::of);
    if let Some(target) = &png {
        if args.render == 0 {
            return Err(Failure::usage("--png needs a picture; give --render a size above 0"));
        }
        if *target == Target::Stdout {
            return Err(Failure::usage("standard output has the figures; give --png a file"));
        }
        target.check(&guard)?;
    }
    let reference = input::table(&args.reference, &mut guard)?;
    let other = input::table(&args.other, &mut guard)?;
    let comparison = compare_with_eps(&reference, &other, args.eps).map_err(|e| Failure::in_file(&args.other, &e))?;
    let names: Vec<String> = reference.grid().channels().iter().map(|c| clean(&c.name)).collect();
    let size = usize::from(args.render);
    let mut render = None;
    if size > 0 {
        let images = spheres_of_tables(&reference, &other, size);
        let mismatch = |e| Failure::in_file(&args.other, &e);
        render = Some(Render {
            overall: psnr(&images[0], &images[1]).map_err(mismatch)?,
            channels: channel_psnr(&images[0], &images[1]).map_err(mismatch)?,
        });
        if let Some(target) = &png {
            Picture::comparison(&images[0], &images[1]).map_err(mismatch)?.write(target, &guard)?;
            target.announce(None, quiet);
        }
    }
    print(&if args.json {
        quote::json(&format!("{}\n", object(args, &names, &comparison, render)))
    } else {
        report(args, &names, &comparison, render)
    })
}

fn object(args: &CompareArgs, names: &[String], comparison: &Comparison, render: Option<Render>) -> Value {
    let figures = |e: &Errors| {
        json!({
            "compared": e.compared,
            "log_rms": e.log_rms,
            "log_max": e.log_max,
            "log_p999": e.log_p999,
            "snr_db": e.snr_db,
        })
    };
    let channel = |(name, errors): (&String, &Errors)| {
        let mut object = figures(errors);
        object["name"] = name.as_str().into();
        object
    };
    json!({
        "reference": label(&args.reference),
        "other": label(&args.other),
        "eps": args.eps,
        "overall": figures(&comparison.overall),
        "channels": names.iter().zip(&comparison.channels).map(channel).collect::<Vec<_>>(),
        "only_in_reference": comparison.only_in_reference,
        "only_in_other": comparison.only_in_other,
        "render_size": args.render,
        "render_psnr_db": render.map(|r| r.overall),
        "render_psnr_rgb_db": render.map(|r| r.channels),
    })
}

fn report(args: &CompareArgs, names: &[String], comparison: &Comparison, render: Option<Render>) -> String {
    let mut text = String::new();
    let _ = writeln!(text, "reference  {}", names::shown(&args.reference));
    let _ = writeln!(text, "other      {}\n", names::shown(&args.other));
    text.push_str(&table(names, comparison));
    text.push('\n');
    for (count, side) in [(comparison.only_in_reference, "reference"), (comparison.only_in_other, "other")] {
        if count > 0 {
            let _ = writeln!(text, "{} entries are valid in the {side} only", grouped(count));
        }
    }
    if let Some(Render { overall, channels: [r, g, b] }) = render {
        let (r, g, b) = (decibel(r), decibel(g), decibel(b));
        let _ = writeln!(text, "render PSNR, dB  {}  (R {r}, G {g}, B {b})", decibel(overall));
        let _ = writeln!(text, "of a sphere {} pixels across", args.render);
    }
    text
}

/// A row of figures a channel, then one for all.
fn table(names: &[String], comparison: &Comparison) -> String {
    let width = names.iter().map(|n| n.chars().count()).max().unwrap_or(0).max(7);
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{:width$}  {:>9}  {:>9}  {:>9}  {:>9}  {:>11}",
        "channel", "log rms", "99.9 %", "log max", "SNR, dB", "compared"
    );
    let rows = names.iter().map(String::as_str).zip(&comparison.channels);
    for (name, e) in rows.chain([("all", &comparison.overall)]) {
        let _ = writeln!(
            text,
            "{name:width$}  {:>9}  {:>9}  {:>9}  {:>9}  {:>11}",
            error_figure(e.log_rms),
            error_figure(e.log_p999),
            error_figure(e.log_max),
            decibel(e.snr_db),
            grouped(e.compared)
        );
    }
    text
}
