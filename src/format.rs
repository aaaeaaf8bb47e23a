//! The container: magic, version, limits and the list of sections (spec section 3).
//!
//! A file is the preamble, the section table, the sections without gaps in table order, and the end marker.
//! Each wire structure has a file of its own in `format/`, its reader beside its writer.

pub mod directory;
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

/// Major version, minor version and draft number that this build writes; draft 0 means final.
pub const VERSION: (u16, u16, u16) = (1, 0, FINAL);
/// Draft number of final versions.
pub(crate) const FINAL: u16 = 0;
/// Drafts of version 1.0, which are read like the final version.
pub const DRAFTS: std::ops::RangeInclusive<u16> = 1..=5;
/// First draft whose records may double the sampling ratio.
const DOUBLINGS_DRAFT: u16 = 2;
/// First draft with a coded index, codes of probabilities, exact zeros, grazing profiles, corrections.
const COMPACT_DRAFT: u16 = 3;
/// First draft with dependent quantisation and coded probabilities.
const DEPENDENT_DRAFT: u16 = 4;
/// First draft with pruned blocks.
const PRUNED_DRAFT: u16 = 5;

/// Whether this build reads files of a version: the same major one, with what later minor ones may be skipped of.
pub(crate) fn reads_version((major, minor, draft): (u16, u16, u16)) -> bool {
    major == VERSION.0 && (draft == FINAL || minor == 0 && DRAFTS.contains(&draft))
}

/// Whether records of a draft may double the sampling ratio; those of final versions may.
pub(crate) fn may_double(draft: u16) -> bool {
    draft == 0 || draft >= DOUBLINGS_DRAFT
}

/// Whether files of a draft have the coded index and what else came with it.
pub(crate) fn is_compact(draft: u16) -> bool {
    draft == 0 || draft >= COMPACT_DRAFT
}

/// Whether files of a draft may have dependent quantisation, and have the section of probabilities that came with it.
pub(crate) fn is_dependent(draft: u16) -> bool {
    draft == 0 || draft >= DEPENDENT_DRAFT
}

/// Whether blocks of a draft's files may be pruned.
pub(crate) fn may_prune(draft: u16) -> bool {
    draft == 0 || draft >= PRUNED_DRAFT
}

/// Most axes of a grid.
pub const MAX_AXES: usize = 4;
/// Most bins of one axis.
pub const MAX_AXIS_LEN: usize = 1 << 16;
/// Largest magnitude of an axis's start and end: within it the decoder's sines are accurate.
pub const MAX_ANGLE: f64 = 1e6;
/// Most grid positions of a table.
pub const MAX_POSITIONS: u64 = 1 << 34;
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
/// Most multiply-adds of a block's synthesis: its values times the sum of its axis lengths above 1.
pub const MAX_BLOCK_WORK: u64 = 1 << 30;
/// Largest sum of the squares of a file's different block lengths: bounds the memory of the decoder's tables.
pub const MAX_TABLE_ENTRIES: usize = 1 << 22;
/// Most bytes of the metadata after decompression.
pub const MAX_METADATA: usize = 1 << 20;
/// Most bytes `{` and `[` in the text of the metadata: an object takes half a kilobyte of memory, be it `{"":0}`.
pub const MAX_METADATA_OBJECTS: usize = 1 << 14;
/// Most means of an index: blocks times channels.
pub const MAX_MEANS: usize = 1 << 24;
/// Most sections of a file.
pub const MAX_SECTIONS: usize = 64;

/// Smallest and largest quantiser step: with bounded magnitudes no sum of coefficients leaves single precision.
pub const STEP_RANGE: std::ops::RangeInclusive<f32> = 1e-12..=1e6;
/// Smallest and largest constant of the tone map, 1/sr.
pub const EPS_RANGE: std::ops::RangeInclusive<f64> = 1e-300..=1e30;

