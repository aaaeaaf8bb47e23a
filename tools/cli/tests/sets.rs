//! Sets as their users see them: a folder of tables in, files and a manifest out; what verify finds in it.

mod common;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use common::{BAD_INPUT, FAST, OK, OPERATION, UNSUPPORTED, USAGE};
use serde_json::Value;
use tempfile::TempDir;

/// The materials of the tables, in the order of their files.
const NAMES: [&str; 3] = ["mirror-like", "pearl", "satin-paint"];

struct Run {
    code: i32,
    stdout: String,
    stderr: String,
}

impl Run {
    #[track_caller]
    fn expect(self, code: i32) -> Run {
        assert_eq!(self.code, code, "stdout: {} stderr: {}", self.stdout, self.stderr);
        self
    }

    /// Asserts that standard error has a line with all of `parts`.
    #[track_caller]
    fn says(self, parts: &[&str]) -> Run {
        let found = self.stderr.lines().any(|line| parts.iter().all(|part| line.contains(part)));
        assert!(found, "no line with {parts:?} in {:?}", self.stderr);
        self
    }
}

fn run(args: &[&str]) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_csbrdf"));
    command.args(args).stdin(Stdio::null()).current_dir(env!("CARGO_TARGET_TMPDIR"));
    let output = command.output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    let run = Run { code: output.status.code().unwrap(), stdout: text(output.stdout), stderr: text(output.stderr) };
    assert!(!run.stderr.contains("panicked"), "{}", run.stderr);
    run
}

/// Tables in a folder, and the set that they become; made once, not to be changed.
struct Fixture {
    tables: PathBuf,
    set: PathBuf,
    stderr: String,
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn fixture() -> &'static Fixture {
    static FIXTURE: OnceLock<Fixture> = OnceLock::new();
    FIXTURE.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sets");
        let (tables, set) = (folder.join("tables"), folder.join("set"));
        let _ = std::fs::remove_dir_all(&folder);
        // Neither a folder within, nor a hidden file, nor a file of another kind is a table.
        std::fs::create_dir_all(tables.join("within.binary")).unwrap();
        std::fs::write(tables.join("._hidden.binary"), "x").unwrap();
        std::fs::write(tables.join("notes.txt"), "x").unwrap();
        for name in NAMES {
            let table = tables.join(format!("{name}.binary"));
            run(&["synth", name, "-o", text(&table), "--noise", "0.003"]).expect(OK);
        }
        let args = ["encode", text(&tables), "--out-dir", text(&set), "--jobs", "2", "--meta", "licence=CC0-1.0"];
        let made = run(&[&args[..], &FAST].concat()).expect(OK);
        assert!(made.stdout.is_empty());
        Fixture { tables, set, stderr: made.stderr }
    })
}

