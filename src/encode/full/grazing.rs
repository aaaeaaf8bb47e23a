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

use crate::codec::channel::ChannelTransform;
use crate::codec::dependent::Quantization;
use crate::codec::contexts::COEFFICIENTS;
use crate::codec::entropy::Walk;
use crate::codec::fourier::Basis;
use crate::codec::fourier::forward::Transform;
use crate::codec::profile::{Profile, TABLES, bins, place};
use crate::codec::quantize::{Quantizer, quantize_mean};
use crate::codec::range::Encoder;
use crate::encode::effort::{Effort, ProfileStage};
use crate::format::profile::CodedProfile;
use crate::base::limits::{MAX_BLOCK_AXIS, check_block};
use crate::table::grid::Grid;

/// Knots along the elevation, and where the profile ends; within 2 % for zones of .12 to .5 and 16 to 32 knots.
const KNOTS: usize = 24;
const ZONE: f32 = 0.15;

/// Residual from which a difference loses weight, log domain.
const DELTA: f32 = 0.05;
const SMOOTHNESS: f32 = 0.5;
const RIDGE: f32 = 0.1;

/// Components that are fitted side by side.
const LANES: usize = 4;

/// A value of each of these.
type Lanes = [f32; LANES];

/// Fewer differences than this determine no profile.
const LEAST_PAIRS: usize = 2000;

fn plus(a: Lanes, b: Lanes) -> Lanes {
    std::array::from_fn(|l| a[l] + b[l])
}

fn minus(a: Lanes, b: Lanes) -> Lanes {
    std::array::from_fn(|l| a[l] - b[l])
}

fn times(a: Lanes, b: Lanes) -> Lanes {
    std::array::from_fn(|l| a[l] * b[l])
}

/// Where light and sensor are among the knots.
#[derive(Clone, Copy)]
struct Place {
    knot: [u8; 2],
    fraction: [f32; 2],
}

impl Place {
    fn new(light: f32, sensor: f32) -> Place {
        let (light, sensor) = (place(light), place(sensor));
        Place { knot: [light.0 as u8, sensor.0 as u8], fraction: [light.1, sensor.1] }
    }
}

/// The knots of a bin in a table.
fn knots(table: &[Lanes], bin: usize) -> &[Lanes; KNOTS] {
    &table.as_chunks().0[bin]
}

fn knots_mut(table: &mut [Lanes], bin: usize) -> &mut [Lanes; KNOTS] {
    &mut table.as_chunks_mut().0[bin]
}

/// Positions of one bin of theta_h that are near the horizon.
struct Plane {
    h: usize,
    /// theta_d and the range of its places.
    rows: Vec<(usize, std::ops::Range<usize>)>,
    places: Vec<Place>,
    /// Where each place is in a plane of the table.
    positions: Vec<u32>,
    /// Whether the place before is the neighbour along phi_d.
    after: Vec<bool>,
    /// The neighbour along theta_d before each place, if there is one.
    below: Vec<Option<u32>>,
}

/// Tables `[table][bin][knot]` of a few components.
#[derive(Clone)]
struct Tables([Vec<Lanes>; TABLES]);

impl Tables {
    fn zero(bins: [usize; 2]) -> Tables {
        Tables(std::array::from_fn(|t| vec![[0.0; LANES]; bins[t / 2] * KNOTS]))
    }

    fn zip(&mut self, other: &Tables, f: impl Fn(usize, &mut f32, f32)) {
        for (a, b) in self.0.iter_mut().zip(&other.0) {
            for (a, b) in a.iter_mut().zip(b) {
                (0..LANES).for_each(|l| f(l, &mut a[l], b[l]));
            }
        }
    }

    fn plus(mut self, other: Tables) -> Tables {
        self.zip(&other, |_, a, b| *a += b);
        self
    }

    fn dot(&self, other: &Tables) -> [f64; LANES] {
        let mut sums = [0.0; LANES];
        for (a, b) in self.0.iter().flatten().zip(other.0.iter().flatten()) {
            (0..LANES).for_each(|l| sums[l] += f64::from(a[l]) * f64::from(b[l]));
        }
        sums
    }

