//! Where bytes come from: regular files, pipes and devices, read no further than they can be of use.
//!
//! What a path names is asked of the opened file, so that nothing can take its place in between. A regular file is read up to
//! the length that it had then. Of a pipe or a device the first bytes say what it is and how long, and it must end there.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::failure::Failure;
use crate::formats::{self, Kind, Length, READ_LIMIT, STREAM_LIMIT};
use crate::path::{folder_of, is_dash, label};
use csbrdf::Bytes;

/// An input that was opened.
pub enum Source {
    /// A regular file, and its length when it was opened.
    Regular { file: File, length: u64 },
    /// A pipe or a device.
    Stream(Box<dyn Read>),
}

/// Opens what a user named: a file, a pipe, a device, `-` for standard input.
pub fn open(path: &Path) -> Result<Source, Failure> {
    let failed = |e: std::io::Error| Failure::io(path, &e);
    if is_dash(path) {
        return Ok(Source::Stream(Box::new(std::io::stdin().lock())));
    }
    let expected = std::fs::metadata(path).map_err(failed)?;
    if expected.is_dir() {
        return Err(Failure::operation(format!("{}: is a directory; name the files in it", label(path))));
    }
    // A pipe waits for its writer, as its user wants. Nothing else may wait, if it became a pipe just now.
    let file = if expected.is_file() { at_once(path, false) } else { File::open(path) };
    let file = file.map_err(failed)?;
    let found = file.metadata().map_err(failed)?;
    match (expected.is_file(), found.is_file()) {
        (_, true) => Ok(Source::Regular { length: found.len(), file }),
        (false, false) => Ok(Source::Stream(Box::new(file))),
        (true, false) => Err(Failure::operation(format!("{}: was exchanged while it was opened", label(path)))),
    }
}

/// Opens a regular file; neither waits for a pipe nor reads a device.
pub fn open_regular(path: &Path) -> Result<(File, u64), Failure> {
    regular(path, at_once(path, false))
}

/// Opens a regular file that is within its folder: a set may come from anywhere, so nothing in it leads elsewhere.
pub fn open_within(path: &Path) -> Result<Source, Failure> {
    let failed = |e: std::io::Error| Failure::io(path, &e);
    let mut real = path.to_path_buf();
    if std::fs::symlink_metadata(path).map_err(failed)?.is_symlink() {
        real = path.canonicalize().map_err(failed)?;
        if !real.starts_with(folder_of(path).canonicalize().map_err(failed)?) {
            let what = "is a link out of its folder, which is not followed; put the file itself there";
            return Err(Failure::operation(format!("{}: {what}", label(path))));
        }
    }
    let (file, length) = regular(path, at_once(&real, true))?;
    Ok(Source::Regular { file, length })
}

fn regular(path: &Path, opened: std::io::Result<File>) -> Result<(File, u64), Failure> {
    let failed = |e: std::io::Error| Failure::io(path, &e);
    let refused = |kind: &str| Failure::operation(format!("{}: is {kind}, not a regular file; not read", label(path)));
    let file = opened.map_err(|e| match std::fs::symlink_metadata(path) {
        // A socket cannot be opened at all.
        Ok(found) if !found.is_file() && !found.is_symlink() && !found.is_dir() => refused(kind(&found)),
        _ => failed(e),
    })?;
    let found = file.metadata().map_err(failed)?;
    if found.is_file() { Ok((file, found.len())) } else { Err(refused(kind(&found))) }
}

/// What a file is that is no regular one.
fn kind(found: &std::fs::Metadata) -> &'static str {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        let kind = found.file_type();
        if kind.is_fifo() {
            return "a pipe";
        }
        if kind.is_char_device() || kind.is_block_device() {
            return "a device";
        }
        if kind.is_socket() {
            return "a socket";
        }
    }
    if found.is_dir() { "a directory" } else { "something else" }
}

/// Opens a file without waiting, were it a pipe; `here` refuses a link in its place.
fn at_once(path: &Path, here: bool) -> std::io::Result<File> {
    let mut options = File::options();
    options.read(true);
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;
        let links = if here { OFlags::NOFOLLOW } else { OFlags::empty() };
        options.custom_flags((OFlags::NONBLOCK | OFlags::NOCTTY | links).bits() as i32);
    }
    #[cfg(not(unix))]
    let _ = here;
    options.open(path)
}

impl Source {
    /// The bytes, of one of these kinds.
    pub fn read(self, path: &Path, kinds: &[Kind]) -> Result<Bytes, Failure> {
        match self {
            Source::Regular { file, length } => read_regular(path, &file, length, kinds),
            Source::Stream(from) => stream(path, from, kinds),
        }
    }
}

fn read_regular(path: &Path, file: &File, length: u64, kinds: &[Kind]) -> Result<Bytes, Failure> {
    let failed = |e: std::io::Error| Failure::io(path, &e);
    let mut bytes = Vec::new();
    let mut from = file.take(length);
    from.by_ref().take(formats::head(kinds)).read_to_end(&mut bytes).map_err(failed)?;
    let stated = formats::length(path, &bytes, length, kinds)?;
    if length <= READ_LIMIT {
        bytes.try_reserve_exact(length as usize - bytes.len()).map_err(|e| failed(e.into()))?;
        from.read_to_end(&mut bytes).map_err(failed)?;
        return Ok(Bytes::from(bytes));
    }
    match stated {
        Length::Exactly(stated) if length > stated => Err(goes_on(path, stated)),
        _ => csbrdf::base::map::map_opened(file).map(Bytes::from).map_err(|e| Failure::in_file(path, &e)),
    }
}

