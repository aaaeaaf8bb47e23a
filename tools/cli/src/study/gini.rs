//! Sparsity of the Fourier coefficients of the table and of its logarithm (the paper's figure 2).

use csbrdf::assess::metrics::{DEFAULT_EPS, gini};
use csbrdf::codec::fourier::forward::Transform;
use csbrdf::codec::fourier::{Basis, partners};
use csbrdf::codec::tone::tone_map;
use csbrdf::table::BrdfTable;
use csbrdf::table::block::{Block, Partition};
use rayon::prelude::*;

use super::csv::{Csv, figure};
use super::folder::Folder;
use super::page::{Section, table};
use super::plan::Plan;
use super::plot::{Mark, dumbbells};
use crate::failure::Failure;

/// The paper's blocks.
const BLOCK: [usize; 4] = [1, 15, 15, 15];

/// Mean Gini indices of a material's blocks: of the table and of its logarithm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Pair {
    raw: f64,
    log: f64,
}

/// The figures of one material.
#[derive(Debug)]
pub struct Row {
    name: String,
    /// Blocks without a hole, times channels; only these have a spectrum without further assumptions.
    blocks: usize,
    dft: Pair,
    dft_without_mean: Pair,
    dct: Pair,
    dct_without_mean: Pair,
}

/// Gini indices of one block: DFT, DFT without mean, DCT, DCT without mean.
type Indices = [f64; 4];

pub fn measure(name: &str, table: &BrdfTable) -> Row {
    let shape = table.grid().shape();
    let blocks: Vec<Block> = match Partition::uniform(shape, BLOCK) {
        Ok(partition) => (0..partition.block_count()).filter_map(|b| partition.block(b)).collect(),
        Err(_) => Vec::new(),
    };
    let channels = table.grid().channels().len();
    let cells: Vec<(usize, Block)> = (0..channels).flat_map(|c| blocks.iter().map(move |b| (c, *b))).collect();
    let measured: Vec<[Indices; 2]> = cells
        .par_iter()
        .filter_map(|(c, block)| {
            let mut valid = vec![false; block.positions()];
            block.gather(shape, table.valid_plane(*c), &mut valid);
            if valid.contains(&false) {
                return None;
            }
            let mut raw = vec![0.0; block.positions()];
            block.gather(shape, table.plane(*c), &mut raw);
            let scale = table.grid().channels()[*c].scale;
            let log: Vec<f64> = raw.iter().map(|v| tone_map((v * scale).min(f64::MAX), DEFAULT_EPS)).collect();
            Some([indices(block.shape, &raw), indices(block.shape, &log)])
        })
        .collect();
    let mean = |which: usize| {
        let of = |domain: usize| measured.iter().map(|m| m[domain][which]).sum::<f64>() / measured.len() as f64;
        if measured.is_empty() { Pair { raw: f64::NAN, log: f64::NAN } } else { Pair { raw: of(0), log: of(1) } }
    };
    Row {
        name: name.into(),
        blocks: measured.len(),
        dft: mean(0),
        dft_without_mean: mean(1),
        dct: mean(2),
        dct_without_mean: mean(3),
    }
}

fn indices(shape: [usize; 4], values: &[f64]) -> Indices {
    let mut dft = values.to_vec();
    Transform::new(Basis::Dft, shape).analyze(&mut dft);
    // Magnitudes of the complex coefficients, of which a pair holds real and imaginary part times sqrt 2.
    let magnitude = |(j, &partner): (usize, &u32)| match partner as usize {
        k if k == j => dft[j].abs(),
        k => dft[j].hypot(dft[k]) * std::f64::consts::FRAC_1_SQRT_2,
    };
    let dft: Vec<f64> = partners(shape).iter().enumerate().map(magnitude).collect();
    let mut dct = values.to_vec();
    Transform::new(Basis::Dct, shape).analyze(&mut dct);
    [gini(&dft), gini(&dft[1..]), gini(&dct), gini(&dct[1..])]
}

