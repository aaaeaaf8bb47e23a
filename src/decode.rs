//! The reader: opens a file, rebuilds single blocks or the whole table (spec section 5).

pub(crate) mod lossless;
pub(crate) mod point;

use std::borrow::Cow;
use std::sync::OnceLock;

use crate::block::{Block, Partition, positions};
use crate::channel::ChannelTransform;
use crate::correct::{self, Decoded, correct};
use crate::dependent::Quantization;
use crate::entropy::{self, Walk};
use crate::error::{Error, Result};
use crate::format::directory::{self, Directory};
use crate::format::header::{self, Coding};
use crate::format::index::Index;
#[cfg(feature = "metadata")]
use crate::format::metadata::Metadata;
use crate::format::probabilities::read_probabilities;
use crate::format::profile::{CodedProfile, read_profile};
use crate::format::record::{Record, ValidityClass};
use crate::format::{Limits, MAX_BLOCK_VALUES, is_compact, may_double, may_prune};
use crate::fourier::{AxisTable, Basis, Extents, Synthesis};
use crate::grid::Grid;
use crate::horizon::Horizon;
use crate::mask::{self, MaskModel};
use crate::profile::Profile;
use crate::quantize::{Quantizer, dequantize_mean};
use crate::range::Decoder;
use crate::sample::{MAX_DOUBLINGS, Sampling, block_seed, sample_positions};
use crate::simd::{Level, Task};
use crate::table::BrdfTable;
use crate::tone::{inverse_tone_map, inverse_tone_map_f64};
use crate::zeros::{self, code_zeros};

/// First contexts of the range coder for coefficients (from 0), masks, zeros, corrections.
pub(crate) const MASKS: usize = entropy::CONTEXTS;
pub(crate) const ZEROS: usize = MASKS + mask::CONTEXTS;
pub(crate) const CORRECTIONS: usize = ZEROS + zeros::CONTEXTS;
/// Number of contexts of the range coder where all multiples of the step are allowed; drafts 1 and 2 end before the zeros.
const SCALAR_CONTEXTS: usize = CORRECTIONS + correct::CONTEXTS;
/// Number of contexts of the range coder with dependent quantisation.
pub(crate) const CONTEXTS: usize = entropy::SIGNIFICANT_ODD + entropy::ODD_CONTEXTS;
const _: () = assert!(entropy::SIGNIFICANT_ODD == SCALAR_CONTEXTS);

/// Number of contexts of a file's range coder.
pub(crate) fn contexts(quantization: Quantization) -> usize {
    match quantization {
        Quantization::Scalar => SCALAR_CONTEXTS,
        Quantization::Dependent => CONTEXTS,
    }
}

/// An open file over bytes in memory or in a map. Shared freely between threads; decoding takes `&self`.
pub struct Reader<D> {
    data: D,
    limits: Limits,
    directory: Directory,
    header: Header,
    index: Index,
    pruned: Pruned,
}

/// What a decoder makes of blocks that were pruned from a file ([`Reader::with_pruned`]).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pruned {
    /// An error, [`Error::Pruned`].
    #[default]
    Refuse,
    /// The block's geometric mean, with the grazing profile if the file has one; no entry counts as measured.
    Coarse,
}

/// What decoding needs besides a block's record; the encoder decodes with it before there is a file.
pub(crate) struct Header {
    pub(crate) grid: Grid,
    pub(crate) coding: Coding,
    pub(crate) partition: Partition,
    pub(crate) probabilities: Vec<u16>,
    synthesis: Synthesis,
    level: Level,
    horizon: OnceLock<Option<Horizon>>,
    mask: OnceLock<MaskModel>,
    coded_profile: Option<CodedProfile>,
    profile: OnceLock<Result<Profile, &'static str>>,
}

/// Buffers of a decode, for callers that rebuild many blocks on a thread.
#[derive(Debug, Default)]
pub struct Scratch {
    pub(crate) coefficients: Vec<i32>,
    pub(crate) extents: Vec<Extents>,
    walk: Walk,
    class: ValidityClass,
    /// Empty where the class says enough and the values do not depend on them.
    pub(crate) masks: Vec<bool>,
    /// Exact zeros, `[channel][position]`; empty where the file tells none.
    pub(crate) zeros: Vec<bool>,
    /// Log values, `[channel][position]`.
    pub(crate) log: Vec<f32>,
    lines: Vec<f32>,
    corrections: Vec<i32>,
    correct: correct::Walk,
}

