//! One plot as SVG, both axes logarithmic. No script: tool tips are titles, points are links.

use std::fmt::Write;

use super::axis::{Axis, is_plottable, tick_label};
use super::style::Style;
use crate::quote::html;

const WIDTH: f64 = 440.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 66.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 44.0;

/// A polyline.
pub struct Line {
    pub style: Style,
    pub points: Vec<(f64, f64)>,
    pub title: String,
}

/// A point.
pub struct Mark {
    pub style: Style,
    pub at: (f64, f64),
    pub title: String,
    /// Where a click leads, if anywhere.
    pub link: Option<String>,
}

/// What to draw; places that a logarithmic axis cannot show are left out.
#[derive(Default)]
pub struct Plot {
    /// Names of the axes, with units.
    pub x: String,
    pub y: String,
    pub lines: Vec<Line>,
    pub marks: Vec<Mark>,
    /// The Pareto front, by rising x.
    pub front: Vec<(f64, f64)>,
    /// Places that the axes reach to besides, so that plots of parts compare.
    pub reach: Vec<(f64, f64)>,
    /// Values of y with a dashed line across.
    pub levels: Vec<(f64, String)>,
}

/// Range of the axes and the way into the picture.
struct Frame {
    x: Axis,
    y: Axis,
}

impl Frame {
    fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let right = self.x.place(x) * (WIDTH - LEFT - RIGHT);
        (LEFT + right, TOP + (1.0 - self.y.place(y)) * (HEIGHT - TOP - BOTTOM))
    }

    fn path(&self, points: &[(f64, f64)]) -> String {
        let mut path = String::new();
        for (i, &point) in points.iter().enumerate() {
            let (x, y) = self.at(point);
            let _ = write!(path, "{}{x:.1} {y:.1}", if i == 0 { 'M' } else { 'L' });
        }
        path
    }
}

fn shown(&(x, y): &(f64, f64)) -> bool {
    is_plottable(x) && is_plottable(y)
}

impl Plot {
    /// The picture.
    pub fn svg(&self) -> String {
        let lines = || self.lines.iter().flat_map(|l| &l.points).chain(&self.reach).copied();
        let all = || lines().chain(self.marks.iter().map(|m| m.at));
        let xs = Axis::around(all().filter(shown).map(|p| p.0));
        let ys = Axis::around(all().filter(shown).map(|p| p.1).chain(self.levels.iter().map(|l| l.0)));
        let mut out = format!(
            "<svg class=\"plot\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" font-family=\"sans-serif\" \
             font-size=\"12\" xmlns=\"http://www.w3.org/2000/svg\">\n<title>{} against {}</title>\n",
            html(&self.y),
            html(&self.x)
        );
        match (xs, ys) {
            (Some(x), Some(y)) => self.draw(&Frame { x, y }, &mut out),
            _ => out.push_str("<text x=\"60\" y=\"60\" fill=\"#555\">nothing to show</text>"),
        }
        out.push_str("</svg>\n");
        out
    }

    fn draw(&self, frame: &Frame, out: &mut String) {
        self.draw_axes(frame, out);
        for (level, title) in &self.levels {
            let y = frame.at((frame.x.low, *level)).1;
            let _ = writeln!(
                out,
                "<path d=\"M{LEFT} {y:.1}H{:.1}\" stroke=\"#555\" stroke-dasharray=\"5 4\"><title>{}</title></path>",
                WIDTH - RIGHT,
                html(title)
            );
        }
        if !self.front.is_empty() {
            let _ = writeln!(
                out,
                "<path d=\"{}\" fill=\"none\" stroke=\"#bbb\" stroke-width=\"7\" stroke-linejoin=\"round\" \
                 stroke-linecap=\"round\" opacity=\"0.55\"><title>Pareto front</title></path>",
                frame.path(&staircase(&self.front))
            );
        }
        for line in &self.lines {
            let points: Vec<_> = line.points.iter().copied().filter(shown).collect();
            let _ = writeln!(
                out,
                "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.5\" stroke-linejoin=\"round\">\
                 <title>{}</title></path>",
                frame.path(&points),
                line.style.colour(),
                html(&line.title)
            );
        }
        for mark in self.marks.iter().filter(|m| shown(&m.at)) {
            let (x, y) = frame.at(mark.at);
            let point = format!(
                "<path class=\"mark\" d=\"{}\" fill=\"{}\" stroke=\"#fff\" stroke-width=\"0.7\"><title>{}</title></path>",
                mark.style.marker(x, y),
                mark.style.colour(),
                html(&mark.title)
            );
            let _ = match &mark.link {
                Some(link) => writeln!(out, "<a href=\"{}\">{point}</a>", html(link)),
                None => writeln!(out, "{point}"),
            };
        }
    }

    fn draw_axes(&self, frame: &Frame, out: &mut String) {
        let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
        for tick in frame.x.ticks() {
            let x = frame.at((tick, frame.y.low)).0;
            let _ = writeln!(
                out,
                "<path d=\"M{x:.1} {TOP}V{bottom}\" stroke=\"#e4e4e4\"/><text x=\"{x:.1}\" y=\"{}\" \
                 text-anchor=\"middle\">{}</text>",
                bottom + 16.0,
                tick_label(tick)
            );
        }
        for tick in frame.y.ticks() {
            let y = frame.at((frame.x.low, tick)).1;
            let _ = writeln!(
                out,
                "<path d=\"M{LEFT} {y:.1}H{right}\" stroke=\"#e4e4e4\"/><text x=\"{}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{}</text>",
                LEFT - 6.0,
                y + 4.0,
                tick_label(tick)
            );
        }
        let (middle, centre) = (0.5 * (LEFT + right), 0.5 * (TOP + bottom));
        let _ = writeln!(
            out,
            "<path d=\"M{LEFT} {TOP}V{bottom}H{right}\" fill=\"none\" stroke=\"#333\"/>\
             <text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
             <text transform=\"translate(12 {centre}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            HEIGHT - 8.0,
            html(&self.x),
            html(&self.y)
        );
    }
}

/// The border of what is reached by a front: level up to the next point, then down to it.
fn staircase(front: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut corners = Vec::new();
    for point in front.iter().filter(|p| shown(p)) {
        if let Some(&(_, y)) = corners.last() {
            corners.push((point.0, y));
        }
        corners.push(*point);
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_mark_has_its_title_and_stays_in_the_frame() {
        let mark = |at, title: &str| Mark { style: Style(0), at, title: title.into(), link: Some("#a&b".into()) };
        let plot = Plot {
            x: "s".into(),
            y: "error <log>".into(),
            marks: vec![mark((1.0, 2.0), "a<b"), mark((10.0, 0.5), "c"), mark((0.0, 1.0), "hidden")],
            front: vec![(1.0, 2.0), (10.0, 0.5)],
            ..Plot::default()
        };
        let svg = plot.svg();
        assert!(
            svg.contains("<title>a&lt;b</title>")
                && svg.contains("href=\"#a&amp;b\"")
                && svg.contains("error &lt;log&gt;")
        );
        assert!(!svg.contains("hidden") && !svg.contains("NaN") && !svg.contains("inf"));
        assert_eq!(svg.matches("class=\"mark\"").count(), 2);
        assert!(Plot::default().svg().contains("nothing to show"));
    }

    #[test]
    fn the_front_is_a_staircase() {
        assert_eq!(staircase(&[(1.0, 3.0), (2.0, 1.0)]), [(1.0, 3.0), (2.0, 3.0), (2.0, 1.0)]);
    }
}
