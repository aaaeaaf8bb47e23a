//! Elementary functions with one result on every machine (spec section 2).
//!
//! The system's `cos` and `exp` differ between platforms; a decoder must not. These use only the correctly
//! rounded operations of IEEE 754 in the order written here, which Rust neither reorders nor contracts.

use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, FRAC_PI_4, PI};

/// `1/(2k)!` with alternating sign, k = 9 down to 1: cosine less its leading 1.
const COS: [f64; 9] = [
    -1.0 / 6402373705728000.0,
    1.0 / 20922789888000.0,
    -1.0 / 87178291200.0,
    1.0 / 479001600.0,
    -1.0 / 3628800.0,
    1.0 / 40320.0,
    -1.0 / 720.0,
    1.0 / 24.0,
    -1.0 / 2.0,
];

/// `1/(2k+1)!` with alternating sign, k = 9 down to 1: sine over x, less its leading 1.
const SIN: [f64; 9] = [
    -1.0 / 121645100408832000.0,
    1.0 / 355687428096000.0,
    -1.0 / 1307674368000.0,
    1.0 / 6227020800.0,
    -1.0 / 39916800.0,
    1.0 / 362880.0,
    -1.0 / 5040.0,
    1.0 / 120.0,
    -1.0 / 6.0,
];

/// `1/k!`, k = 13 down to 0.
const EXP64: [f64; 14] = [
    1.0 / 6227020800.0,
    1.0 / 479001600.0,
    1.0 / 39916800.0,
    1.0 / 3628800.0,
    1.0 / 362880.0,
    1.0 / 40320.0,
    1.0 / 5040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    1.0 / 2.0,
    1.0,
    1.0,
];

/// `1/k!` in single precision, k = 7 down to 0.
const EXP32: [f32; 8] = [1.0 / 5040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 1.0 / 2.0, 1.0, 1.0];

/// atan(t) = t + t^3 P(t^2) / Q(t^2) for |t| <= 0.66, coefficients of Moshier's Cephes library, highest power first; Q begins with 1.
#[allow(clippy::excessive_precision, reason = "as published")]
const ATAN_P: [f64; 5] = [
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
];
#[allow(clippy::excessive_precision, reason = "as published")]
const ATAN_Q: [f64; 5] = [
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
];

/// ln 2 in two parts; the first has enough trailing zeros for exact products with any exponent.
const LN2_HI: f64 = f64::from_bits(0x3FE6_2E42_FEE0_0000);
const LN2_LO: f64 = f64::from_bits(0x3DEA_39EF_3579_3C76);
const LN2_HI32: f32 = f32::from_bits(0x3F31_7200);
const LN2_LO32: f32 = f32::from_bits(0x35BF_BE8E);

/// Adding this to a small number rounds it to an integer, half to even, and leaves the integer in the low bits.
const ROUND64: f64 = 6755399441055744.0;
const ROUND32: f32 = 12582912.0;

fn horner(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().fold(0.0, |sum, c| sum * x + c)
}

/// Cosine and sine for |x| <= pi/4.
fn cos_kernel(x: f64) -> f64 {
    let z = x * x;
    horner(&COS, z) * z + 1.0
}

fn sin_kernel(x: f64) -> f64 {
    let z = x * x;
    horner(&SIN, z) * z * x + x
}

/// `cos(2 pi p / q)`, exact where it is 0 or +-1.
pub(crate) fn cos_turn(p: u64, q: u64) -> f64 {
    // In eighths of a turn times q: first to half a turn, then to a quarter, then to an eighth.
    let eighths = (8 * p) % (8 * q);
    let eighths = eighths.min(8 * q - eighths);
    let (eighths, sign) = if eighths > 2 * q { (4 * q - eighths, -1.0) } else { (eighths, 1.0) };
    if eighths <= q {
        sign * cos_kernel(eighths as f64 / q as f64 * FRAC_PI_4)
    } else {
        sign * sin_kernel((2 * q - eighths) as f64 / q as f64 * FRAC_PI_4)
    }
}