impl Scratch {
    /// Exact zeros in the log values: exp of what they get is zero, and so is the value.
    fn hide_zeros(&mut self) {
        for (log, zero) in self.log.iter_mut().zip(&self.zeros) {
            *log = if *zero { f32::NEG_INFINITY } else { *log };
        }
    }
}

/// Where an entry of a decoded table comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Origin {
    /// Measured, and a sample of the recovery.
    Sampled,
    /// Measured, but not sampled: the recovery had to predict it.
    Measured,
    /// Not measured; filled in by the recovery.
    Filled,
    /// Not measured, and no pair of directions above the horizon falls into the bin.
    Impossible,
}

/// What a file says about one block.
#[derive(Clone, Debug, PartialEq)]
pub struct BlockInfo {
    /// Place and shape.
    pub block: Block,
    /// Bytes of its record.
    pub record: std::ops::Range<usize>,
    /// Class of validity.
    pub class: ValidityClass,
    /// Valid entries of each channel.
    pub valid: Vec<usize>,
    /// Sampled entries of each channel.
    pub sampled: Vec<usize>,
    /// Seed of the sampling.
    pub seed: u64,
    /// Sampling ratio, 0 to 1.
    pub ratio: f64,
    /// Upper bound on the rms error of the binary64 values over valid entries, log domain.
    pub rms: f32,
    /// Upper bound on the largest error of the binary64 values over valid entries, log domain.
    pub max: f32,
}

impl Header {
    pub(crate) fn new(grid: Grid, coding: Coding, partition: Partition, probabilities: Vec<u16>) -> Header {
        let synthesis = Synthesis::new(coding.basis, &partition.axis_lengths());
        Header {
            grid,
            coding,
            partition,
            probabilities,
            synthesis,
            level: Level::detect(),
            horizon: OnceLock::new(),
            mask: OnceLock::new(),
            coded_profile: None,
            profile: OnceLock::new(),
        }
    }

    /// The same with a grazing profile.
    pub(crate) fn with_profile(self, coded_profile: Option<CodedProfile>) -> Header {
        Header { coded_profile, ..self }
    }

