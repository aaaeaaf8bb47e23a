//! Fit of the grazing profile (encoder only; spec section 4.10).
//!
//! The tables are to leave a remainder with few edges, not a small one: a smooth remainder costs nothing. So they are
//! fitted to the differences between neighbouring bins along theta_d and phi_d near the horizon, with the robust weights
//! delta / (|r| + delta) and a penalty on squared second differences of the tables; conjugate gradients, reweighted a few times.
//!
//! Measured (9 x 9 x 36, step 0.1, kB / log rms, without -> by least squares -> robust): alum-bronze 72 / .0080, 54 / .0080, 50 /
//! .0077; chrome-steel 135 / .0094, 63 / .0086, 54 / .0082; RGL golden yellow 79 / .0090, 80 / .0093, 70 / .0087; paper white 36.7 / .0054,
//! 37.0 / .0058, 32.6 / .0054. Tables of the whole range of elevations fitted to the values themselves: no gain on golden yellow
//! and paper white, since what they miss at the horizon is spread over everything.

use rayon::prelude::*;

use super::Effort;
use crate::channel::ChannelTransform;
use crate::entropy::{self, Walk};
use crate::format::profile::{CodedProfile, TABLES};
use crate::format::{MAX_BLOCK_AXIS, check_block};
use crate::fourier::Basis;
use crate::fourier::forward::Transform;
use crate::grid::Grid;
use crate::profile::{Place, Profile, bins};
use crate::quantize::{Quantizer, quantize_mean};
use crate::range::Encoder;

/// Knots along the elevation, and where the profile ends; within 2 % for zones of .12 to .5 and 16 to 32 knots.
const KNOTS: usize = 24;
const ZONE: f32 = 0.15;

/// Residual from which a difference loses weight, log domain.
const DELTA: f32 = 0.05;
const SMOOTHNESS: f32 = 0.5;
const RIDGE: f32 = 0.1;

/// Every so many bins of theta_h take part: the tables between are smooth.
const STRIDE: usize = 2;

/// Fewer differences than this tell no profile.
const LEAST_PAIRS: usize = 2000;

/// Positions of one bin of theta_h that are near the horizon.
struct Plane {
    h: usize,
    /// theta_d and the range of its places.
    rows: Vec<(usize, std::ops::Range<usize>)>,
    places: Vec<Place>,
    /// Where each place is in a plane of the table.
    positions: Vec<u32>,
    /// Neighbours along theta_d or phi_d.
    pairs: Vec<(u32, u32)>,
}

/// Tables `[table][bin][knot]` of one component.
#[derive(Clone)]
struct Tables([Vec<f32>; TABLES]);

impl Tables {
    fn zero(bins: [usize; 2]) -> Tables {
        Tables(std::array::from_fn(|t| vec![0.0; bins[t / 2] * KNOTS]))
    }

    fn zip(&mut self, other: &Tables, mut f: impl FnMut(&mut f32, f32)) {
        for (a, b) in self.0.iter_mut().zip(&other.0) {
            a.iter_mut().zip(b).for_each(|(a, &b)| f(a, b));
        }
    }

    fn plus(mut self, other: Tables) -> Tables {
        self.zip(&other, |a, b| *a += b);
        self
    }

    fn dot(&self, other: &Tables) -> f64 {
        let pairs = self.0.iter().flatten().zip(other.0.iter().flatten());
        pairs.map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()
    }

    /// Adds the gradient of the penalty at `x`.
    fn add_penalty(&mut self, x: &Tables) {
        let second = |out: &mut Vec<f32>, x: &[f32], at: usize, stride: usize| {
            let bend = SMOOTHNESS * (x[at - stride] - 2.0 * x[at] + x[at + stride]);
            out[at - stride] += bend;
            out[at] -= 2.0 * bend;
            out[at + stride] += bend;
        };
        for (out, x) in self.0.iter_mut().zip(&x.0) {
            let bins = x.len() / KNOTS;
            for bin in 0..bins {
                (1..KNOTS - 1).for_each(|e| second(out, x, bin * KNOTS + e, 1));
                if bin > 0 && bin + 1 < bins {
                    (0..KNOTS).for_each(|e| second(out, x, bin * KNOTS + e, KNOTS));
                }
            }
            out.iter_mut().zip(x).for_each(|(out, x)| *out += RIDGE * x);
        }
    }
}

