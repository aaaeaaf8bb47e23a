//! Sets: many materials, each a file of its own, and a manifest that says what they are.
//!
//! A material is read from its own file alone; nothing is shared between the files.
//!
//! What sharing could save, by compressing frame, GRID, CODE, PART, PROB and META of all files together (LZMA, an upper
//! bound: a file alone could not be read from that): of 20 MERL fits at the default quality 3.1 % (577,142 bytes; these are
//! 4.5 % or 1.3 kB a file, of which GRID, CODE and PART are 0.3 kB), of 5 at --quality 0.5 8.5 % (44,020 bytes, 0.75 kB a
//! file). A third is the JSON keys of META and the GRID that is always MERL's: a dictionary known to the format would save
//! these in a single file as well, and leave it readable alone. So nothing is shared here.

pub mod check;
mod entry;
pub mod manifest;
pub mod table;
pub mod unfinished;

use std::path::Path;

use crate::failure::Failure;
use manifest::{Manifest, Refused};

/// Reads the manifest that a file holds.
fn read(path: &Path, bytes: &[u8]) -> Result<Manifest, Failure> {
    Manifest::read(bytes).map_err(|refused| match refused {
        Refused::Bad(what) => Failure::bad_input(path, what),
        Refused::Unsupported(what) => Failure::unsupported(path, what),
    })
}
