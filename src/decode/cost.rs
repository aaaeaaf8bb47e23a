//! What the parts of a decode cost, before they are done: bytes, and operations of about a nanosecond.
//!
//! Measured on one core of a machine with AVX-512, and rounded up, since others have narrower units. What is decoded of a record
//! is counted afterwards, when it is known: until then a block costs a third of a second at most (`MAX_BLOCK_VALUES`).

use super::{Header, Scratch};
use crate::codec::channel::ChannelTransform;
use crate::codec::correct;
use crate::codec::entropy::bytes_of_walk;
use crate::codec::fourier::Synthesis;
use crate::base::limits::MAX_BLOCK_VALUES;
use crate::codec::profile::TABLES;
use crate::format::profile::CodedProfile;
use crate::format::record::ValidityClass;
use crate::table::block::Block;
use crate::table::grid::Grid;

/// A block by itself: the coder's contexts, the record's checksum.
const BLOCK: u64 = 2000;
/// A row or a place of a coefficient that is gone through, and a coefficient that is found.
const STEP: u64 = 4;
const COEFFICIENT: u64 = 12;
/// An entry of a mask, of exact zeros, of corrections, of exact bits.
const MASK: u64 = 6;
const ZERO: u64 = 6;
const CORRECTION: u64 = 12;
const EXACT: u64 = 60;
/// An entry's elevation.
const ELEVATION: u64 = 4;
/// Multiply-adds in one operation.
const AT_ONCE: u64 = 6;
/// A block of the index, and one of its means.
const ENTRY: u64 = 64;
const MEAN: u64 = 16;

/// Operations and bytes of reading an index.
pub(super) fn of_index(blocks: usize, components: usize) -> [u64; 2] {
    let [blocks, means] = [blocks as u64, blocks.saturating_mul(components) as u64];
    [ENTRY * blocks + MEAN * means, 4 * means + (size_of::<usize>() as u64 + 2) * blocks]
}

/// Operations and bytes of rebuilding a profile, its tables side by side included.
pub(super) fn of_profile(
    coded: &CodedProfile,
    grid: &Grid,
    synthesis: &Synthesis,
    shapes: [[usize; 4]; 2],
) -> [u64; 2] {
    let channels = grid.channels().len() as u64;
    let (mut work, mut bytes) = (0, 0);
    for shape in shapes {
        let n = shape.iter().product::<usize>();
        let values = n as u64 * channels;
        // Two tables of a shape.
        work += 2 * (values * (STEP + COEFFICIENT) + channels * synthesis.work(shape, n) / AT_ONCE);
        bytes += 2 * (4 * values + 4 * n as u64 * channels.next_multiple_of(4));
        // Coefficients of one at a time.
        bytes += 16 * values;
    }
    debug_assert!(TABLES == 4 && coded.knots > 0);
    [work, bytes]
}

impl Scratch {
    /// What it takes in memory.
    pub(crate) fn bytes(&self) -> usize {
        let plain = self.masks.capacity() + self.zeros.capacity() + 4 * self.corrections.capacity();
        let terms = self.terms.capacity() * size_of::<crate::codec::fourier::Term>();
        let walks = self.walk.bytes() + self.correct.bytes() + self.lines.bytes();
        plain + terms + walks + self.coefficients.bytes() + self.log.bytes() + self.values.bytes()
    }
}

impl Header {
    fn values_of(&self, block: &Block) -> u64 {
        (block.positions() * self.grid.channels().len()) as u64
    }

    /// Bytes of the buffers of rebuilding a block, but for those of the coefficients, whose number is not known.
    pub(super) fn bytes_of_block(&self, block: &Block, class: ValidityClass) -> u64 {
        let (n, values) = (block.positions() as u64, self.values_of(block));
        let mixed = matches!(self.coding.transform, ChannelTransform::Matrix(_)) && self.grid.channels().len() == 3;
        let log = if mixed { 8 * values } else { 4 * values };
        if class.is_mean_only() {
            return log + n + self.synthesis.bytes(block.shape) as u64;
        }
        let masks = if class == ValidityClass::MaskPerChannel { values + n } else { 2 * n };
        let zeros = if self.coding.zeros { values } else { 0 };
        let corrections = match self.coding.correction {
            // With the validity less exact zeros.
            Some(_) => 5 * values + correct::bytes_of_walk(block.shape) as u64,
            None => 0,
        };
        let walk = (bytes_of_walk(block.shape) + self.synthesis.bytes(block.shape)) as u64;
        log + masks + zeros + corrections + walk
    }

