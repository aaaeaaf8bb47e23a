//! Small deterministic renderers for pictures of materials and for render PSNR.
//!
//! [`rays`] renders scenes under any environment map by sampling. What follows is the quick one, for `compare`:
//! a sphere of unit radius, seen from +z without perspective, under a fixed environment ([`light`]). Direct light only.
//! Every pixel sums the same few hundred directions: some over the whole sphere for the sky, more over the two area
//! lights, and the mirror images of the viewer in a fixed set of half vectors, dense around the normal as the bins of
//! theta_h are, so that a narrow lobe sees a smooth environment. All are one quadrature: a direction weighs one over
//! the summed density of the four sets (balance heuristic, Veach 1995). Nothing is random.

pub mod environment;
mod half;
pub mod light;
mod pending;
pub mod picture;
pub mod rays;
pub mod scene;
pub mod texels;

use std::f64::consts::PI;

use rayon::prelude::*;

use crate::table::Table;
use light::{GOLDEN_TURN, LIGHTS};
use pending::Pending;
pub use picture::{Image, channel_psnr, difference, psnr, write_png};
pub use texels::Texels;

/// Radius of the sphere over half the width of the picture.
pub const RADIUS: f64 = 0.95;

/// Directions over the whole sphere, for the sky.
const SKY_SAMPLES: usize = 128;
/// Half vectors around the normal, for narrow lobes.
const HALF_SAMPLES: usize = 112;
/// Pixels that are worked on together.
const BATCH: usize = 1 << 14;

/// Renders the sphere on `size` x `size` pixels.
///
/// `eval(wi, wo)` is the BRDF in 1/sr (red, green, blue) for unit directions above the horizon, in a frame whose z is
/// the normal and whose x runs level along the sphere; isotropic BRDFs do not depend on the latter.
pub fn render_sphere(size: usize, eval: impl Fn([f64; 3], [f64; 3]) -> [f32; 3] + Sync) -> Image {
    let [image] = render_spheres(size, |wi, wo, out| {
        for ((wi, wo), out) in wi.iter().zip(wo).zip(out) {
            *out = [eval(*wi, *wo)];
        }
    });
    image
}

/// As [`render_sphere`], of several materials and pairs of directions at once: what they share is computed once.
fn render_spheres<const N: usize>(
    size: usize,
    eval: impl Fn(&[[f64; 3]], &[[f64; 3]], &mut [[[f32; 3]; N]]) + Sync,
) -> [Image; N] {
    let quadrature = Quadrature::new(light::radiance);
    let batches: Vec<Vec<Point<N>>> = (0..size * size)
        .into_par_iter()
        .step_by(BATCH)
        .map(|start| {
            let pixels = start..(start + BATCH).min(size * size);
            let mut points: Vec<Point<N>> = pixels.filter_map(|pixel| Point::new(pixel, size)).collect();
            quadrature.reflect(&mut points, &eval, light::radiance);
            points
        })
        .collect();
    std::array::from_fn(|n| {
        let mut rgb = vec![0.0; size * size * 3];
        for point in batches.iter().flatten() {
            for k in 0..3 {
                rgb[3 * point.pixel + k] = (point.sums[n][k] * point.coverage) as f32;
            }
        }
        Image { width: size, height: size, rgb }
    })
}

/// Renders the sphere with the values of a table, interpolated linearly.
///
/// Missing entries, other grids and other channels: as [`Texels`].
pub fn sphere_of_table(table: &Table, size: usize) -> Image {
    let texels = Texels::new(table);
    let [image] = render_spheres(size, |wi, wo, out| {
        texels.each_taps(wi, wo, |i, taps| out[i] = [texels.mix(taps)]);
    });
    image
}

/// As [`sphere_of_table`] of two tables, in less time where they have the same axes.
pub fn spheres_of_tables(a: &Table, b: &Table, size: usize) -> [Image; 2] {
    if a.grid().axes() != b.grid().axes() {
        return [sphere_of_table(a, size), sphere_of_table(b, size)];
    }
    let texels = [Texels::new(a), Texels::new(b)];
    render_spheres(size, |wi, wo, out| {
        texels[0].each_taps(wi, wo, |i, taps| out[i] = texels.each_ref().map(|texels| texels.mix(taps)));
    })
}

