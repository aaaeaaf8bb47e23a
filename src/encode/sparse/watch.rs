//! How the l1 solves of a block go: residual and duality gap against iterations and seconds.

use std::time::{Duration, Instant};

use crate::base::error::Result;
use crate::encode::l1::norm::Norm;
use crate::encode::l1::spgl1::{self, Options, Solution};
use crate::encode::l1::{Iterate, Operator};

/// How far to follow a solve: beyond the encoder, which stops at the first point that reaches sigma.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Most iterations; those of the encoder if they are more.
    pub iterations: usize,
    /// Relative duality gap that ends a solve, above 0.
    pub gap: f64,
}

/// One solve.
#[derive(Clone, Debug, PartialEq)]
pub struct SolverLog {
    /// Samples y.
    pub samples: usize,
    /// Coefficients s.
    pub coefficients: usize,
    /// Bound on the rms residual, log domain.
    pub sigma: f64,
    /// Iterations after which sigma is first reached, or the encoder's limit of them.
    pub reached: usize,
    /// The start and every iterate.
    pub steps: Vec<Step>,
}

/// An iterate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Iterations so far.
    pub iterations: usize,
    /// Forward and adjoint transforms so far.
    pub transforms: usize,
    /// Wall seconds so far, one thread, without those of the log.
    pub seconds: f64,
    /// Rms residual at the samples, log domain.
    pub residual: f64,
    /// Relative duality gap, the best so far: (upper - lower) / upper.
    ///
    /// Every residual r bounds the least norm from below (`solve::pareto`). From above it is bounded by the norm of
    /// the point s + (1 - sigma / ||r||) A^T r, whose residual is sigma because the rows of A are orthonormal.
    pub gap: f64,
}

/// Solves and keeps how it went.
pub(in crate::encode) struct Watcher {
    limits: Limits,
    pub(in crate::encode) logs: Vec<SolverLog>,
}

impl Watcher {
    pub(in crate::encode) fn new(limits: Limits) -> Watcher {
        Watcher { limits, logs: Vec::new() }
    }

    /// As [`spgl1::bpdn`], to the limits of the log. It is SPGL1's descent that is followed, also where an encode would
    /// take the splitting, which keeps no iterate whose residual is known without another transform.
    pub(in crate::encode) fn bpdn<O: Operator>(
        &mut self,
        op: &mut O,
        y: &[f64],
        sigma: f64,
        norm: &Norm,
        options: &Options,
    ) -> Result<Solution> {
        let further = Options {
            max_iterations: self.limits.iterations.max(options.max_iterations),
            gap_tolerance: self.limits.gap,
            ..*options
        };
        let length = y.iter().map(|v| v * v).sum::<f64>().sqrt();
        let mut watched = Watched {
            op,
            norm,
            unit: y.iter().map(|v| v / length).collect(),
            sigma: sigma / length,
            feasible: vec![0.0; norm.cols()],
            correlation: vec![0.0; norm.cols()],
            lower: 0.0,
            upper: f64::INFINITY,
            begin: Instant::now(),
            watching: Duration::ZERO,
            steps: Vec::new(),
        };
        let solution = spgl1::bpdn(&mut watched, y, sigma, norm, &further)?;
        let mut steps = watched.steps;
        let rms = (y.len() as f64).sqrt();
        steps.iter_mut().for_each(|step| step.residual *= length / rms);
        let enough = (sigma + solution.tolerance) / rms;
        let reached = steps.iter().position(|step| step.residual <= enough).unwrap_or(usize::MAX);
        self.logs.push(SolverLog {
            samples: y.len(),
            coefficients: norm.cols(),
            sigma: sigma / rms,
            reached: reached.min(options.max_iterations).min(solution.iterations),
            steps,
        });
        Ok(solution)
    }
}

/// An operator that keeps what it is shown.
struct Watched<'a, O> {
    op: &'a mut O,
    norm: &'a Norm,
    /// y / ||y||
    unit: Vec<f64>,
    /// sigma / ||y||
    sigma: f64,
    feasible: Vec<f64>,
    /// A^T r
    correlation: Vec<f64>,
    /// Best bounds of the least norm so far.
    lower: f64,
    upper: f64,
    begin: Instant,
    /// Time spent here.
    watching: Duration,
    /// With residuals relative to ||y||.
    steps: Vec<Step>,
}

impl<O: Operator> Operator for Watched<'_, O> {
    fn rows(&self) -> usize {
        self.op.rows()
    }

    fn cols(&self) -> usize {
        self.op.cols()
    }

    fn forward(&mut self, coefficients: &[f64], samples: &mut [f64]) {
        self.op.forward(coefficients, samples);
    }

    fn adjoint(&mut self, samples: &[f64], coefficients: &mut [f64]) {
        self.op.adjoint(samples, coefficients);
    }

    fn column(&mut self, index: usize, samples: &mut [f64]) -> bool {
        self.op.column(index, samples)
    }

    fn watch(&mut self, iterate: &Iterate) {
        let now = Instant::now();
        let seconds = (now - self.begin).saturating_sub(self.watching).as_secs_f64();
        let product = |a: &[f64]| a.iter().zip(iterate.residual).map(|(a, r)| a * r).sum::<f64>();
        let residual = product(iterate.residual).sqrt();
        // The solver may know it for some of the columns only.
        self.op.adjoint(iterate.residual, &mut self.correlation);
        let lower = (product(&self.unit) - self.sigma * residual) / self.norm.dual(&self.correlation);
        let factor = 1.0 - self.sigma / residual;
        iterate.coefficients(&mut self.feasible);
        self.feasible.iter_mut().zip(&self.correlation).for_each(|(f, c)| *f += factor * c);
        self.lower = self.lower.max(lower);
        self.upper = self.upper.min(self.norm.primal(&self.feasible));
        let gap = if self.upper > self.lower { (self.upper - self.lower) / self.upper } else { 0.0 };
        let Iterate { iterations, transforms, .. } = *iterate;
        self.steps.push(Step { iterations, transforms, seconds, residual, gap });
        self.watching += now.elapsed();
    }
}
