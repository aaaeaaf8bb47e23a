//! All values of a table from its samples: trend, then l1 recovery of what is left, window by window (encoder only).
//!
//! The windows need not be the blocks of the file: longer ones hold more samples each, and the blocks may be as small as
//! single values are to be had cheaply. Measured at 5 %, log rms with windows 15x15x15, 15x15x60, 15x15x180, and 15x15x180
//! with margins of 5: alum-bronze .022, .018, .019, .018; RGL golden yellow .071, .058, .057, .056, where the margins cost
//! five times the time.

mod windows;

use rayon::prelude::*;

use super::recover::{Recoverer, Recovery};
use super::trend::{Model, Trend, one_of};
use crate::codec::channel::ChannelTransform;
use crate::codec::sample::{Sampling, block_seed, sample_positions};
use crate::encode::gather::entry_log;
use crate::encode::progress::Progress;
use crate::encode::quantised::Solves;
use crate::table::Table;
use crate::table::block::{Block, Partition};
use windows::Windows;

/// Trends to choose from, by their stiffness; none is a choice as well.
///
/// Chosen on samples held out, at 1 %: 0.2 for green-fabric and alum-bronze gains 6 % over 1, 5 for golden yellow 3 %.
const STIFFNESSES: [f64; 3] = [0.2, 1.0, 5.0];

/// Every fifth sample is held out for the choice.
const HELD_OUT: usize = 5;

/// The choice is made on every third window, with short solves.
const TRIAL_WINDOWS: usize = 3;
const TRIAL_ITERATIONS: usize = 50;

/// What became of a table.
pub(in crate::encode) struct Estimate {
    grid: [usize; 4],
    /// ln(f + eps) after the channel transform, everywhere: `[component][position]`.
    planes: Vec<f64>,
    /// Samples that each block took, all components.
    pub(in crate::encode) sampled: Vec<usize>,
    /// Doublings of the file's sampling ratio, one a block.
    pub(in crate::encode) doublings: Vec<u8>,
    pub(in crate::encode) cost: Solves,
}

impl Estimate {
    /// The values of a block, `[component][position]`.
    pub(in crate::encode) fn gather(&self, block: &Block, values: &mut [f64]) {
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
pub(in crate::encode) fn log_planes(table: &Table, transform: &ChannelTransform, eps: f64) -> Vec<f64> {
    let channels = table.grid().channels();
    let n = table.grid().positions();
    let mut planes = vec![0.0; n * channels.len()];
    for ((c, channel), plane) in channels.iter().enumerate().zip(planes.chunks_exact_mut(n)) {
        let entries = table.plane(c).par_iter().zip(table.valid_plane(c));
        plane.par_iter_mut().zip(entries).filter(|(_, (_, valid))| **valid).for_each(|(log, (value, _))| {
            *log = entry_log(*value, channel.scale, eps);
        });
    }
    transform.forward(&mut planes, channels.len());
    planes
}

/// Flags the samples of every block of the partition, each drawn at its own ratio; `valid` and the flags are of one component.
pub(in crate::encode) fn draw(partition: &Partition, seed: u64, sampling: &[Sampling], valid: &[bool]) -> Vec<bool> {
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

/// The recovery of a table, to be repeated as samples are added.
pub(in crate::encode) struct Estimator<'a> {
    table: &'a Table,
    planes: &'a [f64],
    partition: &'a Partition,
    seed: u64,
    recovery: Recovery,
    windows: Windows,
    model: Option<Model>,
    /// Which positions are samples, one list a component.
    flags: Vec<Vec<bool>>,
    /// What the trend says everywhere, or the mean of the samples.
    base: Vec<f64>,
    /// Values of the windows over the base, by component and window; `None` where samples came since.
    solved: Vec<Vec<Option<Vec<f64>>>>,
    cost: Solves,
}

/// How stiff a trend is.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::encode) enum Stiffness {
    /// What suits most tables.
    Usual,
    /// Of several, or no trend at all, what predicts samples held out best.
    HeldOut,
}

impl<'a> Estimator<'a> {
    /// `planes` are the table's log values after the channel transform; blocks of the partition are sampled.
    pub(in crate::encode) fn new(
        table: &'a Table,
        planes: &'a [f64],
        partition: &'a Partition,
        seed: u64,
        recovery: Recovery,
    ) -> Estimator<'a> {
        let windows = Windows::new(partition.grid());
        let components = table.grid().channels().len();
        Estimator {
            table,
            planes,
            partition,
            seed,
            recovery,
            model: Model::new(table.grid()),
            flags: vec![Vec::new(); components],
            base: Vec::new(),
            solved: vec![vec![None; windows.count()]; components],
            windows,
            cost: Solves::default(),
        }
    }

