//! Failures of the tool: one line on standard error and an exit code.

use std::io::Write;
use std::path::{Path, PathBuf};

use crate::path::label;
use crate::text::clean;

/// Exit codes, as `--help` lists them.
const OPERATION: u8 = 1;
const USAGE: u8 = 2;
const BAD_INPUT: u8 = 3;
const UNSUPPORTED: u8 = 4;
/// What shells report of a program that SIGPIPE ended, 128 + 13.
const BROKEN_PIPE: u8 = 141;

/// Why a command ended early.
#[derive(Debug)]
pub struct Failure {
    code: u8,
    /// `None` if there is nothing (more) to say: it was said already, or the reader of our output has gone.
    message: Option<String>,
}

/// What a command returns.
pub type Outcome = Result<(), Failure>;

/// Runs `work` on each file and its number. A failure is reported and does not stop the others; the first is the result.
pub fn each(files: &[PathBuf], mut work: impl FnMut(usize, &Path) -> Outcome) -> Outcome {
    let mut first_failure = None;
    for (i, file) in files.iter().enumerate() {
        match work(i, file) {
            Err(failure) if failure.is_quiet() => return Err(failure),
            Err(failure) => {
                failure.report();
                first_failure.get_or_insert(failure.reported());
            }
            Ok(()) => {}
        }
    }
    first_failure.map_or(Ok(()), Err)
}

impl Failure {
    fn new(code: u8, message: String) -> Failure {
        Failure { code, message: Some(message) }
    }

    /// The machine refused something.
    pub fn operation(message: String) -> Failure {
        Failure::new(OPERATION, message)
    }

    /// The arguments do not make sense together.
    pub fn usage(message: impl Into<String>) -> Failure {
        Failure::new(USAGE, message.into())
    }

    /// A file's contents are damaged or not what they should be.
    pub fn bad_input(file: &Path, what: impl std::fmt::Display) -> Failure {
        Failure::new(BAD_INPUT, format!("{}: {what}", label(file)))
    }

    /// A file is beyond what this build handles.
    pub fn unsupported(file: &Path, what: impl std::fmt::Display) -> Failure {
        Failure::new(UNSUPPORTED, format!("{}: {what}", label(file)))
    }

    /// Reading or writing the named file failed.
    pub fn io(file: &Path, error: &std::io::Error) -> Failure {
        use std::io::ErrorKind::*;
        let remedy = match error.kind() {
            NotFound => "; check the path",
            InvalidFilename => "; choose a shorter name",
            PermissionDenied => "; check the permissions",
            StorageFull | QuotaExceeded => "; free some space",
            _ => "",
        };
        Failure::operation(format!("{}: {}{remedy}", label(file), plain(error)))
    }

    /// Standard output failed; quietly if its reader has closed it, which has what it wanted.
    pub fn stdout(error: &std::io::Error) -> Failure {
        use std::io::ErrorKind::*;
        let remedy = match error.kind() {
            BrokenPipe => return Failure { code: BROKEN_PIPE, message: None },
            StorageFull | QuotaExceeded => "; free some space",
            _ => "",
        };
        Failure::operation(format!("standard output: {}{remedy}", plain(error)))
    }

    /// Everything was reported already; only the exit code of `self` is left.
    pub fn reported(self) -> Failure {
        Failure { message: None, ..self }
    }

    /// An error of the library about the named file.
    pub fn in_file(file: &Path, error: &csbrdf::Error) -> Failure {
        use csbrdf::Error::*;
        let code = match error.kind() {
            Io(e) => return Failure::io(file, e),
            NotCsbrdf { .. } | NotATable(_) | Truncated { .. } | Corrupt { .. } => BAD_INPUT,
            UnsupportedVersion { .. } | LimitExceeded { .. } => UNSUPPORTED,
            InvalidArgument(_) => USAGE,
            _ => OPERATION,
        };
        // The remedy for a corrupt file, where the error does not name one.
        let remedy = match error.kind() {
            Corrupt { what, .. } if !what.contains("fetch") && !what.contains('?') => "; fetch or make the file again",
            _ => "",
        };
        Failure::new(code, format!("{}: {}{remedy}", label(file), error.kind()))
    }

    /// An error of the library about the arguments.
    pub fn in_arguments(error: &csbrdf::Error) -> Failure {
        Failure::usage(error.kind().to_string())
    }

    /// True if nobody reads the output any more, so that more work is in vain.
    pub fn is_quiet(&self) -> bool {
        self.code == BROKEN_PIPE
    }

    /// The exit code.
    pub fn code(&self) -> u8 {
        self.code
    }

    /// Prints the message, one line.
    pub fn report(&self) {
        if let Some(message) = &self.message {
            note(&format!("csbrdf: {message}"));
        }
    }
}

/// An operating system's error without its number.
fn plain(error: &std::io::Error) -> String {
    let text = error.to_string();
    let text = text.split(" (os error").next().unwrap_or(&text);
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_lowercase().chain(letters).collect())
}

/// Most characters of a line. Foreign text in it is cut where it is quoted; this is for what nobody thought of.
const MOST: usize = 10_000;

/// A line on standard error; whether anybody reads it does not matter.
pub fn note(line: &str) {
    let end = line.char_indices().nth(MOST).map_or(line.len(), |(end, _)| end);
    let (shown, rest) = line.split_at(end);
    let more = if rest.is_empty() { String::new() } else { format!("... ({} more bytes)", rest.len()) };
    let _ = writeln!(std::io::stderr().lock(), "{}{more}", clean(shown));
}
