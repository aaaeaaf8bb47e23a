//! The command-line tool as its users see it: standard output, standard error, exit code, files.

mod common;

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

use common::{BAD_INPUT, BROKEN_PIPE, FAST, OK, OPERATION, UNSUPPORTED, USAGE};
use serde_json::Value;
use tempfile::TempDir;

/// A finished run.
struct Run {
    code: i32,
    stdout: Vec<u8>,
    stderr: String,
}

impl Run {
    fn of(output: Output) -> Run {
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert!(!stderr.contains("panicked"), "{stderr}");
        Run { code: output.status.code().unwrap(), stdout: output.stdout, stderr }
    }

    fn text(&self) -> &str {
        std::str::from_utf8(&self.stdout).unwrap()
    }

    fn json(&self) -> Value {
        serde_json::from_slice(&self.stdout).unwrap()
    }

    /// Asserts the exit code.
    #[track_caller]
    fn expect(self, code: i32) -> Run {
        assert_eq!(self.code, code, "stdout: {:.300} stderr: {}", String::from_utf8_lossy(&self.stdout), self.stderr);
        self
    }

    /// Asserts a failure with one line on standard error that holds all of `parts`, and nothing on standard output.
    #[track_caller]
    fn fails(self, code: i32, parts: &[&str]) {
        let run = self.expect(code);
        assert!(run.stderr.starts_with("csbrdf: ") && run.stderr.lines().count() == 1, "{}", run.stderr);
        for part in parts {
            assert!(run.stderr.contains(part), "{part:?} is not in {:?}", run.stderr);
        }
        assert!(run.stdout.is_empty());
    }
}

fn command(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_csbrdf"));
    command.args(args).stdin(Stdio::null());
    command
}

/// Runs the tool in an empty or given folder.
fn run_in(folder: &Path, args: &[&str]) -> Run {
    Run::of(command(args).current_dir(folder).output().unwrap())
}

fn run(args: &[&str]) -> Run {
    run_in(Path::new(env!("CARGO_TARGET_TMPDIR")), args)
}

/// Runs the tool with bytes on its standard input.
fn pipe(args: &[&str], input: &[u8]) -> Run {
    let mut child = command(args).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    std::thread::scope(|scope| {
        // The tool may refuse its input before the end.
        scope.spawn(move || drop(stdin.write_all(input)));
        Run::of(child.wait_with_output().unwrap())
    })
}

/// A synthetic table and its file, made once for all tests.
struct Fixture {
    table: PathBuf,
    file: PathBuf,
}

impl Fixture {
    fn table(&self) -> &str {
        self.table.to_str().unwrap()
    }

    fn file(&self) -> &str {
        self.file.to_str().unwrap()
    }
}

fn fixture() -> &'static Fixture {
    static FIXTURE: OnceLock<Fixture> = OnceLock::new();
    FIXTURE.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("cli");
        std::fs::create_dir_all(&folder).unwrap();
        let fixture = Fixture { table: folder.join("satin.binary"), file: folder.join("satin.csbrdf") };
        let noise = ["--noise", "0.003", "--holes", "0.0005", "--seed", "7", "--force"];
        run(&[&["synth", "satin-paint", "-o", fixture.table()], &noise[..]].concat()).expect(OK);
        let made =
            run(&[&["encode", fixture.table(), "--threads", "2", "--force", "--meta", "lab=x"], &FAST[..]].concat())
                .expect(OK);
        assert!(made.stdout.is_empty());
        assert!(made.stderr.lines().count() == 1 && made.stderr.contains(":1, log rms"), "{}", made.stderr);
        fixture
    })
}

fn empty_folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// Names of all files in a folder, hidden ones included.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Shape and values of an .npy file of float32.
fn npy(bytes: &[u8]) -> (Vec<usize>, Vec<f32>) {
    let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = std::str::from_utf8(&bytes[10..end]).unwrap();
    assert!(header.contains("'<f4'") && header.contains("'fortran_order': False"));
    let shape = header.split(['(', ')']).nth(1).unwrap();
    let shape = shape.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    (shape, bytes[end..].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect())
}

