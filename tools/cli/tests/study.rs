//! `csbrdf study` on two synthesised materials: its files, their contents, its refusals.

mod common;

use std::path::Path;
use std::process::{Command, Stdio};

use common::{BAD_INPUT, OK, OPERATION, USAGE};

/// Exit code and standard error of a run; nothing may be on standard output.
fn run(args: &[&str]) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_csbrdf")).args(args).stdin(Stdio::null()).output().unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(!stderr.contains("panicked") && output.stdout.is_empty(), "{stderr}");
    (output.status.code().unwrap(), stderr)
}

#[track_caller]
fn fails(args: &[&str], code: i32, parts: &[&str]) {
    let (got, stderr) = run(args);
    assert_eq!(got, code, "{stderr}");
    assert!(stderr.starts_with("csbrdf: ") && stderr.lines().count() == 1, "{stderr}");
    assert!(parts.iter().all(|part| stderr.contains(part)), "{stderr}");
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Rows of a CSV file as maps from the head; no field here is quoted.
fn csv(path: &Path) -> Vec<std::collections::HashMap<String, String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    lines
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            assert_eq!(fields.len(), head.len(), "{line}");
            head.iter().zip(fields).map(|(h, f)| (h.to_string(), f.to_string())).collect()
        })
        .collect()
}

/// Width, height and number of different bytes of a PNG file.
fn png(path: &Path) -> (u32, u32, usize) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    bytes.sort_unstable();
    bytes.dedup();
    (info.width, info.height, bytes.len())
}

#[test]
fn a_small_study_has_all_figures() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path().join("tables");
    std::fs::create_dir(&folder).unwrap();
    for name in ["matte", "pearl"] {
        let table = folder.join(format!("{name}.binary"));
        assert_eq!(run(&["synth", name, "--noise", "0.003", "-o", table.to_str().unwrap()]).0, OK);
    }
    // A damaged table costs itself, not the study.
    std::fs::write(folder.join("hurt.binary"), [7; 100]).unwrap();
    let (tables, out) = (folder.to_str().unwrap(), temporary.path().join("out"));
    let base = ["study", tables, "--out", out.to_str().unwrap(), "--materials", "matte,pearl"];
    let (code, stderr) = run(&[&base[..], &["--quick", "--ratios", "1%", "--size", "24", "--spp", "4"]].concat());
    assert_eq!(code, BAD_INPUT, "{stderr}");
    assert!(stderr.contains("hurt.binary: ") && stderr.contains("1 of 3 failed"), "{stderr}");

    let gini = csv(&out.join("gini.csv"));
    assert_eq!(gini.iter().map(|r| r["material"].as_str()).collect::<Vec<_>>(), ["matte", "pearl"]);
    for row in &gini {
        let value = |key: &str| row[key].parse::<f64>().unwrap();
        assert!(row["blocks"].parse::<usize>().unwrap() > 300);
        assert!((0.5..1.0).contains(&value("dft_raw")) && (0.5..1.0).contains(&value("dft_log")));
    }
    let negative = csv(&out.join("negative.csv"));
    assert_eq!(negative.len(), 2);
    assert!(negative.iter().all(|r| r["log_negative"] == "0" && r["ratio"] == "0.01"));
    assert!(negative[1]["raw_negative"].parse::<usize>().unwrap() > 0);
    let spheres = csv(&out.join("spheres.csv"));
    for row in &spheres {
        let value = |key: &str| row[key].parse::<f64>().unwrap();
        assert!((10.0..90.0).contains(&value("psnr_objects_db")), "{row:?}");
        assert!((10.0..90.0).contains(&value("psnr_picture_db")) && value("bytes") > 1000.0, "{row:?}");
        assert!((0.005..0.02).contains(&(value("sampled_entries") / value("valid_entries"))));
    }
    let presets: std::collections::BTreeSet<&str> = spheres.iter().map(|r| r["preset"].as_str()).collect();
    assert!(presets.contains("paper") && spheres.len() == 2 * presets.len());
    // Encoded once: the sheet has the spheres' figures.
    let sheet = csv(&out.join("sheet.csv"));
    for (a, b) in spheres.iter().zip(&sheet) {
        assert_eq!((&a["bytes"], &a["psnr_objects_db"]), (&b["bytes"], &b["psnr_objects_db"]));
    }
    let scene = csv(&out.join("scene.csv"));
    assert_eq!((scene.len(), &*scene[0]["material_1"]), (presets.len(), "pearl"));
    assert!((15.0..90.0).contains(&scene[0]["psnr_objects_db"].parse::<f64>().unwrap()));

    let mut pictures = vec![("scene-reference.png".to_string(), (60, 36)), ("negative-matte.png".into(), (544, 180))];
    for preset in &presets {
        pictures.push((format!("spheres-{preset}.png"), (48, 48)));
        pictures.push((format!("sheet-{preset}.png"), (48, 24)));
        pictures.push((format!("scene-{preset}.png"), (120, 36)));
    }
    let page = std::fs::read_to_string(out.join("index.html")).unwrap();
    for (name, size) in &pictures {
        let (width, height, shades) = png(&out.join(name));
        assert!((width, height) == *size && shades > 20, "{name} {width} {height} {shades}");
        assert!(page.contains(&format!("src=\"{name}\"")), "{name}");
    }
    for name in names(&out) {
        assert!(page.contains(&name) || name == "index.html", "{name} is not on the page");
        if name.ends_with(".svg") {
            assert!(std::fs::read_to_string(out.join(&name)).unwrap().ends_with("</svg>\n"), "{name}");
        }
    }
    for part in ["51.63 dB", "hurt", "--materials matte,pearl", "--only scene", "background excluded"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("NaN"));

    // What is there is not replaced unasked.
    fails(&base, OPERATION, &["out", "not empty", "--force"]);
    let before = std::fs::read(out.join("gini.csv")).unwrap();
    let again = [&base[..], &["--quick", "--only", "gini", "--sheet", "2", "--force", "--quiet"]].concat();
    assert_eq!(run(&again), (OK, String::new()));
    assert_eq!(std::fs::read(out.join("gini.csv")).unwrap(), before);
}

