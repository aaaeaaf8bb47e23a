//! Environment maps: radiance from every direction, and directions drawn in proportion to it.

use std::f64::consts::{PI, TAU};

use super::light;
use crate::base::error::{Error, Result};

/// Size of the built-in map.
const BUILT_IN: [usize; 2] = [1024, 512];
/// Most texels of a map.
const MAX_TEXELS: usize = 1 << 26;

/// A latitude-longitude map, constant over each texel.
///
/// Directions are in the frame of the picture: x right, y up, z towards the viewer. The top row is the zenith, the
/// middle of the map lies straight behind the object (-z), its left and right edges at the viewer.
#[derive(Clone, Debug)]
pub struct Environment {
    width: usize,
    height: usize,
    rgb: Vec<[f32; 3]>,
    /// Share of the power in all rows above each row, `height + 1` entries from 0 to 1.
    rows: Vec<f64>,
    /// Share of a row's power to the left of each texel, `width + 1` entries a row.
    columns: Vec<f64>,
    /// Luminance integrated over the sphere.
    power: f64,
}

/// A direction drawn from an environment.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    /// Unit direction.
    pub towards: [f64; 3],
    /// What arrives from there.
    pub radiance: [f64; 3],
    /// Density of the drawing there, per sr.
    pub density: f64,
}

impl Environment {
    /// A map of linear radiance, rows from the top. Negative values and NaN count as 0, infinite ones as 65504.
    ///
    /// # Errors
    /// `InvalidArgument` if a size is zero or too large, does not match the number of texels, or if all is black.
    pub fn new(width: usize, height: usize, rgb: Vec<[f32; 3]>) -> Result<Environment> {
        let bad = |what: String| Err(Error::InvalidArgument(what));
        let texels = width.checked_mul(height).filter(|n| (1..=MAX_TEXELS).contains(n));
        if texels != Some(rgb.len()) {
            let n = rgb.len();
            return bad(format!("no map of {width} x {height} texels from {n}; at most {MAX_TEXELS} are allowed"));
        }
        let clean = |v: f32| if v.is_nan() { 0.0 } else { v.clamp(0.0, 65504.0) };
        let rgb: Vec<[f32; 3]> = rgb.into_iter().map(|p| p.map(clean)).collect();
        let (mut rows, mut columns) = (vec![0.0], Vec::with_capacity((width + 1) * height));
        let mut power = 0.0;
        for (r, row) in rgb.chunks_exact(width).enumerate() {
            let start = columns.len();
            let mut sum = 0.0;
            columns.push(0.0);
            for texel in row {
                sum += luminance(*texel);
                columns.push(sum);
            }
            if sum > 0.0 {
                columns[start..].iter_mut().for_each(|c| *c /= sum);
            }
            power += sum * (edge(r, height) - edge(r + 1, height)) * TAU / width as f64;
            rows.push(power);
        }
        if power <= 0.0 {
            return bad("the environment is black everywhere; nothing would be seen".into());
        }
        rows.iter_mut().for_each(|r| *r /= power);
        Ok(Environment { width, height, rgb, rows, columns, power })
    }

    /// The map of [`light::radiance`]: a sky over a floor, a softbox and a warm strip light.
    pub fn built_in() -> Environment {
        let [width, height] = BUILT_IN;
        let texel = |i: usize| {
            let phi = TAU * ((i % width) as f64 + 0.5) / width as f64;
            let theta = PI * ((i / width) as f64 + 0.5) / height as f64;
            light::radiance(direction(theta.cos(), phi)).map(|c| c as f32)
        };
        Environment::new(width, height, (0..width * height).map(texel).collect()).expect("the built-in map has light")
    }

    /// Radiance that arrives from the unit direction `w`: red, green, blue.
    pub fn radiance(&self, w: [f64; 3]) -> [f64; 3] {
        self.rgb[self.texel(w)].map(f64::from)
    }

    /// Density per sr with which [`Environment::draw`] gives the unit direction `w`: luminance over power.
    pub fn density(&self, w: [f64; 3]) -> f64 {
        luminance(self.rgb[self.texel(w)]) / self.power
    }

    /// The direction of two numbers in [0, 1).
    pub fn draw(&self, u: [f64; 2]) -> Drawn {
        let (row, down) = pick(&self.rows, u[0]);
        let line = &self.columns[row * (self.width + 1)..][..self.width + 1];
        let (column, across) = pick(line, u[1]);
        // Uniform in the solid angle of the texel.
        let (top, bottom) = (edge(row, self.height), edge(row + 1, self.height));
        let towards = direction(top + (bottom - top) * down, TAU * (column as f64 + across) / self.width as f64);
        let texel = self.rgb[row * self.width + column];
        Drawn { towards, radiance: texel.map(f64::from), density: luminance(texel) / self.power }
    }

    fn texel(&self, w: [f64; 3]) -> usize {
        let theta = w[1].clamp(-1.0, 1.0).acos();
        let phi = w[0].atan2(-w[2]) + PI;
        let row = ((theta / PI * self.height as f64) as usize).min(self.height - 1);
        row * self.width + ((phi / TAU * self.width as f64) as usize).min(self.width - 1)
    }
}

