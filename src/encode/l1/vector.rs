//! Vector arithmetic of the solver, in a fixed order of summation: every run gives the same bits.

/// Partial sums. A fixed number of independent ones lets the compiler use vector registers.
pub(super) const LANES: usize = 8;

/// Inner product.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    sum(a, b, |x, y| x * y)
}

/// ||a - b||^2
pub(super) fn distance_squared(a: &[f64], b: &[f64]) -> f64 {
    sum(a, b, |x, y| (x - y) * (x - y))
}

/// v = y - v
pub(super) fn subtract_from(y: &[f64], v: &mut [f64]) {
    for (v, y) in v.iter_mut().zip(y) {
        *v = y - *v;
    }
}

/// a = a + fraction * (b - a)
pub(super) fn move_towards(a: &mut [f64], b: &[f64], fraction: f64) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += fraction * (b - *a);
    }
}

/// v = factor * v
pub(super) fn scale(v: &mut [f64], factor: f64) {
    for v in v {
        *v *= factor;
    }
}

/// Largest magnitude; NaN if there is one.
pub(super) fn max_abs(v: &[f64]) -> f64 {
    v.iter().fold(0.0, |m: f64, x| if x.abs() <= m || m.is_nan() { m } else { x.abs() })
}

/// Sum of `term` over the entries of both.
#[inline(always)]
fn sum(a: &[f64], b: &[f64], term: impl Fn(f64, f64) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    let (a_lanes, a_rest) = a.as_chunks::<LANES>();
    let (b_lanes, b_rest) = b.as_chunks::<LANES>();
    for (a, b) in a_lanes.iter().zip(b_lanes) {
        for k in 0..LANES {
            sums[k] += term(a[k], b[k]);
        }
    }
    for (a, b) in a_rest.iter().zip(b_rest) {
        sums[0] += term(*a, *b);
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_cover_lanes_and_rest() {
        for n in [0, 1, 7, 8, 9, 31] {
            let a: Vec<f64> = (0..n).map(|i| i as f64 - 3.0).collect();
            let b: Vec<f64> = (0..n).map(|i| 2.0 * i as f64).collect();
            let product: f64 = a.iter().zip(&b).map(|(x, y)| x * y).sum();
            let apart: f64 = a.iter().zip(&b).map(|(x, y)| (x - y).powi(2)).sum();
            assert_eq!(dot(&a, &b), product);
            assert_eq!(distance_squared(&a, &b), apart);
        }
    }

    #[test]
    fn max_abs_reports_nan_wherever_it_stands() {
        assert_eq!(max_abs(&[]), 0.0);
        assert_eq!(max_abs(&[1.0, -3.0, 2.0]), 3.0);
        assert!(max_abs(&[f64::NAN, 1.0]).is_nan());
        assert!(max_abs(&[1.0, f64::NAN, 2.0]).is_nan());
        assert_eq!(max_abs(&[f64::NEG_INFINITY]), f64::INFINITY);
    }
}
