//! Spectral projected gradient for min 1/2 ||y - A s||^2 subject to ||W s||_1 <= tau (Birgin, Martinez, Raydan 2000).
//!
//! One step costs one forward and one adjoint transform, whatever the search does. The trial point is the projected
//! gradient step of Barzilai-Borwein length, as in the published spgl1's curvilinear search; it is taken if it lies
//! below the largest of the last objectives. If not, the search goes back along the segment to it (the published
//! fallback): A is linear, so the residual there is a blend of the two known ones and the objective an exact parabola,
//! whose minimiser needs no transform. Halving a curvilinear step would cost a transform a trial.

use super::Operator;
use super::ball::Projector;
use super::groups::Groups;
use super::vector::{distance_squared, dot, move_towards, subtract_from};

/// Fraction of the linear decrease that a step must achieve (Armijo).
const SUFFICIENT: f64 = 1e-4;

/// Objectives remembered by the non-monotone search. The published default is 3; at 20 the Barzilai-Borwein steps are
/// seldom cut and hard problems (sigma near 1e-3 ||y||) take a half to a fifth of the steps.
const HISTORY: usize = 20;

/// Bounds of the spectral step relative to the first one. Longer steps would lose digits in the projection, which
/// takes them back; shorter ones do not occur unless A is near singular.
const STEP_RANGE: f64 = 1e5;

/// What a step did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Moved {
    /// To a new point.
    Yes,
    /// Nowhere: no descent is left at working precision, the point solves the subproblem.
    Stationary,
    /// Nowhere: the operator returned NaN or infinity.
    NotFinite,
}

/// The iterate and what is known there. Coefficients are packed ([`Groups`]). Buffers are kept from solve to solve;
/// no step allocates.
#[derive(Debug, Default)]
pub(super) struct State {
    projector: Projector,
    /// The iterate s.
    pub(super) s: Vec<f64>,
    /// Residual y - A s.
    pub(super) r: Vec<f64>,
    /// A^T r: the negative gradient.
    pub(super) c: Vec<f64>,
    /// ||r||^2
    pub(super) rr: f64,
    /// ||c||^2
    pub(super) cc: f64,
    /// Dual norm of c.
    pub(super) dual: f64,
    trial_s: Vec<f64>,
    trial_r: Vec<f64>,
    /// Coefficients in the order of the operator.
    unpacked: Vec<f64>,
    /// Barzilai-Borwein step length.
    step: f64,
    first_step: f64,
    /// Threshold of the last projection over its step length: tends to ||A^T r||*.
    lambda: f64,
    /// The last values of ||r||^2, in a ring.
    history: [f64; HISTORY],
    newest: usize,
    /// Forward and adjoint transforms so far.
    pub(super) transforms: usize,
}

/// A problem and the state of its solution.
pub(super) struct Descent<'a, O: Operator + ?Sized> {
    op: &'a mut O,
    groups: &'a Groups,
    /// The samples, ||y|| = 1.
    y: &'a [f64],
    pub(super) at: &'a mut State,
}

impl<'a, O: Operator + ?Sized> Descent<'a, O> {
    /// Starts at s = 0.
    pub(super) fn new(op: &'a mut O, groups: &'a Groups, y: &'a [f64], at: &'a mut State) -> Self {
        let fill = |v: &mut Vec<f64>, n: usize| {
            v.clear();
            v.resize(n, 0.0);
        };
        [&mut at.s, &mut at.c, &mut at.trial_s].into_iter().for_each(|v| fill(v, groups.len()));
        fill(&mut at.unpacked, op.cols());
        fill(&mut at.trial_r, y.len());
        at.r.clear();
        at.r.extend_from_slice(y);
        at.rr = dot(y, y);
        (at.step, at.first_step, at.lambda) = (1.0, 1.0, 0.0);
        at.history = [at.rr; HISTORY];
        at.transforms = 0;
        let mut descent = Descent { op, groups, y, at };
        descent.gradient();
        // At most 1 / ||A||^2; exactly that for orthonormal rows.
        let first = descent.at.rr / descent.at.cc;
        if first.is_finite() && first > 0.0 {
            (descent.at.step, descent.at.first_step) = (first, first);
        }
        descent
    }

    /// Moves to the projection of `start`, in the order of the operator, onto the ball of radius `tau`.
    pub(super) fn restart(&mut self, start: &[f64], tau: f64) {
        self.groups.pack(start, &mut self.at.s);
        self.shrink(tau);
    }

    /// Projects the iterate onto the ball of radius `tau`, which may be smaller than before, and forgets the search's
    /// history.
    pub(super) fn shrink(&mut self, tau: f64) {
        self.at.projector.project(self.groups, &mut self.at.s, tau);
        let at = &mut *self.at;
        self.groups.unpack(&at.s, &mut at.unpacked);
        self.op.forward(&at.unpacked, &mut at.r);
        subtract_from(self.y, &mut at.r);
        at.transforms += 1;
        at.rr = dot(&at.r, &at.r);
        at.history = [at.rr; HISTORY];
        self.gradient();
    }

    /// One step within the ball of radius `tau`, which must hold the iterate.
    pub(super) fn step(&mut self, tau: f64) -> Moved {
        let at = &mut *self.at;
        let taken = at.projector.step(self.groups, (&at.s, at.step, &at.c), tau, at.lambda, &mut at.trial_s);
        at.lambda = taken.lambda;
        if !(taken.slope.is_finite() && at.rr.is_finite()) {
            return Moved::NotFinite;
        }
        if taken.slope <= f64::EPSILON * at.rr {
            return Moved::Stationary;
        }

        self.groups.unpack(&at.trial_s, &mut at.unpacked);
        self.op.forward(&at.unpacked, &mut at.trial_r);
        subtract_from(self.y, &mut at.trial_r);
        at.transforms += 1;
        let trial_rr = dot(&at.trial_r, &at.trial_r);
        let curvature = distance_squared(&at.trial_r, &at.r);
        if !(trial_rr.is_finite() && curvature.is_finite()) {
            return Moved::NotFinite;
        }
        let ceiling = at.history.iter().fold(0.0, |a: f64, &b| a.max(b));
        if trial_rr <= ceiling - 2.0 * SUFFICIENT * taken.slope {
            std::mem::swap(&mut at.s, &mut at.trial_s);
            std::mem::swap(&mut at.r, &mut at.trial_r);
            at.rr = trial_rr;
        } else {
            let fraction = (taken.slope / curvature).min(1.0);
            move_towards(&mut at.s, &at.trial_s, fraction);
            move_towards(&mut at.r, &at.trial_r, fraction);
            at.rr = dot(&at.r, &at.r);
        }
        let (shortest, longest) = (at.first_step / STEP_RANGE, at.first_step * STEP_RANGE);
        at.step = if curvature > 0.0 { (taken.length_squared / curvature).clamp(shortest, longest) } else { longest };
        at.newest = (at.newest + 1) % HISTORY;
        at.history[at.newest] = at.rr;
        self.gradient();
        Moved::Yes
    }

    fn gradient(&mut self) {
        let at = &mut *self.at;
        self.op.adjoint(&at.r, &mut at.unpacked);
        self.groups.pack(&at.unpacked, &mut at.c);
        at.transforms += 1;
        (at.dual, at.cc) = self.groups.dual_and_square(&at.c);
    }
}
