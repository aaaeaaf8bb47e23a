//! Adding a grazing profile to the components of a block.
//!
//! Of MERL's bins 37 % are near enough to a horizon to have a profile that ends at .15, three in five of them with one direction
//! below it and the other above the profile, or both below: there it is the same along the row, which bounds on the elevations tell
//! without a root, a step at a time.

use super::{LANES, Lanes, Profile, Row, STEP, place};
use crate::block::Block;
use crate::format::profile::MAX_KNOTS;
use crate::simd::Task;

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
        let mut sides = [[[0f32; LANES]; MAX_KNOTS + 1]; 2];
        for (i, j) in (0..nh).flat_map(|i| (0..nd).map(move |j| (i, j))) {
            let (h, d) = (first_h + i, first_d + j);
            let Some(row) = profile.row(h, d) else { continue };
            for (group, planes) in values.chunks_mut(LANES * n).enumerate() {
                let mut told = false;
                for at in (0..np).step_by(STEP) {
                    let zones = profile.zones(row, first_p + at);
                    if zones == [Zone::Above; 2] {
                        continue;
                    }
                    if !told {
                        profile.tell(group, h, d, &mut sides);
                        told = true;
                    }
                    let start = (i * nd + j) * np + at;
                    let mut targets = planes.chunks_exact_mut(n).map(|plane| &mut plane[start..][..STEP.min(np - at)]);
                    if zones.contains(&Zone::Between) {
                        let sums = profile.sums(row, first_p + at, zones, &sides);
                        targets.enumerate().for_each(|(lane, target)| add(target, |s| sums[s][lane]));
                    } else {
                        let below = sides.iter().zip(zones).filter(|(_, zone)| *zone == Zone::Below);
                        let sum = below.fold([0.0; LANES], |sum, (side, _)| plus(sum, side[0]));
                        sum.iter().zip(&mut targets).for_each(|(sum, target)| add(target, |_| *sum));
                    }
                }
            }
        }
    }
}

impl Profile {
    /// Where light and sensor are in the step from a bin of phi_d on.
    #[inline(always)]
    fn zones(&self, row: Row, at: usize) -> [Zone; 2] {
        let Row { middle, swing } = row;
        let [low, high] = self.extremes[at];
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

    /// Profiles of a few components over the elevation of light and of sensor at a bin of theta_h and theta_d.
    #[inline(always)]
    fn tell(&self, group: usize, h: usize, d: usize, sides: &mut [Side; 2]) {
        let k = self.knots;
        let of_bin = |table: usize, bins: usize, bin: usize| {
            // Flat, so that it vectorises whatever the lanes are.
            self.tables[table][(group * bins + bin) * k..][..k - 1].as_flattened().iter()
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

    /// The profile at the positions of a step.
    #[inline(always)]
    fn sums(&self, row: Row, at: usize, zones: [Zone; 2], sides: &[Side; 2]) -> [Lanes; STEP] {
        let cos = &self.phi_d[at..][..STEP];
        let mut sums = [[0f32; LANES]; STEP];
        for (sign, (zone, side)) in [-1.0, 1.0].into_iter().zip(zones.into_iter().zip(sides)) {
            if zone != Zone::Above {
                let mut elevations = [0f32; STEP];
                for s in 0..STEP {
                    elevations[s] = row.middle + sign * (row.swing * cos[s]);
                }
                self.add_side(side, elevations, &mut sums);
            }
        }
        sums
    }

    /// One thing after the other for all positions: like this the compiler finds the vectors.
    #[inline(always)]
    fn add_side(&self, side: &Side, mut elevations: [f32; STEP], sums: &mut [Lanes; STEP]) {
        let roots = &mut elevations;
        roots.iter_mut().for_each(|root| *root = self.root(*root));
        let (mut knots, mut fractions) = ([0u32; STEP], [0f32; STEP]);
        for s in 0..STEP {
            (knots[s], fractions[s]) = place(roots[s]);
        }
        for s in 0..STEP {
            // At most the last: the remainder saves a check.
            let knot = knots[s] as usize % MAX_KNOTS;
            let (here, next) = (side[knot], side[knot + 1]);
            let mut more = [0f32; LANES];
            for lane in 0..LANES {
                more[lane] = here[lane] + (next[lane] - here[lane]) * fractions[s];
            }
            sums[s] = plus(sums[s], more);
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

/// Adds to the positions of a step, of which a row may end before the last.
#[inline(always)]
fn add(target: &mut [f32], more: impl Fn(usize) -> f32) {
    match <&mut [f32; STEP]>::try_from(&mut *target) {
        Ok(whole) => whole.iter_mut().enumerate().for_each(|(s, value)| *value += more(s)),
        Err(_) => target.iter_mut().enumerate().for_each(|(s, value)| *value += more(s)),
    }
}
