//! Inputs at the edges: every solve ends, with finite coefficients and the stated reason.

use super::Operator;
use super::norm::Norm;
use super::spgl1::{Options, Solution, Stop, bpdn, bpdn_from, lasso};
use super::testing::{Dense, Lcg, WithColumns, length, residual};
use crate::base::error::Error;
use proptest::prelude::*;

fn half_sampled(n: usize) -> Dense {
    let mut rng = Lcg(11);
    Dense::dct(n).select(&(0..n).filter(|_| rng.uniform() < 0.5).collect::<Vec<_>>())
}

fn assert_finite(solution: &Solution) {
    assert!(solution.coefficients.iter().all(|v| v.is_finite()), "{solution:?}");
    assert!(!solution.norm.is_nan() && !solution.residual_norm.is_nan() && !solution.gap.is_nan(), "{solution:?}");
}

#[test]
fn bad_arguments_are_refused() {
    let mut op = Dense::dct(4);
    let (y, norm, options) = ([1.0; 4], Norm::l1(4), Options::default());
    let mut refused = vec![
        bpdn(&mut op, &y[..3], 0.0, &norm, &options),
        bpdn(&mut op, &y, 0.0, &Norm::l1(5), &options),
        bpdn_from(&mut op, &y, 0.0, &norm, &options, &[0.0; 3]),
        bpdn_from(&mut op, &y, 0.0, &norm, &options, &[0.0, f64::NAN, 0.0, 0.0]),
    ];
    for bad in [-1.0, -1e-300, f64::NAN, f64::NEG_INFINITY] {
        refused.push(bpdn(&mut op, &y, bad, &norm, &options));
        refused.push(lasso(&mut op, &y, bad, &norm, &options));
        refused.push(bpdn(&mut op, &y, 0.1, &norm, &Options { sigma_tolerance: bad, ..options }));
        refused.push(bpdn(&mut op, &y, 0.1, &norm, &Options { bp_tolerance: bad, ..options }));
        refused.push(bpdn(&mut op, &y, 0.1, &norm, &Options { gap_tolerance: bad, ..options }));
    }
    for result in refused {
        assert!(matches!(result, Err(Error::InvalidArgument(_))));
    }
}

#[test]
fn zero_is_the_answer_where_it_is_feasible() {
    let mut op = Dense::dct(4);
    let (y, norm, options) = ([1.0, -2.0, 0.5, 3.0], Norm::l1(4), Options::default());
    let zero = [
        bpdn(&mut op, &y, length(&y) * (1.0 + 1e-15), &norm, &options).unwrap(),
        bpdn(&mut op, &y, f64::INFINITY, &norm, &options).unwrap(),
        bpdn(&mut op, &[0.0; 4], 0.0, &norm, &options).unwrap(),
        lasso(&mut op, &[0.0; 4], 1.0, &norm, &options).unwrap(),
        lasso(&mut op, &y, 0.0, &norm, &options).unwrap(),
    ];
    for solution in zero {
        assert_eq!(solution.stop, Stop::ZeroIsFeasible);
        assert_eq!(solution.coefficients, [0.0; 4]);
        assert_eq!(solution.gap, 0.0);
    }
}

#[test]
fn no_rows_no_columns_one_row() {
    let options = Options::default();
    let mut none = Dense { cols: 5, matrix: vec![] };
    let solution = bpdn(&mut none, &[], 0.0, &Norm::l1(5), &options).unwrap();
    assert_eq!((solution.stop, solution.coefficients.len()), (Stop::ZeroIsFeasible, 5));
    struct NoColumns;
    impl Operator for NoColumns {
        fn rows(&self) -> usize {
            2
        }
        fn cols(&self) -> usize {
            0
        }
        fn forward(&mut self, _: &[f64], samples: &mut [f64]) {
            samples.fill(0.0);
        }
        fn adjoint(&mut self, _: &[f64], _: &mut [f64]) {}
    }
    let solution = bpdn(&mut NoColumns, &[1.0, 1.0], 0.5, &Norm::l1(0), &options).unwrap();
    assert_eq!((solution.stop, solution.reached_sigma(0.5)), (Stop::LeastSquares, false));
    let mut one = Dense::dct(15).select(&[4]);
    for sigma in [0.0, 1.0] {
        let solution = bpdn(&mut one, &[-7.0], sigma, &Norm::l1(15), &options).unwrap();
        assert_eq!(solution.stop, Stop::Converged);
        assert!(solution.reached_sigma(sigma) && (solution.residual_norm - sigma).abs() < 0.01);
    }
}