    /// The same of any block of the file, with as many coefficients as it may have.
    pub(super) fn most_bytes_of_block(&self) -> u64 {
        let whole = |shape: &[usize; 4]| Block { origin: [0; 4], shape: *shape };
        let bytes =
            |block: Block| self.bytes_of_block(&block, ValidityClass::MaskPerChannel) + 16 * self.values_of(&block);
        self.partition.shapes().iter().map(whole).map(bytes).max().unwrap_or(0)
    }

    /// Work that a block takes at least, whatever its record holds.
    pub(super) fn work_of_block(&self, block: &Block, class: ValidityClass) -> u64 {
        let values = self.values_of(block);
        BLOCK + if class.is_mean_only() { values / 2 } else { 2 * values }
    }

    /// Work that decoding a record was.
    pub(super) fn work_of_record(&self, block: &Block, scratch: &Scratch) -> u64 {
        let (n, coefficients) = (block.positions() as u64, &scratch.coefficients);
        let masks = match scratch.class {
            ValidityClass::Mask => n * (MASK + ELEVATION),
            ValidityClass::MaskPerChannel => self.values_of(block) * MASK + n * ELEVATION,
            ValidityClass::Horizon => n * ELEVATION,
            _ => 0,
        };
        let zeros = scratch.zeros.len() as u64 * ZERO;
        masks + zeros + STEP * coefficients.steps() + COEFFICIENT * coefficients.len() as u64
    }

    /// Work of what comes after: values from the coefficients in the scratch, and corrections.
    pub(super) fn work_of_synthesis(&self, block: &Block, scratch: &Scratch) -> u64 {
        let (values, channels) = (self.values_of(block), self.grid.channels().len());
        let terms = |c: usize| 1 + scratch.coefficients.of_channel(c).len();
        let sums: u64 = (0..channels).map(|c| self.synthesis.work(block.shape, terms(c))).sum();
        let mixed = match &self.coding.transform {
            ChannelTransform::Matrix(_) => values * channels as u64,
            ChannelTransform::None => 0,
        };
        let corrections = match self.coding.correction {
            Some(_) if !scratch.class.is_mean_only() => values * CORRECTION,
            _ => 0,
        };
        (sums + mixed) / AT_ONCE + corrections + self.work_of_profile(block)
    }

    /// Work of adding the profile to a block.
    pub(super) fn work_of_profile(&self, block: &Block) -> u64 {
        let Some(profile) = &self.coded_profile else { return 0 };
        let rows = (block.positions() / block.shape[3]) as u64;
        let groups = self.grid.channels().len().div_ceil(4) as u64;
        // Its knots for each row and group of channels, and each entry's place among them.
        rows * groups * (8 + 2 * profile.knots as u64) + 4 * block.positions() as u64 + 2 * self.values_of(block)
    }

    /// Operations and bytes of telling which entries of a block are valid: of all channels if each has a mask of its own.
    pub(super) fn of_validity(&self, block: &Block, class: ValidityClass) -> [u64; 2] {
        let n = block.positions() as u64;
        match class {
            ValidityClass::MaskPerChannel => {
                [BLOCK + self.values_of(block) * MASK + n * ELEVATION, self.values_of(block) + n]
            }
            ValidityClass::Mask => [BLOCK + n * (MASK + ELEVATION), 2 * n],
            ValidityClass::Horizon => [BLOCK + n * ELEVATION, n],
            _ => [BLOCK + n / 8, n],
        }
    }

    /// Operations and bytes of where the entries of so many channels of a block come from.
    pub(super) fn of_origins(&self, block: &Block, channels: usize, drawn: bool) -> [u64; 2] {
        let n = block.positions() as u64;
        let (each, bytes) = if drawn { (20, 8 * n) } else { (1, 0) };
        [n * ELEVATION * 2 + n * each * channels as u64, bytes + n]
    }

    /// Operations and bytes of exact values.
    pub(super) fn of_exact(&self, block: &Block) -> [u64; 2] {
        let (n, values) = (block.positions() as u64, self.values_of(block));
        [values * EXACT, 9 * values + 26 * n]
    }
}

// What is counted afterwards only is done within a third of a second.
const _: () = assert!(MAX_BLOCK_VALUES as u64 * (STEP + COEFFICIENT) <= 300_000_000);