    /// Adds the gradient of the penalty at `x`.
    fn add_penalty(&mut self, x: &Tables) {
        let second = |out: &mut Vec<Lanes>, x: &[Lanes], at: usize, stride: usize| {
            for l in 0..LANES {
                let bend = SMOOTHNESS * (x[at - stride][l] - 2.0 * x[at][l] + x[at + stride][l]);
                out[at - stride][l] += bend;
                out[at][l] -= 2.0 * bend;
                out[at + stride][l] += bend;
            }
        };
        for (out, x) in self.0.iter_mut().zip(&x.0) {
            let bins = x.len() / KNOTS;
            for bin in 0..bins {
                (1..KNOTS - 1).for_each(|e| second(out, x, bin * KNOTS + e, 1));
                if bin > 0 && bin + 1 < bins {
                    (0..KNOTS).for_each(|e| second(out, x, bin * KNOTS + e, KNOTS));
                }
            }
            for (out, x) in out.iter_mut().zip(x) {
                (0..LANES).for_each(|l| out[l] += RIDGE * x[l]);
            }
        }
    }
}

impl Plane {
    /// Profile values at the places.
    fn evaluate(&self, tables: &Tables, values: &mut Vec<Lanes>) {
        let [h_even, h_odd] = [0, 1].map(|t| knots(&tables.0[t], self.h));
        values.clear();
        let mut sides = [[[0f32; LANES]; KNOTS + 1]; 2];
        for (d, range) in &self.rows {
            let [d_even, d_odd] = [2, 3].map(|t| knots(&tables.0[t], *d));
            for e in 0..KNOTS - 1 {
                let (even, odd) = (plus(h_even[e], d_even[e]), plus(h_odd[e], d_odd[e]));
                (sides[0][e], sides[1][e]) = (plus(even, odd), minus(even, odd));
            }
            values.extend(self.places[range.clone()].iter().map(|place| {
                let side = |s: usize| {
                    let knot = usize::from(place.knot[s]).min(KNOTS - 1);
                    let (below, above) = (sides[s][knot], sides[s][knot + 1]);
                    plus(below, times(minus(above, below), [place.fraction[s]; LANES]))
                };
                plus(side(0), side(1))
            }));
        }
    }

    /// Adds the adjoint of [`Plane::evaluate`].
    fn add_adjoint(&self, values: &[Lanes], tables: &mut Tables) {
        let [h_even, h_odd, d_even, d_odd] = &mut tables.0;
        let (h_even, h_odd) = (knots_mut(h_even, self.h), knots_mut(h_odd, self.h));
        for (d, range) in &self.rows {
            // Every other place into sums of its own: neighbours mostly add to the same knots, and would wait for each other.
            let mut halves = [[[[0f32; LANES]; KNOTS + 1]; 2]; 2];
            let places = self.places[range.clone()].iter().zip(&values[range.clone()]);
            for (i, (place, &value)) in places.enumerate() {
                for (s, side) in halves[i % 2].iter_mut().enumerate() {
                    let knot = usize::from(place.knot[s]).min(KNOTS - 1);
                    let upper = times(value, [place.fraction[s]; LANES]);
                    side[knot] = plus(side[knot], minus(value, upper));
                    side[knot + 1] = plus(side[knot + 1], upper);
                }
            }
            let (d_even, d_odd) = (knots_mut(d_even, *d), knots_mut(d_odd, *d));
            for e in 0..KNOTS - 1 {
                let [light, sensor] = [0, 1].map(|s: usize| plus(halves[0][s][e], halves[1][s][e]));
                let (even, odd) = (plus(light, sensor), minus(light, sensor));
                h_even[e] = plus(h_even[e], even);
                h_odd[e] = plus(h_odd[e], odd);
                d_even[e] = plus(d_even[e], even);
                d_odd[e] = plus(d_odd[e], odd);
            }
        }
    }

    /// Differences from the neighbours along phi_d and theta_d, weighted by place, and back.
    fn laplacian(&self, weights: &[[Lanes; 2]], values: &[Lanes], out: &mut Vec<Lanes>) {
        out.clear();
        out.resize(values.len(), [0.0; LANES]);
        let mut before = [0f32; LANES];
        for (i, (weights, below)) in weights.iter().zip(&self.below).enumerate() {
            let value = values[i];
            // The weight is zero where the place before is no neighbour.
            let pull = times(weights[0], minus(value, before));
            if i > 0 {
                out[i - 1] = minus(out[i - 1], pull);
            }
            out[i] = pull;
            if let Some(below) = *below {
                let below = below as usize;
                let pull = times(weights[1], minus(value, values[below]));
                out[i] = plus(out[i], pull);
                out[below] = minus(out[below], pull);
            }
            before = value;
        }
    }

