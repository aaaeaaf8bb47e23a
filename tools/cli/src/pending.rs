//! A file that is being written, until it is complete and gets its name.
//!
//! On Linux it has no name before: whatever ends the tool (a signal, a full disk, the power), nothing is left of it. Elsewhere, and
//! on file systems that cannot do that, it has a name `.csbrdf-*.tmp` beside the one it is to get, which stays if the tool is
//! killed while it writes.

use std::fs::File;
use std::io::Result;
use std::path::Path;

use tempfile::{Builder, NamedTempFile};

use crate::path::folder_of;

/// See the module.
pub enum Pending {
    #[cfg(target_os = "linux")]
    Nameless(File),
    Named(NamedTempFile),
}

impl Pending {
    /// A file in the folder of `path`.
    pub fn beside(path: &Path) -> Result<Pending> {
        #[cfg(target_os = "linux")]
        if let Some(file) = nameless::open(folder_of(path)) {
            return Ok(Pending::Nameless(file));
        }
        named(path).map(Pending::Named)
    }

    pub fn file(&mut self) -> &mut File {
        match self {
            #[cfg(target_os = "linux")]
            Pending::Nameless(file) => file,
            Pending::Named(temporary) => temporary.as_file_mut(),
        }
    }

    /// Brings the file to the disk and gives it its name: in place of a file that has it if `replace` is set, else the
    /// system refuses if there is one (`AlreadyExists`).
    pub fn keep(mut self, path: &Path, replace: bool) -> Result<()> {
        self.file().sync_all()?;
        match self {
            #[cfg(target_os = "linux")]
            Pending::Nameless(file) => nameless::keep(file, path, replace),
            Pending::Named(temporary) => rename(temporary, path, replace),
        }
    }
}

fn rename<F>(temporary: NamedTempFile<F>, path: &Path, replace: bool) -> Result<()> {
    let renamed = match replace {
        true => temporary.persist(path),
        false => temporary.persist_noclobber(path),
    };
    renamed.map(|_| ()).map_err(|e| e.error)
}

/// Of temporary names.
fn builder() -> Builder<'static, 'static> {
    let mut builder = Builder::new();
    builder.prefix(".csbrdf-").suffix(".tmp");
    builder
}

fn named(path: &Path) -> Result<NamedTempFile> {
    let mut builder = builder();
    // Temporary files are private; the result has the permissions of any new file.
    #[cfg(unix)]
    let permissions: std::fs::Permissions = std::os::unix::fs::PermissionsExt::from_mode(0o666);
    #[cfg(unix)]
    builder.permissions(permissions);
    builder.tempfile_in(folder_of(path))
}

/// Files without a name: `open(2)` with `O_TMPFILE`, and `linkat(2)` by way of /proc to give them one.
#[cfg(target_os = "linux")]
mod nameless {
    use std::io::{Error, ErrorKind, Seek};
    use std::os::fd::AsRawFd;
    use std::os::unix::fs::OpenOptionsExt;

    use rustix::fs::{AtFlags, CWD, OFlags, linkat};

    use super::*;

    /// `None` if the file system cannot, or anything else is amiss: a named file is tried then, and its error is the one to report.
    pub fn open(folder: &Path) -> Option<File> {
        let flags = OFlags::TMPFILE.bits() as i32;
        File::options().read(true).write(true).custom_flags(flags).mode(0o666).open(folder).ok()
    }

    pub fn keep(mut file: File, path: &Path, replace: bool) -> Result<()> {
        let source = format!("/proc/self/fd/{}", file.as_raw_fd());
        let link = |name: &Path| linkat(CWD, &source, CWD, name, AtFlags::SYMLINK_FOLLOW).map_err(Error::from);
        let linked = match replace {
            // A link does not replace a file, a rename does.
            true => builder().make_in(folder_of(path), link).and_then(|named| rename(named, path, true)),
            false => link(path),
        };
        match linked {
            Err(e) if e.kind() != ErrorKind::AlreadyExists => {
                // Without /proc, say.
                let mut temporary = named(path)?;
                file.rewind()?;
                std::io::copy(&mut file, temporary.as_file_mut())?;
                temporary.as_file().sync_all()?;
                rename(temporary, path, replace)
            }
            done => done,
        }
    }
}
