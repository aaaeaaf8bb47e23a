//! From a block's log values to its coefficients: sampling and l1 recovery (spec sections 4.3 and 4.5).

use std::collections::HashMap;

use super::trace::Tracer;
use crate::block::positions;
use crate::fourier::forward::Transform;
use crate::fourier::{Basis, partners};
use crate::sample::{Sampling, sample_positions};
use crate::solve::norm::Norm;
use crate::solve::sampled::SampledBasis;
use crate::solve::spgl1::{self, Options};

/// What the recovery of a block's component needs to know.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recovery {
    pub(super) basis: Basis,
    pub(super) sampling: Sampling,
    /// Bound on the rms residual at the samples, log domain.
    pub(super) sigma_rms: f64,
    /// Most iterations of one solve.
    pub(super) iterations: usize,
    /// Exponent p of the weights (1 + |k|)^p on the coefficients; 0 is the plain norm.
    pub(super) weighting: f64,
}

impl Recovery {
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

/// Cost and outcome of the solves of a block.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Solves {
    pub(super) solves: usize,
    pub(super) iterations: usize,
    /// Solves that ended above their sigma.
    pub(super) missed: usize,
}

/// The recovery with its plans and norms by block shape; one a thread.
pub(super) struct Recoverer {
    recovery: Recovery,
    plans: HashMap<[usize; 4], (Transform, Norm)>,
    /// Solves in the plain solver's place, if there.
    pub(super) tracer: Option<Tracer>,
}

impl Recoverer {
    pub(super) fn new(recovery: Recovery) -> Recoverer {
        Recoverer { recovery, plans: HashMap::new(), tracer: None }
    }

    /// Replaces log values by coefficients. `valid` flags the values that may be looked at; the others are holes.
    /// Gives the number of samples.
    pub(super) fn recover(
        &mut self,
        shape: [usize; 4],
        seed: u64,
        values: &mut [f64],
        valid: &[bool],
        cost: &mut Solves,
    ) -> usize {
        let recovery = self.recovery;
        let (transform, norm) =
            self.plans.entry(shape).or_insert_with(|| (Transform::new(recovery.basis, shape), recovery.norm(shape)));
        let positions = sample_positions(seed, recovery.sampling, valid);
        if positions.len() == values.len() {
            // All of an orthonormal transform's values are known: the coefficients follow without a solve.
            transform.analyze(values);
            return positions.len();
        }
        if positions.is_empty() {
            values.fill(0.0);
            return 0;
        }
        // The mean is no sparse feature: taken out, so that the norm does not pull it to zero.
        let mut samples: Vec<f64> = positions.iter().map(|&p| values[p as usize]).collect();
        let mean = samples.iter().sum::<f64>() / samples.len() as f64;
        samples.iter_mut().for_each(|s| *s -= mean);
        let mut operator = SampledBasis::new(transform, vec![&positions]);
        let sigma = recovery.sigma_rms * (samples.len() as f64).sqrt();
        // The first point that reaches sigma will do: proving its norm minimal takes up to twice the steps and
        // changes sizes and errors by less than 0.3 %.
        let gap_tolerance = f64::INFINITY;
        let options = Options { max_iterations: recovery.iterations, gap_tolerance, ..Options::default() };
        let solution = match &mut self.tracer {
            None => spgl1::bpdn(&mut operator, &samples, sigma, norm, &options),
            Some(tracer) => tracer.bpdn(&mut operator, &samples, sigma, norm, &options),
        };
        cost.solves += 1;
        match solution {
            Ok(solution) => {
                cost.iterations += solution.iterations;
                cost.missed += usize::from(!solution.reached_sigma(sigma));
                if recovery.sampling == Sampling::Every {
                    // Every valid value is known better than the recovery has it: it supplies the holes alone.
                    let mut filled = solution.coefficients;
                    transform.synthesize(&mut filled);
                    for ((value, &valid), fill) in values.iter_mut().zip(valid).zip(&filled) {
                        if !valid {
                            *value = fill + mean;
                        }
                    }
                    transform.analyze(values);
                } else {
                    values.copy_from_slice(&solution.coefficients);
                    values[0] += mean * (values.len() as f64).sqrt();
                }
            }
            // Not reached with finite samples and sigma; a flat block is the safe answer all the same.
            Err(_) => {
                cost.missed += 1;
                values.fill(0.0);
                values[0] = mean * (values.len() as f64).sqrt();
            }
        }
        positions.len()
    }
}
