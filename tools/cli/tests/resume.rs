//! Sets that are interrupted: the next run keeps what is finished, makes the rest, and ends with the bytes of an undisturbed one.
#![cfg(unix)]

mod common;
#[path = "common/tool.rs"]
mod tool;

use std::collections::BTreeMap;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use common::{BAD_INPUT, FAST, OK, OPERATION};
use tempfile::TempDir;
use tool::{Run, TOOL, names, run, start, table};

const TABLES: [&str; 4] = ["a", "b", "c", "d"];

/// Tables in a folder, the set that an undisturbed run makes of them, and how long it takes; not to be changed.
struct Fixture {
    tables: PathBuf,
    whole: BTreeMap<String, Vec<u8>>,
    takes: Duration,
}

fn fixture() -> &'static Fixture {
    static FIXTURE: OnceLock<Fixture> = OnceLock::new();
    FIXTURE.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("resume");
        let _ = std::fs::remove_dir_all(&folder);
        let tables = folder.join("tables");
        std::fs::create_dir_all(&tables).unwrap();
        for (i, name) in TABLES.iter().enumerate() {
            std::fs::write(tables.join(format!("{name}.binary")), table(i as f64)).unwrap();
        }
        let before = Instant::now();
        encode(&tables, &folder.join("set"), &[]).expect(OK);
        let takes = before.elapsed();
        Fixture { whole: contents(&folder.join("set")), tables, takes }
    })
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn arguments<'a>(tables: &'a Path, out: &'a Path) -> Vec<&'a str> {
    [&[TOOL, "encode", text(tables), "--out-dir", text(out), "--meta", "licence=CC0-1.0"][..], &FAST].concat()
}

#[track_caller]
fn encode(tables: &Path, out: &Path, more: &[&str]) -> Run {
    let args = arguments(tables, out);
    run(Path::new("."), &[&args[1..], more].concat())
}

/// All files of a folder but temporary ones, which no command looks at.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let named = names(folder).into_iter().filter(|name| !(name.starts_with(".csbrdf-") && name.ends_with(".tmp")));
    named.map(|name| (name.clone(), std::fs::read(folder.join(name)).unwrap())).collect()
}

#[track_caller]
fn assert_whole(folder: &Path) {
    let (found, whole) = (contents(folder), &fixture().whole);
    assert_eq!(found.keys().collect::<Vec<_>>(), whole.keys().collect::<Vec<_>>());
    whole.iter().for_each(|(name, bytes)| assert!(found[name] == *bytes, "{name} differs"));
}

fn inodes(folder: &Path) -> BTreeMap<String, u64> {
    names(folder).into_iter().map(|name| (name.clone(), std::fs::metadata(folder.join(name)).unwrap().ino())).collect()
}

/// A set as it is when `finished` of its files are, and the run that made them was ended.
fn interrupted(finished: usize) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for _ in 0..20 {
        let args = arguments(&fixture().tables, folder.path());
        let mut child = start(Path::new("."), &[&args[..], &["--jobs", "1"]].concat(), Stdio::null());
        let last = folder.path().join(format!("{}.csbrdf", TABLES[finished - 1]));
        while !last.exists() && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        let files = names(folder.path()).iter().filter(|name| name.ends_with(".csbrdf")).count();
        if files == finished && !folder.path().join("manifest.json").exists() {
            return folder;
        }
        names(folder.path()).iter().for_each(|name| std::fs::remove_file(folder.path().join(name)).unwrap());
    }
    panic!("the run was never ended with {finished} files");
}

