//! Weights of rings of half vectors around the normal, and draws by them.

use super::geometry::{Given, Half};
use super::marginal::Pair;

/// Elevations of the given direction that have weights of their own, from the normal to the horizon: even in
/// sqrt(1 - cos(theta_i)), about in theta_i.
const KNOTS: usize = 32;

/// Rings, even in the fourth root of `t`, about in the root of theta_h as MERL's bins are: narrow around the normal.
const RINGS: usize = 90;

/// Parts of half a ring, from the azimuth of the given direction to the last azimuth above the horizon.
const PARTS: usize = 8;

/// Places along a side of a part at which the weight is taken.
const POINTS: usize = 2;

/// Share of a knot's weight that is spread as a diffuse surface would: no ring that can be drawn has none.
const DIFFUSE_SHARE: f64 = 1e-3;

/// Azimuths that are divided by are not taken below this.
const LEAST_PHI: f64 = 1e-9;

#[derive(Clone, Debug)]
pub(super) struct Rings {
    /// Cumulated weights of the rings, 0 to 1, `[knot][0..=RINGS]`.
    rings: Vec<f32>,
    /// Cumulated weights of the parts of a ring, 0 to 1, `[knot][ring][0..=PARTS]`.
    parts: Vec<f32>,
}

/// The weights of the knots on both sides of a given direction's elevation.
pub(super) struct Knots<'a> {
    knots: [Knot<'a>; 2],
    /// Of the second.
    share: f64,
    /// The last `t` that the given direction reaches.
    t_max: f64,
}

/// The weights of a knot.
struct Knot<'a> {
    rings: &'a [f32],
    parts: &'a [f32],
    /// Cumulated weight at the last `t` that the given direction reaches.
    total: f64,
}

impl Rings {
    /// `reflectance` in 1/sr, at least 0 and finite.
    pub(super) fn new(reflectance: impl Fn(Pair) -> f64) -> Rings {
        let mut rings = Vec::with_capacity(KNOTS * (RINGS + 1));
        let mut parts = Vec::with_capacity(KNOTS * RINGS * (PARTS + 1));
        for knot in 0..KNOTS {
            let weights = knot_weights(knot, &reflectance);
            let mut sum = 0.0;
            rings.push(0.0);
            for ring in weights.chunks_exact(PARTS) {
                let weight: f64 = ring.iter().sum();
                sum += weight;
                rings.push(sum as f32);
                let mut part_sum = 0.0;
                parts.push(0.0);
                for part in ring {
                    part_sum += part;
                    parts.push(if weight > 0.0 { (part_sum / weight).min(1.0) as f32 } else { 1.0 });
                }
            }
        }
        Rings { rings, parts }
    }

    /// The weights for a given direction.
    pub(super) fn knots(&self, given: &Given) -> Knots<'_> {
        let place = given.t().sqrt() * (KNOTS - 1) as f64;
        let first = (place as usize).min(KNOTS - 2);
        let t_max = given.t_max();
        let last = ring_of(t_max);
        let within = ((t_max - edge(last)) / (edge(last + 1) - edge(last))).clamp(0.0, 1.0);
        let knot = |knot: usize| {
            let rings = &self.rings[knot * (RINGS + 1)..][..RINGS + 1];
            let parts = &self.parts[knot * RINGS * (PARTS + 1)..][..RINGS * (PARTS + 1)];
            let [below, above] = [rings[last], rings[last + 1]].map(f64::from);
            Knot { rings, parts, total: below + (above - below) * within }
        };
        Knots { knots: [knot(first), knot(first + 1)], share: (place - first as f64).clamp(0.0, 1.0), t_max }
    }
}

impl Knots<'_> {
    /// A direction above the horizon, by two numbers in [0, 1).
    pub(super) fn draw(&self, given: &Given, u: f64, v: f64) -> [f64; 3] {
        let ([first, second], share) = (&self.knots, self.share);
        let (knot, u) = if u < share { (second, u / share) } else { (first, (u - share) / (1.0 - share)) };
        let (ring, within) = find(knot.rings, u * knot.total);
        let t = (edge(ring) + (edge(ring + 1) - edge(ring)) * within).min(self.t_max);
        // Both sides of the given direction's azimuth, alike.
        let (side, v) = if v < 0.5 { (1.0, 2.0 * v) } else { (-1.0, 2.0 * v - 1.0) };
        let (part, within) = find(&knot.parts[ring * (PARTS + 1)..][..PARTS + 1], v);
        let phi = (part as f64 + within) / PARTS as f64 * given.phi_max(t);
        given.mirror(t, side * phi)
    }

    /// Density of [`Knots::draw`] at `wo`, 1/sr.
    pub(super) fn density(&self, given: &Given, wo: [f64; 3]) -> f64 {
        let Half { t, phi, along } = given.half(wo);
        let ring = ring_of(t);
        let phi_max = given.phi_max(t).max(LEAST_PHI);
        let part = ((phi / phi_max * PARTS as f64) as usize).min(PARTS - 1);
        let [first, second] = self.knots.each_ref().map(|knot| knot.probability(ring, part));
        // A part on both sides; then from half vectors to mirrored directions.
        let area = (edge(ring + 1) - edge(ring)) * 2.0 * phi_max / PARTS as f64;
        (first * (1.0 - self.share) + second * self.share) / (area * 4.0 * along)
    }
}

