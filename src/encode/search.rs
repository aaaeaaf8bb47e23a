//! Searches over the quantiser step: nearest to a limit, or least.
//!
//! Trials are whole encodes and few; both searches think in logarithms, where errors and sizes are almost straight lines.

use crate::base::error::{Error, Result};
use crate::base::limits::STEP_RANGE;

/// Logarithm of a step, and what its trial came to.
type Point = (f64, f64);

/// Trials after which the best so far is taken.
const TRIALS: usize = 6;
/// Trials in all where none keeps the limit yet.
const MOST: usize = 14;
/// Largest change of the logarithm of the step between trials.
const STRIDE: f64 = 2.8;

/// Why a search has nothing to give.
#[derive(Debug)]
pub(super) enum Missed {
    /// Not even the first trial could be made.
    Failed(Error),
    /// No trial keeps the limit; this came nearest.
    Best { excess: f64, step: f32, trials: usize },
}

/// The trial whose excess, rising (`slope` 1) or falling (-1) with the step, is nearest to 0 and not above; content with
/// `tolerance` below. A trial that fails bounds the steps: what lies beyond is not tried.
pub(super) fn nearest<T>(
    start: f32,
    slope: f64,
    tolerance: f64,
    trial: &mut dyn FnMut(f32) -> Result<(T, f64)>,
) -> std::result::Result<T, Missed> {
    let range = [STEP_RANGE.start(), STEP_RANGE.end()].map(|&step| f64::from(step).ln());
    let aim = -0.4 * tolerance;
    let mut at = f64::from(start).ln();
    // Nearest point on each side, logarithm of the step and excess; all broken ones, in order of trial.
    let mut kept: Option<Point> = None;
    let mut broken: Option<Point> = None;
    let mut points: Vec<Point> = Vec::new();
    // The same ends as the next interpolation takes them, and the side that the last trial was on.
    let (mut ends, mut last) = ([None; 2], None);
    let mut best: Option<T> = None;
    let mut trials = 0;
    while trials < if best.is_some() { TRIALS } else { MOST } {
        trials += 1;
        let (value, excess) = match trial(at.exp() as f32) {
            Ok(result) => result,
            Err(error) if points.is_empty() => return Err(Missed::Failed(error)),
            Err(_) => break,
        };
        points.push((at, excess));
        if excess > 0.0 {
            if broken.is_none_or(|(_, least)| excess < least) {
                broken = Some((at, excess));
            }
        } else if kept.is_none_or(|(_, most)| excess > most) {
            (kept, best) = (Some((at, excess)), Some(value));
        }
        let side = usize::from(excess > 0.0);
        ends[side] = [kept, broken][side];
        // An end that stays while the other moves twice would hold the search up (the Illinois rule).
        if last == Some(side)
            && let Some((_, other)) = &mut ends[1 - side]
        {
            *other *= 0.5;
        }
        last = Some(side);
        if kept.is_some_and(|(_, excess)| excess >= -tolerance) || (best.is_none() && flat(&points)) {
            break;
        }
        let next = next_step(&points, ends, aim, slope);
        let next = next.clamp(range[0], range[1]);
        if (next - at).abs() < 1e-6 {
            break;
        }
        at = next;
    }
    best.ok_or_else(|| {
        let (at, excess) = broken.expect("a trial was made");
        Missed::Best { excess, step: at.exp() as f32, trials: points.len() }
    })
}

/// Where to try next: between the ends, or further along the line through the last two points.
fn next_step(points: &[Point], ends: [Option<Point>; 2], aim: f64, slope: f64) -> f64 {
    if let [Some(a), Some(b)] = ends {
        let share: f64 = (aim - a.1) / (b.1 - a.1);
        return a.0 + share.clamp(0.05, 0.95) * (b.0 - a.0);
    }
    let own = match points[..] {
        [.., a, b] if a.0 != b.0 => (b.1 - a.1) / (b.0 - a.0),
        _ => slope,
    };
    let own = if own * slope > 0.02 { own } else { slope };
    // Where little changes so far, more may change further on.
    let stride = if own * slope < 0.5 { STRIDE / 2.0 } else { STRIDE };
    let &(at, excess) = points.last().expect("a trial was made");
    at + ((aim - excess) / own).clamp(-stride, stride)
}

/// Whether the last trials, over a factor of 16 of the step and more, changed nothing to speak of.
fn flat(points: &[Point]) -> bool {
    let Some(&(at, excess)) = points.last() else { return false };
    points.iter().any(|&(other, before)| (at - other).abs() > 16f64.ln() && before - excess < 0.05 * excess)
}

/// Logarithm of the factor between the first trials of [`least`].
const PACE: f64 = 0.5;
/// Gain in a logarithm for which a last trial is made.
const WORTH: f64 = 0.002;

