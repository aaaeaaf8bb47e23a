//! What the parts of a decode cost, before they are done: bytes, and operations of about a nanosecond.
//!
//! Measured on one core of a machine with AVX-512, and rounded up, since others have narrower units. What is decoded of a record
//! is counted afterwards, when it is known: until then a block costs a third of a second at most (`MAX_BLOCK_VALUES`).

use super::codec::{BlockCodec, Scratch};
use super::head_cost::{AT_ONCE, COEFFICIENT, STEP};
use crate::codec::channel::ChannelTransform;
use crate::codec::correct;
use crate::codec::entropy::bytes_of_walk;
use crate::base::limits::MAX_BLOCK_VALUES;
use crate::format::record::ValidityClass;
use crate::table::block::Block;

/// A block by itself: the coder's contexts, the record's checksum.
const BLOCK: u64 = 2000;
/// An entry of a mask, of exact zeros, of corrections, of exact bits.
const MASK: u64 = 6;
const ZERO: u64 = 6;
const CORRECTION: u64 = 12;
const EXACT: u64 = 60;
/// An entry's elevation.
const ELEVATION: u64 = 4;

impl Scratch {
    /// What it takes in memory.
    pub(crate) fn bytes(&self) -> usize {
        let plain = self.masks.capacity() + self.zeros.capacity() + 4 * self.corrections.capacity();
        let terms = self.terms.capacity() * size_of::<crate::codec::fourier::Term>();
        let walks = self.walk.bytes() + self.correct.bytes() + self.lines.bytes();
        plain + terms + walks + self.coefficients.bytes() + self.log.bytes() + self.values.bytes()
    }
}

impl BlockCodec {
    fn values_of(&self, block: &Block) -> u64 {
        (block.positions() * self.grid.channels().len()) as u64
    }

    /// Bytes of the buffers of rebuilding a block, but for those of the coefficients, whose number is not known.
    pub(crate) fn bytes_of_block(&self, block: &Block, class: ValidityClass) -> u64 {
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
    pub(crate) fn most_bytes_of_block(&self) -> u64 {
        let whole = |shape: &[usize; 4]| Block { origin: [0; 4], shape: *shape };
        let bytes =
            |block: Block| self.bytes_of_block(&block, ValidityClass::MaskPerChannel) + 16 * self.values_of(&block);
        self.partition.shapes().iter().map(whole).map(bytes).max().unwrap_or(0)
    }

    /// Work that a block takes at least, whatever its record holds.
    pub(crate) fn work_of_block(&self, block: &Block, class: ValidityClass) -> u64 {
        let values = self.values_of(block);
        BLOCK + if class.is_mean_only() { values / 2 } else { 2 * values }
    }

    /// Work that decoding a record was.
    pub(crate) fn work_of_record(&self, block: &Block, scratch: &Scratch) -> u64 {
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
    pub(crate) fn work_of_synthesis(&self, block: &Block, scratch: &Scratch) -> u64 {
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
    pub(crate) fn work_of_profile(&self, block: &Block) -> u64 {
        let Some(profile) = &self.coded_profile else { return 0 };
        let rows = (block.positions() / block.shape[3]) as u64;
        let groups = self.grid.channels().len().div_ceil(4) as u64;
        // Its knots for each row and group of channels, and each entry's place among them.
        rows * groups * (8 + 2 * profile.knots as u64) + 4 * block.positions() as u64 + 2 * self.values_of(block)
    }

    /// Operations and bytes of finding which entries of a block are valid: of all channels if each has a mask of its own.
    pub(crate) fn of_validity(&self, block: &Block, class: ValidityClass) -> [u64; 2] {
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

    /// Operations and bytes of where the entries of `channels` channels of a block come from.
    pub(crate) fn of_origins(&self, block: &Block, channels: usize, drawn: bool) -> [u64; 2] {
        let n = block.positions() as u64;
        let (each, bytes) = if drawn { (20, 8 * n) } else { (1, 0) };
        [n * ELEVATION * 2 + n * each * channels as u64, bytes + n]
    }

    /// Operations and bytes of source values.
    pub(crate) fn of_source(&self, block: &Block) -> [u64; 2] {
        let (n, values) = (block.positions() as u64, self.values_of(block));
        [values * EXACT, 9 * values + 26 * n]
    }
}

// What is counted afterwards only is done within a third of a second.
const _: () = assert!(MAX_BLOCK_VALUES as u64 * (STEP + COEFFICIENT) <= 300_000_000);