impl Knot<'_> {
    /// Of a part of a ring, as if the last ring were whole: up to its reachable end the density is the same.
    fn probability(&self, ring: usize, part: usize) -> f64 {
        step(self.rings, ring) / self.total * step(&self.parts[ring * (PARTS + 1)..], part)
    }
}

/// The step of cumulated weights that `target` falls on, and how far along it.
fn find(sums: &[f32], target: f64) -> (usize, f64) {
    let i = sums[1..].partition_point(|sum| f64::from(*sum) <= target).min(sums.len() - 2);
    let within = (target - f64::from(sums[i])) / step(sums, i);
    // The last step may have no height where sums were rounded.
    (i, if within >= 0.0 { within.min(1.0) } else { 0.0 })
}

fn step(sums: &[f32], i: usize) -> f64 {
    f64::from(sums[i + 1]) - f64::from(sums[i])
}

/// Weights of all parts of all rings, summing to 1.
fn knot_weights(knot: usize, reflectance: &impl Fn(Pair) -> f64) -> Vec<f64> {
    let mut seen = vec![0.0; RINGS * PARTS];
    let mut diffuse = vec![0.0; RINGS * PARTS];
    // The last just above the horizon, where all angles are defined.
    let height = (1.0 - (knot as f64 / (KNOTS - 1) as f64).powi(2)).max(1e-3);
    let level = (1.0 - height * height).sqrt();
    if let Some(given) = Given::new([level, 0.0, height]) {
        let t_max = given.t_max();
        for ring in 0..=ring_of(t_max) {
            let (start, end) = (edge(ring), edge(ring + 1));
            // The last is weighed as if it went on as it is where it can be reached: draws end there.
            let reached = end.min(t_max) - start;
            for i in 0..POINTS {
                let t = start + reached * (i as f64 + 0.5) / POINTS as f64;
                let phi_max = given.phi_max(t);
                for j in 0..PARTS * POINTS {
                    let wo = given.mirror(t, phi_max * (j as f64 + 0.5) / (PARTS * POINTS) as f64);
                    let along = given.half(wo).along;
                    // The cosine, and the solid angle of directions for one of half vectors.
                    let measure = (end - start) * phi_max * wo[2] * along;
                    let at = ring * PARTS + j / POINTS;
                    diffuse[at] += measure;
                    seen[at] += measure * reflectance(pair(height, wo[2], t, along));
                }
            }
        }
    }
    let [seen_scale, diffuse_scale] = [&seen, &diffuse].map(|weights| {
        let sum: f64 = weights.iter().sum();
        if sum > 0.0 && sum.is_finite() { 1.0 / sum } else { 0.0 }
    });
    let blend = |(seen, diffuse): (&f64, &f64)| {
        let seen = if seen_scale > 0.0 { seen * seen_scale } else { 0.0 };
        seen * (1.0 - DIFFUSE_SHARE) + diffuse * diffuse_scale * DIFFUSE_SHARE
    };
    seen.iter().zip(&diffuse).map(blend).collect()
}

fn pair(cos_i: f64, cos_o: f64, t: f64, along: f64) -> Pair {
    let sin = |cos: f64| (1.0 - cos * cos).max(0.0).sqrt();
    // cos_o - cos_i = 2 sin(theta_h) sin(theta_d) cos(phi_d)
    let swing = 2.0 * sin(1.0 - t) * sin(along);
    let cos_phi_d = if swing > 0.0 { ((cos_o - cos_i) / swing).abs() } else { 1.0 };
    Pair { theta_h: (1.0 - t).acos(), theta_d: along.min(1.0).acos(), cos_phi_d }
}

/// The `t` at which a ring begins.
fn edge(ring: usize) -> f64 {
    (ring as f64 / RINGS as f64).powi(4)
}

/// The ring at `t`.
fn ring_of(t: f64) -> usize {
    ((t.sqrt().sqrt() * RINGS as f64) as usize).min(RINGS - 1)
}
