//! Time of the encoder's transforms: microseconds a block and the share of the machine's peak.
//!
//! `cargo bench --bench transform`. The columns at 5 % analyse from samples and synthesise samples alone; the copy that
//! a solver makes of its coefficients is counted.
//!
//! Before the dense products (commit 9de692b), analyze / synthesize: 15x15x15 DFT 26 / 29, DCT 54 / 34; 10x10x20 14 / 14,
//! 15 / 18; 6x6x18 2.1 / 2.2, 3.4 / 4.5; 9x9x36 8.6 / 8.5, 17 / 19; 6x10x60 16 / 15, 22 / 25; 10x15x60 48 / 47, 66 / 69;
//! 15x15x60 66 / 65, 103 / 106; 10x15x180 139 / 138, 185 / 208; 30x30x60 235 / 233, 488 / 813.
//! The share of peak counts one fold a line, so more folds and FFTs of long axes are credited with work they save.

use std::hint::black_box;
use std::time::Instant;

use csbrdf::codec::fourier::Basis;
use csbrdf::codec::fourier::forward::Transform;

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

/// What the machine's vector units can do with data in registers; on AMD Zen 4 the wider AVX-512 does no more.
fn peak_gflops() -> f64 {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
        // SAFETY: the features are there.
        #[allow(unsafe_code)]
        return unsafe { peak_avx2() };
    }
    f64::NAN
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn peak_avx2() -> f64 {
    use std::arch::x86_64::{__m256d, _mm256_fmadd_pd, _mm256_set1_pd};
    #[target_feature(enable = "avx2,fma")]
    fn chains(mut sums: [__m256d; 10], a: __m256d, b: __m256d) -> [__m256d; 10] {
        for _ in 0..1000 {
            let [s0, s1, s2, s3, s4, s5, s6, s7, s8, s9] = sums;
            let next = |s| _mm256_fmadd_pd(s, a, b);
            sums = [next(s0), next(s1), next(s2), next(s3), next(s4), next(s5), next(s6), next(s7), next(s8), next(s9)];
        }
        sums
    }
    let (a, b) = (_mm256_set1_pd(black_box(0.999)), _mm256_set1_pd(black_box(1e-3)));
    let mut sums = [b; 10];
    let time = microseconds(|| sums = black_box(chains(black_box(sums), a, b)));
    1000.0 * 10.0 * 4.0 * 2.0 / time / 1e3
}

/// Operations of dense products without zeros or structure but for one fold of each line: n^2 / 2 multiply-adds.
fn folded_operations(shape: [usize; 4]) -> f64 {
    let values: usize = shape.iter().product();
    shape.iter().filter(|&&n| n > 1).map(|&n| (values * n) as f64).sum()
}

fn main() {
    let peak = peak_gflops();
    println!("peak {peak:.1} GFLOP/s");
    println!(
        "{:>11} {:>5} {:>8} {:>8} {:>8} {:>8} {:>7} {:>6}",
        "shape", "basis", "analyze", "synth.", "an. 5 %", "sy. 5 %", "GFLOP/s", "peak"
    );
    for shape in SHAPES {
        for basis in [Basis::Dft, Basis::Dct] {
            let mut transform = Transform::new(basis, shape);
            let n = transform.positions();
            let values: Vec<f64> = (0..n).map(|i| ((i * 7919) % 101) as f64 / 101.0).collect();
            let positions: Vec<u32> = (0..n as u32).filter(|p| p.wrapping_mul(2654435761) % 1000 < 50).collect();
            let mut samples = values[..positions.len()].to_vec();
            let mut block = values.clone();
            let analyze = microseconds(|| transform.analyze(black_box(&mut block)));
            block.copy_from_slice(&values);
            let synthesize = microseconds(|| transform.synthesize(black_box(&mut block)));
            let few = microseconds(|| transform.analyze_samples(&positions, &samples, black_box(&mut block)));
            let few_back = microseconds(|| {
                block.copy_from_slice(&values);
                transform.synthesize_samples(black_box(&mut block), &positions, &mut samples);
            });
            let name = shape[1..].iter().map(|n| n.to_string()).collect::<Vec<_>>().join("x");
            let rate = 2.0 * folded_operations(shape) / (analyze + synthesize) / 1e3;
            let share = 100.0 * rate / peak;
            println!(
                "{name:>11} {:>5} {analyze:>8.2} {synthesize:>8.2} {few:>8.2} {few_back:>8.2} {rate:>7.1} {share:>5.0}%",
                basis.as_str()
            );
        }
    }
}