/// Sine and cosine of an angle of at most a few turns.
pub(crate) fn sin_cos(angle: f64) -> (f64, f64) {
    let turns = angle * FRAC_2_PI + ROUND64;
    let quarter = turns.to_bits() & 3;
    let rest = angle - (turns - ROUND64) * FRAC_PI_2;
    let (sin, cos) = (sin_kernel(rest), cos_kernel(rest));
    match quarter {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Angle of (x, y) from the x axis, -pi to pi; 0 where both are zero, finite arguments only. Within 3e-16 of the truth. No
/// branches: loops over it vectorise.
#[inline(always)]
pub(crate) fn atan2(y: f64, x: f64) -> f64 {
    let (rise, run) = (y.abs(), x.abs());
    let steep = rise > run;
    let (low, high) = if steep { (run, rise) } else { (rise, run) };
    let slope = low / if high > 0.0 { high } else { 1.0 };
    // Beyond the reach of the rational function: atan(t) = pi/4 + atan((t - 1) / (t + 1)).
    let far = slope > 0.66;
    let t = if far { (slope - 1.0) / (slope + 1.0) } else { slope };
    let z = t * t;
    let mut sums = [0.0, 1.0];
    for k in 0..5 {
        sums = [sums[0] * z + ATAN_P[k], sums[1] * z + ATAN_Q[k]];
    }
    let angle = t * z * (sums[0] / sums[1]) + t;
    let angle = angle + if far { FRAC_PI_4 } else { 0.0 };
    let angle = if steep { FRAC_PI_2 - angle } else { angle };
    let angle = if x < 0.0 { PI - angle } else { angle };
    if y < 0.0 { -angle } else { angle }
}

/// exp(x) in double precision, 0 below -708, saturating at the largest finite value.
pub(crate) fn exp64(x: f64) -> f64 {
    if x < -708.0 {
        return 0.0;
    }
    let x = x.min(710.0);
    let shifted = x * std::f64::consts::LOG2_E + ROUND64;
    let n = shifted - ROUND64;
    let exponent = shifted.to_bits().wrapping_sub(ROUND64.to_bits());
    let r = (x - n * LN2_HI) - n * LN2_LO;
    // Half the power first: 2^1024 is not finite, but exp(709.7) is.
    let half_power = f64::from_bits(exponent.wrapping_add(1022) << 52);
    (horner(&EXP64, r) * half_power * 2.0).min(f64::MAX)
}

/// exp(x) in single precision, 0 below -86, saturating at the largest finite value; branch-free, so that it vectorises.
#[inline(always)]
pub(crate) fn exp32(x: f32) -> f32 {
    let mut one = [x];
    exp32_lanes(&mut one);
    one[0]
}

/// Lanes that [`exp32_lanes`] does best with, and where fewer are left. Of 32 the compiler makes straight code, and puts one vector of it
/// after the other.
pub(crate) const LANES: usize = 128;
pub(crate) const FEWER_LANES: usize = 32;

/// [`exp32`] of each, in place. One after the other they would take half as long again: the processor looks ahead some sixty operations,
/// and in those few can start, since each waits for the one before. Step by step for many, most can.
#[inline(always)]
pub(crate) fn exp32_lanes<const N: usize>(x: &mut [f32; N]) {
    let (mut rest, mut power, mut sum) = ([0f32; N], [0f32; N], [0f32; N]);
    for i in 0..N {
        let clamped = x[i].clamp(-86.0, 89.0);
        power[i] = clamped * std::f32::consts::LOG2_E + ROUND32;
        let n = power[i] - ROUND32;
        rest[i] = (clamped - n * LN2_HI32) - n * LN2_LO32;
    }
    for i in 0..N {
        let exponent = power[i].to_bits().wrapping_sub(ROUND32.to_bits());
        let half_power = f32::from_bits(exponent.wrapping_add(126) << 23);
        power[i] = if x[i] < -86.0 { 0.0 } else { half_power };
        sum[i] = EXP32[0] * rest[i] + EXP32[1];
    }
    for two in EXP32[2..].chunks_exact(2) {
        for i in 0..N {
            sum[i] = (sum[i] * rest[i] + two[0]) * rest[i] + two[1];
        }
    }
    for i in 0..N {
        x[i] = (sum[i] * power[i] * 2.0).min(f32::MAX);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Spec section 2, for one number.
    fn exp_of_the_specification(x: f32) -> f32 {
        let clamped = x.clamp(-86.0, 89.0);
        let shifted = clamped * std::f32::consts::LOG2_E + ROUND32;
        let n = shifted - ROUND32;
        let r = (clamped - n * LN2_HI32) - n * LN2_LO32;
        let sum = EXP32[1..].iter().fold(EXP32[0], |sum, c| sum * r + c);
        let exponent = shifted.to_bits().wrapping_sub(ROUND32.to_bits());
        let value = (sum * f32::from_bits(exponent.wrapping_add(126) << 23) * 2.0).min(f32::MAX);
        if x < -86.0 { 0.0 } else { value }
    }

    /// Also of what is no number, and of every size.
    #[test]
    fn lanes_have_the_bits_of_one_at_a_time() {
        let special = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -86.0, -86.00001, 88.72, 88.73, 89.0, 0.0, -0.0];
        let range = (-1_000_000..1_000_000).step_by(STEP).map(|i| i as f32 * 1e-4);
        let arguments: Vec<f32> = special.into_iter().chain(range).collect();
        together::<LANES>(&arguments);
        together::<FEWER_LANES>(&arguments);
        together::<8>(&arguments);
        together::<1>(&arguments);
    }

    fn together<const N: usize>(arguments: &[f32]) {
        for x in arguments.chunks_exact(N) {
            let mut lanes: [f32; N] = x.try_into().unwrap();
            exp32_lanes(&mut lanes);
            for (x, lane) in x.iter().zip(lanes) {
                assert_eq!(lane.to_bits(), exp_of_the_specification(*x).to_bits(), "{x}, {N}");
            }
        }
    }

    /// Miri takes a thousandth of the arguments.
    const STEP: usize = if cfg!(miri) { 997 } else { 1 };

    #[test]
    fn arc_tangent_agrees_with_the_system_in_every_octant() {
        for i in (0..20_000).step_by(STEP) {
            let angle = (f64::from(i) - 10_000.0) / 10_000.0 * PI;
            let radius = [1e-150, 0.3, 1e150][i as usize % 3];
            let (y, x) = (radius * angle.sin(), radius * angle.cos());
            assert!((atan2(y, x) - y.atan2(x)).abs() <= 4.5e-16, "{y} {x}");
        }
        // Small angles keep their relative precision.
        for y in [1e-300, -3e-17, 2e-8, -0.1] {
            assert!((atan2(y, 1.0) / y.atan2(1.0) - 1.0).abs() <= 2.5e-16, "{y}");
        }
        assert_eq!((atan2(0.0, 0.0), atan2(0.0, 2.0), atan2(0.0, -2.0)), (0.0, 0.0, PI));
        assert_eq!((atan2(1.0, 0.0), atan2(-1.0, 0.0), atan2(1.0, 1.0)), (FRAC_PI_2, -FRAC_PI_2, FRAC_PI_4));
    }

    #[test]
    fn cosines_agree_with_the_system_library() {
        for q in [1u64, 2, 3, 4, 7, 8, 60, 360, 720, 65536 * 4] {
            for p in (0..2 * q).step_by(1 + q as usize * STEP / 1000) {
                let expected = (2.0 * std::f64::consts::PI * p as f64 / q as f64).cos();
                assert!((cos_turn(p, q) - expected).abs() < 4e-15, "{p}/{q}");
            }
        }
        assert_eq!(cos_turn(1, 4), 0.0);
        assert_eq!(cos_turn(3, 4), 0.0);
        assert_eq!(cos_turn(1, 2), -1.0);
        for i in (-1000..1000).step_by(STEP) {
            let x = f64::from(i) * 0.0123;
            let (sin, cos) = sin_cos(x);
            assert!((sin - x.sin()).abs() < 4e-15 && (cos - x.cos()).abs() < 4e-15, "{x}");
        }
    }

    #[test]
    fn exponentials_agree_with_the_system_library() {
        for i in (-70000..70900).step_by(STEP) {
            let x = f64::from(i) * 0.01;
            assert!((exp64(x) / x.exp() - 1.0).abs() < 1e-15, "{x}: {} {}", exp64(x), x.exp());
        }
        for i in (-85999..88700).step_by(STEP) {
            let x = i as f32 * 0.001;
            let expected = f64::from(x).exp();
            assert!((f64::from(exp32(x)) / expected - 1.0).abs() < 2e-7, "{x}");
        }
    }

    #[test]
    fn exponentials_saturate() {
        assert_eq!(exp64(f64::INFINITY), f64::MAX);
        assert_eq!(exp64(1e300), f64::MAX);
        assert_eq!(exp64(f64::NEG_INFINITY), 0.0);
        assert_eq!(exp32(f32::INFINITY), f32::MAX);
        assert_eq!(exp32(1e30), f32::MAX);
        assert_eq!(exp32(f32::NEG_INFINITY), 0.0);
        assert!(exp64(709.7).is_finite() && exp64(709.7) > 1e308);
        assert!(exp32(88.7).is_finite() && exp32(88.7) > 3.3e38);
    }
}