    /// The grazing profile, decoded at first use: opening does not wait for it.
    fn profile(&self) -> Result<Option<&Profile>, &'static str> {
        let Some(coded) = &self.coded_profile else { return Ok(None) };
        self.profile.get_or_init(|| coded.decode(&self.grid)).as_ref().map(Some).map_err(|what| *what)
    }

    pub(crate) fn mask_model(&self) -> &MaskModel {
        self.mask.get_or_init(|| MaskModel::new(self.horizon().cloned(), self.coding.horizon))
    }

    fn horizon(&self) -> Option<&Horizon> {
        self.horizon.get_or_init(|| Horizon::new(&self.grid)).as_ref()
    }

    /// Decodes a record's masks and coefficients into the scratch. Masks: `[channel][position]` or one for all.
    pub(crate) fn decode_record(
        &self,
        block: &Block,
        class: ValidityClass,
        decoder: &mut Decoder,
        scratch: &mut Scratch,
    ) -> Result<(), &'static str> {
        let n = block.positions();
        let channels = self.grid.channels().len();
        scratch.class = class;
        scratch.masks.clear();
        // What is only predicted is left until someone asks.
        if class != ValidityClass::Horizon || self.coding.zeros || self.coding.correction.is_some() {
            self.decode_masks(block, class, decoder, &mut scratch.masks);
        }
        scratch.coefficients.resize(channels * n, 0);
        if class.is_mean_only() {
            scratch.extents.clear();
            scratch.extents.resize(channels, [0; 4]);
            scratch.zeros.clear();
            return Ok(());
        }
        scratch.zeros.clear();
        if self.coding.zeros {
            scratch.zeros.resize(channels * n, false);
            code_zeros(decoder, ZEROS, block.shape, &scratch.masks, &mut scratch.zeros);
        }
        scratch
            .walk
            .code(decoder, self.coding.quantization, block.shape, &mut scratch.coefficients, &mut scratch.extents)
            .map_err(|_| "an extent or a coefficient is out of range")
    }

    fn decode_masks(&self, block: &Block, class: ValidityClass, decoder: &mut Decoder, masks: &mut Vec<bool>) {
        let n = block.positions();
        masks.clear();
        match class {
            ValidityClass::All => masks.resize(n, true),
            ValidityClass::None | ValidityClass::Pruned => masks.resize(n, false),
            ValidityClass::Horizon => masks.extend(self.mask_model().predict(block)),
            ValidityClass::Mask | ValidityClass::MaskPerChannel => {
                let per_channel = class == ValidityClass::MaskPerChannel;
                masks.resize(if per_channel { n * self.grid.channels().len() } else { n }, false);
                self.mask_model().code(decoder, MASKS, block, masks);
            }
        }
    }

    /// Rebuilds a block's log values in `scratch.log`, `[channel][position]`; gives the masks on the side.
    pub(crate) fn rebuild(
        &self,
        block: &Block,
        record: &Record,
        means: &[i32],
        scratch: &mut Scratch,
    ) -> Result<(), &'static str> {
        let mut decoder = self.components(block, record, means, scratch)?;
        self.to_channels(&mut scratch.log);
        if let Some(step) = self.coding.correction.filter(|_| !record.class.is_mean_only()) {
            let Scratch { masks, zeros, log, corrections, .. } = scratch;
            corrections.clear();
            corrections.resize(log.len(), 0);
            let correctable = without_zeros(masks, zeros);
            let decoded = Decoded { shape: block.shape, masks: &correctable, log, step };
            scratch
                .correct
                .code(&mut decoder, CORRECTIONS, decoded, corrections)
                .map_err(|_| "a correction is out of range")?;
            correct(log, corrections, step);
        }
        decoder.check_end()?;
        scratch.hide_zeros();
        Ok(())
    }

    /// Components of log values in `scratch.log`, exact zeros on the side; the decoder stands before the corrections.
    fn components<'a>(
        &self,
        block: &Block,
        record: &Record<'a>,
        means: &[i32],
        scratch: &mut Scratch,
    ) -> Result<Decoder<'a>, &'static str> {
        let mut decoder = Decoder::new(&self.probabilities, record.coded);
        self.decode_record(block, record.class, &mut decoder, scratch)?;
        self.synthesize(block, means, scratch)?;
        Ok(decoder)
    }

    /// Components of log values in `scratch.log`, from the coefficients and extents in the scratch.
    fn synthesize(&self, block: &Block, means: &[i32], scratch: &mut Scratch) -> Result<(), &'static str> {
        let n = block.positions();
        scratch.log.resize(scratch.coefficients.len(), 0.0);
        for (component, values) in scratch.log.chunks_exact_mut(n).enumerate() {
            if self.coding.basis == Basis::Dft {
                values.fill(0.0);
            }
            let coefficients = &scratch.coefficients[component * n..(component + 1) * n];
            let extents = scratch.extents[component].map(|e| e.max(1));
            self.dequantize(component, block.shape, extents, coefficients, means[component], values);
            self.synthesis.synthesize(self.level, block.shape, extents, values, &mut scratch.lines);
        }
        self.add_profile(block, &mut scratch.log)
    }

    /// The coefficients of a component below the extents, at least 1; what is beyond stays as it is.
    fn dequantize(
        &self,
        component: usize,
        shape: [usize; 4],
        extents: Extents,
        coefficients: &[i32],
        mean: i32,
        values: &mut [f32],
    ) {
        let step = self.coding.steps[component];
        let quantizer = Quantizer { step, shrink: self.coding.shrink.map(|s| f32::from(s) / 256.0) };
        dequantize_within(shape, extents, coefficients, quantizer, values);
        values[0] = dequantize_mean(step, mean);
    }

    /// Adds the profile, if the file has one, to the components of a block.
    fn add_profile(&self, block: &Block, values: &mut [f32]) -> Result<(), &'static str> {
        if let Some(profile) = self.profile()? {
            profile.add(self.level, block, values);
        }
        Ok(())
    }

    /// Components to log values of channels, `[channel][position]`.
    fn to_channels(&self, values: &mut [f32]) {
        let (transform, channels) = (&self.coding.transform, self.grid.channels().len());
        self.level.run(ToChannels { transform, channels, values });
    }

    /// BRDF values in the rows of a block, `[channel][row]`, from the components in the scratch.
    fn values_in_rows(&self, scratch: &mut Scratch, mut rows: Vec<&mut [f32]>) {
        let eps = self.coding.eps as f32;
        if let (ChannelTransform::Matrix(matrix), 3, []) =
            (&self.coding.transform, self.grid.channels().len(), &scratch.zeros[..])
        {
            self.level.run(OpponentRows { matrix, eps, components: &scratch.log, rows: &mut rows });
            return;
        }
        self.to_channels(&mut scratch.log);
        scratch.hide_zeros();
        copy_rows(rows, self.values(scratch));
    }

    fn axes(&self, shape: [usize; 4]) -> [&AxisTable; 4] {
        shape.map(|n| self.synthesis.axis(n))
    }

    /// BRDF values in place of the log values in the scratch.
    fn values<'a>(&self, scratch: &'a mut Scratch) -> &'a [f32] {
        self.level.run(InverseToneMap { eps: self.coding.eps as f32, values: &mut scratch.log });
        &scratch.log
    }

    /// What [`Header::rebuild`] gives before corrections and zeros, of coefficients and extents that are not coded yet.
    #[cfg(feature = "encode")]
    pub(crate) fn rebuild_uncoded(
        &self,
        block: &Block,
        coefficients: &[i32],
        extents: &[Extents],
        means: &[i32],
        scratch: &mut Scratch,
    ) -> Result<(), &'static str> {
        scratch.coefficients.clear();
        scratch.coefficients.extend_from_slice(coefficients);
        scratch.extents.clear();
        scratch.extents.extend_from_slice(extents);
        self.synthesize(block, means, scratch)?;
        self.to_channels(&mut scratch.log);
        Ok(())
    }

    /// Masks of all channels of the block that was decoded last, `[channel][position]`.
    pub(crate) fn masks_of(&self, block: &Block, scratch: &Scratch) -> Vec<bool> {
        let channels = self.grid.channels().len();
        match scratch.class {
            ValidityClass::Horizon => self.mask_model().predict(block).repeat(channels),
            ValidityClass::MaskPerChannel => scratch.masks.clone(),
            _ => scratch.masks.repeat(channels),
        }
    }
}