fn stream(path: &Path, mut from: impl Read, kinds: &[Kind]) -> Result<Bytes, Failure> {
    let mut bytes = Vec::new();
    let mut read = |bytes: &mut Vec<u8>, up_to: u64| {
        let missing = up_to.saturating_sub(bytes.len() as u64);
        from.by_ref().take(missing).read_to_end(bytes).map(|_| ()).map_err(|e| Failure::io(path, &e))
    };
    let head = formats::head(kinds);
    // What is none of the kinds is refused as soon as that can be seen: the rest may be long in coming.
    let least = formats::least(kinds);
    read(&mut bytes, least)?;
    if bytes.len() as u64 == least && !bytes.trim_ascii().is_empty() {
        formats::length(path, &bytes, STREAM_LIMIT, kinds)?;
    }
    read(&mut bytes, head)?;
    if (bytes.len() as u64) < head {
        // It has ended.
        formats::length(path, &bytes, bytes.len() as u64, kinds)?;
        return Ok(Bytes::from(bytes));
    }
    let (most, stated) = match formats::length(path, &bytes, STREAM_LIMIT, kinds)? {
        Length::Exactly(stated) => (stated.min(STREAM_LIMIT), Some(stated)),
        Length::AtMost(most) => (most.min(STREAM_LIMIT), None),
    };
    // One more than may be: the end must follow.
    read(&mut bytes, most + 1)?;
    match stated {
        _ if bytes.len() as u64 <= most => Ok(Bytes::from(bytes)),
        Some(stated) if stated == most => Err(goes_on(path, stated)),
        _ => {
            let what = format!("more than {most} bytes came through the pipe; write them to a file and name it");
            Err(Failure::unsupported(path, what))
        }
    }
}

fn goes_on(path: &Path, stated: u64) -> Failure {
    Failure::bad_input(path, format!("goes on after the {stated} bytes that it states; fetch or make it again"))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    /// A file that grows meanwhile is read as long as it was, and one that is cut short to its end.
    #[test]
    fn reading_stops_at_the_length_that_was_checked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        std::fs::write(&path, [7; 10_000]).unwrap();
        let opened = || (open(&path).unwrap(), open_within(&path).unwrap());
        let (one, two) = opened();
        File::options().append(true).open(&path).unwrap().write_all(&[8; 100_000]).unwrap();
        for source in [one, two] {
            assert_eq!(source.read(&path, &[Kind::Damaged]).unwrap().as_ref(), [7; 10_000]);
        }
        let (one, two) = opened();
        File::options().write(true).open(&path).unwrap().set_len(5000).unwrap();
        for source in [one, two] {
            assert_eq!(source.read(&path, &[Kind::Damaged]).unwrap().as_ref(), [7; 5000]);
        }
    }

    /// Without a byte on the disk, but for the first ones.
    #[test]
    fn a_long_file_is_refused_by_its_first_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x");
        let dims: Vec<u8> = [90i32, 90, 180].iter().flat_map(|n| n.to_le_bytes()).collect();
        for (head, kinds) in [
            (&[][..], formats::TABLE),
            (&dims, formats::TABLE),
            (&csbrdf::format::MAGIC, &[Kind::Merl]),
            (b"y\n", &[Kind::List]),
            (&[], &[Kind::Damaged]),
            (b" ", &[Kind::Csbrdf, Kind::Manifest]),
        ] {
            std::fs::write(&path, head).unwrap();
            File::options().write(true).open(&path).unwrap().set_len(1 << 40).unwrap();
            assert!(open(&path).unwrap().read(&path, kinds).is_err(), "{head:?} {kinds:?}");
        }
    }

    #[test]
    fn a_stream_is_read_no_further_than_needed() {
        /// Counts what is read of zeros without end behind a head.
        struct Endless(Vec<u8>, usize);
        impl Read for Endless {
            fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
                let count = into.len().min(4096);
                for (byte, at) in into.iter_mut().zip(self.1..).take(count) {
                    *byte = self.0.get(at).copied().unwrap_or(0);
                }
                self.1 += count;
                Ok(count)
            }
        }
        let dims: Vec<u8> = [90i32, 90, 180].iter().flat_map(|n| n.to_le_bytes()).collect();
        let preamble =
            [&csbrdf::format::MAGIC[..], &[1, 0, 0, 0, 0, 0, 6, 0], &5000u64.to_le_bytes(), &[0; 8]].concat();
        for (head, kinds, most) in [
            (&b""[..], formats::TABLE, 12),
            (b"", &[Kind::Csbrdf][..], 12),
            (b"hello world, hello", &[Kind::Csbrdf, Kind::Manifest], 12),
            (b"", &[Kind::Damaged], 2048),
            (b"", &[Kind::List], 1 << 16),
            (&preamble, &[Kind::Csbrdf], 5001),
            (&dims, &[Kind::Merl], 34_992_013),
        ] {
            let mut from = Endless(head.to_vec(), 0);
            assert!(stream(Path::new("-"), &mut from, kinds).is_err());
            assert!(from.1 <= most, "{} bytes of {kinds:?}", from.1);
        }
    }
}
