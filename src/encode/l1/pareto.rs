//! Root finding on the Pareto curve (van den Berg & Friedlander 2008, sections 2 and 3), on normalised samples.
//!
//! phi(tau) = min { ||y - A s|| : ||W s||_1 <= tau } is convex and decreasing, with slope -||A^T r||* / ||r||; the
//! BPDN solution is the point with phi(tau) = sigma. Newton's method runs on it while the subproblems are still being
//! solved. Every residual r, optimal or not, is a dual point and proves the bounds
//!
//!   ||W s||_1 >= (<y, r> - sigma ||r||) / ||A^T r||*   for every s with ||y - A s|| <= sigma,
//!   ||y - A s|| >= (<y, r> - tau ||A^T r||*) / ||r||   for every s with ||W s||_1 <= tau,
//!
//! so the best bound so far costs nothing, holds Newton's steps from below, and gives the duality gap.

use super::Operator;
use super::descent::{Descent, Moved, State};
use super::groups::Groups;
use super::options::{Options, Stop};
use super::vector::{dot, scale};

/// Newton steps follow when ||r||^2 changes by less than this fraction a step (spgl1's dec_tol) ...
const SETTLED: f64 = 3e-4;
/// ... or, within a factor 2 of sigma, by less than this fraction times |residual - sigma|.
const SETTLED_NEAR_ROOT: f64 = 1.0;
/// ||A^T r|| / ||r|| relative to its value at s = 0 below which r is orthogonal to the range of A.
const LEAST_SQUARES: f64 = 1e-7;
/// A subproblem over the working set counts as nearly solved over all groups if no dual magnitude outside is above the
/// largest one inside by more than this factor.
const VIOLATION: f64 = 1.02;
/// Fewest columns by which the working set may grow at a time.
const GROWTH: usize = 32;
/// Residuals this far below the tolerance mean that tau is past the root of a sigma near 0.
const PAST_ROOT: f64 = 0.1;
/// Smallest sigma for which solutions are scaled back to the residual sigma; below it the scale would round to 1.
const SCALABLE: f64 = 1e-6;
/// Largest tau: beyond all norms of solutions of normalised problems, and its products are finite.
pub(super) const TAU_LIMIT: f64 = 1e150;

/// Buffers of a solve, and its result: the best point, packed.
#[derive(Debug, Default)]
pub(super) struct Search {
    state: State,
    pub(super) best: Vec<f64>,
}

/// What is known of the best point, for samples of unit norm.
pub(super) struct Outcome {
    pub(super) residual: f64,
    pub(super) gap: f64,
    pub(super) iterations: usize,
    pub(super) transforms: usize,
    pub(super) stop: Stop,
}

/// The best point so far.
struct Best<'a> {
    s: &'a mut Vec<f64>,
    residual: f64,
    /// ||W s||_1, known only where sigma was reached; infinite before.
    norm: f64,
    /// Whether it is over the working set.
    restricted: bool,
}

impl<'a> Best<'a> {
    /// Zero.
    fn new(s: &'a mut Vec<f64>) -> Self {
        s.clear();
        Best { s, residual: 1.0, norm: f64::INFINITY, restricted: true }
    }

    fn take(&mut self, at: &State, factor: f64, residual: f64, norm: f64) {
        self.s.clear();
        self.s.extend_from_slice(&at.s);
        self.restricted = at.restricted;
        if factor != 1.0 {
            scale(self.s, factor);
        }
        (self.residual, self.norm) = (residual, norm);
    }
}

