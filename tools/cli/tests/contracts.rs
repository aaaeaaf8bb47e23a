//! What an encode promises: kept as an independent measure sees it, refused where it cannot be, proved by `verify`.

use std::path::Path;
use std::process::{Command, Stdio};

use csbrdf::assess::proof::prove;
use csbrdf::base::error::Error;
use csbrdf::codec::sample::SplitMix64;
use csbrdf::decode::Reader;
use csbrdf::encode::contract::Contract;
use csbrdf::encode::{Encoder, Preset};
use csbrdf::table::BrdfTable;
use csbrdf::table::grid::Grid;
use csbrdf::table::synth::Recipe;
use proptest::prelude::*;

const EPS: f64 = 1e-3;

fn grid(lens: [usize; 3]) -> Grid {
    Grid::merl().with_lengths(&lens).unwrap()
}

fn table(name: &str) -> BrdfTable {
    Recipe { noise: 0.01, holes: 0.02, ..Recipe::named(name).unwrap() }.synthesise(&grid([18, 18, 30])).unwrap()
}

/// Rms and largest error of ln(f + eps) of a file's table, in the units of the source and then in 1/sr.
fn errors(original: &BrdfTable, bytes: &[u8], eps: f64) -> (f64, f64) {
    let decoded = Reader::open(bytes).unwrap().decode_table().unwrap();
    assert_eq!(decoded.valid(), original.valid());
    let n = original.grid().positions();
    let (mut squares, mut max) = (0.0, 0f64);
    for (i, _) in original.valid().iter().enumerate().filter(|(_, valid)| **valid) {
        let scale = original.grid().channels()[i / n].scale;
        let log = |table: &BrdfTable| ((table.values()[i] * scale).min(f64::MAX) + eps).ln();
        let error = (log(original) - log(&decoded)).abs();
        squares += error * error;
        max = max.max(error);
    }
    ((squares / original.valid_count() as f64).sqrt(), max)
}

fn encode(encoder: Encoder, table: &BrdfTable, contract: Contract) -> Result<Vec<u8>, Error> {
    encoder.contract(contract).encode(table).map(|encoded| encoded.bytes)
}

#[test]
fn no_entry_is_off_by_more_than_the_largest_error() {
    for name in ["satin-paint", "mirror-like"] {
        let table = table(name);
        let mut last = usize::MAX;
        for max_error in [1e-4, 0.01, 0.05, 0.3] {
            let bytes = encode(Encoder::new(), &table, Contract::MaxError(max_error)).unwrap();
            let (_, max) = errors(&table, &bytes, EPS);
            assert!(max <= max_error && max > 0.5 * max_error, "{name} {max_error}: {max}");
            assert!(bytes.len() < last, "{name} {max_error}: {} after {last}", bytes.len());
            last = bytes.len();
        }
    }
}

#[test]
fn corrections_serve_every_preset() {
    let table = table("satin-paint");
    for preset in [Preset::Paper, Preset::Sparse] {
        let encoder = Encoder::new().preset(preset).block_shape(&[9, 9, 15]).iterations(50);
        let bytes = encode(encoder, &table, Contract::MaxError(0.1)).unwrap();
        assert!(errors(&table, &bytes, EPS).1 <= 0.1, "{preset:?}");
    }
}

#[test]
fn rms_errors_are_kept_and_come_near() {
    let table = table("rough-metal");
    for rmse in [0.002, 0.02, 0.1] {
        let bytes = encode(Encoder::new(), &table, Contract::Rmse(rmse)).unwrap();
        let (rms, _) = errors(&table, &bytes, EPS);
        assert!(rms <= rmse && rms > 0.9 * rmse, "{rmse}: {rms}");
    }
}

#[test]
fn sizes_and_ratios_are_kept_and_come_near() {
    let table = table("rough-metal");
    for size in [3_000, 20_000] {
        let bytes = encode(Encoder::new(), &table, Contract::Size(size)).unwrap();
        assert!(bytes.len() as u64 <= size && bytes.len() as u64 > size * 9 / 10, "{size}: {}", bytes.len());
    }
    let bytes = encode(Encoder::new(), &table, Contract::Ratio(40.0)).unwrap();
    let ratio = 8.0 * table.values().len() as f64 / bytes.len() as f64;
    assert!((40.0..44.0).contains(&ratio), "{ratio}");
}