#[test]
fn help_lists_subcommands_and_exit_codes() {
    let help = run(&["--help"]).expect(OK);
    for subcommand in [
        "encode", "plan", "decode", "info", "verify", "lint", "compare", "eval", "render", "prune", "repair", "synth",
        "report", "demo", "study",
    ] {
        assert!(help.text().contains(subcommand));
        let own = run(&[subcommand, "--help"]).expect(OK);
        assert!(own.text().contains("Examples:\n  csbrdf "), "{subcommand}");
        // Once, in the tool's own help, which each summary names.
        assert!(!own.text().contains("Exit codes:"), "{subcommand}");
        assert!(run(&[subcommand, "-h"]).expect(OK).text().contains("exit codes: csbrdf --help"), "{subcommand}");
    }
    assert!(help.text().contains("Exit codes:") && help.text().contains("3    an input is damaged"));
    let encode = run(&["encode", "--help"]).expect(OK);
    let groups =
        ["How small or how good:", "What to keep:", "Recovery from samples:", "Output:", "Expert:", "Examples:"];
    let places: Vec<_> = groups.iter().map(|group| encode.text().find(group).expect(group)).collect();
    assert!(places.is_sorted(), "{places:?}");
    assert!(run(&["--version"]).expect(OK).text().starts_with("csbrdf "));
    // Without a subcommand: the help, as a usage error.
    assert!(run(&[]).expect(USAGE).stderr.contains("Usage:"));
}

#[test]
fn wrong_arguments_are_usage_errors() {
    let (table, file) = (fixture().table(), fixture().file());
    let cases: &[&[&str]] = &[
        &["frobnicate"],
        &["encode"],
        &["encode", table, "--quality", "0"],
        &["encode", table, "--quality", "nan"],
        &["encode", table, "--sampling", "101%"],
        &["encode", table, "--sampling", "0"],
        &["encode", table, "--sampling", "auto"],
        &["encode", table, "--rmse", "0.02", "--quality", "0.1"],
        &["encode", table, "--max-error", "0.02", "--psnr", "60"],
        &["encode", table, "--sampling", "auto", "--psnr", "60"],
        &["encode", table, "--sampling", "auto", "--rmse", "0"],
        &["encode", table, "--size", "0"],
        &["encode", table, "--block", "15,0,15"],
        &["encode", table, "--block", "1,1,1,1,1"],
        &["encode", table, "--block", "99999999999999999999,1,1"],
        &["encode", table, "--eps", "-1"],
        &["encode", table, "--sigma", "inf"],
        &["encode", table, "--seed", "-1"],
        &["encode", table, "--preset", "best"],
        &["encode", table, "--meta", "novalue"],
        &["encode", table, "--meta", "name=a", "--meta", "name=b"],
        &["encode", table, "--meta", "encoder=mine"],
        &["encode", table, "--threads", "0"],
        &["encode", table, file, "-o", "x.csbrdf"],
        &["encode", table, "-", "--out-dir", "x"],
        &["encode", "-", "--out-dir", "x"],
        &["encode", table, "-o", "x", "--out-dir", "x"],
        &["encode", "a/x.binary", "b/x.binary", "--out-dir", "x"],
        &["decode", file, "-o", "x.exr"],
        &["decode", file, "-o", "x.csv"],
        &["decode", file, "-o", "x.binary", "--block", "0,0,0"],
        &["decode", file, "-o", "-", "--block", "0,0"],
        &["decode", file, "-o", "-", "--block", "6,0,0"],
        &["decode", file, "-o", "-", "--block", "432"],
        &["compare", file],
        &["compare", "-", "-"],
        &["compare", file, file, "--eps", "0"],
        &["compare", file, file, "--render", "99999"],
        &["compare", file, file, "--render", "0", "--png", "x.png"],
        &["eval", file, "--wi", "0,0,1"],
        &["eval", file, "--wi", "0,0", "--wo", "0,0,1"],
        &["eval", file, "--wi", "0,0,nan", "--wo", "0,0,1"],
        &["eval", file, "--angles", "1,2,3"],
        &["eval", "-"],
        &["synth"],
        &["synth", "unobtainium"],
        &["synth", "matte", "--holes", "2"],
        &["synth", "matte", "--noise", "nan"],
        &["synth", "matte", "--phi-d", "90"],
    ];
    let folder = empty_folder();
    for args in cases {
        let run = run_in(folder.path(), args).expect(USAGE);
        assert!(run.stdout.is_empty() && !run.stderr.is_empty(), "{args:?}");
        assert!(names(folder.path()).is_empty(), "{args:?}");
    }
}

