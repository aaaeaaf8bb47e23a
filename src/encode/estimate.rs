//! All values of a table from its samples: trend, then l1 recovery of what is left, window by window (encoder only).
//!
//! The windows need not be the blocks of the file: longer ones hold more samples each, and the blocks may be as small as
//! single values are to be had cheaply. Measured at 5 %, log rms with windows 15x15x15, 15x15x60, 15x15x180, and 15x15x180
//! with margins of 5: alum-bronze .022, .018, .019, .018; RGL golden yellow .071, .058, .057, .056, where the margins cost
//! five times the time.

mod windows;

use rayon::prelude::*;

use super::recover::{Recoverer, Recovery, Solves};
use super::trend::{Model, Trend};
use crate::block::{Block, Partition};
use crate::channel::ChannelTransform;
use crate::sample::{Sampling, block_seed, sample_positions};
use crate::table::BrdfTable;
use crate::tone::tone_map;
use windows::Windows;

/// Trends to choose from, by their stiffness; none is a choice as well.
///
/// Chosen on samples held out, at 1 %: 0.2 for green-fabric and alum-bronze gains 6 % over 1, 5 for golden yellow 3 %.
const STIFFNESSES: [f64; 3] = [0.2, 1.0, 5.0];

/// One sample of so many is held out for the choice.
const HELD_OUT: usize = 5;

/// The choice is made on one window of so many, with short solves.
const TRIAL_WINDOWS: usize = 3;
const TRIAL_ITERATIONS: usize = 50;

/// What became of a table.
pub(super) struct Estimate {
    grid: [usize; 4],
    /// ln(f + eps) after the channel transform, everywhere: `[component][position]`.
    planes: Vec<f64>,
    /// Samples that each block took, all components.
    pub(super) sampled: Vec<usize>,
    pub(super) cost: Solves,
}

impl Estimate {
    /// The values of a block, `[component][position]`.
    pub(super) fn gather(&self, block: &Block, values: &mut [f64]) {
        let n = self.grid.iter().product();
        for (plane, values) in self.planes.chunks_exact(n).zip(values.chunks_exact_mut(block.positions())) {
            block.gather(self.grid, plane, values);
        }
    }
}

/// The samples of a component.
struct Samples {
    /// In the grid, ascending.
    positions: Vec<u32>,
    values: Vec<f64>,
}

/// The table's log values after the channel transform, zero where not valid.
pub(super) fn log_planes(table: &BrdfTable, transform: &ChannelTransform, eps: f64) -> Vec<f64> {
    let channels = table.grid().channels();
    let n = table.grid().positions();
    let mut planes = vec![0.0; n * channels.len()];
    for ((c, channel), plane) in channels.iter().enumerate().zip(planes.chunks_exact_mut(n)) {
        let entries = table.plane(c).par_iter().zip(table.valid_plane(c));
        plane.par_iter_mut().zip(entries).filter(|(_, (_, valid))| **valid).for_each(|(log, (value, _))| {
            *log = tone_map((*value * channel.scale).min(f64::MAX), eps);
        });
    }
    transform.forward(&mut planes, channels.len());
    planes
}

/// Flags the samples of every block of the partition, each drawn at its own ratio; `valid` and the flags are of one component.
pub(super) fn draw(partition: &Partition, seed: u64, sampling: &[Sampling], valid: &[bool]) -> Vec<bool> {
    let grid = partition.grid();
    let mut flags = vec![false; valid.len()];
    for (number, &sampling) in sampling.iter().enumerate() {
        let block = partition.block(number).expect("one sampling a block");
        let mut mask = vec![false; block.positions()];
        block.gather(grid, valid, &mut mask);
        let drawn = sample_positions(block_seed(seed, number as u32), sampling, &mask);
        mask.fill(false);
        drawn.iter().for_each(|&p| mask[p as usize] = true);
        block.scatter(grid, &mask, &mut flags);
    }
    flags
}

