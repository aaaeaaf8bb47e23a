//! Agreement with the published algorithm: the PyPI package `spgl1` on problems that both sides generate from the same
//! formulas (`tools/spgl1_reference.py` says which, and what the columns of its results are).

use super::norm::Norm;
use super::spgl1::{Options, bpdn};
use super::testing::{BlockDct, Lcg, length};

const REFERENCE: &str = include_str!("../../tests/data/spgl1_reference.txt");

/// The values of a block, first axis slowest.
fn block(kind: &str, rng: &mut Lcg) -> Vec<f64> {
    let value = |p: usize| {
        let (i, j, k) = ((p / 225) as f64 / 14.0, (p / 15 % 15) as f64 / 14.0, (p % 15) as f64 / 14.0);
        let lobe = 1.0 / (0.05 + i * i + 0.3 * (j - 0.4) * (j - 0.4));
        lobe + 2.0 * j * k - 3.0 * k * k * (1.0 - k) + 1.0
    };
    let mut values: Vec<f64> = (0..3375).map(value).collect();
    match kind {
        "smooth" => {}
        "noisy" => values.iter_mut().for_each(|v| *v += rng.uniform() - 0.5),
        "spiky" => {
            for _ in 0..60 {
                let at = (rng.uniform() * 3375.0) as usize;
                values[at] += 20.0 * (rng.uniform() - 0.5);
            }
        }
        other => panic!("unknown block {other}"),
    }
    values
}

/// 1 + |k|
fn frequency_weights() -> Vec<f64> {
    let weight = |p: usize| {
        let (i, j, k) = ((p / 225) as f64, (p / 15 % 15) as f64, (p % 15) as f64);
        1.0 + (i * i + j * j + k * k).sqrt()
    };
    (0..3375).map(weight).collect()
}

#[test]
fn norm_equals_that_of_spgl1_at_equal_residual() {
    let mut problems = 0;
    let (mut steps, mut reference_steps) = (0, 0);
    for line in REFERENCE.lines().filter(|l| !l.starts_with('#')) {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let [kind, ratio, factor, weights, rows, y_norm, l1, reached, iterations, _] = fields[..] else {
            panic!("bad line: {line}")
        };
        let number = |text: &str| text.parse::<f64>().unwrap();
        let mut rng = Lcg(1);
        let values = block(kind, &mut rng);
        let positions: Vec<usize> = (0..3375).filter(|_| rng.uniform() < number(ratio)).collect();
        let y: Vec<f64> = positions.iter().map(|&p| values[p]).collect();
        assert_eq!(y.len() as f64, number(rows), "{line}");
        assert!((length(&y) - number(y_norm)).abs() < 1e-9 * number(y_norm), "{line}");
        let weights = (weights == "frequency").then(frequency_weights);
        let norm = Norm::new(3375, weights.as_deref(), None).unwrap();
        let mut op = BlockDct::new(positions);

        // At equal residual, to the last digit that the reference gives.
        let mut options = Options::default();
        (options.sigma_tolerance, options.bp_tolerance, options.gap_tolerance) = (1e-5, 1e-7, 1e-3);
        options.max_iterations = 3000;
        let sigma = number(reached);
        let solution = bpdn(&mut op, &y, sigma, &norm, &options).unwrap();
        assert!(solution.reached_sigma(sigma), "{line}: {:?} {}", solution.stop, solution.residual_norm);
        let error = (solution.norm - number(l1)) / number(l1);
        assert!(error.abs() < 1e-3, "{line}: norm {}, residual {}", solution.norm, solution.residual_norm);

        // At the reference's default tolerances, in not more steps all in all.
        let sigma = number(factor) * length(&y);
        (options.sigma_tolerance, options.bp_tolerance, options.gap_tolerance) = (0.0, 1e-4, f64::INFINITY);
        let solution = bpdn(&mut op, &y, sigma, &norm, &options).unwrap();
        assert!(solution.reached_sigma(sigma), "{line}");
        steps += solution.iterations;
        reference_steps += iterations.parse::<usize>().unwrap();
        problems += 1;
    }
    assert_eq!(problems, 9);
    assert!(steps <= reference_steps, "{steps} steps, spgl1 {reference_steps}");
}
