//! The tool among other processes and on a machine that refuses: killed, interrupted, in another's way, on a full or read-only disk.
//! Under its name a file is the old one, the new one or not there; never a part of one.
#![cfg(unix)]

mod common;

use std::fs::File;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use common::{BAD_INPUT, FAST, OK, OPERATION, USAGE};
use csbrdf::encode::Encoder;
use csbrdf::io::merl::write_merl_values;
use csbrdf::table::Table;
use csbrdf::table::grid::Grid;
use tempfile::TempDir;

const TOOL: &str = env!("CARGO_BIN_EXE_csbrdf");
const SIGINT: i32 = 2;
const SIGTERM: i32 = 15;
const SIGXFSZ: i32 = 25;

/// What a file holds that is to be replaced.
const OLD: &[u8] = b"the old one";

fn start(folder: &Path, args: &[&str]) -> Child {
    let mut command = Command::new(TOOL);
    command.args(args).current_dir(folder).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

fn output(child: Child) -> (ExitStatus, String) {
    let Output { status, stderr, .. } = child.wait_with_output().unwrap();
    let stderr = String::from_utf8(stderr).unwrap();
    assert!(!stderr.contains("panicked"), "{stderr}");
    (status, stderr)
}

fn run(folder: &Path, args: &[&str]) -> (ExitStatus, String) {
    output(start(folder, args))
}

/// Runs a line of the shell with the tool as `$0`.
fn shell(folder: &Path, line: &str) -> (ExitStatus, String) {
    let mut command = Command::new("sh");
    command.args(["-c", line, TOOL]).current_dir(folder).stdin(Stdio::null()).stdout(Stdio::piped());
    output(command.stderr(Stdio::piped()).spawn().unwrap())
}

/// Asserts a failure of one line with all of `parts`.
#[track_caller]
fn fails((status, stderr): (ExitStatus, String), code: i32, parts: &[&str]) {
    assert_eq!(status.code(), Some(code), "{status}: {stderr}");
    assert!(stderr.starts_with("csbrdf: ") && stderr.lines().count() == 1, "{stderr}");
    parts.iter().for_each(|part| assert!(stderr.contains(part), "{part:?} is not in {stderr:?}"));
}

fn names(folder: &Path) -> Vec<String> {
    let names = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

/// A MERL table, most of it not measured, as its files; made once. Written to each folder as `t.binary`, `t.csbrdf`, `t.trace`.
struct Fixture {
    table: Vec<u8>,
    file: Vec<u8>,
    trace: Vec<u8>,
}

fn fixture() -> &'static Fixture {
    static FIXTURE: OnceLock<Fixture> = OnceLock::new();
    FIXTURE.get_or_init(|| {
        let grid = Grid::merl();
        let n = grid.positions();
        let near = |i: usize| i / (90 * 180) < 15 && i / 180 % 90 < 15;
        let value = |i: usize| if near(i % n) { (i as f64 * 0.001).sin() + 1.1 } else { -1.0 };
        let values: Vec<f64> = (0..3 * n).map(value).collect();
        let mut table = Vec::new();
        write_merl_values(&grid, &values, &mut table).unwrap();
        let source = Table::from_values(grid, values).unwrap();
        let file = Encoder::new().block_shape(&[15, 15, 15]).quality(0.5).encode(&source).unwrap().bytes;
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("t.csbrdf"), &file).unwrap();
        let eval = ["eval", "t.csbrdf", "--angles", "10,0,12,40", "--trace", "t.trace"];
        assert_eq!(run(folder.path(), &eval).0.code(), Some(OK));
        let trace = std::fs::read(folder.path().join("t.trace")).unwrap();
        Fixture { table, file, trace }
    })
}

fn folder() -> TempDir {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("t.csbrdf"), &fixture().file).unwrap();
    std::fs::write(at("t.trace"), &fixture().trace).unwrap();
    folder
}

const ENCODE: [&str; 8] = ["encode", "t.binary", "-o", "out", FAST[0], FAST[1], FAST[2], FAST[3]];
const DECODE: [&str; 6] = ["decode", "t.csbrdf", "--format", "binary", "-o", "out"];
const PRUNE: [&str; 6] = ["prune", "t.csbrdf", "--trace", "t.trace", "-o", "out"];