impl Plane {
    /// Profile values at the places.
    fn evaluate(&self, tables: &Tables) -> Vec<f32> {
        let [h_even, h_odd, d_even, d_odd] = &tables.0;
        let mut values = Vec::with_capacity(self.places.len());
        let mut sides = [[0f32; KNOTS + 1]; 2];
        for (d, range) in &self.rows {
            for e in 0..KNOTS - 1 {
                let even = h_even[self.h * KNOTS + e] + d_even[d * KNOTS + e];
                let odd = h_odd[self.h * KNOTS + e] + d_odd[d * KNOTS + e];
                (sides[0][e], sides[1][e]) = (even + odd, even - odd);
            }
            values.extend(self.places[range.clone()].iter().map(|place| {
                let side = |s: usize| {
                    let (knot, table) = (usize::from(place.knot[s]), &sides[s]);
                    table[knot] + (table[knot + 1] - table[knot]) * place.fraction[s]
                };
                side(0) + side(1)
            }));
        }
        values
    }

    /// Adds the adjoint of [`Plane::evaluate`].
    fn add_adjoint(&self, values: &[f32], tables: &mut Tables) {
        let [h_even, h_odd, d_even, d_odd] = &mut tables.0;
        for (d, range) in &self.rows {
            let mut sides = [[0f32; KNOTS + 1]; 2];
            for (place, value) in self.places[range.clone()].iter().zip(&values[range.clone()]) {
                for (s, side) in sides.iter_mut().enumerate() {
                    let knot = usize::from(place.knot[s]);
                    let upper = value * place.fraction[s];
                    side[knot] += value - upper;
                    side[knot + 1] += upper;
                }
            }
            for e in 0..KNOTS - 1 {
                let (even, odd) = (sides[0][e] + sides[1][e], sides[0][e] - sides[1][e]);
                h_even[self.h * KNOTS + e] += even;
                h_odd[self.h * KNOTS + e] += odd;
                d_even[d * KNOTS + e] += even;
                d_odd[d * KNOTS + e] += odd;
            }
        }
    }

    /// Weighted differences of neighbours, and back.
    fn laplacian(&self, weights: &[f32], values: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; values.len()];
        for (&(a, b), weight) in self.pairs.iter().zip(weights) {
            let pull = weight * (values[b as usize] - values[a as usize]);
            out[b as usize] += pull;
            out[a as usize] -= pull;
        }
        out
    }
}

/// The planes that take part, from which entries all channels know.
fn planes(grid: &Grid, known: &[bool]) -> Option<Vec<Plane>> {
    let [bins_h, bins_d] = bins(grid)?;
    let [_, _, _, bins_p] = grid.shape();
    let n = grid.positions();
    let empty = Profile::new(grid, KNOTS, ZONE, Default::default())?;
    let inside = |place: &Place| place.knot.iter().any(|&knot| usize::from(knot) < KNOTS - 1);
    let plane = |h: usize| {
        let mut plane = Plane { h, rows: Vec::new(), places: Vec::new(), positions: Vec::new(), pairs: Vec::new() };
        let mut row = Vec::new();
        let mut before = vec![u32::MAX; bins_p];
        for d in 0..bins_d {
            let mut current = vec![u32::MAX; bins_p];
            empty.places(h, d, 0..bins_p, &mut row);
            let start = plane.places.len();
            for p in 0..row.len() {
                // The neighbours just outside count too: the profile is zero there.
                let near = (p.saturating_sub(1)..(p + 2).min(bins_p)).any(|q| inside(&row[q]));
                let position = (h * bins_d + d) * bins_p + p;
                if !near || (position..known.len()).step_by(n).any(|i| !known[i]) {
                    continue;
                }
                let number = plane.places.len() as u32;
                current[p] = number;
                plane.places.push(row[p]);
                plane.positions.push(position as u32);
                if p > 0 && current[p - 1] != u32::MAX {
                    plane.pairs.push((number - 1, number));
                }
                if before[p] != u32::MAX {
                    plane.pairs.push((before[p], number));
                }
            }
            if plane.places.len() > start {
                plane.rows.push((d, start..plane.places.len()));
            }
            before = current;
        }
        plane
    };
    let planes: Vec<Plane> = (STRIDE / 2..bins_h).into_par_iter().step_by(STRIDE).map(plane).collect();
    (planes.iter().map(|p| p.pairs.len()).sum::<usize>() >= LEAST_PAIRS).then_some(planes)
}

