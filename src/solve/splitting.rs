//! Douglas-Rachford splitting for basis pursuit denoise where A A^T = 1: a good point in few steps, without a proof.
//!
//! With orthonormal rows the nearest point with ||y - A s|| <= sigma has a closed form, u = z + (1 - sigma / ||r||) A^T r
//! for r = y - A z. A step takes it, then the soft threshold v = shrink(2 u - z, gamma), then z += 1.8 (v - u): one
//! forward and one adjoint transform and a single pass, no projection onto a ball and no line search. Every u is
//! feasible, v is sparse, and in practice ||W u||_1 is above the optimum by about ||W u||_1 - ||W v||_1, which is what
//! ends the search. Source: Lions & Mercier 1979; as ADMM on BPDN: Yang & Zhang, "Alternating direction algorithms for
//! l1-problems in compressive sensing", SIAM J. Sci. Comput. 33(1), 2011.
//!
//! All hangs on gamma. Large, it finds the support and then creeps; small, the reverse. So it starts large and falls
//! geometrically to a floor, the scaled dual variable z - u with it.

use super::Operator;
use super::groups::{Groups, Relaxation};
use super::pareto::{self, Outcome, relative_gap};
use super::spgl1::Stop;
use super::vector::{distance_squared, dot, subtract_from};

/// First and last gamma, in units of the largest dual magnitude at s = 0 times columns over rows: about that of the
/// largest coefficient of a solution.
const FIRST: f64 = 0.2;
const LAST: f64 = 3e-4;
/// From step to step.
const DECAY: f64 = 0.92;
/// Of z to v.
const OVER: f64 = 1.8;
/// The search ends where ||W u||_1 and ||W v||_1 differ by less than this fraction ...
const AGREED: f64 = 1.5e-3;
/// ... and a gap of no more than this is proven: no accident far from the solution.
const PLAUSIBLE: f64 = 0.5;
/// Steps before it counts as failed. Most problems take 40 to 100.
const MOST: usize = 250;
/// Rows, squared, over columns from which it is faster than descent over a working set.
const ROWS_SQUARED: usize = 4;

/// Buffers of the splitting.
#[derive(Debug, Default)]
pub(super) struct Splitting {
    z: Vec<f64>,
    c: Vec<f64>,
    u: Vec<f64>,
    pub(super) best: Vec<f64>,
    unpacked: Vec<f64>,
    r: Vec<f64>,
}

impl Splitting {
    /// Whether it can be used and is the faster way.
    pub(super) fn pays<O: Operator + ?Sized>(op: &O) -> bool {
        let (rows, cols) = (op.rows(), op.cols());
        op.orthonormal_rows() && rows.saturating_mul(rows) > ROWS_SQUARED.saturating_mul(cols)
    }

    /// The best point of up to `most` steps for ||y|| = 1 and 0 <= `sigma` < 1, in `best`. `None` if none was found
    /// whose residual is sigma to within `tolerance`. It stops as converged where norms agreed.
    pub(super) fn bpdn<O: Operator + ?Sized>(
        &mut self,
        op: &mut O,
        y: &[f64],
        (sigma, tolerance): (f64, f64),
        groups: &Groups,
        most: usize,
    ) -> Option<Outcome> {
        for v in [&mut self.z, &mut self.c, &mut self.u, &mut self.best] {
            v.clear();
            v.resize(groups.len(), 0.0);
        }
        self.unpacked.resize(op.cols(), 0.0);
        self.r.resize(y.len(), 0.0);
        op.adjoint(y, &mut self.unpacked);
        groups.pack(&self.unpacked, &mut self.z);
        let unit = groups.dual_and_square(&self.z).0 * op.cols() as f64 / y.len() as f64;
        let (mut gamma, last) = (FIRST * unit, LAST * unit);
        let (mut lower, mut norm) = (0.0f64, f64::INFINITY);
        let (mut iterations, mut transforms) = (0, 1);
        let mut agreed = false;
        while iterations < most.min(MOST) && !agreed {
            self.residual(op, y, groups);
            let (yr, length) = (dot(y, &self.r), dot(&self.r, &self.r).sqrt());
            op.adjoint(&self.r, &mut self.unpacked);
            groups.pack(&self.unpacked, &mut self.c);
            let share = if length > sigma { 1.0 - sigma / length } else { 0.0 };
            let next = last.max(DECAY * gamma);
            let by = Relaxation { share, gamma, rescale: next / gamma, over: OVER };
            let found = groups.relax(&mut self.z, &self.c, &mut self.u, &by);
            gamma = next;
            iterations += 1;
            transforms += 2;
            if !(found.norm_u.is_finite() && length.is_finite()) {
                break;
            }
            let bound = (yr - sigma * length) / found.dual;
            if bound > lower && bound.is_finite() {
                lower = bound;
            }
            agreed = (found.norm_u - found.norm_v).abs() <= AGREED * found.norm_u
                && lower >= (1.0 - PLAUSIBLE) * found.norm_u;
            if found.norm_u < norm {
                norm = found.norm_u;
                std::mem::swap(&mut self.u, &mut self.best);
            }
        }
        if norm.is_infinite() {
            return None;
        }
        // What is claimed is measured.
        std::mem::swap(&mut self.z, &mut self.best);
        self.residual(op, y, groups);
        std::mem::swap(&mut self.z, &mut self.best);
        transforms += 1;
        let residual = dot(&self.r, &self.r).sqrt();
        let stop = if agreed { Stop::Converged } else { Stop::SigmaReached };
        (residual <= sigma + tolerance).then(|| Outcome {
            residual,
            gap: relative_gap(norm, lower),
            iterations,
            transforms,
            stop,
        })
    }

    /// r = y - A z
    fn residual<O: Operator + ?Sized>(&mut self, op: &mut O, y: &[f64], groups: &Groups) {
        groups.unpack(&self.z, &mut self.unpacked);
        op.forward(&self.unpacked, &mut self.r);
        subtract_from(y, &mut self.r);
    }
}
