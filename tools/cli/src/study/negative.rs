//! Negative values after recovery, from the table and from its logarithm (the paper's figure 3).

use csbrdf::assess::metrics::DEFAULT_EPS;
use csbrdf::codec::sample::{Sampling, block_seed, sample_positions};
use csbrdf::codec::tone::tone_map;
use csbrdf::table::BrdfTable;
use csbrdf::table::block::Partition;
use rayon::prelude::*;

use super::csv::{Csv, figure};
use super::folder::Folder;
use super::page::{Section, table};
use super::plan::{Plan, percentage};
use super::plot::{Mark, bars};
use super::progress::Progress;
use super::recovery::{RELATIVE_SIGMA, Recovery};
use crate::failure::Failure;
use crate::picture::Picture;

/// The paper's blocks.
const BLOCK: [usize; 4] = [1, 15, 15, 15];
/// Pixels a bin in the slices.
const ZOOM: usize = 2;

/// What the recoveries of one material gave, over the valid entries of the blocks that were recovered.
pub struct Row {
    name: String,
    entries: usize,
    counts: Counts,
    /// Reference, recovered from the table (negative values red), recovered from the logarithm.
    slices: Picture,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Counts {
    entries: usize,
    /// Recovered from the table and below zero.
    raw_negative: usize,
    /// The least of these, 1/sr.
    raw_least: f64,
    /// Recovered from the logarithm and below zero after the inverse tone map.
    log_negative: usize,
    /// Recovered from the logarithm where exp(L) < eps: the inverse tone map gives zero.
    log_clamped: usize,
    /// Sums of squared errors of ln(f + eps), with negative values taken as zero.
    raw_squares: f64,
    log_squares: f64,
}

impl Counts {
    fn add(mut self, other: Counts) -> Counts {
        self.entries += other.entries;
        self.raw_negative += other.raw_negative;
        self.raw_least = self.raw_least.min(other.raw_least);
        self.log_negative += other.log_negative;
        self.log_clamped += other.log_clamped;
        self.raw_squares += other.raw_squares;
        self.log_squares += other.log_squares;
        self
    }

    fn count(&mut self, reference: f64, raw: f64, log: f64) {
        let from_log = (log.exp() - DEFAULT_EPS).max(0.0);
        self.entries += 1;
        self.raw_negative += usize::from(raw < 0.0);
        self.raw_least = self.raw_least.min(raw);
        self.log_negative += usize::from(from_log < 0.0);
        self.log_clamped += usize::from(log.exp() < DEFAULT_EPS);
        let error = |f: f64| tone_map(f.clamp(0.0, f64::MAX), DEFAULT_EPS) - tone_map(reference, DEFAULT_EPS);
        self.raw_squares += error(raw).powi(2);
        self.log_squares += error(from_log).powi(2);
    }

    fn share(&self, count: usize) -> f64 {
        100.0 * count as f64 / self.entries.max(1) as f64
    }