#[test]
fn the_same_bytes_come_from_any_number_of_threads_and_through_pipes() {
    let table = std::fs::read(fixture().table()).unwrap();
    // Standard input has no name of its own.
    let args = ["encode", "-", "--threads", "1", "--meta", "lab=x"];
    let named = ["--meta", "name=satin", "--meta", "source_file=satin.binary"];
    let encoded = pipe(&[&args[..], &named, &FAST].concat(), &table).expect(OK);
    assert!(encoded.stdout == std::fs::read(fixture().file()).unwrap());
    assert!(encoded.stderr.starts_with("standard input -> standard output: "), "{}", encoded.stderr);

    let one = pipe(&["decode", "-", "--threads", "1"], &encoded.stdout).expect(OK);
    let two = pipe(&["decode", "-", "-o", "-", "--threads", "2"], &encoded.stdout).expect(OK);
    assert!(one.stdout == two.stdout && one.stdout.len() == table.len() && one.stdout[..12] == table[..12]);
    assert!(one.stderr.is_empty());
    let compared = pipe(&["compare", fixture().table(), "-", "--json", "--render", "0"], &one.stdout).expect(OK).json();
    assert!(compared["overall"]["log_rms"].as_f64().unwrap() < 0.05);
    assert_eq!((compared["only_in_reference"].as_u64(), compared["only_in_other"].as_u64()), (Some(0), Some(0)));
}

#[test]
fn nothing_is_replaced_without_force() {
    let folder = empty_folder();
    let out = folder.path().join("taken.binary");
    let taken = out.to_str().unwrap();
    let picture = folder.path().join("csbrdf-demo.png");
    for path in [&out, &picture] {
        std::fs::write(path, "precious").unwrap();
    }
    let (table, file) = (fixture().table(), fixture().file());
    for args in [
        &["encode", table, "-o", taken][..],
        &["decode", file, "-o", taken],
        &["decode", file, "--block", "0", "-o", taken, "--format", "npy"],
        &["compare", file, file, "--png", taken],
        &["synth", "matte", "-o", taken],
    ] {
        run(args).fails(OPERATION, &[taken, "exists already", "--force"]);
    }
    run(&["demo", "--out", folder.path().to_str().unwrap()]).fails(OPERATION, &["csbrdf-demo.png", "--force"]);
    for path in [&out, &picture] {
        assert_eq!(std::fs::read(path).unwrap(), b"precious");
    }
    run(&["decode", file, "-o", taken, "--force"]).expect(OK);
    assert_eq!(std::fs::metadata(&out).unwrap().len(), 34_992_012);
    assert_eq!(names(folder.path()), ["csbrdf-demo.png", "taken.binary"]);
}

#[cfg(unix)]
#[test]
fn outputs_are_like_other_new_files_and_devices_stay_devices() {
    use std::os::unix::fs::PermissionsExt;
    let folder = empty_folder();
    let file = fixture().file();
    run_in(folder.path(), &["decode", file, "--block", "0", "-o", "block.npy"]).expect(OK);
    std::fs::write(folder.path().join("plain"), "").unwrap();
    let mode = |name: &str| std::fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
    assert_eq!(mode("block.npy"), mode("plain"));
    let device = folder.path().join("device");
    std::os::unix::fs::symlink("/dev/null", &device).unwrap();
    run_in(folder.path(), &["decode", file, "--block", "0", "-o", "device", "--force"]).expect(OK);
    assert!(std::fs::symlink_metadata(&device).unwrap().is_symlink());
}

