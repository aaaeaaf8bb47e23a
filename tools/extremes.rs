//! Tables of what comes of stiff and extreme blocks and tables: `cargo run --release --example extremes`
//!
//! First the solver's answers. Blocks of 15 x 15 x 15, DCT basis, plain l1 norm. Per block: why the solver stopped, iterations,
//! the residual over sigma (over the norm of the samples where sigma is 0), the rms error of the rebuilt block against the
//! truth over the rms of the truth, the same when only 4 iterations were allowed, and the largest difference, over the
//! largest value, when the samples are rounded to binary32 before the solve and the coefficients after it.
//!
//! Then the tables of tests/extremes.rs through encoder and decoder: errors of ln(f + 0.001) over the valid entries, with what the
//! test allows where every entry is a sample, bytes of the file, milliseconds of the encode.

#[path = "../tests/common/extreme_tables.rs"]
mod extreme_tables;

use csbrdf::assess::metrics::compare;
use csbrdf::codec::fourier::Basis;
use csbrdf::codec::fourier::forward::Transform;
use csbrdf::codec::sample::SplitMix64;
use csbrdf::decode::Reader;
use csbrdf::encode::Encoder;
use csbrdf::encode::l1::norm::Norm;
use csbrdf::encode::l1::sampled::{Columns, SampledBasis};
use csbrdf::encode::l1::spgl1::{Options, Solution, Solver};
use csbrdf::table::BrdfTable;

const N: usize = 15;
const SHAPE: [usize; 4] = [1, N, N, N];
const SIZE: usize = N * N * N;

type Failure = Box<dyn std::error::Error>;

/// What is solved: the block, where it is sampled, the bound on the rms residual.
struct Case {
    name: &'static str,
    truth: Vec<f64>,
    positions: Vec<u32>,
    sigma_rms: f64,
}

fn main() -> Result<(), Failure> {
    println!("| block | stop | iterations | residual | error | error after 4 | f32 to f64 |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let mut bench = Bench {
        transform: Transform::new(Basis::Dct, SHAPE),
        columns: Columns::new(Basis::Dct, SHAPE),
        norm: Norm::l1(SIZE),
        solver: Solver::default(),
    };
    for case in cases() {
        bench.row(&case)?;
    }
    println!("\n| table | settings | log max, at most | log max | log rms | bytes | ms |");
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    for case in extreme_tables::cases() {
        for (setting, encoder, every_entry) in extreme_tables::settings() {
            let stated = if every_entry { shown(case.log_max) } else { "-".into() };
            println!("| {} | {setting} | {stated} | {} |", case.name, outcome(&case.table, &encoder));
        }
    }
    Ok(())
}

/// The columns of a table's row: what came of it, or why nothing did.
fn outcome(table: &BrdfTable, encoder: &Encoder) -> String {
    let came = encoder.encode(table).and_then(|encoded| {
        let bytes = encoded.bytes.len();
        let errors = compare(table, &Reader::open(encoded.bytes)?.decode_table()?)?.overall;
        let ms = 1e3 * encoded.report.seconds;
        Ok(format!("{} | {} | {bytes} | {ms:.1}", shown(errors.log_max), shown(errors.log_rms)))
    });
    came.unwrap_or_else(|e| format!("{e} | | |"))
}