#[test]
fn a_study_that_cannot_be_is_refused_at_once() {
    let temporary = tempfile::tempdir().unwrap();
    let at = |name: &str| temporary.path().join(name).to_str().unwrap().to_string();
    let (tables, out) = (at("tables"), at("out"));
    fails(&["study", &tables, "--out", &out], OPERATION, &["tables", "check the path"]);
    std::fs::create_dir(&tables).unwrap();
    fails(&["study", &tables, "--out", &out], OPERATION, &["no .binary file", "csbrdf synth"]);
    std::fs::write(Path::new(&tables).join("a.binary"), [0; 64]).unwrap();
    fails(&["study", &tables, "--out", &out, "--materials", "b"], USAGE, &["no b.binary"]);
    fails(&["study", &tables, "--out", &out, "--only", "scene"], USAGE, &["two materials"]);
    std::fs::write(at("file"), "x").unwrap();
    fails(&["study", &tables, "--out", &at("file"), "--only", "gini"], OPERATION, &["is a file", "name a folder"]);
    let light = |name: &str| run(&["study", &tables, "--out", &out, "--only", "gini", "--environment", &at(name)]);
    let (code, stderr) = light("none.hdr");
    assert!(code == OPERATION && stderr.contains("none.hdr"), "{stderr}");
    std::fs::write(at("bad.hdr"), "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 2\nxx").unwrap();
    let (code, stderr) = light("bad.hdr");
    assert!(code == BAD_INPUT && stderr.contains("bad.hdr") && stderr.contains(".exr"), "{stderr}");
    assert!(!Path::new(&out).exists());
}