    /// Calls `each` with a place, a neighbour before it, and 0 if it is one along phi_d, 1 along theta_d.
    fn pairs(&self, mut each: impl FnMut(usize, usize, usize)) {
        for (i, (after, below)) in self.after.iter().zip(&self.below).enumerate() {
            if *after {
                each(i, i - 1, 0);
            }
            if let Some(below) = *below {
                each(i, below as usize, 1);
            }
        }
    }
}

/// The planes that take part, from which entries all channels know.
fn planes(grid: &Grid, known: &[bool]) -> Option<Vec<Plane>> {
    let [bins_h, bins_d] = bins(grid)?;
    let [_, _, _, bins_p] = grid.shape();
    let n = grid.positions();
    let empty = Profile::new(grid, KNOTS, ZONE, Default::default()).ok()?;
    let inside = |place: &Place| place.knot.iter().any(|&knot| usize::from(knot) < KNOTS - 1);
    let plane = |h: usize| {
        let mut plane = Plane {
            h,
            rows: Vec::new(),
            places: Vec::new(),
            positions: Vec::new(),
            after: Vec::new(),
            below: Vec::new(),
        };
        let mut before = vec![u32::MAX; bins_p];
        for d in 0..bins_d {
            let mut current = vec![u32::MAX; bins_p];
            let [light, sensor] = empty.roots(h, d).unwrap_or_default();
            let row: Vec<Place> =
                light.iter().zip(&sensor).map(|(light, sensor)| Place::new(*light, *sensor)).collect();
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
                plane.after.push(p > 0 && current[p - 1] != u32::MAX);
                plane.below.push(Some(before[p]).filter(|&below| below != u32::MAX));
            }
            if plane.places.len() > start {
                plane.rows.push((d, start..plane.places.len()));
            }
            before = current;
        }
        plane
    };
    let planes: Vec<Plane> = (0..bins_h).into_par_iter().map(plane).collect();
    let mut count = 0;
    planes.iter().for_each(|plane| plane.pairs(|_, _, _| count += 1));
    (count >= LEAST_PAIRS).then_some(planes)
}

/// Tables of up to [`LANES`] components with these values, in grid order.
fn solve(planes: &[Plane], bins: [usize; 2], components: &[&[f32]], stages: &[ProfileStage]) -> Tables {
    let mut x = Tables::zero(bins);
    for (number, stage) in stages.iter().enumerate() {
        let some: Vec<&Plane> = planes.iter().skip(stage.stride / 2).step_by(stage.stride).collect();
        for round in 0..stage.rounds {
            refine(&mut x, &some, bins, components, number + round > 0, stage.steps);
        }
    }
    x
}

/// Adds what a plane, by number, gives; with buffers.
type AddPlane<'a> = &'a (dyn Fn(usize, &mut Tables, &mut [Vec<Lanes>; 2]) + Sync);

