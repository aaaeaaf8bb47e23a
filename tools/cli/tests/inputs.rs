//! Inputs that are no regular files, or not what they say: pipes, devices, links, streams without end. A run that hangs fails.
#![cfg(unix)]

mod common;
#[path = "common/tool.rs"]
mod tool;

use std::fs::File;
use std::io::Write;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;

use common::{BAD_INPUT, FAST, OK, OPERATION};
use tempfile::TempDir;
use tool::{Run, TOOL, end, names, run, shell, start, table};

/// A folder of tables, the set of them, and a trace; not to be changed.
fn fixture() -> &'static Path {
    static FIXTURE: OnceLock<PathBuf> = OnceLock::new();
    FIXTURE.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("inputs");
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(folder.join("tables")).unwrap();
        for (i, name) in ["a", "b"].iter().enumerate() {
            std::fs::write(folder.join("tables").join(format!("{name}.binary")), table(i as f64)).unwrap();
        }
        run(&folder, &[&["encode", "tables", "--out-dir", "set"][..], &FAST].concat()).expect(OK);
        std::fs::copy(folder.join("set/a.csbrdf"), folder.join("a.csbrdf")).unwrap();
        folder
    })
}

/// A copy of the set, to be changed.
fn copy() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in names(&fixture().join("set")) {
        std::fs::copy(fixture().join("set").join(&name), folder.path().join(&name)).unwrap();
    }
    folder
}

fn fifo(path: &Path) {
    let _ = std::fs::remove_file(path);
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success());
}

/// Every command on an input that is `X`; what each writes goes to `out`.
const COMMANDS: [&[&str]; 15] = [
    &["info", "X"],
    &["verify", "X"],
    &["decode", "X", "-o", "out"],
    &["decode", "X", "--salvage", "-o", "out"],
    &["repair", "X", "-o", "out"],
    &["prune", "X", "--channels", "R", "-o", "out"],
    &["eval", "X", "--angles", "10,0,12,40"],
    &["render", "X", "-o", "out"],
    &["lint", "X"],
    &["compare", "X", "a.csbrdf"],
    &["compare", "a.csbrdf", "X"],
    &["encode", "X", "-o", "out"],
    &["encode", "--samples", "X", "-o", "out"],
    &["plan", "--fill", "X", "-o", "out"],
    &["plan", "--valid", "X", "-o", "out"],
];

fn with<'a>(command: &[&'a str], input: &'a str) -> Vec<&'a str> {
    command.iter().map(|word| if *word == "X" { input } else { word }).collect()
}

#[test]
fn a_stream_of_no_known_format_is_refused_after_its_first_bytes() {
    let endless = ["/dev/zero", "/dev/urandom"].map(Path::new).into_iter().filter(|device| device.exists());
    for device in endless {
        let name = device.to_str().unwrap();
        for command in COMMANDS {
            let refused = |run: Run, name: &str| {
                run.fails(BAD_INPUT, &[name]);
                assert!(!fixture().join("out").exists());
            };
            refused(run(fixture(), &with(command, name)), name);
            let args = [&[TOOL], &with(command, "-")[..]].concat();
            refused(end(start(fixture(), &args, File::open(device).unwrap().into())), "standard input");
        }
    }
    for wrong in ["verify a.csbrdf --against /dev/zero", "eval a.csbrdf --pairs /dev/zero"] {
        shell(fixture(), &format!("\"$0\" {wrong}")).fails(BAD_INPUT, &["/dev/zero"]);
    }
    let study = "study tables --out \"$(mktemp -d)\" --quick --environment /dev/zero";
    shell(fixture(), &format!("\"$0\" {study}")).fails(OPERATION, &["/dev/zero: is a device, not a regular file"]);
    // Endless text is no list, and endless JSON no manifest.
    shell(fixture(), "yes | \"$0\" encode --samples - -o out").fails(BAD_INPUT, &["standard input", "column"]);
    shell(fixture(), "yes ' ' | \"$0\" info -").fails(BAD_INPUT, &["standard input"]);
    shell(fixture(), "yes '{' | \"$0\" info -").fails(4, &["standard input", "more than 67108864 bytes"]);
}