/// Basis pursuit denoise for ||y|| = 1 and 0 <= sigma < 1; `tolerance` is that of the residual. `start` is
/// a point, in the order of the operator, and its norm.
pub(super) fn bpdn<O: Operator + ?Sized>(
    search: &mut Search,
    op: &mut O,
    y: &[f64],
    (sigma, tolerance): (f64, f64),
    groups: &Groups,
    options: &Options,
    start: Option<(&[f64], f64)>,
) -> Outcome {
    // Long on purpose: one loop of the method, whose steps share the bounds, the best point and the working set.
    let Search { state, best } = search;
    let mut best = Best::new(best);
    let mut descent = Descent::new(op, groups, y, state);
    let (yy, first_cc) = (descent.at.rr, descent.at.cc);
    // Lower bound of the optimal norm.
    let mut lower = 0.0f64;
    let mut tau = 0.0f64;
    if let Some((start, start_norm)) = start {
        let start_norm = start_norm.min(TAU_LIMIT);
        let bound = (yy - sigma) / descent.at.dual;
        if bound > lower {
            lower = bound.min(TAU_LIMIT);
        }
        descent.restart(start, start_norm);
        tau = start_norm;
        if descent.at.rr.is_nan() || descent.at.rr >= yy {
            // Worse than nothing.
            tau = 0.0;
            descent.shrink(tau);
        }
    }
    let mut last_rr = descent.at.rr;
    let mut newton_last = false;
    let mut stationary = false;
    // Tau was past the root: from then on only the lower bound is awaited.
    let mut certifying = false;
    let mut iterations = 0;

    let stop = loop {
        let residual = descent.at.rr.sqrt();
        let cc = descent.at.cc;
        if !(cc.is_finite() && residual.is_finite()) {
            break Stop::NotFinite;
        }
        descent.show(iterations);
        let yr = dot(y, &descent.at.r);
        let excess = residual - sigma;
        if excess <= tolerance {
            let (factor, residual) = scale_to_sphere(yy, yr, descent.at.rr, sigma);
            let size = factor * descent.norm();
            if size < best.norm {
                best.take(descent.at, factor, residual, size);
            }
        } else if best.norm.is_infinite() && residual < best.residual {
            best.take(descent.at, 1.0, residual, f64::INFINITY);
        }
        let change = (descent.at.rr - last_rr).abs();
        let mut settled = if excess > sigma {
            change <= SETTLED * descent.at.rr
        } else {
            change <= SETTLED_NEAR_ROOT * descent.at.rr * excess.abs()
        };
        settled &= !newton_last && !certifying;

        // What the working set makes believe is checked against all groups before anything is decided.
        let is_flat = |cc: f64| cc <= (LEAST_SQUARES * residual).powi(2) * first_cc;
        let bound = |dual: f64| (yr - sigma * residual) / dual;
        let gap_of = |best: &Best, bound: f64| relative_gap(best.norm, bound.max(lower));
        let decides = best.norm.is_finite() && gap_of(&best, bound(descent.at.dual)) <= options.gap_tolerance;
        let mut missing = 1.0;
        if decides || settled || stationary || is_flat(cc) {
            missing = descent.complete(GROWTH.max(y.len() / 2));
            settled &= missing <= VIOLATION;
            stationary &= missing <= 1.0;
        }
        let dual = descent.at.dual;
        if descent.at.complete && bound(dual) > lower {
            lower = bound(dual).min(TAU_LIMIT);
        }
        if best.norm.is_finite() {
            let unproven = options.gap_tolerance == f64::INFINITY && missing > VIOLATION;
            if descent.at.complete && !unproven && relative_gap(best.norm, lower) <= options.gap_tolerance {
                break Stop::Converged;
            }
        } else if descent.at.complete && is_flat(descent.at.cc) {
            break Stop::LeastSquares;
        }
        if iterations >= options.max_iterations {
            break if best.norm.is_finite() { Stop::SigmaReached } else { Stop::IterationLimit };
        }

        // Newton's step for tau, as soon as the subproblem is nearly solved, at most every second iteration.
        let mut target = tau.max(lower);
        newton_last = !certifying && (stationary || settled);
        if newton_last {
            target = (tau + residual * excess / dual).max(lower).min(TAU_LIMIT);
        }
        if excess <= tolerance && residual <= PAST_ROOT * tolerance {
            target = lower.max((1.0 - 0.5 * options.gap_tolerance).max(0.5) * best.norm);
            certifying = true;
        }
        if stationary && (target - tau).abs() <= 4.0 * f64::EPSILON * tau {
            break if best.norm.is_finite() { Stop::SigmaReached } else { Stop::LineSearchFailed };
        }
        let shrinks = target < tau;
        tau = target;
        if shrinks {
            descent.shrink(tau);
        }

        last_rr = descent.at.rr;
        stationary = match descent.step(tau) {
            Moved::Yes => false,
            Moved::Stationary => true,
            Moved::NotFinite => break Stop::NotFinite,
        };
        iterations += 1;
    };
    if best.restricted {
        descent.expand(best.s);
    }
    let gap = if best.norm.is_finite() { relative_gap(best.norm, lower) } else { f64::INFINITY };
    Outcome { residual: best.residual, gap, iterations, transforms: descent.at.transforms, stop }
}

