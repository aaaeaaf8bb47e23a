//! Debiasing: least squares on the support that an l1 solution found.
//!
//! The l1 norm pulls every coefficient towards zero. Once it has chosen the support, its work is done, and the samples
//! alone can say how large the coefficients are: min ||y - A s||_2 over the s that are zero where the solution is.
//! Solved by conjugate gradients (CGLS: Hestenes & Stiefel 1952; Bjorck 1996, section 7.4) from the solution itself, so
//! where the support has more coefficients than there are samples, the nearest of all minimisers is found.

use super::Operator;
use super::norm::Norm;
use super::spgl1::{Solution, Stop, invalid, normalize};
use super::vector::{dot, max_abs, scale, subtract_from};
use crate::base::error::Result;
use std::time::Instant;

/// When to stop, and what counts as support.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Options {
    /// Conjugate gradient steps at most; each is one forward and one adjoint transform. Default 50.
    pub max_iterations: usize,
    /// Groups are support if their magnitude is above this fraction of the largest one. From 0 to 1; default 1e-6.
    pub threshold: f64,
    /// Converged when the gradient on the support is this small, relative to A^T y there. Above 0; default 1e-6.
    pub tolerance: f64,
}

impl Default for Options {
    fn default() -> Self {
        Options { max_iterations: 50, threshold: 1e-6, tolerance: 1e-6 }
    }
}

/// Fits `coefficients`, a solution for `y` in `norm`, to the samples on its support.
///
/// The residual is never above that of `coefficients`: if rounding or a non-linear operator should make it so, they
/// come back as they are, without the groups below the threshold only if that too keeps the residual. In the result,
/// `gap` is the gradient on the support relative to A^T y there, and `stop` is `Converged`, `IterationLimit`,
/// `ZeroIsFeasible` (no support), `LineSearchFailed` (no further progress) or `NotFinite`.
///
/// # Errors
/// `InvalidArgument` where sizes differ, coefficients are not finite or options are out of range.
pub fn debias<O: Operator + ?Sized>(
    op: &mut O,
    y: &[f64],
    norm: &Norm,
    coefficients: &[f64],
    options: &Options,
) -> Result<Solution> {
    // Long on purpose: conjugate gradients over supports that shrink; each step uses what the one before left. They are CGLS on residuals,
    // not the normal equations of the trend nor the fixed steps in single precision of the grazing profile.
    let begin = Instant::now();
    if y.len() != op.rows() || norm.cols() != op.cols() || coefficients.len() != norm.cols() {
        return invalid(format!(
            "{} samples, {} coefficients and a norm of {} for an operator of {} by {}",
            y.len(),
            coefficients.len(),
            norm.cols(),
            op.rows(),
            op.cols()
        ));
    }
    let Options { max_iterations, threshold, tolerance } = *options;
    if !((0.0..=1.0).contains(&threshold) && tolerance > 0.0) {
        return invalid(format!("threshold {threshold} must be from 0 to 1 and tolerance {tolerance} positive"));
    }
    if !max_abs(coefficients).is_finite() {
        return invalid("coefficients must be finite".to_string());
    }
    let mut unit = Vec::new();
    let length = normalize(y, &mut unit);
    let start: Vec<f64> = coefficients.iter().map(|v| if length > 0.0 { v / length } else { 0.0 }).collect();
    let solution = |s: Vec<f64>, residual: f64, gap: f64, iterations: usize, transforms: usize, stop: Stop| Solution {
        norm: norm.primal(&s),
        coefficients: s,
        residual_norm: residual,
        gap,
        iterations,
        transforms,
        seconds: begin.elapsed().as_secs_f64(),
        stop,
        tolerance: 0.0,
    };
    if !length.is_finite() || !max_abs(&start).is_finite() {
        return Ok(solution(coefficients.to_vec(), f64::INFINITY, f64::INFINITY, 0, 0, Stop::NotFinite));
    }

    let support = norm.support(&start, threshold);
    let restrict = |v: &mut [f64]| support.iter().zip(v).filter(|(keep, _)| !**keep).for_each(|(_, v)| *v = 0.0);
    let residual_of = |op: &mut O, s: &[f64], r: &mut Vec<f64>| {
        op.forward(s, r);
        subtract_from(&unit, r);
        dot(r, r).sqrt()
    };
    let (mut r, mut z) = (vec![0.0; y.len()], vec![0.0; start.len()]);
    let before = residual_of(op, &start, &mut r);
    op.adjoint(&unit, &mut z);
    restrict(&mut z);
    let scale_of_gradient = dot(&z, &z).sqrt();
    if !before.is_finite() || !scale_of_gradient.is_finite() {
        return Ok(solution(coefficients.to_vec(), f64::INFINITY, f64::INFINITY, 0, 2, Stop::NotFinite));
    }
    if scale_of_gradient == 0.0 {
        return Ok(solution(coefficients.to_vec(), before * length, 0.0, 0, 2, Stop::ZeroIsFeasible));
    }

    let mut s = start.clone();
    restrict(&mut s);
    residual_of(op, &s, &mut r);
    op.adjoint(&r, &mut z);
    restrict(&mut z);
    let (mut direction, mut image) = (z.clone(), vec![0.0; y.len()]);
    let mut square = dot(&z, &z);
    let (mut iterations, mut transforms) = (0, 4);
    let stop = loop {
        if square.sqrt() <= tolerance * scale_of_gradient {
            break Stop::Converged;
        }
        if iterations >= max_iterations {
            break Stop::IterationLimit;
        }
        op.forward(&direction, &mut image);
        let step = square / dot(&image, &image);
        if !(step.is_finite() && step > 0.0) {
            break if step.is_nan() { Stop::NotFinite } else { Stop::LineSearchFailed };
        }
        s.iter_mut().zip(&direction).for_each(|(s, d)| *s += step * d);
        r.iter_mut().zip(&image).for_each(|(r, q)| *r -= step * q);
        op.adjoint(&r, &mut z);
        restrict(&mut z);
        let next = dot(&z, &z);
        iterations += 1;
        transforms += 2;
        if !next.is_finite() {
            break Stop::NotFinite;
        }
        direction.iter_mut().zip(&z).for_each(|(d, z)| *d = z + next / square * *d);
        square = next;
    };
    // The recurrence drifts from the true residual by rounding; what is returned is computed afresh.
    let after = residual_of(op, &s, &mut r);
    transforms += 1;
    scale(&mut s, length);
    if after <= before && max_abs(&s).is_finite() {
        return Ok(solution(s, after * length, square.sqrt() / scale_of_gradient, iterations, transforms, stop));
    }
    let stop = if after.is_finite() { Stop::LineSearchFailed } else { Stop::NotFinite };
    Ok(solution(coefficients.to_vec(), before * length, f64::INFINITY, iterations, transforms, stop))
}