/// Recovers the table whose log values are `planes` from the samples that `sampling` draws, one entry a block.
pub(super) fn estimate(
    table: &BrdfTable,
    planes: &[f64],
    partition: &Partition,
    seed: u64,
    sampling: &[Sampling],
    recovery: Recovery,
    progress: &(dyn Fn(f64) + Sync),
) -> Estimate {
    let grid = partition.grid();
    let n = table.grid().positions();
    let components = table.grid().channels().len();
    let flags: Vec<Vec<bool>> =
        (0..components).into_par_iter().map(|c| draw(partition, seed, sampling, table.valid_plane(c))).collect();
    let samples: Vec<Samples> = flags
        .par_iter()
        .zip(planes.par_chunks_exact(n))
        .map(|(flags, plane)| {
            let positions: Vec<u32> = (0..n as u32).filter(|&p| flags[p as usize]).collect();
            let values = positions.iter().map(|&p| plane[p as usize]).collect();
            Samples { positions, values }
        })
        .collect();
    progress(0.05);

    let windows = Windows::new(grid);
    let model = Model::new(table.grid());
    let trends: Vec<Option<Trend>> = samples
        .par_iter()
        .map(|samples| model.as_ref().and_then(|model| choose_trend(model, samples, &windows, recovery)))
        .collect();
    progress(0.5);
    let mut base = match &model {
        Some(model) => model.evaluate(&trends),
        None => vec![0.0; planes.len()],
    };

    let mut cost = Solves::default();
    for ((samples, base), trend) in samples.iter().zip(base.chunks_exact_mut(n)).zip(&trends) {
        if trend.is_none() {
            // Where a window has no sample the mean of all is the best guess.
            let mean = samples.values.iter().sum::<f64>() / samples.values.len().max(1) as f64;
            base.fill(mean);
        }
        let mut residual = vec![f64::NAN; n];
        for (&p, value) in samples.positions.iter().zip(&samples.values) {
            residual[p as usize] = value - base[p as usize];
        }
        let solved: Vec<(Vec<f64>, Solves)> = (0..windows.count())
            .into_par_iter()
            .map_init(|| Recoverer::new(recovery), |recoverer, window| windows.solve(recoverer, window, &residual))
            .collect();
        for (window, (values, solves)) in solved.iter().enumerate() {
            cost += *solves;
            windows.add(window, values, base);
        }
        if recovery.sampling == Sampling::Every {
            // Every valid value is known better than the recovery has it.
            for (&p, value) in samples.positions.iter().zip(&samples.values) {
                base[p as usize] = *value;
            }
        }
    }
    progress(1.0);
    let count = |number: usize| {
        let block = partition.block(number).expect("one sampling a block");
        let mut mask = vec![false; block.positions()];
        let taken = |flags: &Vec<bool>| {
            block.gather(grid, flags, &mut mask);
            mask.iter().filter(|flag| **flag).count()
        };
        flags.iter().map(taken).sum()
    };
    Estimate { grid, planes: base, sampled: (0..partition.block_count()).map(count).collect(), cost }
}

/// The trend that tells samples held out best, together with the recovery of what it leaves.
fn choose_trend(model: &Model, samples: &Samples, windows: &Windows, recovery: Recovery) -> Option<Trend> {
    let part = |held_out: bool| Samples {
        positions: pick(&samples.positions, held_out),
        values: pick(&samples.values, held_out),
    };
    let (kept, held_out) = (part(false), part(true));
    if held_out.values.is_empty() {
        return None;
    }
    let n = windows.positions();
    let design = model.design(&kept.positions);
    let held_out_design = model.design(&held_out.positions);
    let trial = Recovery { iterations: recovery.iterations.min(TRIAL_ITERATIONS), ..recovery };
    let error = |trend: Option<&Trend>| -> f64 {
        let (mut known, mut wanted) = (kept.values.clone(), held_out.values.clone());
        match trend {
            Some(trend) => {
                design.subtract(model, &kept.positions, trend, &mut known);
                held_out_design.subtract(model, &held_out.positions, trend, &mut wanted);
            }
            None => {
                let mean = known.iter().sum::<f64>() / known.len() as f64;
                known.iter_mut().chain(&mut wanted).for_each(|v| *v -= mean);
            }
        }
        let mut residual = vec![f64::NAN; n];
        kept.positions.iter().zip(&known).for_each(|(&p, v)| residual[p as usize] = *v);
        let mut truth = vec![f64::NAN; n];
        held_out.positions.iter().zip(&wanted).for_each(|(&p, v)| truth[p as usize] = *v);
        let errors: Vec<f64> = (0..windows.count())
            .into_par_iter()
            .step_by(TRIAL_WINDOWS)
            .map_init(
                || Recoverer::new(trial),
                |recoverer, window| {
                    let (values, _) = windows.solve(recoverer, window, &residual);
                    windows.squared_error(window, &values, &truth)
                },
            )
            .collect();
        errors.iter().sum()
    };
    let mut best = None;
    let mut least = error(None);
    for stiffness in STIFFNESSES {
        let error = error(Some(&model.fit(&design, &kept.values, stiffness)));
        if error < least {
            (best, least) = (Some(stiffness), error);
        }
    }
    let design = model.design(&samples.positions);
    best.map(|stiffness| model.fit(&design, &samples.values, stiffness))
}

fn pick<T: Copy>(from: &[T], held_out: bool) -> Vec<T> {
    let chosen = |i: usize| (i % HELD_OUT == HELD_OUT - 1) == held_out;
    from.iter().enumerate().filter(|(i, _)| chosen(*i)).map(|(_, v)| *v).collect()
}
