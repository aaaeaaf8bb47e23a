//! The Pareto front: the points that no other beats in both coordinates.

/// Numbers of the points on the front, by rising first coordinate; less is better in both. Of equal points the first
/// is taken, points with a NaN are not.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).filter(|&i| !points[i].0.is_nan() && !points[i].1.is_nan()).collect();
    order.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(points[a].1.total_cmp(&points[b].1)));
    let mut least = f64::INFINITY;
    order.retain(|&i| {
        let better = points[i].1 < least;
        least = least.min(points[i].1);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_unbeaten_points_are_on_the_front() {
        let points = [(3.0, 1.0), (1.0, 3.0), (2.0, 3.0), (2.0, 2.0), (1.0, 4.0), (4.0, 1.0), (f64::NAN, 0.0)];
        assert_eq!(pareto_front(&points), [1, 3, 0]);
        assert_eq!(pareto_front(&[(1.0, 1.0), (1.0, 1.0)]), [0]);
        assert!(pareto_front(&[]).is_empty());
    }

    #[test]
    fn every_point_is_on_the_front_or_beaten_by_it() {
        let points: Vec<(f64, f64)> = (0..500u32).map(|i| (f64::from(i * 37 % 101), f64::from(i * 53 % 97))).collect();
        let front = pareto_front(&points);
        for (i, p) in points.iter().enumerate() {
            let beaten = |by: &(f64, f64)| by.0 <= p.0 && by.1 <= p.1 && by != p;
            let twin = front.iter().any(|&f| points[f] == *p);
            assert_eq!(twin || front.contains(&i), !points.iter().any(beaten), "{p:?}");
        }
    }
}
