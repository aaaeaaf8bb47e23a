//! `csbrdf lint` as its users see it.

mod common;

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;
use std::process::{Command, Stdio};

use common::{BAD_INPUT, OK, OPERATION, USAGE};
use csbrdf::encode::Encoder;
use csbrdf::io::merl::write_merl;
use csbrdf::table::BrdfTable;
use csbrdf::table::grid::{Axis, AxisName, Grid, Mapping};
use serde_json::Value;

/// Exit code, standard output, standard error.
fn lint(args: &[&str]) -> (i32, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_csbrdf"));
    let output = command.arg("lint").args(args).stdin(Stdio::null()).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.code().unwrap(), text(output.stdout), text(output.stderr))
}

fn json(path: &Path) -> Value {
    let (code, stdout, stderr) = lint(&[path.to_str().unwrap(), "--json"]);
    assert_eq!(code, OK, "{stderr}");
    serde_json::from_str(&stdout).unwrap()
}

/// A file whose BRDF is rho / pi everywhere.
fn lambertian(folder: &Path, rho: f64) -> std::path::PathBuf {
    let axis = |name, len, mapping, end| Axis { name, len, mapping, start: 0.0, end };
    let axes = vec![
        axis(AxisName::ThetaH, 18, Mapping::Square, FRAC_PI_2),
        axis(AxisName::ThetaD, 18, Mapping::Linear, FRAC_PI_2),
        axis(AxisName::PhiD, 24, Mapping::Linear, PI),
    ];
    let grid = Grid::new(axes, Grid::rgb_channels([1.0; 3])).unwrap();
    let table = BrdfTable::from_values(grid.clone(), vec![rho / PI; 3 * grid.positions()]).unwrap();
    let path = folder.join(format!("lambertian-{rho}.csbrdf"));
    std::fs::write(&path, Encoder::new().block_shape(&[9, 9, 24]).encode(&table).unwrap().bytes).unwrap();
    path
}

#[test]
fn a_lambertian_surface_has_its_albedo_and_no_warnings() {
    let folder = tempfile::tempdir().unwrap();
    let path = lambertian(folder.path(), 0.6);
    let found = json(&path);
    let albedos = found["albedos"].as_array().unwrap();
    assert_eq!(albedos.len(), 7);
    for albedo in albedos {
        for value in albedo["values"].as_array().unwrap() {
            // The quantiser's error is in it.
            assert!((value.as_f64().unwrap() - 0.6).abs() < 0.006, "{albedo}");
        }
    }
    assert_eq!(found["warnings"].as_array().unwrap().len(), 0);
    assert_eq!((&found["reciprocal_by_grid"], &found["entries"]["missing"]), (&true.into(), &0.into()));
    assert!(found["reciprocity"]["log_max"].as_f64().unwrap() < 1e-3);
    let (code, text, stderr) = lint(&["--strict", path.to_str().unwrap()]);
    assert_eq!((code, stderr.as_str()), (OK, ""));
    assert!(text.contains("albedo, G") && !text.contains("warning"), "{text}");
}

#[test]
fn more_light_than_arrives_is_reported_and_fails_when_strict() {
    let folder = tempfile::tempdir().unwrap();
    let (good, bad) = (lambertian(folder.path(), 0.5), lambertian(folder.path(), 1.1));
    let found = json(&bad);
    assert_eq!(found["warnings"][0]["kind"], "energy");
    assert!((found["largest_albedo"].as_f64().unwrap() - 1.1).abs() < 0.011);
    let files = [bad.to_str().unwrap(), good.to_str().unwrap()];
    let (code, text, stderr) = lint(&files);
    assert_eq!((code, stderr.as_str()), (OK, ""));
    assert!(text.contains("warning") && text.contains("energy: reflects 1."), "{text}");
    let (code, text, stderr) = lint(&[&files[..], &["--strict"]].concat());
    assert_eq!(code, OPERATION);
    // The good one is looked at all the same.
    assert!(stderr.contains("1 warning") && stderr.lines().count() == 1, "{stderr}");
    assert_eq!(text.matches("largest albedo").count(), 2);
}

#[test]
fn tables_are_looked_at_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("one-way.binary");
    let grid = Grid::merl_360();
    // Half of phi_d is brighter than the other: not reciprocal. A tenth is missing.
    let values = (0..3 * grid.positions())
        .map(|i| match i % 10 {
            0 => -1.0,
            _ if i % 360 < 180 => 0.2 / grid.channels()[i / grid.positions()].scale,
            _ => 0.1 / grid.channels()[i / grid.positions()].scale,
        })
        .collect();
    let table = BrdfTable::from_values(grid, values).unwrap();
    write_merl(&table, false, std::fs::File::create(&path).unwrap()).unwrap();
    let found = json(&path);
    let log_max = found["reciprocity"]["log_max"].as_f64().unwrap();
    assert!((log_max - (0.201f64 / 0.101).ln()).abs() < 1e-3, "{found}");
    assert_eq!(found["warnings"][0]["kind"], "reciprocity");
    assert_eq!(found["reciprocal_by_grid"], false);
    let entries = |key: &str| found["entries"][key].as_u64().unwrap() as f64;
    let all = entries("measured") + entries("missing") + entries("impossible");
    assert!((entries("measured") / all - 0.9).abs() < 1e-3 && entries("missing") > 0.0, "{found}");
}

#[test]
fn what_cannot_be_read_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let good = lambertian(folder.path(), 0.4);
    let fails = |bytes: &[u8], code: i32| {
        let path = folder.path().join("bad");
        std::fs::write(&path, bytes).unwrap();
        let (got, stdout, stderr) = lint(&[path.to_str().unwrap(), good.to_str().unwrap()]);
        assert_eq!(got, code, "{stderr}");
        assert!(stderr.starts_with("csbrdf: ") && stderr.lines().count() == 1, "{stderr}");
        // The next file is looked at.
        assert!(stdout.contains("lambertian-0.4"));
    };
    fails(b"", BAD_INPUT);
    fails(b"a text", BAD_INPUT);
    let bytes = std::fs::read(&good).unwrap();
    fails(&bytes[..bytes.len() / 2], BAD_INPUT);
    assert_eq!(lint(&[folder.path().join("none").to_str().unwrap()]).0, OPERATION);
    assert_eq!(lint(&[]).0, USAGE);
    assert_eq!(lint(&["--strikt", "x"]).0, USAGE);
}
