//! The version of the format that this build writes, and the drafts that it reads.

/// Major version, minor version and draft number that this build writes; draft 0 means final.
pub const VERSION: (u16, u16, u16) = (1, 0, FINAL);
/// Draft number of final versions.
pub const FINAL: u16 = 0;
/// Drafts of version 1.0, which are read like the final version.
pub const DRAFTS: std::ops::RangeInclusive<u16> = 1..=5;
