//! SPGL1: basis pursuit, basis pursuit denoise and LASSO by spectral projected gradients and root finding on the
//! Pareto curve.
//!
//! Source: E. van den Berg, M. P. Friedlander, "Probing the Pareto frontier for basis pursuit solutions", SIAM J. Sci.
//! Comput. 31(2), 890-912, 2008. Differences from the published program are stated where they are made: the search
//! (`descent.rs`) never spends an extra transform, and every solution carries a proven duality gap.
//!
//! Samples are normalised to ||y|| = 1 inside, so results scale with the data from denormals to 1e300.

use super::Operator;
use super::norm::Norm;
pub use super::options::{Options, Stop};
use super::pareto::{self, Outcome, Search, TAU_LIMIT};
use super::splitting::Splitting;
use super::vector::{dot, max_abs, scale};
use crate::base::error::{Error, Result};
use std::time::Instant;

/// Smallest tolerance, over ||y||: what rounding leaves.
const PRECISION: f64 = 1e-13;

/// What a solver found, and what it cost. All numbers but `gap` and those of the costs have the unit of y.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Solution {
    /// Coefficients s, as many as the operator's columns; always finite.
    pub coefficients: Vec<f64>,
    /// ||y - A s||_2; infinite if y is not finite.
    pub residual_norm: f64,
    /// ||W s||_1
    pub norm: f64,
    /// Relative duality gap. BPDN: the norm is at most this fraction above the optimum; infinite where sigma was not
    /// reached. LASSO: the residual is at most this fraction above the optimum.
    pub gap: f64,
    /// Projected gradient steps.
    pub iterations: usize,
    /// Forward and adjoint transforms.
    pub transforms: usize,
    /// Wall-clock time. Nothing depends on it.
    pub seconds: f64,
    /// Why the solver stopped.
    pub stop: Stop,
    /// The amount by which a residual may exceed sigma, from [`Options`].
    pub tolerance: f64,
}

impl Solution {
    /// Whether the residual is sigma or less, within the tolerance of the solve.
    pub fn reached_sigma(&self, sigma: f64) -> bool {
        self.residual_norm <= sigma + self.tolerance
    }
}

/// Basis pursuit denoise: min ||W s||_1 subject to ||y - A s||_2 <= `sigma`; basis pursuit at `sigma` = 0.
///
/// `y` holds one sample a row of `op`, `sigma` >= 0 has its unit. Of all points visited the one that reaches sigma
/// with the smallest norm is returned, before one does the one with the smallest residual: more iterations never
/// give a worse result.
///
/// # Errors
/// `InvalidArgument` for a negative or NaN sigma, options out of range, or sizes of `y`, `norm` and `op` that differ.
/// Failures of the numbers are no errors: see [`Solution::stop`].
///
/// ```
/// use csbrdf::encode::l1::{Operator, norm::Norm, spgl1};
/// struct Identity;
/// impl Operator for Identity {
///     fn rows(&self) -> usize {
///         3
///     }
///     fn cols(&self) -> usize {
///         3
///     }
///     fn forward(&mut self, s: &[f64], y: &mut [f64]) {
///         y.copy_from_slice(s);
///     }
///     fn adjoint(&mut self, y: &[f64], s: &mut [f64]) {
///         s.copy_from_slice(y);
///     }
/// }
/// let y = [5.0, 1.0, -3.0];
/// let solution = spgl1::bpdn(&mut Identity, &y, 2.0, &Norm::l1(3), &spgl1::Options::default())?;
/// assert!(solution.reached_sigma(2.0) && solution.norm < 6.0);
/// # Ok::<(), csbrdf::base::error::Error>(())
/// ```
pub fn bpdn<O: Operator + ?Sized>(
    op: &mut O,
    y: &[f64],
    sigma: f64,
    norm: &Norm,
    options: &Options,
) -> Result<Solution> {
    Solver::default().bpdn(op, y, sigma, norm, options, None)
}

/// [`bpdn`] from the coefficients `start` instead of zero, for instance the solution at another sigma.
///
/// # Errors
/// As [`bpdn`], and where `start` has not one finite entry a column.
pub fn bpdn_from<O: Operator + ?Sized>(
    op: &mut O,
    y: &[f64],
    sigma: f64,
    norm: &Norm,
    options: &Options,
    start: &[f64],
) -> Result<Solution> {
    Solver::default().bpdn(op, y, sigma, norm, options, Some(start))
}

