//! Densities integrate to 1, draws follow them, and estimates by them have less noise than those by the cosine.

use std::f64::consts::{PI, TAU};

use proptest::prelude::*;

use super::marginal::Pair;
use super::*;
use crate::codec::sample::SplitMix64;

/// Parts of the hemisphere: along the root of the angle to the mirror direction of wi, and around it.
const BINS: [usize; 2] = [16, 32];
/// Points of a bin's integral along each.
const POINTS: usize = 40;
/// Degrees.
const ELEVATIONS: [f64; 7] = [0.0, 5.0, 30.0, 45.0, 60.0, 80.0, 89.0];

fn elevated(degrees: f64) -> [f64; 3] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    // Not along an axis.
    [0.6 * sin, 0.8 * sin, cos]
}

fn uniform(random: &mut SplitMix64) -> f64 {
    (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// A diffuse surface, a lobe of GGX's shape that rises towards grazing, nothing at all, and steps of all sizes.
fn materials() -> [(&'static str, Importance); 4] {
    let glossy = |pair: Pair| {
        let (sin, cos) = pair.theta_h.sin_cos();
        let root = 0.01 * cos * cos + sin * sin;
        0.02 + 0.01 / (PI * root * root) * (0.05 + (1.0 - pair.theta_d.cos()).powi(5))
    };
    let ragged = |pair: Pair| {
        let cell = (pair.theta_h * 20.0) as u64 * 1000 + (pair.theta_d * 20.0) as u64;
        (SplitMix64(cell).next_u64() % 1000) as f64 * if pair.cos_phi_d > 0.5 { 1e6 } else { 1.0 }
    };
    let of = |rings: Rings| Importance { rings: Some(rings) };
    [
        ("diffuse", of(Rings::new(|_| 0.3))),
        ("glossy", of(Rings::new(glossy))),
        ("black", of(Rings::new(|_| 0.0))),
        ("ragged", of(Rings::new(ragged))),
    ]
}

/// Mirror direction of wi, and two directions across.
fn frame([x, y, z]: [f64; 3]) -> [[f64; 3]; 3] {
    [[-x, -y, z], [0.8, -0.6, 0.0], [-0.6 * z, -0.8 * z, -x.hypot(y)]]
}

/// Integral of a density over each part of the hemisphere of wo, by other coordinates than those of the table.
fn integrals(wi: [f64; 3], pdf: impl Fn([f64; 3]) -> f64) -> Vec<f64> {
    let frame = frame(wi);
    let mut bins = vec![0.0; BINS[0] * BINS[1]];
    let [rows, columns] = BINS.map(|n| n * POINTS);
    for row in 0..rows {
        let root = (row as f64 + 0.5) / rows as f64;
        let (sin, cos) = (PI * root * root).sin_cos();
        let area = sin * TAU * root / rows as f64 * TAU / columns as f64;
        for column in 0..columns {
            let (sin_turn, cos_turn) = ((column as f64 + 0.5) / columns as f64 * TAU).sin_cos();
            let wo: [f64; 3] =
                std::array::from_fn(|k| cos * frame[0][k] + sin * (cos_turn * frame[1][k] + sin_turn * frame[2][k]));
            if wo[2] > 0.0 {
                bins[row / POINTS * BINS[1] + column / POINTS] += area * pdf(wo);
            }
        }
    }
    bins
}

fn bin(wi: [f64; 3], wo: [f64; 3]) -> usize {
    let [along, x, y] = frame(wi).map(|axis| axis[0] * wo[0] + axis[1] * wo[1] + axis[2] * wo[2]);
    let share = [(x.hypot(y).atan2(along) / PI).sqrt(), y.atan2(x).rem_euclid(TAU) / TAU];
    let [row, column] = [0, 1].map(|k| ((share[k] * BINS[k] as f64) as usize).min(BINS[k] - 1));
    row * BINS[1] + column
}

/// How many standard deviations a chi-square statistic of the draws is above what their density lets expect, by the
/// approximation of Wilson and Hilferty (1931).
fn surprise(importance: &Importance, wi: [f64; 3], expected: &[f64]) -> f64 {
    const DRAWS: usize = 100_000;
    let mut random = SplitMix64(11);
    let mut counts = vec![0.0; expected.len()];
    for _ in 0..DRAWS {
        let u = [uniform(&mut random), uniform(&mut random)];
        counts[bin(wi, importance.sample(wi, u).unwrap().wo)] += 1.0;
    }
    // Bins that expect few are one.
    let (mut statistic, mut degrees, mut few) = (0.0, -1.0, [0.0; 2]);
    let mut add = |count: f64, expected: f64| {
        statistic += (count - expected) * (count - expected) / expected;
        degrees += 1.0;
    };
    for (count, expected) in counts.iter().zip(expected) {
        let expected = expected * DRAWS as f64;
        if expected < 10.0 {
            few = [few[0] + count, few[1] + expected];
        } else {
            add(*count, expected);
        }
    }
    if few[1] > 0.0 {
        add(few[0], few[1]);
    }
    let spread: f64 = 2.0 / (9.0 * degrees);
    ((statistic / degrees).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// One-sided level .01 over at most 40 comparisons (Bonferroni): .00025.
const LIMIT: f64 = 3.48;

#[test]
#[cfg_attr(miri, ignore = "integrals of millions of points")]
fn densities_integrate_to_one_and_draws_follow_them() {
    for (name, importance) in materials() {
        for degrees in ELEVATIONS {
            let wi = elevated(degrees);
            let expected = integrals(wi, |wo| importance.pdf(wi, wo));
            let total: f64 = expected.iter().sum();
            assert!((total - 1.0).abs() < 0.01, "{name} at {degrees}: {total}");
            let surprise = surprise(&importance, wi, &expected);
            assert!(surprise < LIMIT, "{name} at {degrees}: {surprise}");
        }
    }
}

#[test]
#[cfg_attr(miri, ignore = "integrals of millions of points")]
fn a_density_that_is_off_by_a_few_percent_is_noticed() {
    let [_, (_, glossy), ..] = materials();
    for degrees in [0.0, 45.0, 80.0] {
        let wi = elevated(degrees);
        // Uneven by 5 % around the normal.
        let uneven = integrals(wi, |wo| glossy.pdf(wi, wo) * (1.0 + 0.05 * (3.0 * wo[1].atan2(wo[0])).cos()));
        // More by the cosine than was drawn.
        let blurred = integrals(wi, |wo| 0.95 * glossy.pdf(wi, wo) + 0.05 * wo[2] / PI);
        for wrong in [uneven, blurred] {
            let surprise = surprise(&glossy, wi, &wrong);
            assert!(surprise > LIMIT, "{degrees}: {surprise}");
        }
    }
    let wi = elevated(60.0);
    let turned = integrals(wi, |wo| glossy.pdf(elevated(60.5), wo));
    assert!(surprise(&glossy, wi, &turned) > LIMIT);
}

#[test]
#[cfg_attr(miri, ignore = "integrals of millions of points")]
fn any_numbers_give_directions_above_the_horizon() {
    let numbers = [0.0, -0.0, 1e-300, 0.049_999, 0.05, 0.3, 0.5, 0.999_999, BELOW_ONE, 1.0, -1.0, 2.0, f64::NAN];
    let heights = [1.0f64, 0.5, 1e-3, 1.1e-6, 1e-6, 1e-9, 1e-300];
    for (name, importance) in materials().into_iter().chain([("cosine", Importance::cosine())]) {
        for z in heights {
            for wi in [[(1.0 - z * z).sqrt(), 0.0, z], [-3.0, 4.0, 5.0 * z], [0.0, 0.0, z]] {
                for (u, v) in numbers.iter().flat_map(|u| numbers.map(|v| (*u, v))) {
                    let sample = importance.sample(wi, [u, v]).unwrap();
                    let [x, y, z] = sample.wo;
                    assert!((x * x + y * y + z * z - 1.0).abs() < 1e-9 && z > 0.0, "{name} {wi:?} {u} {v}: {sample:?}");
                    assert!(sample.pdf.is_finite() && sample.pdf > 0.0, "{name} {wi:?} {u} {v}: {sample:?}");
                    let pdf = importance.pdf(wi, sample.wo);
                    assert!(pdf.is_finite() && pdf > 0.0, "{name} {wi:?} {u} {v}: {sample:?} {pdf}");
                }
            }
        }
    }
}

#[test]
#[cfg_attr(miri, ignore = "integrals of millions of points")]
fn the_density_of_a_draw_is_the_density_there() {
    let mut random = SplitMix64(5);
    for (name, importance) in materials() {
        for _ in 0..20_000 {
            let wi = elevated(89.9 * uniform(&mut random));
            let sample = importance.sample(wi, [uniform(&mut random), uniform(&mut random)]).unwrap();
            assert_eq!(importance.pdf(wi, sample.wo), sample.pdf, "{name} {wi:?}");
        }
    }
}

/// Numbers from 0 to 1, ends of the range and of what the draw is cut into among them.
fn number() -> impl Strategy<Value = f64> {
    let edges = (0u32..=90, -4i32..=4).prop_map(|(i, ulps)| {
        let at = f64::from(i) / 90.0;
        f64::from_bits(at.to_bits().saturating_add_signed(i64::from(ulps)))
    });
    let ends = (0u64..1 << 12, any::<bool>());
    let ends = ends.prop_map(|(n, low)| if low { f64::from_bits(n) } else { f64::from_bits(1.0f64.to_bits() - n) });
    let small = (0i32..1074).prop_map(|e| 2f64.powi(-e));
    prop_oneof![4 => 0.0..1.0, 2 => ends, 2 => edges, 1 => small, 1 => prop::sample::select(vec![BELOW_ONE, COSINE_SHARE, 0.5])]
}

/// Directions above the horizon, of any length.
fn above() -> impl Strategy<Value = [f64; 3]> {
    let length =
        prop_oneof![4 => Just(1.0), 1 => 1e-3..1e3, 1 => prop::sample::select(vec![1e-320, 1e-150, 1e150, 1e300])];
    let height = prop_oneof![
        4 => 0.0..1.0,
        2 => (0i32..310).prop_map(|e| 10f64.powi(-e)),
        1 => (0.0..1e-15).prop_map(|off| 1.0 - off),
        1 => prop::sample::select(vec![1e-6, 1.0000001e-6, 0.999_999_9e-6, 1e-12, f64::MIN_POSITIVE, 5e-324]),
    ];
    (height, 0.0..TAU, length).prop_map(|(z, turn, length): (f64, f64, f64)| {
        let level = (1.0 - z * z).max(0.0).sqrt();
        [level * turn.cos() * length, level * turn.sin() * length, (z * length).max(5e-324)]
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: if cfg!(miri) { 4 } else { 20_000 }, ..ProptestConfig::default() })]

    /// For all numbers and all directions, at the ends of the range where the density has no bound too.
    #[test]
    fn sample_and_pdf_agree_to_the_bit(wi in above(), u in number(), v in number()) {
        static MATERIALS: std::sync::OnceLock<Vec<(&str, Importance)>> = std::sync::OnceLock::new();
        let materials = MATERIALS.get_or_init(|| {
            materials().into_iter().chain([("cosine", Importance::cosine())]).collect()
        });
        for (name, importance) in materials {
            let sample = importance.sample(wi, [u, v]).unwrap();
            let square: f64 = sample.wo.iter().map(|x| x * x).sum();
            prop_assert!((square - 1.0).abs() < 1e-14 && sample.wo[2] > 0.0, "{} {:?}", name, sample);
            prop_assert!(sample.pdf.is_finite() && sample.pdf > 0.0, "{} {:?}", name, sample);
            prop_assert_eq!(importance.pdf(wi, sample.wo).to_bits(), sample.pdf.to_bits(), "{} {:?}", name, sample);
        }
    }
}

#[test]
#[cfg_attr(miri, ignore = "integrals of millions of points")]
fn directions_that_are_none_have_no_density() {
    let [_, (_, glossy), ..] = materials();
    let up = [0.0, 0.0, 1.0];
    let none = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [f64::NAN, 0.0, 1.0], [0.0, f64::INFINITY, 1.0]];
    for bad in none {
        assert_eq!(glossy.sample(bad, [0.5; 2]), None);
        assert_eq!((glossy.pdf(bad, up), glossy.pdf(up, bad)), (0.0, 0.0));
    }
    assert_eq!(glossy.pdf(up, [0.0, 0.0, 7.0]), glossy.pdf([0.0, 0.0, 1e-200], up));
    // As near to opposite as can be.
    assert!(glossy.pdf([1.0, 0.0, 1.1e-6], [-1.0, 0.0, 1e-300]).is_finite());
}

#[test]
#[cfg_attr(miri, ignore = "integrals of millions of points")]
fn other_grids_are_drawn_from_by_the_cosine() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/v1");
    let (mut with, mut without) = (0, 0);
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "csbrdf") {
            continue;
        }
        let reader = Reader::open(std::fs::read(&path).unwrap()).unwrap();
        let importance = Importance::new(&reader).unwrap();
        let sample = importance.sample(elevated(40.0), [0.3, 0.7]).unwrap();
        assert!(sample.pdf > 0.0 && sample.pdf.is_finite());
        let axes = reader.grid().axes();
        let half = axes.iter().any(|a| a.name == crate::table::grid::AxisName::ThetaH);
        let others = axes.iter().any(|a| a.name as u8 > 4 || a.name as u8 == 0);
        assert_eq!(importance.rings.is_some(), half && !others, "{}", path.display());
        *(if importance.rings.is_some() { &mut with } else { &mut without }) += 1;
    }
    assert!(with > 0 && without > 0, "{with} {without}");
}

