//! What a file says about a block besides its values: validity, origin, errors.

use super::Reader;
use crate::block::{Block, positions};
use crate::error::Result;
use crate::format::record::{Record, ValidityClass};
use crate::range::Decoder;
use crate::sample::{Sampling, block_seed, sample_positions};

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

impl<D: AsRef<[u8]>> Reader<D> {
    /// Validity of a block's entries, `[channel][position]`.
    ///
    /// # Errors
    /// As [`Reader::block_into`].
    pub fn block_validity(&self, block: usize) -> Result<Vec<bool>> {
        let place = self.place(block)?;
        let record = self.record(block)?;
        let mut masks = Vec::new();
        let mut decoder = Decoder::new(self.header.probabilities.get()?, record.coded);
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
}
