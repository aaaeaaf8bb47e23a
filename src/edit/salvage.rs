//! Damaged files: what is left of them, and what is not.
//!
//! [`Reader::open`] refuses a file whose header or index is damaged, and so must an archive. [`salvage`] goes on with what checksums
//! prove to be intact, and says all that it did. What damage costs, by where it is:
//!
//! - A record: its block. The block's mean is in the index.
//! - META: the metadata. EXCT: the source values of a block, or of all if it is in the section's head.
//! - Section table, GRID, CODE, PART, PROB, GRAZ, INDX: nothing, if the file has a spare copy of them (section SPAR, `csbrdf encode
//!   --spare`). Otherwise the file, but for
//! - one bit, where more than the checksum proves which one it was: mostly in the section table, GRID, CODE, PART and PROB, never in GRAZ;
//! - INDX: nothing if at most four neighbouring bytes are wrong and the records behind them prove it; otherwise all values.
//! - GRAZ is needed for every value: the profile's extent over the table is in it.
//!
//! "Restored" means proven to [`WANTED`] bits; a caller may take less ([`Options::evidence`]), and then learns how much there was.

mod evidence;
mod gather;
mod head;
mod index;
mod lossless;
mod mend;
#[cfg(feature = "encode")]
mod repair;
mod usual;

use std::borrow::Cow;
use std::ops::Range;

use crate::base::error::Result;
use crate::base::limits::Limits;
use crate::decode::Reader;
use crate::format::directory::Directory;
use crate::table::block::Block;
pub use evidence::WANTED;
#[cfg(feature = "encode")]
pub use repair::{Repaired, repair, repair_with};

/// Bytes of a record at least.
const MIN_RECORD: usize = 5;

/// What damage cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Outcome {
    /// Nothing: the bytes are known, proven to [`WANTED`] bits at least.
    Restored,
    /// Nothing, if a change is right that fewer bits prove; only where the caller takes less ([`Options::evidence`]).
    Assumed {
        /// Bits of evidence: it is wrong with a probability of 2^-bits at most.
        bits: u32,
    },
    /// What was there.
    Lost,
}

/// How a damaged file is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Options {
    /// Limits on what reading it takes.
    pub limits: Limits,
    /// Bits of evidence from which on a change is accepted, at most [`WANTED`].
    pub evidence: u32,
}

impl Default for Options {
    fn default() -> Options {
        Options { limits: Limits::default(), evidence: WANTED }
    }
}

impl Options {
    /// The same with other limits.
    pub fn limits(self, limits: Limits) -> Options {
        Options { limits, ..self }
    }

    /// The same with changes accepted that fewer bits prove: each is wrong with a probability of up to 2^-bits.
    pub fn evidence(self, bits: u32) -> Options {
        Options { evidence: bits.min(WANTED), ..self }
    }
}

/// One place of a file that is damaged.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Damage {
    /// Section, or "section table", "end marker", "file".
    pub section: Cow<'static, str>,
    /// The blocks whose records, or whose source values in the section EXCT, it is.
    pub blocks: Option<Range<usize>>,
    /// Bytes of the file; they may be beyond its end.
    pub bytes: Range<usize>,
    /// What is wrong, or what was done.
    pub what: Cow<'static, str>,
    /// What it cost.
    pub outcome: Outcome,
}

impl Damage {
    fn of_section(
        section: impl Into<Cow<'static, str>>,
        bytes: Range<usize>,
        what: impl Into<Cow<'static, str>>,
        outcome: Outcome,
    ) -> Damage {
        Damage { section: section.into(), blocks: None, bytes, what: what.into(), outcome }
    }

    /// Adds a block that is lost to a list, to the last of it where it is the next one, lost alike.
    fn of_block(list: &mut Vec<Damage>, section: &'static str, block: usize, bytes: Range<usize>, what: &'static str) {
        let last = list.last_mut().filter(|last| last.section == section && last.what == what);
        if let Some(Damage { blocks: Some(blocks), bytes: range, .. }) = last
            && blocks.end == block
        {
            (blocks.end, range.end) = (block + 1, bytes.end);
            return;
        }
        let (blocks, outcome) = (Some(block..block + 1), Outcome::Lost);
        list.push(Damage { section: section.into(), blocks, bytes, what: what.into(), outcome });
    }
}

/// A file as far as it is intact.
#[non_exhaustive]
pub struct Salvaged {
    reader: Reader<Vec<u8>>,
    damage: Vec<Damage>,
    /// Blocks without a record.
    lost: Vec<usize>,
    /// First block whose mean is lost as well, and that of all after it.
    known_means: usize,
    /// Blocks without source values, of a lossless file.
    lost_source: usize,
    /// What the file was: version, sections in their order.
    #[cfg_attr(not(feature = "encode"), allow(dead_code))]
    was: Directory,
}

impl Salvaged {
    /// Reads it. Blocks that are lost are there as pruned ones, which decode to their mean: no entry counts as valid.
    pub fn reader(&self) -> &Reader<Vec<u8>> {
        &self.reader
    }

    /// All that is damaged, in the order of the file's parts; empty if the file is intact. Neighbouring blocks that are lost alike are one.
    pub fn damage(&self) -> &[Damage] {
        &self.damage
    }

    /// Whether nothing is lost: all that was damaged is restored, and proven to be what it was.
    pub fn is_whole(&self) -> bool {
        self.damage.iter().all(|damage| damage.outcome == Outcome::Restored)
    }

    /// Numbers of the blocks that are lost by this damage.
    pub fn lost(&self) -> &[usize] {
        &self.lost
    }

    /// Blocks whose source values are lost by this damage, those that are [`lost`](Salvaged::lost) themselves among them; all if they are
    /// lost as a whole, none if the file has no source values.
    pub fn lost_source(&self) -> usize {
        self.lost_source
    }

    /// Place and shape of a block that is lost.
    pub fn place(&self, block: usize) -> Option<Block> {
        self.reader.partition().block(block)
    }

    /// Whether the mean of a block is known.
    pub fn has_mean(&self, block: usize) -> bool {
        block < self.known_means
    }

    /// Entries (positions times channels) of the blocks that are lost.
    pub fn lost_entries(&self) -> usize {
        let positions = |&block: &usize| self.place(block).map_or(0, |place| place.positions());
        self.lost.iter().map(positions).sum::<usize>() * self.reader.grid().channels().len()
    }
}

/// What can be had of a file, with the usual limits, as far as it is proven.
///
/// # Errors
/// As [`Reader::open`], where nothing can: no section table, or a section that all blocks need is damaged. `UnsupportedVersion`,
/// `LimitExceeded`.
pub fn salvage(data: &[u8]) -> Result<Salvaged> {
    salvage_with(data, &Options::default())
}

/// As [`salvage`], with the caller's limits.
///
/// # Errors
/// As [`salvage`].
pub fn salvage_with_limits(data: &[u8], limits: Limits) -> Result<Salvaged> {
    salvage_with(data, &Options::default().limits(limits))
}

/// As [`salvage`], with the caller's limits and evidence. Takes memory for the bytes of the file twice, and for the index as often; all within
/// the limits.
///
/// # Errors
/// As [`salvage`].
pub fn salvage_with(data: &[u8], options: &Options) -> Result<Salvaged> {
    gather::gather(data, options)
}