#[test]
fn a_stream_that_goes_on_behind_its_end_is_refused_at_once() {
    let a = "tables/a.binary";
    for (input, command) in [
        ("a.csbrdf", &["info", "-"][..]),
        ("a.csbrdf", &["verify", "-"]),
        ("a.csbrdf", &["decode", "-", "-o", "out"]),
        ("a.csbrdf", &["compare", "-", "a.csbrdf"]),
        (a, &["compare", "-", "a.csbrdf"]),
        (a, &["encode", "-", "-o", "out"]),
        (a, &["lint", "-"]),
        (a, &["plan", "--fill", "-", "-o", "out"]),
    ] {
        // One byte more, and no end.
        let bytes = [&std::fs::read(fixture().join(input)).unwrap()[..], b"x"].concat();
        let mut child = start(fixture(), &[&[TOOL], command].concat(), Stdio::piped());
        let mut stdin = child.stdin.take().unwrap();
        let writer = std::thread::spawn(move || {
            stdin.write_all(&bytes).unwrap();
            stdin
        });
        end(child).fails(BAD_INPUT, &["standard input: goes on after the"]);
        drop(writer.join().unwrap());
        assert!(!fixture().join("out").exists());
    }
    shell(fixture(), "cat a.csbrdf /dev/zero | \"$0\" info -").fails(BAD_INPUT, &["standard input: goes on after the"]);
    // And one that ends is read.
    shell(fixture(), "cat a.csbrdf | \"$0\" verify -").expect(OK);
    shell(fixture(), &format!("cat {a} | \"$0\" compare - a.csbrdf --render 0")).expect(OK);
}

#[test]
fn a_pipe_with_a_name_is_read_as_any_other() {
    let folder = tempfile::tempdir().unwrap();
    fifo(&folder.path().join("p"));
    let file = fixture().join("a.csbrdf");
    let line = format!("cat '{}' >p & \"$0\" verify p", file.display());
    let read = shell(folder.path(), &line).expect(OK);
    assert!(String::from_utf8(read.stdout).unwrap().starts_with("p: ok"));
    let line = format!("{{ cat '{}'; printf x; }} >p & \"$0\" decode p -o out", file.display());
    shell(folder.path(), &line).fails(BAD_INPUT, &["p: goes on after"]);
    // But not for what has to be a file.
    let study =
        ["study", fixture().join("tables").to_str().unwrap(), "--out", "o", "--environment", "p"].map(String::from);
    let study: Vec<&str> = study.iter().map(String::as_str).collect();
    run(folder.path(), &study).fails(OPERATION, &["p: is a pipe, not a regular file"]);
}

