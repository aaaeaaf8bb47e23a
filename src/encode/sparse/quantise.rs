//! Blocks of a table that is sampled: tone map, channel transform, sampling, recovery, quantiser.

use rayon::prelude::*;

use super::estimate::Estimate;
use super::recover::{Recoverer, Recovery};
use crate::base::error::Result;
use crate::codec::channel::ChannelTransform;
use crate::codec::sample::block_seed;
use crate::encode::gather::gather_log;
use crate::encode::progress::Progress;
use crate::encode::quantised::{Quantized, Solves};
use crate::encode::settings::Encoder;
use crate::table::Table;
use crate::table::block::{Block, Partition};

/// What the blocks of a sampled table share.
#[derive(Clone, Copy)]
pub(in crate::encode) struct Sampled<'a> {
    pub(in crate::encode) settings: &'a Encoder,
    pub(in crate::encode) table: &'a Table,
    pub(in crate::encode) transform: &'a ChannelTransform,
    /// The table recovered as a whole, if it was.
    pub(in crate::encode) estimate: Option<&'a Estimate>,
}

impl<'a> Sampled<'a> {
    /// All blocks, in parallel, in order; at most `iterations` in a solve.
    pub(in crate::encode) fn quantize_blocks(
        self,
        partition: &'a Partition,
        iterations: usize,
        progress: Progress<'a>,
    ) -> impl IndexedParallelIterator<Item = Result<Quantized>> + 'a {
        let recovery: Recovery = Recovery::new(self.settings, iterations);
        let pieces = progress.pieces(partition.block_count());
        (0..partition.block_count()).into_par_iter().map_init(
            move || Recoverer::new(recovery),
            move |recoverer, number| {
                let block = partition.block(number).expect("number is below the count");
                let quantized = self.quantize_block(recoverer, number, &block);
                pieces.finish();
                quantized.ok_or_else(|| self.settings.too_fine())
            },
        )
    }

    /// One block. `None` if the step is too small for the format.
    pub(in crate::encode) fn quantize_block(self, recoverer: &mut Recoverer, number: usize, block: &Block) -> Option<Quantized> {
        let Sampled { settings, table, transform, estimate } = self;
        let n = block.positions();
        let channels = table.grid().channels().len();
        let (mut log, valid) = gather_log(table, block, settings.eps);
        match estimate {
            Some(estimate) => estimate.gather(block, &mut log),
            None => transform.forward(&mut log, channels),
        }
        let seed = block_seed(settings.seed, number as u32);
        let mut quantized = Quantized::empty(block.shape, channels);
        let mut sampled = estimate.map_or(0, |estimate| estimate.sampled[number]);
        let doublings = estimate.map_or(0, |estimate| estimate.doublings[number]);
        let mut cost = Solves::default();
        for c in 0..channels {
            let values = &mut log[c * n..(c + 1) * n];
            let valid = &valid[c * n..(c + 1) * n];
            let known = match estimate {
                Some(_) if valid.contains(&true) => {
                    recoverer.analyze(block.shape, values);
                    true
                }
                Some(_) => {
                    values.fill(0.0);
                    false
                }
                None => {
                    let samples = recoverer.recover(block.shape, seed, values, valid, &mut cost);
                    sampled += samples;
                    samples > 0
                }
            };
            if known {
                quantized.quantize(c, settings.step, settings.rounding, values)?;
            }
        }
        Some(Quantized { sampled, doublings, cost, ..quantized })
    }
}
