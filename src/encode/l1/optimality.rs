//! Solutions against closed forms, exact sparse signals and the optimality conditions.

use super::norm::Norm;
use super::spgl1::{Options, Solution, Stop, bpdn, bpdn_from, lasso};
use super::testing::{Dense, Lcg, WithColumns, length, residual};
use super::{Iterate, Operator};
use proptest::prelude::*;

fn tight() -> Options {
    Options { max_iterations: 20_000, sigma_tolerance: 1e-7, bp_tolerance: 1e-9, gap_tolerance: 1e-6 }
}

fn uniform(n: usize, rng: &mut Lcg) -> Vec<f64> {
    (0..n).map(|_| rng.uniform() - 0.5).collect()
}

/// Weights from 0.5 to 3, equal within the pairs (1, 2), (3, 4), ...
fn paired_weights(n: usize, rng: &mut Lcg) -> Vec<f64> {
    let drawn: Vec<f64> = (0..n).map(|_| 0.5 + 2.5 * rng.uniform()).collect();
    (0..n).map(|i| drawn[i.div_ceil(2)]).collect()
}

/// The four kinds of norm over the columns of a Fourier matrix of size n, for one channel or several.
fn joint_norms(n: usize, channels: usize, partner: &[u32], rng: &mut Lcg) -> [Norm; 4] {
    let weights = paired_weights(n, rng);
    [(false, false), (true, false), (false, true), (true, true)]
        .map(|(w, p)| Norm::group(n, channels, w.then_some(&weights), p.then_some(partner)).unwrap())
}

/// The lambda at which `measure(soft threshold of s)` is `target`, by bisection, and that threshold.
fn bisect(norm: &Norm, s: &[f64], target: f64, increasing: bool, measure: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let (mut low, mut high) = (0.0, norm.dual(s));
    let mut shrunk = s.to_vec();
    for _ in 0..200 {
        let middle = 0.5 * (low + high);
        shrunk.copy_from_slice(s);
        norm.soft_threshold(&mut shrunk, middle);
        if (measure(&shrunk) < target) == increasing { low = middle } else { high = middle }
    }
    shrunk
}

fn assert_near(a: &[f64], b: &[f64], tolerance: f64) {
    let distance = length(&a.iter().zip(b).map(|(x, y)| x - y).collect::<Vec<_>>());
    assert!(distance <= tolerance * length(b), "{distance} of {}", length(b));
}

#[test]
fn full_sampling_is_a_soft_threshold() {
    let (op, partner) = Dense::fourier(45);
    let mut rng = Lcg(5);
    for (channels, norm) in
        [1, 3].iter().flat_map(|&c| joint_norms(45, c, &partner, &mut rng).map(move |norm| (c, norm)))
    {
        let mut op = op.channels(channels);
        let y = uniform(45 * channels, &mut Lcg(6));
        let mut spectrum = vec![0.0; 45 * channels];
        op.adjoint(&y, &mut spectrum);
        for fraction in [0.9, 0.3, 0.01] {
            let sigma = fraction * length(&y);
            let away = |s: &[f64]| length(&s.iter().zip(&spectrum).map(|(a, b)| a - b).collect::<Vec<_>>());
            let expected = bisect(&norm, &spectrum, sigma, true, away);
            let solution = bpdn(&mut op, &y, sigma, &norm, &tight()).unwrap();
            assert_eq!(solution.stop, Stop::Converged);
            assert!((solution.residual_norm - sigma).abs() <= 1e-6 * sigma + 1e-8);
            assert_near(&solution.coefficients, &expected, 1e-4);

            let tau = fraction * norm.primal(&spectrum);
            let expected = bisect(&norm, &spectrum, tau, false, |s| norm.primal(s));
            let solution = lasso(&mut op, &y, tau, &norm, &tight()).unwrap();
            assert_eq!(solution.stop, Stop::Converged);
            assert_near(&solution.coefficients, &expected, 1e-4);
            assert!((solution.norm - tau).abs() <= 1e-6 * tau);
        }
        let solution = bpdn(&mut op, &y, 0.0, &norm, &tight()).unwrap();
        assert_near(&solution.coefficients, &spectrum, 1e-7);
    }
}

