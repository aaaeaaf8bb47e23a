//! The default preset on fits of measured materials, where their data is at hand: `shared/data` beside the checkout,
//! or the folder named by `CSBRDF_DATA`. Says so and passes where it is not.
#![cfg(feature = "encode")]

use csbrdf::codec::sample::{Sampling, SplitMix64};
use csbrdf::encode::{Encoder, Preset};
use csbrdf::table::BrdfTable;
use csbrdf::table::grid::Grid;
use std::path::{Path, PathBuf};

fn data() -> Option<PathBuf> {
    let folder = std::env::var_os("CSBRDF_DATA").map(PathBuf::from);
    let folder = folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"));
    if folder.join("merl-factors.f32").exists() {
        return Some(folder);
    }
    eprintln!("SKIPPED: no merl-factors.f32 in {}; set CSBRDF_DATA to its folder", folder.display());
    None
}

/// A material of the factored fit (Bagher et al. 2016) on MERL's grid, with multiplicative noise.
fn fitted(folder: &Path, material: &str, noise: f64) -> BrdfTable {
    let names = std::fs::read_to_string(folder.join("merl-factors.names")).unwrap();
    let number = names.split_whitespace().position(|name| name == material).expect("a fitted material");
    let bytes = std::fs::read(folder.join("merl-factors.f32")).unwrap();
    let factors: Vec<f64> = bytes[number * 272 * 12..(number + 1) * 272 * 12]
        .chunks_exact(4)
        .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])))
        .collect();
    let grid = Grid::merl();
    let n = grid.positions();
    let mut random = SplitMix64(7);
    let mut uniform = move || ((random.next_u64() >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
    let mut values = vec![-1.0; 3 * n];
    for i in 0..n {
        let (h, d, p) = (i / 180 / 90, i / 180 % 90, i % 180);
        let [theta_h, theta_d, phi_d] = [(0, h), (1, d), (2, p)].map(|(a, bin)| grid.axes()[a].angle(bin as f64 + 0.5));
        let (along, across) = (theta_h.cos() * theta_d.cos(), theta_h.sin() * theta_d.sin() * phi_d.cos());
        let cosines = [along - across, along + across];
        if cosines.iter().any(|&c| c < -0.061) {
            continue;
        }
        for c in 0..3 {
            let at = |row: usize| factors[row * 3 + c];
            // Masking and 1/cos of one direction, tabulated by its elevation in degrees.
            let masking = |cosine: f64| {
                let t = cosine.clamp(1e-4, 1.0).acos().to_degrees() - 0.5;
                let low = t.floor().clamp(1.0, 89.0) as usize;
                let w = t - t.floor();
                (at(92 + low) * (1.0 - w) + at(92 + (low + 1).min(89)) * w) / cosine.max(1e-3)
            };
            let specular = at(1) * at(2 + h) * at(182 + d) * masking(cosines[0]) * masking(cosines[1]);
            let normal = (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos();
            values[c * n + i] = (at(0) + specular) * (noise * normal).exp() / grid.channels()[c].scale;
        }
    }
    BrdfTable::from_values(grid, values).unwrap()
}

#[test]
fn archive_keeps_measured_materials_small_and_close() {
    let Some(folder) = data() else { return };
    // Material, noise, largest log rms, smallest ratio to the MERL file.
    for (material, noise, rms, ratio) in [
        ("alum-bronze", 0.003, 0.011, 900.0),
        ("green-fabric", 0.02, 0.025, 600.0),
        ("chrome-steel", 0.003, 0.011, 900.0),
    ] {
        let table = fitted(&folder, material, noise);
        let encoded = Encoder::new().encode(&table).unwrap();
        let got = 34_992_012.0 / encoded.bytes.len() as f64;
        eprintln!("{material}: {got:.0}:1, log rms {:.5}", encoded.report.log_rms);
        assert!(encoded.report.log_rms <= rms && got >= ratio, "{material}: {got} {}", encoded.report.log_rms);
    }
}

/// From the same samples a quarter of the error of the source paper's setting at most, and as many samples as asked for.
#[test]
fn sparse_recovers_measured_materials_from_few_samples() {
    let Some(folder) = data() else { return };
    for (material, noise, ratio) in [("chrome-steel", 0.003, 0.01), ("green-fabric", 0.02, 0.05)] {
        let table = fitted(&folder, material, noise);
        let encode = |preset| {
            let encoder = Encoder::new().preset(preset).sampling(Sampling::from_ratio(ratio).unwrap());
            encoder.encode(&table).unwrap().report
        };
        let (paper, sparse) = (encode(Preset::Paper), encode(Preset::Sparse));
        eprintln!("{material}: paper {:.4}, sparse {:.4}", paper.log_rms, sparse.log_rms);
        assert!(sparse.log_rms <= 0.25 * paper.log_rms, "{material}: {} {}", sparse.log_rms, paper.log_rms);
        assert_eq!(sparse.sampled, paper.sampled);
    }
    let table = fitted(&folder, "alum-bronze", 0.003);
    let auto = Encoder::new().preset(Preset::Sparse).sampling_for(0.05).encode(&table).unwrap().report;
    assert!(auto.log_rms <= 0.05 && 10 * auto.sampled < auto.valid, "{auto:?}");
}
