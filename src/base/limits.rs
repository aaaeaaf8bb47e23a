//! What a file may hold at most (spec sections 3.1 to 3.10), and what it may take of a reader.

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
/// Most knots of a table along the elevation.
pub const MAX_KNOTS: usize = 64;

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
///
/// ```no_run
/// use csbrdf::{BrdfOptions, Limits};
///
/// // A service that knows its files: MERL tables have 4,374,000 values.
/// let limits = Limits { table_values: 1 << 23, bytes: 64 << 20, ..Limits::default() };
/// let brdf = BrdfOptions::new().limits(limits).open("upload.csbrdf")?;
/// # Ok::<(), csbrdf::Error>(())
/// ```
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
    /// the file: opening, a block, its validity and origins, its source values, importance, pruning, checking whether a material
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
    /// The default limits for tables of `values` values: operations and bytes grow with them, and never fall below the defaults.
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