/// Whether files of a folder can be without a name until they are complete.
fn nameless(folder: &Path) -> bool {
    #[cfg(target_os = "linux")]
    return {
        use std::os::unix::fs::OpenOptionsExt;
        let flags = rustix::fs::OFlags::TMPFILE.bits() as i32;
        File::options().write(true).custom_flags(flags).open(folder).is_ok()
    };
    #[cfg(not(target_os = "linux"))]
    {
        let _ = folder;
        false
    }
}

/// Waits in small parts, not for a process that has ended.
fn wait(child: &mut Child, time: Duration) {
    let start = Instant::now();
    while start.elapsed() < time && child.try_wait().unwrap().is_none() {
        let rest = time.saturating_sub(start.elapsed());
        std::thread::sleep(rest.min(Duration::from_millis(20)));
    }
}

/// Sends a signal to a process that was started here.
fn signal(child: &Child, name: &str) {
    // Fails if the process has ended.
    let _ = Command::new("kill").args([name, &child.id().to_string()]).stderr(Stdio::null()).status();
}

/// Runs a command and ends it by a signal after each of `count` times, up to a little more than it takes; every second time it is to
/// replace a file. Asserts what is there afterwards. How often the command was done before.
fn end_at_many_moments(folder: &Path, args: &[&str], count: u32, name: &str, code: i32) -> u32 {
    let out = folder.join("out");
    let _ = std::fs::remove_file(&out);
    let before = Instant::now();
    assert_eq!(run(folder, args).0.code(), Some(OK));
    let mut takes = before.elapsed();
    let whole = std::fs::read(&out).unwrap();
    let others = names(folder).len() - 1;
    let mut done = 0;
    for i in 0..count {
        let replaces = i % 2 == 1;
        let forced = [args, &["--force"]].concat();
        if replaces {
            std::fs::write(&out, OLD).unwrap();
        } else {
            std::fs::remove_file(&out).unwrap();
        }
        let mut child = start(folder, if replaces { &forced } else { args });
        wait(&mut child, takes * (i + 1) / count);
        signal(&child, name);
        let (status, stderr) = output(child);
        assert!(status.signal() == Some(code) || status.code() == Some(OK), "{status} {stderr}");
        match std::fs::read(&out) {
            Ok(bytes) if bytes == whole => {}
            Ok(bytes) => assert!(replaces && bytes == OLD && status.signal().is_some(), "{} bytes", bytes.len()),
            Err(_) => {
                assert!(!replaces && status.signal().is_some());
                std::fs::write(&out, OLD).unwrap();
            }
        }
        if status.code() == Some(OK) {
            // The first time it took longer.
            takes = takes.mul_f64(0.8);
            done += 1;
        }
        for name in names(folder).into_iter().filter(|name| name.starts_with('.')) {
            // A file without a name gets one for the moment in which it replaces another.
            assert!(name.starts_with(".csbrdf-") && name.ends_with(".tmp"), "{name}");
            assert!(replaces || !nameless(folder), "{name} is left");
            std::fs::remove_file(folder.join(name)).unwrap();
        }
        assert_eq!(names(folder).len(), others + 1);
    }
    done
}

#[test]
fn killed_at_any_moment_no_part_of_a_file_is_left_under_its_name() {
    let folder = folder();
    std::fs::write(folder.path().join("t.binary"), &fixture().table).unwrap();
    for (args, count) in [(&ENCODE[..], 4), (&DECODE, 8), (&PRUNE, 24)] {
        let done = end_at_many_moments(folder.path(), args, count, "-KILL", 9);
        println!("{}: {done} of {count} were done before", args[0]);
    }
}

#[test]
fn interrupts_end_the_tool_as_signals_do_and_leave_nothing() {
    let folder = folder();
    for (args, count) in [(&DECODE[..], 3), (&PRUNE, 8)] {
        end_at_many_moments(folder.path(), args, count, "-INT", SIGINT);
        end_at_many_moments(folder.path(), args, count, "-TERM", SIGTERM);
    }
}