/// Height above the horizon (y) at the upper edge of a row.
fn edge(row: usize, height: usize) -> f64 {
    (PI * row as f64 / height as f64).cos()
}

/// The unit direction at height `y`, `phi` from the left edge of the map.
fn direction(y: f64, phi: f64) -> [f64; 3] {
    let r = (1.0 - y * y).max(0.0).sqrt();
    let (sin, cos) = phi.sin_cos();
    [-r * sin, y, r * cos]
}

/// The interval of a cumulative distribution that holds `u`, and how far into it.
fn pick(cumulative: &[f64], u: f64) -> (usize, f64) {
    // The last edge at or below u: never an interval without weight, unless rounding led past the end.
    let at = cumulative.partition_point(|edge| *edge <= u).clamp(1, cumulative.len() - 1) - 1;
    let (low, high) = (cumulative[at], cumulative[at + 1]);
    (at, if high > low { ((u - low) / (high - low)).clamp(0.0, 1.0 - f64::EPSILON) } else { 0.5 })
}

/// Relative luminance of linear sRGB (IEC 61966-2-1).
fn luminance(rgb: [f32; 3]) -> f64 {
    0.2126 * f64::from(rgb[0]) + 0.7152 * f64::from(rgb[1]) + 0.0722 * f64::from(rgb[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assess::render::light::whole_sphere;

    fn unit(i: usize, n: usize) -> [f64; 2] {
        [(i as f64 + 0.5) / n as f64, (i as f64 * 0.618_033_988_749_894_9 + 0.3).fract()]
    }

    #[test]
    fn the_density_integrates_to_one() {
        let environment = Environment::built_in();
        let n = 400_000;
        let sum: f64 = whole_sphere(n).map(|w| environment.density(w)).sum();
        assert!((sum * 4.0 * PI / n as f64 - 1.0).abs() < 2e-3, "{sum}");
        // Texel by texel, exactly.
        let mut total = 0.0;
        for row in 0..environment.height {
            let angle =
                (edge(row, environment.height) - edge(row + 1, environment.height)) * TAU / environment.width as f64;
            let texels = &environment.rgb[row * environment.width..][..environment.width];
            total += texels.iter().map(|t| luminance(*t) / environment.power * angle).sum::<f64>();
        }
        assert!((total - 1.0).abs() < 1e-12);
    }

    #[test]
    fn drawn_directions_lie_in_their_texels() {
        let environment = Environment::built_in();
        for i in 0..2000 {
            let drawn = environment.draw(unit(i, 2000));
            assert!((drawn.towards.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-12);
            assert!((environment.density(drawn.towards) / drawn.density - 1.0).abs() < 1e-12);
            assert_eq!(environment.radiance(drawn.towards), drawn.radiance);
        }
        for u in [[0.0, 0.0], [1.0 - 1e-16, 1.0 - 1e-16], [0.0, 0.999_999], [0.5, 0.0]] {
            assert!(environment.draw(u).density > 0.0);
        }
    }

    #[test]
    fn sampled_irradiance_equals_the_direct_sum() {
        let environment = Environment::built_in();
        for normal in [[0.0, 1.0, 0.0], [0.6, 0.0, 0.8], [0.0, -1.0, 0.0]] {
            let cosine = |w: [f64; 3]| (0..3).map(|k| w[k] * normal[k]).sum::<f64>().max(0.0);
            let n = 400_000;
            let direct: f64 =
                whole_sphere(n).map(|w| environment.radiance(w)[1] * cosine(w)).sum::<f64>() * 4.0 * PI / n as f64;
            let n = 40_000;
            let drawn = (0..n).map(|i| environment.draw(unit(i, n)));
            let sampled: f64 = drawn.map(|d| d.radiance[1] * cosine(d.towards) / d.density).sum::<f64>() / n as f64;
            assert!((sampled / direct - 1.0).abs() < 5e-3, "{normal:?} {sampled} {direct}");
        }
    }

    #[test]
    fn maps_are_oriented_as_stated() {
        // Four texels across: from the viewer's back on the left, over the left hand, behind the object, the right.
        let mut map = vec![[0.0f32; 3]; 8];
        map[1] = [1.0; 3];
        let left = Environment::new(4, 2, map.clone()).unwrap();
        let side = std::f64::consts::FRAC_1_SQRT_2 * 0.8;
        assert_eq!(left.radiance([-side, 0.6, -side]), [1.0; 3]);
        assert_eq!(left.radiance([side, 0.6, -side]), [0.0; 3]);
        assert!(left.draw([0.3, 0.9]).towards[0] < 0.0);
        map[1] = [f32::NAN, -1.0, 0.0];
        assert!(Environment::new(4, 2, map.clone()).is_err());
        assert!(Environment::new(3, 2, map).is_err() && Environment::new(0, 0, Vec::new()).is_err());
    }
}
