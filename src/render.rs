//! A small deterministic renderer for pictures of materials and for render PSNR.
//!
//! A sphere of unit radius, seen from +z without perspective, under a fixed environment ([`light`]). Direct light only.
//! Every pixel sums the same few hundred directions: some over the whole sphere for the sky, more over the two area
//! lights, and the mirror images of the viewer in a fixed set of half vectors, dense around the normal as the bins of
//! theta_h are, so that a narrow lobe sees a smooth environment. All are one quadrature: a direction weighs one over
//! the summed density of the four sets (balance heuristic, Veach 1995). Nothing is random.

pub mod light;
pub mod picture;

use std::f64::consts::PI;

use crate::coords::{Lookup, grid_coordinates, taps};
use crate::grid::Grid;
use crate::table::BrdfTable;
use light::{GOLDEN_TURN, LIGHTS};
pub use picture::{Image, channel_psnr, difference, psnr, write_png};

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
pub fn render_sphere(size: usize, eval: impl Fn([f64; 3], [f64; 3]) -> [f32; 3]) -> Image {
    let quadrature = Quadrature::new(light::radiance);
    let mut rgb = vec![0.0; size * size * 3];
    let mut points: Vec<Point> = Vec::with_capacity(BATCH);
    for start in (0..size * size).step_by(BATCH) {
        let pixels = start..(start + BATCH).min(size * size);
        points.clear();
        points.extend(pixels.filter_map(|pixel| Point::new(pixel, size)));
        quadrature.reflect(&mut points, &eval, light::radiance);
        for point in &points {
            for k in 0..3 {
                rgb[3 * point.pixel + k] = (point.sum[k] * point.coverage) as f32;
            }
        }
    }
    Image { width: size, height: size, rgb }
}

/// Renders the sphere with the values of a table, interpolated linearly.
///
/// Missing entries are left out of the interpolation and the weights of the others raised; where all are missing, and
/// on grids whose axes [`grid_coordinates`] does not know, nothing is reflected. Channels named R, G, B give the
/// colours; of others those nearest to 610, 550 and 465 nm, or else the first, the middle and the last.
pub fn sphere_of_table(table: &BrdfTable, size: usize) -> Image {
    let grid = table.grid();
    let channels = colour_channels(grid);
    // One copy with the colours side by side: a lookup touches a third of the memory. NaN marks missing entries.
    let texels: Vec<[f32; 3]> = (0..grid.positions())
        .map(|p| {
            channels.map(|c| {
                let value = (table.plane(c)[p] * grid.channels()[c].scale) as f32;
                if table.valid_plane(c)[p] { value.min(f32::MAX) } else { f32::NAN }
            })
        })
        .collect();
    render_sphere(size, |wi, wo| {
        let Some(coordinates) = grid_coordinates(grid, wi, wo) else { return [0.0; 3] };
        let (mut sums, mut weights) = ([0.0; 3], [0.0; 3]);
        for &(position, weight) in taps(grid, coordinates, Lookup::Linear).as_slice() {
            for k in 0..3 {
                let value = texels[position][k];
                if !value.is_nan() {
                    sums[k] += weight * f64::from(value);
                    weights[k] += weight;
                }
            }
        }
        std::array::from_fn(|k| if weights[k] > 0.0 { (sums[k] / weights[k]) as f32 } else { 0.0 })
    })
}

/// The channels shown as red, green and blue.
fn colour_channels(grid: &Grid) -> [usize; 3] {
    let channels = grid.channels();
    let named = ["R", "G", "B"].map(|name| channels.iter().position(|c| c.name == name));
    if let [Some(r), Some(g), Some(b)] = named {
        return [r, g, b];
    }
    if channels.iter().all(|c| c.wavelength.is_some()) {
        return [610.0, 550.0, 465.0].map(|target: f64| {
            let away = |c: usize| channels[c].wavelength.map_or(f64::INFINITY, |w| (w - target).abs());
            (0..channels.len()).min_by(|a, b| away(*a).total_cmp(&away(*b))).unwrap_or(0)
        });
    }
    let last = channels.len() - 1;
    [0, last / 2, last]
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
            .map(|i| {
                let u = (i as f64 + 0.5) / HALF_SAMPLES as f64;
                let (sin, cos) = (u * u, (1.0 - u * u * u * u).sqrt());
                let (sin_phi, cos_phi) = (GOLDEN_TURN * i as f64).sin_cos();
                [sin * cos_phi, sin * sin_phi, cos]
            })
            .collect();
        Quadrature { fixed, half }
    }

    /// Adds to the sum of each point the light that it reflects towards the viewer; `radiance` as in
    /// [`Quadrature::new`].
    ///
    /// All points take a direction before any takes the next: a direction's theta_d, or a half vector's theta_h, is
    /// the same for all, so that the lookups in a table stay in one slice of it.
    fn reflect(
        &self,
        points: &mut [Point],
        eval: &impl Fn([f64; 3], [f64; 3]) -> [f32; 3],
        radiance: impl Fn([f64; 3]) -> [f64; 3],
    ) {
        for fixed in &self.fixed {
            for point in points.iter_mut() {
                let wi = point.frame.map(|axis| dot(axis, fixed.towards));
                if wi[2] > 0.0 {
                    let half: [f64; 3] = std::array::from_fn(|k| wi[k] + point.wo[k]);
                    let length = dot(half, half).sqrt();
                    let half = half.map(|c| c / length);
                    let density = fixed.density + half_density(half, dot(half, point.wo));
                    point.add(eval(wi, point.wo), fixed.radiance, wi[2] / density);
                }
            }
        }
        for &half in &self.half {
            for point in points.iter_mut() {
                let along = dot(half, point.wo);
                let wi: [f64; 3] = std::array::from_fn(|k| 2.0 * along * half[k] - point.wo[k]);
                if along > 0.0 && wi[2] > 0.0 {
                    let towards = std::array::from_fn(|k| (0..3).map(|j| point.frame[j][k] * wi[j]).sum());
                    let density = fixed_density(towards) + half_density(half, along);
                    point.add(eval(wi, point.wo), radiance(towards), wi[2] / density);
                }
            }
        }
    }
}