#[test]
fn a_device_that_is_full_is_told() {
    if !Path::new("/dev/full").exists() {
        eprintln!("skipped: no /dev/full");
        return;
    }
    let folder = folder();
    let full = ["No space left", "free some space"].map(str::to_lowercase);
    let named = [full[0].as_str(), &full[1], "/dev/full"];
    for args in
        [&["decode", "t.csbrdf", "--format", "binary", "-o", "/dev/full"][..], &[&PRUNE[..5], &["/dev/full"]].concat()]
    {
        fails(run(folder.path(), args), OPERATION, &named);
    }
    for command in
        ["info t.csbrdf", "decode t.csbrdf -o -", "verify t.csbrdf", "synth --list", "info --json --blocks t.csbrdf"]
    {
        fails(shell(folder.path(), &format!("\"$0\" {command} >/dev/full")), OPERATION, &["standard output", &full[0]]);
    }
    assert_eq!(names(folder.path()), ["t.csbrdf", "t.trace"]);
}

#[test]
fn files_beyond_the_limit_of_a_process_are_told_and_nothing_is_left() {
    let folder = folder();
    let decode = DECODE.join(" ");
    // As shells and services set it: the signal ends the tool.
    let (status, stderr) = shell(folder.path(), &format!("ulimit -c 0; ulimit -f 64; exec \"$0\" {decode}"));
    assert_eq!(status.signal(), Some(SIGXFSZ), "{status} {stderr}");
    // Files without a name leave nothing behind, others what a killed process leaves.
    if nameless(folder.path()) {
        assert_eq!(names(folder.path()), ["t.csbrdf", "t.trace"]);
    }
    let ended = shell(folder.path(), &format!("trap '' XFSZ; ulimit -f 64; exec \"$0\" {decode}"));
    fails(ended, OPERATION, &["out: ", "file too large"]);
    assert!(!folder.path().join("out").exists());
}

/// Runs a line in a folder `d` of its own file system, mounted with some options, and lists what is in it afterwards; `None`, and
/// said so, where this user may not mount.
fn on_a_disk(folder: &Path, options: &str, line: &str) -> Option<(ExitStatus, String, String)> {
    std::fs::create_dir_all(folder.join("d")).unwrap();
    let inside = format!("mount -t tmpfs -o {options} none d || exit 99; {line}; code=$?; ls -A d >list; exit $code");
    let run = Command::new("unshare").args(["-rm", "sh", "-c", &inside, TOOL]).current_dir(folder).output();
    let refused = |run: &Output| run.status.code() == Some(99) || run.stderr.starts_with(b"unshare");
    let Some(run) = run.ok().filter(|run| !refused(run)) else {
        eprintln!("skipped: no file system of one's own to fill (unshare -rm, mount -t tmpfs)");
        return None;
    };
    let list = std::fs::read_to_string(folder.join("list")).unwrap();
    Some((run.status, String::from_utf8(run.stderr).unwrap(), list))
}

#[test]
fn a_full_disk_is_told_and_keeps_the_old_file() {
    let folder = folder();
    let line = |args: &str| {
        format!("printf old >d/out; \"$0\" {args} --force -o d/out; code=$?; cat d/out >kept; (exit $code)")
    };
    for args in ["decode t.csbrdf --format binary", "encode t.binary --lossless --block 15,15,15"] {
        if args.starts_with("encode") {
            std::fs::write(folder.path().join("t.binary"), &fixture().table).unwrap();
        }
        let Some((status, stderr, list)) = on_a_disk(folder.path(), "size=8k", &line(args)) else { return };
        fails((status, stderr), OPERATION, &["d/out: no space left on device; free some space"]);
        assert_eq!(list, "out\n");
        assert_eq!(std::fs::read(folder.path().join("kept")).unwrap(), b"old");
    }
}

