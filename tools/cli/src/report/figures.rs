//! What each plot of the page shows.

use super::Tried;
use super::axis::is_plottable;
use super::front::pareto_front;
use super::plot::{Line, Mark, Plot};
use super::point::{Point, anchor};
use super::solver_log::Followed;
use super::style::Style;
use crate::text::{decibel, error_figure, grouped};

/// Vertices of a followed solve's line at most: even steps in the logarithm.
const VERTICES: f64 = 150.0;

/// Error against encode seconds, decode seconds and bytes for some of the series, with the front of all points.
pub fn precision(table: usize, tried: &Tried, series: &[usize]) -> [Plot; 3] {
    type Cost = fn(&Point) -> f64;
    let costs: [(&str, Cost); 3] = [
        ("encode, s", |p| p.encode_seconds),
        ("decode, ms", |p| 1e3 * p.decode_seconds),
        ("file, kB", |p| p.bytes as f64 / 1e3),
    ];
    costs.map(|(x, cost)| {
        let place = |p: &Point| (cost(p), p.log_rms);
        let places: Vec<_> = tried.points.iter().map(place).collect();
        let mut plot = Plot {
            x: x.into(),
            y: "log rms error".into(),
            front: pareto_front(&places).into_iter().map(|i| places[i]).collect(),
            reach: places.clone(),
            ..Plot::default()
        };
        for &number in series {
            let (style, series) = (Style(number), &tried.plan.series[number]);
            let found = |s: &String| tried.points.iter().position(|p| p.settings == *s);
            let points: Vec<usize> = series.settings.iter().filter_map(found).collect();
            let line = points.iter().map(|&i| places[i]).collect();
            plot.lines.push(Line { style, points: line, title: series.name.clone() });
            plot.marks.extend(points.iter().map(|&i| Mark {
                style,
                at: places[i],
                title: describe(&series.name, &tried.points[i]),
                link: Some(format!("#{}", anchor(table, i))),
            }));
        }
        plot
    })
}

/// The tool tip of a point.
fn describe(series: &str, p: &Point) -> String {
    let psnr = p.psnr.map(|db| format!(", render PSNR {} dB", decibel(db))).unwrap_or_default();
    format!(
        "{series}\n{} bytes, log rms {}, max {}{psnr}\nencode {:.2} s, decode {:.1} ms, {} iterations\n{}",
        grouped(p.bytes),
        error_figure(p.log_rms),
        error_figure(p.log_max),
        p.encode_seconds,
        1e3 * p.decode_seconds,
        grouped(p.iterations),
        p.command
    )
}

/// Residual and gap against iterations and seconds, of the first component of a block with several settings.
pub fn following(followed: &[Followed]) -> Vec<Plot> {
    type Of = fn(&csbrdf::encode::solver_log::Step) -> f64;
    let xs: [(&str, Of); 2] = [("iterations", |s| s.iterations as f64), ("seconds", |s| s.seconds)];
    let ys: [(&str, Of); 2] = [("residual, rms", |s| s.residual), ("relative duality gap", |s| s.gap)];
    let mut plots = Vec::new();
    for (y_name, y) in ys {
        for (x_name, x) in xs {
            let mut plot = Plot { x: x_name.into(), y: y_name.into(), ..Plot::default() };
            for (i, (followed, trace)) in followed.iter().filter_map(|f| Some((f, f.traces.first()?))).enumerate() {
                let style = Style(i);
                let points: Vec<_> = trace.steps.iter().map(|s| (x(s), y(s))).collect();
                plot.lines.push(Line { style, points: thin(&points), title: followed.settings.clone() });
                if let Some(step) = trace.steps.get(trace.reached) {
                    let title = format!(
                        "{}\nsigma reached, or the limit of iterations: {} iterations, {:.2} ms, residual {}, gap {}",
                        followed.settings,
                        step.iterations,
                        1e3 * step.seconds,
                        error_figure(step.residual),
                        error_figure(step.gap)
                    );
                    plot.marks.push(Mark { style, at: points[trace.reached], title, link: None });
                }
                let known = plot.levels.iter().any(|l| l.0 == trace.sigma);
                if y_name.starts_with("residual") && !known && is_plottable(trace.sigma) {
                    plot.levels.push((trace.sigma, format!("sigma = {}", trace.sigma)));
                }
            }
            plots.push(plot);
        }
    }
    plots
}

/// The points that a logarithmic axis can show apart, the last included.
fn thin(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let usable: Vec<_> = points.iter().copied().filter(|p| is_plottable(p.0) && is_plottable(p.1)).collect();
    let (Some(first), Some(last)) = (usable.first(), usable.last()) else { return Vec::new() };
    let least = (last.0 / first.0).ln() / VERTICES;
    let mut kept = vec![*first];
    for point in &usable[1..] {
        if (point.0 / kept[kept.len() - 1].0).ln() >= least || point == last {
            kept.push(*point);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_thinned() {
        let points: Vec<_> = (0..10_000).map(|i| (f64::from(i), 1.0)).collect();
        let kept = thin(&points);
        assert!(kept.len() < 155 && kept[0] == (1.0, 1.0) && kept[kept.len() - 1] == (9999.0, 1.0));
        assert!(thin(&[(0.0, 1.0)]).is_empty());
    }
}