/// The directions that every pixel sums.
struct Quadrature {
    /// Towards the sky and the lights.
    fixed: Vec<Fixed>,
    /// Half vectors in the frame of the surface.
    half: Vec<[f64; 3]>,
}

/// A direction that is the same for all pixels.
struct Fixed {
    /// In the frame of the picture.
    towards: [f64; 3],
    /// What arrives from there.
    radiance: [f64; 3],
    /// Density of the sky's and the lights' sets there, per sr.
    density: f64,
}

impl Quadrature {
    fn new(radiance: impl Fn([f64; 3]) -> [f64; 3]) -> Quadrature {
        let sky = light::whole_sphere(SKY_SAMPLES);
        let lights = LIGHTS.iter().flat_map(|l| l.samples());
        let fixed =
            sky.chain(lights).map(|w| Fixed { towards: w, radiance: radiance(w), density: fixed_density(w) }).collect();
        let half = (0..HALF_SAMPLES)
            .map(|i| half::vector((i as f64 + 0.5) / HALF_SAMPLES as f64, GOLDEN_TURN * i as f64))
            .collect();
        Quadrature { fixed, half }
    }

    /// Adds to the sum of each point the light that it reflects towards the viewer; `radiance` as in
    /// [`Quadrature::new`].
    ///
    /// All points take a direction before any takes the next: a direction's theta_d, or a half vector's theta_h, is
    /// the same for all, so that the lookups in a table stay in one slice of it.
    fn reflect<const N: usize>(
        &self,
        points: &mut [Point<N>],
        eval: &impl Fn(&[[f64; 3]], &[[f64; 3]], &mut [[[f32; 3]; N]]),
        radiance: impl Fn([f64; 3]) -> [f64; 3],
    ) {
        let mut pending = Pending::new();
        for fixed in &self.fixed {
            for index in 0..points.len() {
                let point = &points[index];
                let wi = point.frame.map(|axis| dot(axis, fixed.towards));
                if wi[2] > 0.0 {
                    let density = fixed.density + HALF_SAMPLES as f64 * half::density_of(wi, point.wo);
                    pending.add(index, wi, fixed.radiance, wi[2] / density, points, eval);
                }
            }
            pending.settle(points, eval);
        }
        for &half in &self.half {
            for index in 0..points.len() {
                let point = &points[index];
                let (wi, along) = half::reflect(half, point.wo);
                if along > 0.0 && wi[2] > 0.0 {
                    let towards = std::array::from_fn(|k| (0..3).map(|j| point.frame[j][k] * wi[j]).sum());
                    let density = fixed_density(towards) + HALF_SAMPLES as f64 * half::density(half, along);
                    pending.add(index, wi, radiance(towards), wi[2] / density, points, eval);
                }
            }
            pending.settle(points, eval);
        }
    }
}

/// One pixel's point of the sphere.
struct Point<const N: usize> {
    pixel: usize,
    /// Share of the pixel that the sphere covers.
    coverage: f64,
    /// Tangent (level), bi-tangent and normal in the frame of the picture.
    frame: [[f64; 3]; 3],
    /// Towards the viewer, in the frame of the surface.
    wo: [f64; 3],
    /// Radiance towards the viewer, by material.
    sums: [[f64; 3]; N],
}

impl<const N: usize> Point<N> {
    /// The point under the middle of a pixel (row-major index); `None` off the sphere.
    fn new(pixel: usize, size: usize) -> Option<Point<N>> {
        let across = |i: usize| (2.0 * (i as f64 + 0.5) / size as f64 - 1.0) / RADIUS;
        let (x, y) = (across(pixel % size), -across(pixel / size));
        let r = x.hypot(y);
        // The rim is blended into the black background over one pixel.
        let coverage = ((1.0 - r) * RADIUS * size as f64 / 2.0 + 0.5).clamp(0.0, 1.0);
        let shrink = if r > 0.999 { 0.999 / r } else { 1.0 };
        let (x, y) = (x * shrink, y * shrink);
        (coverage > 0.0).then(|| Point::with_normal(pixel, coverage, [x, y, (1.0 - x * x - y * y).sqrt()]))
    }

