//! Files as bytes: the one place with `unsafe`.

use std::fs::File;
use std::path::Path;

use memmap2::Mmap;

use crate::error::{Error, Result};

/// Maps a file read-only.
///
/// The bytes are those of the file as long as nobody changes it in place; csbrdf itself replaces files by rename,
/// which leaves maps intact. If another process truncates the file, touching the lost pages ends this process by
/// SIGBUS; where that matters, read the file into a `Vec<u8>` and open that.
///
/// # Errors
/// `Io` in the named file.
#[allow(unsafe_code)]
pub fn map_file(path: &Path) -> Result<Mmap> {
    let file = File::open(path).map_err(|e| Error::Io(e).in_file(path))?;
    // SAFETY: the map is read-only and private to this value. Undefined behaviour needs another process (or this
    // one, through another handle) to change the file while it is mapped, which the documentation above rules out.
    unsafe { Mmap::map(&file) }.map_err(|e| Error::Io(e).in_file(path))
}
