//! The container: magic, version, limits and the list of sections (spec section 3).
//!
//! A file is the preamble, the section table, the sections without gaps in table order, and the end marker.
//! Each wire structure has a file of its own in `format/`, its reader beside its writer.

pub mod directory;
pub(crate) mod drafts;
#[cfg(feature = "encode")]
pub(crate) mod file;
pub mod header;
pub mod index;
pub(crate) mod lossless;
pub mod metadata;
pub(crate) mod probabilities;
pub(crate) mod profile;
pub mod record;
pub(crate) mod spare;

/// First bytes of every file. The high bit and the line ends show text-mode damage, the 0x1A stops `type`.
pub const MAGIC: [u8; 8] = [0x8B, b'C', b'S', b'B', b'\r', b'\n', 0x1A, b'\n'];

/// Last bytes of every file.
pub const END_MARKER: [u8; 8] = *b"CSBRDF.\n";

pub(crate) use drafts::{is_compact, is_dependent, may_double, may_prune, reads_version};