#[test]
fn tables_that_are_none_are_refused_and_nothing_is_left() {
    let folder = empty_folder();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let table = std::fs::read(fixture().table()).unwrap();
    let mut wrong_dims = table.clone();
    wrong_dims[..8].copy_from_slice(&[180, 0, 0, 0, 90, 0, 0, 0]);
    wrong_dims[8] = 90;
    let cases: [(&str, &[u8], &str); 7] = [
        ("text.binary", b"theta_h theta_d phi_d\n1 2 3\n", "text file"),
        ("empty.binary", b"", "empty"),
        ("cut.binary", &table[..table.len() - 1], "34992012 bytes needed, 34992011 present"),
        ("head.binary", &table[..7], "truncated"),
        ("long.binary", &[&table[..], &[0]].concat(), "1 bytes follow"),
        ("dims.binary", &wrong_dims, "theta_h has 180 bins"),
        ("rgl.binary", b"tensor_file\0\x01\0\x01\0\0\0", "RGL tensor file"),
    ];
    for (name, bytes, what) in cases {
        std::fs::write(at(name), bytes).unwrap();
        run(&["encode", &at(name)]).fails(BAD_INPUT, &[name, what]);
        run(&["compare", fixture().file(), &at(name)]).fails(BAD_INPUT, &[name, what]);
        std::fs::remove_file(at(name)).unwrap();
    }
    let missing = at("missing.binary");
    let here = folder.path().to_str().unwrap();
    for command in ["encode", "decode", "info", "verify"] {
        run(&[command, &missing]).fails(OPERATION, &["missing.binary", "no such file", "check the path"]);
        // A folder is a set of tables to encode.
        let what = if command == "encode" { "no .binary file in it" } else { "directory" };
        run(&[command, here]).fails(OPERATION, &[here, what]);
    }
    run(&["encode", fixture().table(), "-o", &at("no/folder/x.csbrdf")]).fails(OPERATION, &["no folder"]);
    run(&["encode", fixture().file(), "-o", &at("x.csbrdf")]).fails(BAD_INPUT, &["satin.csbrdf", "already"]);

    run(&["synth", "matte", "--holes", "1", "-o", &at("void.binary")]).expect(OK);
    run(&["encode", &at("void.binary")]).fails(BAD_INPUT, &["void.binary", "no entry is valid"]);
    assert_eq!(names(folder.path()), ["void.binary"]);
}

#[test]
fn damaged_files_are_refused_and_nothing_is_left() {
    let folder = empty_folder();
    let path = folder.path().join("damaged.csbrdf");
    let name = path.to_str().unwrap();
    let out = folder.path().join("out.binary");
    let out = out.to_str().unwrap();
    let good = std::fs::read(fixture().file()).unwrap();
    // Every use of the damaged bytes: a failure that names the file, nothing written.
    let refused = |bytes: &[u8], codes: &[i32], part: &str| {
        std::fs::write(&path, bytes).unwrap();
        for args in [&["verify", name][..], &["decode", name, "-o", out]] {
            let run = run(args);
            assert!(codes.contains(&run.code), "{args:?} {} {}", run.code, run.stderr);
            assert!(run.stderr.contains("damaged.csbrdf: ") && run.stderr.contains(part), "{}", run.stderr);
        }
        assert_eq!(names(folder.path()), ["damaged.csbrdf"]);
    };
    for cut in [1, 7, 8, 31, 32, 100, 300, good.len() / 2, good.len() - 9, good.len() - 1] {
        refused(&good[..cut], &[BAD_INPUT], "truncated");
        run(&["info", name]).fails(BAD_INPUT, &["damaged.csbrdf", "truncated"]);
        run(&["eval", name, "--angles", "0,0,0,0"]).fails(BAD_INPUT, &["damaged.csbrdf", "truncated"]);
    }
    refused(&[&good[..], b"x"].concat(), &[BAD_INPUT], "follow the end");
    let mut bad = good.clone();
    bad[0] = b'x';
    refused(&bad, &[BAD_INPUT], "not a csbrdf file");
    let mut newer = good.clone();
    newer[8] += 1;
    refused(&newer, &[UNSUPPORTED], "format version 2.0");
    for at in (0..good.len()).step_by(good.len() / 23) {
        let mut bad = good.clone();
        bad[at] ^= 1 << (at % 8);
        std::fs::write(&path, &bad).unwrap();
        let verified = run(&["verify", name]);
        assert!([BAD_INPUT, UNSUPPORTED].contains(&verified.code), "byte {at}: {}", verified.stderr);
        assert!(verified.stderr.contains("damaged.csbrdf: "), "{}", verified.stderr);
    }
    for (bytes, part) in [(&b""[..], "empty"), (b"hello world, this is text", "text")] {
        refused(bytes, &[BAD_INPUT], part);
    }
}

