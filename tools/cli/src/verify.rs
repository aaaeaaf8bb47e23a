//! `csbrdf verify`: every byte of a file or of the files of a manifest, and what they state about their errors.

pub mod file;

use crate::args::VerifyArgs;
use crate::failure::{Failure, Outcome};
use crate::formats::Kind;
use crate::input;
use crate::path::{folder_of, is_dash, label};
use crate::sets::check;
use crate::sets::manifest::Manifest;
use crate::sets::unfinished::is_in;
use file::{Original, Results, verify};

pub fn run(args: &VerifyArgs, quiet: bool) -> Outcome {
    if args.against.is_some() && args.files.len() > 1 {
        return Err(Failure::usage("--against ORIGINAL is for one file or manifest; verify them one by one"));
    }
    if args.against.as_deref().is_some_and(is_dash) {
        return Err(Failure::usage("--against takes the file of the original, not standard input"));
    }
    let mut results = Results { quiet, first_failure: None };
    for file in &args.files {
        match input::read(file, &[Kind::Csbrdf, Kind::Manifest]) {
            Ok(bytes) if Manifest::is_likely(bytes.as_ref()) => {
                let result = check::run(file, bytes.as_ref(), args.against.as_deref(), &mut results);
                results.result(String::new(), result)?;
            }
            Ok(bytes) => {
                let original = args.against.as_deref().map(|table| Original { table, sha256: None });
                let (text, result) = verify(file, bytes, original.as_ref());
                results.result(text, result)?;
            }
            Err(_) if !file.exists() && is_in(folder_of(file)) => {
                let what =
                    "is not there yet: the set is not finished; run its csbrdf encode again, which keeps what is";
                results.result(String::new(), Err(Failure::operation(format!("{}: {what}", label(file)))))?;
            }
            Err(failure) => results.result(String::new(), Err(failure))?,
        }
    }
    results.first_failure.map_or(Ok(()), Err)
}
