//! Inputs: a path or `-`, read to memory; tables in either format.

use std::path::Path;
use std::sync::OnceLock;

pub use csbrdf::Bytes;
use csbrdf::Limits;
use csbrdf::decode::{PrunedPolicy, Reader};
use csbrdf::format::MAGIC;
use csbrdf::table::Table;

use crate::failure::{Failure, note};
use crate::formats::{Kind, TABLE};
pub use crate::formats::{read_table, table_format};
use crate::guard::Guard;
pub use crate::path::{is_dash, label};
use crate::source::{self, Source};

/// The bytes of a file or of standard input, of one of these kinds.
pub fn read(path: &Path, kinds: &[Kind]) -> Result<Bytes, Failure> {
    source::open(path)?.read(path, kinds)
}

/// The bytes of a regular file that is within its folder, as those of a set must be.
pub fn read_within(path: &Path, kinds: &[Kind]) -> Result<Bytes, Failure> {
    source::open_within(path)?.read(path, kinds)
}

/// The bytes of a regular file, which may be a link to one.
pub fn read_regular(path: &Path, kinds: &[Kind]) -> Result<Bytes, Failure> {
    let (file, length) = source::open_regular(path)?;
    Source::Regular { file, length }.read(path, kinds)
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
pub fn open(path: &Path) -> Result<Reader, Failure> {
    reader(read(path, &[Kind::Csbrdf])?).map_err(|e| Failure::in_file(path, &e))
}

/// Says of a file that was written that others read it only with --limit.
pub fn note_needed_limit(file: impl std::fmt::Display, values: usize) {
    if values > Limits::default().table_values {
        let most = Limits::default().table_values;
        note(&format!("{file}: {values} values; readers take {most} by default, this one with --limit {values}"));
    }
}

/// What to make of blocks that were pruned.
pub fn pruned(coarse: bool) -> PrunedPolicy {
    if coarse { PrunedPolicy::Coarse } else { PrunedPolicy::Refuse }
}

/// The table in a file of either format, known by its first bytes; what the metadata of a csbrdf file name as its source is
/// guarded.
pub fn table(path: &Path, guard: &mut Guard) -> Result<Table, Failure> {
    let bytes = read(path, TABLE)?;
    if !bytes.as_ref().starts_with(&MAGIC) {
        return table_of(path, bytes);
    }
    let reader = reader(bytes).map_err(|e| Failure::in_file(path, &e))?;
    *guard = std::mem::take(guard).source_of(path, &reader);
    reader.decode_table().map_err(|e| Failure::in_file(path, &e))
}

/// The table in the bytes of a file of either format.
pub fn table_of(path: &Path, bytes: Bytes) -> Result<Table, Failure> {
    if !bytes.as_ref().starts_with(&MAGIC) {
        return read_table(bytes.as_ref()).map_err(|e| Failure::in_file(path, &e));
    }
    reader(bytes).and_then(|reader| reader.decode_table()).map_err(|e| Failure::in_file(path, &e))
}
