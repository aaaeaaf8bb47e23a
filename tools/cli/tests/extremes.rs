//! Tables that measurements are not like, through the tool: what must come out of each.
//!
//! The tool encodes tables on MERL's grid. Those of other grids come to it as files that the library encoded with the settings that
//! the tool's options stand for; verify, decode, info and compare are the tool's.

mod common;
#[path = "../../../tests/common/extreme_tables.rs"]
mod extreme_tables;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use common::{BAD_INPUT, OK, USAGE};
use csbrdf::assess::metrics::compare;
use csbrdf::decode::Reader;
use csbrdf::table::Table;
use extreme_tables::{Case, MAX_ERROR, cases, grid, settings};
use rayon::prelude::*;
use serde_json::Value;

/// Runs the tool; exit code, standard output, standard error. It is not to die of a signal or a panic, whatever comes.
fn run(args: &[&str]) -> (i32, Vec<u8>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_csbrdf")).args(args).stdin(Stdio::null()).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(!stderr.contains("panicked"), "{args:?}: {stderr}");
    (output.status.code().unwrap_or_else(|| panic!("{args:?}: a signal")), output.stdout, stderr)
}

#[track_caller]
fn ok(args: &[&str]) -> Vec<u8> {
    let (code, stdout, stderr) = run(args);
    assert_eq!(code, OK, "{args:?}: {stderr}");
    stdout
}

/// Asserts a failure that names the file and all of `parts`, in one line.
#[track_caller]
fn fails(args: &[&str], code: i32, parts: &[&str]) {
    let (got, stdout, stderr) = run(args);
    assert_eq!(got, code, "{args:?}: {stderr}");
    assert!(stdout.is_empty() && stderr.lines().count() == 1, "{stderr}");
    parts.iter().for_each(|part| assert!(stderr.contains(part), "{part:?} is not in {stderr:?}"));
}

fn figures(reference: &Path, other: &Path) -> Value {
    let [a, b] = [reference, other].map(|path| path.to_str().unwrap());
    serde_json::from_slice(&ok(&["compare", a, b, "--json", "--render", "0"])).unwrap()
}

