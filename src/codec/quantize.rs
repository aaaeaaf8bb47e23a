//! Uniform quantiser with dead zone (spec section 4.5).

#[cfg(feature = "encode")]
use crate::codec::entropy::MAX_MAGNITUDE;

/// Step and reconstruction points of one component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantizer {
    /// Distance between reconstruction points, in the units of the coefficients (log domain, orthonormal basis).
    pub step: f32,
    /// How far below their multiple of the step magnitudes 1, and 2 and above, are rebuilt; in steps, -0.5 to 0.5.
    pub shrink: [f32; 2],
}

impl Quantizer {
    /// Integer of a coefficient: magnitudes are rounded up from `rounding` (0.5 is rounding to nearest; less makes
    /// the dead zone around zero wider). Encoder's choice: the decoder does not know it.
    /// `None` if its magnitude is beyond what the format holds.
    #[cfg(feature = "encode")]
    pub fn quantize(step: f32, rounding: f64, coefficient: f64) -> Option<i32> {
        let magnitude = coefficient.abs() / f64::from(step) + rounding;
        // Conversion rounds down; `floor` would be a call.
        let within = magnitude < f64::from(MAX_MAGNITUDE + 1);
        within.then_some(if coefficient < 0.0 { -(magnitude as i32) } else { magnitude as i32 })
    }

    /// Coefficient of an integer.
    #[inline(always)]
    pub fn dequantize(&self, q: i32) -> f32 {
        let magnitude = q.unsigned_abs();
        if magnitude == 0 {
            return 0.0;
        }
        let shrink = self.shrink[usize::from(magnitude > 1)];
        let value = (magnitude as f32 - shrink) * self.step;
        if q < 0 { -value } else { value }
    }
}

/// The first coefficient of a block (its mean) is rounded to nearest and rebuilt without shrinking.
pub fn dequantize_mean(step: f32, q: i32) -> f32 {
    q as f32 * step
}

/// Integer of the first coefficient; `None` if its magnitude is beyond what the format holds.
#[cfg(feature = "encode")]
pub fn quantize_mean(step: f32, coefficient: f64) -> Option<i32> {
    let mean = (coefficient / f64::from(step)).round();
    (mean.abs() <= f64::from(MAX_MAGNITUDE)).then_some(mean as i32)
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn error_is_within_the_step(c in -1e4f64..1e4, step in 1e-2f32..1.0, rounding in 0.2f64..0.5, shrink in 0f32..0.3) {
            let q = Quantizer::quantize(step, rounding, c).unwrap();
            let back = f64::from(Quantizer { step, shrink: [shrink; 2] }.dequantize(q));
            // A magnitude q stands for q - rounding to q + 1 - rounding and is rebuilt at q - shrink.
            let bound = f64::from(step) * (1.0 - rounding + f64::from(shrink)) + c.abs() * 2e-7;
            prop_assert!((back - c).abs() <= bound);
            let mean = f64::from(dequantize_mean(step, quantize_mean(step, c).unwrap()));
            prop_assert!((mean - c).abs() <= f64::from(step) * 0.5001 + c.abs() * 2e-7);
        }
    }

    #[test]
    fn what_the_format_cannot_hold_is_refused() {
        assert_eq!(Quantizer::quantize(1e-30, 0.5, 1e30), None);
        assert_eq!(Quantizer::quantize(1.0, 0.5, f64::NAN), None);
        assert_eq!(Quantizer::quantize(1.0, 0.4, -f64::from(MAX_MAGNITUDE)), Some(-(MAX_MAGNITUDE as i32)));
        assert_eq!(quantize_mean(1e-30, -1e30), None);
        assert_eq!(Quantizer::quantize(0.1, 0.4, 0.0), Some(0));
    }
}
