//! Synthetic tables with the look of measured ones: for tests, examples and benchmarks, which need no outside data.
//!
//! Diffuse plus microfacet lobes (GGX distribution, Walter et al. 2007; height-correlated Smith masking; Schlick
//! Fresnel) at the bin centres, in the units of the source file. Bins below the horizon are missing as they are in the
//! MERL files; noise and holes on request.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::BrdfTable;
use crate::base::error::{Error, Result};
use crate::table::grid::{AxisName, Grid};

/// A bin is impossible where the lower of the two directions of its centre has a cosine below this.
///
/// The validity of the MERL tables follows this rule in all but 2 of their 1,458,000 bins.
pub const HORIZON: f64 = -0.061;

/// Cosines are not taken below this where they divide: bins that straddle the horizon stay finite.
const LEAST_COSINE: f64 = 1e-3;

/// Value of an entry that was not measured, in source units.
const MISSING: f64 = -1.0;

/// One specular lobe.
#[derive(Clone, Debug, PartialEq)]
pub struct Lobe {
    /// Width (GGX alpha), 1e-4 to 1.
    pub roughness: f64,
    /// Reflectance at normal incidence: red, green, blue, 0 to 1.
    pub f0: [f64; 3],
    /// Factor of the lobe, 0 or more.
    pub weight: f64,
}

/// What a table is synthesised from.
///
/// Without noise a table is exactly mirror-symmetric in phi_d, which measured ones are not; codecs look better on it
/// than they are. A sigma of 0.003 stands for a clean measurement, 0.02 for a noisy one.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Diffuse albedo: red, green, blue, 0 to 1; the BRDF's share is albedo / pi.
    pub diffuse: [f64; 3],
    /// Specular lobes, summed.
    pub lobes: Vec<Lobe>,
    /// Sigma of the noise in the log domain, 0 to 4: every value is multiplied by `exp(noise * N(0, 1))`.
    pub noise: f64,
    /// Share of the possible positions that are missing, 0 to 1: a quarter of them in a few patches, the others
    /// scattered. A hole is missing in all channels.
    pub holes: f64,
    /// Seed of noise and holes, which are independent of each other.
    pub seed: u64,
}

