//! The source's bits, from files that keep them (spec section 4.12).

use super::{Reader, Scratch};
use crate::base::budget::{Budget, filled, zeroed};
use crate::base::error::{Error, Result};
use crate::blocks::lossless::decode_bits;
use crate::codec::lossless::Decoded;
use crate::format::directory;
use crate::format::is_compact;
use crate::format::lossless::LosslessIndex;
use crate::format::record::ValidityClass;
use crate::table::block::Block;

impl<D: AsRef<[u8]>> Reader<D> {
    /// Whether the file restores the table that it was made from bit by bit: [`Reader::source_table`].
    pub fn is_lossless(&self) -> bool {
        // Before draft 3 the name was free for others to use.
        is_compact(self.version().2) && self.directory.find(directory::LOSSLESS).is_some()
    }

    /// One block of the source, bit by bit, in its units: `[channel][position]`, with whatever marked missing entries.
    ///
    /// # Errors
    /// `InvalidArgument` if the file is not lossless or has no such block, `Corrupt` if the block's record or what
    /// restores its bits is damaged.
    pub fn source_block(&self, block: usize) -> Result<Vec<f64>> {
        self.place(block)?;
        let (_, bits) = self.source_bits_within(&self.lossless_index()?, block, &mut Scratch::default(), &self.call())?;
        Ok(bits.into_iter().map(f64::from_bits).collect())
    }

    /// Where the parts of the blocks are. Read when bits are asked for: damage there does not keep values from being decoded.
    pub(crate) fn lossless_index(&self) -> Result<LosslessIndex> {
        if !self.is_lossless() {
            let what = "the file does not hold the source values; encode the table with --lossless to keep them";
            return Err(Error::InvalidArgument(what.into()));
        }
        let section = self.directory.require(directory::LOSSLESS)?;
        LosslessIndex::read(self.data.as_ref(), section, self.block_count(), self.grid().channels().len())
    }

    /// How many blocks have lost their source values to damage, although they are marked so in a repaired file.
    ///
    /// # Errors
    /// As [`Reader::source_block`], for the list of their parts.
    pub fn lost_source(&self) -> Result<usize> {
        let index = self.lossless_index()?;
        Ok((0..self.block_count()).filter(|&block| index.is_lost(self.data.as_ref(), block)).count())
    }

    pub(crate) fn source_bits(
        &self,
        index: &LosslessIndex,
        block: usize,
        scratch: &mut Scratch,
    ) -> Result<(Block, Vec<u64>)> {
        self.source_bits_within(index, block, scratch, &self.call())
    }

    /// As [`Reader::source_bits`], on a budget.
    pub(super) fn source_bits_within(
        &self,
        index: &LosslessIndex,
        block: usize,
        scratch: &mut Scratch,
        budget: &Budget,
    ) -> Result<(Block, Vec<u64>)> {
        let coded = index.coded(self.data.as_ref(), block)?;
        let record = self.record(block)?;
        if record.class == ValidityClass::Pruned {
            return Err(self.gone(block));
        }
        let place = self.rebuild(block, &record, scratch, budget)?;
        let [work, bytes] = self.codec.of_source(&place);
        budget.spend(work)?;
        let _held = budget.holding(bytes)?;
        let scales: Vec<f64> = self.grid().channels().iter().map(|channel| channel.scale).collect();
        let mut bits = filled(0, scratch.log.len())?;
        let decoded = Decoded {
            shape: place.shape,
            valid: &self.codec.masks_of(&place, scratch)?,
            log: &scratch.log,
            eps: self.codec.coding.eps,
            scales: &scales,
            missing: &index.missing,
        };
        decode_bits(decoded, coded, &mut bits).map_err(|what| index.corrupt(block, what))?;
        Ok((place, bits))
    }
}

impl<D: AsRef<[u8]> + Sync> Reader<D> {
    /// The table that the file was made from, bit by bit, in its units: one plane per channel, last axis fastest, missing
    /// entries with whatever marked them (negative, infinite, NaN with its payload).
    ///
    /// # Errors
    /// `InvalidArgument` if the file is not lossless ([`Reader::is_lossless`]), `Corrupt` if a record or what restores a
    /// block's bits is damaged, `LimitExceeded` if the table is above the caller's limit.
    pub fn source_table(&self) -> Result<Vec<f64>> {
        let index = self.lossless_index()?;
        let mut values = zeroed(self.check_table_size()?)?;
        let (shares, budget) = (self.shares(), self.whole_call());
        self.for_each_block(&shares, shares.memory(&mut values), |scratch, block, place, memory| {
            let (_, bits) = self.source_bits_within(&index, block, scratch, &budget)?;
            // In the same memory.
            let exact: Vec<f64> = bits.into_iter().map(f64::from_bits).collect();
            memory.of_block(place).put_all(&exact);
            Ok(())
        })?;
        Ok(values)
    }
}