/// A file without a name gets one by way of /proc.
#[test]
fn without_proc_a_file_gets_its_name_all_the_same() {
    let folder = folder();
    let line = "mount -t tmpfs none /proc && \"$0\" decode -q t.csbrdf --block 0 -o d/out.npy && \"$0\" decode -q t.csbrdf --block 1 -o \
                d/out.npy --force && \"$0\" decode t.csbrdf --block 0 -o d/out.npy";
    if let Some((status, stderr, list)) = on_a_disk(folder.path(), "size=1m", line) {
        fails((status, stderr), OPERATION, &["d/out.npy: exists already"]);
        assert_eq!(list, "out.npy\n");
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_told() {
    let folder = folder();
    fails(run(folder.path(), &[&PRUNE[..5], &["t.trace/out"]].concat()), OPERATION, &["no folder t.trace"]);
    fails(run(folder.path(), &[&PRUNE[..5], &["no/out"]].concat()), OPERATION, &["no folder no; make it first"]);
    if let Some((status, stderr, list)) = on_a_disk(folder.path(), "ro", "\"$0\" decode t.csbrdf -o d/out.binary") {
        fails((status, stderr), OPERATION, &["d/out.binary: read-only file system"]);
        assert_eq!(list, "");
    }
    let closed = folder.path().join("closed");
    std::fs::create_dir(&closed).unwrap();
    let permissions = |mode| std::os::unix::fs::PermissionsExt::from_mode(mode);
    std::fs::set_permissions(&closed, permissions(0o555)).unwrap();
    let parts = ["closed/out: permission denied; check the permissions"];
    let args = [&PRUNE[..5], &["closed/out"]].concat();
    // The superuser goes past permissions, unless it gives that up.
    let superuser = File::create(closed.join("x")).and_then(|_| std::fs::remove_file(closed.join("x"))).is_ok();
    let bound = |command: &str| {
        let mut setpriv = Command::new("setpriv");
        setpriv.args(["--bounding-set=-dac_override", command]).current_dir(folder.path()).stdin(Stdio::null());
        setpriv
    };
    if !superuser {
        fails(run(folder.path(), &args), OPERATION, &parts);
    } else if bound("true").output().is_ok_and(|run| run.status.success()) {
        let child = bound(TOOL).args(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        fails(output(child.unwrap()), OPERATION, &parts);
    } else {
        eprintln!("skipped: permissions do not bind this user, and setpriv cannot have them do so");
    }
    assert!(names(&closed).is_empty());
    std::fs::set_permissions(&closed, permissions(0o755)).unwrap();
}

#[test]
fn of_two_writers_one_wins_whole() {
    let folder = folder();
    let out = folder.path().join("out");
    let block = |number| ["decode", "t.csbrdf", "--format", "npy", "-o", "out", "--block", number];
    let whole = ["0", "1"].map(|number| {
        assert_eq!(run(folder.path(), &block(number)).0.code(), Some(OK));
        let bytes = std::fs::read(&out).unwrap();
        std::fs::remove_file(&out).unwrap();
        bytes
    });
    assert_ne!(whole[0], whole[1]);
    for _ in 0..8 {
        let both = ["0", "1"].map(|number| start(folder.path(), &block(number))).map(output);
        let won: Vec<usize> = (0..2).filter(|&i| both[i].0.success()).collect();
        assert_eq!(won.len(), 1, "{both:?}");
        assert!(std::fs::read(&out).unwrap() == whole[won[0]]);
        let [one, other] = both;
        fails(if won == [0] { other } else { one }, OPERATION, &["out: exists already; --force replaces it"]);

        let both = ["0", "1"].map(|number| start(folder.path(), &[&block(number)[..], &["--force"]].concat()));
        assert!(both.map(output).iter().all(|(status, _)| status.success()));
        assert!(whole.contains(&std::fs::read(&out).unwrap()));
        std::fs::remove_file(&out).unwrap();
        assert_eq!(names(folder.path()), ["t.csbrdf", "t.trace"]);
    }
}

#[test]
fn outputs_that_are_folders_or_inputs_are_told() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("d")).unwrap();
    let prune = |output| [&PRUNE[..5], &[output]].concat();
    fails(run(folder.path(), &prune("d")), OPERATION, &["d: is a directory; name a file in it"]);
    fails(run(folder.path(), &[prune("d"), vec!["--force"]].concat()), OPERATION, &["d: is a directory"]);
    fails(run(folder.path(), &prune("new/")), OPERATION, &["new/"]);
    let itself = ["t.csbrdf: is an input itself; name another output", "--replace-source"];
    fails(run(folder.path(), &prune("t.csbrdf")), OPERATION, &itself);
    fails(run(folder.path(), &[prune("t.csbrdf"), vec!["--force"]].concat()), OPERATION, &itself);
    assert!(std::fs::read(folder.path().join("t.csbrdf")).unwrap() == fixture().file);
    fails(run(folder.path(), &prune("t.csbrdf/out")), OPERATION, &["no folder t.csbrdf"]);
    fails(run(folder.path(), &["prune", "t.csbrdf", "--trace", "d", "-o", "out"]), OPERATION, &["d: "]);
    assert_eq!(run(folder.path(), &["prune", "-", "--trace", "t.trace"]).0.code(), Some(USAGE));
    assert_eq!(names(folder.path()), ["d", "t.csbrdf", "t.trace"]);

    // A file in place of itself: its old bytes are read to the end before.
    let (status, stderr) = run(folder.path(), &[prune("t.csbrdf"), vec!["--replace-source"]].concat());
    assert!(status.success(), "{stderr}");
    assert_eq!(run(folder.path(), &["verify", "t.csbrdf"]).0.code(), Some(OK));
    assert!(std::fs::metadata(folder.path().join("t.csbrdf")).unwrap().len() < fixture().file.len() as u64);
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let folder = folder();
    for args in [
        &["info", "t.csbrdf"][..],
        &["info", "t.csbrdf", "--json", "--blocks"],
        &["verify", "t.csbrdf"],
        &["lint", "t.csbrdf"],
        &["compare", "t.csbrdf", "t.csbrdf", "--render", "0"],
        &["eval", "t.csbrdf", "--angles", "10,0,12,40"],
        &["decode", "t.csbrdf", "-o", "-"],
        &["prune", "t.csbrdf", "--trace", "t.trace", "-o", "-", "--quiet"],
        &["plan", "--sampling", "1%"],
        &["synth", "--list"],
        &["--help"],
        &["decode", "--help"],
    ] {
        // Gone before the tool begins: some are done sooner than anything could go away.
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let mut command = Command::new(TOOL);
        command.args(args).current_dir(folder.path()).stdin(Stdio::null()).stdout(writer).stderr(Stdio::piped());
        let child = command.spawn().unwrap();
        let (status, stderr) = output(child);
        // As a shell says of a program that SIGPIPE ended: not all was written.
        assert!(status.code() == Some(141) && stderr.is_empty(), "{args:?}: {status} {stderr}");
    }
}

/// A file that is cut short while it is read is a damaged file, not the end of the process by SIGBUS.
#[test]
fn inputs_that_shrink_or_vanish_meanwhile_are_told() {
    let folder = folder();
    let path = folder.path().join("shrinks.binary");
    let (mut seen, mut takes) = ([0; 2], Duration::ZERO);
    for i in 0..7 {
        // All zeros, without a byte on the disk.
        std::fs::write(&path, &fixture().table[..12]).unwrap();
        let file = File::options().write(true).open(&path).unwrap();
        file.set_len(fixture().table.len() as u64).unwrap();
        let before = Instant::now();
        let mut child = start(folder.path(), &["compare", "t.csbrdf", "shrinks.binary", "--render", "0"]);
        if i == 0 {
            // Undisturbed.
            assert!(output(child).0.success());
            takes = before.elapsed();
            continue;
        }
        wait(&mut child, takes * i / 6);
        file.set_len(12).unwrap();
        let (status, stderr) = output(child);
        let code = status.code().unwrap_or_else(|| panic!("{status}"));
        match code {
            OK => seen[0] += 1,
            _ => {
                fails((status, stderr), BAD_INPUT, &["shrinks.binary", "truncated"]);
                seen[1] += 1;
            }
        }
    }
    println!("{} were read before, {} were reported", seen[0], seen[1]);

    // A name that is taken away does not take the file away that was opened under it.
    let small = folder.path().join("small.csbrdf");
    for i in 0..6 {
        std::fs::write(&small, &fixture().file).unwrap();
        let child = start(folder.path(), &["verify", "small.csbrdf"]);
        std::thread::sleep(Duration::from_micros(500 * i));
        std::fs::remove_file(&small).unwrap();
        let ended = output(child);
        if ended.0.code() != Some(OK) {
            fails(ended, OPERATION, &["small.csbrdf: no such file or directory; check the path"]);
        }
    }
}
