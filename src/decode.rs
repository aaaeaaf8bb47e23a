//! The reader: opens a file, rebuilds single blocks or the whole table (spec section 5).

#[cfg(all(test, feature = "encode"))]
mod bombs;
mod coefficients;
mod contents;
pub(crate) mod lossless;
pub(crate) mod point;
mod table;
#[cfg(test)]
mod tests;

use crate::base::budget::{Budget, Call, Fault, Held};
use crate::base::bytes::Bytes;
use crate::base::error::{Error, Result};
use crate::blocks::{BlockCodec, head_cost};
use crate::codec::contexts::{ZEROS, contexts};
use crate::codec::range::Decoder;
use crate::codec::sample::{MAX_DOUBLINGS, Sampling};
use crate::format::directory::{self, Directory};
use crate::format::header::{self, Coding};
use crate::format::index::{Index, LOST};
#[cfg(feature = "metadata")]
use crate::format::metadata::Metadata;
use crate::format::probabilities::Probabilities;
use crate::format::profile::read_profile;
use crate::format::record::{Record, ValidityClass};
use crate::base::limits::{Limits, MAX_BLOCK_VALUES};
use crate::format::{is_compact, may_double, may_prune};
use crate::table::block::{Block, Partition, Place, Target};
use crate::table::grid::Grid;

pub use self::coefficients::Spectrum;
pub use self::contents::{BlockInfo, Origin};
pub use crate::blocks::Scratch;

/// An open file over bytes in memory or in a map. Shared freely between threads; decoding takes `&self`.
///
/// ```no_run
/// let reader = csbrdf::Reader::open(std::fs::read("chrome.csbrdf").expect("a file"))?;
/// let values: Vec<f32> = reader.decode_all()?; // 1/sr, [channel], then the axes, the last one fastest
/// let mut block = vec![0.0; reader.block_values(7)?];
/// reader.block_into(7, &mut block)?; // reads the record of block 7 alone
/// # Ok::<(), csbrdf::Error>(())
/// ```
pub struct Reader<D = Bytes> {
    data: D,
    limits: Limits,
    directory: Directory,
    codec: BlockCodec,
    index: Index,
    pruned: PrunedPolicy,
    /// Of all calls together; `None` where each has its own.
    budget: Option<Budget<'static>>,
}

/// What a decoder makes of blocks that were pruned from a file ([`Reader::with_pruned`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum PrunedPolicy {
    /// An error, [`Error::Pruned`].
    #[default]
    Refuse,
    /// The block's geometric mean, with the grazing profile if the file has one; no entry counts as measured.
    Coarse,
}

/// What a file holds of a block ([`Reader::state`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum State {
    /// All that was written, or what damage makes of it: that is seen when the block is decoded.
    Whole,
    /// Its mean: the block was left out on purpose, `csbrdf prune`.
    Pruned,
    /// Its mean at best: damage took it before the file was repaired.
    Lost,
}

#[cfg(feature = "mmap")]
impl Reader {
    /// Maps and opens a file. It may be replaced by renaming another over it, but must not be written to or truncated while it is open: a
    /// program that reads a map of it then gets other values, or ends.
    ///
    /// # Errors
    /// As [`Reader::open`], naming the file.
    pub fn open_path(path: impl AsRef<std::path::Path>) -> Result<Self> {
        let path = path.as_ref();
        Reader::open(Bytes::from(crate::base::map::map_file(path)?)).map_err(|e| e.in_file(path))
    }
}

