//! `csbrdf verify`: every byte of a file.

use std::fmt::Write;

use crate::args::VerifyArgs;
use crate::failure::{Failure, Outcome};
use crate::input::{self, label};
use crate::output::print;
use crate::text::{clean, grouped};

pub fn run(args: &VerifyArgs, quiet: bool) -> Outcome {
    let mut first_failure = None;
    for file in &args.files {
        let (text, result) = verify(file);
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

fn verify(file: &std::path::Path) -> (String, Outcome) {
    let reader = match input::open(file) {
        Ok(reader) => reader,
        Err(failure) => return (String::new(), Err(failure)),
    };
    let name = clean(&label(file));
    let damage = reader.verify();
    let Some(first) = damage.first() else {
        return (format!("{name}: ok, {} blocks\n", grouped(reader.block_count())), Ok(()));
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