#[test]
fn render_psnr_is_kept() {
    let table = table("satin-paint");
    // At 55 dB a table as small as this is left so few coefficients that one step more or less is worth 4 dB.
    let bytes = encode(Encoder::new(), &table, Contract::Psnr(65.0)).unwrap();
    let decoded = Reader::open(&bytes[..]).unwrap().decode_table().unwrap();
    let [a, b] = [&table, &decoded].map(|table| csbrdf::assess::render::sphere_of_table(table, 128));
    let psnr = csbrdf::assess::render::psnr(&a, &b).unwrap();
    assert!((65.0..67.0).contains(&psnr), "{psnr}");
}

#[test]
fn what_cannot_be_kept_is_refused_with_the_best() {
    let table = table("satin-paint");
    let says = |encoder: Encoder, contract| match encode(encoder, &table, contract) {
        Err(Error::ContractNotMet(what)) => what,
        other => panic!("{:?}", other.map(|bytes| bytes.len())),
    };
    let size = says(Encoder::new(), Contract::Size(200));
    assert!(size.contains("size of 200 bytes") && size.contains("reaches"), "{size}");
    let sampled = Encoder::new().preset(Preset::Paper).block_shape(&[9, 9, 15]).iterations(30);
    let rmse = says(sampled, Contract::Rmse(1e-3));
    assert!(rmse.contains("1.0000e-3"), "{rmse}");
    for contract in [Contract::MaxError(1e-8), Contract::MaxError(f64::NAN), Contract::Rmse(0.0), Contract::Psnr(-1.0)]
    {
        assert!(matches!(encode(Encoder::new(), &table, contract), Err(Error::InvalidArgument(_))), "{contract:?}");
    }
}

