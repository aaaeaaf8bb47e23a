//! Inputs: a path or `-`, read to memory; tables in either format.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::OnceLock;

use csbrdf::decode::{Pruned, Reader};
use csbrdf::format::{Limits, MAGIC};
use csbrdf::table::BrdfTable;
use csbrdf::table::merl::read_merl;

use crate::failure::{Failure, Outcome, note};

/// Most bytes that are read from a pipe: it may never end.
const STREAM_LIMIT: u64 = 1 << 30;

/// Larger files are mapped. Up to here they are read, and a file that another process cuts short meanwhile is an error as any other; in
/// a map it would end this process by SIGBUS. Files of some 20 kB take no longer so; one block of a lossless file of 20 MB takes 32 ms
/// of a processor in place of 4, and a comparison with a MERL table of 35 MB 539 in place of 492.
const READ_LIMIT: u64 = 1 << 28;

/// The bytes of an input.
pub enum Bytes {
    /// Of a large file.
    Map(memmap2::Mmap),
    /// Of any other file, or a pipe.
    Heap(Vec<u8>),
}

impl AsRef<[u8]> for Bytes {
    fn as_ref(&self) -> &[u8] {
        match self {
            Bytes::Map(map) => map,
            Bytes::Heap(bytes) => bytes,
        }
    }
}

/// True for `-`, standard input or output.
pub fn is_dash(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// What messages call a path.
pub fn label(path: &Path) -> String {
    if is_dash(path) { "standard input".into() } else { path.display().to_string() }
}

/// The bytes of a file or of standard input.
pub fn read(path: &Path) -> Result<Bytes, Failure> {
    let failed = |e: std::io::Error| Failure::io(path, &e);
    if is_dash(path) {
        return stream(path, std::io::stdin().lock());
    }
    let metadata = std::fs::metadata(path).map_err(failed)?;
    if metadata.is_dir() {
        return Err(Failure::operation(format!("{}: is a directory; name the files in it", label(path))));
    }
    if metadata.is_file() && metadata.len() <= READ_LIMIT {
        return std::fs::read(path).map(Bytes::Heap).map_err(failed);
    }
    if metadata.is_file() {
        return csbrdf::map::map_file(path).map(Bytes::Map).map_err(|e| Failure::in_file(path, &e));
    }
    stream(path, File::open(path).map_err(failed)?)
}

fn stream(path: &Path, from: impl Read) -> Result<Bytes, Failure> {
    let mut bytes = Vec::new();
    let read = from.take(STREAM_LIMIT + 1).read_to_end(&mut bytes).map_err(|e| Failure::io(path, &e))?;
    if read as u64 > STREAM_LIMIT {
        let what = format!("more than {STREAM_LIMIT} bytes came through the pipe; write them to a file and name it");
        return Err(Failure::unsupported(path, what));
    }
    Ok(Bytes::Heap(bytes))
}

/// What files may take, if --limit says so.
static LIMITS: OnceLock<Limits> = OnceLock::new();

/// Sets what files may take, once.
pub fn set_limits(limits: Limits) {
    let _ = LIMITS.set(limits);
}

/// What files may take.
pub fn limits() -> Limits {
    LIMITS.get().copied().unwrap_or_default()
}

/// A reader of a csbrdf file's bytes. All that a command asks of a file comes out of one budget.
pub fn reader<D: AsRef<[u8]>>(bytes: D) -> csbrdf::Result<Reader<D>> {
    Ok(Reader::open_with_limits(bytes, limits())?.with_one_budget())
}

/// Opens a csbrdf file.
pub fn open(path: &Path) -> Result<Reader<Bytes>, Failure> {
    reader(read(path)?).map_err(|e| Failure::in_file(path, &e))
}

/// Says of a file that was written that others read it only if they are told to.
pub fn note_needed_limit(file: impl std::fmt::Display, values: usize) {
    if values > Limits::default().table_values {
        let most = Limits::default().table_values;
        note(&format!("{file}: {values} values; readers take {most} by default, this one with --limit {values}"));
    }
}

/// What to make of blocks that were pruned.
pub fn pruned(coarse: bool) -> Pruned {
    if coarse { Pruned::Coarse } else { Pruned::Refuse }
}

/// Fails if the first bytes are those of something else than a MERL table.
pub fn expect_merl(path: &Path, bytes: &[u8]) -> Outcome {
    let other = match bytes {
        [] => "the file is empty; give a MERL .binary table",
        b if b.starts_with(&MAGIC) => "is a csbrdf file already; give the table that it was made from",
        b if b.starts_with(b"tensor_file") => "is an RGL tensor file; give a table on MERL's grid",
        b if b.iter().take(64).all(|c| c.is_ascii_graphic() || c.is_ascii_whitespace()) => {
            "is a text file; give a MERL .binary table"
        }
        _ => return Ok(()),
    };
    Err(Failure::bad_input(path, other))
}

/// The table in a file of either format, told apart by its first bytes.
pub fn table(path: &Path) -> Result<BrdfTable, Failure> {
    let bytes = read(path)?;
    if !bytes.as_ref().starts_with(&MAGIC) {
        expect_merl(path, bytes.as_ref())?;
        return read_merl(bytes.as_ref()).map_err(|e| Failure::in_file(path, &e));
    }
    reader(bytes).and_then(|reader| reader.decode_table()).map_err(|e| Failure::in_file(path, &e))
}