#[test]
fn a_set_reads_regular_files_within_itself() {
    let outside = fixture().join("set/a.csbrdf");
    let spoil = |what: &dyn Fn(&Path)| {
        let folder = copy();
        let path = folder.path().join("a.csbrdf");
        std::fs::remove_file(&path).unwrap();
        what(&path);
        folder
    };
    let check = |folder: &TempDir, parts: &[&str]| {
        let verified = run(folder.path(), &["verify", "manifest.json"]).expect(OPERATION);
        let verified = verified.says(&[&["a.csbrdf: "], parts].concat());
        // One line for it, the rest goes on.
        assert_eq!(verified.stderr.lines().count(), 2, "{}", verified.stderr);
        assert!(verified.stderr.contains("1 of 2 failed"));
        assert!(String::from_utf8(verified.stdout).unwrap().contains("b.csbrdf: ok"));
    };
    check(&spoil(&fifo), &["is a pipe, not a regular file"]);
    check(&spoil(&|path| symlink("/dev/zero", path).unwrap()), &["is a link out of its folder"]);
    check(&spoil(&|path| symlink(&outside, path).unwrap()), &["is a link out of its folder"]);
    check(&spoil(&|path| symlink("a.csbrdf", path).unwrap()), &["symbolic links"]);
    check(&spoil(&|path| std::fs::create_dir(path).unwrap()), &["is a directory"]);
    check(&spoil(&|path| drop(std::os::unix::net::UnixListener::bind(path).unwrap())), &["is a socket"]);
    // A hole of a terabyte is not read.
    let large = spoil(&|path| File::create(path).unwrap().set_len(1 << 40).unwrap());
    let verified = run(large.path(), &["verify", "manifest.json"]).expect(BAD_INPUT);
    verified.says(&["a.csbrdf: has 1099511627776 bytes, the manifest states"]);
    // Links within the set lead nowhere else.
    let inside = spoil(&|path| {
        std::fs::create_dir(path.with_file_name("in")).unwrap();
        std::fs::copy(&outside, path.with_file_name("in").join("a")).unwrap();
        symlink("in/a", path).unwrap();
    });
    run(inside.path(), &["verify", "manifest.json"]).expect(OK);
    // Names that lead elsewhere are none.
    let folder = copy();
    let manifest = folder.path().join("manifest.json");
    let text = std::fs::read_to_string(&manifest).unwrap();
    for name in ["/dev/zero", "../a.csbrdf", "in/a.csbrdf"] {
        std::fs::write(&manifest, text.replace("\"a.csbrdf\"", &format!("{name:?}"))).unwrap();
        for command in ["verify", "info"] {
            run(folder.path(), &[command, "manifest.json"]).fails(BAD_INPUT, &[name, "is not the name of a file"]);
        }
    }
}

#[test]
fn tables_of_a_set_are_regular_files_too() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["tables", "originals"] {
        std::fs::create_dir(at(name)).unwrap();
        std::fs::copy(fixture().join("tables/b.binary"), at(name).join("b.binary")).unwrap();
        fifo(&at(name).join("a.binary"));
    }
    symlink("/dev/zero", at("tables/z.binary")).unwrap();
    symlink(fixture().join("tables/a.binary"), at("tables/out.binary")).unwrap();
    symlink("b.binary", at("tables/in.binary")).unwrap();
    let encode = [&["encode", "tables", "--out-dir", "set"][..], &FAST].concat();
    let made = run(folder.path(), &encode).expect(OPERATION);
    let made = made
        .says(&["a.binary: is a pipe, not a regular file"])
        .says(&["out.binary: is a link out of its folder"])
        .says(&["z.binary: is a link out of its folder"]);
    assert_eq!(made.stderr.lines().filter(|line| line.starts_with("csbrdf: ")).count(), 3, "{}", made.stderr);
    assert_eq!(names(&at("set")), ["b.csbrdf", "in.csbrdf", "manifest.json"]);
    let set = fixture().join("set/manifest.json");
    let against = run(folder.path(), &["verify", set.to_str().unwrap(), "--against", "originals"]).expect(OPERATION);
    against.says(&["a.binary: is a pipe, not a regular file"]).says(&["1 of 2 failed"]);
    // Named by its user, a link is followed.
    run(folder.path(), &[&["encode", "tables/out.binary", "-o", "x.csbrdf"][..], &FAST].concat()).expect(OK);
    // A study goes on without them, and so does a set whose files may not be written to.
    let study = ["study", "tables", "--out", "study", "--quick", "--only", "gini"];
    let studied = run(folder.path(), &study).expect(OPERATION);
    studied.says(&["a.binary: is a pipe, not a regular file"]).says(&["out.binary: is a link out"]);
    fifo(&at("set/b.csbrdf"));
    for force in [&[][..], &["--force"]] {
        run(folder.path(), &[&encode[..], force].concat())
            .expect(OPERATION)
            .says(&["set/b.csbrdf: is a pipe, not a regular file"]);
    }
}