    fn rms(&self, squares: f64) -> f64 {
        (squares / self.entries.max(1) as f64).sqrt()
    }
}

/// Where a block's values appear in the slices: row, column, reference, from table, from logarithm.
type Dot = (usize, usize, f64, f64, f64);

pub fn measure(plan: &Plan, name: &str, table: &BrdfTable, progress: &Progress) -> csbrdf::Result<Row> {
    let grid = table.grid();
    let shape = grid.shape();
    let partition = Partition::uniform(shape, BLOCK)?;
    let channels = grid.channels().len();
    let sampling = Sampling::from_ratio(plan.focus).unwrap_or(Sampling::Every);
    let middle = shape[3] / 2;
    let cells: Vec<(usize, usize)> = (0..partition.block_count())
        .step_by(plan.block_stride)
        .flat_map(|block| (0..channels).map(move |c| (block, c)))
        .collect();
    let done = std::sync::atomic::AtomicUsize::new(0);
    let one = |recovery: &mut Recovery, (number, c): (usize, usize), tick: &(dyn Fn(f64) + Sync)| {
        let mut counts = Counts::default();
        let mut dots: Vec<Dot> = Vec::new();
        let block = partition.block(number).ok_or_else(|| csbrdf::Error::InvalidArgument("no such block".into()))?;
        let (mut raw, mut valid) = (vec![0.0; block.positions()], vec![false; block.positions()]);
        block.gather(shape, table.plane(c), &mut raw);
        block.gather(shape, table.valid_plane(c), &mut valid);
        let scale = grid.channels()[c].scale;
        raw.iter_mut().zip(&valid).for_each(|(v, valid)| *v = if *valid { (*v * scale).min(f64::MAX) } else { 0.0 });
        // The samples of the encoder.
        let positions = sample_positions(block_seed(plan.seed, number as u32), sampling, &valid);
        if !positions.is_empty() {
            let log: Vec<f64> = raw.iter().map(|v| tone_map(*v, DEFAULT_EPS)).collect();
            let from_raw = recovery.recover(block.shape, &raw, &positions)?;
            let from_log = recovery.recover(block.shape, &log, &positions)?;
            for i in (0..raw.len()).filter(|&i| valid[i]) {
                counts.count(raw[i], from_raw[i], from_log[i]);
                let (k, rest) = (block.origin[3] + i % block.shape[3], i / block.shape[3]);
                if c == channels / 2 && k == middle {
                    let (row, column) =
                        (block.origin[1] + rest / block.shape[2], block.origin[2] + rest % block.shape[2]);
                    dots.push((row, column, raw[i], from_raw[i], from_log[i].exp() - DEFAULT_EPS));
                }
            }
        }
        let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
        tick(done as f64 / cells.len() as f64);
        Ok((counts, dots))
    };
    let results: Vec<(Counts, Vec<Dot>)> = progress.step(|tick| {
        cells.par_iter().map_init(Recovery::default, |r, &cell| one(r, cell, tick)).collect::<csbrdf::Result<_>>()
    })?;
    let counts = results.iter().fold(Counts::default(), |sum, (counts, _)| sum.add(*counts));
    let dots: Vec<Dot> = results.into_iter().flat_map(|(_, dots)| dots).collect();
    Ok(Row { name: name.into(), entries: counts.entries, counts, slices: slices(&dots, shape[1], shape[2]) })
}

/// Three slices side by side in shades of the logarithm; red below zero, dark blue where there is nothing.
fn slices(dots: &[Dot], rows: usize, columns: usize) -> Picture {
    let mut picture = Picture::black((3 * columns + 2) * ZOOM, rows * ZOOM);
    let mut paint = |panel: usize, row: usize, column: usize, rgb: [u8; 3]| {
        for i in 0..ZOOM * ZOOM {
            let x = (panel * (columns + 1) + column) * ZOOM + i % ZOOM;
            picture.set(x, row * ZOOM + i / ZOOM, rgb);
        }
    };
    for panel in 0..3 {
        (0..rows * columns).for_each(|i| paint(panel, i / columns, i % columns, [20, 24, 48]));
    }
    let logs = || dots.iter().map(|d| tone_map(d.2, DEFAULT_EPS));
    let (low, high) = (logs().fold(f64::INFINITY, f64::min), logs().fold(f64::NEG_INFINITY, f64::max));
    for &(row, column, reference, raw, log) in dots {
        for (panel, value) in [reference, raw, log].into_iter().enumerate() {
            let shade = (tone_map(value.max(0.0), DEFAULT_EPS) - low) / (high - low).max(1e-9);
            let grey = (255.0 * shade.clamp(0.0, 1.0)) as u8;
            paint(panel, row, column, if panel == 1 && value < 0.0 { [230, 30, 30] } else { [grey; 3] });
        }
    }
    picture
}

pub fn write(plan: &Plan, rows: &[Row], folder: &Folder) -> Result<Section, Failure> {
    let mut csv = Csv::new(
        "material,ratio,entries,raw_negative,raw_negative_percent,raw_least,log_negative,log_clamped,\
         log_clamped_percent,log_rms_of_raw,log_rms_of_log",
    );
    let mut cells = Vec::new();
    for Row { name, entries, counts, .. } in rows {
        csv.row(&[
            name.clone(),
            plan.focus.to_string(),
            entries.to_string(),
            counts.raw_negative.to_string(),
            figure(counts.share(counts.raw_negative), 3),
            format!("{:.6}", counts.raw_least),
            counts.log_negative.to_string(),
            counts.log_clamped.to_string(),
            figure(counts.share(counts.log_clamped), 3),
            figure(counts.rms(counts.raw_squares), 5),
            figure(counts.rms(counts.log_squares), 5),
        ]);
        cells.push(vec![
            name.clone(),
            format!("{:.2} %", counts.share(counts.raw_negative)),
            format!("{:.4}", counts.raw_least),
            format!("{:.2} %", counts.share(counts.log_negative)),
            format!("{:.2} %", counts.share(counts.log_clamped)),
            format!("{:.3}", counts.rms(counts.raw_squares)),
            format!("{:.3}", counts.rms(counts.log_squares)),
        ]);
    }
    folder.write("negative.csv", csv.bytes())?;
    let marks: Vec<Mark> = rows
        .iter()
        .map(|r| Mark {
            name: r.name.clone(),
            from: r.counts.share(r.counts.raw_negative),
            to: r.counts.share(r.counts.log_negative),
        })
        .collect();
    let title = format!("Negative values recovered from {} of the entries", percentage(plan.focus));
    let labels = ["from the table", "from its logarithm"];
    folder.write("negative.svg", bars(&title, "percent of the valid entries", labels, &marks)?.as_bytes())?;
    let mut section = Section::new("Negative values after recovery (figure 3)");
    let blocks = match plan.block_stride {
        1 => "all blocks".to_string(),
        n => format!("every {n}th block"),
    };
    section.text(&format!(
        "Plain l1 recovery of the DFT coefficients of 15 x 15 x 15 blocks from {} of the entries, {blocks}, all \
         channels, the same samples for both; residual {RELATIVE_SIGMA} of the samples' norm without mean. Left: the \
         table is sampled as it is; right: its logarithm, then exp(L) - eps, at least 0 (eps = {DEFAULT_EPS}/sr). \
         \"At the floor\" are values where exp(L) is below eps. Log rms: error of ln(f + eps), negative values as 0.",
        percentage(plan.focus)
    ));
    let worst = rows.iter().map(|r| r.counts.share(r.counts.raw_negative)).fold(0.0, f64::max);
    let negative: usize = rows.iter().map(|r| r.counts.log_negative).sum();
    section.claim(
        "recovery of the raw table gives negative values, of its logarithm none",
        &format!(
            "up to {worst:.1} % of the values are negative from the raw table, {negative} values from the logarithm"
        ),
    );
    section.image("negative.svg", "Share of negative values");
    let head = [
        "material",
        "negative, table",
        "least, 1/sr",
        "negative, log",
        "at the floor, log",
        "log rms, table",
        "log rms, log",
    ];
    section.html(&table(&head, &cells));
    section.text(
        "Slices at phi_d in the middle of its range, middle channel: theta_h down, theta_d across, brightness by \
         ln(f + eps). Reference, recovered from the table (negative values red), recovered from the logarithm.",
    );
    for row in rows {
        let file = format!("negative-{}.png", row.name);
        folder.picture(&file, &row.slices)?;
        section.small_image(&file, &row.name);
    }
    section.files(&["negative.csv"]);
    section.command(&format!("{} --only negative", plan.command_without_only()));
    Ok(section)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_counted() {
        let mut counts = Counts::default();
        counts.count(0.5, -0.25, 0.5f64.ln());
        counts.count(0.5, 0.5, (DEFAULT_EPS / 2.0).ln());
        assert_eq!((counts.entries, counts.raw_negative, counts.raw_least), (2, 1, -0.25));
        assert_eq!((counts.log_negative, counts.log_clamped), (0, 1));
        assert_eq!(counts.share(counts.raw_negative), 50.0);
        let sum = counts.add(counts);
        assert_eq!((sum.entries, sum.raw_least), (4, -0.25));
        assert!((sum.rms(sum.raw_squares) - counts.rms(counts.raw_squares)).abs() < 1e-12);
    }
}
