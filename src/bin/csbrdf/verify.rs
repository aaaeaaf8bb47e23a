//! `csbrdf verify`: every byte of a file, and what it states about its errors.

use std::fmt::Write;
use std::path::Path;

use csbrdf::decode::Reader;
use csbrdf::proof::prove;
use sha2::{Digest, Sha256};

use crate::args::VerifyArgs;
use crate::encode::hex;
use crate::failure::{Failure, Outcome};
use crate::input::{self, Bytes, label};
use crate::output::print;
use crate::text::{clean, decibel, error_figure, grouped};

pub fn run(args: &VerifyArgs, quiet: bool) -> Outcome {
    if args.against.is_some() && args.files.len() > 1 {
        return Err(Failure::usage("--against ORIGINAL is for one file; verify them one by one"));
    }
    if args.against.as_deref().is_some_and(input::is_dash) {
        return Err(Failure::usage("--against reads the original twice; give a file, not standard input"));
    }
    let mut first_failure = None;
    for file in &args.files {
        let (text, result) = verify(file, args.against.as_deref());
        if !quiet {
            print(&text)?;
        }
        if let Err(failure) = result {
            failure.report();
            first_failure.get_or_insert(failure.reported());
        }
    }
    first_failure.map_or(Ok(()), Err)
}

fn verify(file: &Path, against: Option<&Path>) -> (String, Outcome) {
    let reader = match input::open(file) {
        Ok(reader) => reader,
        Err(failure) => return (String::new(), Err(failure)),
    };
    let name = clean(&label(file));
    let damage = reader.verify();
    let Some(first) = damage.first() else {
        let ok = format!("{name}: ok, {} blocks\n", grouped(reader.block_count()));
        return match against {
            None => (ok, Ok(())),
            Some(original) => {
                let mut text = ok;
                let outcome = proof(file, &reader, original, &mut text);
                (text, outcome)
            }
        };
    };
    let mut text = String::new();
    for error in &damage {
        let _ = writeln!(text, "{name}: {}", clean(&error.to_string()));
    }
    let places = if damage.len() == 1 { "one place is".into() } else { format!("{} places are", damage.len()) };
    let failure = match first {
        csbrdf::Error::LimitExceeded { .. } => Failure::in_file(file, first),
        _ => Failure::bad_input(file, format!("{places} damaged; fetch the file again")),
    };
    (text, Err(failure))
}

/// Measures the file's errors against the original and adds what it finds to the text.
fn proof(file: &Path, reader: &Reader<Bytes>, original: &Path, text: &mut String) -> Outcome {
    let failed = |e: csbrdf::Error| Failure::in_file(file, &e);
    let bytes = input::read(original)?;
    let hash = hex(&Sha256::digest(bytes.as_ref()));
    drop(bytes);
    let proof = prove(&input::table(original)?, reader).map_err(failed)?;
    let (name, figures) = (clean(&label(file)), &proof.figures);
    let mut broken = proof.broken;
    if let Some(stated) = reader.metadata().map_err(failed)?.source_sha256.filter(|stated| *stated != hash) {
        let other = clean(&label(original));
        broken.push(format!("{other} is not the table that the file was made from: SHA-256 {hash}, stated {stated}"));
    }
    let errors = format!("log rms {}, largest {}", error_figure(figures.log_rms), error_figure(figures.log_max));
    let contract = match proof.contract {
        None => "no contract stated".into(),
        Some(contract) => {
            let figure = figures.psnr.map_or(String::new(), |psnr| format!(", render PSNR {} dB", decibel(psnr)));
            let word = if contract.kept(figures) { "kept" } else { "broken" };
            format!("contract {} {} {word}{figure}", contract.name(), contract.asked())
        }
    };
    let bits = if reader.is_lossless() && broken.is_empty() { ", every bit restored" } else { "" };
    let _ = writeln!(text, "{name}: {errors}, {contract}{bits}");
    for statement in &broken {
        let _ = writeln!(text, "{name}: {}", clean(statement));
    }
    match broken.len() {
        0 => Ok(()),
        n => Err(Failure::operation(format!("{name}: does not keep its word against the original ({n} statements)"))),
    }
}
