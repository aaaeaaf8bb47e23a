//! From a block's log values to its coefficients: sampling and l1 recovery (spec sections 4.3 and 4.5).

use std::collections::HashMap;

use super::watch::Watcher;
use crate::codec::fourier::forward::Transform;
use crate::codec::fourier::{Basis, partners};
use crate::codec::sample::{Sampling, sample_positions};
use crate::encode::l1::norm::Norm;
use crate::encode::l1::sampled::{Columns, SampledBasis};
use crate::encode::l1::spgl1::{Options, Solver};
use crate::encode::quantised::Solves;
use crate::encode::settings::Encoder;
use crate::table::block::positions;

/// What the recovery of a block's component needs to know.
#[derive(Clone, Copy, Debug)]
pub(in crate::encode) struct Recovery {
    pub(in crate::encode) basis: Basis,
    pub(in crate::encode) sampling: Sampling,
    /// Bound on the rms residual at the samples, log domain.
    pub(in crate::encode) sigma_rms: f64,
    /// Most iterations of one solve.
    pub(in crate::encode) iterations: usize,
    /// Exponent p of the weights (1 + |k|)^p on the coefficients; 0 is the plain norm.
    pub(in crate::encode) weighting: f64,
}

impl Recovery {
    /// What settings say of it, with at most `iterations` in a solve.
    pub(in crate::encode) fn new(settings: &Encoder, iterations: usize) -> Recovery {
        let (basis, sampling, weighting) = (settings.basis, settings.base_sampling(), settings.weighting);
        Recovery { basis, sampling, sigma_rms: settings.sigma_rms(), iterations, weighting }
    }

    /// The norm to minimise over blocks of a shape.
    fn norm(&self, shape: [usize; 4]) -> Norm {
        // Half periods along a block: the index of a DCT, twice the frequency of a DFT.
        let half_periods = |j: usize| match self.basis {
            Basis::Dct => j as f64,
            Basis::Dft => (2 * j.div_ceil(2)) as f64,
        };
        let weight = |k: [usize; 4]| {
            let length = k.iter().map(|&j| half_periods(j).powi(2)).sum::<f64>().sqrt();
            (1.0 + length).powf(self.weighting)
        };
        let weights: Option<Vec<f64>> = (self.weighting != 0.0).then(|| positions(shape).map(weight).collect());
        let pairs = (self.basis == Basis::Dft).then(|| partners(shape));
        let n = shape.iter().product();
        Norm::new(n, weights.as_deref(), pairs.as_deref()).expect("weights of 1 and up, equal for partners")
    }
}

/// What solves over blocks of a shape share.
struct Plan {
    transform: Transform,
    norm: Norm,
    columns: Columns,
}

/// The recovery with its plans by block shape; one a thread.
pub(in crate::encode) struct Recoverer {
    recovery: Recovery,
    plans: HashMap<[usize; 4], Plan>,
    solver: Solver,
    /// Solves in the plain solver's place, if there.
    pub(in crate::encode) watcher: Option<Watcher>,
}

impl Recoverer {
    pub(in crate::encode) fn new(recovery: Recovery) -> Recoverer {
        Recoverer { recovery, plans: HashMap::new(), solver: Solver::default(), watcher: None }
    }

    fn plan(&mut self, shape: [usize; 4]) -> &mut Plan {
        let recovery = self.recovery;
        self.plans.entry(shape).or_insert_with(|| Plan {
            transform: Transform::new(recovery.basis, shape),
            norm: recovery.norm(shape),
            columns: Columns::new(recovery.basis, shape),
        })
    }

    /// Block values to coefficients, in place.
    pub(in crate::encode) fn analyze(&mut self, shape: [usize; 4], values: &mut [f64]) {
        self.plan(shape).transform.analyze(values);
    }

    /// Replaces log values by coefficients. `valid` flags the values that may be looked at; the others are holes.
    /// Gives the number of samples.
    pub(in crate::encode) fn recover(
        &mut self,
        shape: [usize; 4],
        seed: u64,
        values: &mut [f64],
        valid: &[bool],
        cost: &mut Solves,
    ) -> usize {
        let positions = sample_positions(seed, self.recovery.sampling, valid);
        if positions.len() == values.len() {
            // All of an orthonormal transform's values are known: the coefficients follow without a solve.
            self.analyze(shape, values);
        } else if self.recovery.sampling == Sampling::Every && !positions.is_empty() {
            // Every valid value is known better than the recovery has it: it supplies the holes alone.
            let samples: Vec<f64> = positions.iter().map(|&p| values[p as usize]).collect();
            let filled = self.fill(shape, &positions, &samples, cost);
            for ((value, &valid), fill) in values.iter_mut().zip(valid).zip(&filled) {
                if !valid {
                    *value = *fill;
                }
            }
            self.analyze(shape, values);
        } else {
            let samples: Vec<f64> = positions.iter().map(|&p| values[p as usize]).collect();
            let coefficients = self.solve(shape, &positions, &samples, cost);
            values.copy_from_slice(&coefficients);
        }
        positions.len()
    }

    /// All values of a block from its samples.
    pub(in crate::encode) fn fill(
        &mut self,
        shape: [usize; 4],
        positions: &[u32],
        samples: &[f64],
        cost: &mut Solves,
    ) -> Vec<f64> {
        let mut values = self.solve(shape, positions, samples, cost);
        self.plan(shape).transform.synthesize(&mut values);
        values
    }

    /// The coefficients of a block from its samples; zeros without any.
    fn solve(&mut self, shape: [usize; 4], positions: &[u32], samples: &[f64], cost: &mut Solves) -> Vec<f64> {
        let n: usize = shape.iter().product();
        if samples.is_empty() {
            return vec![0.0; n];
        }
        // The mean is no sparse feature: taken out, so that the norm does not pull it to zero.
        let mean = samples.iter().sum::<f64>() / samples.len() as f64;
        let centred: Vec<f64> = samples.iter().map(|sample| sample - mean).collect();
        let Recovery { iterations, sigma_rms, .. } = self.recovery;
        let sigma = sigma_rms * (samples.len() as f64).sqrt();
        // A point that reaches sigma with a norm near the least will do: proving its norm minimal takes up to twice the
        // steps and changes sizes and errors by less than 0.5 %.
        let gap_tolerance = f64::INFINITY;
        let options = Options { max_iterations: iterations, gap_tolerance, ..Options::default() };
        let (mut solver, mut watcher) = (std::mem::take(&mut self.solver), self.watcher.take());
        let Plan { transform, norm, columns } = self.plan(shape);
        let mut operator = SampledBasis::new(transform, vec![positions]).with_columns(columns);
        let solution = match &mut watcher {
            None => solver.bpdn(&mut operator, &centred, sigma, norm, &options, None),
            Some(watcher) => watcher.bpdn(&mut operator, &centred, sigma, norm, &options),
        };
        (self.solver, self.watcher) = (solver, watcher);
        cost.solves += 1;
        let mut coefficients = match solution {
            Ok(solution) => {
                cost.iterations += solution.iterations;
                cost.missed += usize::from(!solution.reached_sigma(sigma));
                solution.coefficients
            }
            // Not reached with finite samples and sigma; a flat block is the safe answer all the same.
            Err(_) => {
                cost.missed += 1;
                vec![0.0; n]
            }
        };
        coefficients[0] += mean * (n as f64).sqrt();
        coefficients
    }
}