struct ToChannels<'a> {
    transform: &'a ChannelTransform,
    channels: usize,
    values: &'a mut [f32],
}

impl Task for ToChannels<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        self.transform.inverse(self.values, self.channels);
    }
}

/// Three components to values in the rows of a block, in one pass: the sums of [`ChannelTransform::inverse`].
struct OpponentRows<'a, 'b> {
    /// Of three channels.
    matrix: &'a [f32],
    eps: f32,
    components: &'a [f32],
    /// `[channel][row]`.
    rows: &'a mut [&'b mut [f32]],
}

impl Task for OpponentRows<'_, '_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let OpponentRows { matrix, eps, components, rows } = self;
        let m: [f32; 9] = std::array::from_fn(|i| matrix[i]);
        let (first, rest) = components.split_at(components.len() / 3);
        let (second, third) = rest.split_at(first.len());
        let (red, rest) = rows.split_at_mut(rows.len() / 3);
        let (green, blue) = rest.split_at_mut(red.len());
        let mut at = 0;
        for ((red, green), blue) in red.iter_mut().zip(green).zip(blue) {
            let place = at..at + red.len();
            at = place.end;
            let from = first[place.clone()].iter().zip(&second[place.clone()]).zip(&third[place]);
            let to = red.iter_mut().zip(green.iter_mut()).zip(blue.iter_mut());
            for (((r, g), b), ((x, y), z)) in to.zip(from) {
                *r = inverse_tone_map((x * m[0] + y * m[3]) + z * m[6], eps);
                *g = inverse_tone_map((x * m[1] + y * m[4]) + z * m[7], eps);
                *b = inverse_tone_map((x * m[2] + y * m[5]) + z * m[8], eps);
            }
        }
    }
}

struct InverseToneMap<'a> {
    eps: f32,
    values: &'a mut [f32],
}

impl Task for InverseToneMap<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        self.values.iter_mut().for_each(|value| *value = inverse_tone_map(*value, self.eps));
    }
}

/// Validity less exact zeros, which take no correction.
pub(crate) fn without_zeros<'a>(masks: &'a [bool], zeros: &[bool]) -> Cow<'a, [bool]> {
    if !zeros.contains(&true) {
        return masks.into();
    }
    zeros.iter().enumerate().map(|(i, zero)| masks[i % masks.len()] && !zero).collect::<Vec<_>>().into()
}

/// Dequantises the coefficients below the extents; the others stay zero.
fn dequantize_within(shape: [usize; 4], extents: Extents, from: &[i32], quantizer: Quantizer, to: &mut [f32]) {
    let [_, n1, n2, n3] = shape;
    for i in 0..extents[0] {
        for j in 0..extents[1] {
            for k in 0..extents[2] {
                let row = ((i * n1 + j) * n2 + k) * n3;
                for (value, &q) in to[row..row + extents[3]].iter_mut().zip(&from[row..]) {
                    *value = quantizer.dequantize(q);
                }
            }
        }
    }
}

#[cfg(feature = "mmap")]
impl Reader<memmap2::Mmap> {
    /// Maps and opens a file. See [`crate::map::map_file`] on files that others change.
    ///
    /// # Errors
    /// As [`Reader::open`], naming the file.
    pub fn open_path(path: impl AsRef<std::path::Path>) -> Result<Self> {
        let path = path.as_ref();
        Reader::open(crate::map::map_file(path)?).map_err(|e| e.in_file(path))
    }
}

