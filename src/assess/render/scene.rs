//! The two scenes of the study: one ball, and a still life of two materials.

use super::RADIUS;
use super::rays::{Hit, Ray, Scene};

/// The unit ball from +z without perspective, on black: material 0.
#[derive(Clone, Copy, Debug)]
pub struct Ball;

impl Scene for Ball {
    fn ray(&self, x: f64, y: f64) -> Ray {
        Ray { origin: [(2.0 * x - 1.0) / RADIUS, (1.0 - 2.0 * y) / RADIUS, 2.0], towards: [0.0, 0.0, -1.0] }
    }

    fn hit(&self, ray: &Ray) -> Option<Hit> {
        let normal = at(ray, sphere([0.0; 3], 1.0, ray)?);
        Some(Hit { position: normal, normal, material: 0 })
    }

    fn is_shaded(&self, _: &Ray) -> bool {
        false
    }

    fn shows_environment(&self) -> bool {
        false
    }

    fn subjects(&self) -> usize {
        1
    }
}

/// A ball (material 0) and a leaning ring (material 1) on a floor of light and dark squares (2 and 3), in the open.
/// The picture is five wide to three high.
#[derive(Clone, Copy, Debug)]
pub struct StillLife;

const BALL: [f64; 3] = [-1.12, 1.0, 0.0];
const RING: [f64; 3] = [1.18, 1.0, 0.0];
/// Axis of the ring; its lowest point touches the floor.
const AXIS: [f64; 3] = [-0.28, 0.48, 0.831_384_387_633_061_2];
const MAJOR: f64 = 0.76;
const MINOR: f64 = 0.333;
/// The floor ends here, measured from the middle.
const FLOOR: f64 = 40.0;
const EYE: [f64; 3] = [0.0, 1.9, 9.0];
/// Unit vectors right, up and forward of the camera, which looks slightly down.
const CAMERA: [[f64; 3]; 3] =
    [[1.0, 0.0, 0.0], [0.0, 0.994_366_129_753_020_1, -0.106], [0.0, -0.106, -0.994_366_129_753_020_1]];
/// Half the width of the picture at distance one.
const SPREAD: f64 = 0.32;

impl Scene for StillLife {
    fn ray(&self, x: f64, y: f64) -> Ray {
        let (x, y) = (SPREAD * (2.0 * x - 1.0), 0.6 * SPREAD * (1.0 - 2.0 * y));
        let length = (1.0 + x * x + y * y).sqrt();
        let [right, up, forward] = CAMERA;
        Ray { origin: EYE, towards: std::array::from_fn(|k| (forward[k] + x * right[k] + y * up[k]) / length) }
    }

    fn hit(&self, ray: &Ray) -> Option<Hit> {
        let ball = sphere(BALL, 1.0, ray).map(|t| (t, 0));
        let ring = ring(ray).map(|t| (t, 1));
        let floor = floor(ray).map(|t| (t, 2));
        let (t, what) = [ball, ring, floor].into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))?;
        let position = at(ray, t);
        let [x, y, z] = position;
        Some(match what {
            0 => Hit { position, normal: std::array::from_fn(|k| position[k] - BALL[k]), material: 0 },
            1 => Hit { position, normal: ring_normal(position), material: 1 },
            _ => {
                let dark = ((x / 0.8).floor() + (z / 0.8).floor()).rem_euclid(2.0) as usize;
                Hit { position: [x, y.max(0.0), z], normal: [0.0, 1.0, 0.0], material: 2 + dark }
            }
        })
    }

    fn is_shaded(&self, ray: &Ray) -> bool {
        // Light from below the horizon ends at the floor.
        ray.towards[1] < 0.0 || sphere(BALL, 1.0, ray).is_some() || ring(ray).is_some()
    }

    fn shows_environment(&self) -> bool {
        true
    }

    fn subjects(&self) -> usize {
        2
    }
}