/// LASSO for ||y|| = 1 and 0 < tau <= `TAU_LIMIT`; a residual up to `tolerance` counts as zero.
pub(super) fn lasso<O: Operator + ?Sized>(
    search: &mut Search,
    op: &mut O,
    y: &[f64],
    tau: f64,
    tolerance: f64,
    groups: &Groups,
    options: &Options,
) -> Outcome {
    // As `bpdn`, for one tau.
    let Search { state, best } = search;
    let mut best = Best::new(best);
    let mut descent = Descent::new(op, groups, y, state);
    let first_cc = descent.at.cc;
    // Lower bound of the optimal residual.
    let mut lower = 0.0f64;
    let mut stationary = false;
    let mut iterations = 0;

    let stop = loop {
        let residual = descent.at.rr.sqrt();
        let cc = descent.at.cc;
        if !(cc.is_finite() && residual.is_finite()) {
            break Stop::NotFinite;
        }
        if residual < best.residual {
            best.take(descent.at, 1.0, residual, f64::INFINITY);
        }
        let yr = dot(y, &descent.at.r);
        let bound = |dual: f64| (yr - tau * dual) / residual;
        let is_flat = |cc: f64| cc <= (LEAST_SQUARES * residual).powi(2) * first_cc;
        let decides = best.residual - bound(descent.at.dual).max(lower) <= options.gap_tolerance * best.residual;
        if decides || stationary || is_flat(cc) {
            stationary &= descent.complete(GROWTH.max(y.len() / 2)) <= 1.0;
        }
        if descent.at.complete && bound(descent.at.dual) > lower {
            lower = bound(descent.at.dual);
        }
        if best.residual <= tolerance || best.residual - lower <= options.gap_tolerance * best.residual {
            break Stop::Converged;
        }
        if descent.at.complete && is_flat(descent.at.cc) {
            break Stop::LeastSquares;
        }
        if iterations >= options.max_iterations {
            break Stop::IterationLimit;
        }
        if stationary {
            break Stop::LineSearchFailed;
        }
        stationary = match descent.step(tau) {
            Moved::Yes => false,
            Moved::Stationary => true,
            Moved::NotFinite => break Stop::NotFinite,
        };
        iterations += 1;
    };
    if best.restricted {
        descent.expand(best.s);
    }
    let gap = relative_gap(best.residual, lower);
    Outcome { residual: best.residual, gap, iterations, transforms: descent.at.transforms, stop }
}

/// A point whose residual is below sigma may be scaled by a factor below 1 until its residual is sigma: its norm falls
/// by that factor. Returns the factor (1 if there is nothing to gain) and the residual there.
///
/// The residual of factor * s is y + factor (r - y), so this is a quadratic equation in known inner products.
fn scale_to_sphere(yy: f64, yr: f64, rr: f64, sigma: f64) -> (f64, f64) {
    if sigma < SCALABLE || rr >= sigma * sigma {
        return (1.0, rr.sqrt());
    }
    let (a, b, c) = (rr - 2.0 * yr + yy, yy - yr, yy - sigma * sigma);
    let factor = c / (b + (b * b - a * c).max(0.0).sqrt());
    if factor > 0.0 && factor < 1.0 { (factor, sigma) } else { (1.0, rr.sqrt()) }
}

/// How far `value` can be above its optimum, relative to `value`; at least 0.
pub(super) fn relative_gap(value: f64, lower: f64) -> f64 {
    if value > lower { (value - lower) / value } else { 0.0 }
}