    fn with_normal(pixel: usize, coverage: f64, normal: [f64; 3]) -> Point<N> {
        let [x, y, z] = normal;
        // Never zero: the normal leans towards the viewer.
        let level = x.hypot(z);
        let frame = [[z / level, 0.0, -x / level], [-x * y / level, level, -y * z / level], normal];
        Point { pixel, coverage, frame, wo: frame.map(|axis| axis[2]), sums: [[0.0; 3]; N] }
    }

    fn add(&mut self, brdfs: [[f32; 3]; N], radiance: [f64; 3], weight: f64) {
        for (sum, brdf) in self.sums.iter_mut().zip(brdfs) {
            for k in 0..3 {
                sum[k] += f64::from(brdf[k]) * radiance[k] * weight;
            }
        }
    }
}

/// Directions per sr of the sky's and the lights' sets.
fn fixed_density(towards: [f64; 3]) -> f64 {
    SKY_SAMPLES as f64 / (4.0 * PI) + LIGHTS.iter().map(|l| l.density(towards)).sum::<f64>()
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::grid::{Axis, AxisName, Grid, Mapping};
    use crate::table::synth::Recipe;

    fn white(_: [f64; 3]) -> [f64; 3] {
        [1.0; 3]
    }

    #[test]
    fn a_white_surface_in_a_white_room_is_white() {
        let quadrature = Quadrature::new(white);
        for normal in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.48, 0.64, 0.6], [0.0, -0.954, 0.3]] {
            let mut points = [Point::with_normal(0, 1.0, normal)];
            quadrature.reflect(&mut points, &|_, _, out| out.fill([[1.0 / PI as f32; 3]]), white);
            let [out] = points[0].sums;
            assert!((out[0] - 1.0).abs() < 0.03, "{normal:?} {out:?}");
        }
    }

    #[test]
    fn pictures_are_of_the_table_and_repeat() {
        let table = Recipe::named("satin-paint").unwrap().merl().unwrap();
        let image = sphere_of_table(&table, 24);
        // One pair of directions at a time.
        let texels = Texels::new(&table);
        assert_eq!(image, render_sphere(24, |wi, wo| texels.eval(wi, wo)));
        // Two at once are the same pictures.
        let other = Recipe { holes: 0.1, ..Recipe::named("pearl").unwrap() }.merl().unwrap();
        assert_eq!(spheres_of_tables(&table, &other, 24), [&table, &other].map(|table| sphere_of_table(table, 24)));
        let finer = Recipe::named("matte").unwrap().synthesise(&Grid::merl_360()).unwrap();
        assert_eq!(spheres_of_tables(&table, &finer, 8), [&table, &finer].map(|table| sphere_of_table(table, 8)));
        assert!(image.rgb.iter().all(|v| v.is_finite() && *v >= 0.0));
        // Red paint, lit all over its face, on black.
        let centre = &image.rgb[(12 * 24 + 12) * 3..][..3];
        assert!(centre[0] > 3.0 * centre[2] && centre[2] > 0.0, "{centre:?}");
        assert_eq!(image.rgb[..3], [0.0; 3]);
    }

    #[test]
    fn holes_are_bridged_and_unknown_axes_black() {
        let satin = Recipe::named("satin-paint").unwrap();
        let whole = sphere_of_table(&satin.merl().unwrap(), 24);
        let holed = Recipe { holes: 0.02, ..satin }.merl().unwrap();
        assert!(psnr(&whole, &sphere_of_table(&holed, 24)).unwrap() > 30.0);
        let axis = Axis { name: AxisName::Other, len: 4, mapping: Mapping::Linear, start: 0.0, end: 1.0 };
        let grid = Grid::new(vec![axis], Grid::rgb_channels([1.0; 3])).unwrap();
        let table = Table::from_values(grid, vec![1.0; 12]).unwrap();
        assert!(sphere_of_table(&table, 8).rgb.iter().all(|v| *v == 0.0));
        assert!(sphere_of_table(&table, 0).rgb.is_empty());
    }
}