#[test]
fn ended_at_any_moment_the_next_run_ends_as_an_undisturbed_one() {
    let f = fixture();
    let mut seen = BTreeMap::new();
    for (i, (signal, jobs)) in [("-KILL", "1"), ("-INT", "2")].into_iter().cycle().take(6).enumerate() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        // Twice, the second time while it goes on with what the first one left.
        for round in 0..2 {
            let args = arguments(&f.tables, out);
            let mut child = start(Path::new("."), &[&args[..], &["--jobs", jobs]].concat(), Stdio::null());
            std::thread::sleep(f.takes * (i as u32 + 1 + 2 * round) / 9);
            let _ = Command::new("kill").args([signal, &child.id().to_string()]).stderr(Stdio::null()).status();
            let ended = child.wait().unwrap();
            assert!(ended.code().is_none() || ended.success(), "{ended}");
            // No manifest has holes.
            if let Ok(manifest) = std::fs::read(out.join("manifest.json")) {
                assert!(manifest == f.whole["manifest.json"]);
            }
            *seen.entry(names(out).iter().filter(|name| name.ends_with(".csbrdf")).count()).or_insert(0) += 1;
        }
        encode(&f.tables, out, &["--jobs", jobs]).expect(OK);
        assert_whole(out);
        run(out, &["verify", "manifest.json"]).expect(OK);
    }
    println!("files that were finished when a run was ended, and how often: {seen:?}");
}

#[test]
fn what_is_finished_is_kept_and_listed() {
    let folder = interrupted(2);
    let out = folder.path();
    // Nobody is advised to delete a good file.
    run(out, &["verify", "manifest.json"]).fails(OPERATION, &["the set is not finished", "csbrdf encode again"]);
    let before = inodes(out);
    let again = encode(&fixture().tables, out, &[]).expect(OK);
    assert_eq!(again.stderr.lines().filter(|line| line.ends_with("kept")).count(), 2, "{}", again.stderr);
    let again = again.says(&["manifest.json: 4 materials"]);
    assert!(again.stderr.lines().count() == 6);
    assert_whole(out);
    for name in ["a.csbrdf", "b.csbrdf"] {
        assert_eq!(inodes(out)[name], before[name], "{name} was made again");
    }
    // A set that is finished is left as it is.
    let before = inodes(out);
    let again = encode(&fixture().tables, out, &[]).expect(OK);
    assert_eq!(again.stderr.matches("kept").count(), 4, "{}", again.stderr);
    assert_eq!(inodes(out), before);

    // Temporary files of a run that was killed go with it.
    let folder = interrupted(1);
    std::fs::write(folder.path().join(".csbrdf-abc.tmp"), "half").unwrap();
    encode(&fixture().tables, folder.path(), &[]).expect(OK);
    assert!(!folder.path().join(".csbrdf-abc.tmp").exists());
}

#[test]
fn without_record_and_manifest_equal_files_are_kept_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.csbrdf", "d.csbrdf"] {
        std::fs::write(folder.path().join(name), &fixture().whole[name]).unwrap();
    }
    let before = inodes(folder.path());
    let made = encode(&fixture().tables, folder.path(), &[]).expect(OK);
    assert_eq!(made.stderr.matches("kept").count(), 2, "{}", made.stderr);
    assert_whole(folder.path());
    assert!(before.iter().all(|(name, inode)| inodes(folder.path())[name] == *inode));
}

#[test]
fn files_that_do_not_match_are_named_and_left() {
    let f = fixture();
    let changed = |change: &dyn Fn(&Path)| {
        let folder = interrupted(2);
        change(folder.path());
        folder
    };
    let check = |folder: &TempDir, file: &str, parts: &[&str]| {
        let before = std::fs::read(folder.path().join(file)).unwrap();
        let refused = encode(&f.tables, folder.path(), &[]).expect(OPERATION);
        let refused = refused.says(&[&[file, "--force"], parts].concat());
        assert!(std::fs::read(folder.path().join(file)).unwrap() == before);
        assert!(!folder.path().join("manifest.json").exists(), "{}", refused.stderr);
        encode(&f.tables, folder.path(), &["--force"]).expect(OK);
        assert_whole(folder.path());
    };
    // Damaged, of another table, of other settings, no file at all.
    let flipped = changed(&|out| {
        let mut bytes = std::fs::read(out.join("a.csbrdf")).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(out.join("a.csbrdf"), bytes).unwrap();
    });
    check(&flipped, "a.csbrdf", &["changed or damaged"]);
    let other = changed(&|out| std::fs::write(out.join("c.csbrdf"), &f.whole["d.csbrdf"]).unwrap());
    check(&other, "c.csbrdf", &["was made from another table"]);
    let none = changed(&|out| std::fs::write(out.join("d.csbrdf"), "no file").unwrap());
    check(&none, "d.csbrdf", &["is no file of this set"]);
    let settings = tempfile::tempdir().unwrap();
    let one = f.tables.join("a.binary");
    run(settings.path(), &["encode", text(&one), "-o", "a.csbrdf", "--block", "15,15,15", "--quality", "0.4"])
        .expect(OK);
    check(&settings, "a.csbrdf", &["with other settings or another version"]);
}

