//! Solves the problems that `tools/spgl1_compare.py` writes, for comparison with the PyPI package `spgl1`.
//!
//! Both files are text, a problem a line. In: `basis sigma max_iterations position:value ...` over a block of 15 x 15 x 15.
//! Out: `norm residual gap iterations transforms seconds stop`; the seconds are the median of several solves.

use csbrdf::codec::fourier::forward::Transform;
use csbrdf::codec::fourier::{Basis, partners};
use csbrdf::encode::l1::norm::Norm;
use csbrdf::encode::l1::sampled::{Columns, SampledBasis};
use csbrdf::encode::l1::spgl1::{Options, Solver};

const SHAPE: [usize; 4] = [1, 15, 15, 15];
const REPEATS: usize = 5;

/// Processor time of this thread, so that other work on the machine does not count (Linux; wall-clock time elsewhere).
fn processor_seconds() -> Option<f64> {
    // The kernel brings the figure up to date when it schedules.
    std::thread::yield_now();
    let statistics = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(statistics.split_whitespace().next()?.parse::<f64>().ok()? * 1e-9)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("usage: spgl1_compare PROBLEMS")?;
    let partner = partners(SHAPE);
    let dct = (Transform::new(Basis::Dct, SHAPE), Norm::l1(3375));
    let dft = (Transform::new(Basis::Dft, SHAPE), Norm::new(3375, None, Some(&partner))?);
    let (mut dct, mut dft) = (dct, dft);
    let columns = [Basis::Dct, Basis::Dft].map(|basis| Columns::new(basis, SHAPE));
    let mut solver = Solver::default();
    for line in std::fs::read_to_string(path)?.lines() {
        let mut words = line.split_whitespace();
        let (transform, norm, columns) = match words.next() {
            Some("dct") => (&mut dct.0, &dct.1, &columns[0]),
            _ => (&mut dft.0, &dft.1, &columns[1]),
        };
        let sigma: f64 = words.next().ok_or("no sigma")?.parse()?;
        let mut options = Options::default();
        options.gap_tolerance = words.next().ok_or("no gap")?.parse()?;
        options.max_iterations = 3000;
        // The residual asked for is that of the other solver, and may be far below what it was asked for.
        options.bp_tolerance = 1e-8;
        let (mut positions, mut y) = (Vec::<u32>::new(), Vec::<f64>::new());
        for word in words {
            let (position, value) = word.split_once(':').ok_or("no colon")?;
            positions.push(position.parse()?);
            y.push(value.parse()?);
        }
        let mut op = SampledBasis::new(transform, vec![&positions]).with_columns(columns);
        let mut seconds = Vec::new();
        let mut timed = || -> Result<_, csbrdf::Error> {
            let begin = processor_seconds();
            let solution = solver.bpdn(&mut op, &y, sigma, norm, &options, None)?;
            seconds.push(processor_seconds().zip(begin).map_or(solution.seconds, |(end, begin)| end - begin));
            Ok(solution)
        };
        for _ in 1..REPEATS {
            timed()?;
        }
        let solution = timed()?;
        seconds.sort_by(f64::total_cmp);
        println!(
            "{:.12e} {:.12e} {:e} {} {} {:.9} {:?}",
            solution.norm,
            solution.residual_norm,
            solution.gap,
            solution.iterations,
            solution.transforms,
            seconds[REPEATS / 2],
            solution.stop
        );
    }
    Ok(())
}
