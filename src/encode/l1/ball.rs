//! Euclidean projection onto the ball { s : ||W s||_1 <= tau }.
//!
//! The projection is the soft threshold at the theta >= 0 where the norm comes down to tau: the root of
//! f(theta) = sum w max(m - theta w, 0) - tau over group magnitudes m and weights w. f is convex, decreasing and
//! piecewise linear, so Newton's method lands at or below the root from anywhere and climbs to it in finitely many
//! steps; from below, each step drops groups for good (Michelot 1986; Condat 2016, "Fast projection onto the simplex
//! and the l1 ball"). A guess of theta is a good start; in a projected gradient step, it is near the step's length
//! times ||A^T r||*.

use super::groups::Groups;
use super::vector::LANES;
use crate::base::simd::{Level, Task};

/// Passes over all groups before the active set is gathered.
const WHOLE_PASSES: usize = 4;

/// Reusable scratch of the projection.
#[derive(Clone, Debug, Default)]
pub(super) struct Projector {
    magnitudes: Vec<f64>,
    /// (magnitude, weight) of the groups still above the threshold.
    active: Vec<[f64; 2]>,
}

impl Projector {
    /// Moves the packed `s` to the nearest point with ||W s||_1 <= `tau`, in place. A `tau` that is not positive gives
    /// zero.
    pub(super) fn project(&mut self, groups: &Groups, s: &mut [f64], tau: f64) {
        if tau.is_nan() || tau <= 0.0 {
            s.fill(0.0);
            return;
        }
        self.fit(groups);
        groups.magnitudes(s, &mut self.magnitudes);
        let theta = self.threshold(groups.weights(), tau, 0.0);
        if theta > 0.0 {
            groups.shrink(s, &self.magnitudes, theta);
        }
    }

    /// Sets `trial` to the projection of s + step * c. `lambda` is a guess of theta / step: it saves time where it is
    /// near and costs little where not. `tau` must be positive.
    pub(super) fn step(
        &mut self,
        groups: &Groups,
        (s, step, c): (&[f64], f64, &[f64]),
        tau: f64,
        lambda: f64,
        trial: &mut [f64],
    ) -> Step {
        self.fit(groups);
        groups.step(s, step, c, trial, &mut self.magnitudes);
        let theta = self.threshold(groups.weights(), tau, step * lambda);
        let (slope, length_squared) = groups.shrink_towards(trial, &self.magnitudes, theta, s, c);
        Step { lambda: theta / step, slope, length_squared }
    }

    fn fit(&mut self, groups: &Groups) {
        self.magnitudes.resize(groups.slots(), 0.0);
    }

    /// The root of f, or 0 where f(0) <= 0.
    fn threshold(&mut self, weights: &[f64], tau: f64, guess: f64) -> f64 {
        let mut theta = 0.0;
        if guess > 0.0 {
            let sums = Sums::above(&self.magnitudes, weights, guess);
            if sums.squares > 0.0 {
                theta = sums.newton(tau);
            }
        }
        // A Newton step that lands above 0 proves f(0) > 0.
        if theta <= 0.0 {
            theta = Sums::above(&self.magnitudes, weights, 0.0).newton(tau);
            if theta <= 0.0 {
                return 0.0;
            }
        }
        // Theta is below the root from here on. A few whole passes are fast and mostly enough ...
        for _ in 0..WHOLE_PASSES {
            let next = Sums::above(&self.magnitudes, weights, theta).newton(tau);
            if next <= theta {
                return theta;
            }
            theta = next;
        }
        // ... and after them, each round visits only the groups that the last one left.
        self.active.clear();
        self.active.extend(self.magnitudes.iter().zip(weights).map(|(&m, &w)| [m, w]));
        loop {
            let before = self.active.len();
            let mut sums = Sums::default();
            self.active.retain(|&[m, w]| {
                let keep = m > theta * w;
                sums.add(m, w, keep);
                keep
            });
            let next = sums.newton(tau);
            if self.active.len() == before || next <= theta {
                return theta;
            }
            theta = next;
        }
    }
}

