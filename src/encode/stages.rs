//! Stages one to five of the encoder, block by block: tone map, channel transform, sampling, recovery, quantiser.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::Encoder;
use super::blocks::{Quantized, gather_log};
use super::dense::{Dense, DenseBlock};
use super::estimate::Estimate;
use super::recover::{Recoverer, Recovery, Solves};
use super::trellis::{self, Filled};
use crate::base::error::{Error, Result};
use crate::codec::channel::ChannelTransform;
use crate::codec::sample::block_seed;
use crate::table::BrdfTable;
use crate::table::block::{Block, Partition};

impl Encoder {
    pub(super) fn recovery(&self, iterations: usize) -> Recovery {
        let (basis, sampling, weighting) = (self.basis, self.base_sampling(), self.weighting);
        Recovery { basis, sampling, sigma_rms: self.sigma_rms(), iterations, weighting }
    }

    /// Stages one to five of all blocks, in parallel, in order.
    pub(super) fn quantize_blocks<'a>(
        &'a self,
        table: &'a BrdfTable,
        transform: &'a ChannelTransform,
        partition: &'a Partition,
        estimate: Option<&'a Estimate>,
        iterations: usize,
        progress: &'a (dyn Fn(f64) + Sync),
    ) -> impl IndexedParallelIterator<Item = Result<Quantized>> + 'a {
        let recovery = self.recovery(iterations);
        let done = AtomicUsize::new(0);
        let count = partition.block_count();
        (0..count).into_par_iter().map_init(
            move || Recoverer::new(recovery),
            move |recoverer, number| {
                let block = partition.block(number).expect("number is below the count");
                let quantized = self.quantize_block(table, transform, estimate, recoverer, number, &block);
                progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / count as f64);
                quantized.ok_or_else(|| self.too_fine())
            },
        )
    }

    /// Stages one to five of a block: tone map, channel transform, sampling, recovery, quantiser.
    /// `None` if the step is too small for the format.
    pub(super) fn quantize_block(
        &self,
        table: &BrdfTable,
        transform: &ChannelTransform,
        estimate: Option<&Estimate>,
        recoverer: &mut Recoverer,
        number: usize,
        block: &Block,
    ) -> Option<Quantized> {
        let n = block.positions();
        let channels = table.grid().channels().len();
        let (mut log, valid) = gather_log(table, block, self.eps);
        match estimate {
            Some(estimate) => estimate.gather(block, &mut log),
            None => transform.forward(&mut log, channels),
        }
        let seed = block_seed(self.seed, number as u32);
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
                quantized.quantize(c, self.step, self.rounding, values)?;
            }
        }
        Some(Quantized { sampled, doublings, cost, ..quantized })
    }

    /// Stages three to five of all blocks of a dense table, in parallel, in order.
    pub(super) fn quantize_dense_blocks(
        &self,
        dense: &Dense,
        transform: &ChannelTransform,
        partition: &Partition,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<Vec<Quantized>> {
        let done = AtomicUsize::new(0);
        let count = partition.block_count();
        let filled: Vec<Filled> = (0..count)
            .into_par_iter()
            .with_max_len(1)
            .map(|number| {
                let block = partition.block(number).expect("number is below the count");
                let (filled, _) = self.fill(dense, transform, &block, self.effort.fill_steps());
                progress((done.fetch_add(1, Ordering::Relaxed) + 1) as f64 / count as f64);
                filled
            })
            .collect();
        trellis::quantize(&filled, dense.channels, self.step, self.rounding).ok_or_else(|| self.too_fine())
    }

    /// A block of a dense table through channel transform and basis, its holes filled in so many steps; how many of its entries
    /// are known.
    fn fill(&self, dense: &Dense, transform: &ChannelTransform, block: &Block, steps: usize) -> (Filled, usize) {
        let DenseBlock { log: mut coefficients, known } = dense.block(block);
        let count = known.iter().filter(|k| **k).count();
        if count == 0 {
            coefficients.clear();
        } else {
            let step = self.step;
            dense.fillers.with(|f| f.analyze(block.shape, transform, &mut coefficients, &known, step, steps));
        }
        (Filled { shape: block.shape, coefficients }, count)
    }

    /// A block of a dense table quantised for a trial, its holes filled in so many steps.
    /// `None` if the step is too small for the format.
    pub(super) fn quantize_dense(
        &self,
        dense: &Dense,
        transform: &ChannelTransform,
        block: &Block,
        steps: usize,
    ) -> Option<Quantized> {
        let n = block.positions();
        let mut quantized = Quantized::empty(block.shape, dense.channels);
        let (filled, known) = self.fill(dense, transform, block, steps);
        for (c, values) in filled.coefficients.chunks_exact(n).enumerate() {
            quantized.quantize_trial(c, self.step, self.rounding, values)?;
        }
        // Errors in holes do not count.
        quantized.squared_error *= known as f64 / (n * dense.channels) as f64;
        Some(quantized)
    }

    pub(super) fn too_fine(&self) -> Error {
        let largest = crate::codec::entropy::MAX_MAGNITUDE;
        let step = self.step;
        Error::InvalidArgument(format!("quality {step} is too fine: a coefficient is beyond {largest} steps; raise it"))
    }
}
