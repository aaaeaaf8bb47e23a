//! The encoder's bits: SHA-256 of what it writes of synthetic tables, by preset, effort and contract, so that a change that should
//! change no bits can be seen to change none.
//!
//! An encoder's choices hang on sums whose last bits differ between processors and C libraries, so this is for one machine and a
//! person, before and after a change:
//!
//!     ENCODED=target/before.txt cargo test --release --test encoded -- --ignored   # writes the file where there is none
//!     ENCODED=target/before.txt cargo test --release --test encoded -- --ignored   # afterwards compares with it
//!
//! Without the variable `tests/data/encoded.txt` is compared with, which was made on an x86-64 with AVX-512.
#![cfg(feature = "encode")]

use std::fmt::Write;
use std::path::{Path, PathBuf};

use csbrdf::decode::Reader;
use csbrdf::encode::contract::Contract;

use csbrdf::codec::sample::Sampling;
use csbrdf::edit::prune::Pruner;
use csbrdf::encode::{Effort, Encoder, Preset};
use csbrdf::table::BrdfTable;
use csbrdf::table::grid::{Axis, AxisName, Channel, Grid, Mapping};
use csbrdf::table::synth::Recipe;
use sha2::{Digest, Sha256};

/// MERL's axes with fewer bins; the same with an azimuth of the half vector and seven wavelengths.
fn tables() -> Vec<(&'static str, BrdfTable)> {
    let small = Grid::merl().with_lengths(&[30, 30, 60]).unwrap();
    let of = |name: &str, noise, holes| Recipe { noise, holes, ..Recipe::named(name).unwrap() };
    let quarter = std::f64::consts::FRAC_PI_2;
    let axis = |name, len, end| Axis { name, len, mapping: Mapping::Linear, start: 0.0, end };
    let axes = vec![
        axis(AxisName::ThetaH, 9, quarter),
        axis(AxisName::PhiH, 8, 4.0 * quarter),
        axis(AxisName::ThetaD, 8, quarter),
        axis(AxisName::PhiD, 12, 2.0 * quarter),
    ];
    let channel = |i: usize| Channel { name: format!("{i}"), scale: 1.0, wavelength: Some(400.0 + 50.0 * i as f64) };
    let spectral = Grid::new(axes, (0..7).map(channel).collect()).unwrap();
    vec![
        ("matte", of("matte", 0.0, 0.0).synthesise(&small).unwrap()),
        ("satin-paint", of("satin-paint", 0.003, 0.0).synthesise(&small).unwrap()),
        ("pearl", of("pearl", 0.02, 0.1).synthesise(&small).unwrap()),
        ("rough-metal", of("rough-metal", 0.003, 0.3).synthesise(&small).unwrap()),
        ("mirror-like", of("mirror-like", 0.003, 0.0).synthesise(&small).unwrap()),
        ("spectral", of("pearl", 0.003, 0.05).synthesise(&spectral).unwrap()),
    ]
}

/// Settings with names.
fn settings() -> Vec<(String, Encoder)> {
    let mut settings = Vec::new();
    for (effort_name, effort) in
        [("fast", Effort::Fast), ("standard", Effort::Standard), ("thorough", Effort::Thorough)]
    {
        for (name, preset) in [("archive", Preset::Archive), ("paper", Preset::Paper), ("sparse", Preset::Sparse)] {
            settings.push((format!("{name} {effort_name}"), Encoder::new().preset(preset).effort(effort)));
        }
        let contracts = [
            ("max-error", Contract::MaxError(0.05)),
            ("rmse", Contract::Rmse(0.004)),
            ("psnr", Contract::Psnr(60.0)),
            ("size", Contract::Size(4000)),
            ("ratio", Contract::Ratio(300.0)),
        ];
        for (name, contract) in contracts {
            settings.push((format!("{name} {effort_name}"), Encoder::new().contract(contract).effort(effort)));
        }
    }
    let fast = || Encoder::new().effort(Effort::Fast);
    settings.extend([
        ("lossless".into(), fast().lossless(true)),
        ("spare".into(), fast().spare(true)),
        ("no profile".into(), fast().profile(false)),
        ("blocks".into(), fast().block_shape(&[5, 7, 9])),
        ("a third".into(), fast().sampling(Sampling::from_ratio(0.3).unwrap())),
        ("for rms".into(), fast().preset(Preset::Sparse).sampling_for(0.05)),
        ("no trend".into(), fast().preset(Preset::Sparse).trend(false)),
    ]);
    settings
}

/// A line a file: what it is of, its bytes and SHA-256; or why it could not be made.
fn sums() -> String {
    let mut text = String::new();
    let mut line = |what: &str, bytes: Result<Vec<u8>, csbrdf::Error>| {
        match bytes {
            Ok(bytes) => {
                let sum: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
                writeln!(text, "{what}: {} {sum}", bytes.len())
            }
            Err(e) => writeln!(text, "{what}: {e}"),
        }
        .unwrap();
    };
    for (name, table) in tables() {
        for (setting, encoder) in settings() {
            line(&format!("{name} {setting}"), encoder.encode(&table).map(|encoded| encoded.bytes));
        }
        let whole = fast_bytes(&table);
        let pruned = Pruner::new().detail(0.02).prune(&Reader::open(&whole[..]).unwrap());
        line(&format!("{name} pruned"), pruned.map(|pruned| pruned.bytes));
    }
    text
}

fn fast_bytes(table: &BrdfTable) -> Vec<u8> {
    Encoder::new().effort(Effort::Fast).encode(table).unwrap().bytes
}

#[test]
#[ignore = "for one machine, before and after a change: some minutes"]
fn the_encoder_writes_the_bits_that_it_wrote() {
    let usual = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/encoded.txt");
    let path = std::env::var_os("ENCODED").map_or(usual, PathBuf::from);
    let found = sums();
    if !path.exists() {
        std::fs::write(&path, found).unwrap();
        println!("{} written", path.display());
        return;
    }
    let wanted = std::fs::read_to_string(&path).unwrap();
    for (found, wanted) in found.lines().zip(wanted.lines()) {
        assert_eq!(found, wanted);
    }
    assert_eq!(found.lines().count(), wanted.lines().count());
}