/// LASSO: min ||y - A s||_2 subject to ||W s||_1 <= `tau`, `tau` >= 0 in the unit of y. The point of smallest residual
/// is returned.
///
/// # Errors
/// As [`bpdn`], for tau.
pub fn lasso<O: Operator + ?Sized>(
    op: &mut O,
    y: &[f64],
    tau: f64,
    norm: &Norm,
    options: &Options,
) -> Result<Solution> {
    Solver::default().lasso(op, y, tau, norm, options)
}

/// The solver with its buffers, for many solves: but for the coefficients returned, nothing is allocated again while
/// sizes stay the same. Results do not depend on what was solved before.
#[derive(Debug, Default)]
pub struct Solver {
    search: Search,
    splitting: Splitting,
    /// y / ||y||
    unit: Vec<f64>,
    /// The start, over ||y||.
    start: Vec<f64>,
}

impl Solver {
    /// [`bpdn`], or [`bpdn_from`] where there is a start.
    ///
    /// # Errors
    /// As those.
    pub fn bpdn<O: Operator + ?Sized>(
        &mut self,
        op: &mut O,
        y: &[f64],
        sigma: f64,
        norm: &Norm,
        options: &Options,
        start: Option<&[f64]>,
    ) -> Result<Solution> {
        check(op, y, norm, options)?;
        if sigma.is_nan() || sigma < 0.0 {
            return invalid(format!("sigma is {sigma}; it must be 0 or more"));
        }
        if start.is_some_and(|s| s.len() != norm.cols() || !max_abs(s).is_finite()) {
            return invalid(format!("the start needs {} finite coefficients", norm.cols()));
        }
        let problem = Problem::new(y, norm, &mut self.unit);
        if !problem.length.is_finite() {
            return Ok(problem.zero(Stop::NotFinite, 0.0));
        }
        if sigma >= problem.length {
            return Ok(problem.zero(Stop::ZeroIsFeasible, 0.0));
        }
        let (sigma_of_y, sigma) = (sigma, sigma / problem.length);
        let tolerance = if sigma > 0.0 { options.sigma_tolerance * sigma } else { options.bp_tolerance };
        let tolerance = tolerance.max(PRECISION);
        self.start.clear();
        self.start.extend(start.unwrap_or_default().iter().map(|v| v / problem.length));
        // A start that overflows in units of the data says nothing about them.
        let start = (start.is_some() && max_abs(&self.start) < TAU_LIMIT)
            .then(|| (self.start.as_slice(), norm.primal(&self.start)));
        let groups = norm.packing();
        let mut options = *options;
        let mut first = None;
        if options.gap_tolerance == f64::INFINITY && start.is_none() && Splitting::pays(op, groups) {
            let most = options.max_iterations;
            first = self.splitting.bpdn(op, &self.unit, (sigma, tolerance), groups, most);
        }
        let first = match first {
            Some(found) if found.stop == Stop::Converged || found.iterations >= options.max_iterations => {
                return Ok(problem.finish(found, &self.splitting.best, tolerance));
            }
            first => first.map(|found| problem.finish(found, &self.splitting.best, tolerance)),
        };
        options.max_iterations -= first.as_ref().map_or(0, |found| found.iterations);
        let search = &mut self.search;
        let outcome = pareto::bpdn(search, op, &self.unit, (sigma, tolerance), groups, &options, start);
        let mut second = problem.finish(outcome, &self.search.best, tolerance);
        let Some(first) = first else {
            return Ok(second);
        };
        let iterations = first.iterations + second.iterations;
        let transforms = first.transforms + second.transforms;
        if first.norm < second.norm || second.residual_norm > first.residual_norm.max(sigma_of_y + second.tolerance) {
            second = Solution { seconds: second.seconds, ..first };
        }
        Ok(Solution { iterations, transforms, ..second })
    }

