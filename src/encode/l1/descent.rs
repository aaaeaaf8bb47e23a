//! Spectral projected gradient for min 1/2 ||y - A s||^2 subject to ||W s||_1 <= tau (Birgin, Martinez, Raydan 2000).
//!
//! One step costs one forward and one adjoint transform, whatever the search does. The trial point is the projected
//! gradient step of Barzilai-Borwein length, as in the published spgl1's curvilinear search; it is taken if it lies
//! below the largest of the last objectives. If not, the search goes back along the segment to it (the published
//! fallback): A is linear, so the residual there is a blend of the two known ones and the objective an exact parabola,
//! whose minimiser needs no transform. Halving a curvilinear step would cost a transform a trial.

use super::ball::Projector;
use super::groups::Groups;
use super::vector::{distance_squared, dot, move_towards, subtract_from};
use super::working::Working;
use super::{Iterate, Operator};

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
    /// Coefficients in the order of the operator, and those packed over all groups.
    unpacked: Vec<f64>,
    packed: Vec<f64>,
    magnitudes: Vec<f64>,
    working: Working,
    /// Whether `s`, `c` and their kin are over the working set, not over all groups.
    pub(super) restricted: bool,
    /// Whether `dual` and `cc` are those over all groups.
    pub(super) complete: bool,
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
        at.restricted = at.working.start(op, groups);
        let entries = if at.restricted { 0 } else { groups.len() };
        [&mut at.s, &mut at.c, &mut at.trial_s].into_iter().for_each(|v| fill(v, entries));
        fill(&mut at.packed, groups.len());
        fill(&mut at.magnitudes, groups.slots());
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
        descent.complete(usize::MAX);
        // At most 1 / ||A||^2; exactly that for orthonormal rows.
        let first = descent.at.rr / descent.at.cc;
        if first.is_finite() && first > 0.0 {
            (descent.at.step, descent.at.first_step) = (first, first);
        }
        descent
    }

    /// Moves to the projection of `start`, in the order of the operator, onto the ball of radius `tau`.
    pub(super) fn restart(&mut self, start: &[f64], tau: f64) {
        let at = &mut *self.at;
        self.groups.pack(start, &mut at.packed);
        if at.restricted {
            at.working.cover(self.op, self.groups, &at.packed);
            at.fit();
            at.working.gather(&at.packed, &mut at.s);
            if at.working.too_wide() {
                self.leave_working_set();
            }
        } else {
            at.s.copy_from_slice(&at.packed);
        }
        self.shrink(tau);
    }

    /// Projects the iterate onto the ball of radius `tau`, which may be smaller than before, and forgets the search's
    /// history.
    pub(super) fn shrink(&mut self, tau: f64) {
        let at = &mut *self.at;
        let groups = if at.restricted { &at.working.groups } else { self.groups };
        at.projector.project(groups, &mut at.s, tau);
        at.swap();
        self.trial_residual();
        let at = &mut *self.at;
        at.swap();
        at.rr = dot(&at.r, &at.r);
        at.history = [at.rr; HISTORY];
        self.gradient();
    }

    /// ||W s||_1
    pub(super) fn norm(&self) -> f64 {
        let groups = if self.at.restricted { &self.at.working.groups } else { self.groups };
        groups.primal(&self.at.s)
    }

    /// The vector `set`, over the working set as it is or was before, over all groups.
    pub(super) fn expand(&mut self, set: &mut Vec<f64>) {
        self.at.working.scatter(set, &mut self.at.packed);
        set.clone_from(&self.at.packed);
    }

    /// Looks at all groups, and takes into the working set those whose dual magnitude is above all those inside, up to
    /// about `most` columns. `dual` and `cc` are those over all groups then. Returns the largest dual magnitude
    /// outside before, relative to the largest one inside: 1 or less where nothing was missing.
    pub(super) fn complete(&mut self, most: usize) -> f64 {
        let at = &mut *self.at;
        if at.complete {
            return 1.0;
        }
        self.op.adjoint(&at.r, &mut at.unpacked);
        at.transforms += 1;
        self.groups.pack(&at.unpacked, &mut at.packed);
        self.groups.magnitudes(&at.packed, &mut at.magnitudes);
        let inside = at.dual;
        (at.dual, at.cc) = self.groups.dual_and_square(&at.packed);
        at.complete = true;
        let empty = at.s.is_empty();
        // At the start, the columns that the first samples can determine.
        let most = if empty { at.r.len().max(32) } else { most };
        let outside = at.working.grow(self.op, self.groups, &at.magnitudes, inside, most);
        if outside > 0.0 {
            at.fit();
            at.working.gather(&at.packed, &mut at.c);
        }
        if at.working.too_wide() {
            self.leave_working_set();
        }
        if empty { 1.0 } else { outside / inside }
    }

    /// Goes on over all groups.
    fn leave_working_set(&mut self) {
        let at = &mut *self.at;
        at.working.scatter(&at.s, &mut at.packed);
        at.s.clone_from(&at.packed);
        at.restricted = false;
        at.trial_s.resize(at.s.len(), 0.0);
        at.c.resize(at.s.len(), 0.0);
        self.gradient();
    }

    /// One step within the ball of radius `tau`, which must hold the iterate.
    pub(super) fn step(&mut self, tau: f64) -> Moved {
        let at = &mut *self.at;
        let groups = if at.restricted { &at.working.groups } else { self.groups };
        let taken = at.projector.step(groups, (&at.s, at.step, &at.c), tau, at.lambda, &mut at.trial_s);
        at.lambda = taken.lambda;
        if !(taken.slope.is_finite() && at.rr.is_finite()) {
            return Moved::NotFinite;
        }
        if taken.slope <= f64::EPSILON * at.rr {
            return Moved::Stationary;
        }

        self.trial_residual();
        let at = &mut *self.at;
        let trial_rr = dot(&at.trial_r, &at.trial_r);
        let curvature = distance_squared(&at.trial_r, &at.r);
        if !(trial_rr.is_finite() && curvature.is_finite()) {
            return Moved::NotFinite;
        }
        let ceiling = at.history.iter().fold(0.0, |a: f64, &b| a.max(b));
        if trial_rr <= ceiling - 2.0 * SUFFICIENT * taken.slope {
            at.swap();
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

    /// Shows the iterate to the operator.
    pub(super) fn show(&mut self, iterations: usize) {
        let (transforms, residual) = (self.at.transforms, &self.at.r);
        self.op.watch(&Iterate { iterations, transforms, residual, state: self.at, groups: self.groups });
    }

    /// trial_r = y - A trial_s
    fn trial_residual(&mut self) {
        let at = &mut *self.at;
        if at.restricted {
            at.working.residual(self.y, &at.trial_s, &mut at.trial_r);
            return;
        }
        self.groups.unpack(&at.trial_s, &mut at.unpacked);
        self.op.forward(&at.unpacked, &mut at.trial_r);
        subtract_from(self.y, &mut at.trial_r);
        at.transforms += 1;
    }

    fn gradient(&mut self) {
        let at = &mut *self.at;
        at.complete = !at.restricted;
        if at.restricted {
            at.working.gradient(&at.r, &mut at.c);
            (at.dual, at.cc) = at.working.groups.dual_and_square(&at.c);
            return;
        }
        self.op.adjoint(&at.r, &mut at.unpacked);
        self.groups.pack(&at.unpacked, &mut at.c);
        at.transforms += 1;
        (at.dual, at.cc) = self.groups.dual_and_square(&at.c);
    }
}

impl State {
    /// The trial point and the iterate change places.
    fn swap(&mut self) {
        std::mem::swap(&mut self.s, &mut self.trial_s);
        std::mem::swap(&mut self.r, &mut self.trial_r);
    }

    /// The iterate in the order of the operator.
    pub(super) fn unpack(&self, groups: &Groups, coefficients: &mut [f64]) {
        assert_eq!(coefficients.len(), self.unpacked.len(), "coefficients");
        if self.restricted {
            let mut packed = vec![0.0; groups.len()];
            self.working.scatter(&self.s, &mut packed);
            groups.unpack(&packed, coefficients);
        } else {
            groups.unpack(&self.s, coefficients);
        }
    }

    /// Vectors as long as the working set has grown.
    fn fit(&mut self) {
        let entries = self.working.groups.len();
        [&mut self.s, &mut self.c, &mut self.trial_s].into_iter().for_each(|v| v.resize(entries, 0.0));
    }
}