#[cfg(test)]
mod tests {
    use super::super::spgl1;
    use super::super::testing::{Dense, Lcg, length, residual};
    use super::*;
    use proptest::prelude::*;

    fn tight() -> Options {
        Options { max_iterations: 500, tolerance: 1e-10, ..Options::default() }
    }

    #[test]
    fn full_sampling_gives_the_spectrum_on_the_support() {
        // Orthonormal columns: one step, and the closed form.
        let mut op = Dense::dct(40);
        let mut rng = Lcg(4);
        let y: Vec<f64> = (0..40).map(|_| rng.uniform() - 0.5).collect();
        let mut spectrum = vec![0.0; 40];
        op.adjoint(&y, &mut spectrum);
        let norm = Norm::l1(40);
        let found = spgl1::bpdn(&mut op, &y, 0.6 * length(&y), &norm, &spgl1::Options::default()).unwrap();
        let fitted = debias(&mut op, &y, &norm, &found.coefficients, &tight()).unwrap();
        assert_eq!((fitted.stop, fitted.iterations), (Stop::Converged, 1));
        for ((&was, &is), &whole) in found.coefficients.iter().zip(&fitted.coefficients).zip(&spectrum) {
            assert!((is - if was == 0.0 { 0.0 } else { whole }).abs() < 1e-12);
        }
    }

