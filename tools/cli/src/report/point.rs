//! A point: one `csbrdf encode` command, carried out and measured.

use std::path::Path;
use std::time::Instant;

use clap::Parser;
use csbrdf::assess::render::{Image, psnr, sphere_of_table};
use csbrdf::decode::Reader;
use csbrdf::encode::Encoder;
use csbrdf::format::metadata::Metadata;
use csbrdf::table::Table;

use super::plan::preset_name;
use crate::args::{Cli, Command, EncodeArgs};
use crate::encode;
use crate::failure::Failure;
use crate::quote;

/// Decodes of a point; the fastest counts.
pub const DECODES: usize = 5;

/// What a page calls the row of a point, for links to it.
pub fn anchor(table: usize, point: usize) -> String {
    format!("t{table}p{point}")
}

/// Settings, cost and error of one file.
#[derive(Clone, Debug)]
pub struct Point {
    /// Options from the plan.
    pub settings: String,
    /// The whole command.
    pub command: String,
    pub preset: String,
    pub basis: String,
    /// Lengths with x between them; several shapes with blanks.
    pub block: String,
    pub ratio: f64,
    pub sigma: f64,
    pub quality: f64,
    pub bytes: usize,
    pub log_rms: f64,
    pub log_max: f64,
    /// dB; infinite where equal. `None` if not asked for.
    pub psnr: Option<f64>,
    pub encode_seconds: f64,
    pub decode_seconds: f64,
    pub solves: usize,
    pub iterations: usize,
    pub missed: usize,
}

/// A command line of `csbrdf encode`.
pub struct Invocation {
    /// As a shell reads it.
    pub command: String,
    pub args: EncodeArgs,
}

impl Invocation {
    /// The command that encodes `table` with `settings` into a file `output`. What the options mean is left to the
    /// parser of the command line, so that the command gives what was measured.
    pub fn new(table: &Path, settings: &str, output: &str, threads: Option<u16>) -> Result<Invocation, Failure> {
        let mut name = table.to_string_lossy().into_owned();
        if name.starts_with('-') {
            name.insert_str(0, "./");
        }
        let threads = threads.map(|n| format!("--threads {n}")).unwrap_or_default();
        let mut words = vec!["csbrdf", "encode", &name];
        words.extend(settings.split_whitespace().chain(threads.split_whitespace()).chain(["-o", output]));
        let cli = Cli::try_parse_from(&words).map_err(|e| {
            let text = e.to_string();
            let what = text.lines().next().unwrap_or_default();
            Failure::usage(format!("{settings}: {}; see csbrdf help encode", what.trim_start_matches("error: ")))
        })?;
        let Command::Encode(args) = cli.command else {
            return Err(Failure::usage(format!("{settings}: no options of csbrdf encode")));
        };
        let words: Vec<_> = words.into_iter().map(quote::shell).collect();
        Ok(Invocation { command: words.join(" "), args })
    }

    /// The encoder that the command runs, the metadata aside.
    pub fn encoder(&self) -> Encoder {
        encode::encoder(&self.args)
    }
}

/// A table to encode and its picture to compare to.
pub struct Subject {
    pub table: Table,
    /// What the input's name and bytes put into the metadata of its files.
    pub metadata: Metadata,
    pub picture: Option<Image>,
}

/// Encodes, decodes and measures.
pub fn measure(
    subject: &Subject,
    settings: &str,
    invocation: &Invocation,
    progress: &(dyn Fn(f64) + Sync),
) -> csbrdf::Result<Point> {
    let encoder = invocation.encoder().metadata(subject.metadata.clone());
    let encoded = encoder.encode_with(&subject.table, progress)?;
    let bytes = encoded.bytes;
    let mut decode_seconds = f64::INFINITY;
    for _ in 0..DECODES {
        let start = Instant::now();
        drop(Reader::open(&bytes[..])?.decode_all()?);
        decode_seconds = decode_seconds.min(start.elapsed().as_secs_f64());
    }
    let reader = Reader::open(&bytes[..])?;
    let psnr = match &subject.picture {
        None => None,
        Some(picture) => Some(psnr(picture, &sphere_of_table(&reader.decode_table()?, picture.width))?),
    };
    let report = encoded.report;
    let used = reader.metadata()?.encoder.unwrap_or_default();
    let lengths = |shape: &serde_json::Value| {
        let lengths = shape.as_array().into_iter().flatten();
        lengths.map(ToString::to_string).collect::<Vec<_>>().join("x")
    };
    let shapes: Vec<String> = used["block_shapes"].as_array().into_iter().flatten().map(lengths).collect();
    Ok(Point {
        settings: settings.into(),
        command: invocation.command.clone(),
        preset: preset_name(invocation.args.preset()),
        basis: reader.coding().basis.as_str().into(),
        block: shapes.join(" "),
        ratio: as_given(reader.coding().sampling.ratio()),
        sigma: used["sigma"].as_f64().unwrap_or(f64::NAN),
        quality: used["quality"].as_f64().unwrap_or(f64::NAN),
        bytes: bytes.len(),
        log_rms: report.log_rms,
        log_max: report.log_max,
        psnr,
        encode_seconds: report.seconds,
        decode_seconds,
        solves: report.solves,
        iterations: report.iterations,
        missed: report.missed_sigma,
    })
}

/// A ratio as its user wrote it: a file keeps it in steps of 2^-32.
fn as_given(ratio: f64) -> f64 {
    (1e9 * ratio).round() / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{BasisArg, PresetArg};

    #[test]
    fn the_command_is_what_is_parsed() {
        let path = Path::new("my table.binary");
        let settings = "--preset paper --basis dct --sigma 0.01 --iterations 7 --block-shape 5,5,5";
        let invocation = Invocation::new(path, settings, "t.csbrdf", Some(2)).unwrap();
        assert_eq!(invocation.command, format!("csbrdf encode 'my table.binary' {settings} --threads 2 -o t.csbrdf"));
        let args = &invocation.args;
        assert_eq!((args.preset(), args.basis, args.sigma), (PresetArg::Paper, Some(BasisArg::Dct), Some(0.01)));
        assert_eq!((args.iterations, args.block.as_ref().unwrap().0.as_slice()), (Some(7), &[5, 5, 5][..]));
        assert!(Invocation::new(Path::new("-x"), "", "o", None).unwrap().command.contains(" ./-x "));
        for wrong in ["--sigma x", "--sigma 1 --sigma 2", "--nonsense", "--help"] {
            assert!(Invocation::new(path, wrong, "o", None).is_err());
        }
    }
}