#[cfg(feature = "encode")]
mod of_files {
    use super::*;
    use crate::encode::Encoder;
    use crate::table::grid::{Axis, AxisName, Grid, Mapping};
    use crate::table::synth::Recipe;
    use std::f64::consts::FRAC_PI_2;

    fn brdf(name: &str) -> Brdf<Vec<u8>> {
        let axis = |name, len, mapping, end| Axis { name, len, mapping, start: 0.0, end };
        let axes = vec![
            axis(AxisName::ThetaH, 60, Mapping::Square, FRAC_PI_2),
            axis(AxisName::ThetaD, 30, Mapping::Linear, FRAC_PI_2),
            axis(AxisName::PhiD, 24, Mapping::Linear, PI),
        ];
        let grid = Grid::new(axes, Grid::rgb_channels([1.0; 3])).unwrap();
        let table = Recipe::named(name).unwrap().synthesise(&grid).unwrap();
        let bytes = Encoder::new().block_shape(&[15, 15, 24]).encode(&table).unwrap().bytes;
        Brdf::open(Reader::open(bytes).unwrap()).unwrap()
    }

    /// Mean and variance of estimates of the green light that comes back in a white furnace.
    fn furnace(brdf: &Brdf<Vec<u8>>, importance: &Importance, wi: [f64; 3], n: usize) -> [f64; 2] {
        let mut random = SplitMix64(3);
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let Sample { wo, pdf } =
                importance.sample(wi, [uniform(&mut random), uniform(&mut random)]).expect("wi is above the horizon");
            let estimate = f64::from(brdf.eval(wi, wo).unwrap()[1]) * wo[2] / pdf;
            (sum, squares) = (sum + estimate, squares + estimate * estimate);
        }
        let mean = sum / n as f64;
        [mean, squares / n as f64 - mean * mean]
    }

    #[test]
    fn estimates_have_less_noise_than_by_the_cosine_and_no_bias() {
        // Most that the variance may be of that by the cosine, which is as good as any on what is matte, and of the
        // squared mean. Green is a small part of the means of satin paint, which is red.
        let cases = [
            ("matte", f64::INFINITY, 0.05),
            ("satin-paint", 0.5, 0.8),
            ("rough-metal", 0.02, 0.05),
            ("pearl", 0.02, 0.05),
        ];
        for (name, most, relative) in cases {
            let brdf = brdf(name);
            let importance = brdf.importance().unwrap();
            for degrees in [0.0, 30.0, 60.0, 80.0] {
                let wi = elevated(degrees);
                let expected: f64 = integrals(wi, |wo| f64::from(brdf.eval(wi, wo).unwrap()[1]) * wo[2]).iter().sum();
                let n = 20_000;
                let [mean, variance] = furnace(&brdf, &importance, wi, n);
                let [_, by_cosine] = furnace(&brdf, &Importance::cosine(), wi, n);
                assert!(variance < most * by_cosine, "{name} at {degrees}: {}", variance / by_cosine);
                assert!(variance < relative * mean * mean, "{name} at {degrees}: {variance} of {mean}");
                let error = (variance / n as f64).sqrt();
                assert!((mean - expected).abs() < 4.0 * error + 1e-3 * expected, "{name} {degrees}: {mean} {expected}");
            }
        }
    }

    #[test]
    fn a_narrow_lobe_integrates_to_one_and_is_followed() {
        let importance = brdf("mirror-like").importance().unwrap();
        for degrees in ELEVATIONS {
            let wi = elevated(degrees);
            let expected = integrals(wi, |wo| importance.pdf(wi, wo));
            let total: f64 = expected.iter().sum();
            assert!((total - 1.0).abs() < 0.01, "{degrees}: {total}");
            assert!(surprise(&importance, wi, &expected) < LIMIT, "{degrees}");
        }
    }
}
