//! What a command does not replace, whatever else it may: its own input, and the measurement that the input was made from.
#![cfg(unix)]

mod common;
#[path = "common/tool.rs"]
mod tool;

use std::os::unix::fs::symlink;
use std::path::Path;
use std::sync::OnceLock;

use common::{FAST, OK, OPERATION};
use tempfile::TempDir;
use tool::{names, run, table};

/// The bytes of a table, of its file, of a trace.
fn fixture() -> &'static [(&'static str, Vec<u8>); 3] {
    static FIXTURE: OnceLock<[(&'static str, Vec<u8>); 3]> = OnceLock::new();
    FIXTURE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.binary"), table(0.0)).unwrap();
        run(folder.path(), &[&["encode", "a.binary"][..], &FAST].concat()).expect(OK);
        run(folder.path(), &["eval", "a.csbrdf", "--angles", "10,0,12,40", "--trace", "a.trace"]).expect(OK);
        ["a.binary", "a.csbrdf", "a.trace"].map(|name| (name, std::fs::read(folder.path().join(name)).unwrap()))
    })
}

fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in fixture() {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    folder
}

/// Asserts that the inputs are what they were.
#[track_caller]
fn assert_unchanged(folder: &Path) {
    for (name, bytes) in fixture() {
        assert!(std::fs::read(folder.join(name)).unwrap() == *bytes, "{name} was replaced");
    }
}

/// The example: a lossy table in place of the measured one.
#[test]
fn a_table_is_not_replaced_by_what_is_decoded_from_its_file() {
    let folder = folder();
    let decode = |args: &[&str]| run(folder.path(), &[&["decode", "a.csbrdf"], args].concat());
    decode(&["-f"]).expect(OK).says(&["a.csbrdf -> a.decoded.binary"]);
    decode(&["--format", "npy"]).expect(OK).says(&["a.csbrdf -> a.decoded.npy"]);
    decode(&[]).fails(OPERATION, &["a.decoded.binary: exists already; --force replaces it"]);
    assert!(decode(&["-f", "--quiet"]).expect(OK).stderr.is_empty());
    assert_unchanged(folder.path());

    // By its name, through links and other spellings; by its bytes under another name.
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    symlink("../a.binary", folder.path().join("sub/link.binary")).unwrap();
    std::fs::hard_link(folder.path().join("a.binary"), folder.path().join("hard.binary")).unwrap();
    std::fs::copy(folder.path().join("a.binary"), folder.path().join("sub/a.binary")).unwrap();
    std::fs::copy(folder.path().join("a.binary"), folder.path().join("other.binary")).unwrap();
    let named = "has the name of the table that a.csbrdf was made from";
    let same = "is the table that a.csbrdf was made from, by its SHA-256";
    for (output, why) in [
        ("a.binary", named),
        ("./sub/../a.binary", named),
        ("hard.binary", named),
        ("sub/a.binary", named),
        ("sub/link.binary", same),
        ("other.binary", same),
    ] {
        for more in [&["-f"][..], &["-f", "--salvage"], &["-f", "--fill"]] {
            decode(&[&["-o", output], more].concat()).fails(OPERATION, &[output, why, "--replace-source"]);
        }
    }
    assert_unchanged(folder.path());
    // A file of that name that is none is made as any other; the source is replaced where that is said.
    std::fs::create_dir(folder.path().join("new")).unwrap();
    decode(&["-o", "new/a.binary"]).expect(OK);
    decode(&["-o", "a.binary", "--replace-source"]).expect(OK).says(&["a.csbrdf -> a.binary"]);
    assert!(std::fs::read(folder.path().join("a.binary")).unwrap() != fixture()[0].1);
}

