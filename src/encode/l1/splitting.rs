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
//! geometrically, the scaled dual variable z - u with it.
//!
//! Tried on 80 blocks of 15^3 (5 and 25 %, DCT and DFT), steps of two transforms to a norm within 0.4 %: this 50 to 80; a
//! fixed gamma 50 to 350, each problem with another best one; Anderson acceleration over 8 steps, a tenth less than
//! without over-relaxation, which gains more; FISTA with restart and continuation 80 to 500; SPGL1 130 to 280.

use super::Operator;
use super::groups::{Groups, Relaxation};
use super::pareto::{Outcome, relative_gap};
use super::options::Stop;
use super::vector::{dot, subtract_from};

/// The unit of gamma is the largest dual magnitude at s = 0 times columns over rows, about that of the largest
/// coefficient of a solution. Down to each of these levels, gamma falls by this factor a step: slow while the support is
/// found, then fast, and in the end slow again, where hard problems need more of the same.
const SCHEDULE: [(f64, f64); 3] = [(0.05, 0.94), (3e-4, 0.9), (1e-6, 0.97)];
const FIRST: f64 = 0.2;
/// Of z to v.
const OVER: f64 = 1.8;
/// The search ends where ||W u||_1 and ||W v||_1 differ by less than this fraction ...
const AGREED: f64 = 1e-3;
/// ... and a gap of no more than this is proven: no accident far from the solution.
const PLAUSIBLE: f64 = 0.5;
/// Steps before it counts as failed: descent begins anew then, and the better point wins. Most problems take 50 to 120.
const MOST: usize = 160;
/// Rows, squared, over columns from which it is faster than descent over a working set.
const ROWS_SQUARED: usize = 4;
/// Columns over rows down to which it is used: many samples make problems easy, and descent needs fewer steps.
const THINNEST: usize = 3;
/// Largest weight over smallest up to which it is used: one gamma does not suit coefficients weighted much apart.
const WEIGHTS: f64 = 2.0;

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
    pub(super) fn pays<O: Operator + ?Sized>(op: &O, groups: &Groups) -> bool {
        let (rows, cols) = (op.rows(), op.cols());
        let fits = rows.saturating_mul(rows) > ROWS_SQUARED.saturating_mul(cols) && rows <= cols / THINNEST;
        let (least, most) = groups.weights().iter().fold((f64::INFINITY, 0.0f64), |(a, b), w| (a.min(*w), b.max(*w)));
        op.orthonormal_rows() && fits && most <= WEIGHTS * least
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
        // Long on purpose: one loop of the method over its four vectors.
        for v in [&mut self.z, &mut self.c, &mut self.u, &mut self.best] {
            v.clear();
            v.resize(groups.len(), 0.0);
        }
        self.unpacked.resize(op.cols(), 0.0);
        self.r.resize(y.len(), 0.0);
        op.adjoint(y, &mut self.unpacked);
        groups.pack(&self.unpacked, &mut self.z);
        let unit = groups.dual_and_square(&self.z).0 * op.cols() as f64 / y.len() as f64;
        let mut gamma = FIRST;
        let (mut lower, mut norm) = (0.0f64, f64::INFINITY);
        let (mut iterations, mut transforms) = (0, 1);
        let mut agreed = false;
        while iterations < most.min(MOST) && !agreed {
            self.residual(op, y, groups);
            let (yr, length) = (dot(y, &self.r), dot(&self.r, &self.r).sqrt());
            op.adjoint(&self.r, &mut self.unpacked);
            groups.pack(&self.unpacked, &mut self.c);
            let share = if length > sigma { 1.0 - sigma / length } else { 0.0 };
            let decay = SCHEDULE.iter().find(|(level, _)| gamma > *level).map_or(1.0, |(_, decay)| *decay);
            let by = Relaxation { share, gamma: gamma * unit, rescale: decay, over: OVER };
            let found = groups.relax(&mut self.z, &self.c, &mut self.u, &by);
            gamma *= decay;
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

#[cfg(test)]
mod tests {
    use crate::codec::fourier::forward::Transform;
    use crate::codec::fourier::{Basis, partners};
    use crate::encode::l1::Operator;
    use crate::encode::l1::norm::Norm;
    use crate::encode::l1::sampled::SampledBasis;
    use crate::encode::l1::spgl1::{Options, Solver, bpdn};
    use crate::encode::l1::testing::{Dense, Lcg, length, residual};

    const SHAPE: [usize; 4] = [1, 9, 9, 9];
    const SIZE: usize = 729;

    /// Positions, and samples of a smooth block with a little noise.
    fn sampled(ratio: f64, seed: u64) -> (Vec<u32>, Vec<f64>) {
        let mut rng = Lcg(seed);
        let positions: Vec<u32> = (0..SIZE as u32).filter(|_| rng.uniform() < ratio).collect();
        let value = |p: f64| (0.01 * p).sin() + (0.7 * (p % 9.0)).cos() + 0.3 * (p / 81.0).floor();
        let y = positions.iter().map(|&p| value(f64::from(p)) + 0.01 * rng.uniform()).collect();
        (positions, y)
    }

    fn quick(max_iterations: usize) -> Options {
        Options { max_iterations, gap_tolerance: f64::INFINITY, ..Options::default() }
    }

    #[test]
    fn norms_are_near_the_proven_optimum() {
        let weights: Vec<f64> = (0..SIZE).map(|k| 1.0 + 0.1 * (k % 9).div_ceil(2) as f64).collect();
        let mut solver = Solver::default();
        for (basis, ratio) in [Basis::Dct, Basis::Dft].into_iter().flat_map(|b| [0.1, 0.2, 0.3].map(|r| (b, r))) {
            let partner = (basis == Basis::Dft).then(|| partners(SHAPE));
            for weights in [None, Some(weights.as_slice())] {
                let norm = Norm::new(SIZE, weights, partner.as_deref()).unwrap();
                let (positions, y) = sampled(ratio, 3);
                let mut transform = Transform::new(basis, SHAPE);
                let mut op = SampledBasis::new(&mut transform, vec![&positions]);
                for sigma in [0.1 * length(&y), 3e-3 * length(&y)] {
                    let proof = Options { max_iterations: 50_000, gap_tolerance: 1e-4, ..Options::default() };
                    let proof = Options { sigma_tolerance: 1e-6, ..proof };
                    let best = solver.bpdn(&mut op, &y, sigma, &norm, &proof, None).unwrap();
                    let fast = solver.bpdn(&mut op, &y, sigma, &norm, &quick(1000), None).unwrap();
                    let what = format!("{basis:?} {ratio} {} {}: {}", sigma, best.norm, fast.norm);
                    assert!(fast.reached_sigma(sigma) && fast.residual_norm < sigma * (1.0 + 1e-9), "{what}");
                    assert!(fast.iterations < 250, "{what}: {} steps", fast.iterations);
                    assert!(fast.norm < 1.005 * best.norm && fast.norm > 0.9999 * best.norm, "{what}");
                    assert!(fast.norm * (1.0 - fast.gap) < best.norm * (1.0 + 1e-9), "{what}: gap {}", fast.gap);
                    let r = residual(&mut op, &y, &fast.coefficients);
                    assert!((length(&r) - fast.residual_norm).abs() < 1e-12 * length(&y), "{what}");
                    let again = bpdn(&mut op, &y, sigma, &norm, &quick(1000)).unwrap();
                    assert_eq!(again.coefficients, fast.coefficients);
                }
            }
        }
    }

    #[test]
    fn more_steps_are_never_worse() {
        let (positions, y) = sampled(0.2, 5);
        let mut transform = Transform::new(Basis::Dct, SHAPE);
        let mut op = SampledBasis::new(&mut transform, vec![&positions]);
        // Little noise, and more than the data could be without: the second does not end by itself soon.
        for sigma in [0.05, 0.0, 1e-9] {
            let mut last = f64::INFINITY;
            assert_eq!(bpdn(&mut op, &y, sigma, &Norm::l1(SIZE), &quick(0)).unwrap().coefficients, [0.0; SIZE]);
            for steps in [1, 2, 5, 10, 20, 40, 80, 200, super::MOST, super::MOST + 1, 400] {
                let solution = bpdn(&mut op, &y, sigma, &Norm::l1(SIZE), &quick(steps)).unwrap();
                assert!(solution.reached_sigma(sigma) && solution.iterations <= steps, "{steps}: {:?}", solution.stop);
                assert!(solution.norm <= last, "{steps}: {} {last}", solution.norm);
                last = solution.norm;
            }
        }
    }

    /// Says of itself what is not true.
    struct Liar(Dense);

    impl Operator for Liar {
        fn rows(&self) -> usize {
            self.0.rows()
        }

        fn cols(&self) -> usize {
            self.0.cols()
        }

        fn forward(&mut self, coefficients: &[f64], samples: &mut [f64]) {
            self.0.forward(coefficients, samples);
        }

        fn adjoint(&mut self, samples: &[f64], coefficients: &mut [f64]) {
            self.0.adjoint(samples, coefficients);
        }

        fn orthonormal_rows(&self) -> bool {
            true
        }
    }

    #[test]
    fn rows_that_are_not_orthonormal_are_noticed() {
        for factor in [0.3, 1.7, 1e9] {
            let mut dense = Dense::dct(100).select(&(0..30).map(|i| i * 3).collect::<Vec<_>>());
            dense.matrix.iter_mut().for_each(|a| *a *= factor);
            let y: Vec<f64> = (0..30).map(|i| (f64::from(i) * 0.3).sin()).collect();
            let norm = Norm::l1(100);
            let expected = bpdn(&mut dense, &y, 0.1, &norm, &quick(1000)).unwrap();
            let solution = bpdn(&mut Liar(dense), &y, 0.1, &norm, &quick(1000)).unwrap();
            assert!(solution.reached_sigma(0.1));
            assert!(solution.norm < 1.02 * expected.norm, "{factor}: {} {}", solution.norm, expected.norm);
        }
    }
}
