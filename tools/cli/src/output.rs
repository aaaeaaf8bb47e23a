//! Outputs: standard output, or a file that appears under its name only when it is complete.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::failure::{Failure, Outcome, note};
use crate::guard::{Guard, exists};
use crate::path::{folder_of, is_dash, label};
use crate::pending::Pending;
use crate::stdout;

pub use crate::stdout::print;

/// Where a command's result goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Target {
    /// Standard output.
    Stdout,
    /// A file.
    File(PathBuf),
}

impl Target {
    /// The target that `-o` names.
    pub fn of(path: &Path) -> Target {
        if is_dash(path) { Target::Stdout } else { Target::File(path.to_path_buf()) }
    }

    /// Fails if writing would fail for a reason that can be known before the work: the file exists and may not be
    /// replaced, its folder does not, or bytes that are no text would go to a terminal.
    pub fn check(&self, guard: &Guard) -> Outcome {
        let path = match self {
            Target::Stdout if stdout::is_terminal() => {
                return Err(Failure::usage("binary data is not written to a terminal; use -o FILE or a pipe"));
            }
            Target::Stdout => return stdout::lock().map(drop),
            Target::File(path) => path,
        };
        match std::fs::metadata(path) {
            Ok(found) if found.is_dir() => {
                Err(Failure::operation(format!("{}: is a directory; name a file in it", path.display())))
            }
            Ok(_) => guard.check(path),
            // Too long a name: known now, not after the work.
            Err(e) if e.kind() == std::io::ErrorKind::InvalidFilename => Err(Failure::io(path, &e)),
            Err(_) if !folder_of(path).is_dir() => {
                let folder = folder_of(path).display().to_string();
                Err(Failure::operation(format!("{}: no folder {folder}; make it first", path.display())))
            }
            Err(_) => Ok(()),
        }
    }

    /// Writes what `fill` produces. A file gets its name when it is complete and on the disk; if anything fails, nothing is
    /// left. Devices and pipes are written to directly.
    pub fn write(&self, guard: &Guard, fill: impl FnOnce(&mut dyn Write) -> csbrdf::Result<()>) -> Outcome {
        let path = match self {
            Target::Stdout => {
                let mut out = BufWriter::new(stdout::lock()?);
                let written = fill(&mut out).and_then(|()| Ok(out.flush()?));
                return written.map_err(|e| match e.kind() {
                    csbrdf::Error::Io(e) => Failure::stdout(e),
                    _ => Failure::in_arguments(&e),
                });
            }
            Target::File(path) => path,
        };
        // It may have been made in the meantime.
        guard.check(path)?;
        let failed = |e: csbrdf::Error| Failure::in_file(path, &e);
        let io = |e: std::io::Error| Failure::io(path, &e);
        if std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) {
            let mut out = BufWriter::new(File::options().write(true).open(path).map_err(io)?);
            return fill(&mut out).and_then(|()| Ok(out.flush()?)).map_err(failed);
        }
        let mut pending = Pending::beside(path).map_err(io)?;
        let mut out = BufWriter::new(pending.file());
        fill(&mut out).and_then(|()| Ok(out.flush()?)).map_err(failed)?;
        drop(out);
        pending.keep(path, guard.replaces()).map_err(|e| match e.kind() {
            // The name was taken while it was written.
            std::io::ErrorKind::AlreadyExists if !guard.replaces() => exists(path),
            _ => io(e),
        })?;
        // The name itself, where folders can be synchronised.
        if let Ok(folder) = File::open(folder_of(path)) {
            let _ = folder.sync_all();
        }
        Ok(())
    }

    /// Says which file was written, and from what, unless all is to be quiet; whoever named standard output knows.
    pub fn announce(&self, from: Option<&Path>, quiet: bool) {
        match from {
            _ if quiet || *self == Target::Stdout => {}
            Some(from) => note(&format!("{} -> {self}", label(from))),
            None => note(&format!("{self}: written")),
        }
    }
}

impl std::fmt::Display for Target {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Target::Stdout => write!(f, "standard output"),
            Target::File(path) => write!(f, "{}", path.display()),
        }
    }
}
