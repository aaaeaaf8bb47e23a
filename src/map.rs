//! What is asked of the system's memory: files as bytes, large pages.

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
pub fn map_file(path: &Path) -> Result<Mmap> {
    let file = File::open(path).map_err(|e| Error::Io(e).in_file(path))?;
    map_opened(&file).map_err(|e| e.in_file(path))
}

/// As [`map_file`], of a file that is open for reading: what was checked of it is what is mapped.
///
/// # Errors
/// `Io`.
#[allow(unsafe_code)]
pub fn map_opened(file: &File) -> Result<Mmap> {
    // SAFETY: the map is read-only and private to this value. Undefined behaviour needs another process (or this
    // one, through another handle) to change the file while it is mapped, which the documentation above rules out.
    unsafe { Mmap::map(file) }.map_err(Error::Io)
}

/// Bytes from which large pages are worth asking for.
#[cfg(all(target_os = "linux", not(miri)))]
const LARGE: usize = 4 << 20;

/// Asks for large pages behind memory that nobody has touched yet. Of small ones Linux hands out those of a MERL table one by one,
/// in half the time that decoding it takes.
#[cfg(all(target_os = "linux", not(miri)))]
#[allow(unsafe_code)]
pub(crate) fn ask_for_large_pages<T>(values: &mut [T]) {
    // The largest of Linux's usual pages.
    const PAGE: usize = 1 << 16;
    let bytes = size_of_val(values);
    if bytes < LARGE {
        return;
    }
    let start = values.as_mut_ptr().cast::<u8>();
    let skipped = start.addr().next_multiple_of(PAGE) - start.addr();
    let length = (bytes - skipped) / PAGE * PAGE;
    // SAFETY: a hint about pages that lie within the slice as a whole; their contents stay. That it may be refused is no harm.
    unsafe { libc::madvise(start.wrapping_add(skipped).cast(), length, libc::MADV_HUGEPAGE) };
}

#[cfg(not(all(target_os = "linux", not(miri))))]
pub(crate) fn ask_for_large_pages<T>(_: &mut [T]) {}

#[cfg(test)]
mod tests {
    use super::*;

    /// Also of a slice whose ends are within pages.
    #[test]
    fn asking_for_large_pages_changes_no_value() {
        for count in [0, 3, 1 << 20, 3 << 20] {
            let mut values: Vec<u32> = (0..count).collect();
            let first = values.len().min(5);
            ask_for_large_pages(&mut values[first..]);
            assert!(values.iter().zip(0..).all(|(value, i)| *value == i));
        }
    }
}