#[test]
fn damage_in_one_record_costs_that_block_only() {
    let info = run(&["info", fixture().file(), "--json", "--blocks"]).expect(OK).json();
    let block = &info["blocks"][20];
    let mut bad = std::fs::read(fixture().file()).unwrap();
    bad[(block["offset"].as_u64().unwrap() + 2) as usize] ^= 4;
    let folder = empty_folder();
    let path = folder.path().join("hurt.csbrdf");
    std::fs::write(&path, bad).unwrap();
    let hurt = path.to_str().unwrap();
    let verified = run(&["verify", hurt, fixture().file()]).expect(BAD_INPUT);
    assert!(verified.text().contains("corrupt RECS at offset") && verified.text().contains("satin.csbrdf: ok"));
    run(&["decode", hurt, "--block", "20", "-o", "-"]).fails(BAD_INPUT, &["hurt.csbrdf", "RECS", "offset"]);
    run(&["decode", hurt, "-o", "-"]).fails(BAD_INPUT, &["hurt.csbrdf", "RECS", "offset"]);
    let other = ["--block", "21", "-o", "-"];
    let from_hurt = run(&[&["decode", hurt], &other[..]].concat()).expect(OK).stdout;
    assert!(from_hurt == run(&[&["decode", fixture().file()], &other[..]].concat()).expect(OK).stdout);
    let shown = run(&["info", hurt]).expect(BAD_INPUT);
    assert!(shown.text().contains("\ndamaged ") && shown.stderr.contains("hurt.csbrdf"));
}

#[test]
fn a_failing_input_does_not_stop_the_others() {
    let folder = empty_folder();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    std::fs::write(at("bad.binary"), "no table").unwrap();
    std::fs::copy(fixture().table(), at("second.binary")).unwrap();
    let (bad, second, out) = (at("bad.binary"), at("second.binary"), at("out"));
    let args = ["encode", &bad, fixture().table(), &second, "--out-dir", &out];
    let run = run(&[&args[..], &FAST].concat()).expect(BAD_INPUT);
    assert!(run.stdout.is_empty());
    assert!(run.stderr.contains("bad.binary: is a text file") && run.stderr.contains("1 of 3 failed"));
    let rows: Vec<&str> = run.stderr.lines().filter(|l| l.contains(":1 ")).collect();
    assert!(rows.len() == 2 && rows[0].contains("satin.binary") && rows[1].contains("second.binary"), "{}", run.stderr);
    assert_eq!(names(Path::new(&out)), ["satin.csbrdf", "second.csbrdf"]);
}