/// The sections that all blocks share, but for the index.
pub(crate) fn read_header(bytes: &[u8], directory: &Directory, limits: &Limits) -> Result<BlockCodec> {
    let grid = header::read_grid(directory.open(bytes, directory::GRID)?)?;
    let channels = grid.channels().len();
    let draft = directory.version().2;
    let compact = is_compact(draft);
    let coding = header::read_coding(directory.open(bytes, directory::CODING)?, channels, draft)?;
    let partition = header::read_partition(directory.open(bytes, directory::PARTITION)?, &grid)?;
    let limit = limits.block_values.min(MAX_BLOCK_VALUES);
    // Within the format's limits: no overflow.
    let values = partition.largest_block() * channels;
    if values > limit {
        return Err(Error::LimitExceeded { what: "values of a block", got: values as u64, limit: limit as u64 });
    }
    let contexts = if compact { contexts(coding.quantization) } else { ZEROS };
    let probabilities = directory.open(bytes, directory::PROBABILITIES)?;
    let probabilities = Probabilities::of_section(probabilities, contexts, draft);
    let profile = match directory.find(directory::PROFILE) {
        Some(_) if compact => Some(read_profile(directory.open(bytes, directory::PROFILE)?, &grid)?),
        Some(section) => {
            let what = "a grazing profile in a draft that has none";
            return Err(Error::corrupt("GRAZ", section.range.start as u64, what));
        }
        None => None,
    };
    // It is decoded as a whole, whatever block is asked for.
    if let Some(values) = profile.as_ref().map(|profile| profile.values(&grid)).filter(|values| *values > limit) {
        return Err(Error::LimitExceeded { what: "values of the profile", got: values as u64, limit: limit as u64 });
    }
    Ok(BlockCodec::new(grid, coding, partition, probabilities).with_profile(profile))
}

impl<D: AsRef<[u8]>> Reader<D> {
    /// Opens a file: checks the header sections and the whole index, touches no record. What only records need, the probabilities
    /// of the coder and the grazing profile, is checked by its checksum and decoded with the first block.
    ///
    /// # Errors
    /// `NotCsbrdf`, `UnsupportedVersion`, `Truncated` or `Corrupt` with section and offset; `LimitExceeded`.
    pub fn open(data: D) -> Result<Reader<D>> {
        Reader::open_with_limits(data, Limits::default())
    }

    /// As [`Reader::open`], with the caller's limits.
    pub fn open_with_limits(data: D, limits: Limits) -> Result<Reader<D>> {
        let bytes = data.as_ref();
        let directory = Directory::read(bytes)?;
        let codec = read_header(bytes, &directory, &limits)?;
        let records = directory.require(directory::RECORDS)?;
        let index = directory.open(bytes, directory::INDEX)?;
        let (partition, channels) = (&codec.partition, codec.grid.channels().len());
        // No more blocks than bytes are read.
        let [work, memory] = head_cost::of_index(partition.block_count().min(records.range.len()), channels);
        let budget = Budget::new(&limits, bytes.len());
        budget.spend(work)?;
        budget.hold(memory)?;
        let index = match is_compact(directory.version().2) {
            true => Index::read(index, partition, channels, records)?,
            false => Index::read_plain(index, partition.block_count(), channels, records)?,
        };
        Ok(Reader { data, limits, directory, codec, index, pruned: PrunedPolicy::default(), budget: None })
    }

    /// A reader of parts that were put together from a damaged file.
    pub(crate) fn of(data: D, limits: Limits, directory: Directory, codec: BlockCodec, index: Index) -> Reader<D> {
        Reader { data, limits, directory, codec, index, pruned: PrunedPolicy::default(), budget: None }
    }

    /// The same with another answer for blocks that were pruned.
    pub fn with_pruned(self, pruned: PrunedPolicy) -> Reader<D> {
        Reader { pruned, ..self }
    }

    /// The same with one budget ([`Limits::operations`], [`Limits::bytes`]) for all calls from now on, in place of one for each call:
    /// for programs that ask many things of a file that they do not trust. Whole tables are bounded by [`Limits::table_values`] as
    /// before.
    pub fn with_one_budget(self) -> Reader<D> {
        let budget = Budget::new(&self.limits, self.data.as_ref().len());
        // What opening took is not given back; it was within the same bounds.
        let _ = budget.hold(head_cost::of_index(self.block_count(), self.grid().channels().len())[1]);
        Reader { budget: Some(budget), ..self }
    }

