//! Euclidean projection onto the ball { s : ||W s||_1 <= tau }.
//!
//! The projection is the soft threshold at the theta >= 0 where the norm comes down to tau: the root of
//! f(theta) = sum w max(m - theta w, 0) - tau over group magnitudes m and weights w. f is convex, decreasing and
//! piecewise linear, so Newton's method lands at or below the root from anywhere and climbs to it in finitely many
//! steps; from below, each step drops groups for good (Michelot 1986; Condat 2016, "Fast projection onto the simplex
//! and the l1 ball"). The theta of the previous call is a second start: neighbouring iterates nearly share it.

use super::norm::Norm;

/// Reusable scratch of the projection.
#[derive(Clone, Debug)]
pub struct Projector {
    magnitudes: Vec<f64>,
    /// (magnitude, weight) of the groups still above the threshold.
    active: Vec<[f64; 2]>,
    hint: f64,
}

impl Projector {
    /// Scratch for projections with `norm`.
    pub fn new(norm: &Norm) -> Projector {
        Projector { magnitudes: vec![0.0; norm.groups()], active: vec![[0.0; 2]; norm.groups()], hint: 0.0 }
    }

    /// Moves `s` to the nearest point with ||W s||_1 <= `tau`, in place, and returns the threshold theta >= 0 that was
    /// taken off (0 where `s` was inside). Expected O(n), no allocation. A `tau` that is not positive gives zero.
    ///
    /// # Panics
    /// Where the scratch was made for another norm or `s` has another length.
    pub fn project(&mut self, norm: &Norm, s: &mut [f64], tau: f64) -> f64 {
        if !(tau > 0.0) {
            s.fill(0.0);
            return 0.0;
        }
        norm.magnitudes(s, &mut self.magnitudes);
        let theta = self.threshold(norm.weights(), tau);
        if theta > 0.0 {
            norm.soft_threshold(s, theta);
            self.hint = theta;
        }
        theta
    }

    /// The root of f, or 0 where f(0) <= 0.
    fn threshold(&mut self, weights: &[f64], tau: f64) -> f64 {
        let all = Sums::above(&self.magnitudes, weights, 0.0);
        if all.norm <= tau {
            return 0.0;
        }
        let mut theta = all.newton(tau).max(0.0);
        if self.hint > theta {
            let hinted = Sums::above(&self.magnitudes, weights, self.hint);
            if hinted.squares > 0.0 {
                theta = theta.max(hinted.newton(tau));
            }
        }
        let mut count = 0;
        let mut sums = Sums::default();
        for (&m, &w) in self.magnitudes.iter().zip(weights) {
            // Written always, kept only if counted: no branch to mispredict.
            self.active[count] = [m, w];
            let keep = m > theta * w;
            count += usize::from(keep);
            sums.add(m, w, keep);
        }
        // Each round drops a group or ends, so the rounds are bounded by the groups.
        loop {
            let next = sums.newton(tau);
            if !(next > theta) {
                return theta;
            }
            theta = next;
            let before = count;
            count = 0;
            sums = Sums::default();
            for i in 0..before {
                let [m, w] = self.active[i];
                self.active[count] = [m, w];
                let keep = m > theta * w;
                count += usize::from(keep);
                sums.add(m, w, keep);
            }
            if count == before || count == 0 {
                return theta;
            }
        }
    }
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
        const LANES: usize = 8;
        let mut lanes = [Sums::default(); LANES];
        let (m_lanes, m_rest) = magnitudes.as_chunks::<LANES>();
        let (w_lanes, w_rest) = weights.as_chunks::<LANES>();
        for (m, w) in m_lanes.iter().zip(w_lanes) {
            for k in 0..LANES {
                lanes[k].add(m[k], w[k], m[k] > theta * w[k]);
            }
        }
        for (&m, &w) in m_rest.iter().zip(w_rest) {
            lanes[0].add(m, w, m > theta * w);
        }
        lanes.iter().fold(Sums::default(), |a, b| Sums { norm: a.norm + b.norm, squares: a.squares + b.squares })
    }

    /// The theta at which these groups alone have norm `tau`.
    fn newton(&self, tau: f64) -> f64 {
        (self.norm - tau) / self.squares
    }
}
