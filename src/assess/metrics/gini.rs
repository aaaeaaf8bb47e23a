//! Gini index: how sparse a vector is, whatever its scale.

/// The Gini index of the magnitudes of `values` (Hurley, Rickard, "Comparing Measures of Sparsity", 2009):
/// `1 - 2 sum_k |c|_(k) / ||c||_1 * (n - k + 1/2) / n`, k = 1..n in ascending order.
///
/// 0 where all magnitudes are equal, `1 - 1/n` for a single spike; 0 for zeros and for no values. NaN counts as 0.
pub fn gini(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values.iter().map(|v| if v.is_nan() { 0.0 } else { v.abs().min(f64::MAX) }).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let Some(&largest) = sizes.last().filter(|largest| **largest > 0.0) else { return 0.0 };
    let n = sizes.len() as f64;
    let (mut sum, mut ranked) = (0.0, 0.0);
    for (i, size) in sizes.iter().enumerate() {
        // Over the largest, so that sums do not overflow.
        let share = size / largest;
        sum += share;
        ranked += share * (n - i as f64 - 0.5) / n;
    }
    1.0 - 2.0 * ranked / sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_forms() {
        for n in [1usize, 2, 10, 3375] {
            let mut values = vec![-2.5; n];
            assert!(gini(&values).abs() < 1e-12);
            values.fill(0.0);
            assert_eq!(gini(&values), 0.0);
            values[n / 2] = -1e-3;
            assert!((gini(&values) - (1.0 - 1.0 / n as f64)).abs() < 1e-12);
            // 1, 2, ..., n: (n - 1) / (3 n).
            let ramp: Vec<f64> = (1..=n).rev().map(|k| k as f64).collect();
            assert!((gini(&ramp) - (n as f64 - 1.0) / (3.0 * n as f64)).abs() < 1e-12);
        }
    }

    #[test]
    fn scale_does_not_matter_and_extremes_are_harmless() {
        let values = [0.0, 1.0, -3.0, 0.5];
        for scale in [1e-300, 7.0, 1e300] {
            assert!((gini(&values.map(|v| v * scale)) - gini(&values)).abs() < 1e-12);
        }
        assert_eq!(gini(&[]), 0.0);
        assert!((gini(&[f64::NAN, f64::INFINITY, 0.0, 0.0]) - 0.75).abs() < 1e-12);
        assert!(gini(&[f64::MAX; 3]).abs() < 1e-12);
    }
}