    /// What a call draws on.
    pub(crate) fn call(&self) -> Call<'_> {
        match &self.budget {
            Some(budget) => Call::Shared(budget),
            None => Call::Own(Budget::new(&self.limits, self.data.as_ref().len())),
        }
    }

    /// What all calls draw on, if that is one budget.
    pub(crate) fn one_budget(&self) -> Option<&Budget<'static>> {
        self.budget.as_ref()
    }

    /// The limits that the file was opened with.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// What a call on the whole table draws on: the number of values bounds its work.
    pub(crate) fn whole_call(&self) -> Budget<'static> {
        Budget::of_bytes(&self.limits, self.data.as_ref().len())
    }

    /// Major version, minor version and draft number (0 when final) of the file.
    pub fn version(&self) -> (u16, u16, u16) {
        self.directory.version()
    }

    /// Shape, axes and channels.
    pub fn grid(&self) -> &Grid {
        &self.codec.grid
    }

    /// How the values were coded.
    pub fn coding(&self) -> &Coding {
        &self.codec.coding
    }

    /// Whether the file has a grazing profile.
    pub fn has_profile(&self) -> bool {
        self.codec.coded_profile.is_some()
    }

    /// The cut into blocks.
    pub fn partition(&self) -> &Partition {
        &self.codec.partition
    }

    /// The sections of the file.
    pub fn directory(&self) -> &Directory {
        &self.directory
    }

    /// Number of blocks.
    pub fn block_count(&self) -> usize {
        self.codec.partition.block_count()
    }

    /// Number of values of a block: positions times channels; the length of the buffer for [`Reader::block_into`].
    ///
    /// # Errors
    /// `InvalidArgument` if there is no such block.
    pub fn block_values(&self, block: usize) -> Result<usize> {
        Ok(self.place(block)?.positions() * self.grid().channels().len())
    }

    /// Bytes of the file.
    pub(crate) fn len(&self) -> usize {
        self.data.as_ref().len()
    }

    /// What another file takes over from this one.
    #[cfg(feature = "encode")]
    pub(crate) fn header(&self) -> &BlockCodec {
        &self.codec
    }

    #[cfg(feature = "encode")]
    pub(crate) fn record_bytes(&self, block: usize) -> &[u8] {
        &self.data.as_ref()[self.index.record(block)]
    }

    #[cfg(feature = "encode")]
    pub(crate) fn error_codes(&self, block: usize) -> [u8; 2] {
        self.index.error_codes(block)
    }

    #[cfg(feature = "encode")]
    pub(crate) fn means(&self, block: usize) -> &[i32] {
        self.index.means(block)
    }

    /// A section's bytes, its checksum verified; `None` if the file has none of that name.
    #[cfg(feature = "encode")]
    pub(crate) fn section(&self, name: &'static str) -> Result<Option<Vec<u8>>> {
        match self.directory.find(name) {
            Some(_) => Ok(Some(self.directory.open(self.data.as_ref(), name)?.rest().to_vec())),
            None => Ok(None),
        }
    }

    /// Bounds on a block's rms and largest error that the index states.
    #[cfg(feature = "encode")]
    pub(crate) fn stated_errors(&self, block: usize) -> (f32, f32) {
        self.index.errors(block)
    }

    /// CRC-32 of the index section.
    pub(crate) fn index_crc(&self) -> u32 {
        self.directory.find(directory::INDEX).map_or(0, |section| section.crc)
    }

    /// Where a block's record is in the file, be it damaged or not.
    ///
    /// # Errors
    /// `InvalidArgument` if there is no such block.
    pub fn record_range(&self, block: usize) -> Result<std::ops::Range<usize>> {
        self.place(block)?;
        Ok(self.index.record(block))
    }

    /// What a file holds of a block.
    ///
    /// # Errors
    /// `InvalidArgument` if there is no such block.
    pub fn state(&self, block: usize) -> Result<State> {
        self.place(block)?;
        let is_mean = self.record(block).is_ok_and(|record| record.class == ValidityClass::Pruned);
        Ok(match self.index.error_codes(block) {
            _ if !is_mean => State::Whole,
            LOST => State::Lost,
            _ => State::Pruned,
        })
    }

    /// Numbers of the blocks that damage took before the file was repaired: it holds their means, or less.
    pub fn lost_blocks(&self) -> impl Iterator<Item = usize> {
        (0..self.block_count()).filter(|&block| self.state(block).is_ok_and(|state| state == State::Lost))
    }

    /// Bytes of a block's record.
    pub(crate) fn record_length(&self, block: usize) -> usize {
        self.index.record(block).len()
    }

    /// Provenance and encoder report; empty if the file has none. Takes some tens of megabytes at most, whatever is in the file.
    ///
    /// # Errors
    /// `Corrupt` if the section is damaged, `LimitExceeded` if it holds more than 2^20 bytes or
    /// 2^14 objects and lists.
    #[cfg(feature = "metadata")]
    pub fn metadata(&self) -> Result<Metadata> {
        match self.directory.find(directory::METADATA) {
            Some(_) => Metadata::read(self.directory.open(self.data.as_ref(), directory::METADATA)?),
            None => Ok(Metadata::default()),
        }
    }

    pub(crate) fn place(&self, block: usize) -> Result<Block> {
        self.codec.partition.block(block).ok_or_else(|| {
            Error::InvalidArgument(format!("block {block} does not exist, the file has {}", self.block_count()))
        })
    }

    pub(crate) fn record(&self, block: usize) -> Result<Record<'_>> {
        let range = self.index.record(block);
        let offset = range.start as u64;
        let doubles = may_double(self.version().2) && self.coding().sampling != Sampling::Every;
        let most_doublings = if doubles { MAX_DOUBLINGS } else { 0 };
        let may_prune = may_prune(self.version().2);
        Record::read(&self.data.as_ref()[range], block as u32, offset, most_doublings, may_prune)
    }

    /// The record of a block that is to be decoded.
    fn record_to_decode(&self, block: usize) -> Result<Record<'_>> {
        let record = self.record(block)?;
        if record.class == ValidityClass::Pruned && self.pruned == PrunedPolicy::Refuse {
            return Err(self.gone(block));
        }
        Ok(record)
    }

    /// The error of a block of which there is but a mean.
    pub(crate) fn gone(&self, block: usize) -> Error {
        if self.index.error_codes(block) == LOST { Error::Lost { block } } else { Error::Pruned { block } }
    }

    pub(crate) fn decode_log(&self, block: usize, scratch: &mut Scratch, budget: &Budget) -> Result<Block> {
        self.place(block)?;
        let record = self.record_to_decode(block)?;
        self.rebuild(block, &record, scratch, budget)
    }

    /// Decodes what opening has left for the first block; fails if it is damaged, or takes more than the call may.
    pub(crate) fn prepare(&self, budget: &Budget) -> Result<()> {
        self.codec.probabilities.get()?;
        let Some(coded) = &self.codec.coded_profile else { return Ok(()) };
        if let Some([work, bytes]) = self.codec.cost_of_profile() {
            budget.spend(work)?;
            // It stays.
            budget.hold(bytes)?;
        }
        self.codec.profile().map_err(|what| Error::corrupt("GRAZ", coded.offset, what))?;
        Ok(())
    }

    fn rebuild(&self, block: usize, record: &Record, scratch: &mut Scratch, budget: &Budget) -> Result<Block> {
        let place = self.place(block)?;
        self.prepare(budget)?;
        let _held = self.begin(&place, record, budget)?;
        self.codec
            .rebuild(&place, record, self.index.means(block), scratch, budget)
            .map_err(|fault| self.fault(block, fault))?;
        Ok(place)
    }

    /// Counts what rebuilding a block takes at least, and its memory for as long as what it gives lives.
    fn begin<'a>(&self, place: &Block, record: &Record, budget: &'a Budget) -> Result<Held<'a>> {
        budget.spend(self.codec.work_of_block(place, record.class))?;
        budget.holding(self.codec.bytes_of_block(place, record.class))
    }

    /// The coefficients of a block of a file without corrections, in the scratch.
    fn decode_coefficients(&self, block: usize, place: &Block, scratch: &mut Scratch, budget: &Budget) -> Result<()> {
        let record = self.record_to_decode(block)?;
        let _held = self.begin(place, &record, budget)?;
        let mut decoder = Decoder::new(self.codec.probabilities.get()?, record.coded);
        let decoded = self.codec.decode_record(place, record.class, &mut decoder, scratch, budget);
        budget.spend(self.codec.work_of_record(place, scratch))?;
        decoded.and_then(|()| Ok(decoder.check_end()?)).map_err(|fault| self.fault(block, fault))
    }

    /// The error of a record that does not decode.
    pub(crate) fn fault(&self, block: usize, fault: Fault) -> Error {
        fault.error(|what| self.bad_record(block, what))
    }

    pub(crate) fn bad_record(&self, block: usize, what: &str) -> Error {
        Error::corrupt("RECS", self.index.record(block).start as u64, format!("block {block}: {what}"))
    }

    /// Rebuilds one block: BRDF values in 1/sr, `[channel][position]`, positions in the block's row-major order.
    /// Missing entries hold what the recovery filled in.
    ///
    /// # Errors
    /// `Corrupt` if the record is damaged, `InvalidArgument` if there is no such block or `out` has another length
    /// than [`Reader::block_values`].
    pub fn block_into(&self, block: usize, out: &mut [f32]) -> Result<()> {
        self.block_with(block, &mut Scratch::default(), out)
    }

    /// As [`Reader::block_into`], with the caller's scratch.
    pub fn block_with(&self, block: usize, scratch: &mut Scratch, out: &mut [f32]) -> Result<()> {
        let expected = self.block_values(block)?;
        if out.len() != expected {
            return Err(Error::InvalidArgument(format!("block {block} has {expected} values, not {}", out.len())));
        }
        self.block_within(block, scratch, out, &self.call())
    }

    /// As [`Reader::block_with`], on a budget; `out` has the length.
    pub(crate) fn block_within(
        &self,
        block: usize,
        scratch: &mut Scratch,
        out: &mut [f32],
        budget: &Budget,
    ) -> Result<()> {
        let positions = out.len() / self.grid().channels().len();
        // At most one for each of 4096 channels.
        let mut planes: Vec<&mut [f32]> = out.chunks_exact_mut(positions).collect();
        self.values_to(block, scratch, Target::whole(&mut planes), budget)
    }

    /// The values of a block to all of its memory.
    fn values_to<P: Place<f32>>(
        &self,
        block: usize,
        scratch: &mut Scratch,
        target: Target<P>,
        budget: &Budget,
    ) -> Result<()> {
        if self.coding().correction.is_some() {
            self.decode_log(block, scratch, budget)?;
            target.put_all(self.codec.values(scratch));
            return Ok(());
        }
        let place = self.place(block)?;
        let record = self.record_to_decode(block)?;
        self.prepare(budget)?;
        let _held = self.begin(&place, &record, budget)?;
        let means = self.index.means(block);
        if record.class.is_mean_only() && self.codec.rows_of_means(&place, means, scratch)? {
            self.codec.to_channels(&mut scratch.log);
            target.fill(self.codec.values(scratch), place.shape[3]);
            return Ok(());
        }
        self.codec
            .components(&place, &record, means, scratch, budget)
            .and_then(|decoder| Ok(decoder.check_end()?))
            .map_err(|fault| self.fault(block, fault))?;
        self.codec.values_to(&place, scratch, target)
    }

    pub(crate) fn check_table_size(&self) -> Result<usize> {
        let values = self.grid().positions().saturating_mul(self.grid().channels().len());
        if values > self.limits.table_values {
            let limit = self.limits.table_values as u64;
            return Err(Error::LimitExceeded { what: "values of the table", got: values as u64, limit });
        }
        Ok(values)
    }
}
