//! Colours and markers: seven colours that colour-blind eyes distinguish (Okabe, Ito 2008, without the yellow), eight
//! shapes of marker; 56 pairs before the first returns.

use std::fmt::Write;

const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#333333"];

/// Half the extent of a marker.
const SIZE: f64 = 4.2;

/// How a series looks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style(pub usize);

impl Style {
    pub fn colour(self) -> &'static str {
        COLOURS[self.0 % COLOURS.len()]
    }

    /// The outline of the marker around a place.
    pub fn marker(self, x: f64, y: f64) -> String {
        let corners: &[(f64, f64)] = match self.0 % 8 {
            0 => {
                return format!(
                    "M{:.1} {y:.1}a{SIZE} {SIZE} 0 1 0 {d} 0a{SIZE} {SIZE} 0 1 0 -{d} 0z",
                    x - SIZE,
                    d = 2.0 * SIZE
                );
            }
            1 => &[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
            2 => &[(0.0, -1.2), (1.1, 0.8), (-1.1, 0.8)],
            3 => &[(0.0, -1.3), (1.3, 0.0), (0.0, 1.3), (-1.3, 0.0)],
            4 => &[(0.0, 1.2), (1.1, -0.8), (-1.1, -0.8)],
            5 => &[
                (-0.4, -1.2),
                (0.4, -1.2),
                (0.4, -0.4),
                (1.2, -0.4),
                (1.2, 0.4),
                (0.4, 0.4),
                (0.4, 1.2),
                (-0.4, 1.2),
                (-0.4, 0.4),
                (-1.2, 0.4),
                (-1.2, -0.4),
                (-0.4, -0.4),
            ],
            6 => &[(-1.2, -0.5), (1.2, -0.5), (1.2, 0.5), (-1.2, 0.5)],
            _ => &[(-0.5, -1.2), (0.5, -1.2), (0.5, 1.2), (-0.5, 1.2)],
        };
        let mut path = String::new();
        for (i, (dx, dy)) in corners.iter().enumerate() {
            let _ = write!(path, "{}{:.1} {:.1}", if i == 0 { 'M' } else { 'L' }, x + SIZE * dx, y + SIZE * dy);
        }
        path + "z"
    }

    /// A picture of line and marker for a legend.
    pub fn swatch(self) -> String {
        let (colour, marker) = (self.colour(), self.marker(14.0, 7.0));
        format!(
            "<svg width=\"28\" height=\"14\" aria-hidden=\"true\"><path d=\"M0 7H28\" stroke=\"{colour}\" \
             stroke-width=\"1.6\"/><path d=\"{marker}\" fill=\"{colour}\"/></svg>"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fifty_six_styles_differ() {
        let mut pairs: Vec<_> = (0..56).map(|i| (Style(i).colour(), Style(i).marker(10.0, 10.0))).collect();
        pairs.sort();
        pairs.dedup();
        assert_eq!(pairs.len(), 56);
    }
}
