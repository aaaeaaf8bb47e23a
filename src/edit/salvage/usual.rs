//! Fields of GRID and CODE that vouch for themselves: their value is one of the few that such a field usually has.
//!
//! Damage that is taken for one flipped bit leaves the rest of itself in the section. In a field of 64 bits that usually holds zero, pi or a
//! short decimal number it shows.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::evidence::{WANTED, of_one_bit};
use crate::codec::channel::ChannelTransform;
use crate::codec::sample::Sampling;
use crate::format::header::Coding;
use crate::table::block::Block;
use crate::table::grid::{Channel, Grid, MERL_SCALE};
use crate::table::horizon::Horizon;

/// Digits of a decimal number that people write down, in binary64 and in binary32.
const DIGITS: usize = 6;
const DIGITS_F32: usize = 4;
/// Magnitudes of such numbers. Zero with some bits set is a number of few digits as well, but too small for anybody to write.
const MAGNITUDES: std::ops::RangeInclusive<f64> = 1e-12..=1e12;
/// Largest divisor of a usual scale.
const DIVISOR: f64 = 1e6;
/// Most bins whose elevations the horizon is compared with.
const MOST_BINS: usize = 1 << 24;

/// Bits of a section that nothing vouches for.
#[derive(Default)]
struct Unvouched {
    bits: u64,
    /// Bytes from the first to the last of them.
    first: Option<usize>,
    end: usize,
}

impl Unvouched {
    /// Counts a field of some bytes unless it is vouched for, and gives the place behind it.
    fn field(&mut self, at: usize, bytes: usize, vouched: bool) -> usize {
        if !vouched && bytes > 0 {
            self.bits += 8 * bytes as u64;
            self.first.get_or_insert(at);
            self.end = at + bytes;
        }
        at + bytes
    }

    fn evidence(&self) -> u32 {
        match self.first {
            Some(first) => of_one_bit(self.bits, 8 * (self.end - first) as u64),
            None => WANTED,
        }
    }
}

/// A decimal number of few digits.
fn is_short(x: f64) -> bool {
    x.to_bits() == 0 || MAGNITUDES.contains(&x.abs()) && digits(&format!("{x:e}")) <= DIGITS
}

fn is_short_f32(x: f32) -> bool {
    x.to_bits() == 0 || MAGNITUDES.contains(&f64::from(x.abs())) && digits(&format!("{x:e}")) <= DIGITS_F32
}

/// Digits of a number in scientific notation.
fn digits(text: &str) -> usize {
    text.split('e').next().unwrap_or(text).bytes().filter(u8::is_ascii_digit).count()
}

/// An angle in radians of few digits, in radians or in degrees, or a usual part of a turn.
fn is_usual_angle(x: f64) -> bool {
    let degrees = x.to_degrees().round();
    [FRAC_PI_2, PI, TAU].contains(&x) || is_short(x) || degrees != 0.0 && degrees.to_radians() == x
}

fn is_usual_scale(x: f64) -> bool {
    let divisor = (1.0 / x).round();
    is_short(x) || MERL_SCALE.contains(&x) || divisor <= DIVISOR && x == 1.0 / divisor
}

/// A colour, or the channel's wavelength.
fn is_usual_name(channel: &Channel) -> bool {
    let wavelength = channel.wavelength.is_some_and(|w| channel.name.trim_end_matches("nm").parse() == Ok(w));
    wavelength || ["R", "G", "B", "X", "Y", "Z"].contains(&&channel.name[..])
}

/// Evidence for one bit that was flipped back in GRID (spec section 3.2), if the section reads as this grid.
pub(super) fn of_grid(grid: &Grid) -> u32 {
    let mut unvouched = Unvouched::default();
    let mut at = 1;
    for axis in grid.axes() {
        // Name, mapping, reserved bytes, length: of few values, or held by the partition.
        at = unvouched.field(at, 8, true);
        at = unvouched.field(at, 8, is_usual_angle(axis.start));
        at = unvouched.field(at, 8, is_usual_angle(axis.end));
    }
    at = unvouched.field(at, 2, true);
    for channel in grid.channels() {
        at = unvouched.field(at, 8, is_usual_scale(channel.scale));
        at = unvouched.field(at, 8, channel.wavelength.is_none_or(is_short));
        at = unvouched.field(at, 1, true);
        at = unvouched.field(at, channel.name.len(), is_usual_name(channel));
    }
    unvouched.evidence()
}