/// Values of an .npy file of float32.
fn npy(bytes: &[u8]) -> Vec<f32> {
    let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    bytes[end..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// Everything that must hold of a case's file under some settings.
fn check(case: &Case, at: &Path, setting: &str, every_entry: bool) {
    let what = format!("{}, {setting}", case.name);
    let file = at.to_str().unwrap();
    assert!(String::from_utf8(ok(&["verify", file])).unwrap().contains(": ok, "), "{what}");

    // What was measured comes back as something a renderer can use, and what was not comes back as -1 unless it is to be filled in.
    let marked = npy(&ok(&["decode", file, "--format", "npy", "-o", "-"]));
    let filled = npy(&ok(&["decode", file, "--format", "npy", "-o", "-", "--fill"]));
    assert_eq!((marked.len(), filled.len()), (case.table.values().len(), case.table.values().len()), "{what}");
    for ((&marked, &filled), &valid) in marked.iter().zip(&filled).zip(case.table.valid()) {
        assert!(filled.is_finite() && filled >= 0.0, "{what}: {filled}");
        assert!(if valid { marked.to_bits() == filled.to_bits() } else { marked == -1.0 }, "{what}: {marked} {filled}");
    }

    let reader = Reader::open(std::fs::read(at).unwrap()).unwrap();
    let decoded = reader.decode_table().unwrap();
    assert_eq!(decoded.valid(), case.table.valid(), "{what}: validity");
    assert!(decoded.values().iter().all(|v| v.is_finite() && *v >= 0.0), "{what}");
    let errors = compare(&case.table, &decoded).unwrap().overall;
    assert!(errors.log_rms.is_finite() && errors.log_max.is_finite(), "{what}: {errors:?}");
    if every_entry {
        assert!(errors.log_max <= case.log_max, "{what}: log max {}", errors.log_max);
        let zeros = case.table.values().iter().zip(decoded.values());
        assert!(zeros.filter(|(source, _)| **source == 0.0).all(|(_, back)| back.to_bits() == 0), "{what}: zeros");
    }
    if setting.starts_with("--max-error") {
        assert!(errors.log_max <= MAX_ERROR, "{what}: log max {}", errors.log_max);
    }
    if setting == "--lossless" {
        assert_eq!(bits(&reader.source_table().unwrap()), bits(case.table.values()), "{what}");
    }
}

#[test]
fn every_table_comes_back_as_stated() {
    let folder = tempfile::tempdir().unwrap();
    cases().par_iter().enumerate().for_each(|(number, case)| {
        let path = |setting: usize| folder.path().join(format!("{number}-{setting}.csbrdf"));
        for (i, (setting, encoder, every_entry)) in settings().into_iter().enumerate() {
            let encoded = encoder.encode(&case.table).unwrap_or_else(|e| panic!("{}, {setting}: {e}", case.name));
            std::fs::write(path(i), encoded.bytes).unwrap();
            check(case, &path(i), setting, every_entry);
        }
        let info: Value = serde_json::from_slice(&ok(&["info", "--json", path(0).to_str().unwrap()])).unwrap();
        assert_eq!(info["bytes"].as_u64(), Some(std::fs::metadata(path(0)).unwrap().len()), "{}", case.name);
        let same = figures(&path(0), &path(0));
        assert_eq!(same["overall"]["log_max"].as_f64(), Some(0.0), "{}", case.name);
        assert_eq!(same["overall"]["compared"].as_u64(), Some(case.table.valid_count() as u64), "{}", case.name);
        // Of the file that keeps all within MAX_ERROR and the default one: no further apart than both are from the table.
        let apart = figures(&path(3), &path(0));
        assert!(apart["overall"]["log_max"].as_f64().unwrap() <= case.log_max + MAX_ERROR, "{}: {apart}", case.name);
        assert_eq!((apart["only_in_reference"].as_u64(), apart["only_in_other"].as_u64()), (Some(0), Some(0)));
    });
}

/// A MERL .binary file whose first 12 x 12 x 12 bins hold `value` by channel and number within, all others `rest`.
fn merl(at: &Path, rest: f64, value: &dyn Fn(usize, usize) -> f64) -> Vec<u8> {
    const PHI_D: usize = 180;
    let n = 90 * 90 * PHI_D;
    let mut bytes: Vec<u8> = [90i32, 90, 180].iter().flat_map(|len| len.to_le_bytes()).collect();
    bytes.extend(rest.to_le_bytes().repeat(3 * n));
    for (c, i) in (0..3 * 1728).map(|i| (i / 1728, i % 1728)) {
        let place = c * n + (i / 144 * 90 + i / 12 % 12) * PHI_D + i % 12;
        bytes[12 + 8 * place..][..8].copy_from_slice(&value(c, i).to_le_bytes());
    }
    std::fs::write(at, &bytes).unwrap();
    bytes
}

#[test]
fn merl_tables_go_through_the_tool_as_stated() {
    /// Name, what fills the table, what is in its corner, options, and the largest error; below 0 if none is stated.
    type Row = (&'static str, f64, fn(usize, usize) -> f64, &'static [&'static str], f64);
    const BLOCKS: [&str; 2] = ["--block", "15,15,15"];
    let sampled = |c, i| if c == 2 { -1.0 } else { extreme_tables::smooth(i) };
    let rows: [Row; 2] = [
        ("sampled", f64::NEG_INFINITY, sampled, &["--preset", "paper"], -1.0),
        ("bits", f64::from_bits(0xFFF8_0000_0000_BEEF), odd_bits, &["--fast", "--lossless"], 0.2),
    ];
    let folder = tempfile::tempdir().unwrap();
    rows.par_iter().for_each(|(name, rest, value, options, log_max)| {
        let [source, file, back] =
            ["binary", "csbrdf", "back.binary"].map(|extension| folder.path().join(format!("{name}.{extension}")));
        let [source_name, file_name, back_name] = [&source, &file, &back].map(|path| path.to_str().unwrap());
        let bytes = merl(&source, *rest, value);
        ok(&[&["encode", source_name, "--quiet"], &BLOCKS[..], options].concat());
        ok(&["verify", file_name, "--against", source_name]);
        ok(&["decode", file_name, "-o", back_name]);
        let compared = figures(&source, &back);
        let [largest, rms] = ["log_max", "log_rms"].map(|name| compared["overall"][name].as_f64().unwrap());
        assert!(largest.is_finite() && rms <= largest, "{name}: {compared}");
        assert!(*log_max < 0.0 || largest <= *log_max, "{name}: {compared}");
        assert_eq!((compared["only_in_reference"].as_u64(), compared["only_in_other"].as_u64()), (Some(0), Some(0)));
        if options.contains(&"--lossless") {
            assert!(ok(&["decode", file_name, "--exact", "-o", "-"]) == bytes, "{name}");
        }
    });

    let void = folder.path().join("void.binary");
    merl(&void, f64::NAN, &|_, i| if i % 2 == 0 { -1.0 } else { f64::INFINITY });
    fails(&["encode", void.to_str().unwrap()], BAD_INPUT, &["void.binary", "no entry is valid"]);
    assert!(!void.with_extension("csbrdf").exists());
}

/// Zeros of both signs, NaN of many bits, denormals, and numbers.
fn odd_bits(c: usize, i: usize) -> f64 {
    match i % 6 {
        0 => 0.0,
        1 => -0.0,
        2 => f64::from_bits(0x7FF0_0000_0000_0001 + (c * 1728 + i) as u64),
        3 => f64::from_bits(1 + i as u64),
        4 => f64::from_bits(0xFFF0_0000_0000_0000 + i as u64),
        _ => extreme_tables::smooth(i),
    }
}

#[test]
fn what_is_not_on_merls_grid_has_no_binary_form() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("spectral.csbrdf");
    let (file, case) = (file.to_str().unwrap(), &cases()[0]);
    std::fs::write(file, csbrdf::encode::Encoder::new().lossless(true).encode(&case.table).unwrap().bytes).unwrap();
    fails(&["decode", file, "-o", "-", "--format", "binary"], USAGE, &["not on MERL's grid", ".npy"]);
    fails(&["decode", file, "-o", "-", "--exact"], USAGE, &["not a MERL table"]);
}

#[test]
fn channels_and_bins_beyond_the_limits_are_refused() {
    let refused = |lens: &[usize], count| grid(lens, count).unwrap_err().to_string();
    assert!(refused(&[1], 4097).contains("1 to 4096 channels, not 4097"));
    assert!(refused(&[1], 5_000_000).contains("1 to 4096 channels, not 5000000"));
    assert!(refused(&[65537], 1).contains("1 to 65536"));
    assert!(refused(&[0, 1, 1], 1).contains("0 bins"));
    assert!(refused(&[65536, 65536, 65536], 1).contains("positions, at most"));
    assert!(refused(&[65536, 65536, 65536, 65536], 1).contains("positions, at most"));

    // A file that claims them, all its checksums right: refused before anything is allocated for it.
    let table = Table::from_values(grid(&[3, 4, 5], 2).unwrap(), vec![1.0; 120]).unwrap();
    let bytes = csbrdf::encode::Encoder::new().encode(&table).unwrap().bytes;
    let sections = usize::from(u16::from_le_bytes([bytes[14], bytes[15]]));
    let first = 32 + 20 * sections;
    assert_eq!(&bytes[32..36], b"GRID");
    let length = u64::from_le_bytes(bytes[40..48].try_into().unwrap()) as usize;
    let channels = first + 1 + 24 * 3;
    assert_eq!(bytes[channels..channels + 2], [2, 0]);
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("claims.csbrdf");
    // Three channels are none too many, and not there; 65,535 are.
    for (claimed, bins, part) in [
        (3u16, 5u32, "GRID"),
        (65535, 5, "channels"),
        (2, 65537, "bins"),
        (2, u32::MAX, "bins"),
        (2, 0, "bins"),
        (2, 65536, "PART"),
    ] {
        let mut bytes = bytes.clone();
        bytes[channels..channels + 2].copy_from_slice(&claimed.to_le_bytes());
        bytes[channels - 20..channels - 16].copy_from_slice(&bins.to_le_bytes());
        let crc = crc32fast::hash(&bytes[first..first + length]);
        bytes[48..52].copy_from_slice(&crc.to_le_bytes());
        let crc = crc32fast::hash(&[&bytes[..28], &bytes[32..first]].concat());
        bytes[28..32].copy_from_slice(&crc.to_le_bytes());
        std::fs::write(&path, bytes).unwrap();
        for command in ["info", "verify"] {
            fails(&[command, path.to_str().unwrap()], BAD_INPUT, &["claims.csbrdf", part]);
        }
    }
}
