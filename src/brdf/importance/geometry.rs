//! Half vectors as seen from one given direction: which of them mirror it to above the horizon, and where to.
//!
//! A half vector at theta_h, and phi_h from the azimuth of the given direction, mirrors it to the height
//! sin(theta_i) sin(2 theta_h) cos(phi_h) + cos(theta_i) cos(2 theta_h). That is above the horizon for all phi_h while
//! theta_i + 2 theta_h < pi/2, for none once 2 theta_h > pi/2 + theta_i, and between them for phi_h within
//! acos(-cot(theta_i) cot(2 theta_h)) of zero.
//!
//! Elevations of half vectors are measured by `t = 1 - cos(theta_h)`, in which solid angle is even.

use std::f64::consts::PI;

/// Heights of the given direction below this leave half vectors too few digits; 1e-6 is 0.00006 degrees.
const LEAST_HEIGHT: f64 = 1e-6;

/// Heights of mirrored directions that rounding took to the horizon or below.
const LEAST_MIRRORED: f64 = 1e-12;

/// A direction above the horizon.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Given {
    w: [f64; 3],
    sin: f64,
    /// Unit vector along its azimuth; any where it is the normal.
    azimuth: [f64; 2],
}

/// A half vector as the given direction sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Half {
    /// `1 - cos(theta_h)`, 0 to 1.
    pub(crate) t: f64,
    /// Azimuth from that of the given direction, 0 to pi.
    pub(crate) phi: f64,
    /// Cosine between the half vector and the given direction, `cos(theta_d)`.
    pub(crate) along: f64,
}

impl Given {
    /// `None` unless the unit vector `w` is above the horizon.
    pub(crate) fn new(w: [f64; 3]) -> Option<Given> {
        let sin = (w[0] * w[0] + w[1] * w[1]).sqrt();
        let azimuth = if sin > 1e-140 { [w[0] / sin, w[1] / sin] } else { [1.0, 0.0] };
        (w[2] > 0.0).then_some(Given { w, sin, azimuth })
    }

    pub(crate) fn is_grazing(&self) -> bool {
        self.w[2] < LEAST_HEIGHT
    }

    /// `1 - cos(theta_i)`, without loss of digits near the normal.
    pub(crate) fn t(&self) -> f64 {
        self.sin * self.sin / (1.0 + self.w[2])
    }

    /// The `t` at which no half vector is left: theta_h = pi/4 + theta_i/2.
    pub(crate) fn t_max(&self) -> f64 {
        let cos = self.w[2];
        // (1 - sin) / 2, without loss of digits near the horizon.
        1.0 - (0.5 * cos * cos / (1.0 + self.sin)).sqrt()
    }

    /// Largest azimuth of the half vectors at `t`, 0 to pi.
    pub(crate) fn phi_max(&self, t: f64) -> f64 {
        let (sin_h, cos_h) = sin_cos(t);
        let threshold = -self.w[2] * (2.0 * cos_h * cos_h - 1.0);
        let swing = self.sin * 2.0 * sin_h * cos_h;
        if threshold <= -swing {
            return PI;
        }
        if threshold >= swing { 0.0 } else { (threshold / swing).acos() }
    }

    /// Mirrors the given direction in the half vector at `t` and azimuth `phi`.
    pub(crate) fn mirror(&self, t: f64, phi: f64) -> [f64; 3] {
        let (sin_h, cos_h) = sin_cos(t);
        let (sin, cos) = phi.sin_cos();
        let [x, y] = self.azimuth;
        let half = [sin_h * (cos * x - sin * y), sin_h * (cos * y + sin * x), cos_h];
        let along = sin_h * cos * self.sin + cos_h * self.w[2];
        let mut wo: [f64; 3] = std::array::from_fn(|k| 2.0 * along * half[k] - self.w[k]);
        wo[2] = wo[2].max(LEAST_MIRRORED);
        wo
    }

    /// The half vector between the given direction and `wo`, both not below the horizon.
    pub(crate) fn half(&self, wo: [f64; 3]) -> Half {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|k| self.w[k] + wo[k]);
        let level = x * x + y * y;
        let square = level + z * z;
        let length = square.sqrt();
        let t = level / square / (1.0 + z / length);
        let [ax, ay] = self.azimuth;
        let phi = (ax * y - ay * x).abs().atan2(ax * x + ay * y);
        Half { t: t.min(1.0), phi, along: 0.5 * length }
    }
}

/// Sine and cosine of the elevation at `t`.
fn sin_cos(t: f64) -> (f64, f64) {
    ((t * (2.0 - t)).max(0.0).sqrt(), 1.0 - t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn given(theta: f64, phi: f64) -> Given {
        Given::new([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]).unwrap()
    }

    proptest! {
        #[test]
        fn half_vectors_come_back(theta in 0.0..1.57, turn in -3.0..3.0, share in 0.0..1.0, v in 0.0..1.0) {
            let given = given(theta, turn);
            let t = share * given.t_max();
            let phi = v * given.phi_max(t);
            let wo = given.mirror(t, phi);
            prop_assert!(wo[2] > 0.0);
            let half = given.half(wo);
            prop_assert!((half.t - t).abs() < 1e-9, "{half:?}");
            // An azimuth says nothing on the normal.
            prop_assert!((half.phi - phi).abs() * t.sqrt() < 1e-6, "{half:?} {phi}");
        }

        #[test]
        fn the_last_azimuth_is_where_the_horizon_is(theta in 0.01..1.56, share in 0.0..1.0) {
            let given = given(theta, 0.4);
            let t = share * given.t_max();
            let phi_max = given.phi_max(t);
            prop_assume!(phi_max < PI);
            prop_assert!(given.mirror(t, phi_max)[2] < 1e-7);
            prop_assert!(given.mirror(t, phi_max * 0.99)[2] > LEAST_MIRRORED);
        }
    }

    #[test]
    fn ends_of_the_range() {
        let normal = given(0.0, 0.0);
        let forty_five = 1.0 - 0.5f64.sqrt();
        assert!((normal.t_max() - forty_five).abs() < 1e-15);
        assert_eq!((normal.phi_max(0.0), normal.phi_max(forty_five - 1e-9)), (PI, PI));
        assert_eq!(normal.phi_max(forty_five + 1e-9), 0.0);
        let low = given(FRAC_PI_2 - 1e-6, 0.0);
        assert!((low.t_max() - 1.0).abs() < 1e-6 && (low.phi_max(0.3) - FRAC_PI_2).abs() < 1e-5);
        assert!(Given::new([1.0, 0.0, 0.0]).is_none());
    }
}