pub fn write(plan: &Plan, rows: &[Row], folder: &Folder) -> Result<Section, Failure> {
    let mut csv = Csv::new(
        "material,blocks,dft_raw,dft_log,dft_raw_without_mean,dft_log_without_mean,dct_raw,dct_log,\
         dct_raw_without_mean,dct_log_without_mean",
    );
    for row in rows {
        let mut fields = vec![row.name.clone(), row.blocks.to_string()];
        for pair in [row.dft, row.dft_without_mean, row.dct, row.dct_without_mean] {
            fields.extend([pair.raw, pair.log].map(|v| figure(Some(v).filter(|v| v.is_finite()), 5)));
        }
        csv.row(&fields);
    }
    folder.write("gini.csv", csv.bytes())?;
    let plot = |title: &str, of: fn(&Row) -> Pair| {
        let marks: Vec<Mark> =
            rows.iter().map(|r| Mark { name: r.name.clone(), from: of(r).raw, to: of(r).log }).collect();
        dumbbells(title, "Gini index (1: sparsest)", ["table", "ln(table + eps)"], &marks)
    };
    folder.write("gini.svg", plot("DFT coefficients", |r| r.dft)?.as_bytes())?;
    let without = plot("DFT coefficients without the mean of each block", |r| r.dft_without_mean)?;
    folder.write("gini-without-mean.svg", without.as_bytes())?;
    let sparser =
        |of: fn(&Row) -> Pair| format!("{} of {}", rows.iter().filter(|r| of(r).log > of(r).raw).count(), rows.len());
    let mean = |of: fn(&Row) -> Pair| {
        let known: Vec<Pair> = rows.iter().map(of).filter(|p| p.raw.is_finite()).collect();
        let n = known.len().max(1) as f64;
        let sum = |side: fn(&Pair) -> f64| known.iter().map(side).sum::<f64>() / n;
        [format!("{:.3}", sum(|p| p.raw)), format!("{:.3}", sum(|p| p.log))]
    };
    let mut cells = Vec::new();
    type Kind = (&'static str, fn(&Row) -> Pair);
    let kinds: [Kind; 4] = [
        ("DFT", |r| r.dft),
        ("DFT without mean", |r| r.dft_without_mean),
        ("DCT", |r| r.dct),
        ("DCT without mean", |r| r.dct_without_mean),
    ];
    for (kind, of) in kinds {
        let [raw, log] = mean(of);
        cells.push(vec![kind.to_string(), raw, log, sparser(of)]);
    }
    let mut section = Section::new("Sparsity of the coefficients (figure 2)");
    section.text(&format!(
        "Gini index of the magnitudes of the coefficients of 15 x 15 x 15 blocks, mean over all channels and all \
         blocks without a hole; eps = {DEFAULT_EPS}/sr. The mean of a block is by far the largest coefficient of its \
         logarithm: with it and without are both shown."
    ));
    section.claim(
        "the logarithm makes the coefficients sparser",
        &format!(
            "with the mean the logarithm is sparser for {} materials, without for {} (DFT)",
            sparser(|r| r.dft),
            sparser(|r| r.dft_without_mean)
        ),
    );
    section.image("gini.svg", "Gini index, raw against log");
    section.image("gini-without-mean.svg", "Gini index without the mean, raw against log");
    section.html(&table(&["coefficients", "table", "ln(table + eps)", "log is sparser"], &cells));
    section.files(&["gini.csv"]);
    section.command(&format!("{} --only gini", plan.command_without_only()));
    Ok(section)
}

#[cfg(test)]
mod tests {
    use super::*;
    use csbrdf::table::grid::Grid;

    #[test]
    fn flat_blocks_are_one_spike_and_noise_is_not() {
        let shape = [1, 5, 4, 3];
        let [dft, _, dct, _] = indices(shape, &[2.0; 60]);
        assert!((dft - (1.0 - 1.0 / 60.0)).abs() < 1e-9 && (dct - dft).abs() < 1e-9);
        // A single value that is not zero has coefficients of one magnitude.
        let mut spike = vec![0.0; 60];
        spike[17] = 1.0;
        assert!(indices(shape, &spike)[0].abs() < 1e-9);
    }

    #[test]
    fn blocks_with_holes_are_left_out() {
        let axes = Grid::merl().axes().iter().map(|a| csbrdf::table::grid::Axis { len: 15, ..*a }).collect();
        let grid = Grid::new(axes, Grid::rgb_channels([1.0; 3])).unwrap();
        let mut values: Vec<f64> = (0..3 * 3375).map(|i| 1.0 + (i % 7) as f64).collect();
        values[0] = -1.0;
        let row = measure("x", &BrdfTable::from_values(grid, values).unwrap());
        assert_eq!(row.blocks, 2);
        assert!(row.dft.raw > 0.0 && row.dft.log < 1.0);
    }
}
