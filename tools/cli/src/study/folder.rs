//! The folder of the results.

use std::path::{Path, PathBuf};

use crate::failure::{Failure, Outcome};
use crate::guard::Guard;
use crate::names;
use crate::output::Target;
use crate::picture::Picture;

/// Files that go into one folder.
pub struct Folder {
    path: PathBuf,
    guard: Guard,
}

impl Folder {
    /// Makes the folder if need be. Fails at once if nothing could be written later, or if it is in use and `force`
    /// is not set.
    pub fn open(path: &Path, force: bool, guard: Guard) -> Result<Folder, Failure> {
        let failed = |e: std::io::Error| Failure::io(path, &e);
        if path.exists() && !path.is_dir() {
            return Err(Failure::operation(format!("{}: is a file; name a folder", path.display())));
        }
        std::fs::create_dir_all(path).map_err(failed)?;
        if !force && std::fs::read_dir(path).map_err(failed)?.next().is_some() {
            let what = "is not empty; name a new folder, or give --force to replace files in it";
            return Err(Failure::operation(format!("{}: {what}", path.display())));
        }
        tempfile::tempfile_in(path).map_err(failed)?;
        // As long a name as a material gets, with what is put before and after it.
        let longest = path.join("n".repeat(names::LONGEST + 30));
        if let Err(e) = std::fs::symlink_metadata(&longest)
            && e.kind() == std::io::ErrorKind::InvalidFilename
        {
            return Err(failed(e));
        }
        Ok(Folder { path: path.to_path_buf(), guard })
    }

    /// Writes a file, whole or not at all.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Outcome {
        Target::File(self.path.join(name)).write(&self.guard, |out| Ok(out.write_all(bytes)?))
    }

    /// Writes a PNG file.
    pub fn picture(&self, name: &str, picture: &Picture) -> Outcome {
        picture.write(&Target::File(self.path.join(name)), &self.guard)
    }
}
