//! Which blocks' solves are followed.

use csbrdf::codec::tone::tone_map;
use csbrdf::table::BrdfTable;
use csbrdf::table::block::Partition;

/// Constant of the logarithm that ranges are measured in, 1/sr.
const EPS: f64 = csbrdf::assess::metrics::DEFAULT_EPS;

/// A block and why it is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct Chosen {
    /// Number in the partition.
    pub number: usize,
    /// "smooth", "glossy", "stiff" or "block".
    pub kind: &'static str,
    /// Largest less least ln(f + eps) of the valid entries of all channels.
    pub range: f64,
}

/// Of the blocks of which half the entries are valid or more those of least, median and greatest log range; or the
/// blocks of the given numbers. `None` stands for a number that is no block's.
pub fn choose(table: &BrdfTable, partition: &Partition, numbers: &[usize]) -> Option<Vec<Chosen>> {
    if !numbers.is_empty() {
        let named = |&number: &usize| {
            let range = log_range(table, partition, number)?.1;
            Some(Chosen { number, kind: "block", range })
        };
        return numbers.iter().map(named).collect();
    }
    let ranges = (0..partition.block_count()).filter_map(|n| Some((n, log_range(table, partition, n)?)));
    let mut usable: Vec<(usize, f64)> = ranges.filter(|(_, (share, _))| *share >= 0.5).map(|(n, r)| (n, r.1)).collect();
    usable.sort_by(|a, b| a.1.total_cmp(&b.1));
    let picks: &[(usize, &str)] = match usable.len() {
        0 => &[],
        1 => &[(0, "stiff")],
        2 => &[(0, "smooth"), (1, "stiff")],
        n => &[(0, "smooth"), (n / 2, "glossy"), (n - 1, "stiff")],
    };
    Some(picks.iter().map(|&(i, kind)| Chosen { number: usable[i].0, kind, range: usable[i].1 }).collect())
}

/// Share of valid entries and log range of a block.
fn log_range(table: &BrdfTable, partition: &Partition, number: usize) -> Option<(f64, f64)> {
    let block = partition.block(number)?;
    let shape = table.grid().shape();
    let n = block.positions();
    let (mut values, mut valid) = (vec![0.0; n], vec![false; n]);
    let (mut low, mut high, mut count) = (f64::INFINITY, f64::NEG_INFINITY, 0);
    let channels = table.grid().channels();
    for (c, channel) in channels.iter().enumerate() {
        block.gather(shape, table.plane(c), &mut values);
        block.gather(shape, table.valid_plane(c), &mut valid);
        for (value, _) in values.iter().zip(&valid).filter(|(_, valid)| **valid) {
            let log = tone_map((value * channel.scale).min(f64::MAX), EPS);
            (low, high, count) = (low.min(log), high.max(log), count + 1);
        }
    }
    Some((count as f64 / (n * channels.len()) as f64, (high - low).max(0.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use csbrdf::table::grid::{Axis, Grid};

    #[test]
    fn blocks_are_ranked_by_log_range() {
        let axis = Axis { len: 16, ..Grid::merl().axes()[0] };
        let grid = Grid::new(vec![axis], Grid::rgb_channels([1.0; 3])).unwrap();
        // Four blocks of four: factors 10, 100 and 3 between their entries, then one that is mostly missing.
        let plane = [1.0, 1.0, 1.0, 10.0, 1.0, 1.0, 1.0, 100.0, 1.0, 3.0, 1.0, -1.0, 1e9, -1.0, -1.0, -1.0];
        let table = BrdfTable::from_values(grid, plane.repeat(3)).unwrap();
        let partition = Partition::uniform(table.grid().shape(), [1, 1, 1, 4]).unwrap();
        let chosen = choose(&table, &partition, &[]).unwrap();
        assert_eq!(chosen.iter().map(|c| c.number).collect::<Vec<_>>(), [2, 0, 1]);
        assert_eq!(chosen[0].kind, "smooth");
        assert!((chosen[2].range - 100f64.ln()).abs() < 1e-2);
        assert_eq!(choose(&table, &partition, &[3]).unwrap()[0].number, 3);
        assert_eq!(choose(&table, &partition, &[0, 4]), None);
    }
}