#[test]
fn a_block_is_the_same_alone_as_in_the_whole() {
    let file = fixture().file();
    let (shape, whole) = npy(&run(&["decode", file, "--format", "npy", "-o", "-"]).expect(OK).stdout);
    assert_eq!(shape, [3, 90, 90, 180]);
    assert!(whole.contains(&-1.0) && whole.iter().all(|v| v.is_finite()));
    let info = run(&["info", file, "--json", "--blocks"]).expect(OK).json();
    for block in ["0,0,0", "3,4,5", "5,5,11"] {
        let i: Vec<usize> = block.split(',').map(|n| n.parse().unwrap()).collect();
        let number = (i[0] * 6 + i[1]) * 12 + i[2];
        assert_eq!(info["blocks"][number]["origin"], serde_json::json!([15 * i[0], 15 * i[1], 15 * i[2]]));
        let own = run(&["decode", file, "--block", block, "-o", "-"]).expect(OK).stdout;
        assert!(own == run(&["decode", file, "--block", &number.to_string(), "-o", "-"]).expect(OK).stdout);
        let (shape, values) = npy(&own);
        assert_eq!(shape, [3, 15, 15, 15]);
        let csv = run(&["decode", file, "--block", block, "--format", "csv"]).expect(OK);
        let mut rows = csv.text().lines();
        assert_eq!(rows.next(), Some("theta_h_bin,theta_d_bin,phi_d_bin,R,G,B"));
        let n = 15 * 15 * 15;
        for (position, row) in rows.enumerate() {
            let fields: Vec<f32> = row.split(',').map(|f| f.parse().unwrap()).collect();
            let bin = |axis: usize| fields[axis] as usize;
            for c in 0..3 {
                let at = ((c * 90 + bin(0)) * 90 + bin(1)) * 180 + bin(2);
                assert_eq!([fields[3 + c], values[c * n + position]], [whole[at]; 2]);
            }
        }
        assert_eq!(csv.text().lines().count(), n + 1);
    }
    let (_, filled) = npy(&run(&["decode", file, "--format", "npy", "-o", "-", "--fill"]).expect(OK).stdout);
    assert!(!filled.contains(&-1.0));
    assert!(whole.iter().zip(&filled).all(|(w, f)| w == f || *w == -1.0));
    // A name made of the input's.
    let folder = empty_folder();
    std::fs::copy(file, folder.path().join("m.csbrdf")).unwrap();
    run_in(folder.path(), &["decode", "m.csbrdf", "--block", "3,4,5"]).expect(OK);
    run_in(folder.path(), &["decode", "m.csbrdf"]).expect(OK);
    assert_eq!(names(folder.path()), ["m.block-3-4-5.npy", "m.csbrdf", "m.decoded.binary"]);
}

#[test]
fn info_tells_people_and_scripts() {
    let file = fixture().file();
    let info = run(&["info", file, "--json"]).expect(OK).json();
    assert_eq!(info["bytes"], std::fs::metadata(file).unwrap().len());
    assert_eq!(info["axes"][0]["name"], "theta_h");
    assert_eq!(info["channels"][2]["name"], "B");
    assert_eq!(info["partition"]["blocks"], 432);
    assert_eq!((&info["coding"]["basis"], &info["coding"]["quantization"]), (&"dct".into(), &"dependent".into()));
    assert_eq!(info["metadata"]["encoder"]["quality"], 0.5);
    assert_eq!((&info["metadata"]["name"], &info["metadata"]["lab"]), (&"satin".into(), &"x".into()));
    assert_eq!(info["metadata"]["source_file"], "satin.binary");
    assert_eq!(info["metadata"]["source_sha256"].as_str().unwrap().len(), 64);
    let sum = |value: &Value| value.as_object().unwrap().values().map(|n| n.as_u64().unwrap()).sum::<u64>();
    assert_eq!(sum(&info["origins"]), 3 * 90 * 90 * 180);
    assert_eq!(sum(&info["validity_classes"]), 432);
    let sections = info["sections"].as_array().unwrap();
    assert_eq!(sections.iter().map(|s| s["bytes"].as_u64().unwrap()).sum::<u64>(), info["bytes"].as_u64().unwrap());
    assert!(info.get("blocks").is_none());
    let figure = |key: &str| info["errors"][key].as_f64().unwrap();
    assert!(figure("log_rms") <= figure("log_rms_bound") && figure("log_max") <= figure("log_max_bound"));

    let text = run(&["info", file, "--blocks"]).expect(OK);
    for part in ["RECS", "horizon", "sampled", "impossible", "satin.binary", "slices over theta_h", "432 (6 x 6 x 12)"]
    {
        assert!(text.text().contains(part), "{part}");
    }
    assert!(!text.text().contains('\u{1b}'));
    // A line a file.
    let two = run(&["info", "--json", file, file]).expect(OK);
    assert_eq!(two.text().lines().filter(|l| serde_json::from_str::<Value>(l).is_ok()).count(), 2);
}

