//! Direct light from an environment on what a scene shows, by sampling.
//!
//! Each of a pixel's samples looks through another point of it and takes two directions there: one drawn from the
//! environment by luminance, one mirrored in a half vector near the normal. Both are weighted by the balance heuristic
//! (Veach 1995). The numbers come from a seed and the pixel alone: two materials are seen by the same samples,
//! so that the difference of their pictures is that of the materials and not noise.

use std::f64::consts::TAU;

use rayon::prelude::*;

use super::environment::Environment;
use super::half;
use super::picture::Image;
use crate::codec::sample::SplitMix64;

/// A half line.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts.
    pub origin: [f64; 3],
    /// Unit direction.
    pub towards: [f64; 3],
}

/// Where a ray meets a surface.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    /// The point.
    pub position: [f64; 3],
    /// Unit normal, outwards.
    pub normal: [f64; 3],
    /// Which of the materials is there.
    pub material: usize,
}

/// What is in the picture. Frame: x right, y up, z towards the viewer.
pub trait Scene: Sync {
    /// The ray through a point of the picture: 0 to 1 from the left and from the top.
    fn ray(&self, x: f64, y: f64) -> Ray;
    /// The first surface along a ray.
    fn hit(&self, ray: &Ray) -> Option<Hit>;
    /// Whether something stands between a point and the environment.
    fn is_shaded(&self, ray: &Ray) -> bool;
    /// Whether the environment is seen where nothing else is; black if not.
    fn shows_environment(&self) -> bool;
    /// Number of the materials that are to be looked at; those after them are the stage.
    fn subjects(&self) -> usize;
}

/// A BRDF in 1/sr of directions in the frame of the surface, z along the normal; must not depend on x and y alone.
pub type Material<'a> = &'a (dyn Fn([f64; 3], [f64; 3]) -> [f32; 3] + Sync);

/// Size and effort of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quality {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Samples a pixel, of two directions each.
    pub samples: usize,
    /// Seed of the samples.
    pub seed: u64,
}