/// Limits on what a file may make a reader take; the caller can lower or raise them. Beyond them a call ends in
/// [`Error::LimitExceeded`](crate::Error::LimitExceeded), which names the limit.
///
/// By default no file below 100 kB takes a call, or an evaluator over its life, more than about two seconds of a processor or 512 MB,
/// but for whole tables. Each call has a budget of its own, or all calls on a reader have one together
/// ([`Reader::with_one_budget`](crate::decode::Reader::with_one_budget)).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Most values (positions times channels) of a table that is decoded, verified, or summed up as a whole. A decode holds the
    /// result (4 bytes a value, 9 with validity in double precision), at most 64 MB of addresses for each of them, some 20 MB for
    /// the threads' shares, and the buffers of as many blocks as threads work on: no more of them than `bytes` has room for. It takes
    /// up to some 1 us of a processor a value (a hostile file with long blocks; 20 ns is usual), whatever `operations` says.
    pub table_values: usize,
    /// Most values of one block, at most 2^24, and of a table of the profile. Rebuilding one takes 4 bytes a value for
    /// the logarithms (8 with three channels that are mixed), 1 each for a mask by channel and for exact zeros, 5 for corrections, 8 to
    /// 16 for each coefficient that is not zero, and at most 200 bytes a position beside. These are counted to `bytes`.
    pub block_values: usize,
    /// Most operations that one call on a file may take, about a nanosecond of one processor each, besides 2^12 for each byte of
    /// the file: opening, a block, its validity and origins, its exact values, importance, pruning, checking whether a material
    /// could exist; and all that an evaluator decodes over its life ([`Brdf`](crate::brdf::Brdf) says what is left out). What is
    /// decoded of one record is counted when it is known, at most a third of a second later. Whole tables go by `table_values` instead.
    pub operations: u64,
    /// Most bytes of memory that one call on a file may take beside its result and the caller's buffers, besides 16 for each byte of
    /// the file. The evaluator's cache goes by
    /// [`BrdfOptions::cache_bytes`](crate::BrdfOptions::cache_bytes), the table that is decoded by `table_values`, and the metadata by
    /// the format's 2^20 instead.
    pub bytes: u64,
}

impl Default for Limits {
    /// 2^28 values a table, 2^24 a block, 10^9 operations, 2^28 bytes.
    fn default() -> Self {
        Limits { table_values: 1 << 28, block_values: MAX_BLOCK_VALUES, operations: 1_000_000_000, bytes: 1 << 28 }
    }
}

impl Limits {
    /// The default limits for tables of so many values: operations and bytes grow with them, and never fall below the defaults.
    pub fn of_table(values: usize) -> Limits {
        let usual = Limits::default();
        let times = values.div_ceil(usual.table_values).max(1) as u64;
        let [operations, bytes] = [usual.operations, usual.bytes].map(|limit| limit.saturating_mul(times));
        Limits { table_values: values, operations, bytes, ..usual }
    }
}

/// Fails unless blocks of this shape are within the format's limits for `channels` channels.
pub(crate) fn check_block(shape: [usize; 4], channels: usize) -> Result<(), String> {
    let values = shape.iter().map(|&n| n as u64).product::<u64>() * channels as u64;
    if values > MAX_BLOCK_VALUES as u64 {
        return Err(format!("a block {shape:?} of {channels} channels has more than {MAX_BLOCK_VALUES} values"));
    }
    let lengths: u64 = shape.iter().filter(|&&n| n > 1).map(|&n| n as u64).sum();
    if values * lengths > MAX_BLOCK_WORK {
        return Err(format!("a block {shape:?} of {channels} channels takes more than {MAX_BLOCK_WORK} operations"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A final version comes after all drafts: what they brought stays.
    #[test]
    fn what_drafts_brought_stays_when_the_version_is_final() {
        assert_eq!([0, 1, 2, 3].map(may_double), [true, false, true, true]);
        assert_eq!([0, 1, 2, 3, 4].map(is_compact), [true, false, false, true, true]);
        assert_eq!([0, 2, 3, 4, 5].map(is_dependent), [true, false, false, true, true]);
        assert_eq!([0, 3, 4, 5, 6].map(may_prune), [true, false, false, true, true]);
        let versions = [(1, 0, 0), (1, 0, 1), (1, 0, 5), (1, 7, 0), (1, 0, 6), (1, 1, 1), (0, 0, 0), (2, 0, 0)];
        assert_eq!(versions.map(reads_version), [true, true, true, true, false, false, false, false]);
    }
}
