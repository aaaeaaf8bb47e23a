//! The environment of the pictures: a sky over a floor, a softbox and a warm strip light.
//!
//! Directions are in the frame of the picture: x right, y up, z towards the viewer. Radiance is in arbitrary units.

use std::f64::consts::TAU;

/// Step of the golden-angle spiral, radians.
pub(super) const GOLDEN_TURN: f64 = 2.399963229728653;

/// A rectangular area light at infinity.
pub(super) struct Light {
    /// Unit vectors to the right and up across the light, and towards its middle.
    frame: [[f64; 3]; 3],
    /// Half width and half height, as tangents of the angle from the middle.
    half_size: [f64; 2],
    /// Radiance away from the soft edge.
    radiance: [f64; 3],
    /// Directions across and down.
    samples: [usize; 2],
}

/// A bright softbox from the upper left and a warm strip from the right.
pub(super) const LIGHTS: [Light; 2] = [
    Light {
        frame: [[0.8, 0.0, 0.6], [0.36, 0.8, -0.48], [-0.48, 0.6, 0.64]],
        half_size: [0.24, 0.24],
        radiance: [11.0, 10.5, 9.5],
        samples: [7, 7],
    },
    Light {
        frame: [
            [5.0 / 13.0, 0.0, -12.0 / 13.0],
            [-0.28 * 12.0 / 13.0, 0.96, -0.28 * 5.0 / 13.0],
            [0.96 * 12.0 / 13.0, 0.28, 0.96 * 5.0 / 13.0],
        ],
        half_size: [0.14, 0.45],
        radiance: [4.6, 2.5, 1.1],
        samples: [3, 9],
    },
];

impl Light {
    /// Position on the light's plane over its half size (-1 to 1 inside) and the squared length of that position
    /// from the middle; `None` more than a right angle away.
    fn position(&self, w: [f64; 3]) -> Option<([f64; 2], f64)> {
        let [x, y, depth] = self.frame.map(|a| a[0] * w[0] + a[1] * w[1] + a[2] * w[2]);
        if depth <= 0.0 {
            return None;
        }
        let (x, y) = (x / depth, y / depth);
        Some(([x / self.half_size[0], y / self.half_size[1]], x * x + y * y))
    }

    /// Unit directions on a regular grid over the light.
    pub(super) fn samples(&self) -> impl Iterator<Item = [f64; 3]> {
        let [columns, rows] = self.samples;
        let [right, up, towards] = self.frame;
        (0..columns * rows).map(move |i| {
            let at = |i: usize, n: usize| 2.0 * (i as f64 + 0.5) / n as f64 - 1.0;
            let x = self.half_size[0] * at(i % columns, columns);
            let y = self.half_size[1] * at(i / columns, rows);
            let length = (1.0 + x * x + y * y).sqrt();
            std::array::from_fn(|k| (towards[k] + x * right[k] + y * up[k]) / length)
        })
    }

    /// Directions per sr of [`Light::samples`] around the direction `w`.
    pub(super) fn density(&self, w: [f64; 3]) -> f64 {
        match self.position(w) {
            Some(([x, y], squared)) if x.abs() <= 1.0 && y.abs() <= 1.0 => {
                let count = (self.samples[0] * self.samples[1]) as f64;
                // Area on the plane at distance one over solid angle.
                count * (1.0 + squared) * (1.0 + squared).sqrt() / (4.0 * self.half_size[0] * self.half_size[1])
            }
            _ => 0.0,
        }
    }

    /// Share of the radiance at `w`: 1 inside, falling to 0 at the edge.
    fn brightness(&self, w: [f64; 3]) -> f64 {
        self.position(w).map_or(0.0, |([x, y], _)| {
            let edge = |x: f64| smoothstep((1.0 - x.abs()) / 0.2);
            edge(x) * edge(y)
        })
    }
}

/// Radiance that arrives from the unit direction `w`: red, green, blue.
pub fn radiance(w: [f64; 3]) -> [f64; 3] {
    const ZENITH: [f64; 3] = [0.16, 0.27, 0.50];
    const HORIZON: [f64; 3] = [0.72, 0.76, 0.80];
    const FLOOR: [f64; 3] = [0.13, 0.11, 0.09];
    let height = w[1].clamp(-1.0, 1.0);
    let sky = height.max(0.0).sqrt();
    let above = smoothstep((height + 0.12) / 0.24);
    let mut sum: [f64; 3] = std::array::from_fn(|k| {
        let sky = HORIZON[k] + (ZENITH[k] - HORIZON[k]) * sky;
        FLOOR[k] + (sky - FLOOR[k]) * above
    });
    for light in &LIGHTS {
        let brightness = light.brightness(w);
        for (sum, radiance) in sum.iter_mut().zip(light.radiance) {
            *sum += brightness * radiance;
        }
    }
    sum
}

/// `n` directions spread evenly over the sphere (Fibonacci spiral).
pub(super) fn whole_sphere(n: usize) -> impl Iterator<Item = [f64; 3]> {
    (0..n).map(move |i| {
        let y = 1.0 - 2.0 * (i as f64 + 0.5) / n as f64;
        let (sin, cos) = (GOLDEN_TURN * i as f64 % TAU).sin_cos();
        let r = (1.0 - y * y).sqrt();
        [r * cos, y, r * sin]
    })
}

fn smoothstep(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn densities_are_those_of_the_samples() {
        for light in &LIGHTS {
            for (i, j) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
                let dot: f64 = (0..3).map(|k| light.frame[i][k] * light.frame[j][k]).sum();
                assert!((dot - f64::from(u8::from(i == j))).abs() < 1e-12);
            }
            // One over the density, summed, is the solid angle; so is the share of a dense set over the sphere inside.
            let angle: f64 = light.samples().map(|w| 1.0 / light.density(w)).sum();
            let n = 200_000;
            let inside = whole_sphere(n).filter(|w| light.density(*w) > 0.0).count();
            assert!((angle / (inside as f64 * 4.0 * PI / n as f64) - 1.0).abs() < 0.01);
        }
    }

    #[test]
    fn light_comes_from_the_lights_the_sky_and_little_from_the_floor() {
        let red = |w| radiance(w)[0];
        assert!(red(LIGHTS[0].frame[2]) > 10.0 && red(LIGHTS[1].frame[2]) > 4.0);
        assert!(red([0.0, 0.3, -0.95]) > red([0.0, -1.0, 0.0]) && red([0.0, -1.0, 0.0]) > 0.0);
    }
}