    /// [`lasso`].
    ///
    /// # Errors
    /// As that.
    pub fn lasso<O: Operator + ?Sized>(
        &mut self,
        op: &mut O,
        y: &[f64],
        tau: f64,
        norm: &Norm,
        options: &Options,
    ) -> Result<Solution> {
        check(op, y, norm, options)?;
        if tau.is_nan() || tau < 0.0 {
            return invalid(format!("tau is {tau}; it must be 0 or more"));
        }
        let problem = Problem::new(y, norm, &mut self.unit);
        if !problem.length.is_finite() {
            return Ok(problem.zero(Stop::NotFinite, 0.0));
        }
        let tolerance = options.bp_tolerance;
        if tau == 0.0 || problem.length == 0.0 {
            return Ok(problem.zero(Stop::ZeroIsFeasible, tolerance * problem.length));
        }
        let tau = (tau / problem.length).clamp(f64::MIN_POSITIVE, TAU_LIMIT);
        let (search, groups) = (&mut self.search, norm.packing());
        let outcome = pareto::lasso(search, op, &self.unit, tau, tolerance, groups, options);
        Ok(problem.finish(outcome, &self.search.best, tolerance))
    }
}

/// The samples as a direction and a length.
struct Problem<'a> {
    norm: &'a Norm,
    /// ||y||; infinite or NaN if y is not finite or its norm overflows.
    length: f64,
    begin: Instant,
}

impl<'a> Problem<'a> {
    /// Sets `unit` to y / ||y||.
    fn new(y: &[f64], norm: &'a Norm, unit: &mut Vec<f64>) -> Self {
        let begin = Instant::now();
        let length = normalize(y, unit);
        Problem { norm, length, begin }
    }

    /// The zero solution.
    fn zero(&self, stop: Stop, tolerance: f64) -> Solution {
        let (residual_norm, gap) =
            if stop == Stop::NotFinite { (f64::INFINITY, f64::INFINITY) } else { (self.length, 0.0) };
        Solution {
            coefficients: vec![0.0; self.norm.cols()],
            residual_norm,
            norm: 0.0,
            gap,
            iterations: 0,
            transforms: 0,
            seconds: self.begin.elapsed().as_secs_f64(),
            stop,
            tolerance,
        }
    }

    /// The outcome in the unit of y.
    fn finish(&self, outcome: Outcome, best: &[f64], tolerance: f64) -> Solution {
        let mut coefficients = vec![0.0; self.norm.cols()];
        self.norm.packing().unpack(best, &mut coefficients);
        scale(&mut coefficients, self.length);
        let norm = self.norm.primal(&coefficients);
        let (iterations, transforms) = (outcome.iterations, outcome.transforms);
        if !max_abs(&coefficients).is_finite() || !norm.is_finite() {
            return Solution { iterations, transforms, ..self.zero(Stop::NotFinite, 0.0) };
        }
        Solution {
            coefficients,
            residual_norm: outcome.residual * self.length,
            norm,
            gap: outcome.gap,
            iterations,
            transforms,
            seconds: self.begin.elapsed().as_secs_f64(),
            stop: outcome.stop,
            tolerance: tolerance * self.length,
        }
    }
}

/// Sets `unit` to y / ||y||, or to y where that is zero or not finite, and returns ||y||.
pub(super) fn normalize(y: &[f64], unit: &mut Vec<f64>) -> f64 {
    unit.clear();
    unit.extend_from_slice(y);
    let largest = max_abs(y);
    if !(largest > 0.0 && largest.is_finite()) {
        return largest;
    }
    // In two steps: neither squares nor the reciprocal of a denormal may overflow.
    unit.iter_mut().for_each(|v| *v /= largest);
    let relative = dot(unit, unit).sqrt();
    unit.iter_mut().for_each(|v| *v /= relative);
    largest * relative
}

fn check<O: Operator + ?Sized>(op: &O, y: &[f64], norm: &Norm, options: &Options) -> Result<()> {
    if y.len() != op.rows() {
        return invalid(format!("{} samples for an operator of {} rows", y.len(), op.rows()));
    }
    if norm.cols() != op.cols() {
        return invalid(format!("a norm of {} coefficients for an operator of {} columns", norm.cols(), op.cols()));
    }
    let Options { sigma_tolerance, bp_tolerance, gap_tolerance, .. } = *options;
    if !(sigma_tolerance >= 0.0 && bp_tolerance > 0.0 && gap_tolerance > 0.0) {
        return invalid(format!(
            "tolerances must be positive: sigma {sigma_tolerance}, bp {bp_tolerance}, gap {gap_tolerance}"
        ));
    }
    Ok(())
}

pub(super) fn invalid<T>(what: String) -> Result<T> {
    Err(Error::InvalidArgument(what))
}
