//! How far one table is from another: log error, its peak and percentile, signal-to-noise ratio.
//!
//! The log error of an entry is `ln(b + eps) - ln(a + eps)` with both values in 1/sr, so that the dark parts of a table,
//! a million times below its highlight, count like the bright ones.

mod gini;

use crate::base::error::{Error, Result};
use crate::table::Table;
pub use gini::gini;

/// The constant in the log error, 1/sr, unless another is given.
pub const DEFAULT_EPS: f64 = 1e-3;

/// Error figures of one channel or of all. Never NaN; where `compared` is 0 the errors are 0 and the ratio is infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Errors {
    /// Number of entries valid in both tables.
    pub compared: usize,
    /// Root mean square of the log error.
    pub log_rms: f64,
    /// Largest magnitude of the log error.
    pub log_max: f64,
    /// 99.9th percentile (nearest rank) of the magnitude of the log error.
    pub log_p999: f64,
    /// Linear signal-to-noise ratio `10 log10(sum a^2 / sum (a - b)^2)` in dB, values in 1/sr; `+inf` where the tables
    /// are equal, `-inf` where the reference is zero everywhere and the other table is not.
    pub snr_db: f64,
}

/// The result of [`compare`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Comparison {
    /// Over the entries of all channels.
    pub overall: Errors,
    /// Per channel, in the order of the planes.
    pub channels: Vec<Errors>,
    /// Entries (all channels) that are valid in the reference only.
    pub only_in_reference: usize,
    /// Entries (all channels) that are valid in the other table only.
    pub only_in_other: usize,
}

/// Compares `other` to `reference` over the entries valid in both, with [`DEFAULT_EPS`].
///
/// # Errors
/// `InvalidArgument` if the tables differ in shape, or in the number, names or wavelengths of their channels. Scales
/// may differ: each table is brought to 1/sr by its own.
pub fn compare(reference: &Table, other: &Table) -> Result<Comparison> {
    compare_with_eps(reference, other, DEFAULT_EPS)
}

/// [`compare`] with the constant `eps` (1/sr) in the log error.
///
/// # Errors
/// Those of [`compare`]; `InvalidArgument` if `eps` is not positive and finite.
pub fn compare_with_eps(reference: &Table, other: &Table, eps: f64) -> Result<Comparison> {
    if !(eps.is_finite() && eps > 0.0) {
        return Err(Error::InvalidArgument(format!("eps must be positive and finite, not {eps}")));
    }
    same_layout(reference, other)?;
    // Squares are taken of values over the largest, so that extreme ones neither overflow nor vanish.
    let largest = pairs(reference, other).fold(0.0f64, |m, (_, a, b)| m.max(a).max(b));
    let unit = if largest > 0.0 { largest } else { 1.0 };
    let mut sums = vec![Sums::default(); reference.grid().channels().len()];
    let mut magnitudes = Vec::new();
    for (channel, a, b) in pairs(reference, other) {
        let error = capped(b + eps).ln() - capped(a + eps).ln();
        magnitudes.push(error.abs());
        sums[channel].add(error, a / unit, b / unit);
    }
    let mut total = Sums::default();
    let mut channels = Vec::with_capacity(sums.len());
    let mut rest = magnitudes.as_mut_slice();
    for sums in &sums {
        let (own, others) = rest.split_at_mut(sums.count);
        channels.push(sums.errors(own));
        total.merge(sums);
        rest = others;
    }
    let count = |in_a: bool, in_b: bool| {
        reference.valid().iter().zip(other.valid()).filter(|&(&a, &b)| a == in_a && b == in_b).count()
    };
    Ok(Comparison {
        overall: total.errors(&mut magnitudes),
        channels,
        only_in_reference: count(true, false),
        only_in_other: count(false, true),
    })
}

fn same_layout(a: &Table, b: &Table) -> Result<()> {
    let (a, b) = (a.grid(), b.grid());
    if a.shape() != b.shape() {
        let shapes = (a.shape(), b.shape());
        return Err(Error::InvalidArgument(format!(
            "tables of shape {:?} and {:?} do not compare",
            shapes.0, shapes.1
        )));
    }
    let names =
        |g: &crate::table::grid::Grid| g.channels().iter().map(|c| (c.name.clone(), c.wavelength)).collect::<Vec<_>>();
    if names(a) != names(b) {
        let counts = (a.channels().len(), b.channels().len());
        return Err(Error::InvalidArgument(format!(
            "the channels differ ({} and {} of them, or other names or wavelengths)",
            counts.0, counts.1
        )));
    }
    Ok(())
}

/// Channel and the two values in 1/sr of every entry valid in both, plane by plane.
fn pairs<'a>(a: &'a Table, b: &'a Table) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
    (0..a.grid().channels().len()).flat_map(move |c| {
        let scale = (a.grid().channels()[c].scale, b.grid().channels()[c].scale);
        let valid = a.valid_plane(c).iter().zip(b.valid_plane(c));
        let values = a.plane(c).iter().zip(b.plane(c));
        valid
            .zip(values)
            .filter(|((in_a, in_b), _)| **in_a && **in_b)
            .map(move |(_, (x, y))| (c, capped(x * scale.0), capped(y * scale.1)))
    })
}

/// A product of finite factors may overflow; the largest number stands for it.
fn capped(x: f64) -> f64 {
    x.min(f64::MAX)
}

/// Compensated sum (Neumaier 1974).
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    sum: f64,
    lost: f64,
}

impl Sum {
    fn add(&mut self, x: f64) {
        let sum = self.sum + x;
        self.lost += if self.sum.abs() >= x.abs() { (self.sum - sum) + x } else { (x - sum) + self.sum };
        self.sum = sum;
    }

