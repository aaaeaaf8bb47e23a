//! The one error type of the crate.

use std::fmt;
use std::path::PathBuf;

use super::version::{DRAFTS, VERSION};

/// What went wrong, where, and what to do about it.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused an operation.
    Io(std::io::Error),
    /// The bytes are not a csbrdf file at all.
    NotCsbrdf {
        /// What the first bytes look like instead.
        looks_like: &'static str,
    },
    /// The bytes hold no table in an outside format that is read (`csbrdf::io`): what they look like, and what to do.
    NotATable(String),
    /// A csbrdf file of a version that this build does not read.
    UnsupportedVersion {
        /// Major version, minor version and draft number of the file.
        found: (u16, u16, u16),
    },
    /// The file ends before its contents do.
    Truncated {
        /// Section in which the data ends.
        section: &'static str,
        /// Bytes needed from the start of the file (or stream).
        expected: u64,
        /// Bytes present.
        got: u64,
    },
    /// The contents contradict themselves or the specification.
    Corrupt {
        /// Section of the file (spec name), or the name of an outside format.
        section: &'static str,
        /// Byte offset from the start of the file.
        offset: u64,
        /// What was found and what was expected.
        what: String,
    },
    /// A block that was pruned from the file, which the caller did not allow ([`crate::decode::PrunedPolicy`]).
    Pruned {
        /// Its number.
        block: usize,
    },
    /// A block that damage took before the file was repaired ([`crate::edit::salvage`]), which the caller did not allow to stand for
    /// ([`crate::decode::PrunedPolicy`]).
    Lost {
        /// Its number.
        block: usize,
    },
    /// A size is beyond the limits that the caller set ([`crate::base::limits::Limits`]).
    LimitExceeded {
        /// Name of the limited quantity.
        what: &'static str,
        /// The value found.
        got: u64,
        /// The largest value allowed.
        limit: u64,
    },
    /// The machine has no memory for what the file needs; nothing was aborted.
    OutOfMemory {
        /// Bytes that were asked for.
        bytes: u64,
    },
    /// An encoder's contract cannot be met, or a file breaks the one that it states.
    ContractNotMet(String),
    /// An argument of the call is out of its range.
    InvalidArgument(String),
    /// Any of the above, in a named file.
    InFile {
        /// The file.
        path: PathBuf,
        /// What happened there.
        source: Box<Error>,
    },
}

/// Result with the crate's [`Error`].
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// The same error, naming the file in which it happened.
    pub fn in_file(self, path: impl Into<PathBuf>) -> Error {
        match self {
            named @ Error::InFile { .. } => named,
            other => Error::InFile { path: path.into(), source: Box::new(other) },
        }
    }

    /// The error without the file name around it.
    pub fn kind(&self) -> &Error {
        match self {
            Error::InFile { source, .. } => source.kind(),
            other => other,
        }
    }

    /// Shorthand for [`Error::Corrupt`].
    pub(crate) fn corrupt(section: &'static str, offset: u64, what: impl Into<String>) -> Error {
        Error::Corrupt { section, offset, what: what.into() }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Io(e) => write!(f, "{e}"),
            Error::NotCsbrdf { looks_like } => {
                write!(f, "not a csbrdf file ({looks_like}); `csbrdf encode` makes one from a MERL .binary table")
            }
            Error::NotATable(what) => write!(f, "{what}"),
            Error::UnsupportedVersion { found: (major, minor, draft) } => {
                write!(f, "format version {major}.{minor}")?;
                if *draft != 0 {
                    write!(f, " draft {draft}")?;
                }
                let ((m, ..), drafts) = (VERSION, DRAFTS);
                let (oldest, newest) = (drafts.start(), drafts.end());
                write!(
                    f,
                    " is not known to this build, which reads {m}.x and drafts {oldest} to {newest} of {m}.0; use the \
                     csbrdf release that wrote the file, or encode the table again"
                )
            }
            Error::Truncated { section, expected, got } => {
                write!(f, "truncated in {section}: {expected} bytes needed, {got} present; fetch the file again")
            }
            Error::Corrupt { section, offset, what } => {
                write!(f, "corrupt {section} at offset {offset}: {what}")
            }
            Error::Pruned { block } => {
                write!(
                    f,
                    "block {block} was pruned from this file; use the file that it was pruned from, or allow the block's \
                     mean in its place (--coarse, PrunedPolicy::Coarse)"
                )
            }
            Error::Lost { block } => {
                write!(
                    f,
                    "block {block} was lost to damage before this file was repaired; use an intact copy of the file, or allow what is \
                     left of the block in its place, its mean at best (--coarse, PrunedPolicy::Coarse)"
                )
            }
            Error::LimitExceeded { what, got, limit } => {
                write!(
                    f,
                    "{what} is {got}, above the limit of {limit}; raise the limit if the file is trusted (--limit, Limits)"
                )
            }
            Error::OutOfMemory { bytes } => {
                write!(f, "no memory for {bytes} bytes; close other programs, or lower the limits to refuse such files")
            }
            Error::ContractNotMet(what) | Error::InvalidArgument(what) => write!(f, "{what}"),
            Error::InFile { path, source } => write!(f, "{}: {source}", path.display()),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Io(e) => Some(e),
            Error::InFile { source, .. } => Some(source),
            _ => None,
        }
    }
}

impl From<std::io::Error> for Error {
    fn from(e: std::io::Error) -> Self {
        Error::Io(e)
    }
}