/// Tables of a component with these values, in grid order.
fn solve(planes: &[Plane], bins: [usize; 2], values: &[f32], (rounds, steps): (usize, usize)) -> Tables {
    // Planes are grouped in a fixed way, so that sums do not depend on the number of threads.
    let over = |add: &(dyn Fn(usize, &mut Tables) + Sync)| {
        let numbers: Vec<usize> = (0..planes.len()).collect();
        let parts: Vec<Tables> = numbers
            .par_chunks(planes.len().div_ceil(4).max(1))
            .map(|part| {
                let mut tables = Tables::zero(bins);
                part.iter().for_each(|&i| add(i, &mut tables));
                tables
            })
            .collect();
        parts.into_iter().fold(Tables::zero(bins), Tables::plus)
    };
    let mut weights: Vec<Vec<f32>> = planes.iter().map(|p| vec![1.0; p.pairs.len()]).collect();
    let mut x = Tables::zero(bins);
    for round in 0..rounds {
        let residuals: Vec<Vec<f32>> = planes
            .par_iter()
            .map(|plane| {
                let fitted = plane.evaluate(&x);
                plane.positions.iter().zip(fitted).map(|(&at, fitted)| values[at as usize] - fitted).collect()
            })
            .collect();
        if round > 0 {
            weights.par_iter_mut().zip(planes).zip(&residuals).for_each(|((weights, plane), r)| {
                for (weight, &(a, b)) in weights.iter_mut().zip(&plane.pairs) {
                    *weight = DELTA / ((r[b as usize] - r[a as usize]).abs() + DELTA);
                }
            });
        }
        let mut r = over(&|i, out| planes[i].add_adjoint(&planes[i].laplacian(&weights[i], &residuals[i]), out));
        let mut penalty = Tables::zero(bins);
        penalty.add_penalty(&x);
        r.zip(&penalty, |r, p| *r -= p);
        // About the diagonal: what each entry's places weigh.
        let mut diagonal = over(&|i, out| {
            let mut weight = vec![0.0; planes[i].places.len()];
            for (&(a, b), w) in planes[i].pairs.iter().zip(&weights[i]) {
                weight[a as usize] += w;
                weight[b as usize] += w;
            }
            planes[i].add_adjoint(&weight, out);
        });
        (diagonal.0[1], diagonal.0[3]) = (diagonal.0[0].clone(), diagonal.0[2].clone());
        diagonal.0.iter_mut().flatten().for_each(|d| *d = 0.3 * *d + 12.0 * SMOOTHNESS + RIDGE);
        let scaled = |r: &Tables| {
            let mut z = r.clone();
            z.zip(&diagonal, |z, d| *z /= d);
            z
        };
        let mut z = scaled(&r);
        let mut direction = z.clone();
        let mut energy = r.dot(&z);
        for _ in 0..steps {
            if energy <= 1e-12 {
                break;
            }
            let mut image = over(&|i, out| {
                let plane = &planes[i];
                plane.add_adjoint(&plane.laplacian(&weights[i], &plane.evaluate(&direction)), out);
            });
            image.add_penalty(&direction);
            let length = (energy / direction.dot(&image)) as f32;
            x.zip(&direction, |x, d| *x += length * d);
            r.zip(&image, |r, i| *r -= length * i);
            z = scaled(&r);
            let left = r.dot(&z);
            let keep = (left / energy) as f32;
            energy = left;
            direction.zip(&z, |d, z| *d = z + keep * *d);
        }
    }
    x
}

