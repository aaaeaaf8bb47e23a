//! Tone map: values in 1/sr to the log domain and back (spec section 4.1).

use crate::base::portable::{FEWER_LANES, LANES, exp32, exp32_lanes, exp64};

/// L = ln(f + eps). `f` in 1/sr, not negative; `eps` in 1/sr, positive: below it values lose relative precision.
#[cfg(feature = "encode")]
pub fn tone_map(f: f64, eps: f64) -> f64 {
    (f + eps).ln()
}

/// f = max(exp(L) - eps, 0) in single precision, at most `f32::MAX`.
#[inline(always)]
pub fn inverse_tone_map(log: f32, eps: f32) -> f32 {
    (exp32(log) - eps).max(0.0)
}

/// [`inverse_tone_map`] of each, in place.
#[inline(always)]
pub(crate) fn inverse_tone_maps(values: &mut [f32], eps: f32) {
    let rest = together::<LANES>(values, eps);
    let rest = together::<FEWER_LANES>(rest, eps);
    together::<1>(rest, eps);
}

/// `N` at a time; gives what is left over.
#[inline(always)]
fn together<const N: usize>(values: &mut [f32], eps: f32) -> &mut [f32] {
    let mut chunks = values.chunks_exact_mut(N);
    for chunk in &mut chunks {
        if let Ok(lanes) = <&mut [f32; N]>::try_from(chunk) {
            exp32_lanes(lanes);
            lanes.iter_mut().for_each(|value| *value = (*value - eps).max(0.0));
        }
    }
    chunks.into_remainder()
}

/// f = max(exp(L) - eps, 0) in double precision from the same single-precision L, for tables beyond f32's range.
pub fn inverse_tone_map_f64(log: f32, eps: f64) -> f64 {
    (exp64(f64::from(log)) - eps).max(0.0)
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    #[test]
    fn inverse_undoes_the_map_over_the_whole_range() {
        for eps in [1e-9, 1e-3, 1.0] {
            for exponent in -300..300 {
                let f = 10f64.powi(exponent);
                let log = tone_map(f, eps) as f32;
                let back = inverse_tone_map_f64(log, eps);
                // The log is rounded to single precision: half an ulp of |L| is the relative error of f + eps.
                let bound = (f + eps) * f64::from(log.abs().max(1.0)) * 1.3e-7;
                assert!((back - f).abs() <= bound, "{f} {eps} {back}");
                if f < 3e38 {
                    let single = f64::from(inverse_tone_map(log, eps as f32));
                    assert!((single - f).abs() <= 3.0 * bound + 1e-37, "{f} {eps} {single}");
                }
            }
        }
    }
}
