//! The largest error that a file may have, and the corrections that keep it (spec section 4.11).

use crate::base::error::{Error, Result};
use crate::codec::entropy::MAX_MAGNITUDE;
use crate::base::limits::STEP_RANGE;

/// Correction step in largest errors. Up to 2 would do; an entry is corrected where it is off by more than one error,
/// and one step serves up to nearly three.
///
/// Measured, bytes at 1.2 / 1.5 / 1.7 / 1.98: alum-bronze at E = 0.05 45,640 / 45,253 / 45,526 / 45,308, at 0.3 12,264 /
/// 12,124 / 12,002 / 11,841; golden yellow 65,805 / 65,405 / 65,129 / 64,816 and 16,634 / 16,396 / 16,123 / 15,973. The
/// rms error rises by 8 % from 1.2 to 1.98.
const STEP: f64 = 1.98;

/// Largest errors that can be asked for.
const RANGE: std::ops::RangeInclusive<f64> = 1e-9..=1e3;

/// What corrections are made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bound {
    /// Largest error of the decoded logs: below the promise by what exp, ln and a change of units round.
    limit: f64,
    /// Correction step.
    pub(super) step: f32,
}

impl Bound {
    /// A bound that log values of magnitudes up to `largest` can keep.
    pub(super) fn new(max_error: f64, largest: f64) -> Result<Bound> {
        let bad = |what: String| Err(Error::InvalidArgument(what));
        if !RANGE.contains(&max_error) {
            return bad(format!("the largest error is {max_error}, must be within {RANGE:?}"));
        }
        // Half the distance between single-precision numbers of this magnitude.
        let half_ulp = largest.max(1e-30).log2().ceil().exp2() / (1u64 << 24) as f64;
        let least = 4.0 * half_ulp;
        if max_error < least {
            return bad(format!(
                "a largest error of {max_error} cannot be kept: log values of magnitude {largest:.1} are single-precision \
                 numbers in the file; the least error to ask for is {least:.2e}"
            ));
        }
        let step = (STEP * max_error).min(2.0 * (max_error - 2.0 * half_ulp)) as f32;
        let step = step.clamp(*STEP_RANGE.start(), *STEP_RANGE.end());
        Ok(Bound { limit: max_error * (1.0 - 1e-9) - 1e-12, step })
    }

    /// Corrections of a block's decoded logs, `[channel][position]`; empty if none is needed. `floor` and `ceiling`
    /// are what the inverse tone map cuts logs off at. The error is that of the worst entry that nothing helps.
    pub(super) fn corrections(
        &self,
        log: &[f64],
        valid: &[bool],
        decoded: &[f32],
        [floor, ceiling]: [f64; 2],
    ) -> std::result::Result<Vec<i32>, f64> {
        let mut corrections = Vec::new();
        for (i, ((&value, &valid), &decoded)) in log.iter().zip(valid).zip(decoded).enumerate() {
            let error = |log: f32| (value - f64::from(log).clamp(floor, ceiling)).abs();
            if !valid || error(decoded) <= self.limit {
                continue;
            }
            let nearest = ((value - f64::from(decoded)) / f64::from(self.step)).round();
            // Rounding to single precision may favour a neighbour; the smallest that does is the cheapest.
            let mut candidates = [nearest, nearest - 1.0, nearest + 1.0];
            candidates.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
            let after = |m: f64| error(decoded + m as f32 * self.step);
            let fits = |m: &f64| m.abs() <= f64::from(MAX_MAGNITUDE) && after(*m) <= self.limit;
            let Some(m) = candidates.into_iter().find(fits) else {
                return Err(after(nearest));
            };
            if corrections.is_empty() {
                corrections.resize(log.len(), 0);
            }
            corrections[i] = m as i32;
        }
        Ok(corrections)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CUTS: [f64; 2] = [-700.0, 709.0];

    proptest! {
        #[test]
        fn corrected_values_keep_the_bound(
            value in -700f64..700.0, off in -1000f64..1000.0, exponent in -4i32..2, shrink in 0u32..40
        ) {
            let max_error = 10f64.powi(exponent);
            let (value, off) = (value * 0.5f64.powi(shrink as i32), off * 0.5f64.powi(shrink as i32));
            let decoded = (value + off) as f32;
            let bound = Bound::new(max_error, value.abs().max(f64::from(decoded).abs())).unwrap_or_else(|_| {
                Bound::new(max_error.max(1e-3), 1400.0).unwrap()
            });
            let corrections = bound.corrections(&[value], &[true], &[decoded], CUTS).unwrap();
            let mut log = [decoded];
            crate::codec::correct::correct(&mut log, &corrections, bound.step);
            prop_assert!((value - f64::from(log[0]).clamp(CUTS[0], CUTS[1])).abs() <= bound.limit);
        }
    }

    #[test]
    fn what_single_precision_cannot_hold_is_refused() {
        assert!(Bound::new(1e-6, 11.5).unwrap_err().to_string().contains("single-precision"));
        assert!(Bound::new(1e-5, 11.5).is_ok());
        assert!(Bound::new(f64::NAN, 1.0).is_err() && Bound::new(0.0, 1.0).is_err() && Bound::new(1e4, 1.0).is_err());
    }

    #[test]
    fn only_outliers_are_corrected() {
        let bound = Bound::new(0.1, 10.0).unwrap();
        let correct = |decoded: [f32; 4]| bound.corrections(&[1.0; 4], &[true, true, true, false], &decoded, CUTS);
        assert_eq!(correct([1.05, 0.91, 1.0, 9.0]).unwrap(), [0i32; 0]);
        assert_eq!(correct([1.05, 0.89, 1.28, 9.0]).unwrap(), [0, 1, -1, 0]);
        assert!(correct([1.0, 1.0, 1e9, 9.0]).is_err());
    }
}
