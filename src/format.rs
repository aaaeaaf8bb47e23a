//! The container: magic, version, limits and the list of sections (spec section 3).
//!
//! A file is the preamble, the section table, the sections without gaps in table order, and the end marker.
//! Each wire structure has a file of its own in `format/`, its reader beside its writer.

pub mod directory;
pub mod header;
pub mod index;
pub mod metadata;
pub mod record;

/// First bytes of every file. The high bit and the line ends show text-mode damage, the 0x1A stops `type`.
pub const MAGIC: [u8; 8] = [0x8B, b'C', b'S', b'B', b'\r', b'\n', 0x1A, b'\n'];

/// Last bytes of every file.
pub const END_MARKER: [u8; 8] = *b"CSBRDF.\n";

/// Major version, minor version and draft number that this build writes; draft 0 means final.
pub const VERSION: (u16, u16, u16) = (1, 0, 1);

/// Most axes of a grid.
pub const MAX_AXES: usize = 4;
/// Most bins of one axis.
pub const MAX_AXIS_LEN: usize = 1 << 16;
/// Largest magnitude of an axis's start and end: within it the decoder's sines are accurate.
pub const MAX_ANGLE: f64 = 1e6;
/// Most grid positions of a table.
pub const MAX_POSITIONS: usize = 1 << 34;
/// Most channels of a table.
pub const MAX_CHANNELS: usize = 4096;
/// Most bytes of a channel's name.
pub const MAX_CHANNEL_NAME: usize = 255;
/// Most blocks of a file.
pub const MAX_BLOCKS: usize = 1 << 24;
/// Most grid positions of one block.
pub const MAX_BLOCK_POSITIONS: usize = 1 << 21;
/// Longest axis of a block: bounds the decoder's cosine tables.
pub const MAX_BLOCK_AXIS: usize = 1 << 10;
/// Most values (positions times channels) of one block.
pub const MAX_BLOCK_VALUES: usize = 1 << 24;
/// Most bytes of the metadata after decompression.
pub const MAX_METADATA: usize = 1 << 20;
/// Most sections of a file.
pub const MAX_SECTIONS: usize = 64;

/// Smallest and largest quantiser step: with bounded magnitudes no sum of coefficients leaves single precision.
pub const STEP_RANGE: std::ops::RangeInclusive<f32> = 1e-12..=1e6;
/// Smallest and largest constant of the tone map, 1/sr.
pub const EPS_RANGE: std::ops::RangeInclusive<f64> = 1e-300..=1e30;

/// Limits on what a reader allocates for a file; the caller can lower or raise them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most values (positions times channels) that a whole-table decode may allocate.
    pub table_values: usize,
    /// Most values of one block, at most [`MAX_BLOCK_VALUES`].
    pub block_values: usize,
}

impl Default for Limits {
    /// 2^28 values a table, [`MAX_BLOCK_VALUES`] a block.
    fn default() -> Self {
        Limits { table_values: 1 << 28, block_values: MAX_BLOCK_VALUES }
    }
}