impl Recipe {
    /// Names that [`Recipe::named`] knows.
    pub const NAMES: [&'static str; 5] = ["matte", "satin-paint", "pearl", "rough-metal", "mirror-like"];

    /// A material by name, without noise and holes; `None` if the name is not in [`Recipe::NAMES`].
    pub fn named(name: &str) -> Option<Recipe> {
        let lobe = |roughness, f0, weight| Lobe { roughness, f0, weight };
        let (diffuse, lobes) = match name {
            "matte" => ([0.45, 0.33, 0.20], vec![lobe(0.6, [0.03; 3], 1.0)]),
            "satin-paint" => ([0.42, 0.03, 0.035], vec![lobe(0.18, [0.045; 3], 1.0)]),
            "pearl" => ([0.10, 0.16, 0.26], vec![lobe(0.35, [0.20, 0.26, 0.36], 0.8), lobe(0.06, [0.04; 3], 1.0)]),
            "rough-metal" => ([0.0; 3], vec![lobe(0.32, [0.91, 0.67, 0.32], 1.0)]),
            "mirror-like" => ([0.002; 3], vec![lobe(0.02, [0.55, 0.56, 0.58], 0.9), lobe(0.12, [0.5; 3], 0.08)]),
            _ => return None,
        };
        Some(Recipe { diffuse, lobes, noise: 0.0, holes: 0.0, seed: 1 })
    }

    /// The table on MERL's grid: 90 x 90 x 180 bins, R, G, B.
    ///
    /// # Errors
    /// Those of [`Recipe::synthesise`].
    pub fn merl(&self) -> Result<BrdfTable> {
        self.synthesise(&Grid::merl())
    }

    /// The table on `grid`, whose axes are any of theta_h, phi_h, theta_d, phi_d.
    ///
    /// A missing theta_h or theta_d is 0, a missing phi_d pi/2. With other than three channels, colours run evenly
    /// from the first component through the second to the third. The same recipe gives the same table on one machine;
    /// the last bits of `exp`, `ln` and `sin` differ between platforms.
    ///
    /// # Errors
    /// `InvalidArgument` if a field is outside its range or the grid has another axis.
    pub fn synthesise(&self, grid: &Grid) -> Result<BrdfTable> {
        self.check(grid)?;
        let (mut values, possible) = self.evaluate(grid);
        let mut keep = possible.clone();
        punch(&mut keep, grid.shape(), self.holes, SplitMix64(self.seed ^ 0x686F_6C65_7300_0000));
        // One normal per possible entry whether it is kept or not: holes do not change the noise of the others.
        let mut normals = Normals::new(SplitMix64(self.seed));
        for plane in values.chunks_exact_mut(possible.len()) {
            for ((value, &possible), &keep) in plane.iter_mut().zip(&possible).zip(&keep) {
                if possible && self.noise > 0.0 {
                    *value *= (self.noise * normals.next()).exp();
                }
                if !keep {
                    *value = MISSING;
                }
            }
        }
        BrdfTable::from_values(grid.clone(), values)
    }

    fn check(&self, grid: &Grid) -> Result<()> {
        let within = |what: &str, x: f64, low: f64, high: f64| {
            // Written so that NaN fails.
            if x >= low && x <= high {
                return Ok(());
            }
            Err(Error::InvalidArgument(format!("{what} is {x}, allowed are {low} to {high}")))
        };
        within("noise", self.noise, 0.0, 4.0)?;
        within("holes", self.holes, 0.0, 1.0)?;
        self.diffuse.iter().try_for_each(|x| within("diffuse albedo", *x, 0.0, 1.0))?;
        for lobe in &self.lobes {
            within("roughness", lobe.roughness, 1e-4, 1.0)?;
            within("weight", lobe.weight, 0.0, 1e6)?;
            lobe.f0.iter().try_for_each(|x| within("f0", *x, 0.0, 1.0))?;
        }
        let known = [AxisName::ThetaH, AxisName::PhiH, AxisName::ThetaD, AxisName::PhiD];
        match grid.axes().iter().find(|a| !known.contains(&a.name)) {
            Some(axis) => Err(Error::InvalidArgument(format!(
                "materials are synthesised over theta_h, phi_h, theta_d, phi_d, not over {}",
                axis.name.as_str()
            ))),
            None => Ok(()),
        }
    }

    /// Values of all positions in source units, and whether each position is above the horizon.
    fn evaluate(&self, grid: &Grid) -> (Vec<f64>, Vec<bool>) {
        let (theta_h, theta_d) = (Centres::of(grid, AxisName::ThetaH, 0.0), Centres::of(grid, AxisName::ThetaD, 0.0));
        let phi_d = Centres::of(grid, AxisName::PhiD, FRAC_PI_2);
        let channels = grid.channels().len();
        let colours = |rgb: [f64; 3]| (0..channels).map(|c| colour(rgb, c, channels)).collect::<Vec<_>>();
        let diffuse = colours(self.diffuse);
        // Factors of one angle only, tabulated: D[lobe][theta_h], F[lobe][theta_d][channel].
        let d: Vec<Vec<f64>> =
            self.lobes.iter().map(|l| theta_h.map(|angle| l.weight * ggx(l.roughness, angle))).collect();
        let f: Vec<Vec<Vec<f64>>> = self
            .lobes
            .iter()
            .map(|l| theta_d.map(|angle| colours(l.f0).iter().map(|f0| schlick(*f0, angle)).collect()))
            .collect();
        let (sin_cos_h, sin_cos_d) = (theta_h.map(f64::sin_cos), theta_d.map(f64::sin_cos));
        let cos_phi = phi_d.map(f64::cos);

        let n = grid.positions();
        let mut values = vec![MISSING; n * channels];
        let mut possible = vec![false; n];
        for position in 0..n {
            let at = |centres: &Centres| position / centres.stride % centres.angles.len();
            let (h, td, pd) = (at(&theta_h), at(&theta_d), at(&phi_d));
            let middle = sin_cos_h[h].1 * sin_cos_d[td].1;
            let swing = sin_cos_h[h].0 * sin_cos_d[td].0 * cos_phi[pd];
            let (cos_i, cos_o) = (middle - swing, middle + swing);
            if cos_i.min(cos_o) < HORIZON {
                continue;
            }
            possible[position] = true;
            let (cos_i, cos_o) = (cos_i.max(LEAST_COSINE), cos_o.max(LEAST_COSINE));
            for (c, albedo) in diffuse.iter().enumerate() {
                values[c * n + position] = albedo / PI;
            }
            for (lobe, (d, f)) in self.lobes.iter().zip(d.iter().zip(&f)) {
                let specular = d[h] * visibility(lobe.roughness, cos_i, cos_o);
                for (c, fresnel) in f[td].iter().enumerate() {
                    values[c * n + position] += specular * fresnel;
                }
            }
            for (c, channel) in grid.channels().iter().enumerate() {
                values[c * n + position] /= channel.scale;
            }
        }
        (values, possible)
    }
}

/// Bin centres of one axis and the distance of its bins in the linear index.
struct Centres {
    angles: Vec<f64>,
    stride: usize,
}

impl Centres {
    fn of(grid: &Grid, name: AxisName, missing: f64) -> Centres {
        match grid.find(name) {
            None => Centres { angles: vec![missing], stride: 1 },
            Some(k) => {
                let axis = grid.axes()[k];
                let angles = (0..axis.len).map(|i| axis.angle(i as f64 + 0.5)).collect();
                Centres { angles, stride: grid.axes()[k + 1..].iter().map(|a| a.len).product() }
            }
        }
    }

