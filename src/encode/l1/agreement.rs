//! Agreement with the published algorithm: the PyPI package `spgl1` on problems that both sides generate from the same
//! formulas (`tools/spgl1_reference.py` says which, and what the columns of its results are).

use super::norm::Norm;
use super::sampled::{Columns, SampledBasis};
use super::spgl1::{Options, bpdn};
use super::testing::{Lcg, length};
use crate::codec::fourier::forward::Transform;
use crate::codec::fourier::{Basis, partners};

const SHAPE: [usize; 4] = [1, 15, 15, 15];
const REFERENCE: &str = include_str!("../../../tests/data/spgl1_reference.txt");

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
        "stiff" => {
            for (p, v) in values.iter_mut().enumerate() {
                let (i, j, k) = ((p / 225) as f64 / 14.0, (p / 15 % 15) as f64 / 14.0, (p % 15) as f64 / 14.0);
                *v = 0.1 * *v + if (3.0 * i + 2.0 * j + k) * 14.0 > 42.0 { 11.5 } else { -11.5 };
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
    let (mut transforms, mut reference_transforms) = (0, 0);
    let bases = [Basis::Dct, Basis::Dft].map(|basis| (Transform::new(basis, SHAPE), Columns::new(basis, SHAPE)));
    let [mut dct, mut dft] = bases;
    for line in REFERENCE.lines().filter(|l| !l.starts_with('#')) {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let [basis, kind, holes, ratio, factor, weights, rows, y_norm, l1, reached, _, theirs] = fields[..] else {
            panic!("bad line: {line}")
        };
        let number = |text: &str| text.parse::<f64>().unwrap();
        let mut rng = Lcg(1);
        let values = block(kind, &mut rng);
        let inside = |p: u32| holes == "full" || p / 225 + p / 15 % 15 <= 18;
        let positions: Vec<u32> = (0..3375).filter(|&p| rng.uniform() < number(ratio) && inside(p)).collect();
        let channels = if basis == "mmv" { 3 } else { 1 };
        let y: Vec<f64> = (0..channels)
            .flat_map(|c| positions.iter().map(move |&p| (c, p as usize)))
            .map(|(c, p)| match c {
                0 => values[p],
                1 => values[p] + 0.5 * (p / 225) as f64 / 14.0,
                _ => 0.5 * values[p] + (p % 15) as f64 / 14.0,
            })
            .collect();
        assert_eq!(positions.len() as f64, number(rows), "{line}");
        assert!((length(&y) - number(y_norm)).abs() < 1e-9 * number(y_norm), "{line}");
        let weights = (weights == "frequency").then(frequency_weights);
        let partner = (basis == "dft").then(|| partners(SHAPE));
        let norm = Norm::group(3375, channels, weights.as_deref(), partner.as_deref()).unwrap();
        let (transform, columns) = if basis == "dft" { &mut dft } else { &mut dct };
        let mut op = SampledBasis::new(transform, vec![&positions; channels]).with_columns(columns);

        // At equal residual, to the last digit that the reference gives.
        let mut options = Options::default();
        (options.sigma_tolerance, options.bp_tolerance, options.gap_tolerance) = (1e-5, 1e-7, 1e-3);
        options.max_iterations = 20_000;
        let sigma = number(reached);
        let solution = bpdn(&mut op, &y, sigma, &norm, &options).unwrap();
        assert!(solution.reached_sigma(sigma), "{line}: {:?} {}", solution.stop, solution.residual_norm);
        let error = (solution.norm - number(l1)) / number(l1);
        assert!(error.abs() < 1e-3, "{line}: norm {}, residual {}", solution.norm, solution.residual_norm);

        // At the reference's default tolerances, in fewer transforms all in all.
        let sigma = number(factor) * length(&y);
        // Its tolerance is one of the samples' norm.
        (options.sigma_tolerance, options.gap_tolerance) = (1e-4 / number(factor), f64::INFINITY);
        let solution = bpdn(&mut op, &y, sigma, &norm, &options).unwrap();
        assert!(solution.reached_sigma(sigma), "{line}");
        transforms += solution.transforms;
        reference_transforms += theirs.parse::<usize>().unwrap();
        problems += 1;
    }
    assert_eq!(problems, 20);
    assert!(2 * transforms <= reference_transforms, "{transforms} transforms, spgl1 {reference_transforms}");
}