impl<D: AsRef<[u8]>> Reader<D> {
    /// Opens a file: checks the header sections and the whole index, touches no record.
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
        let probabilities = read_probabilities(directory.open(bytes, directory::PROBABILITIES)?, contexts, draft)?;
        let profile = match directory.find(directory::PROFILE) {
            Some(_) if compact => Some(read_profile(directory.open(bytes, directory::PROFILE)?, &grid)?),
            Some(section) => {
                let what = "a grazing profile in a draft that has none";
                return Err(Error::corrupt("GRAZ", section.range.start as u64, what));
            }
            None => None,
        };
        let records = directory.require(directory::RECORDS)?;
        let index = directory.open(bytes, directory::INDEX)?;
        let index = match compact {
            true => Index::read(index, &partition, channels, records)?,
            false => Index::read_plain(index, partition.block_count(), channels, records)?,
        };
        let header = Header::new(grid, coding, partition, probabilities).with_profile(profile);
        Ok(Reader { data, limits, directory, header, index, pruned: Pruned::default() })
    }

    /// The same with another answer for blocks that were pruned.
    pub fn with_pruned(self, pruned: Pruned) -> Reader<D> {
        Reader { pruned, ..self }
    }

    /// Major version, minor version and draft number (0 when final) of the file.
    pub fn version(&self) -> (u16, u16, u16) {
        self.directory.version()
    }

    /// Shape, axes and channels.
    pub fn grid(&self) -> &Grid {
        &self.header.grid
    }

    /// How the values were coded.
    pub fn coding(&self) -> &Coding {
        &self.header.coding
    }

    /// Whether the file has a grazing profile.
    pub fn has_profile(&self) -> bool {
        self.header.coded_profile.is_some()
    }

    /// The cut into blocks.
    pub fn partition(&self) -> &Partition {
        &self.header.partition
    }

    /// The sections of the file.
    pub fn directory(&self) -> &Directory {
        &self.directory
    }

    /// Number of blocks.
    pub fn block_count(&self) -> usize {
        self.header.partition.block_count()
    }

    /// Number of values of a block: positions times channels; the length of the buffer for [`Reader::block_into`].
    ///
    /// # Errors
    /// `InvalidArgument` if there is no such block.
    pub fn block_values(&self, block: usize) -> Result<usize> {
        Ok(self.place(block)?.positions() * self.grid().channels().len())
    }

    /// Bytes of the file.
    #[cfg(feature = "encode")]
    pub(crate) fn len(&self) -> usize {
        self.data.as_ref().len()
    }

    /// What another file takes over from this one.
    #[cfg(feature = "encode")]
    pub(crate) fn header(&self) -> &Header {
        &self.header
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

    /// Bytes of a block's record.
    pub(crate) fn record_length(&self, block: usize) -> usize {
        self.index.record(block).len()
    }

    /// Provenance and encoder report; empty if the file has none.
    ///
    /// # Errors
    /// `Corrupt` if the section is damaged.
    #[cfg(feature = "metadata")]
    pub fn metadata(&self) -> Result<Metadata> {
        match self.directory.find(directory::METADATA) {
            Some(_) => Metadata::read(self.directory.open(self.data.as_ref(), directory::METADATA)?),
            None => Ok(Metadata::default()),
        }
    }

    pub(crate) fn place(&self, block: usize) -> Result<Block> {
        self.header.partition.block(block).ok_or_else(|| {
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
        if record.class == ValidityClass::Pruned && self.pruned == Pruned::Refuse {
            return Err(Error::Pruned { block });
        }
        Ok(record)
    }

    fn decode_log(&self, block: usize, scratch: &mut Scratch) -> Result<Block> {
        self.place(block)?;
        let record = self.record_to_decode(block)?;
        self.rebuild(block, &record, scratch)
    }

    /// Fails if the profile is damaged.
    fn check_profile(&self) -> Result<()> {
        if let Some(coded) = &self.header.coded_profile {
            self.header.profile().map_err(|what| Error::corrupt("GRAZ", coded.offset, what))?;
        }
        Ok(())
    }

    fn rebuild(&self, block: usize, record: &Record, scratch: &mut Scratch) -> Result<Block> {
        let place = self.place(block)?;
        self.check_profile()?;
        self.header
            .rebuild(&place, record, self.index.means(block), scratch)
            .map_err(|what| self.bad_record(block, what))?;
        Ok(place)
    }

    /// The coefficients of a block of a file without corrections, in the scratch.
    fn decode_coefficients(&self, block: usize, place: &Block, scratch: &mut Scratch) -> Result<()> {
        let record = self.record_to_decode(block)?;
        let mut decoder = Decoder::new(&self.header.probabilities, record.coded);
        let decoded = self.header.decode_record(place, record.class, &mut decoder, scratch);
        decoded.and_then(|()| decoder.check_end()).map_err(|what| self.bad_record(block, what))
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
        self.decode_log(block, scratch)?;
        out.copy_from_slice(self.header.values(scratch));
        Ok(())
    }

    /// Validity of a block's entries, `[channel][position]`.
    ///
    /// # Errors
    /// As [`Reader::block_into`].
    pub fn block_validity(&self, block: usize) -> Result<Vec<bool>> {
        let place = self.place(block)?;
        let record = self.record(block)?;
        let mut masks = Vec::new();
        let mut decoder = Decoder::new(&self.header.probabilities, record.coded);
        self.header.decode_masks(&place, record.class, &mut decoder, &mut masks);
        let channels = self.grid().channels().len();
        let copies = if record.class == ValidityClass::MaskPerChannel { 1 } else { channels };
        Ok(masks.repeat(copies))
    }

    /// Where each entry of a block comes from, `[channel][position]`.
    ///
    /// # Errors
    /// As [`Reader::block_into`].
    pub fn block_origin(&self, block: usize) -> Result<Vec<Origin>> {
        let place = self.place(block)?;
        let valid = self.block_validity(block)?;
        let sampling = self.coding().sampling.doubled(self.record(block)?.doublings);
        let horizon = self.header.horizon();
        let mut origins: Vec<Origin> = positions(place.shape)
            .map(|p| {
                let at = std::array::from_fn(|a| place.origin[a] + p[a]);
                if horizon.is_some_and(|h| h.is_impossible(at)) { Origin::Impossible } else { Origin::Filled }
            })
            .collect();
        origins = origins.repeat(self.grid().channels().len());
        let n = place.positions();
        for (channel, valid) in valid.chunks_exact(n).enumerate() {
            let origins = &mut origins[channel * n..(channel + 1) * n];
            for (origin, _) in origins.iter_mut().zip(valid).filter(|(_, valid)| **valid) {
                *origin = Origin::Measured;
            }
            for position in sample_positions(self.block_seed(block), sampling, valid) {
                origins[position as usize] = Origin::Sampled;
            }
        }
        Ok(origins)
    }

    fn block_seed(&self, block: usize) -> u64 {
        block_seed(self.coding().seed, block as u32)
    }

    /// What the file says about one block.
    ///
    /// # Errors
    /// As [`Reader::block_into`].
    pub fn block_info(&self, block: usize) -> Result<BlockInfo> {
        let place = self.place(block)?;
        let Record { class, doublings, .. } = self.record(block)?;
        let valid = self.block_validity(block)?;
        let planes = valid.chunks_exact(place.positions());
        let seed = self.block_seed(block);
        let sampling = self.coding().sampling.doubled(doublings);
        let sampled = |valid: &[bool]| match sampling {
            Sampling::Every => valid.iter().filter(|v| **v).count(),
            Sampling::Bernoulli { .. } => sample_positions(seed, sampling, valid).len(),
        };
        let (rms, max) = self.index.errors(block);
        Ok(BlockInfo {
            block: place,
            record: self.index.record(block),
            class,
            valid: planes.clone().map(|p| p.iter().filter(|v| **v).count()).collect(),
            sampled: planes.map(sampled).collect(),
            seed,
            ratio: sampling.ratio(),
            rms,
            max,
        })
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

impl<D: AsRef<[u8]> + Sync> Reader<D> {
    /// The whole table: BRDF values in 1/sr, one plane per channel, last axis fastest. Missing entries hold what
    /// the recovery filled in.
    ///
    /// # Errors
    /// `Corrupt` if a record is damaged, `LimitExceeded` if the table is above the caller's limit.
    pub fn decode_all(&self) -> Result<Vec<f32>> {
        let mut values = vec![0f32; self.check_table_size()?];
        self.decode_all_into(&mut values)?;
        Ok(values)
    }

    /// As [`Reader::decode_all`], into the caller's memory: positions times channels values.
    ///
    /// # Errors
    /// As [`Reader::decode_all`], with some of `values` written; `InvalidArgument` if its length is another.
    pub fn decode_all_into(&self, values: &mut [f32]) -> Result<()> {
        let expected = self.check_table_size()?;
        if values.len() != expected {
            return Err(Error::InvalidArgument(format!("the table has {expected} values, not {}", values.len())));
        }
        for_each_block(self.partition().rows_by_block(values), |scratch, block, rows| {
            if self.coding().correction.is_some() {
                self.decode_log(block, scratch)?;
                copy_rows(rows, self.header.values(scratch));
                return Ok(());
            }
            let place = self.place(block)?;
            let record = self.record_to_decode(block)?;
            self.check_profile()?;
            self.header
                .components(&place, &record, self.index.means(block), scratch)
                .and_then(|decoder| decoder.check_end())
                .map_err(|what| self.bad_record(block, what))?;
            self.header.values_in_rows(scratch, rows);
            Ok(())
        })
    }

    /// The whole table in double precision and the source's units, with the validity of its entries.
    ///
    /// # Errors
    /// As [`Reader::decode_all`].
    pub fn decode_table(&self) -> Result<BrdfTable> {
        let size = self.check_table_size()?;
        let mut values = vec![0f64; size];
        let mut valid = vec![false; size];
        let eps = self.header.coding.eps;
        let partition = self.partition();
        let blocks = partition.rows_by_block(&mut values).into_iter().zip(partition.rows_by_block(&mut valid));
        for_each_block(blocks.collect(), |scratch, block, (values, valid)| {
            let place = self.decode_log(block, scratch)?;
            let mut decoded = Vec::with_capacity(scratch.log.len());
            for (log, channel) in scratch.log.chunks_exact(place.positions()).zip(self.grid().channels()) {
                // The scale is mostly below 1: what the tone map saturated would overflow again.
                let unscale = |log: f32| (inverse_tone_map_f64(log, eps) / channel.scale).min(f64::MAX);
                decoded.extend(log.iter().map(|&log| unscale(log)));
            }
            copy_rows(values, &decoded);
            copy_rows(valid, &self.header.masks_of(&place, scratch));
            Ok(())
        })?;
        BrdfTable::from_parts(self.grid().clone(), values, valid)
    }

    /// Checks every byte: all sections' checksums and, block by block, that each record and what restores its bits decodes.
    /// Returns what is damaged; nothing if the file is intact. A table above the caller's limit is not looked at:
    /// that is the one error then.
    pub fn verify(&self) -> Vec<Error> {
        if let Err(e) = self.check_table_size() {
            return vec![e];
        }
        let mut damage = Vec::new();
        for section in self.directory.sections() {
            let bytes = &self.data.as_ref()[section.range.clone()];
            if crc32fast::hash(bytes) != section.crc {
                let what = format!("checksum of section {} is wrong", section.name());
                damage.push(Error::corrupt("file", section.range.start as u64, what));
                continue;
            }
            #[cfg(feature = "metadata")]
            if section.id == directory::METADATA.as_bytes() {
                damage.extend(self.metadata().err());
            }
        }
        let exact = match self.is_lossless().then(|| self.exact_index()).transpose() {
            Ok(exact) => exact,
            Err(e) => {
                damage.push(e);
                None
            }
        };
        let check = |scratch: &mut Scratch, block: usize| {
            let record = self.record(block).and_then(|record| self.rebuild(block, &record, scratch)).err();
            let bits = exact.as_ref().filter(|_| record.is_none());
            Ok([record, bits.and_then(|index| self.exact_bits(index, block, scratch).err())])
        };
        match map_blocks(0..self.block_count(), check) {
            Ok(found) => damage.extend(found.into_iter().flatten().flatten()),
            Err(e) => damage.push(e),
        }
        damage
    }
}

/// `work` on every block, in order of their numbers; the first error ends it.
#[cfg(feature = "parallel")]
fn map_blocks<T: Send>(
    blocks: std::ops::Range<usize>,
    work: impl Fn(&mut Scratch, usize) -> Result<T> + Sync + Send,
) -> Result<Vec<T>> {
    use rayon::prelude::*;
    blocks.into_par_iter().map_init(Scratch::default, work).collect()
}

#[cfg(not(feature = "parallel"))]
fn map_blocks<T>(blocks: std::ops::Range<usize>, work: impl Fn(&mut Scratch, usize) -> Result<T>) -> Result<Vec<T>> {
    let mut scratch = Scratch::default();
    blocks.map(|block| work(&mut scratch, block)).collect()
}

/// `work` on every block with what belongs to it; the first error ends it.
#[cfg(feature = "parallel")]
fn for_each_block<T: Send>(
    blocks: Vec<T>,
    work: impl Fn(&mut Scratch, usize, T) -> Result<()> + Sync + Send,
) -> Result<()> {
    use rayon::prelude::*;
    let with_scratch = |scratch: &mut Scratch, (block, target)| work(scratch, block, target);
    blocks.into_par_iter().enumerate().with_max_len(1).try_for_each_init(Scratch::default, with_scratch)
}

#[cfg(not(feature = "parallel"))]
fn for_each_block<T>(blocks: Vec<T>, work: impl Fn(&mut Scratch, usize, T) -> Result<()>) -> Result<()> {
    let mut scratch = Scratch::default();
    blocks.into_iter().enumerate().try_for_each(|(block, target)| work(&mut scratch, block, target))
}

/// Copies the values of a block into its rows.
fn copy_rows<T: Copy>(rows: Vec<&mut [T]>, values: &[T]) {
    let mut left = values;
    for row in rows {
        let (values, rest) = left.split_at(row.len());
        row.copy_from_slice(values);
        left = rest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn golden() -> Vec<(String, Vec<u8>)> {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/v1");
        let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.retain(|path| path.extension().is_some_and(|e| e == "csbrdf"));
        files.sort();
        assert!(files.len() > 20);
        files.into_iter().map(|path| (path.display().to_string(), std::fs::read(path).unwrap())).collect()
    }

    fn bits(values: &[f32]) -> Vec<u32> {
        values.iter().map(|v| v.to_bits()).collect()
    }

    /// The vector instructions of this machine and those of every machine give the same bits.
    #[test]
    fn every_level_gives_the_same_bits() {
        for (name, bytes) in golden() {
            let mut reader = Reader::open(bytes).unwrap().with_pruned(Pruned::Coarse);
            let best = bits(&reader.decode_all().unwrap());
            reader.header.level = Level::baseline();
            assert!(bits(&reader.decode_all().unwrap()) == best, "{name}");
        }
    }

    /// Single values, from the coefficients, are those of the whole block bit by bit.
    #[test]
    fn points_are_those_of_the_block() {
        let mut scratch = Scratch::default();
        let mut some = 0;
        for (name, bytes) in golden() {
            let reader = Reader::open(bytes).unwrap().with_pruned(Pruned::Coarse);
            let channels = reader.grid().channels().len();
            for block in 0..reader.block_count() {
                let mut whole = vec![0.0; reader.block_values(block).unwrap()];
                reader.block_into(block, &mut whole).unwrap();
                let Some(sparse) = reader.sparse_block(block, &mut scratch).unwrap() else { continue };
                let place = reader.place(block).unwrap();
                for (index, within) in positions(place.shape).enumerate().step_by(7) {
                    let mut value = vec![f32::NAN; channels];
                    reader.point(&sparse, within, &mut value).unwrap();
                    let expected: Vec<f32> = whole.iter().skip(index).step_by(place.positions()).copied().collect();
                    assert!(
                        bits(&value) == bits(&expected),
                        "{name}, block {block}, {within:?}: {value:?} {expected:?}"
                    );
                    some += 1;
                }
            }
        }
        assert!(some > 10_000);
    }

    /// Values on their way into the table and into a block are the same bits; a wrong length is refused.
    #[test]
    fn the_table_is_its_blocks() {
        for (name, bytes) in golden() {
            let reader = Reader::open(bytes).unwrap().with_pruned(Pruned::Coarse);
            let (shape, n) = (reader.grid().shape(), reader.grid().positions());
            let mut expected = vec![0.0; n * reader.grid().channels().len()];
            for block in 0..reader.block_count() {
                let place = reader.place(block).unwrap();
                let mut values = vec![0.0; reader.block_values(block).unwrap()];
                reader.block_into(block, &mut values).unwrap();
                for (plane, values) in expected.chunks_exact_mut(n).zip(values.chunks_exact(place.positions())) {
                    place.scatter(shape, values, plane);
                }
            }
            let mut table = vec![f32::NAN; expected.len()];
            reader.decode_all_into(&mut table).unwrap();
            assert!(bits(&table) == bits(&expected), "{name}");
            assert!(reader.decode_all_into(&mut table[1..]).is_err());
        }
    }

    /// Buffers hold what the block before left, of another shape or file: nothing of it comes through.
    #[test]
    fn what_a_scratch_holds_does_not_matter() {
        let mut stale = Scratch::default();
        for (name, bytes) in golden() {
            let reader = Reader::open(bytes).unwrap().with_pruned(Pruned::Coarse);
            for block in (0..reader.block_count()).rev() {
                let mut fresh = vec![0.0; reader.block_values(block).unwrap()];
                reader.block_into(block, &mut fresh).unwrap();
                let mut values = vec![f32::NAN; fresh.len()];
                reader.block_with(block, &mut stale, &mut values).unwrap();
                assert!(bits(&values) == bits(&fresh), "{name}, block {block}");
            }
        }
    }
}