    fn value(self) -> f64 {
        self.sum + self.lost
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: usize,
    log: Sum,
    signal: Sum,
    noise: Sum,
}

impl Sums {
    fn add(&mut self, error: f64, a: f64, b: f64) {
        self.count += 1;
        self.log.add(error * error);
        self.signal.add(a * a);
        self.noise.add((a - b) * (a - b));
    }

    fn merge(&mut self, other: &Sums) {
        self.count += other.count;
        self.log.add(other.log.value());
        self.signal.add(other.signal.value());
        self.noise.add(other.noise.value());
    }

    /// The figures; `magnitudes` are the |log error| of the same entries and are put in another order.
    fn errors(&self, magnitudes: &mut [f64]) -> Errors {
        let n = magnitudes.len();
        let log_p999 = match n {
            0 => 0.0,
            _ => {
                let rank = ((n as f64 * 0.999).ceil() as usize).clamp(1, n);
                *magnitudes.select_nth_unstable_by(rank - 1, f64::total_cmp).1
            }
        };
        let (signal, noise) = (self.signal.value(), self.noise.value());
        let snr_db = match (signal > 0.0, noise > 0.0) {
            (_, false) => f64::INFINITY,
            (false, true) => f64::NEG_INFINITY,
            (true, true) => 10.0 * (signal.log10() - noise.log10()),
        };
        Errors {
            compared: n,
            log_rms: (self.log.value() / n.max(1) as f64).sqrt(),
            log_max: magnitudes.iter().fold(0.0, |m, x| m.max(*x)),
            log_p999,
            snr_db,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::grid::Grid;

    fn table(scale: [f64; 3], values: Vec<f64>) -> Table {
        let axis = crate::table::grid::Axis { len: values.len() / 3, ..Grid::merl().axes()[0] };
        Table::from_values(Grid::new(vec![axis], Grid::rgb_channels(scale)).unwrap(), values).unwrap()
    }

    #[test]
    fn a_known_factor_is_its_logarithm() {
        let a = table([2.0, 1.0, 1.0], (0..3000).map(|i| 1.0 + i as f64).collect());
        let mut values = a.values().to_vec();
        for v in &mut values[1000..2000] {
            *v = (*v + 1e-3) * 0.1f64.exp() - 1e-3;
        }
        // One entry in a thousand beyond the percentile.
        values[0] *= 100.0;
        let b = table([2.0, 1.0, 1.0], values);
        let c = compare(&a, &b).unwrap();
        assert_eq!(c.overall.compared, 3000);
        assert!((c.channels[1].log_rms - 0.1).abs() < 1e-12 && (c.channels[1].log_max - 0.1).abs() < 1e-12);
        assert!((c.channels[0].log_max - 100f64.ln()).abs() < 1e-2 && c.channels[0].log_p999 == 0.0);
        assert_eq!((c.channels[2].log_rms, c.channels[2].snr_db), (0.0, f64::INFINITY));
        // b = a e^0.1 nearly: noise is (e^0.1 - 1)^2 of the signal.
        assert!((c.channels[1].snr_db + 20.0 * (0.1f64.exp() - 1.0).log10()).abs() < 1e-4);
        assert!((c.overall.log_rms - ((1000.0 * 0.01 + c.channels[0].log_max.powi(2)) / 3000.0).sqrt()).abs() < 1e-9);
    }

    #[test]
    fn scales_are_applied_and_holes_counted() {
        let a = table([1.0; 3], vec![1.0, 2.0, -1.0, 4.0, 5.0, 6.0]);
        let b = table([0.5; 3], vec![2.0, 4.0, 6.0, -1.0, -1.0, 12.0]);
        let c = compare(&a, &b).unwrap();
        assert_eq!((c.only_in_reference, c.only_in_other, c.overall.compared), (2, 1, 3));
        assert_eq!((c.overall.log_max, c.overall.snr_db), (0.0, f64::INFINITY));
    }

    #[test]
    fn nothing_in_common_and_extreme_values_are_no_nan() {
        let a = table([1.0; 3], vec![1.0, -1.0, 1.0]);
        let b = table([1.0; 3], vec![f64::NAN, 1.0, f64::INFINITY]);
        let c = compare(&a, &b).unwrap();
        assert_eq!((c.overall.compared, c.only_in_reference, c.only_in_other), (0, 2, 1));
        assert_eq!((c.overall.log_rms, c.overall.log_p999, c.overall.snr_db), (0.0, 0.0, f64::INFINITY));
        let a = table([1e9; 3], vec![0.0, f64::MAX, 5e-324]);
        let b = table([1e9; 3], vec![f64::MAX, 0.0, f64::MAX]);
        for eps in [5e-324, 1e-3, f64::MAX] {
            let c = compare_with_eps(&a, &b, eps).unwrap();
            for e in c.channels.iter().chain([&c.overall]) {
                assert!(!e.snr_db.is_nan() && e.log_rms.is_finite() && e.log_max.is_finite() && e.log_p999.is_finite());
            }
        }
    }

    #[test]
    fn other_layouts_are_refused() {
        let a = table([1.0; 3], vec![1.0; 6]);
        assert!(compare(&a, &table([1.0; 3], vec![1.0; 9])).is_err());
        let mut channels = Grid::rgb_channels([1.0; 3]);
        channels[1].name = "X".into();
        let grid = Grid::new(a.grid().axes().to_vec(), channels).unwrap();
        assert!(compare(&a, &Table::from_values(grid, vec![1.0; 6]).unwrap()).is_err());
        assert!(compare_with_eps(&a, &a, 0.0).is_err() && compare_with_eps(&a, &a, f64::NAN).is_err());
    }
}