#[test]
fn basis_pursuit_recovers_sparse_signals_exactly() {
    for seed in 1..6 {
        let mut rng = Lcg(seed);
        let rows: Vec<usize> = (0..128).filter(|_| rng.uniform() < 0.5).collect();
        let mut op = Dense::dct(128).select(&rows);
        let mut sparse = vec![0.0; 128];
        for _ in 0..8 {
            sparse[(128.0 * rng.uniform()) as usize] = 4.0 * (rng.uniform() - 0.5);
        }
        let mut y = vec![0.0; rows.len()];
        op.forward(&sparse, &mut y);
        let solution = bpdn(&mut op, &y, 0.0, &Norm::l1(128), &tight()).unwrap();
        assert!(solution.reached_sigma(0.0), "{:?}", solution.stop);
        assert_near(&solution.coefficients, &sparse, 1e-6);
    }
}

#[test]
fn weights_steer_the_choice() {
    // One sample of two equally good columns: the cheaper one explains it all.
    let mut op = Dense { cols: 2, matrix: vec![1.0, 1.0] };
    let norm = Norm::new(2, Some(&[3.0, 1.0]), None).unwrap();
    let solution = bpdn(&mut op, &[4.0], 1.0, &norm, &tight()).unwrap();
    assert_near(&solution.coefficients, &[0.0, 3.0], 1e-6);
    assert!((solution.norm - 3.0).abs() < 1e-6);
}

#[test]
fn a_good_start_saves_steps_and_a_bad_one_does_no_harm() {
    let mut rng = Lcg(3);
    let mut op = Dense::dct(200).select(&(0..200).filter(|_| rng.uniform() < 0.4).collect::<Vec<_>>());
    let y = uniform(op.rows(), &mut rng);
    let (norm, sigma) = (Norm::l1(200), 0.1 * length(&y));
    let options = Options { gap_tolerance: 1e-5, ..tight() };
    let cold = bpdn(&mut op, &y, sigma, &norm, &options).unwrap();
    let warm = bpdn_from(&mut op, &y, sigma, &norm, &options, &cold.coefficients).unwrap();
    assert!(warm.iterations * 2 < cold.iterations, "{} {}", warm.iterations, cold.iterations);
    for start in [vec![1e6; 200], vec![1e300; 200], vec![-1e-300; 200], cold.coefficients.iter().map(|v| -v).collect()]
    {
        let other = bpdn_from(&mut op, &y, sigma, &norm, &options, &start).unwrap();
        assert_eq!(other.stop, Stop::Converged);
        assert!((other.norm - cold.norm).abs() < 1e-4 * cold.norm);
    }
}

#[test]
fn every_iterate_is_shown() {
    struct Watched {
        op: Dense,
        /// Whether it gives columns.
        columns: bool,
        unit: Vec<f64>,
        seen: Vec<(usize, f64)>,
    }
    impl Operator for Watched {
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
            self.columns && WithColumns(&mut self.op).column(index, samples)
        }
        fn watch(&mut self, iterate: &Iterate) {
            let mut s = vec![0.0; self.cols()];
            iterate.coefficients(&mut s);
            assert_near(&residual(&mut self.op, &self.unit, &s), iterate.residual, 1e-10);
            self.seen.push((iterate.iterations, length(iterate.residual)));
        }
    }
    let (fourier, partner) = Dense::fourier(101);
    let mut rng = Lcg(3);
    for (share, columns) in [(0.4, false), (0.4, true), (0.2, true)] {
        let op = fourier.select(&(0..101).filter(|_| rng.uniform() < share).collect::<Vec<_>>()).channels(2);
        let y = uniform(op.rows(), &mut rng);
        let unit = y.iter().map(|v| v / length(&y)).collect();
        let norm = Norm::group(101, 2, None, Some(&partner)).unwrap();
        let options = Options { gap_tolerance: f64::INFINITY, ..tight() };
        let mut watched = Watched { op, columns, unit, seen: Vec::new() };
        let solution = bpdn(&mut watched, &y, 0.1 * length(&y), &norm, &options).unwrap();
        let seen = watched.seen;
        assert!(seen.iter().map(|step| step.0).eq(0..=solution.iterations));
        assert!((seen[0].1 - 1.0).abs() < 1e-12 && (seen[solution.iterations].1 - 0.1).abs() < 1e-3);
    }
}

/// <A^T r, s> = ||A^T r||* ||W s||_1: s is a maximiser of its own dual vector.
fn assert_aligned(op: &mut Dense, y: &[f64], norm: &Norm, solution: &Solution, tolerance: f64) {
    let s = &solution.coefficients;
    let r = residual(op, y, s);
    let mut c = vec![0.0; s.len()];
    op.adjoint(&r, &mut c);
    let product: f64 = c.iter().zip(s).map(|(a, b)| a * b).sum();
    let bound = norm.dual(&c) * norm.primal(s);
    assert!((bound - product).abs() <= tolerance * bound, "{product} of {bound}");
    assert!((length(&r) - solution.residual_norm).abs() <= 1e-10 * length(y));
    assert!((norm.primal(s) - solution.norm).abs() <= 1e-12 * solution.norm);
}