#[test]
fn verify_says_ok() {
    let run = run(&["verify", fixture().file()]).expect(OK);
    assert!(run.text().ends_with("satin.csbrdf: ok, 432 blocks\n") && run.stderr.is_empty());
}

#[test]
fn equal_tables_compare_as_equal() {
    let folder = empty_folder();
    let png = folder.path().join("x.png");
    let file = fixture().file();
    let args = ["compare", file, file, "--render", "16", "--png", png.to_str().unwrap()];
    let run_text = run(&args).expect(OK);
    assert!(run_text.text().contains("render PSNR, dB  equal  (R equal, G equal, B equal)"), "{}", run_text.text());
    let mut magic = [0; 8];
    std::fs::File::open(&png).unwrap().read_exact(&mut magic).unwrap();
    assert_eq!(&magic, b"\x89PNG\r\n\x1a\n");
    let object = run(&["compare", file, file, "--json", "--render", "0"]).expect(OK).json();
    assert_eq!(object["overall"]["log_max"], 0.0);
    assert!(object["overall"]["snr_db"].is_null() && object["render_psnr_db"].is_null());
    assert_eq!(object["channels"].as_array().unwrap().len(), 3);
}

#[test]
fn eval_gives_the_values_at_directions() {
    let file = fixture().file();
    let below = run(&["eval", file, "--wi", "0,0,-1", "--wo", "0,0,1"]).expect(OK);
    assert_eq!(below.text(), "0 0 0\n");
    assert_eq!(run(&["eval", file, "--angles", "100,0,20,0"]).expect(OK).text(), "0 0 0\n");
    // The centre of bin 0 of every axis is close to the mirror direction at normal incidence.
    let values = |args: &[&str]| -> Vec<f32> {
        let run = run(&[&["eval", file], args].concat()).expect(OK);
        run.text().split_whitespace().map(|v| v.parse().unwrap()).collect()
    };
    let up = values(&["--wi", "0,0,1", "--wo", "0,0,2", "--lookup", "nearest"]);
    let csv = run(&["decode", file, "--block", "0", "--format", "csv"]).expect(OK);
    let first: Vec<f32> = csv.text().lines().nth(1).unwrap().split(',').skip(3).map(|v| v.parse().unwrap()).collect();
    assert_eq!(up, first);
    // Vectors, angles and pairs say the same.
    let vectors = values(&["--wi", "-0.5,0,0.8660254037844386", "--wo", "0,0.5,0.8660254037844386"]);
    let angles = values(&["--angles", "30,180,30,90"]);
    assert!(vectors.iter().zip(&angles).all(|(a, b)| (a / b - 1.0).abs() < 1e-4 && *a > 0.0));
    let pairs = b"# wi wo\n\n-0.5 0 0.8660254037844386  0 0.5 0.8660254037844386\r\n0,0,-1,0,0,1";
    let text = pipe(&["eval", file], pairs).expect(OK);
    let lines: Vec<&str> = text.text().lines().collect();
    assert_eq!((lines.len(), lines[1]), (2, "0 0 0"));
    assert_eq!(lines[0].split(' ').map(|v| v.parse::<f32>().unwrap()).collect::<Vec<_>>(), vectors);
    let json = run(&["eval", file, "--angles", "30,180,30,90", "--json"]).expect(OK).json();
    assert_eq!(json["values"][1].as_f64().unwrap() as f32, angles[1]);
    assert_eq!(json["unit"], "1/sr");
    pipe(&["eval", file, "--pairs", "-"], b"0 0 1 0 0\n").fails(BAD_INPUT, &["standard input", "line 1", "six"]);
    pipe(&["eval", file], &[b'1'; 10_000]).fails(BAD_INPUT, &["line 1"]);
    run(&["eval", file, "--pairs", "no-such-file"]).fails(OPERATION, &["no-such-file"]);
}