#[test]
fn sets_of_other_settings_or_with_other_files_are_refused_before_the_work() {
    let f = fixture();
    // Unfinished.
    let folder = interrupted(1);
    let other = ["--spare"];
    encode(&f.tables, folder.path(), &other).fails(OPERATION, &["a.csbrdf", "with other settings", "did not end"]);
    // The record is as it was: the first settings go on.
    encode(&f.tables, folder.path(), &[]).expect(OK);
    assert_whole(folder.path());
    // Finished.
    let refused = encode(&f.tables, folder.path(), &other);
    refused.fails(OPERATION, &["manifest.json: exists already", "with other settings", "--force"]);
    assert_whole(folder.path());
    // A file that the manifest would not list.
    std::fs::write(folder.path().join("e.csbrdf"), &f.whole["a.csbrdf"]).unwrap();
    encode(&f.tables, folder.path(), &[]).fails(OPERATION, &["e.csbrdf: none of the tables given becomes this file"]);
    std::fs::remove_file(folder.path().join("e.csbrdf")).unwrap();
    // A manifest with more than what is encoded now.
    let one = f.tables.join("a.binary");
    let fewer = |more: &[&str]| encode(&one, folder.path(), &[&["--manifest"], more].concat());
    fewer(&[]).fails(OPERATION, &["manifest.json: lists b.csbrdf"]);
    assert_whole(folder.path());
    // No manifest of csbrdf at all.
    std::fs::write(folder.path().join("manifest.json"), "{}").unwrap();
    encode(&f.tables, folder.path(), &[]).fails(OPERATION, &["manifest.json: exists already; --force"]);
    encode(&f.tables, folder.path(), &["--force"]).expect(OK);
    assert_whole(folder.path());
}

#[test]
fn a_table_that_could_not_be_read_joins_its_set_later() {
    let f = fixture();
    let (tables, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    for name in TABLES {
        let name = format!("{name}.binary");
        std::fs::hard_link(f.tables.join(&name), tables.path().join(&name)).unwrap();
    }
    let c = tables.path().join("c.binary");
    std::fs::remove_file(&c).unwrap();
    std::fs::write(&c, "no table").unwrap();
    encode(tables.path(), out.path(), &[]).expect(BAD_INPUT).says(&["manifest.json: 3 materials"]);
    run(out.path(), &["verify", "manifest.json"]).expect(OK);
    std::fs::remove_file(&c).unwrap();
    std::fs::hard_link(f.tables.join("c.binary"), &c).unwrap();
    let whole = encode(tables.path(), out.path(), &[]).expect(OK);
    assert_eq!(whole.stderr.matches("kept").count(), 3, "{}", whole.stderr);
    assert_whole(out.path());

    // A table that is gone bad takes no hole into the manifest.
    std::fs::remove_file(&c).unwrap();
    std::fs::write(&c, "no table").unwrap();
    encode(tables.path(), out.path(), &[]).expect(BAD_INPUT).says(&["manifest.json: not written"]);
    assert_eq!(std::fs::read(out.path().join("manifest.json")).unwrap(), f.whole["manifest.json"]);
    run(out.path(), &["verify", "manifest.json"]).expect(OK);
}

#[test]
fn two_runs_at_a_time_do_not_mix() {
    let f = fixture();
    let folder = tempfile::tempdir().unwrap();
    let args = arguments(&f.tables, folder.path());
    let first = start(Path::new("."), &args, Stdio::null());
    let record = folder.path().join(".csbrdf-set.jsonl");
    while std::fs::metadata(&record).map_or(0, |found| found.len()) == 0 {
        std::thread::sleep(Duration::from_millis(1));
    }
    let second = encode(&f.tables, folder.path(), &[]);
    if second.code != Some(OK) {
        second.fails(OPERATION, &["another csbrdf encode is making this set"]);
    }
    tool::end(first).expect(OK);
    assert_whole(folder.path());
}