fn at(ray: &Ray, t: f64) -> [f64; 3] {
    std::array::from_fn(|k| ray.origin[k] + t * ray.towards[k])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Distances at which a ray enters and leaves a sphere.
fn crossing(centre: [f64; 3], radius: f64, ray: &Ray) -> Option<[f64; 2]> {
    let from: [f64; 3] = std::array::from_fn(|k| ray.origin[k] - centre[k]);
    let b = dot(from, ray.towards);
    let root = b * b - dot(from, from) + radius * radius;
    (root >= 0.0).then(|| [-b - root.sqrt(), -b + root.sqrt()])
}

/// Distance along a ray from outside to a sphere.
fn sphere(centre: [f64; 3], radius: f64, ray: &Ray) -> Option<f64> {
    crossing(centre, radius, ray).map(|[t, _]| t).filter(|t| *t > 0.0)
}

/// Distance to the floor, as far as it goes.
fn floor(ray: &Ray) -> Option<f64> {
    let t = -ray.origin[1] / ray.towards[1];
    let [x, _, z] = at(ray, t);
    (t > 0.0 && x.hypot(z) < FLOOR).then_some(t)
}

/// Distance to the ring, by steps of the distance to its surface.
fn ring(ray: &Ray) -> Option<f64> {
    const NEAR: f64 = 1e-5;
    let [enter, leave] = crossing(RING, MAJOR + MINOR, ray)?;
    let mut t = enter.max(0.0);
    for _ in 0..200 {
        if t > leave {
            return None;
        }
        let distance = ring_distance(at(ray, t));
        if distance < NEAR {
            return Some(t);
        }
        t += distance;
    }
    None
}

/// Height over the plane of the ring and distance from its axis.
fn ring_coordinates(p: [f64; 3]) -> ([f64; 3], f64, f64) {
    let from: [f64; 3] = std::array::from_fn(|k| p[k] - RING[k]);
    let height = dot(from, AXIS);
    let across: [f64; 3] = std::array::from_fn(|k| from[k] - height * AXIS[k]);
    (across, height, dot(across, across).sqrt())
}

fn ring_distance(p: [f64; 3]) -> f64 {
    let (_, height, r) = ring_coordinates(p);
    (r - MAJOR).hypot(height) - MINOR
}

fn ring_normal(p: [f64; 3]) -> [f64; 3] {
    let (across, height, r) = ring_coordinates(p);
    let normal: [f64; 3] = std::array::from_fn(|k| across[k] * (1.0 - MAJOR / r) + height * AXIS[k]);
    let length = dot(normal, normal).sqrt();
    normal.map(|c| c / length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assess::render::rays::subject_mask;

    #[test]
    fn constants_are_unit_vectors_and_the_ring_stands_on_the_floor() {
        for v in [AXIS, CAMERA[0], CAMERA[1], CAMERA[2]] {
            assert!((dot(v, v) - 1.0).abs() < 1e-14, "{v:?}");
        }
        assert!(dot(CAMERA[1], CAMERA[2]).abs() < 1e-9);
        let lowest = RING[1] - MAJOR * (1.0 - AXIS[1] * AXIS[1]).sqrt() - MINOR;
        assert!(lowest.abs() < 2e-3, "{lowest}");
    }

    #[test]
    fn normals_point_to_the_viewer_and_what_touches_the_floor_is_seen() {
        let mut seen = [0; 4];
        for i in 0..50 * 30 {
            let ray = StillLife.ray((0.5 + (i % 50) as f64) / 50.0, (0.5 + (i / 50) as f64) / 30.0);
            if let Some(hit) = StillLife.hit(&ray) {
                seen[hit.material] += 1;
                assert!((dot(hit.normal, hit.normal) - 1.0).abs() < 1e-9);
                assert!(dot(hit.normal, ray.towards) < 1e-2 && hit.position[1] > -1e-3, "{hit:?}");
            }
        }
        assert!(seen.iter().all(|n| *n > 50), "{seen:?}");
        let mask = subject_mask(&StillLife, 50, 30);
        assert_eq!(mask.iter().filter(|m| **m).count(), seen[0] + seen[1]);
        let from_the_shade = Ray { origin: [BALL[0] + 0.5, 0.0, 0.0], towards: [0.0, 1.0, 0.0] };
        assert!(StillLife.is_shaded(&from_the_shade));
    }
}