#[test]
fn no_command_replaces_its_input_or_its_source() {
    let folder = folder();
    symlink("a.csbrdf", folder.path().join("link")).unwrap();
    for (input, args) in [
        ("a.binary", &["encode", "a.binary", "-o", "a.binary"][..]),
        ("./a.binary", &["encode", "a.binary", "-o", "./a.binary"]),
        ("a.csbrdf", &["decode", "a.csbrdf", "-o", "a.csbrdf", "--format", "binary"]),
        ("a.csbrdf", &["decode", "link", "-o", "a.csbrdf", "--format", "npy"]),
        ("a.csbrdf", &["decode", "a.csbrdf", "-o", "a.csbrdf", "--format", "binary", "--salvage"]),
        ("a.csbrdf", &["repair", "a.csbrdf", "-o", "a.csbrdf"]),
        ("a.binary", &["repair", "a.csbrdf", "-o", "a.binary"]),
        ("a.csbrdf", &["prune", "a.csbrdf", "--trace", "a.trace", "-o", "a.csbrdf"]),
        ("a.trace", &["prune", "a.csbrdf", "--trace", "a.trace", "-o", "a.trace"]),
        ("a.binary", &["prune", "a.csbrdf", "--trace", "a.trace", "-o", "a.binary"]),
        ("a.csbrdf", &["render", "a.csbrdf", "--size", "8", "-o", "a.csbrdf"]),
        ("a.binary", &["render", "a.csbrdf", "--size", "8", "-o", "x.png", "--trace", "a.binary"]),
        ("a.csbrdf", &["compare", "a.csbrdf", "a.binary", "--png", "a.csbrdf"]),
        ("a.binary", &["compare", "a.csbrdf", "a.binary", "--png", "a.binary"]),
        ("a.csbrdf", &["eval", "a.csbrdf", "--angles", "1,2,3,4", "--trace", "a.csbrdf"]),
        ("a.trace", &["eval", "a.csbrdf", "--pairs", "a.trace", "--trace", "a.trace"]),
        ("a.binary", &["plan", "--fill", "a.binary", "-o", "a.binary"]),
        ("a.csbrdf", &["plan", "--valid", "a.csbrdf", "-o", "a.csbrdf"]),
    ] {
        run(folder.path(), args).expect(OPERATION);
        let forced = run(folder.path(), &[args, &["--force"]].concat());
        forced.fails(OPERATION, &[&format!("{input}: "), "--replace-source"]);
        assert_unchanged(folder.path());
    }
    // Nor do results that have names of their own in a folder.
    std::fs::create_dir(folder.path().join("set")).unwrap();
    for name in ["manifest.json", "report.html", "index.html"] {
        std::fs::hard_link(folder.path().join("a.binary"), folder.path().join("set").join(name)).unwrap();
    }
    run(folder.path(), &["report", "a.binary", "--out", "set", "--force"])
        .expect(OPERATION)
        .says(&["set/report.html: is an input itself"]);
    let encode = ["encode", "a.binary", "--out-dir", "set", "--manifest", "--force"];
    run(folder.path(), &[&encode[..], &FAST].concat())
        .expect(OPERATION)
        .says(&["set/manifest.json: is an input itself"]);
    assert_unchanged(folder.path());
    // Where that is said, an input is replaced by what was made of it.
    run(folder.path(), &["prune", "a.csbrdf", "--trace", "a.trace", "-o", "a.csbrdf", "--replace-source"]).expect(OK);
    run(folder.path(), &["verify", "a.csbrdf"]).expect(OK);
    assert!(std::fs::metadata(folder.path().join("a.csbrdf")).unwrap().len() < fixture()[1].1.len() as u64);
}

#[test]
fn every_command_says_what_it_wrote() {
    let folder = folder();
    for (written, args) in [
        ("a.binary -> b.csbrdf", &["encode", "a.binary", "-o", "b.csbrdf", FAST[0], FAST[1], FAST[2], FAST[3]][..]),
        ("a.csbrdf -> a.block-0-0-0.npy", &["decode", "a.csbrdf", "--block", "0,0,0"]),
        ("a.csbrdf -> s.binary", &["decode", "a.csbrdf", "--salvage", "-o", "s.binary"]),
        ("a.csbrdf -> a.repaired.csbrdf", &["repair", "a.csbrdf"]),
        ("a.csbrdf -> a.pruned.csbrdf", &["prune", "a.csbrdf", "--trace", "a.trace"]),
        ("a.png: ", &["render", "a.csbrdf", "--size", "8", "--coarse", "--samples", "1"]),
        ("r.trace: ", &["render", "a.csbrdf", "--size", "8", "--samples", "1", "-o", "r.png", "--trace", "r.trace"]),
        ("c.png: ", &["compare", "a.csbrdf", "a.binary", "--render", "8", "--png", "c.png"]),
        ("e.trace: ", &["eval", "a.csbrdf", "--angles", "1,2,3,4", "--trace", "e.trace"]),
        ("p.csv: ", &["plan", "--sampling", "1%", "-o", "p.csv"]),
        ("matte.binary: ", &["synth", "matte"]),
    ] {
        let before = names(folder.path()).len();
        run(folder.path(), args).expect(OK).says(&[written]);
        assert!(names(folder.path()).len() > before, "{args:?}");
        let quiet = run(folder.path(), &[args, &["--quiet", "--force"]].concat()).expect(OK);
        assert!(quiet.stderr.is_empty(), "{args:?} {}", quiet.stderr);
    }
    assert_unchanged(folder.path());
}