/// Every statement of a file about its errors is checked.
#[test]
fn proofs_see_what_is_not_so() {
    let original = table("satin-paint");
    let bytes = encode(Encoder::new(), &original, Contract::MaxError(0.05)).unwrap();
    let reader = Reader::open(&bytes[..]).unwrap();
    let proof = prove(&original, &reader).unwrap();
    assert!(proof.broken.is_empty() && proof.contract == Some(Contract::MaxError(0.05)), "{proof:?}");
    assert_eq!(proof.figures.log_max, errors(&original, &bytes, EPS).1);
    let mut values = original.values().to_vec();
    let at = original.valid().iter().position(|v| *v).unwrap();
    values[at] = values[at] * 1.2 + 1.0;
    let changed = BrdfTable::from_values(original.grid().clone(), values).unwrap();
    let broken = prove(&changed, &reader).unwrap().broken;
    assert!(
        broken.iter().any(|b| b.contains("1 blocks")) && broken.iter().any(|b| b.contains("contract")),
        "{broken:?}"
    );
    let other = BrdfTable::from_values(grid([18, 18, 15]), vec![1.0; 18 * 18 * 15 * 3]).unwrap();
    assert!(prove(&other, &reader).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn arbitrary_tables_keep_the_largest_error(
        lens in prop::array::uniform3(1usize..9), block in prop::array::uniform3(1usize..9), seed in any::<u64>(),
        max_error in 1e-3f64..1.0, exponent in 0i32..40, per_channel in any::<bool>(), dft in any::<bool>(),
    ) {
        let grid = grid(lens);
        let n = grid.positions();
        let mut random = SplitMix64(seed);
        let mut values: Vec<f64> = (0..3 * n)
            .map(|_| {
                let r = random.next_u64();
                let magnitude = 10f64.powi((r >> 8) as i32 % (exponent + 1) - exponent / 2);
                match r % 32 { 0..2 => -magnitude, 2 => f64::NAN, 3..5 => 0.0, 5 => 1e-9, 6 => 1e5, 7..20 => 0.5, _ => magnitude }
            })
            .collect();
        values[0] = 1.0;
        if !per_channel {
            for i in 0..n {
                if values[i].is_nan() || values[i] < 0.0 { values[n + i] = -1.0; values[2 * n + i] = -1.0; }
                else { values[n + i] = values[n + i].abs().min(1e30); values[2 * n + i] = values[2 * n + i].abs().min(1e30); }
            }
        }
        let table = BrdfTable::from_values(grid, values).unwrap();
        let basis = if dft { csbrdf::codec::fourier::Basis::Dft } else { csbrdf::codec::fourier::Basis::Dct };
        let encoder = Encoder::new().basis(basis).block_shape(&block).iterations(20);
        let bytes = encode(encoder, &table, Contract::MaxError(max_error)).unwrap();
        let (_, max) = errors(&table, &bytes, EPS);
        prop_assert!(max <= max_error, "{} {}", max, max_error);
        prop_assert!(Reader::open(&bytes[..]).unwrap().verify().is_empty());
    }
}

/// Runs the tool; gives exit code, standard output and standard error.
fn run(folder: &Path, args: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_csbrdf"))
        .args(args)
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

#[test]
fn the_tool_keeps_refuses_and_proves() {
    let folder = tempfile::tempdir().unwrap();
    let go = |args: &[&str]| run(folder.path(), args);
    for (name, seed) in [("a.binary", "1"), ("b.binary", "2")] {
        let made = go(&["synth", "satin-paint", "--noise", "0.003", "--seed", seed, "-o", name]);
        assert_eq!(made.0, 0, "{made:?}");
    }
    let (code, _, stderr) = go(&["encode", "a.binary", "--max-error", "0.2", "--block", "15,15,30"]);
    assert!(code == 0 && stderr.contains("corrected"), "{stderr}");
    let (code, stdout, _) = go(&["verify", "a.csbrdf", "--against", "a.binary"]);
    assert!(code == 0 && stdout.contains("contract max_error 0.2 kept"), "{stdout}");
    let (code, stdout, stderr) = go(&["verify", "a.csbrdf", "--against", "b.binary"]);
    assert!(code == 1 && stdout.contains("SHA-256") && stderr.contains("word"), "{stdout}{stderr}");

    // A table changed after the file was made.
    let mut bytes = std::fs::read(folder.path().join("a.binary")).unwrap();
    let at = 12 + 8 * 40_000;
    let value = f64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    assert!(value > 0.0);
    bytes[at..at + 8].copy_from_slice(&(value * 1.5 + 100.0).to_le_bytes());
    std::fs::write(folder.path().join("changed.binary"), &bytes).unwrap();
    let (code, stdout, _) = go(&["verify", "a.csbrdf", "--against", "changed.binary"]);
    assert!(code == 1 && stdout.contains("index states"), "{stdout}");
    // A file changed after it was made.
    let mut bytes = std::fs::read(folder.path().join("a.csbrdf")).unwrap();
    let at = bytes.len() - 100;
    bytes[at] ^= 1;
    std::fs::write(folder.path().join("hurt.csbrdf"), &bytes).unwrap();
    assert_eq!(go(&["verify", "hurt.csbrdf", "--against", "a.binary"]).0, 3);

    let (code, _, stderr) = go(&["encode", "a.binary", "--size", "100", "-o", "small.csbrdf", "--block", "15,15,30"]);
    assert!(code == 1 && stderr.contains("size of 100 bytes cannot be kept"), "{stderr}");
    assert!(!folder.path().join("small.csbrdf").exists());
    for args in [
        &["--max-error", "0.1", "--quality", "0.1"][..],
        &["--max-error", "0.1", "--rmse", "0.1"],
        &["--size", "5G"],
        &["--rmse", "0.1", "--quality", "0.1"],
        &["--max-error", "1e-8"],
    ] {
        let (code, _, stderr) = go(&[&["encode", "b.binary"][..], args].concat());
        assert_eq!(code, 2, "{args:?}: {stderr}");
    }
    assert_eq!(go(&["verify", "a.csbrdf", "b.csbrdf", "--against", "a.binary"]).0, 2);
}
