//! A logarithmic axis: its range, its ticks, their labels.

/// Values from `low` to `high`, both above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    pub low: f64,
    pub high: f64,
}

/// An axis covers at least this factor, so that no noise fills a plot.
const LEAST_FACTOR: f64 = 1.6;

/// Multiples of the powers of ten that carry ticks, from few to many.
const MULTIPLES: [&[u32]; 3] = [&[1], &[1, 3], &[1, 2, 5]];

impl Axis {
    /// The axis around values; those that are not finite and above 0 do not count. `None` without any.
    pub fn around(values: impl IntoIterator<Item = f64>) -> Option<Axis> {
        let usable = values.into_iter().filter(|v| is_plottable(*v));
        let (low, high) = usable.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
        if high == 0.0 {
            return None;
        }
        let (low, high) = (low.ln(), high.ln());
        let widen = 0.5 * (LEAST_FACTOR.ln() - (high - low)).max(0.0);
        let margin = widen + 0.04 * (high - low + 2.0 * widen);
        Some(Axis { low: (low - margin).exp().max(f64::MIN_POSITIVE), high: (high + margin).exp().min(f64::MAX) })
    }

    /// Where a value lies, 0 to 1 within the axis.
    pub fn place(&self, value: f64) -> f64 {
        (value.ln() - self.low.ln()) / (self.high.ln() - self.low.ln())
    }

    /// Values to label, three or more where double precision allows, in rising order.
    pub fn ticks(&self) -> Vec<f64> {
        let (first, last) = (self.low.log10(), self.high.log10());
        let decades = first.floor() as i32..=last.ceil() as i32;
        let within = |v: &f64| (self.low..=self.high).contains(v);
        if last - first > 8.0 {
            let every = ((last - first) / 6.0).ceil() as i32;
            return decades.filter(|d| d % every == 0).map(|d| 10f64.powi(d)).filter(within).collect();
        }
        for multiples in MULTIPLES {
            let powers = decades.clone().flat_map(|d| multiples.iter().map(move |&m| scaled(m.into(), d)));
            let ticks: Vec<f64> = powers.filter(within).collect();
            if ticks.len() >= 3 {
                return ticks;
            }
        }
        // A narrow axis: even steps of 1, 2 or 5 times a power of ten.
        let aim = (self.high - self.low) / 4.0;
        let decade = aim.log10().floor() as i32;
        let multiple = [1i64, 2, 5, 10].into_iter().find(|m| scaled(*m, decade) >= aim).unwrap_or(10);
        let step = scaled(multiple, decade);
        let numbers = (self.low / step).ceil() as i64..=(self.high / step).floor() as i64;
        numbers.map(|n| scaled(n * multiple, decade)).collect()
    }
}

/// Whether a logarithmic axis can show a value.
pub fn is_plottable(value: f64) -> bool {
    value.is_finite() && value > 0.0
}

/// n 10^decade, the double nearest to it as far as n and the power are exact.
fn scaled(n: i64, decade: i32) -> f64 {
    if decade < 0 { n as f64 / 10f64.powi(-decade) } else { n as f64 * 10f64.powi(decade) }
}

/// A tick's value as text: plain near 1, with a power of ten far from it.
pub fn tick_label(value: f64) -> String {
    if (1e-3..1e5).contains(&value) {
        let decimals = (2 - value.log10().floor() as i32).max(0) as usize;
        let text = format!("{value:.decimals$}");
        return match text.contains('.') {
            true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
            false => text,
        };
    }
    let text = format!("{value:.1e}");
    let (digits, power) = text.split_once('e').unwrap_or((&text, "0"));
    let raised: String = power.chars().map(superscript).collect();
    match digits.trim_end_matches('0').trim_end_matches('.') {
        "1" => format!("10{raised}"),
        digits => format!("{digits}\u{b7}10{raised}"),
    }
}

fn superscript(c: char) -> char {
    let raised = ['\u{2070}', '\u{b9}', '\u{b2}', '\u{b3}', '\u{2074}', '\u{2075}', '\u{2076}', '\u{2077}'];
    match c {
        '-' => '\u{207b}',
        '8' => '\u{2078}',
        '9' => '\u{2079}',
        c => c.to_digit(8).map_or(c, |d| raised[d as usize]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_suit_the_range() {
        let ticks = |low, high| Axis { low, high }.ticks();
        assert_eq!(ticks(0.003, 3.0), [0.01, 0.1, 1.0]);
        assert_eq!(ticks(0.9, 40.0), [1.0, 3.0, 10.0, 30.0]);
        assert_eq!(ticks(0.9, 11.0), [1.0, 3.0, 10.0]);
        assert_eq!(ticks(1.8, 11.0), [2.0, 5.0, 10.0]);
        assert_eq!(ticks(25.0, 41.0), [25.0, 30.0, 35.0, 40.0]);
        assert_eq!(ticks(1e-12, 1.1), [1e-12, 1e-9, 1e-6, 1e-3, 1.0]);
        for (low, high) in [(1e-300, 1e300), (0.010, 0.0161), (9.99, 16.0), (1e-5, 1e5), (7.0, 7.0e3)] {
            let ticks = ticks(low, high);
            assert!((3..=9).contains(&ticks.len()), "{low} {high}: {ticks:?}");
            assert!(ticks.windows(2).all(|w| w[0] < w[1]) && ticks.iter().all(|t| (low..=high).contains(t)));
        }
    }

    #[test]
    fn axes_hold_their_values_and_are_never_empty() {
        assert_eq!(Axis::around([0.0, f64::NAN, f64::INFINITY, -1.0]), None);
        for values in [vec![3.0], vec![1.0, 1e6], vec![5.0, 5.01, 0.0], vec![1e-300, 1e300]] {
            let axis = Axis::around(values.iter().copied()).unwrap();
            assert!(axis.high / axis.low >= 1.59 && axis.high.is_finite());
            assert!(values.iter().filter(|v| **v > 0.0).all(|v| (0.0..1.0).contains(&axis.place(*v))), "{axis:?}");
        }
        assert!((Axis { low: 1.0, high: 100.0 }.place(10.0) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn labels_are_short() {
        let labels = [0.001, 0.05, 0.3, 1.0, 25.0, 20000.0, 1e5, 3e-4, 1e-12].map(tick_label);
        let expected = [
            "0.001",
            "0.05",
            "0.3",
            "1",
            "25",
            "20000",
            "10\u{2075}",
            "3\u{b7}10\u{207b}\u{2074}",
            "10\u{207b}\u{b9}\u{b2}",
        ];
        assert_eq!(labels, expected);
    }
}
