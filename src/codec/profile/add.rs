//! Adding a grazing profile to the components of a block.
//!
//! Of MERL's bins 37 % are near enough to a horizon to have a profile that ends at .15, three in five of them with one direction
//! below it and the other above the profile, or both below: there it is the same along the row, which bounds on the elevations show
//! without a root, for the whole row or for steps of it. Steps that are alike go together.

use super::{LANES, Lanes, Profile, Row, STEP, place};
use crate::base::limits::MAX_KNOTS;
use crate::base::simd::Task;
use crate::table::block::Block;

pub(super) struct Add<'a> {
    pub(super) profile: &'a Profile,
    pub(super) block: &'a Block,
    /// `[component][position]`
    pub(super) values: &'a mut [f32],
}

/// What a profile has at each knot for one direction; zero from the last one on.
type Side = [Lanes; MAX_KNOTS + 1];

/// Where the elevations of a step are.
#[derive(Clone, Copy, PartialEq)]
enum Zone {
    /// All where there is no profile.
    Above,
    /// Some where it changes.
    Between,
    /// All below the horizon, where it is what it is at the horizon.
    Below,
}

impl Task for Add<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Add { profile, block, values } = self;
        let [_, first_h, first_d, first_p] = block.origin;
        let [_, nh, nd, np] = block.shape;
        let n = block.positions();
        let everywhere = profile.everywhere(block);
        let mut sides = [[[0f32; LANES]; MAX_KNOTS + 1]; 2];
        let mut run = Run { knots: [0; RUN], fractions: [0.0; RUN], sums: [[0.0; LANES]; RUN] };
        for (i, j) in (0..nh).flat_map(|i| (0..nd).map(move |j| (i, j))) {
            let (h, d) = (first_h + i, first_d + j);
            let Some(row) = profile.row(h, d) else { continue };
            let zones = profile.zones(row, everywhere);
            if zones == [Zone::Above; 2] {
                continue;
            }
            let changes = zones.contains(&Zone::Between);
            for (group, planes) in values.chunks_mut(LANES * n).enumerate() {
                let place = (i * nd + j) * np;
                let mut planes = planes.chunks_exact_mut(n).map(|plane| &mut plane[place..place + np]);
                profile.mix(group, h, d, if changes { profile.knots - 1 } else { 1 }, &mut sides);
                if !changes {
                    add_constant(zones, &sides, planes);
                    continue;
                }
                let mut planes: [&mut [f32]; LANES] = std::array::from_fn(|_| planes.next().unwrap_or_default());
                let mut at = 0;
                while at < np {
                    // As many steps as are alike.
                    let (start, zones) = (at, profile.zones(row, profile.extremes[first_p + at]));
                    at += STEP;
                    while at < np && at - start < RUN && profile.zones(row, profile.extremes[first_p + at]) == zones {
                        at += STEP;
                    }
                    let targets = planes.iter_mut().filter(|plane| !plane.is_empty());
                    let targets = targets.map(|plane| &mut plane[start..at.min(np)]);
                    if !zones.contains(&Zone::Between) {
                        add_constant(zones, &sides, targets);
                        continue;
                    }
                    run.fill(profile, row, first_p + start, at - start, zones, &sides);
                    targets.enumerate().for_each(|(lane, target)| {
                        target.iter_mut().zip(&run.sums).for_each(|(value, sum)| *value += sum[lane]);
                    });
                }
            }
        }
    }
}

/// [`Profile::add_to_rows`]
pub(super) fn add_to_rows(profile: &Profile, block: &Block, values: &mut [f32]) -> bool {
    let [_, first_h, first_d, _] = block.origin;
    let [_, nh, nd, _] = block.shape;
    let everywhere = profile.everywhere(block);
    let mut sides = [[[0f32; LANES]; MAX_KNOTS + 1]; 2];
    for (i, j) in (0..nh).flat_map(|i| (0..nd).map(move |j| (i, j))) {
        let (h, d) = (first_h + i, first_d + j);
        let Some(row) = profile.row(h, d) else { continue };
        let zones = profile.zones(row, everywhere);
        if zones.contains(&Zone::Between) {
            return false;
        }
        for (group, planes) in values.chunks_mut(LANES * nh * nd).enumerate() {
            profile.mix(group, h, d, 1, &mut sides);
            let place = i * nd + j;
            add_constant(zones, &sides, planes.chunks_exact_mut(nh * nd).map(|plane| &mut plane[place..][..1]));
        }
    }
    true
}