    #[test]
    fn noise_averages_out_once_the_bias_is_gone() {
        let mut rng = Lcg(8);
        let rows: Vec<usize> = (0..256).filter(|_| rng.uniform() < 0.4).collect();
        let mut op = Dense::dct(256).select(&rows);
        let mut truth = vec![0.0; 256];
        for _ in 0..10 {
            let k = (256.0 * rng.uniform()) as usize;
            truth[k] = 1.0 + rng.uniform();
        }
        let mut y = vec![0.0; rows.len()];
        op.forward(&truth, &mut y);
        y.iter_mut().for_each(|v| *v += 0.3 * (rng.uniform() - 0.5));
        let norm = Norm::l1(256);
        let sigma = 0.3 / 12f64.sqrt() * (rows.len() as f64).sqrt();
        let found = spgl1::bpdn(&mut op, &y, sigma, &norm, &spgl1::Options::default()).unwrap();
        let options = Options { threshold: 0.3, ..tight() };
        let fitted = debias(&mut op, &y, &norm, &found.coefficients, &options).unwrap();
        let error = |s: &[f64]| length(&s.iter().zip(&truth).map(|(a, b)| a - b).collect::<Vec<_>>());
        assert!(1.5 * error(&fitted.coefficients) < error(&found.coefficients));
    }

    #[test]
    fn edges_are_answered() {
        let mut op = Dense::dct(4);
        let (y, norm) = ([1.0, 2.0, -1.0, 0.5], Norm::l1(4));
        for (y, s, stop) in [
            (y, [0.0; 4], Stop::ZeroIsFeasible),
            ([0.0; 4], [1.0; 4], Stop::ZeroIsFeasible),
            ([f64::NAN, 0.0, 0.0, 1.0], [1.0; 4], Stop::NotFinite),
            ([f64::INFINITY; 4], [1.0; 4], Stop::NotFinite),
            ([5e-324; 4], [1e300; 4], Stop::NotFinite),
            (y.map(|v| 1e300 * v), [1e-300; 4], Stop::ZeroIsFeasible),
            (y.map(|v| 1e300 * v), [1e290; 4], Stop::Converged),
            (y.map(|v| 1e-300 * v), [1e-300; 4], Stop::Converged),
        ] {
            let fitted = debias(&mut op, &y, &norm, &s, &Options::default()).unwrap();
            assert_eq!(fitted.stop, stop, "{y:?} {s:?}");
            assert!(fitted.coefficients.iter().all(|v| v.is_finite()));
        }
        assert!(debias(&mut op, &y, &norm, &[1.0; 3], &Options::default()).is_err());
        assert!(debias(&mut op, &y, &norm, &[f64::NAN; 4], &Options::default()).is_err());
        assert!(debias(&mut op, &y, &norm, &[1.0; 4], &Options { threshold: 2.0, ..tight() }).is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        #[test]
        fn least_squares_on_the_support_and_never_worse(
            seed: u64, rows in 2..40usize, nonzero in 1..30usize, steps in 0..20usize, channels in 1..3usize,
        ) {
            let mut rng = Lcg(seed);
            let mut op = Dense::dct(40).select(&(0..rows).map(|i| 7 * i % 40).collect::<Vec<_>>()).channels(channels);
            let norm = Norm::group(40, channels, None, None).unwrap();
            let mut s = vec![0.0; 40 * channels];
            for _ in 0..nonzero {
                let k = (40.0 * rng.uniform()) as usize;
                (0..channels).for_each(|c| s[40 * c + k] = rng.uniform() - 0.5);
            }
            let y: Vec<f64> = (0..rows * channels).map(|_| rng.uniform() - 0.5).collect();
            let before = length(&residual(&mut op, &y, &s));
            let few = debias(&mut op, &y, &norm, &s, &Options { max_iterations: steps, ..tight() }).unwrap();
            prop_assert!(few.residual_norm <= before * (1.0 + 1e-14) && few.iterations <= steps);
            let fitted = debias(&mut op, &y, &norm, &s, &tight()).unwrap();
            prop_assert!(fitted.residual_norm <= few.residual_norm * (1.0 + 1e-9));
            let r = residual(&mut op, &y, &fitted.coefficients);
            prop_assert!((length(&r) - fitted.residual_norm).abs() <= 1e-12 * (length(&y) + length(&fitted.coefficients)));
            let mut gradient = vec![0.0; s.len()];
            op.adjoint(&r, &mut gradient);
            for i in 0..s.len() {
                let inside = (0..channels).any(|c| s[i % 40 + 40 * c] != 0.0);
                prop_assert!(inside || fitted.coefficients[i] == 0.0);
                let flat = fitted.stop != Stop::Converged || gradient[i].abs() <= 1e-8 * length(&y);
                prop_assert!(!inside || flat, "{} {:?}", gradient[i], fitted.stop);
            }
        }
    }
}