    fn map<T>(&self, f: impl Fn(f64) -> T) -> Vec<T> {
        self.angles.iter().map(|a| f(*a)).collect()
    }
}

/// GGX density of microfacet normals, 1/sr.
fn ggx(alpha: f64, theta_h: f64) -> f64 {
    let (sin, cos) = theta_h.sin_cos();
    let root = alpha * alpha * cos * cos + sin * sin;
    alpha * alpha / (PI * root * root)
}

/// Smith masking and shadowing (height-correlated, Heitz 2014) over `4 cos_i cos_o`.
fn visibility(alpha: f64, cos_i: f64, cos_o: f64) -> f64 {
    let a2 = alpha * alpha;
    let root = |c: f64| (a2 + (1.0 - a2) * c * c).sqrt();
    0.5 / (cos_o * root(cos_i) + cos_i * root(cos_o))
}

fn schlick(f0: f64, theta_d: f64) -> f64 {
    f0 + (1.0 - f0) * (1.0 - theta_d.cos()).powi(5)
}

/// Component `channel` of `channels`, read evenly along the three of `rgb`; the middle one if there is one channel.
fn colour(rgb: [f64; 3], channel: usize, channels: usize) -> f64 {
    if channels == 1 {
        return rgb[1];
    }
    let along = 2.0 * channel as f64 / (channels - 1) as f64;
    let low = (along as usize).min(1);
    rgb[low] + (rgb[low + 1] - rgb[low]) * (along - low as f64)
}

/// Clears `share` of the set positions exactly: a quarter of them in boxes of neighbours, the others one by one.
fn punch(keep: &mut [bool], shape: [usize; 4], share: f64, mut random: SplitMix64) {
    const PATCHES: usize = 4;
    let mut left = keep.iter().filter(|k| **k).count();
    let mut target = (share * left as f64).round() as usize;
    let mut patched = target / 4;
    for patch in 0..PATCHES {
        let mut budget = patched / (PATCHES - patch);
        patched -= budget;
        // A box of about the right volume with the proportions of the table, which may hang over the edge.
        let side =
            (budget as f64 / keep.len() as f64).powf(1.0 / shape.iter().filter(|n| **n > 1).count().max(1) as f64);
        let size = shape.map(|n| ((n as f64 * side).ceil() as usize).clamp(1, n));
        let corner = shape.map(|n| random.below(n));
        for i in 0..size.iter().product() {
            let mut rest = i;
            let mut index = [0; 4];
            for k in (0..4).rev() {
                index[k] = (corner[k] + rest % size[k]) % shape[k];
                rest /= size[k];
            }
            let position = index.iter().zip(shape).fold(0, |p, (i, n)| p * n + i);
            if budget > 0 && keep[position] {
                keep[position] = false;
                (budget, left, target) = (budget - 1, left - 1, target - 1);
            }
        }
    }
    // Selection sampling (Knuth, TAOCP 2, algorithm S): every remaining position is as likely, the count is exact.
    for k in keep.iter_mut().filter(|k| **k) {
        if random.below(left) < target {
            *k = false;
            target -= 1;
        }
        left -= 1;
    }
}

/// SplitMix64 (Steele, Lea, Flood 2014).
struct SplitMix64(u64);

impl SplitMix64 {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// In (0, 1].
    fn unit(&mut self) -> f64 {
        ((self.next() >> 11) + 1) as f64 / (1u64 << 53) as f64
    }