/// What is known of a projected gradient step d = trial - s.
pub(super) struct Step {
    /// Threshold of the projection over the step length; tends to ||A^T r||*.
    pub(super) lambda: f64,
    /// <c, d>
    pub(super) slope: f64,
    /// ||d||^2
    pub(super) length_squared: f64,
}

/// Sums over the groups above a threshold.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// sum w m
    norm: f64,
    /// sum w^2
    squares: f64,
}

impl Sums {
    #[inline(always)]
    fn add(&mut self, m: f64, w: f64, keep: bool) {
        let kept = if keep { w } else { 0.0 };
        self.norm += kept * m;
        self.squares += kept * w;
    }

    /// The sums over all groups with m > theta w.
    fn above(magnitudes: &[f64], weights: &[f64], theta: f64) -> Sums {
        let mut sums = Sums::default();
        Level::detect().run(Above { magnitudes, weights, theta, sums: &mut sums });
        sums
    }

    /// The theta at which these groups alone have norm `tau`; negative if there are none.
    fn newton(&self, tau: f64) -> f64 {
        let theta = (self.norm - tau) / self.squares;
        if theta.is_nan() { f64::NEG_INFINITY } else { theta }
    }
}

/// [`Sums::above`], on the best instructions of the machine.
struct Above<'a> {
    magnitudes: &'a [f64],
    weights: &'a [f64],
    theta: f64,
    sums: &'a mut Sums,
}

impl Task for Above<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Above { magnitudes, weights, theta, sums } = self;
        let (mut norms, mut squares) = ([0.0; LANES], [0.0; LANES]);
        for (m, w) in magnitudes.as_chunks::<LANES>().0.iter().zip(weights.as_chunks::<LANES>().0) {
            for k in 0..LANES {
                let kept = if m[k] > theta * w[k] { w[k] } else { 0.0 };
                norms[k] += kept * m[k];
                squares[k] += kept * w[k];
            }
        }
        *sums = Sums { norm: norms.iter().sum(), squares: squares.iter().sum() };
    }
}

#[cfg(test)]
mod tests {
    use super::super::norm::Norm;
    use super::*;
    use proptest::prelude::*;

    fn project(norm: &Norm, s: &mut [f64], tau: f64) {
        let mut packed = vec![0.0; norm.packing().len()];
        norm.packing().pack(s, &mut packed);
        Projector::default().project(norm.packing(), &mut packed, tau);
        norm.packing().unpack(&packed, s);
    }

    /// The threshold by sorting the breakpoints m / w, downwards.
    fn sorted_threshold(norm: &Norm, s: &[f64], tau: f64) -> f64 {
        let packing = norm.packing();
        let (mut packed, mut magnitudes) = (vec![0.0; packing.len()], vec![0.0; packing.slots()]);
        packing.pack(s, &mut packed);
        packing.magnitudes(&packed, &mut magnitudes);
        let mut groups: Vec<(f64, f64)> = magnitudes.into_iter().zip(packing.weights().iter().copied()).collect();
        groups.sort_by(|a, b| (b.0 / b.1).total_cmp(&(a.0 / a.1)));
        let (mut norm_sum, mut squares, mut theta) = (0.0, 0.0, 0.0);
        for (m, w) in groups {
            if m / w <= theta {
                break;
            }
            norm_sum += w * m;
            squares += w * w;
            theta = f64::max(0.0, (norm_sum - tau) / squares);
        }
        theta
    }

    #[test]
    fn inside_is_untouched_and_no_radius_gives_zero() {
        let norm = Norm::l1(3);
        let mut s = [1.0, -2.0, 0.5];
        project(&norm, &mut s, 3.5);
        assert_eq!(s, [1.0, -2.0, 0.5]);
        for tau in [0.0, -1.0, f64::NAN] {
            let mut s = [1.0, -2.0, 0.5];
            project(&norm, &mut s, tau);
            assert_eq!(s, [0.0; 3]);
        }
        project(&Norm::l1(0), &mut [], 1.0);
    }