/// Adds to each component where neither direction is between.
#[inline(always)]
fn add_constant<'a>(zones: [Zone; 2], sides: &[Side; 2], targets: impl Iterator<Item = &'a mut [f32]>) {
    let below = sides.iter().zip(zones).filter(|(_, zone)| *zone == Zone::Below);
    let sum = below.fold([0.0; LANES], |sum, (side, _)| plus(sum, side[0]));
    for (target, sum) in targets.zip(sum) {
        target.iter_mut().for_each(|value| *value += sum);
    }
}

impl Profile {
    /// Least and largest cosine of phi_d in a block.
    #[inline(always)]
    fn everywhere(&self, block: &Block) -> [f32; 2] {
        let steps = &self.extremes[block.origin[3]..][..block.shape[3]];
        steps.iter().fold([1f32, -1.0], |[low, high], step| [low.min(step[0]), high.max(step[1])])
    }

    /// Where light and sensor are over bins of phi_d whose cosines have these extremes.
    #[inline(always)]
    fn zones(&self, row: Row, [low, high]: [f32; 2]) -> [Zone; 2] {
        let Row { middle, swing } = row;
        let (a, b) = (swing * low, swing * high);
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        let zone = |low: f32, high: f32| {
            if low >= self.end {
                Zone::Above
            } else if high <= 0.0 {
                Zone::Below
            } else {
                Zone::Between
            }
        };
        [zone(middle - high, middle - low), zone(middle + low, middle + high)]
    }

    /// Profiles of a few components over the elevation of light and of sensor at a bin of theta_h and theta_d, at the first knots.
    #[inline(always)]
    fn mix(&self, group: usize, h: usize, d: usize, knots: usize, sides: &mut [Side; 2]) {
        let k = self.knots;
        let of_bin = |table: usize, bins: usize, bin: usize| {
            // Flat, so that it vectorises whatever the lanes are.
            self.tables[table][(group * bins + bin) * k..][..knots].as_flattened().iter()
        };
        let (nh, nd) = (self.theta_h.len(), self.theta_d.len());
        let even = of_bin(0, nh, h).zip(of_bin(2, nd, d));
        let odd = of_bin(1, nh, h).zip(of_bin(3, nd, d));
        let [light, sensor] = sides;
        let sides = light.as_flattened_mut().iter_mut().zip(sensor.as_flattened_mut());
        for ((light, sensor), ((h_even, d_even), (h_odd, d_odd))) in sides.zip(even.zip(odd)) {
            let (even, odd) = (h_even + d_even, h_odd + d_odd);
            *light = even + odd;
            *sensor = even - odd;
        }
    }
}

/// Most positions of a run.
const RUN: usize = 8 * STEP;

/// Positions of a row that follow each other.
struct Run {
    knots: [u32; RUN],
    fractions: [f32; RUN],
    sums: [Lanes; RUN],
}

impl Run {
    /// The profile at some positions, whole steps, from one on. One thing after the other for all: like this the compiler finds the
    /// vectors.
    #[inline(always)]
    fn fill(&mut self, profile: &Profile, row: Row, at: usize, length: usize, zones: [Zone; 2], sides: &[Side; 2]) {
        let (knots, fractions, sums) =
            (&mut self.knots[..length], &mut self.fractions[..length], &mut self.sums[..length]);
        let cos = &profile.phi_d[at..][..length];
        sums.fill([0.0; LANES]);
        for (sign, (zone, side)) in [-1.0, 1.0].into_iter().zip(zones.into_iter().zip(sides)) {
            if zone == Zone::Above {
                continue;
            }
            for (cos, (knot, fraction)) in cos.iter().zip(knots.iter_mut().zip(&mut *fractions)) {
                (*knot, *fraction) = place(profile.root(row.middle + sign * (row.swing * cos)));
            }
            for (sums, (knot, fraction)) in sums.iter_mut().zip(knots.iter().zip(&*fractions)) {
                // At most the last: the remainder saves a check.
                let knot = *knot as usize % MAX_KNOTS;
                let (here, next) = (side[knot], side[knot + 1]);
                let mut more = [0f32; LANES];
                for lane in 0..LANES {
                    more[lane] = here[lane] + (next[lane] - here[lane]) * fraction;
                }
                *sums = plus(*sums, more);
            }
        }
    }
}

#[inline(always)]
fn plus(a: Lanes, b: Lanes) -> Lanes {
    let mut sum = [0f32; LANES];
    for lane in 0..LANES {
        sum[lane] = a[lane] + b[lane];
    }
    sum
}