#[test]
fn joint_sparsity_recovers_what_one_channel_alone_does_not() {
    // 11 common frequencies from 30 samples a channel: too few for each channel, enough for three that share them.
    let mut rng = Lcg(21);
    let mut order: Vec<usize> = (0..100).collect();
    for i in 0..100 {
        order.swap(i, i + (rng.uniform() * (100 - i) as f64) as usize);
    }
    let one = Dense::dct(100).select(&order[..30]);
    let mut truth = vec![0.0; 300];
    for _ in 0..11 {
        let k = (100.0 * rng.uniform()) as usize;
        (0..3).for_each(|c| truth[100 * c + k] = rng.uniform() - 0.5);
    }
    let mut op = one.channels(3);
    let mut y = vec![0.0; 90];
    op.forward(&truth, &mut y);
    let solve = |norm: Norm, op: &mut Dense| bpdn(op, &y, 0.0, &norm, &tight()).unwrap().coefficients;
    let joint = solve(Norm::group(100, 3, None, None).unwrap(), &mut op);
    let apart = solve(Norm::l1(300), &mut op);
    // Near the limit of what can be recovered the norm is flat: an excess of 1e-5 moves the solution by 4e-3.
    assert_near(&joint, &truth, 1e-2);
    let error = length(&apart.iter().zip(&truth).map(|(a, b)| a - b).collect::<Vec<_>>());
    assert!(error > 0.1 * length(&truth), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn optimality_conditions_hold(
        seed: u64, rows in 1..30usize, kind in 0..4usize, channels in 1..4usize, general: bool,
        fraction in 0.05..0.95f64, exponent in -9..9i32,
    ) {
        let mut rng = Lcg(seed);
        let (fourier, partner) = Dense::fourier(61);
        let mut positions: Vec<usize> = (0..61).collect();
        for i in 0..rows {
            positions.swap(i, i + (rng.uniform() * (61 - i) as f64) as usize);
        }
        let mut op = fourier.select(&positions[..rows]).channels(channels);
        if general {
            // Neither orthonormal rows nor unit norm.
            op.matrix.iter_mut().for_each(|a| *a = 10f64.powi(exponent) * (*a + 0.3 * (rng.uniform() - 0.5)));
        }
        let norm = joint_norms(61, channels, &partner, &mut rng)[kind].clone();
        let y = uniform(rows * channels, &mut rng);
        let sigma = fraction * length(&y);

        let solution = bpdn(&mut op, &y, sigma, &norm, &tight()).unwrap();
        // Ill-conditioned draws run out of steps short of the tolerance.
        prop_assert!(solution.stop == Stop::Converged || solution.gap < 1e-4, "{:?} {}", solution.stop, solution.gap);
        prop_assert!((solution.residual_norm - sigma).abs() <= 1e-6 * sigma);
        assert_aligned(&mut op, &y, &norm, &solution, 5e-3);

        // Over a working set, the same.
        let few = bpdn(&mut WithColumns(&mut op), &y, sigma, &norm, &tight()).unwrap();
        prop_assert!(few.stop == Stop::Converged || few.gap < 1e-4, "{:?} {}", few.stop, few.gap);
        prop_assert!((few.norm - solution.norm).abs() <= 2e-4 * solution.norm, "{} {}", few.norm, solution.norm);
        assert_aligned(&mut op, &y, &norm, &few, 5e-3);

        // The LASSO with that norm as its radius is the same problem.
        let same = lasso(&mut op, &y, solution.norm, &norm, &tight()).unwrap();
        prop_assert!((same.residual_norm - sigma).abs() <= 1e-4 * sigma, "{} {}", same.residual_norm, sigma);
        prop_assert!(same.norm <= solution.norm * (1.0 + 1e-9));
        assert_aligned(&mut op, &y, &norm, &same, 5e-3);
        let few = lasso(&mut WithColumns(&mut op), &y, solution.norm, &norm, &tight()).unwrap();
        prop_assert!((few.residual_norm - sigma).abs() <= 1e-4 * sigma, "{} {}", few.residual_norm, sigma);
    }
}