    /// Draws the samples anew, each block at its own ratio.
    pub(in crate::encode) fn draw(&mut self, sampling: &[Sampling]) {
        let (table, partition, seed, windows) = (self.table, self.partition, self.seed, &self.windows);
        self.flags.par_iter_mut().zip(&mut self.solved).enumerate().for_each(|(c, (flags, solved))| {
            let drawn = draw(partition, seed, sampling, table.valid_plane(c));
            for (window, solved) in solved.iter_mut().enumerate() {
                if flags.is_empty() || windows.differs(window, flags, &drawn) {
                    *solved = None;
                }
            }
            *flags = drawn;
        });
    }

    fn samples(&self) -> Vec<Samples> {
        let n = self.windows.positions();
        let component = |(flags, plane): (&Vec<bool>, &[f64])| {
            let positions: Vec<u32> = (0..n as u32).filter(|&p| flags[p as usize]).collect();
            let values = positions.iter().map(|&p| plane[p as usize]).collect();
            Samples { positions, values }
        };
        self.flags.par_iter().zip(self.planes.par_chunks_exact(n)).map(component).collect()
    }

    /// Fits the trend to the samples drawn.
    pub(in crate::encode) fn fit(&mut self, stiffness: Stiffness) {
        let samples = self.samples();
        let trends: Vec<Option<Trend>> = samples
            .par_iter()
            .map(|samples| {
                let model = self.model.as_ref()?;
                match stiffness {
                    Stiffness::Usual => Some(model.fit(&model.design(&samples.positions), &samples.values, 1.0)),
                    Stiffness::HeldOut => choose_trend(model, samples, &self.windows, self.recovery),
                }
            })
            .collect();
        let n = self.windows.positions();
        self.base = match &self.model {
            Some(model) => model.evaluate(&trends),
            None => vec![0.0; self.planes.len()],
        };
        for ((samples, base), _) in
            samples.iter().zip(self.base.chunks_exact_mut(n)).zip(&trends).filter(|(_, trend)| trend.is_none())
        {
            base.fill(samples.values.iter().sum::<f64>() / samples.values.len().max(1) as f64);
        }
        self.solved.iter_mut().flatten().for_each(|solved| *solved = None);
    }

    /// Recovers the windows that have new samples, or all after a fit. Gives the values everywhere.
    pub(in crate::encode) fn solve(&mut self, progress: Progress) -> Vec<f64> {
        let n = self.windows.positions();
        let mut planes = self.base.clone();
        let components = self.flags.len();
        for (c, base) in planes.chunks_exact_mut(n).enumerate() {
            let (flags, plane) = (&self.flags[c], &self.planes[c * n..(c + 1) * n]);
            let mut residual = vec![f64::NAN; n];
            for (i, residual) in residual.iter_mut().enumerate().filter(|(i, _)| flags[*i]) {
                *residual = plane[i] - base[i];
            }
            let (windows, recovery) = (&self.windows, self.recovery);
            let costs: Vec<Solves> = self.solved[c]
                .par_iter_mut()
                .enumerate()
                .filter(|(_, solved)| solved.is_none())
                .map_init(
                    || Recoverer::new(recovery),
                    |recoverer, (window, solved)| {
                        let (values, cost) = windows.solve(recoverer, window, &residual);
                        *solved = Some(values);
                        cost
                    },
                )
                .collect();
            costs.into_iter().for_each(|cost| self.cost += cost);
            for (window, values) in self.solved[c].iter().enumerate() {
                windows.add(window, values.as_ref().expect("solved above"), base);
            }
            progress.reach((c + 1) as f64 / components as f64);
        }
        planes
    }