    /// In 0..n; the bias of the multiplication is below n / 2^64.
    fn below(&mut self, n: usize) -> usize {
        ((self.next() as u128 * n as u128) >> 64) as usize
    }
}

/// Standard normal numbers by Box and Muller, in pairs.
struct Normals {
    random: SplitMix64,
    spare: Option<f64>,
}

impl Normals {
    fn new(random: SplitMix64) -> Normals {
        Normals { random, spare: None }
    }

    fn next(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = (-2.0 * self.random.unit().ln()).sqrt();
        let (sin, cos) = (TAU * self.random.unit()).sin_cos();
        self.spare = Some(radius * sin);
        radius * cos
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::grid::{Axis, Mapping};

    fn small(phi_end: f64) -> Grid {
        let axis = |name, len, end| Axis { name, len, mapping: Mapping::Linear, start: 0.0, end };
        let axes = vec![
            axis(AxisName::ThetaH, 12, FRAC_PI_2),
            axis(AxisName::ThetaD, 10, FRAC_PI_2),
            axis(AxisName::PhiD, 24, phi_end),
        ];
        Grid::new(axes, Grid::rgb_channels([1.0, 0.5, 2.0])).unwrap()
    }

    fn pearl() -> Recipe {
        Recipe::named("pearl").unwrap()
    }

    #[test]
    fn every_named_material_fills_the_merl_grid_with_its_horizon() {
        for name in Recipe::NAMES {
            let table = Recipe::named(name).unwrap().merl().unwrap();
            let share = 1.0 - table.valid_count() as f64 / table.values().len() as f64;
            // The MERL tables: 20.976 %.
            assert!((share - 0.20976).abs() < 1e-5, "{name}: {share}");
            assert!(table.values().iter().all(|v| v.is_finite() && (*v == MISSING || *v >= 0.0)));
        }
        assert_eq!(Recipe::named("unobtainium"), None);
    }

    #[test]
    fn reciprocal_and_mirrored_bins_are_equal() {
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * a.abs().max(b.abs());
        // Swapped directions are phi_d + pi, mirrored ones -phi_d, both together pi - phi_d.
        let half = pearl().synthesise(&small(PI)).unwrap();
        let whole = pearl().synthesise(&small(TAU)).unwrap();
        for row in half.values().chunks_exact(24) {
            assert!((0..24).all(|i| near(row[i], row[23 - i])));
        }
        for row in whole.values().chunks_exact(24) {
            assert!((0..12).all(|i| near(row[i], row[i + 12]) && near(row[i], row[23 - i])));
        }
    }

    #[test]
    fn a_lobe_reflects_what_its_fresnel_term_says() {
        // At normal incidence on a narrow white lobe nearly all energy comes back: integrate over theta_h, phi_d free,
        // d(wi) = 4 cos(theta_d) d(h) with wo along the normal, so theta_d = theta_h.
        let alpha = 0.1;
        let n = 20_000;
        let total: f64 = (0..n)
            .map(|i| {
                let t = (i as f64 + 0.5) / n as f64 * PI / 4.0;
                let cos_i = (2.0 * t).cos();
                let f = ggx(alpha, t) * visibility(alpha, cos_i, 1.0);
                f * cos_i * 4.0 * t.cos() * TAU * t.sin() * (PI / 4.0 / n as f64)
            })
            .sum();
        assert!((0.97..=1.0).contains(&total), "{total}");
    }

    #[test]
    fn seeds_decide_noise_and_holes() {
        let grid = small(PI);
        let recipe = Recipe { noise: 0.1, holes: 0.1, seed: 5, ..pearl() };
        let table = recipe.synthesise(&grid).unwrap();
        assert_eq!(table, recipe.synthesise(&grid).unwrap());
        let other = Recipe { seed: 6, ..recipe.clone() }.synthesise(&grid).unwrap();
        assert_ne!(table.values(), other.values());
        // Holes leave the noise of the other entries as it is.
        let whole = Recipe { holes: 0.0, ..recipe }.synthesise(&grid).unwrap();
        let kept = table.valid().iter().zip(table.values().iter().zip(whole.values())).filter(|(v, _)| **v);
        assert!(kept.clone().count() > 0 && kept.into_iter().all(|(_, (a, b))| a == b));
    }

    #[test]
    fn noise_has_the_stated_sigma() {
        let grid = Grid::merl();
        let clean = pearl().synthesise(&grid).unwrap();
        let noisy = Recipe { noise: 0.02, ..pearl() }.synthesise(&grid).unwrap();
        let logs = clean.values().iter().zip(noisy.values()).filter(|(a, _)| **a > 0.0).map(|(a, b)| (b / a).ln());
        let (n, sum, squares) = logs.fold((0.0, 0.0, 0.0), |(n, s, q), x| (n + 1.0, s + x, q + x * x));
        assert!((sum / n).abs() < 1e-4 && ((squares / n).sqrt() / 0.02 - 1.0).abs() < 5e-3);
    }

    #[test]
    fn holes_have_the_stated_share_in_all_channels_alike() {
        let grid = Grid::merl();
        let whole = pearl().synthesise(&grid).unwrap().valid_count() as f64;
        for holes in [0.0, 0.003, 0.05, 0.5, 1.0] {
            let table = Recipe { holes, ..pearl() }.synthesise(&grid).unwrap();
            let share = 1.0 - table.valid_count() as f64 / whole;
            assert!((share - holes).abs() < 1e-6, "{holes}: {share}");
            assert_eq!(table.valid_plane(0), table.valid_plane(2));
        }
    }

    #[test]
    fn other_grids_and_ranges() {
        let axes = small(PI).axes().to_vec();
        let spectral = Grid::new(vec![axes[2], axes[0]], vec![small(PI).channels()[0].clone(); 7]).unwrap();
        let table = Recipe { holes: 0.5, ..pearl() }.synthesise(&spectral).unwrap();
        assert_eq!(table.values().len(), 24 * 12 * 7);
        let isotropic = Grid::new(vec![Axis { name: AxisName::ThetaI, ..axes[0] }], Grid::rgb_channels([1.0; 3]));
        assert!(pearl().synthesise(&isotropic.unwrap()).is_err());
        for bad in [
            Recipe { noise: f64::NAN, ..pearl() },
            Recipe { holes: 1.1, ..pearl() },
            Recipe { lobes: vec![Lobe { roughness: 0.0, f0: [0.5; 3], weight: 1.0 }], ..pearl() },
        ] {
            assert!(bad.synthesise(&small(PI)).is_err());
        }
    }
}
