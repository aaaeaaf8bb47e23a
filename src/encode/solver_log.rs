//! How the l1 solves of one block go, for reports.

use super::prepare::Prepared;
use super::progress::Progress;
use super::settings::Encoder;
use super::sparse::recover::{Recoverer, Recovery};
use super::sparse::watch::Watcher;
pub use super::sparse::watch::{Limits, Step, SolverLog};
use crate::base::error::{Error, Result};
use crate::table::Table;

impl Encoder {
    /// Follows the solves of one block, of one component of its values after the other; none where every valid
    /// entry is a sample, nor with a trend, which leaves windows to solve in place of blocks. `block` is the number of the block in the partition of an encode.
    ///
    /// # Errors
    /// As [`Encoder::encode`]; `InvalidArgument` if there is no such block or a limit is out of range.
    pub fn solver_log(&self, table: &Table, block: usize, limits: Limits) -> Result<Vec<SolverLog>> {
        self.check()?;
        if limits.gap.is_nan() || limits.gap <= 0.0 {
            return Err(Error::InvalidArgument(format!("gap is {}, must be above 0", limits.gap)));
        }
        let prepared = Prepared::new(self, table)?;
        let partition = prepared.choose_partition(self, Progress::none())?;
        let Some(place) = partition.block(block) else {
            let count = partition.block_count();
            return Err(Error::InvalidArgument(format!("no block {block}, there are {count}")));
        };
        if self.trend || prepared.full.is_some() {
            return Ok(Vec::new());
        }
        let mut recoverer = Recoverer::new(Recovery::new(self, self.iterations));
        recoverer.watcher = Some(Watcher::new(limits));
        let quantized = prepared.sampled(self, None).quantize_block(&mut recoverer, block, &place);
        quantized.ok_or_else(|| self.too_fine())?;
        Ok(recoverer.watcher.map(|watcher| watcher.logs).unwrap_or_default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::Preset;
    use crate::table::synth::Recipe;

    #[test]
    fn a_trace_ends_at_the_gap_and_reaches_sigma_on_its_way() {
        let table = Recipe::named("satin-paint").unwrap().merl().unwrap();
        let encoder = Encoder::new().preset(Preset::Paper).sigma(0.02);
        let logs = encoder.solver_log(&table, 200, Limits { iterations: 2000, gap: 0.01 }).unwrap();
        assert_eq!(logs.len(), 3);
        for log in &logs {
            let (first, last) = (log.steps[0], log.steps[log.steps.len() - 1]);
            assert!(log.steps.iter().map(|s| s.iterations).eq(0..log.steps.len()));
            assert!(log.steps.windows(2).all(|w| w[1].gap <= w[0].gap && w[1].seconds >= w[0].seconds));
            assert!(first.gap > 0.1 && last.gap <= 0.0101, "{first:?} {last:?}");
            assert!(last.residual <= 1.01 * log.sigma && first.residual > 2.0 * log.sigma);
            let stop = log.reached;
            assert!(stop > 0 && stop <= last.iterations && log.steps[stop].residual <= 1.01 * log.sigma);
        }
        assert!(encoder.solver_log(&table, 432, Limits { iterations: 1, gap: 0.1 }).is_err());
        let full = Encoder::new().block_shape(&[15, 15, 15]);
        for none in [full, encoder.trend(true)] {
            assert!(none.solver_log(&table, 200, Limits { iterations: 1, gap: 0.1 }).unwrap().is_empty());
        }
    }
}