    pub(in crate::encode) fn partition(&self) -> &Partition {
        self.partition
    }

    /// Rms error of an estimate over the samples of a block that `next` draws but that are not drawn yet, with a margin for
    /// how few they are: infinite if there are none, though the block holds valid entries, zero if it holds none.
    pub(in crate::encode) fn held_out_rms(&self, estimate: &[f64], number: usize, next: Sampling) -> f64 {
        let block = self.partition.block(number).expect("number is below the count");
        let (grid, n) = (self.partition.grid(), self.windows.positions());
        let seed = block_seed(self.seed, number as u32);
        let mut flags = vec![false; block.positions()];
        let (mut truth, mut guess) = (vec![0.0; flags.len()], vec![0.0; flags.len()]);
        let (mut squares, mut count, mut empty) = (0.0, 0, true);
        for (c, seen) in self.flags.iter().enumerate() {
            block.gather(grid, self.table.valid_plane(c), &mut flags);
            empty &= !flags.contains(&true);
            let drawn = sample_positions(seed, next, &flags);
            block.gather(grid, seen, &mut flags);
            block.gather(grid, &self.planes[c * n..(c + 1) * n], &mut truth);
            block.gather(grid, &estimate[c * n..(c + 1) * n], &mut guess);
            for p in drawn.into_iter().map(|p| p as usize).filter(|&p| !flags[p]) {
                squares += f64::powi(truth[p] - guess[p], 2);
                count += 1;
            }
        }
        match f64::from(count) {
            0.0 if empty => 0.0,
            0.0 => f64::INFINITY,
            count => (squares / count).sqrt() * (1.0 + count.sqrt().recip()),
        }
    }

    /// The values everywhere from what was drawn, and the samples of each block.
    pub(in crate::encode) fn finish(mut self, doublings: Vec<u8>, progress: Progress) -> Estimate {
        let mut planes = self.solve(progress);
        let (grid, n) = (self.partition.grid(), self.windows.positions());
        for (number, &doublings) in doublings.iter().enumerate() {
            if self.recovery.sampling.doubled(doublings) != Sampling::Every {
                continue;
            }
            // Every valid value is known better than the recovery has it.
            let block = self.partition.block(number).expect("one count of doublings a block");
            let (mut values, mut known) = (vec![0.0; block.positions()], vec![0.0; block.positions()]);
            let mut mask = vec![false; block.positions()];
            for (c, flags) in self.flags.iter().enumerate() {
                let plane = &mut planes[c * n..(c + 1) * n];
                block.gather(grid, plane, &mut values);
                block.gather(grid, &self.planes[c * n..(c + 1) * n], &mut known);
                block.gather(grid, flags, &mut mask);
                for ((value, known), _) in values.iter_mut().zip(&known).zip(&mask).filter(|(_, taken)| **taken) {
                    *value = *known;
                }
                block.scatter(grid, &values, plane);
            }
        }
        let count = |number: usize| {
            let block = self.partition.block(number).expect("number is below the count");
            let mut mask = vec![false; block.positions()];
            let taken = |flags: &Vec<bool>| {
                block.gather(grid, flags, &mut mask);
                mask.iter().filter(|flag| **flag).count()
            };
            self.flags.iter().map(taken).sum()
        };
        let sampled = (0..self.partition.block_count()).map(count).collect();
        Estimate { grid, planes, sampled, doublings, cost: self.cost }
    }
}

/// The trend that predicts samples held out best, together with the recovery of what it leaves.
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
    let stiffness = best?;
    // One design at a time: they are the largest that an encode holds.
    drop((design, held_out_design));
    Some(model.fit(&model.design(&samples.positions), &samples.values, stiffness))
}

fn pick<T: Copy>(from: &[T], held_out: bool) -> Vec<T> {
    let chosen = |i: usize| one_of(i, HELD_OUT) == held_out;
    from.iter().enumerate().filter(|(i, _)| chosen(*i)).map(|(_, v)| *v).collect()
}