/// Renders a scene; `materials` by the numbers in [`Hit`]. The same arguments give the same picture.
///
/// # Panics
/// If a hit names a material that is not there.
pub fn render(scene: &impl Scene, materials: &[Material], environment: &Environment, quality: &Quality) -> Image {
    let &Quality { width, height, samples, seed } = quality;
    let pixel = |i: usize| -> [f32; 3] {
        let mut random = SplitMix64(seed ^ (i as u64).wrapping_mul(0xD129_0B26_9C8B_8C2D));
        let shift: [f64; 6] = std::array::from_fn(|_| (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64);
        let mut sum = [0.0; 3];
        for k in 0..samples {
            let [x, y, a, b] = point(k);
            let at = |k: usize, value: f64| (shift[k] + value).fract();
            let ray = scene
                .ray(((i % width) as f64 + at(0, x)) / width as f64, ((i / width) as f64 + at(1, y)) / height as f64);
            let light = match scene.hit(&ray) {
                Some(hit) => {
                    let draws = [[at(2, a), at(3, b)], [at(4, a), at(5, b)]];
                    reflected(scene, materials[hit.material], environment, &ray, &hit, draws)
                }
                None if scene.shows_environment() => environment.radiance(ray.towards),
                None => [0.0; 3],
            };
            for (sum, light) in sum.iter_mut().zip(light) {
                *sum += light;
            }
        }
        sum.map(|c| (c / samples.max(1) as f64) as f32)
    };
    let mut rgb = vec![0.0; width * height * 3];
    if width > 0 {
        rgb.par_chunks_mut(3 * width).enumerate().for_each(|(y, row)| {
            for (x, out) in row.chunks_exact_mut(3).enumerate() {
                out.copy_from_slice(&pixel(y * width + x));
            }
        });
    }
    Image { width, height, rgb }
}

/// The pixels in whose middle a subject of the scene is seen.
pub fn subject_mask(scene: &impl Scene, width: usize, height: usize) -> Vec<bool> {
    let seen = |i: usize| {
        let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        scene.hit(&scene.ray(x / width as f64, y / height as f64)).is_some_and(|hit| hit.material < scene.subjects())
    };
    (0..width * height).map(seen).collect()
}

/// An estimate of the light that a surface sends back along a ray.
fn reflected(
    scene: &impl Scene,
    material: Material,
    environment: &Environment,
    ray: &Ray,
    hit: &Hit,
    draws: [[f64; 2]; 2],
) -> [f64; 3] {
    let frame = frame(hit.normal);
    let wo = frame.map(|axis| -dot(axis, ray.towards));
    let mut sum = [0.0; 3];
    if wo[2] <= 0.0 {
        return sum;
    }
    let mut add = |wi: [f64; 3], towards: [f64; 3], radiance: [f64; 3], density: f64| {
        let origin = std::array::from_fn(|k| hit.position[k] + 1e-4 * hit.normal[k]);
        if wi[2] > 0.0 && density > 0.0 && !scene.is_shaded(&Ray { origin, towards }) {
            let brdf = material(wi, wo);
            for k in 0..3 {
                sum[k] += f64::from(brdf[k]) * radiance[k] * wi[2] / density;
            }
        }
    };
    let drawn = environment.draw(draws[0]);
    let wi = frame.map(|axis| dot(axis, drawn.towards));
    if wi[2] > 0.0 {
        add(wi, drawn.towards, drawn.radiance, drawn.density + half::density_of(wi, wo));
    }
    // Zero would be the normal itself, where the density is infinite.
    let vector = half::vector(draws[1][0].max(1e-6), TAU * draws[1][1]);
    let (wi, along) = half::reflect(vector, wo);
    if wi[2] > 0.0 && along > 0.0 {
        let towards: [f64; 3] = std::array::from_fn(|k| (0..3).map(|j| frame[j][k] * wi[j]).sum());
        let density = environment.density(towards) + half::density(vector, along);
        add(wi, towards, environment.radiance(towards), density);
    }
    sum
}

/// Point `k` of a four-dimensional additive sequence of low discrepancy (Roberts 2018): powers of the root of
/// `x^5 = x + 1`.
fn point(k: usize) -> [f64; 4] {
    const STEP: f64 = 1.0 / 1.167_303_978_261_418_7;
    let step = |power: i32| (k as f64 * STEP.powi(power)).fract();
    [step(1), step(2), step(3), step(4)]
}

/// Two tangents and the normal.
fn frame(normal: [f64; 3]) -> [[f64; 3]; 3] {
    // Duff et al., "Building an Orthonormal Basis, Revisited" (2017).
    let [x, y, z] = normal;
    let sign = 1f64.copysign(z);
    let a = -1.0 / (sign + z);
    let b = x * y * a;
    [[1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y], normal]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assess::render::picture::{difference, psnr_over};
    use crate::assess::render::scene::{Ball, StillLife};
    use crate::assess::render::texels::Texels;
    use crate::table::synth::Recipe;
    use std::f64::consts::PI;

    const SMALL: Quality = Quality { width: 24, height: 24, samples: 64, seed: 3 };

    fn white() -> Environment {
        Environment::new(8, 4, vec![[1.0; 3]; 32]).unwrap()
    }

    #[test]
    fn a_lambertian_ball_in_a_white_room_shows_its_albedo() {
        let albedo = [0.7f32, 0.4, 0.1];
        let material = move |_: [f64; 3], _: [f64; 3]| albedo.map(|a| a / PI as f32);
        let image = render(&Ball, &[&material], &white(), &SMALL);
        let mask = subject_mask(&Ball, 24, 24);
        // Pixels wholly on the ball.
        let inside = |i: usize| mask[i] && [i - 1, i + 1, i - 24, i + 24].iter().all(|&j| mask[j]);
        let pixels: Vec<_> = image.rgb.chunks_exact(3).enumerate().filter(|(i, _)| inside(*i)).collect();
        for (k, expected) in albedo.iter().enumerate() {
            let mean = pixels.iter().map(|(_, p)| f64::from(p[k])).sum::<f64>() / pixels.len() as f64;
            assert!((mean / f64::from(*expected) - 1.0).abs() < 0.01, "{mean} {expected}");
            assert!(pixels.iter().all(|(_, p)| (p[k] / expected - 1.0).abs() < 0.25));
        }
    }

    #[test]
    fn both_ways_of_drawing_agree_with_a_dense_sum() {
        // A narrow lobe under the built-in lights: half vectors carry the lobe, the map carries the lights.
        let texels = Texels::new(&Recipe::named("pearl").unwrap().merl().unwrap());
        let environment = Environment::built_in();
        let ray = Ball.ray(0.36, 0.38);
        let hit = Ball.hit(&ray).unwrap();
        let frame = frame(hit.normal);
        let wo = frame.map(|axis| -dot(axis, ray.towards));
        let n = 1_000_000;
        let direct: f64 = crate::assess::render::light::whole_sphere(n)
            .map(|w| (frame.map(|axis| dot(axis, w)), w))
            .filter(|(wi, _)| wi[2] > 0.0)
            .map(|(wi, w)| f64::from(texels.eval(wi, wo)[1]) * environment.radiance(w)[1] * wi[2])
            .sum::<f64>()
            * 4.0
            * PI
            / n as f64;
        let n = 20_000;
        let material: Material = &|wi, wo| texels.eval(wi, wo);
        let sampled: f64 = (0..n)
            .map(|k| {
                let [a, b, c, d] = point(k);
                reflected(&Ball, material, &environment, &ray, &hit, [[a, b], [c, d]])[1]
            })
            .sum::<f64>()
            / n as f64;
        assert!((sampled / direct - 1.0).abs() < 0.01, "{sampled} {direct}");
    }

    #[test]
    fn equal_materials_give_equal_pictures() {
        let texels = Texels::new(&Recipe::named("satin-paint").unwrap().merl().unwrap());
        let environment = Environment::built_in();
        let material: Material = &|wi, wo| texels.eval(wi, wo);
        let grey: Material = &|_, _| [0.1; 3];
        let materials = [material, grey, grey, grey];
        let quality = Quality { width: 30, height: 18, samples: 4, seed: 1 };
        let image = render(&StillLife, &materials, &environment, &quality);
        let again = render(&StillLife, &materials, &environment, &quality);
        assert_eq!(image, again);
        let mask = subject_mask(&StillLife, 30, 18);
        assert_eq!(psnr_over(&image, &again, 1.0, &mask).unwrap(), f64::INFINITY);
        assert!(difference(&image, &again, 1.0).unwrap().iter().all(|v| *v == 0));
        let other = render(&StillLife, &materials, &environment, &Quality { seed: 2, ..quality });
        assert_ne!(image, other);
        assert!(render(&Ball, &[grey], &environment, &Quality { width: 0, ..quality }).rgb.is_empty());
    }
}