/// A round of reweighting and conjugate gradient steps; differences weigh the same if they are not `robust`.
fn refine(x: &mut Tables, planes: &[&Plane], bins: [usize; 2], components: &[&[f32]], robust: bool, steps: usize) {
    // Long on purpose: conjugate gradients in lanes of single precision with a fixed number of steps, written out so that sums keep their order.
    const GROUPS: usize = 4;
    // Planes are grouped in a fixed way, so that sums do not depend on the number of threads.
    let over = |add: AddPlane| {
        let parts: Vec<Tables> = (0..GROUPS)
            .into_par_iter()
            .with_max_len(1)
            .map(|group| {
                let mut tables = Tables::zero(bins);
                let mut buffers = Default::default();
                (group..planes.len()).step_by(GROUPS).for_each(|i| add(i, &mut tables, &mut buffers));
                tables
            })
            .collect();
        parts.into_iter().reduce(Tables::plus).expect("some groups")
    };
    let mut weights: Vec<Vec<[Lanes; 2]>> = planes.iter().map(|p| vec![Default::default(); p.places.len()]).collect();
    let residuals: Vec<Vec<Lanes>> = planes
        .par_iter()
        .map(|plane| {
            let mut residuals = Vec::new();
            plane.evaluate(x, &mut residuals);
            for (residual, &at) in residuals.iter_mut().zip(&plane.positions) {
                for (residual, values) in residual.iter_mut().zip(components) {
                    *residual = values[at as usize] - *residual;
                }
            }
            residuals
        })
        .collect();
    weights.par_iter_mut().zip(planes).zip(&residuals).for_each(|((weights, plane), r)| {
        plane.pairs(|i, before, along| {
            let weight = |l: usize| if robust { DELTA / ((r[i][l] - r[before][l]).abs() + DELTA) } else { 1.0 };
            weights[i][along] = std::array::from_fn(weight);
        });
    });
    let mut r = over(&|i, out, [pulls, _]| {
        planes[i].laplacian(&weights[i], &residuals[i], pulls);
        planes[i].add_adjoint(pulls, out);
    });
    let mut penalty = Tables::zero(bins);
    penalty.add_penalty(x);
    r.zip(&penalty, |_, r, p| *r -= p);
    // About the diagonal: what each entry's places weigh.
    let mut diagonal = over(&|i, out, [weight, _]| {
        weight.clear();
        weight.resize(planes[i].places.len(), [0.0; LANES]);
        planes[i].pairs(|place, before, along| {
            let w = weights[i][place][along];
            weight[place] = plus(weight[place], w);
            weight[before] = plus(weight[before], w);
        });
        planes[i].add_adjoint(weight, out);
    });
    (diagonal.0[1], diagonal.0[3]) = (diagonal.0[0].clone(), diagonal.0[2].clone());
    diagonal.0.iter_mut().flatten().flatten().for_each(|d| *d = 0.3 * *d + 12.0 * SMOOTHNESS + RIDGE);
    let scaled = |r: &Tables| {
        let mut z = r.clone();
        z.zip(&diagonal, |_, z, d| *z /= d);
        z
    };
    let mut z = scaled(&r);
    let mut direction = z.clone();
    let mut energy = r.dot(&z);
    for _ in 0..steps {
        let mut image = over(&|i, out, [values, pulls]| {
            let plane = &planes[i];
            plane.evaluate(&direction, values);
            plane.laplacian(&weights[i], values, pulls);
            plane.add_adjoint(pulls, out);
        });
        image.add_penalty(&direction);
        let curvature = direction.dot(&image);
        let ratio = |over: [f64; LANES], under: [f64; LANES]| -> Lanes {
            std::array::from_fn(|l| if under[l] > 1e-12 { (over[l] / under[l]) as f32 } else { 0.0 })
        };
        let length = ratio(energy, curvature);
        x.zip(&direction, |l, x, d| *x += length[l] * d);
        r.zip(&image, |l, r, i| *r -= length[l] * i);
        z = scaled(&r);
        let left = r.dot(&z);
        let keep = ratio(left, energy);
        energy = left;
        direction.zip(&z, |l, d, z| *d = z + keep[l] * *d);
    }
}

/// Fits a profile to logarithms `[channel][position]` where they are known; `None` if the grid has none or too little
/// is near the horizon. The tables are quantised with the step of the blocks.
pub(in crate::encode) fn fit(
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
    let mut components = log.to_vec();
    transform.forward(&mut components, channels);
    let components: Vec<&[f32]> = components.chunks_exact(grid.positions()).collect();
    let tables: Vec<Tables> =
        components.chunks(LANES).map(|components| solve(&planes, bins, components, effort.profile_stages())).collect();
    let mut first = Vec::new();
    let mut encoder = Encoder::new(&vec![1 << 15; COEFFICIENTS]);
    let mut walk = Walk::default();
    for t in 0..TABLES {
        let shape = [1, 1, bins[t / 2], KNOTS];
        let mut fourier = Transform::new(Basis::Dct, shape);
        let mut coefficients = Vec::new();
        for c in 0..channels {
            let mut values: Vec<f64> = tables[c / LANES].0[t].iter().map(|lanes| lanes[c % LANES].into()).collect();
            fourier.analyze(&mut values);
            first.push(quantize_mean(step, values[0])?);
            coefficients.push(0);
            for &value in &values[1..] {
                coefficients.push(Quantizer::quantize(step, 0.4, value)?);
            }
        }
        walk.code(&mut encoder, Quantization::Scalar, shape, &coefficients).ok()?;
    }
    let coded = CodedProfile { knots: KNOTS, zone: ZONE, step, first, coded: encoder.finish(), offset: 0 };
    let profile = coded.decode(grid).ok()?;
    Some((coded, profile))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::block::{Block, positions};
    use crate::table::grid::Channel;

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
        profile.add(crate::base::simd::Level::detect(), &Block { origin: [0; 4], shape: grid.shape() }, &mut taken);
        let steps = |values: &dyn Fn(usize) -> f32| -> f64 {
            let beside = (1..log.len()).filter(|&i| i % 180 > 0 && known[i] && known[i - 1]);
            beside.map(|i| f64::from((values(i) - values(i - 1)).abs())).sum()
        };
        let (before, after) = (steps(&|i| log[i]), steps(&|i| log[i] - taken[i]));
        assert!(after < 0.3 * before, "{before} -> {after}");
    }
}
