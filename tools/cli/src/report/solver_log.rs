//! Followed solves of chosen blocks.

use csbrdf::encode::Encoder;
use csbrdf::encode::solver_log::{Limits, SolverLog, Step};
use csbrdf::table::Table;

use super::blocks::Chosen;

/// The duality gap that ends a followed solve.
pub const GAP: f64 = 1e-3;

/// Times that each is solved, for the seconds.
pub const RUNS: usize = 3;

/// The solves of a block with some settings.
#[derive(Clone, Debug)]
pub struct Followed {
    pub block: Chosen,
    pub settings: String,
    /// One a component of the block's values.
    pub traces: Vec<SolverLog>,
}

/// Follows the solves of a block. All runs take the same steps; of each step the least time counts, so that what else
/// the machine does shows little.
pub fn follow(table: &Table, encoder: &Encoder, block: usize, iterations: usize) -> csbrdf::Result<Vec<SolverLog>> {
    let limits = Limits { iterations, gap: GAP };
    let mut runs = (0..RUNS).map(|_| encoder.solver_log(table, block, limits)).collect::<csbrdf::Result<Vec<_>>>()?;
    let mut first = runs.swap_remove(0);
    for (number, trace) in first.iter_mut().enumerate() {
        let clocks = |steps: &[Step]| steps.iter().map(|s| s.seconds).collect::<Vec<_>>();
        let all: Vec<Vec<f64>> = runs.iter().map(|r| clocks(&r[number].steps)).chain([clocks(&trace.steps)]).collect();
        let least = least_times(&all);
        trace.steps.iter_mut().zip(least).for_each(|(step, seconds)| step.seconds = seconds);
    }
    Ok(first)
}

/// From several runs' clocks at the same steps the one of the least time each.
fn least_times(clocks: &[Vec<f64>]) -> Vec<f64> {
    let steps = clocks.iter().map(Vec::len).min().unwrap_or(0);
    let since = |clock: &[f64], i: usize| clock[i] - if i == 0 { 0.0 } else { clock[i - 1] };
    let mut now = 0.0;
    (0..steps)
        .map(|i| {
            now += clocks.iter().map(|clock| since(clock, i)).fold(f64::INFINITY, f64::min);
            now
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn delays_of_single_runs_do_not_count() {
        assert_eq!(least_times(&[vec![1.0, 9.0, 10.0], vec![2.0, 3.0, 8.0]]), [1.0, 2.0, 3.0]);
        assert_eq!(least_times(&[vec![0.5, 1.0]]), [0.5, 1.0]);
    }
}