/// A copy of the set, to be changed.
fn copy() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    for name in names(&fixture().set) {
        std::fs::copy(fixture().set.join(&name), folder.path().join(&name)).unwrap();
    }
    let manifest = folder.path().join("manifest.json");
    (folder, manifest)
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn manifest(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Changes the manifest.
fn edit(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut value = manifest(path);
    change(&mut value);
    std::fs::write(path, value.to_string()).unwrap();
}

#[test]
fn a_folder_becomes_files_and_a_manifest() {
    let f = fixture();
    assert_eq!(names(&f.set), ["manifest.json", "mirror-like.csbrdf", "pearl.csbrdf", "satin-paint.csbrdf"]);
    let rows: Vec<&str> = f.stderr.lines().filter(|l| l.contains(":1 ")).collect();
    assert!(rows.len() == 3 && NAMES.iter().zip(&rows).all(|(n, row)| row.contains(n)), "{}", f.stderr);
    let last = f.stderr.lines().last().unwrap();
    assert!(last.contains("manifest.json: 3 materials, "), "{last}");
    let value = manifest(&f.set.join("manifest.json"));
    assert_eq!((&value["format"], &value["version"]), (&"csbrdf-manifest".into(), &1.into()));
    for (i, name) in NAMES.iter().enumerate() {
        let m = &value["materials"][i];
        let (file, table) = (f.set.join(format!("{name}.csbrdf")), f.tables.join(format!("{name}.binary")));
        assert_eq!((&m["name"], &m["file"]), (&Value::from(*name), &format!("{name}.csbrdf").into()));
        assert_eq!(m["bytes"], std::fs::metadata(&file).unwrap().len());
        assert_eq!(m["source_file"], format!("{name}.binary"));
        assert_eq!((m["metadata"].to_string(), &m["step"]), (r#"{"licence":"CC0-1.0"}"#.into(), &0.5.into()));
        // The file itself says the same.
        let own: Value = serde_json::from_str(&run(&["info", "--json", text(&file)]).expect(OK).stdout).unwrap();
        assert_eq!(own["metadata"]["source_sha256"], m["source_sha256"]);
        assert_eq!((&own["errors"]["log_rms"], &own["errors"]["log_max"]), (&m["log_rms"], &m["log_max"]));
        assert_eq!(own["metadata"]["encoder"]["valid"], m["valid"]);
        assert_eq!((m["entries"].as_u64(), table.exists()), (Some(90 * 90 * 180 * 3), true));
        assert_eq!((m["sha256"].as_str().unwrap().len(), m.get("contract")), (64, None));
    }
}

#[test]
fn bytes_depend_neither_on_jobs_nor_on_threads_or_how_tables_are_named() {
    let f = fixture();
    let out = tempfile::tempdir().unwrap();
    let list: Vec<PathBuf> = NAMES.iter().map(|name| f.tables.join(format!("{name}.binary"))).collect();
    let list: Vec<&str> = list.iter().map(|path| text(path)).collect();
    for (jobs, inputs) in [("1", vec![text(&f.tables)]), ("3", list)] {
        let args = ["--out-dir", text(out.path()), "--jobs", jobs, "--threads", "1", "--meta", "licence=CC0-1.0"];
        let args = [&["encode", "--manifest", "--force"], &inputs[..], &args, &FAST].concat();
        run(&args).expect(OK);
        assert_eq!(names(out.path()), names(&f.set));
        for name in names(&f.set) {
            assert!(
                std::fs::read(out.path().join(&name)).unwrap() == std::fs::read(f.set.join(&name)).unwrap(),
                "{name}"
            );
        }
    }
}

#[test]
fn a_set_verifies_alone_and_against_its_tables() {
    let f = fixture();
    let path = f.set.join("manifest.json");
    let alone = run(&["verify", text(&path)]).expect(OK);
    assert!(alone.stderr.is_empty() && alone.stdout.lines().count() == 4, "{}", alone.stdout);
    assert!(alone.stdout.lines().last().unwrap().contains("manifest.json: ok, 3 materials"));
    let against = run(&["verify", text(&path), "--against", text(&f.tables)]).expect(OK);
    assert_eq!(against.stdout.matches("no contract stated").count(), 3, "{}", against.stdout);
    assert!(run(&["verify", "--quiet", text(&path)]).expect(OK).stdout.is_empty());

    let empty = tempfile::tempdir().unwrap();
    let missing = run(&["verify", text(&path), "--against", text(empty.path())]).expect(OPERATION);
    missing.says(&["pearl.binary", "no such file"]).says(&["3 of 3 failed"]);
    run(&["verify", text(&path), "--against", text(&path)]).expect(OPERATION).says(&["is not a folder"]);
    // The tables under each other's names.
    for (i, name) in NAMES.iter().enumerate() {
        let table = f.tables.join(format!("{}.binary", NAMES[(i + 1) % 3]));
        std::os::unix::fs::symlink(table, empty.path().join(format!("{name}.binary"))).unwrap();
    }
    let swapped = run(&["verify", text(&path), "--against", text(empty.path())]).expect(OPERATION);
    assert_eq!(swapped.stdout.matches("is not the table that the file was made from").count(), 3);
}

#[test]
fn damaged_missing_swapped_and_extra_files_are_named() {
    let (folder, manifest) = copy();
    let verify = |code| run(&["verify", text(&manifest)]).expect(code);
    let file = |name: &str| folder.path().join(format!("{name}.csbrdf"));
    let original = std::fs::read(file("pearl")).unwrap();

    let mut bytes = original.clone();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    std::fs::write(file("pearl"), &bytes).unwrap();
    let flipped = verify(BAD_INPUT).says(&["pearl.csbrdf: has SHA-256"]).says(&["1 of 3 failed"]);
    // Which block it is, and that the others are well.
    assert!(flipped.stdout.contains("pearl.csbrdf: ") && flipped.stdout.matches(": ok").count() == 2);

    std::fs::write(file("pearl"), &original[..original.len() - 1]).unwrap();
    verify(BAD_INPUT).says(&["pearl.csbrdf: has ", " bytes, the manifest states "]);

    std::fs::remove_file(file("pearl")).unwrap();
    verify(OPERATION).says(&["pearl.csbrdf: is missing"]).says(&["1 of 3 failed"]);

    std::fs::rename(file("satin-paint"), file("pearl")).unwrap();
    std::fs::write(file("satin-paint"), &original).unwrap();
    verify(BAD_INPUT)
        .says(&["pearl.csbrdf: holds the bytes of satin-paint.csbrdf"])
        .says(&["satin-paint.csbrdf: holds the bytes of pearl.csbrdf"]);

    let (folder, manifest) = copy();
    std::fs::write(folder.path().join("other.csbrdf"), &original).unwrap();
    let extra = run(&["verify", text(&manifest)]).expect(OPERATION);
    extra.says(&["other.csbrdf: is not in the manifest"]).says(&["0 of 3 failed, 1 not in the manifest"]);
}

#[test]
fn a_manifest_that_says_otherwise_is_found_out() {
    let verify = |change: &dyn Fn(&mut Value), code| {
        let (_folder, path) = copy();
        edit(&path, change);
        run(&["verify", text(&path)]).expect(code)
    };
    // Reordered keys and new ones are no change.
    verify(&|m| m["materials"][0]["colour"] = "red".into(), OK);
    verify(&|m| m["materials"][1]["log_rms"] = 1e-9.into(), BAD_INPUT)
        .says(&["pearl.csbrdf: the manifest says otherwise: log_rms is"]);
    verify(&|m| m["materials"][1]["valid"] = 7.into(), BAD_INPUT).says(&["valid is", "not 7"]);
    verify(&|m| m["materials"][0]["file"] = "../x.csbrdf".into(), BAD_INPUT).says(&["is not the name of a file"]);
    verify(&|m| m["materials"][0]["file"] = "pearl.csbrdf".into(), BAD_INPUT).says(&["is listed twice"]);
    verify(&|m| m["materials"][0]["sha256"] = "00FF".into(), BAD_INPUT).says(&["\"00FF\" is no SHA-256"]);
    verify(&|m| m["materials"][0]["step"] = 1e300.into(), BAD_INPUT).says(&["out of range"]);
    verify(&|m| m["version"] = 2.into(), UNSUPPORTED).says(&["manifest version 2"]);
    verify(&|m| m["format"] = "x".into(), BAD_INPUT).says(&["is no manifest of csbrdf files"]);
    verify(&|m| drop(m["materials"][2].as_object_mut().unwrap().remove("sha256")), BAD_INPUT).says(&["`sha256`"]);
}

#[test]
fn a_failing_table_does_not_lose_the_others() {
    let f = fixture();
    let (tables, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    std::fs::write(tables.path().join("bad.binary"), "no table").unwrap();
    for name in &NAMES[..2] {
        let name = format!("{name}.binary");
        std::fs::copy(f.tables.join(&name), tables.path().join(name)).unwrap();
    }
    let args = ["encode", text(tables.path()), "--out-dir", text(out.path())];
    let made = run(&[&args[..], &FAST].concat()).expect(BAD_INPUT);
    let made =
        made.says(&["bad.binary: is a text file"]).says(&["1 of 3 failed"]).says(&["manifest.json: 2 materials"]);
    assert!(made.stderr.lines().next().unwrap().contains("bad.binary"));
    assert_eq!(names(out.path()), ["manifest.json", "mirror-like.csbrdf", "pearl.csbrdf"]);
    let path = out.path().join("manifest.json");
    run(&["verify", text(&path)]).expect(OK);

    // Nothing is replaced without --force, and nothing is begun.
    let other = ["--block", "15,15,15", "--quality", "0.6"];
    run(&[&args[..], &other].concat()).expect(OPERATION).says(&["manifest.json: exists already", "--force"]);
    // A file in the way fails alone, and no manifest is written that would not list it.
    std::fs::remove_file(&path).unwrap();
    std::fs::remove_file(out.path().join("pearl.csbrdf")).unwrap();
    std::fs::write(out.path().join("mirror-like.csbrdf"), "precious").unwrap();
    let again = run(&[&args[..], &FAST, &["--quiet"]].concat()).expect(BAD_INPUT);
    assert!(again.says(&["mirror-like.csbrdf: exists already"]).stderr.lines().count() == 2);
    assert_eq!(names(out.path()), [".csbrdf-set.jsonl", "mirror-like.csbrdf", "pearl.csbrdf"]);
    assert_eq!(std::fs::read(out.path().join("mirror-like.csbrdf")).unwrap(), b"precious");

    // Of nothing there is no manifest.
    let none = tempfile::tempdir().unwrap();
    let bad = tables.path().join("bad.binary");
    run(&["encode", text(&bad), "--manifest", "--out-dir", text(none.path())]).expect(BAD_INPUT);
    assert!(names(none.path()).is_empty());
}

#[test]
fn contracts_are_in_the_manifest_and_in_the_table() {
    let f = fixture();
    let out = tempfile::tempdir().unwrap();
    let table = f.tables.join("satin-paint.binary");
    let args = ["encode", text(&table), "--out-dir", text(out.path()), "--manifest", "--force", "--block", "15,15,15"];
    for (option, asked, name) in [("--max-error", "0.3", "max_error"), ("--size", "60k", "bytes")] {
        run(&[&args[..], &[option, asked]].concat()).expect(OK);
        let path = out.path().join("manifest.json");
        let value = manifest(&path);
        let kept = &value["materials"][0]["contract"];
        assert_eq!((&kept["name"], value["materials"].as_array().unwrap().len()), (&name.into(), 1));
        let bound = if name == "bytes" { 60_000.0 } else { 0.3 };
        assert_eq!(kept["asked"].as_f64(), Some(bound));
        assert!(kept["achieved"].as_f64().unwrap() <= bound && kept["achieved"].as_f64().unwrap() > 0.5 * bound);
        run(&["verify", text(&path), "--against", text(&f.tables)]).expect(OK);
        assert!(run(&["info", text(&path)]).expect(OK).stdout.contains(name));
        edit(&path, |m| m["materials"][0]["contract"]["asked"] = 0.25.into());
        run(&["verify", text(&path)]).expect(BAD_INPUT).says(&["the manifest says otherwise"]);
    }
}

#[test]
fn info_prints_a_table_or_the_object() {
    let path = fixture().set.join("manifest.json");
    let table = run(&["info", text(&path)]).expect(OK).stdout;
    let rows: Vec<&str> = table.lines().filter(|line| line.contains(":1")).collect();
    assert!(rows.len() == 4 && rows[3].starts_with("3 files"), "{table}");
    assert!(NAMES.iter().zip(&rows).all(|(name, row)| row.starts_with(name)), "{table}");
    let both = run(&["info", "--json", text(&path), text(&fixture().set.join("satin-paint.csbrdf"))]).expect(OK).stdout;
    let objects: Vec<Value> = both.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!((&objects[0], objects.len()), (&manifest(&path), 2));
    run(&["info", "--blocks", text(&path)]).expect(USAGE).says(&["--blocks"]);

    // A name wider than any column: 16 bits of width are what Rust formats.
    let (_folder, path) = copy();
    edit(&path, |m| m["materials"][0]["name"] = "x".repeat(100_000).into());
    let table = run(&["info", text(&path)]).expect(OK).stdout;
    assert!(table.len() < 102_000 && table.contains(&"x".repeat(100_000)));
}

#[test]
fn wrong_usage_is_told() {
    let f = fixture();
    let (tables, empty) = (text(&f.tables), tempfile::tempdir().unwrap());
    let file = f.set.join("satin-paint.csbrdf");
    run(&["encode", tables]).expect(USAGE).says(&["--out-dir DIR"]);
    run(&["encode", tables, "-o", "x.csbrdf"]).expect(USAGE).says(&["--out-dir DIR"]);
    run(&["encode", tables, tables, "--out-dir", "x"]).expect(USAGE).says(&["would both become"]);
    run(&["encode", "a.binary", "--manifest"]).expect(USAGE);
    run(&["encode", tables, "--out-dir", "x", "--jobs", "0"]).expect(USAGE);
    run(&["encode", text(empty.path()), "--out-dir", "x"]).expect(OPERATION).says(&["no .binary file in it"]);
    run(&["verify", text(&file), "--against", tables]).expect(OPERATION).says(&["is a directory"]);
    assert!(!Path::new(env!("CARGO_TARGET_TMPDIR")).join("x").exists());
}

/// A set of format 1.0 and its manifest, read forever. CRC-32s of the binary32 values by `spec/decode.py`.
#[test]
fn the_golden_set_is_as_it_was() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/v1/set");
    run(&["verify", text(&folder.join("manifest.json"))]).expect(0);
    let listed = manifest(&folder.join("manifest.json"));
    let files: Vec<_> = listed["materials"].as_array().unwrap().iter().map(|m| m["file"].as_str().unwrap()).collect();
    let sums = [("matte.csbrdf", 0xec0e9391), ("pearl.csbrdf", 0x09461705), ("satin-paint.csbrdf", 0x5f110514)];
    assert_eq!(files, sums.map(|(file, _)| file));
    for (file, sum) in sums {
        let reader = csbrdf::decode::Reader::open(std::fs::read(folder.join(file)).unwrap()).unwrap();
        let bytes: Vec<u8> = reader.decode_all().unwrap().into_iter().flat_map(f32::to_le_bytes).collect();
        assert_eq!(crc32fast::hash(&bytes), sum, "{file}");
    }
}
