//! Time of the encoder's transforms: microseconds a block and the share of the machine's peak.
//!
//! `cargo bench --bench transform [shape ...]`, a shape being lengths joined by `x`.

use std::hint::black_box;
use std::time::Instant;

use csbrdf::fourier::Basis;
use csbrdf::fourier::forward::Transform;

const SHAPES: [[usize; 4]; 9] = [
    [1, 15, 15, 15],
    [1, 10, 10, 20],
    [1, 6, 6, 18],
    [1, 9, 9, 36],
    [1, 6, 10, 60],
    [1, 10, 15, 60],
    [1, 15, 15, 60],
    [1, 10, 15, 180],
    [1, 30, 30, 60],
];

/// Best of 15 rounds of about 2 ms: others may use the machine at the same time.
fn microseconds(mut work: impl FnMut()) -> f64 {
    let begin = Instant::now();
    work();
    let once = begin.elapsed().as_secs_f64().max(1e-7);
    let repeats = (2e-3 / once).ceil() as usize;
    let round = |_| {
        let begin = Instant::now();
        (0..repeats).for_each(|_| work());
        begin.elapsed().as_secs_f64() / repeats as f64
    };
    (0..15).map(round).fold(f64::INFINITY, f64::min) * 1e6
}

fn main() {
    println!("{:>14} {:>5} {:>10} {:>10}", "shape", "basis", "analyze", "synthesize");
    for shape in SHAPES {
        for basis in [Basis::Dft, Basis::Dct] {
            let mut transform = Transform::new(basis, shape);
            let n = transform.positions();
            let values: Vec<f64> = (0..n).map(|i| ((i * 7919) % 101) as f64 / 101.0).collect();
            let mut block = values.clone();
            let analyze = microseconds(|| transform.analyze(black_box(&mut block)));
            block.copy_from_slice(&values);
            let synthesize = microseconds(|| transform.synthesize(black_box(&mut block)));
            let name = shape[1..].iter().map(|n| n.to_string()).collect::<Vec<_>>().join("x");
            println!("{name:>14} {:>5} {analyze:>10.2} {synthesize:>10.2}", basis.as_str());
        }
    }
}
