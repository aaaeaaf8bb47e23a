//! Spectral projected gradient for min 1/2 ||y - A s||^2 subject to ||W s||_1 <= tau (Birgin, Martinez, Raydan 2000).
//!
//! One step costs one forward and one adjoint transform, whatever the search does. The trial point is the projected
//! gradient step of Barzilai-Borwein length, as in the published spgl1's curvilinear search; it is taken if it lies
//! below the largest of the last objectives. If not, the search goes back along the segment to it (the published
//! fallback): A is linear, so the residual there is a blend of the two known ones and the objective an exact parabola,
//! whose minimiser needs no transform. Halving a curvilinear step would cost a transform a trial.

use super::ball::Projector;
use super::norm::Norm;
use super::vector::{distance_squared, dot, move_towards, slope_and_length, step_from, subtract_from};
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

/// The iterate and what is known there. Buffers are made once; no step allocates.
pub(super) struct Descent<'a, O: Operator + ?Sized> {
    op: &'a mut O,
    norm: &'a Norm,
    /// The samples, ||y|| = 1.
    y: &'a [f64],
    projector: Projector,
    /// The iterate s.
    pub(super) s: Vec<f64>,
    /// Residual y - A s.
    pub(super) r: Vec<f64>,
    /// A^T r: the negative gradient.
    pub(super) c: Vec<f64>,
    /// ||r||^2
    pub(super) rr: f64,
    trial_s: Vec<f64>,
    trial_r: Vec<f64>,
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

impl<'a, O: Operator + ?Sized> Descent<'a, O> {
    /// Starts at s = 0.
    pub(super) fn new(op: &'a mut O, norm: &'a Norm, y: &'a [f64]) -> Self {
        let (rows, cols) = (op.rows(), op.cols());
        let rr = dot(y, y);
        let mut descent = Descent {
            op,
            norm,
            y,
            projector: Projector::new(norm),
            s: vec![0.0; cols],
            r: y.to_vec(),
            c: vec![0.0; cols],
            rr,
            trial_s: vec![0.0; cols],
            trial_r: vec![0.0; rows],
            step: 1.0,
            first_step: 1.0,
            lambda: 0.0,
            history: [rr; HISTORY],
            newest: 0,
            transforms: 0,
        };
        descent.gradient();
        // At most 1 / ||A||^2; exactly that for orthonormal rows.
        let first = rr / dot(&descent.c, &descent.c);
        if first.is_finite() && first > 0.0 {
            (descent.step, descent.first_step) = (first, first);
        }
        descent
    }

    /// Moves to the projection of `start` onto the ball of radius `tau` and forgets the search's history.
    pub(super) fn restart(&mut self, start: &[f64], tau: f64) {
        self.s.copy_from_slice(start);
        self.shrink(tau);
    }

    /// Projects the iterate onto the ball of radius `tau`, which may be smaller than before.
    pub(super) fn shrink(&mut self, tau: f64) {
        self.projector.project(self.norm, &mut self.s, tau);
        self.op.forward(&self.s, &mut self.r);
        subtract_from(self.y, &mut self.r);
        self.transforms += 1;
        self.rr = dot(&self.r, &self.r);
        self.history = [self.rr; HISTORY];
        self.gradient();
    }

    /// One step within the ball of radius `tau`, which must hold the iterate.
    pub(super) fn step(&mut self, tau: f64) -> Moved {
        step_from(&self.s, self.step, &self.c, &mut self.trial_s);
        let guess = self.step * self.lambda;
        self.lambda = self.projector.project_from(self.norm, &mut self.trial_s, tau, guess) / self.step;
        let (slope, length_squared) = slope_and_length(&self.trial_s, &self.s, &self.c);
        if !(slope.is_finite() && self.rr.is_finite()) {
            return Moved::NotFinite;
        }
        if slope <= f64::EPSILON * self.rr {
            return Moved::Stationary;
        }

        self.op.forward(&self.trial_s, &mut self.trial_r);
        subtract_from(self.y, &mut self.trial_r);
        self.transforms += 1;
        let trial_rr = dot(&self.trial_r, &self.trial_r);
        let curvature = distance_squared(&self.trial_r, &self.r);
        if !(trial_rr.is_finite() && curvature.is_finite()) {
            return Moved::NotFinite;
        }
        let ceiling = self.history.iter().fold(0.0, |a: f64, &b| a.max(b));
        if trial_rr <= ceiling - 2.0 * SUFFICIENT * slope {
            std::mem::swap(&mut self.s, &mut self.trial_s);
            std::mem::swap(&mut self.r, &mut self.trial_r);
            self.rr = trial_rr;
        } else {
            let fraction = (slope / curvature).min(1.0);
            move_towards(&mut self.s, &self.trial_s, fraction);
            move_towards(&mut self.r, &self.trial_r, fraction);
            self.rr = dot(&self.r, &self.r);
        }
        let (shortest, longest) = (self.first_step / STEP_RANGE, self.first_step * STEP_RANGE);
        self.step = if curvature > 0.0 { (length_squared / curvature).clamp(shortest, longest) } else { longest };
        self.newest = (self.newest + 1) % HISTORY;
        self.history[self.newest] = self.rr;
        self.gradient();
        Moved::Yes
    }

    /// Shows the iterate to the operator.
    pub(super) fn show(&mut self, iterations: usize) {
        let (transforms, coefficients, residual, correlation) = (self.transforms, &self.s, &self.r, &self.c);
        self.op.watch(&Iterate { iterations, transforms, coefficients, residual, correlation });
    }

    fn gradient(&mut self) {
        self.op.adjoint(&self.r, &mut self.c);
        self.transforms += 1;
    }
}
