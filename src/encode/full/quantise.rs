//! Blocks of the full table: holes filled, transformed, quantised.

use rayon::prelude::*;

use super::trellis::{self, Filled};
use super::table::{FullBlock, FullTable};
use crate::base::error::Result;
use crate::encode::progress::Progress;
use crate::encode::quantised::Quantized;
use crate::encode::settings::Encoder;
use crate::table::block::{Block, Partition};

impl FullTable {
    /// All blocks, in parallel, in order.
    pub(in crate::encode) fn quantize_blocks(
        &self,
        settings: &Encoder,
        partition: &Partition,
        progress: Progress,
    ) -> Result<Vec<Quantized>> {
        let pieces = progress.pieces(partition.block_count());
        let filled: Vec<Filled> = (0..partition.block_count())
            .into_par_iter()
            .with_max_len(1)
            .map(|number| {
                let block = partition.block(number).expect("number is below the count");
                let (filled, _) = self.fill(settings, &block, settings.effort.fill_steps());
                pieces.finish();
                filled
            })
            .collect();
        trellis::quantize(&filled, self.channels, settings.step, settings.rounding).ok_or_else(|| settings.too_fine())
    }

    /// A block through channel transform and basis, its holes filled in `steps` steps; how many of its entries are known.
    fn fill(&self, settings: &Encoder, block: &Block, steps: usize) -> (Filled, usize) {
        let FullBlock { log: mut coefficients, known } = self.block(block);
        let count = known.iter().filter(|k| **k).count();
        if count == 0 {
            coefficients.clear();
        } else {
            let (transform, step) = (&self.transform, settings.step);
            self.fillers.with(|f| f.analyze(block.shape, transform, &mut coefficients, &known, step, steps));
        }
        (Filled { shape: block.shape, coefficients }, count)
    }

    /// A block quantised for a trial, its holes filled in few steps.
    ///
    /// # Errors
    /// `InvalidArgument` if the step is too small for the format.
    pub(in crate::encode) fn quantize_trial(&self, settings: &Encoder, block: &Block) -> Result<Quantized> {
        let n = block.positions();
        let mut quantized = Quantized::empty(block.shape, self.channels);
        let (filled, known) = self.fill(settings, block, settings.effort.trial_steps());
        for (c, values) in filled.coefficients.chunks_exact(n).enumerate() {
            let done = quantized.quantize_trial(c, settings.step, settings.rounding, values);
            done.ok_or_else(|| settings.too_fine())?;
        }
        // Errors in holes do not count.
        quantized.squared_error *= known as f64 / (n * self.channels) as f64;
        Ok(quantized)
    }
}
