//! What is asked of the system's memory: files as bytes, large pages.

use std::fs::{File, Metadata};
use std::io;
use std::path::Path;

use memmap2::Mmap;

use crate::base::error::{Error, Result};

/// Maps a file read-only.
///
/// The bytes are those of the file as long as nobody changes it in place; csbrdf itself replaces files by rename,
/// which leaves maps intact. If another process truncates the file, touching the lost pages ends this process by
/// SIGBUS; where that matters, read the file into a `Vec<u8>` and open that.
///
/// # Errors
/// `Io` in the named file; at once also of pipes, sockets and devices, whose other end may never come.
pub fn map_file(path: &Path) -> Result<Mmap> {
    let file = open_regular(path).map_err(|e| Error::Io(e).in_file(path))?;
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

/// Opens a regular file, and waits for nothing: to open a pipe for reading waits for a writer, to open some devices does more.
fn open_regular(path: &Path) -> io::Result<File> {
    refuse_others(&std::fs::metadata(path)?)?;
    let mut options = File::options();
    options.read(true);
    // Should another file have that name by now.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK);
    let file = options.open(path)?;
    refuse_others(&file.metadata()?)?;
    Ok(file)
}

/// Fails of what is no regular file.
fn refuse_others(metadata: &Metadata) -> io::Result<()> {
    if metadata.is_dir() {
        #[cfg(unix)]
        return Err(io::Error::from_raw_os_error(libc::EISDIR));
        #[cfg(not(unix))]
        return Err(io::ErrorKind::IsADirectory.into());
    }
    if !metadata.is_file() {
        let what = "is a pipe, a socket or a device, which cannot be mapped; read its bytes and open these";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    Ok(())
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

    #[cfg(all(target_os = "linux", not(miri)))]
    #[test]
    fn what_is_no_regular_file_is_refused_at_once() {
        use std::ffi::CString;
        let folder = tempfile::tempdir().unwrap();
        let fifo = folder.path().join("fifo");
        let name = CString::new(fifo.to_str().unwrap()).unwrap();
        // SAFETY: a string that ends in a zero byte.
        #[allow(unsafe_code)]
        let made = unsafe { libc::mkfifo(name.as_ptr(), 0o600) };
        assert_eq!(made, 0);
        for (path, what) in
            [(fifo.as_path(), "a pipe"), (Path::new("/dev/zero"), "a pipe"), (folder.path(), "irectory")]
        {
            let refused = map_file(path).unwrap_err().to_string();
            assert!(refused.contains(what) && refused.contains(path.to_str().unwrap()), "{refused}");
        }
    }

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