#[test]
fn results_scale_with_the_data() {
    let mut op = half_sampled(60);
    let mut rng = Lcg(2);
    let unit: Vec<f64> = (0..op.rows()).map(|_| rng.uniform() - 0.5).collect();
    let reference = bpdn(&mut op, &unit, 0.2, &Norm::l1(60), &Options::default()).unwrap();
    assert_eq!(reference.stop, Stop::Converged);
    for factor in [1e-305, 1e-300, 1e-150, 1e150, 1e300] {
        let y: Vec<f64> = unit.iter().map(|v| v * factor).collect();
        let solution = bpdn(&mut op, &y, 0.2 * factor, &Norm::l1(60), &Options::default()).unwrap();
        assert_eq!(solution.stop, Stop::Converged);
        assert!((solution.norm / factor - reference.norm).abs() < 1e-2 * reference.norm);
        assert!((solution.residual_norm / factor - 0.2).abs() < 1e-3);
        let same = lasso(&mut op, &y, solution.norm, &Norm::l1(60), &Options::default()).unwrap();
        assert!((same.residual_norm / factor - 0.2).abs() < 0.01);
    }
}

#[test]
fn constant_and_alternating_samples() {
    let mut op = half_sampled(60);
    let n = op.rows();
    for y in [vec![3.0; n], (0..n).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }).collect()] {
        for relative in [0.0, 1e-6, 0.5, 1.0 - 1e-12] {
            let sigma = relative * length(&y);
            let solution = bpdn(&mut op, &y, sigma, &Norm::l1(60), &Options::default()).unwrap();
            assert_finite(&solution);
            assert!(solution.reached_sigma(sigma), "{relative}: {:?}", solution.stop);
        }
    }
    let solution = bpdn(&mut op, &vec![3.0; n], 0.0, &Norm::l1(60), &Options::default()).unwrap();
    assert!((solution.coefficients[0] / (3.0 * 60f64.sqrt()) - 1.0).abs() < 1e-4);
}

#[test]
fn huge_beside_tiny() {
    let mut op = half_sampled(60);
    let y: Vec<f64> = (0..op.rows()).map(|i| if i == 7 { 1e5 } else { 1e-9 }).collect();
    let weights: Vec<f64> = (0..60).map(|i| 10f64.powi(i % 13 - 6)).collect();
    for norm in [Norm::l1(60), Norm::new(60, Some(&weights), None).unwrap()] {
        for sigma in [0.0, 1e-3, 10.0] {
            let solution = bpdn(&mut op, &y, sigma, &norm, &Options::default()).unwrap();
            assert_finite(&solution);
            let r = residual(&mut op, &y, &solution.coefficients);
            assert!((length(&r) - solution.residual_norm).abs() <= 1e-6);
        }
    }
}

#[test]
fn what_is_not_finite_stops_with_zeros() {
    let mut op = Dense::dct(4);
    for bad in [[1.0, f64::NAN, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0, 1.0], [f64::MAX; 4]] {
        for solution in [
            bpdn(&mut op, &bad, 0.1, &Norm::l1(4), &Options::default()).unwrap(),
            lasso(&mut op, &bad, 0.1, &Norm::l1(4), &Options::default()).unwrap(),
        ] {
            assert_eq!(solution.stop, Stop::NotFinite);
            assert_eq!(solution.coefficients, [0.0; 4]);
            assert!(!solution.reached_sigma(1e300));
        }
    }
}

/// An operator that turns bad after some transforms.
struct Failing {
    inner: Dense,
    left: usize,
    value: f64,
}

impl Operator for Failing {
    fn rows(&self) -> usize {
        self.inner.rows()
    }

    fn cols(&self) -> usize {
        self.inner.cols()
    }

    fn forward(&mut self, coefficients: &[f64], samples: &mut [f64]) {
        self.inner.forward(coefficients, samples);
        self.left = self.left.saturating_sub(1);
        if self.left == 0 {
            samples[0] = self.value;
        }
    }

    fn adjoint(&mut self, samples: &[f64], coefficients: &mut [f64]) {
        self.inner.adjoint(samples, coefficients);
        self.left = self.left.saturating_sub(1);
        if self.left == 0 {
            coefficients[0] = self.value;
        }
    }
}

#[test]
fn a_failing_operator_stops_with_the_best_finite_point() {
    let inner = || half_sampled(60);
    let mut rng = Lcg(2);
    let y: Vec<f64> = (0..inner().rows()).map(|_| rng.uniform() - 0.5).collect();
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for left in 1..12 {
            let mut op = Failing { inner: inner(), left, value };
            let solution = bpdn(&mut op, &y, 0.01, &Norm::l1(60), &Options::default()).unwrap();
            assert_eq!(solution.stop, Stop::NotFinite, "{value} {left}");
            assert_finite(&solution);
            assert!(solution.residual_norm <= length(&y) * (1.0 + 1e-15));
            let mut op = Failing { inner: inner(), left, value };
            assert_finite(&lasso(&mut op, &y, 0.5, &Norm::l1(60), &Options::default()).unwrap());
        }
    }
}