    #[test]
    fn known_point() {
        let norm = Norm::new(3, Some(&[1.0, 2.0, 1.0]), None).unwrap();
        // theta = 0.5: (3 - 0.5) + 2 (2 - 2 * 0.5) + 0 = 4.5
        let mut s = [3.0, -2.0, 0.25];
        project(&norm, &mut s, 4.5);
        assert_eq!(s, [2.5, -1.0, 0.0]);
    }

    #[test]
    fn slowest_decay_still_ends() {
        // Each round drops few groups here; the active set must end them all.
        let s: Vec<f64> = (0..2000).map(|i| 0.99f64.powi(i)).collect();
        let norm = Norm::l1(2000);
        for tau in [1e-9, 1e-3, 1.0, 30.0, 99.0] {
            let mut p = s.clone();
            project(&norm, &mut p, tau);
            assert!((norm.primal(&p) - tau).abs() <= 1e-12 * tau.max(1e-3), "{tau}");
        }
    }

    proptest! {
        #[test]
        fn equals_the_sorted_threshold(
            s in prop::collection::vec(prop_oneof![Just(0.0), -1.0..1.0f64, -100.0..100.0f64], 2..150),
            weights in prop::collection::vec(prop_oneof![Just(1.0), 0.01..50.0f64], 150),
            fraction in 0.0001..1.2f64,
            guess in prop_oneof![Just(0.0), 0.0..200.0f64],
            step in 0.01..5.0f64,
            channels in 1..3usize,
            paired: bool,
        ) {
            let n = s.len() / channels;
            let s = &s[..n * channels];
            let weights: Vec<f64> = (0..n).map(|i| weights[i / 2]).collect();
            let partner: Vec<u32> = (0..n).map(|i| if i ^ 1 < n { (i ^ 1) as u32 } else { i as u32 }).collect();
            let norm = Norm::group(n, channels, Some(&weights), paired.then_some(&partner)).unwrap();
            let packing = norm.packing();
            let tau = fraction * norm.primal(s);
            let theta = sorted_threshold(&norm, s, tau);
            let mut expected = s.to_vec();
            norm.soft_threshold(&mut expected, theta);
            let mut projected = s.to_vec();
            project(&norm, &mut projected, tau);
            for (a, b) in projected.iter().zip(&expected) {
                prop_assert!((a - b).abs() <= 1e-9 * (1.0 + theta), "{} {}", a, b);
            }
            prop_assert!(norm.primal(&projected) <= tau * (1.0 + 1e-11));
            if fraction < 0.999 && tau > 0.0 {
                prop_assert!((norm.primal(&projected) - tau).abs() <= 1e-9 * tau);
            }

            // The same as a step from s / 2 along s / (2 step).
            let mut packed = vec![0.0; packing.len()];
            packing.pack(s, &mut packed);
            let half: Vec<f64> = packed.iter().map(|v| 0.5 * v).collect();
            let along: Vec<f64> = packed.iter().map(|v| 0.5 * v / step).collect();
            if tau > 0.0 {
                let taken = Projector::default().step(packing, (&half, step, &along), tau, guess, &mut packed);
                prop_assert!((taken.lambda * step - theta).abs() <= 1e-10 * (1.0 + theta), "{} {}", taken.lambda, theta);
                let apart: Vec<f64> = packed.iter().zip(&half).map(|(a, b)| a - b).collect();
                let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
                let (slope, length) = (product(&along, &apart), product(&apart, &apart));
                prop_assert!((taken.slope - slope).abs() <= 1e-9 * (1.0 + slope.abs()));
                prop_assert!((taken.length_squared - length).abs() <= 1e-9 * (1.0 + length));
                packing.unpack(&packed, &mut projected);
                for (a, b) in projected.iter().zip(&expected) {
                    prop_assert!((a - b).abs() <= 1e-9 * (1.0 + theta), "{} {}", a, b);
                }
            }
        }
    }
}
