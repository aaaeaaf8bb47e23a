//! Plots as SVG text.

use plotters::coord::Shift;
use plotters::prelude::*;

use crate::failure::Failure;

const FROM: RGBColor = RGBColor(0xd9, 0x5f, 0x02);
const TO: RGBColor = RGBColor(0x1b, 0x6c, 0xa8);
/// Colours of lines: those of Okabe and Ito, then again.
const LINES: [RGBColor; 7] = [
    RGBColor(0xe6, 0x9f, 0x00),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x00, 0x00),
    RGBColor(0x00, 0x9e, 0x73),
    RGBColor(0x56, 0xb4, 0xe9),
    RGBColor(0xcc, 0x79, 0xa7),
    RGBColor(0x00, 0x72, 0xb2),
];
const GREY: RGBColor = RGBColor(0x99, 0x99, 0x99);

/// Two values of one material.
pub struct Mark {
    pub name: String,
    pub from: f64,
    pub to: f64,
}

/// A line by name.
pub struct Line {
    pub name: String,
    pub points: Vec<(f64, f64)>,
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

fn svg(width: u32, height: u32, draw: impl FnOnce(&Area) -> Drawn) -> Result<String, Failure> {
    let mut text = String::new();
    let area = SVGBackend::with_string(&mut text, (width, height)).into_drawing_area();
    let drawn = area.fill(&WHITE).and_then(|()| draw(&area)).and_then(|()| area.present());
    drop(area);
    drawn.map_err(|e| Failure::operation(format!("cannot draw a plot: {e}")))?;
    Ok(text)
}

/// A row a material, two dots joined by a line.
pub fn dumbbells(title: &str, axis: &str, labels: [&str; 2], marks: &[Mark]) -> Result<String, Failure> {
    let known = |m: &&Mark| m.from.is_finite() && m.to.is_finite();
    let values = || marks.iter().filter(known).flat_map(|m| [m.from, m.to]);
    let (low, high) = (values().fold(1.0, f64::min), values().fold(0.0, f64::max));
    let pad = 0.05 * (high - low).max(0.02);
    rows(title, axis, labels, marks, [low - pad, high + pad], Shape::Dots)
}

/// A row a material, two bars from zero.
pub fn bars(title: &str, axis: &str, labels: [&str; 2], marks: &[Mark]) -> Result<String, Failure> {
    let high = marks.iter().flat_map(|m| [m.from, m.to]).filter(|v| v.is_finite()).fold(0.0, f64::max);
    rows(title, axis, labels, marks, [0.0, 1.05 * high.max(0.1)], Shape::Bars)
}

/// How a row is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Shape {
    Dots,
    Bars,
}

fn rows(
    title: &str,
    axis: &str,
    labels: [&str; 2],
    marks: &[Mark],
    range: [f64; 2],
    shape: Shape,
) -> Result<String, Failure> {
    let count = marks.len().max(1);
    // Room for the legend above the first row.
    let top = count as f64 + 1.4;
    svg(760, 150 + 22 * count as u32, |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(title, ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(44)
            .y_label_area_size(190)
            .build_cartesian_2d(range[0]..range[1], -0.5..top)?;
        // The first material on top; labels come at halves too.
        let name = |y: &f64| {
            let at = count as f64 - 1.0 - y;
            let near = (at - at.round()).abs() < 1e-6 && at > -0.5;
            marks.get(at.round() as usize).filter(|_| near).map_or(String::new(), |m| m.name.clone())
        };
        chart
            .configure_mesh()
            .x_desc(axis)
            .y_labels(2 * count + 4)
            .disable_y_mesh()
            .y_label_formatter(&name)
            .x_label_style(("sans-serif", 13))
            .y_label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 14))
            .light_line_style(TRANSPARENT)
            .draw()?;
        for (i, mark) in marks.iter().enumerate().filter(|(_, m)| m.from.is_finite() && m.to.is_finite()) {
            let y = (count - 1 - i) as f64;
            let both = [(mark.from, FROM), (mark.to, TO)];
            if shape == Shape::Dots {
                let ends = both.map(|(x, _)| (x, y)).to_vec();
                chart.draw_series([PathElement::new(ends, GREY.stroke_width(2))])?;
                chart.draw_series(both.map(|(x, colour)| Circle::new((x, y), 5, colour.filled())))?;
            } else {
                let low = [y, y - 0.32];
                let bars = [0, 1].map(|k| (low[k], both[k]));
                chart.draw_series(
                    bars.map(|(low, (x, colour))| Rectangle::new([(0.0, low), (x, low + 0.32)], colour.filled())),
                )?;
            }
        }
        for (label, colour) in labels.into_iter().zip([FROM, TO]) {
            chart
                .draw_series(std::iter::empty::<Circle<(f64, f64), i32>>())?
                .label(label)
                .legend(move |(x, y)| Circle::new((x + 8, y), 5, colour.filled()));
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .label_font(("sans-serif", 13))
            .background_style(WHITE.mix(0.85))
            .border_style(GREY)
            .draw()
    })
}

/// Lines over a logarithmic axis, with a dashed line at `level`. Infinite values are left out.
pub fn lines(title: &str, axes: [&str; 2], level: f64, all: &[Line]) -> Result<String, Failure> {
    let points = || all.iter().flat_map(|l| &l.points).filter(|p| p.1.is_finite());
    let span = |of: fn(&(f64, f64)) -> f64| {
        (points().map(of).fold(f64::INFINITY, f64::min), points().map(of).fold(f64::NEG_INFINITY, f64::max))
    };
    let ((left, right), (low, high)) =
        if points().next().is_some() { (span(|p| p.0), span(|p| p.1)) } else { ((1.0, 2.0), (level, level)) };
    let mut shares: Vec<f64> = points().map(|p| p.0).collect();
    shares.sort_unstable_by(f64::total_cmp);
    shares.dedup();
    let ticks = (0.8 * left..1.25 * right).log_scale().with_key_points(shares);
    svg(760, 460, |area| {
        let mut chart = ChartBuilder::on(area)
            .caption(title, ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(44)
            .y_label_area_size(56)
            .build_cartesian_2d(ticks, low.min(level) - 2.0..high.max(level) + 2.0)?;
        chart
            .configure_mesh()
            .x_desc(axes[0])
            .y_desc(axes[1])
            .x_label_formatter(&|x| format!("{x}"))
            .y_label_formatter(&|y| format!("{y:.0}"))
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 14))
            .light_line_style(TRANSPARENT)
            .draw()?;
        chart.draw_series(DashedLineSeries::new([(0.8 * left, level), (1.25 * right, level)], 6, 4, GREY.into()))?;
        for (i, line) in all.iter().enumerate() {
            let colour = LINES[i % LINES.len()];
            let known = || line.points.iter().copied().filter(|p| p.1.is_finite());
            chart
                .draw_series(LineSeries::new(known(), colour.stroke_width(2)))?
                .label(&line.name)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], colour.stroke_width(2)));
            chart.draw_series(known().map(|p| Circle::new(p, 4, colour.filled())))?;
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::LowerRight)
            .label_font(("sans-serif", 13))
            .background_style(WHITE.mix(0.85))
            .border_style(GREY)
            .draw()
    })
}