/// The trial of least cost; the cost has one minimum over the step. Steps whose trials fail are dearer than any other.
pub(super) fn least<T>(start: f32, trial: &mut dyn FnMut(f32) -> Result<(T, f64)>) -> std::result::Result<T, Missed> {
    let mut best: Option<(T, f64, f64)> = None;
    let mut points: Vec<Point> = Vec::new();
    let mut failure = None;
    let mut attempt = |at: f64, points: &mut Vec<Point>, best: &mut Option<(T, f64, f64)>| {
        let cost = match trial(at.exp() as f32) {
            Ok((value, cost)) => {
                if best.as_ref().is_none_or(|(_, _, least)| cost < *least) {
                    *best = Some((value, at, cost));
                }
                cost
            }
            Err(error) => {
                failure.get_or_insert(error);
                f64::INFINITY
            }
        };
        points.push((at, cost));
        cost
    };
    let first = f64::from(start).ln();
    // Where nothing works at first, too fine a step is the likely reason.
    let mut at = first;
    while attempt(at, &mut points, &mut best).is_infinite() && points.len() < TRIALS {
        at += STRIDE / 2.0;
    }
    if best.is_some() {
        let ahead = attempt(at + PACE, &mut points, &mut best);
        let direction = if best.as_ref().is_some_and(|(_, _, cost)| *cost == ahead) { 1.0 } else { -1.0 };
        let mut next = if direction > 0.0 { at + 2.0 * PACE } else { at - PACE };
        while points.len() < TRIALS + 1 {
            let before = best.as_ref().map(|(_, _, cost)| *cost);
            let cost = attempt(next, &mut points, &mut best);
            if before.is_some_and(|before| cost >= before) {
                break;
            }
            next += direction * PACE;
        }
        if let Some((at, gain)) = vertex(&points, best.as_ref().map_or(at, |(_, at, _)| *at))
            && gain > WORTH
        {
            attempt(at, &mut points, &mut best);
        }
    }
    match best {
        Some((value, _, _)) => Ok(value),
        None => Err(Missed::Failed(failure.expect("trials without a result have failed"))),
    }
}

/// Place of the minimum of the parabola through the point at `at` and its neighbours, and how far below it that is.
fn vertex(points: &[Point], at: f64) -> Option<(f64, f64)> {
    let mut sorted: Vec<Point> = points.iter().copied().filter(|(_, cost)| cost.is_finite()).collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let middle = sorted.iter().position(|p| p.0 == at)?;
    let [a, b, c] = sorted.get(middle.checked_sub(1)?..middle + 2)?.try_into().ok()?;
    let (left, right) = ((b.1 - a.1) / (b.0 - a.0), (c.1 - b.1) / (c.0 - b.0));
    let curvature = (right - left) / (c.0 - a.0);
    if curvature <= 0.0 {
        return None;
    }
    let slope = left + curvature * (b.0 - a.0);
    let offset = -slope / (2.0 * curvature);
    Some((b.0 + offset, curvature * offset * offset))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Finds `f(step) = 1` from below; gives the value and the number of trials.
    fn seek(start: f32, slope: f64, f: impl Fn(f64) -> f64) -> (std::result::Result<f64, Missed>, usize) {
        let mut count = 0;
        let found = nearest(start, slope, 0.02, &mut |step| {
            count += 1;
            Ok((f(step.into()), f(step.into()).ln()))
        });
        (found, count)
    }

    #[test]
    fn limits_are_met_in_few_trials() {
        let curves: [(f64, &dyn Fn(f64) -> f64); 5] = [
            (1.0, &|s| s / 0.37),
            (1.0, &|s| (0.3 + s * s).sqrt() / 0.8),
            (1.0, &|s| (s / 0.02).powf(0.7)),
            (-1.0, &|s| 0.2 / s.powf(0.8) + 0.05),
            (-1.0, &|s| 0.01 / s),
        ];
        for (i, (slope, f)) in curves.into_iter().enumerate() {
            for start in [0.1, 0.9] {
                let (found, count) = seek(start, slope, f);
                let found = found.unwrap();
                assert!(found <= 1.0 && found > 0.97 && count <= 6, "{i} {start}: {found} {count}");
            }
        }
    }

    #[test]
    fn unreachable_limits_are_told_with_the_best() {
        let (found, count) = seek(0.1, 1.0, |s| 2.0 + s);
        let Err(Missed::Best { excess, .. }) = found else { panic!("{found:?}") };
        assert!((excess - 2f64.ln()).abs() < 0.05 && count <= 6, "{excess} {count}");
        let failed = nearest(0.1, 1.0, 0.02, &mut |_| Err::<((), f64), _>(Error::InvalidArgument("no".into())));
        assert!(matches!(failed, Err(Missed::Failed(_))));
        // Steps below the start cannot be had.
        let wall = nearest(0.1, 1.0, 0.02, &mut |step| {
            if step < 0.05 { Err(Error::InvalidArgument("too fine".into())) } else { Ok(((), 1.0)) }
        });
        assert!(matches!(wall, Err(Missed::Best { trials: 1, .. })));
    }

    #[test]
    fn the_least_is_found_from_either_side() {
        for start in [0.02f32, 0.1, 0.3] {
            let mut count = 0;
            let cost = |step: f64| (step / 0.1).ln().powi(2) * 0.1;
            let found = least(start, &mut |step| {
                count += 1;
                Ok((cost(step.into()), cost(step.into())))
            });
            assert!(found.unwrap() < 0.003 && count <= 8, "{start} {count}");
        }
        let found = least(1e-5, &mut |step| {
            if step < 1e-4 { Err(Error::InvalidArgument("too fine".into())) } else { Ok((step, f64::from(step))) }
        });
        assert!(found.unwrap() < 4e-4);
    }
}