#[test]
fn synth_lists_and_makes_tables() {
    let list = run(&["synth", "--list"]).expect(OK);
    assert!(list.text().lines().any(|l| l == "satin-paint"));
    let folder = empty_folder();
    run_in(folder.path(), &["synth", "matte", "--phi-d", "360"]).expect(OK);
    assert_eq!(names(folder.path()), ["matte.binary"]);
    assert_eq!(std::fs::metadata(folder.path().join("matte.binary")).unwrap().len(), 12 + 8 * 3 * 90 * 90 * 360);
}

#[test]
fn a_closed_pipe_ends_the_tool_quietly() {
    let mut child = command(&["decode", fixture().file(), "-o", "-"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut head = [0; 12];
    child.stdout.take().unwrap().read_exact(&mut head).unwrap();
    assert_eq!(head[0], 90);
    // Not 0, as if all had been written: as of SIGPIPE.
    let run = Run::of(child.wait_with_output().unwrap()).expect(BROKEN_PIPE);
    assert!(run.stderr.is_empty(), "{}", run.stderr);
}

#[test]
fn the_demo_needs_nothing() {
    let folder = empty_folder();
    let demo = run(&["demo", "--out", folder.path().to_str().unwrap()]).expect(OK);
    for part in ["ratio", "log error, rms", "render PSNR", "open and decode one block", "csbrdf-demo.png"] {
        assert!(demo.text().contains(part), "{}", demo.text());
    }
    assert!(!demo.text().contains('\u{1b}') && demo.stderr.is_empty());
    assert_eq!(names(folder.path()), ["csbrdf-demo.png"]);
    // What to do next is said; the picture is three balls of 256 pixels and what is around them.
    assert!(demo.text().contains("encode pearl.binary"), "{}", demo.text());
    let picture = std::fs::read(folder.path().join("csbrdf-demo.png")).unwrap();
    assert_eq!(u32::from_be_bytes(picture[16..20].try_into().unwrap()), 3 * 256 + 4 * 16);
}

#[test]
fn lossless_files_give_the_very_bytes_back() {
    let folder = empty_folder();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    // Marks of missing entries of other kinds.
    let mut table = std::fs::read(fixture().table()).unwrap();
    for (i, mark) in [f64::NAN.to_bits() | 77, f64::NEG_INFINITY.to_bits(), (-0.0f64).to_bits()].into_iter().enumerate()
    {
        table[12 + 8 * 1000 * (i + 1)..][..8].copy_from_slice(&mark.to_le_bytes());
    }
    let (source, file, back) = (at("m.binary"), at("m.csbrdf"), at("back.binary"));
    std::fs::write(&source, &table).unwrap();
    run(&[&["encode", &source, "--lossless"], &FAST[..]].concat()).expect(OK);
    run(&["decode", &file, "--exact", "-o", &back]).expect(OK);
    assert!(std::fs::read(&back).unwrap() == table);
    assert!(run(&["decode", &file, "--exact", "-o", "-"]).expect(OK).stdout == table);
    run(&["verify", &file, "--against", &source]).expect(OK);
    assert!(run(&["info", &file]).expect(OK).text().contains("lossless"));
    // One other bit.
    table[12 + 8 * 1000] ^= 1;
    std::fs::write(&source, &table).unwrap();
    let verified = run(&["verify", &file, "--against", &source]).expect(OPERATION);
    assert!(verified.text().contains("1 entries are not restored bit by bit"), "{}", verified.text());

    run(&["decode", fixture().file(), "--exact", "-o", &back, "--force"]).fails(USAGE, &["--lossless"]);
    assert!(std::fs::read(&back).unwrap() != table);
    for args in [["--fill"].as_slice(), &["--block", "0"], &["--format", "npy"]] {
        run(&[&["decode", &file, "--exact", "-o", "-"], args].concat()).expect(USAGE);
    }
    run(&["encode", &source, "--lossless", "--ratio", "2"]).expect(USAGE);
}
