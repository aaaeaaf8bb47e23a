//! One file: every byte of it, and what it states about its errors.

use std::fmt::Write;
use std::path::Path;

use csbrdf::assess::proof::prove;
use csbrdf::decode::Reader;
use sha2::{Digest, Sha256};

use crate::failure::{Failure, Outcome};
use crate::formats::TABLE;
use crate::gone::Gone;
use crate::input::{self, Bytes};
use crate::output::print;
use crate::path::label;
use crate::text::hex;
use crate::text::{clean, decibel, error_figure, grouped};

/// Reports results as they come.
pub struct Results {
    /// Failures only.
    pub quiet: bool,
    /// The first failure so far.
    pub first_failure: Option<Failure>,
}

impl Results {
    /// Text to standard output unless that is to be quiet, a failure to standard error. Fails if nobody reads any more.
    pub fn result(&mut self, text: String, result: Outcome) -> Outcome {
        if !self.quiet {
            print(&text)?;
        }
        if let Err(failure) = result {
            failure.report();
            self.first_failure.get_or_insert(failure.reported());
        }
        Ok(())
    }
}

/// The table that a file was made from.
pub struct Original<'a> {
    /// Where it is.
    pub table: &'a Path,
    /// Its SHA-256 as others than the file state it.
    pub sha256: Option<&'a str>,
}

/// Checks a file, and compares it with its original if that is given.
pub fn verify(file: &Path, bytes: Bytes, against: Option<&Original>) -> (String, Outcome) {
    let reader = match input::reader(bytes) {
        Ok(reader) => reader,
        Err(e) => return (String::new(), Err(Failure::in_file(file, &e))),
    };
    let name = clean(&label(file));
    let damage = reader.verify();
    let Some(first) = damage.first() else {
        let gone = Gone::of(&reader);
        let (mut text, mut outcome) = intact(file, &name, &gone);
        if let Some(original) = against {
            let proven = proof(file, &reader, original, &mut text);
            outcome = outcome.and(proven);
        }
        return (text, outcome);
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

/// What is said of a file without damage: that damage took some of it before it was repaired, if so, is a failure.
fn intact(file: &Path, name: &str, gone: &Gone) -> (String, Outcome) {
    let blocks = grouped(gone.blocks);
    let pruned = match gone.pruned {
        0 => String::new(),
        n => format!(", {} of them pruned", grouped(n)),
    };
    if !gone.is_hurt() {
        return (format!("{name}: ok, {blocks} blocks{pruned}\n"), Ok(()));
    }
    let what = gone.what_is_lost();
    let text = format!("{name}: what there is is intact, {blocks} blocks{pruned}, but {what}\n");
    (text, Err(Failure::bad_input(file, format!("{what}; the file was repaired: look for an intact copy of it"))))
}

/// Measures the file's errors against the original and adds what it finds to the text.
fn proof(file: &Path, reader: &Reader, original: &Original, text: &mut String) -> Outcome {
    let sha256 = original.sha256.map(str::to_string);
    let original = original.table;
    let failed = |e: csbrdf::Error| Failure::in_file(file, &e);
    // Read once: what is compared is what the hash is of.
    let bytes = match sha256 {
        None => input::read(original, TABLE)?,
        // Of a set, which names its tables itself.
        Some(_) => input::read_regular(original, TABLE)?,
    };
    let hash = hex(&Sha256::digest(bytes.as_ref()));
    let proof = prove(&input::table_of(original, bytes)?, reader).map_err(failed)?;
    let (name, figures) = (clean(&label(file)), &proof.figures);
    let mut broken = proof.broken;
    let stated = reader.metadata().map_err(failed)?.source_sha256;
    if let Some(stated) = stated.into_iter().chain(sha256).find(|stated| *stated != hash) {
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