/// Evidence for one bit that was flipped back in CODE (spec section 3.3), if the section reads as this coding of that grid.
pub(super) fn of_coding(coding: &Coding, grid: &Grid) -> u32 {
    let mut unvouched = Unvouched::default();
    // Basis, tone map, entropy coder, transform: of two values. Shrink: of any.
    let mut at = unvouched.field(0, 4, true);
    at = unvouched.field(at, 2, false);
    at = unvouched.field(at, 2, true);
    at = unvouched.field(at, 8, is_short(coding.eps));
    at = unvouched.field(at, 8, coding.horizon.is_none_or(|threshold| is_elevation(threshold, grid)));
    at = unvouched.field(at, 8, coding.seed == 0);
    at = unvouched.field(at, 4, is_usual_ratio(coding.sampling));
    let steps = &coding.steps;
    let same = steps.len() > 1 && steps.iter().all(|step| *step == steps[0]);
    at = unvouched.field(at, 4 * steps.len(), same || steps.iter().all(|step| is_short_f32(*step)));
    if let ChannelTransform::Matrix(matrix) = &coding.transform {
        at = unvouched.field(at, 4 * matrix.len(), coding.transform == ChannelTransform::opponent());
    }
    unvouched.field(at, 4, coding.correction.is_none_or(is_short_f32));
    unvouched.evidence()
}

/// What the encoder chooses a horizon from: the elevation of a bin's centre, or a multiple of 2^-13.
fn is_elevation(threshold: f64, grid: &Grid) -> bool {
    if threshold != 0.0 && (threshold * 8192.0).fract() == 0.0 {
        return true;
    }
    let Some(horizon) = Horizon::new(grid).filter(|_| grid.positions() <= MOST_BINS) else { return false };
    let mut found = false;
    horizon.for_each(&Block { origin: [0; 4], shape: grid.shape() }, |elevation| found |= elevation == threshold);
    found
}

/// Every entry, or a share of few digits.
fn is_usual_ratio(sampling: Sampling) -> bool {
    let Sampling::Bernoulli { threshold } = sampling else { return true };
    let short = (f64::from(threshold) / 4_294_967_296.0 * 1e4).round() / 1e4;
    threshold.is_power_of_two() || Sampling::from_ratio(short) == Some(sampling)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_numbers_are_those_that_people_write() {
        assert!([0.0, 1.0, 1e-3, 450.0, 385.65, 1e12].into_iter().all(is_short));
        assert!([PI, 1.0 / 3.0, f64::from_bits(0x3F50_624D_D2F1_A9FD), 385.650_000_1].iter().all(|x| !is_short(*x)));
        // What damage leaves of a zero.
        assert!([-0.0, 5e-324, 1e-322, f64::from_bits(0x4200), 1e-300].iter().all(|x| !is_short(*x)));
        assert!(!is_usual_angle(-0.0) && !is_usual_angle(5e-324) && !is_usual_scale(1e-20) && is_usual_angle(0.0));
        assert!(!is_short_f32(-0.0) && !is_short_f32(1e-45));
        assert!([0.065f32, 0.1, 2.5e-4].into_iter().all(is_short_f32) && !is_short_f32(0.065_123_4));
        assert!([0.0, PI, 30f64.to_radians()].into_iter().all(is_usual_angle) && !is_usual_angle(1.234_567_8));
        assert!(MERL_SCALE.into_iter().chain([1.0, 1.0 / 255.0]).all(is_usual_scale) && !is_usual_scale(0.123_456_789));
    }

    /// Every bit of a usual grid vouches for itself; one unusual number leaves as many bits as it has.
    #[test]
    fn what_is_unusual_costs_evidence() {
        let grid = Grid::merl();
        assert_eq!(of_grid(&grid), WANTED);
        let mut axes = grid.axes().to_vec();
        axes[1].end = 1.234_567_890_123;
        let other = Grid::new(axes.clone(), grid.channels().to_vec()).unwrap();
        assert_eq!(of_grid(&other), 32 - 6);
        axes[2].end = 3.034_567_890_123;
        let other = Grid::new(axes, grid.channels().to_vec()).unwrap();
        assert_eq!(of_grid(&other), 32 - 7);
    }
}