fn cases() -> Vec<Case> {
    let mut random = SplitMix64(1);
    let mut uniform = move || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    let at = |p: usize| [p / (N * N), p / N % N, p % N];
    let block = |value: &dyn Fn([usize; 3]) -> f64| -> Vec<f64> { (0..SIZE).map(|p| value(at(p))).collect() };
    let smooth = block(&|[i, j, k]| 2.0 - 0.3 * i as f64 + (0.2 * j as f64).cos() * (0.1 * k as f64).sin());
    let noisy: Vec<f64> = smooth.iter().map(|v| v + 0.2 * (uniform() - 0.5)).collect();
    let extreme: Vec<f64> = (0..SIZE).map(|_| if uniform() < 0.5 { 1e-9 } else { 1e5 }).collect();
    let mut peak = vec![1e-3; SIZE];
    peak[SIZE / 2] = 1e5;
    let logs = |v: &[f64]| -> Vec<f64> { v.iter().map(|x| x.ln()).collect() };
    let scaled = |factor: f64| -> Vec<f64> { smooth.iter().map(|v| v * factor).collect() };
    let drawn: Vec<u32> = (0..SIZE as u32).filter(|_| uniform() < 0.05).collect();
    let with_peak: Vec<u32> = (0..SIZE as u32).filter(|&p| drawn.contains(&p) || p as usize == SIZE / 2).collect();
    let plane: Vec<u32> = (0..SIZE as u32).filter(|&p| at(p as usize)[0] == 7).collect();
    let every = |step: u32| -> Vec<u32> { (0..SIZE as u32).step_by(step as usize).collect() };
    let lattice: Vec<u32> = (0..SIZE as u32).filter(|&p| at(p as usize).iter().all(|i| i % 2 == 0)).collect();
    let case = |name, truth: &[f64], positions: &[u32], sigma_rms| Case {
        name,
        truth: truth.to_vec(),
        positions: positions.to_vec(),
        sigma_rms,
    };
    vec![
        case("smooth, 5 %", &smooth, &drawn, 1e-3),
        case("1e-9 beside 1e5, linear", &extreme, &drawn, 1e-3),
        case("1e-9 beside 1e5, log", &logs(&extreme), &drawn, 1e-3),
        case("one peak of 1e5 over 1e-3, linear, sampled", &peak, &with_peak, 1e-3),
        case("one peak of 1e5 over 1e-3, log, sampled", &logs(&peak), &with_peak, 1e-3),
        case("one peak, log, not sampled", &logs(&peak), &drawn, 1e-3),
        case("no sample", &smooth, &[], 1e-3),
        case("one sample", &smooth, &drawn[..1], 1e-3),
        case("two samples", &smooth, &drawn[..2], 1e-3),
        case("all samples in one plane", &smooth, &plane, 1e-3),
        case("all entries sampled", &noisy, &every(1), 1e-3),
        case("constant 3", &[3.0; SIZE], &drawn, 1e-3),
        case("constant 0", &[0.0; SIZE], &drawn, 1e-3),
        case(
            "signs in turn, log 1e5",
            &block(&|[i, j, k]| if (i + j + k) % 2 == 0 { 11.5 } else { -11.5 }),
            &drawn,
            1e-3,
        ),
        case("times 1e-300", &scaled(1e-300), &drawn, 1e-303),
        case("times 1e300", &scaled(1e300), &drawn, 1e297),
        case("denormal: times 1e-310", &scaled(1e-310), &drawn, 1e-313),
        case("every second position", &smooth, &every(2), 1e-3),
        case("every third position (aliases)", &smooth, &every(3), 1e-3),
        case("even positions on all axes (aliases)", &smooth, &lattice, 1e-3),
        case("noise, sigma 0", &noisy, &drawn, 0.0),
        case("noise, sigma that of the noise", &noisy, &drawn, 0.2 / 12f64.sqrt()),
        case("sigma 10 times the signal", &smooth, &drawn, 20.0),
        case("a NaN among the samples", &[&[f64::NAN][..], &smooth[1..]].concat(), &every(5), 1e-3),
        case("an infinity among the samples", &[&[f64::INFINITY][..], &smooth[1..]].concat(), &every(5), 1e-3),
    ]
}

struct Bench {
    transform: Transform,
    columns: Columns,
    norm: Norm,
    solver: Solver,
}

impl Bench {
    fn solve(&mut self, case: &Case, y: &[f64], max_iterations: usize) -> Result<Solution, Failure> {
        let mut op = SampledBasis::new(&mut self.transform, vec![&case.positions]).with_columns(&self.columns);
        let sigma = case.sigma_rms * (y.len() as f64).sqrt();
        let mut options = Options::default();
        options.max_iterations = max_iterations;
        Ok(self.solver.bpdn(&mut op, y, sigma, &self.norm, &options, None)?)
    }

    fn block(&mut self, solution: &Solution) -> Vec<f64> {
        let mut block = solution.coefficients.clone();
        self.transform.synthesize(&mut block);
        block
    }

    fn row(&mut self, case: &Case) -> Result<(), Failure> {
        let y: Vec<f64> = case.positions.iter().map(|&p| case.truth[p as usize]).collect();
        let solution = self.solve(case, &y, 1000)?;
        let brief = self.solve(case, &y, 4)?;
        let single: Vec<f64> = y.iter().map(|&v| f64::from(v as f32)).collect();
        let mut rounded = self.solve(case, &single, 1000)?;
        rounded.coefficients.iter_mut().for_each(|v| *v = f64::from(*v as f32));
        let [block, brief, rounded] = [&solution, &brief, &rounded].map(|s| self.block(s));

        let unit = if case.sigma_rms > 0.0 { case.sigma_rms * (y.len() as f64).sqrt() } else { length(&y) };
        let apart = block.iter().zip(&rounded).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
        let largest = block.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let in_range = single.iter().all(|v| v.is_finite()) && (largest == 0.0 || (1e-30..1e30).contains(&largest));
        println!(
            "| {} | {:?} | {} | {} | {} | {} | {} |",
            case.name,
            solution.stop,
            solution.iterations,
            shown(solution.residual_norm / unit),
            shown(error(&block, &case.truth)),
            shown(error(&brief, &case.truth)),
            if in_range { shown(if largest > 0.0 { apart / largest } else { apart }) } else { "beyond f32".into() },
        );
        if block.iter().any(|v| !v.is_finite()) {
            return Err(format!("{}: a value that is not finite", case.name).into());
        }
        Ok(())
    }
}

fn shown(value: f64) -> String {
    if value.is_finite() { format!("{value:.2e}") } else { "-".into() }
}

/// ||v||_2, without overflow.
fn length(v: &[f64]) -> f64 {
    let largest = v.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    if largest == 0.0 {
        return 0.0;
    }
    largest * v.iter().map(|x| (x / largest).powi(2)).sum::<f64>().sqrt()
}

/// ||block - truth|| / ||truth||, of the difference itself where the truth is zero.
fn error(block: &[f64], truth: &[f64]) -> f64 {
    let apart: Vec<f64> = block.iter().zip(truth).map(|(a, b)| a - b).collect();
    let unit = length(truth);
    if unit > 0.0 { length(&apart) / unit } else { length(&apart) }
}