/// Fits a profile to logarithms `[channel][position]` where they are known; `None` if the grid has none or too little
/// is near the horizon. The tables are quantised with the step of the blocks.
pub(super) fn fit(
    grid: &Grid,
    transform: &ChannelTransform,
    log: &[f32],
    known: &[bool],
    step: f32,
    effort: Effort,
) -> Option<(CodedProfile, Profile)> {
    let bins = bins(grid)?;
    let channels = grid.channels().len();
    if bins.iter().any(|&n| n > MAX_BLOCK_AXIS || check_block([1, 1, n, KNOTS], channels).is_err()) {
        return None;
    }
    let planes = planes(grid, known)?;
    let mut components: Vec<f64> = log.iter().map(|&value| value.into()).collect();
    transform.forward(&mut components, channels);
    let components: Vec<f32> = components.iter().map(|&value| value as f32).collect();
    let tables: Vec<Tables> = components
        .chunks_exact(grid.positions())
        .map(|values| solve(&planes, bins, values, effort.profile_steps()))
        .collect();
    let mut first = Vec::new();
    let mut encoder = Encoder::new(&vec![1 << 15; entropy::CONTEXTS]);
    let mut walk = Walk::default();
    for t in 0..TABLES {
        let shape = [1, 1, bins[t / 2], KNOTS];
        let mut fourier = Transform::new(Basis::Dct, shape);
        let mut coefficients = Vec::new();
        for tables in &tables {
            let mut values: Vec<f64> = tables.0[t].iter().map(|&value| value.into()).collect();
            fourier.analyze(&mut values);
            first.push(quantize_mean(step, values[0])?);
            coefficients.push(0);
            for &value in &values[1..] {
                coefficients.push(Quantizer::quantize(step, 0.4, value)?);
            }
        }
        walk.code(&mut encoder, shape, &mut coefficients, &mut Vec::new()).ok()?;
    }
    let coded = CodedProfile { knots: KNOTS, zone: ZONE, step, first, coded: encoder.finish(), offset: 0 };
    let profile = coded.decode(grid).ok()?;
    Some((coded, profile))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::{Block, positions};
    use crate::grid::Channel;

    /// A course that depends on the elevations alone is taken out, whatever smooth course it stands on.
    #[test]
    fn what_follows_the_elevations_is_found() {
        let merl = Grid::merl();
        let one = Channel { name: "Y".into(), wavelength: None, scale: 1.0 };
        let grid = Grid::new(merl.axes().to_vec(), vec![one]).unwrap();
        let mut log = Vec::new();
        let mut known = Vec::new();
        for at in positions(grid.shape()) {
            let angle = |axis: usize| grid.axes()[axis].angle(at[1 + axis] as f64 + 0.5);
            let (h, d, phi) = (angle(0), angle(1), angle(2));
            let elevation = |sign: f64| h.cos() * d.cos() + sign * h.sin() * d.sin() * phi.cos();
            let course = |z: f64| if z < 0.15 { -(z.max(0.004) / 0.15).ln() } else { 0.0 };
            let (light, sensor) = (elevation(-1.0), elevation(1.0));
            log.push((3.0 * (2.0 * h).cos() + d + course(light) + 0.5 * course(sensor)) as f32);
            known.push(light > 0.0 && sensor > 0.0);
        }
        let (_, profile) = fit(&grid, &ChannelTransform::None, &log, &known, 0.1, Effort::Standard).unwrap();
        let mut taken = vec![0f32; log.len()];
        profile.add(&Block { origin: [0; 4], shape: grid.shape() }, &mut taken);
        let steps = |values: &dyn Fn(usize) -> f32| -> f64 {
            let beside = (1..log.len()).filter(|&i| i % 180 > 0 && known[i] && known[i - 1]);
            beside.map(|i| f64::from((values(i) - values(i - 1)).abs())).sum()
        };
        let (before, after) = (steps(&|i| log[i]), steps(&|i| log[i] - taken[i]));
        assert!(after < 0.3 * before, "{before} -> {after}");
    }
}