#[test]
fn samples_out_of_range_give_least_squares() {
    // Two rows that contradict each other: no s has a residual below 1 / sqrt 2.
    let mut op = Dense { cols: 3, matrix: vec![1.0, 2.0, 0.5, 1.0, 2.0, 0.5] };
    let solution = bpdn(&mut op, &[1.0, 2.0], 0.1, &Norm::l1(3), &Options::default()).unwrap();
    assert_eq!(solution.stop, Stop::LeastSquares);
    assert!(!solution.reached_sigma(0.1) && (solution.residual_norm - 0.5f64.sqrt()).abs() < 1e-6);
    let solution = lasso(&mut op, &[1.0, 2.0], 100.0, &Norm::l1(3), &Options::default()).unwrap();
    assert!((solution.residual_norm - 0.5f64.sqrt()).abs() < 1e-6, "{solution:?}");
    // Orthogonal to all columns.
    let solution = bpdn(&mut op, &[1.0, -1.0], 0.1, &Norm::l1(3), &Options::default()).unwrap();
    assert_eq!((solution.stop, solution.norm), (Stop::LeastSquares, 0.0));
}

#[test]
fn more_iterations_are_never_worse() {
    never_worse(&mut half_sampled(120));
    let mut few = Dense::dct(120).select(&(0..120).step_by(5).collect::<Vec<_>>());
    never_worse(&mut WithColumns(&mut few));
}

fn never_worse(op: &mut dyn Operator) {
    let mut rng = Lcg(9);
    let y: Vec<f64> = (0..op.rows()).map(|_| rng.uniform() - 0.5).collect();
    for (sigma, tau) in [(0.0, 0.3), (0.05, 2.0), (0.5, 6.0)] {
        let mut last: Option<(Solution, Solution)> = None;
        for max_iterations in 0..150 {
            let options = Options { max_iterations, gap_tolerance: 1e-6, ..Options::default() };
            let denoise = bpdn(op, &y, sigma, &Norm::l1(120), &options).unwrap();
            let within = lasso(op, &y, tau, &Norm::l1(120), &options).unwrap();
            assert!(denoise.iterations <= max_iterations && within.iterations <= max_iterations);
            if let Some((before, within_before)) = last {
                if before.reached_sigma(sigma) {
                    assert!(denoise.reached_sigma(sigma) && denoise.norm <= before.norm);
                    assert!(denoise.gap <= before.gap);
                } else {
                    assert!(denoise.residual_norm <= before.residual_norm);
                }
                assert!(within.residual_norm <= within_before.residual_norm);
            }
            last = Some((denoise, within));
        }
        assert!(sigma == 0.0 || last.unwrap().0.reached_sigma(sigma));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn any_samples_end_with_finite_coefficients(
        y in prop::collection::vec(prop_oneof![any::<f64>(), -1.0..1.0f64, Just(0.0), Just(5e-324), Just(1e300)], 8),
        sigma in prop_oneof![Just(0.0), 0.0..2.0f64, 1e-320..1e300f64],
        weights in prop::collection::vec(prop_oneof![Just(1.0), 1e-100..1e100f64, Just(1e-100), Just(1e100)], 16),
        paired: bool,
    ) {
        let mut op = Dense::dct(16).select(&[0, 1, 4, 5, 9, 11, 12, 15]);
        let weights: Vec<f64> = (0..16).map(|i| weights[i / 2]).collect();
        let partner: Vec<u32> = (0..16).map(|i| i ^ 1).collect();
        let norm = Norm::new(16, Some(&weights), paired.then_some(&partner)).unwrap();
        let options = Options { max_iterations: 200, ..Options::default() };
        assert_finite(&bpdn(&mut op, &y, sigma, &norm, &options).unwrap());
        assert_finite(&lasso(&mut op, &y, sigma, &norm, &options).unwrap());
        assert_finite(&bpdn_from(&mut op, &y, sigma, &norm, &options, &[0.25; 16]).unwrap());
        let mut op = WithColumns(&mut op);
        assert_finite(&bpdn(&mut op, &y, sigma, &norm, &options).unwrap());
        assert_finite(&lasso(&mut op, &y, sigma, &norm, &options).unwrap());
        assert_finite(&bpdn_from(&mut op, &y, sigma, &norm, &options, &[0.25; 16]).unwrap());
    }
}
