//! What a file says about a block besides its values: validity, origin, errors.

use super::{Reader, State};
use crate::base::budget::{Budget, repeated};
use crate::base::error::Result;
use crate::codec::range::Decoder;
use crate::codec::sample::{Sampling, block_seed, sample_positions};
use crate::format::record::{Record, ValidityClass};
use crate::table::block::{Block, positions};

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
#[non_exhaustive]
pub struct BlockInfo {
    /// Place and shape.
    pub block: Block,
    /// Bytes of its record.
    pub record: std::ops::Range<usize>,
    /// Class of validity.
    pub class: ValidityClass,
    /// What the file holds of it.
    pub state: State,
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

impl<D: AsRef<[u8]>> Reader<D> {
    /// Validity of a block's entries, `[channel][position]`.
    ///
    /// # Errors
    /// As [`Reader::block_into`].
    pub fn block_validity(&self, block: usize) -> Result<Vec<bool>> {
        self.validity(block, &self.call())
    }

    fn validity(&self, block: usize, budget: &Budget) -> Result<Vec<bool>> {
        let _held = budget.holding(self.block_values(block)? as u64)?;
        let (place, masks) = self.masks(block, budget)?;
        if masks.len() > place.positions() {
            return Ok(masks);
        }
        budget.spend(self.block_values(block)? as u64 / 8)?;
        repeated(&masks, self.grid().channels().len())
    }

    /// A block's place, and its validity: of each channel, or once where all have the same.
    fn masks(&self, block: usize, budget: &Budget) -> Result<(Block, Vec<bool>)> {
        let place = self.place(block)?;
        let record = self.record(block)?;
        let [work, bytes] = self.codec.of_validity(&place, record.class);
        budget.spend(work)?;
        let _held = budget.holding(bytes)?;
        let mut masks = Vec::new();
        let mut decoder = Decoder::new(self.codec.probabilities.get()?, record.coded);
        self.codec.decode_masks(&place, record.class, &mut decoder, &mut masks)?;
        Ok((place, masks))
    }

    /// Which positions of a block are in bins wholly below the horizon; `None`: the grid has no such.
    fn impossible(&self, place: Block) -> Option<impl Iterator<Item = bool>> {
        let horizon = self.codec.horizon()?;
        Some(
            positions(place.shape).map(move |p| horizon.is_impossible(std::array::from_fn(|a| place.origin[a] + p[a]))),
        )
    }

    /// Where each entry of a block comes from, `[channel][position]`.
    ///
    /// # Errors
    /// As [`Reader::block_into`].
    pub fn block_origin(&self, block: usize) -> Result<Vec<Origin>> {
        let budget = &self.call();
        let place = self.place(block)?;
        let valid = self.validity(block, budget)?;
        let sampling = self.coding().sampling.doubled(self.record(block)?.doublings);
        let channels = self.grid().channels().len();
        let [work, bytes] = self.codec.of_origins(&place, channels, sampling != Sampling::Every);
        budget.spend(work + 2 * valid.len() as u64)?;
        let _held = budget.holding(bytes + 2 * valid.len() as u64)?;
        let n = place.positions();
        let of_one: Vec<Origin> = match self.impossible(place) {
            // A byte a position.
            Some(all) => all.map(|is| if is { Origin::Impossible } else { Origin::Filled }).collect(),
            None => vec![Origin::Filled; n],
        };
        let mut origins = repeated(&of_one, channels)?;
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

    /// How many entries of a block come from where, in the order of [`Origin`]'s variants: what counting those of
    /// [`Reader::block_origin`] gives, at less cost.
    ///
    /// # Errors
    /// As [`Reader::block_into`].
    pub fn block_origins(&self, block: usize) -> Result<[usize; 4]> {
        self.origins(block, &self.call())
    }

    /// As [`Reader::block_origins`], on a budget.
    pub(crate) fn origins(&self, block: usize, budget: &Budget) -> Result<[usize; 4]> {
        let (place, masks) = self.masks(block, budget)?;
        let _held = budget.holding(masks.len() as u64)?;
        let sampling = self.coding().sampling.doubled(self.record(block)?.doublings);
        let n = place.positions();
        let (each, copies) = (masks.len() / n, self.grid().channels().len() * n / masks.len());
        let [work, bytes] = self.codec.of_origins(&place, each, sampling != Sampling::Every);
        budget.spend(work)?;
        let _also = budget.holding(bytes)?;
        let mut counts = [0; 4];
        for valid in masks.chunks_exact(n) {
            let measured = valid.iter().filter(|valid| **valid).count();
            let sampled = self.sampled(block, sampling, valid);
            let missing = || valid.iter().map(|valid| !valid);
            let impossible = match self.impossible(place).filter(|_| measured < n) {
                Some(all) => all.zip(missing()).filter(|(is, missing)| *is && *missing).count(),
                None => 0,
            };
            let filled = n - measured - impossible;
            let of_mask = [sampled, measured - sampled, filled, impossible];
            counts.iter_mut().zip(of_mask).for_each(|(count, of_mask)| *count += copies * of_mask);
        }
        Ok(counts)
    }

    /// Entries of a channel that were sampled.
    fn sampled(&self, block: usize, sampling: Sampling, valid: &[bool]) -> usize {
        match sampling {
            Sampling::Every => valid.iter().filter(|v| **v).count(),
            Sampling::Bernoulli { .. } => sample_positions(self.block_seed(block), sampling, valid).len(),
        }
    }

    fn block_seed(&self, block: usize) -> u64 {
        block_seed(self.coding().seed, block as u32)
    }

    /// What the file says about one block.
    ///
    /// # Errors
    /// As [`Reader::block_into`].
    pub fn block_info(&self, block: usize) -> Result<BlockInfo> {
        let budget = &self.call();
        let state = self.state(block)?;
        let Record { class, doublings, .. } = self.record(block)?;
        let (place, masks) = self.masks(block, budget)?;
        let _held = budget.holding(masks.len() as u64)?;
        let sampling = self.coding().sampling.doubled(doublings);
        let n = place.positions();
        let [work, bytes] = self.codec.of_origins(&place, masks.len() / n, sampling != Sampling::Every);
        budget.spend(work)?;
        let _also = budget.holding(bytes)?;
        // One number a channel, 4096 at most.
        let copies = self.grid().channels().len() * n / masks.len();
        let planes = masks.chunks_exact(n);
        let valid: Vec<usize> = planes.clone().map(|p| p.iter().filter(|v| **v).count()).collect();
        let sampled: Vec<usize> = planes.map(|valid| self.sampled(block, sampling, valid)).collect();
        let (rms, max) = self.index.errors(block);
        Ok(BlockInfo {
            block: place,
            record: self.index.record(block),
            class,
            state,
            valid: valid.repeat(copies),
            sampled: sampled.repeat(copies),
            seed: self.block_seed(block),
            ratio: sampling.ratio(),
            rms,
            max,
        })
    }
}