/// One pixel's point of the sphere.
struct Point {
    pixel: usize,
    /// Share of the pixel that the sphere covers.
    coverage: f64,
    /// Tangent (level), bi-tangent and normal in the frame of the picture.
    frame: [[f64; 3]; 3],
    /// Towards the viewer, in the frame of the surface.
    wo: [f64; 3],
    /// Radiance towards the viewer.
    sum: [f64; 3],
}

impl Point {
    /// The point under the middle of a pixel (row-major index); `None` off the sphere.
    fn new(pixel: usize, size: usize) -> Option<Point> {
        let across = |i: usize| (2.0 * (i as f64 + 0.5) / size as f64 - 1.0) / RADIUS;
        let (x, y) = (across(pixel % size), -across(pixel / size));
        let r = x.hypot(y);
        // The rim is blended into the black background over one pixel.
        let coverage = ((1.0 - r) * RADIUS * size as f64 / 2.0 + 0.5).clamp(0.0, 1.0);
        let shrink = if r > 0.999 { 0.999 / r } else { 1.0 };
        let (x, y) = (x * shrink, y * shrink);
        (coverage > 0.0).then(|| Point::with_normal(pixel, coverage, [x, y, (1.0 - x * x - y * y).sqrt()]))
    }

    fn with_normal(pixel: usize, coverage: f64, normal: [f64; 3]) -> Point {
        let [x, y, z] = normal;
        // Never zero: the normal leans towards the viewer.
        let level = x.hypot(z);
        let frame = [[z / level, 0.0, -x / level], [-x * y / level, level, -y * z / level], normal];
        Point { pixel, coverage, frame, wo: frame.map(|axis| axis[2]), sum: [0.0; 3] }
    }

    fn add(&mut self, brdf: [f32; 3], radiance: [f64; 3], weight: f64) {
        for k in 0..3 {
            self.sum[k] += f64::from(brdf[k]) * radiance[k] * weight;
        }
    }
}

/// Directions per sr of the sky's and the lights' sets.
fn fixed_density(towards: [f64; 3]) -> f64 {
    SKY_SAMPLES as f64 / (4.0 * PI) + LIGHTS.iter().map(|l| l.density(towards)).sum::<f64>()
}

/// Directions per sr that the half vectors give: sin(theta_h) = u^2 and phi_h uniform, `d(wi) = 4 cos(theta_d) d(h)`.
fn half_density(half: [f64; 3], cos_theta_d: f64) -> f64 {
    let sin = (half[0] * half[0] + half[1] * half[1]).sqrt();
    // Infinite at the normal itself, where the weight becomes 0.
    HALF_SAMPLES as f64 * half[2] / (4.0 * PI * sin * sin.sqrt()) / (4.0 * cos_theta_d)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Axis, AxisName, Mapping};
    use crate::table::synth::Recipe;

    fn white(_: [f64; 3]) -> [f64; 3] {
        [1.0; 3]
    }

    #[test]
    fn a_white_surface_in_a_white_room_is_white() {
        let quadrature = Quadrature::new(white);
        for normal in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [-0.48, 0.64, 0.6], [0.0, -0.954, 0.3]] {
            let mut points = [Point::with_normal(0, 1.0, normal)];
            quadrature.reflect(&mut points, &|_, _| [1.0 / PI as f32; 3], white);
            let out = points[0].sum;
            assert!((out[0] - 1.0).abs() < 0.03, "{normal:?} {out:?}");
        }
    }

    #[test]
    fn pictures_are_of_the_table_and_repeat() {
        let table = Recipe::named("satin-paint").unwrap().merl().unwrap();
        let image = sphere_of_table(&table, 24);
        assert_eq!(image, sphere_of_table(&table, 24));
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
        let table = BrdfTable::from_values(grid, vec![1.0; 12]).unwrap();
        assert!(sphere_of_table(&table, 8).rgb.iter().all(|v| *v == 0.0));
        assert!(sphere_of_table(&table, 0).rgb.is_empty());
    }

    #[test]
    fn colours_come_from_names_or_wavelengths() {
        let axes = Grid::merl().axes()[..1].to_vec();
        let channels = |names: &[&str], wavelengths: &[Option<f64>]| {
            let channel = |(n, w): (&&str, &Option<f64>)| crate::grid::Channel {
                name: n.to_string(),
                wavelength: *w,
                scale: 1.0,
            };
            Grid::new(axes.clone(), names.iter().zip(wavelengths).map(channel).collect()).unwrap()
        };
        assert_eq!(colour_channels(&channels(&["B", "G", "R"], &[None; 3])), [2, 1, 0]);
        let wavelengths = [Some(400.0), Some(470.0), Some(540.0), Some(600.0), Some(700.0)];
        assert_eq!(colour_channels(&channels(&["a", "b", "c", "d", "e"], &wavelengths)), [3, 2, 1]);
        assert_eq!(colour_channels(&channels(&["luminance"], &[None])), [0, 0, 0]);
    }
}
