//! The tool with hostile text: names and traces of any length, without end, with characters that steer a terminal, a page or a
//! spreadsheet; and with a standard output that is not there.
#![cfg(unix)]

mod common;

use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use common::{BAD_INPUT, BROKEN_PIPE, OK, OPERATION, USAGE};
use csbrdf::encode::Encoder;
use csbrdf::format::metadata::Metadata;
use csbrdf::table::BrdfTable;
use csbrdf::table::grid::{Axis, AxisName, Channel, Grid, Mapping};
use serde_json::Value;

const TOOL: &str = env!("CARGO_BIN_EXE_csbrdf");

/// What each text below holds: the writing direction turned round, a line separator, a space of no width, a byte order mark, an
/// escape sequence, C1's introducer of one, and a tag.
const HIDDEN: &str = "\u{202E}\u{2028}\u{200B}\u{FEFF}\u{1b}[31m\u{9b}2J\u{E0041}";

fn is_hidden(c: char) -> bool {
    c != '\n' && (c.is_control() || HIDDEN.contains(c) && !c.is_ascii())
}

/// Runs the tool, and expects its exit code.
#[track_caller]
fn run(folder: &Path, args: &[&str], code: i32) -> (String, String) {
    let output = Command::new(TOOL).args(args).current_dir(folder).stdin(Stdio::null()).output().unwrap();
    texts(output, code)
}

/// A line of the shell with the tool as `$0`.
#[track_caller]
fn shell(folder: &Path, line: &str, code: i32) -> (String, String) {
    let output = Command::new("bash").args(["-c", line, TOOL]).current_dir(folder).stdin(Stdio::null()).output();
    texts(output.unwrap(), code)
}

/// Standard output and standard error, in which nothing is hidden.
#[track_caller]
fn texts(output: Output, code: i32) -> (String, String) {
    let [stdout, stderr] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert_eq!(output.status.code(), Some(code), "{stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
    for text in [&stdout, &stderr] {
        assert!(!text.contains(is_hidden), "{text:?}");
    }
    (stdout, stderr)
}

/// A small file whose channels and metadata have the given names.
fn file(folder: &Path, name: &str, channels: [&str; 3]) -> PathBuf {
    let axis = |name, len, mapping, end| Axis { name, len, mapping, start: 0.0, end };
    let (quarter, half) = (std::f64::consts::FRAC_PI_2, std::f64::consts::PI);
    let axes = vec![
        axis(AxisName::ThetaH, 12, Mapping::Square, quarter),
        axis(AxisName::ThetaD, 10, Mapping::Linear, quarter),
        axis(AxisName::PhiD, 12, Mapping::Linear, half),
    ];
    let channel = |name: &str| Channel { name: name.into(), wavelength: None, scale: 1.0 };
    let grid = Grid::new(axes, channels.map(channel).to_vec()).unwrap();
    let values = (0..3 * grid.positions()).map(|i| 0.1 + (i % 17) as f64 * 0.01).collect();
    let table = BrdfTable::from_values(grid, values).unwrap();
    let mut metadata = Metadata { name: Some(format!("name{HIDDEN}")), ..Metadata::default() };
    metadata.authors = vec![format!("author{HIDDEN}"), "=1+1".into()];
    metadata.other.insert(format!("key{HIDDEN}"), Value::from(HIDDEN));
    let encoded = Encoder::new().block_shape(&[6, 5, 6]).metadata(metadata).encode(&table).unwrap();
    let path = folder.join(name);
    std::fs::write(&path, encoded.bytes).unwrap();
    path
}

#[test]
fn text_out_of_files_and_names_steers_no_terminal() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let names = [format!("R{HIDDEN}"), "=1+1".to_string(), "-2+cmd".to_string()];
    let name = format!("t{HIDDEN}.csbrdf");
    file(folder, &name, [&names[0], &names[1], &names[2]]);
    let (info, _) = run(folder, &["info", &name, "--blocks"], OK);
    assert!(info.contains("name\u{FFFD}") && info.contains("author\u{FFFD}") && info.contains("key\u{FFFD}"), "{info}");
    for command in [&["verify", &name][..], &["lint", &name], &["compare", &name, &name, "--render", "0"]] {
        let (text, _) = run(folder, command, OK);
        assert!(text.contains("t\u{FFFD}"), "{text}");
    }
    // JSON keeps the text, as escapes.
    for command in [
        &["info", &name, "--json"][..],
        &["lint", &name, "--json"],
        &["eval", &name, "--json", "--angles", "10,0,20,40"],
    ] {
        let (text, _) = run(folder, command, OK);
        let value: Value = serde_json::from_str(&text).unwrap();
        let channel = &value["channels"][0];
        let channel = channel.get("name").unwrap_or(channel);
        assert_eq!(*channel, Value::from(names[0].as_str()), "{text}");
    }
    // CSV: no formula but numbers.
    let (csv, _) = run(folder, &["decode", &name, "--block", "0", "--format", "csv"], OK);
    let head = csv.lines().next().unwrap();
    assert!(head.ends_with(",'=1+1,'-2+cmd") && head.starts_with("theta_h_bin,"), "{head}");
    assert!(csv.lines().nth(1).unwrap().split(',').all(|field| field.parse::<f64>().is_ok()), "{csv}");
    // Errors that name files and arguments, clap's among them.
    run(folder, &["info", &format!("gone{HIDDEN}")], OPERATION);
    run(folder, &["info", &format!("--x{HIDDEN}")], USAGE);
    run(folder, &["synth", &format!("x{HIDDEN}")], USAGE);
    let raw = std::ffi::OsString::from_vec(b"raw\xFF\xED\xA0\x80".to_vec());
    let output = Command::new(TOOL).arg("info").arg(raw).output().unwrap();
    texts(output, OPERATION);
}

#[test]
fn traces_without_end_are_not_read_to_it() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    file(folder, "t.csbrdf", ["R", "G", "B"]);
    let start = Instant::now();
    let (_, error) = run(folder, &["prune", "t.csbrdf", "--trace", "/dev/zero", "-o", "x"], BAD_INPUT);
    assert!(error.contains("/dev/zero") && error.contains("first line is not"), "{error}");
    // Text that goes on for ever, by way of a pipe.
    let head = "printf 'csbrdf trace 1\\nblocks 8 index 0\\n'";
    for (rest, part) in [("tr '\\0' x < /dev/zero", "more than 4096 bytes"), ("yes hello", "`hello` is not a block")] {
        let line = format!("$0 prune t.csbrdf -o x --trace <({head}; {rest})");
        let (_, error) = shell(folder, &line, BAD_INPUT);
        assert!(error.contains(part) && error.len() < 500, "{error}");
    }
    let (_, error) = shell(folder, "$0 eval t.csbrdf --pairs /dev/zero", BAD_INPUT);
    assert!(error.contains("line 1 has more than 4096 bytes"), "{error}");
    let (_, error) = shell(folder, "ulimit -v 500000; $0 encode --samples /dev/zero -o x", BAD_INPUT);
    assert!(error.contains("/dev/zero: is no text"), "{error}");
    // A line of megabytes is not echoed.
    std::fs::write(folder.join("long"), format!("csbrdf trace 1\n{}", "7".repeat(5_000_000))).unwrap();
    let (_, error) = run(folder, &["prune", "t.csbrdf", "--trace", "long", "-o", "x"], BAD_INPUT);
    assert!(error.len() < 500 && error.contains("more than 4096 bytes"), "{}", error.len());
    std::fs::write(folder.join("long"), format!("csbrdf trace 1\n{}", "7".repeat(4000))).unwrap();
    let (_, error) = run(folder, &["prune", "t.csbrdf", "--trace", "long", "-o", "x"], BAD_INPUT);
    assert!(error.len() < 500 && error.contains("777... (3920 more bytes)"), "{error}");
    assert!(!folder.join("x").exists() && start.elapsed() < Duration::from_secs(60));
}

#[test]
fn the_odd_trace_is_named_and_blocks_that_are_gone_are_counted() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    file(folder, "one.csbrdf", ["R", "G", "B"]);
    file(folder, "other.csbrdf", ["R", "G", "Blue"]);
    let angles = ["--angles", "10,0,20,40", "--trace"];
    for name in ["one", "other"] {
        run(folder, &[&["eval", &format!("{name}.csbrdf")], &angles[..], &[&format!("{name}.trace")]].concat(), OK);
    }
    // Their indexes may be alike; of another file this one is surely.
    let text = std::fs::read_to_string(folder.join("other.trace")).unwrap();
    let odd = text.split_once("index ").unwrap().0.to_string() + "index 00000bad\n0\n";
    std::fs::write(folder.join("odd.trace"), odd).unwrap();
    for order in [["one.trace", "odd.trace"], ["odd.trace", "one.trace"]] {
        let args = ["prune", "one.csbrdf", "--trace", order[0], "--trace", order[1], "-o", "x"];
        let (_, error) = run(folder, &args, USAGE);
        assert!(
            error.starts_with("csbrdf: odd.trace: the trace is of another file: of 8 blocks with index 00000bad"),
            "{error}"
        );
    }
    run(folder, &["prune", "one.csbrdf", "--trace", "one.trace", "-o", "small.csbrdf"], OK);
    // What the pruned file's scenes look at with --coarse, where most is gone.
    let all =
        [&["eval", "small.csbrdf", "--coarse"][..], &["--angles", "80,0,80,20", "--trace", "gone.trace"]].concat();
    run(folder, &all, OK);
    let (_, note) = run(folder, &["prune", "small.csbrdf", "--trace", "gone.trace", "-o", "less.csbrdf"], OK);
    assert!(note.contains("warning: the trace names") && note.contains("holds only the mean of"), "{note}");
}

#[test]
fn a_standard_output_that_is_not_there_is_an_error() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    file(folder, "t.csbrdf", ["R", "G", "B"]);
    let commands = [
        "--help",
        "--version",
        "help encode",
        "info t.csbrdf",
        "verify t.csbrdf",
        "lint t.csbrdf",
        "synth --list",
        "eval t.csbrdf --angles 10,0,20,40",
        "compare t.csbrdf t.csbrdf --render 0",
        "decode t.csbrdf --format npy -o -",
        "decode t.csbrdf --block 0 --format csv",
        "plan --sampling 0.1%",
    ];
    for command in commands {
        let (_, error) = shell(folder, &format!("$0 {command} >&-"), OPERATION);
        assert!(error.contains("standard output: is closed"), "{command}: {error}");
        if Path::new("/dev/full").exists() {
            let (_, error) = shell(folder, &format!("$0 {command} >/dev/full"), OPERATION);
            assert!(error.contains("standard output: no space left"), "{command}: {error}");
        }
        shell(folder, &format!("$0 {command} >/dev/null"), OK);
    }
    // What goes to a file needs none.
    shell(folder, "$0 decode t.csbrdf --format npy -o t.npy >&- && test -s t.npy", OK);
}

#[test]
fn a_reader_that_goes_away_is_no_success() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    file(folder, "t.csbrdf", ["R", "G", "B"]);
    for command in ["info t.csbrdf --blocks", "--help", "synth --list", "decode t.csbrdf --format npy -o -"] {
        // The tool begins once its reader has gone.
        let line = format!("{{ sleep 0.2; $0 {command}; echo $? > code; }} | true");
        let (_, error) = shell(folder, &line, OK);
        let until = Instant::now() + Duration::from_secs(20);
        let code = loop {
            match std::fs::read_to_string(folder.join("code")) {
                Ok(code) if !code.is_empty() => break code,
                _ => assert!(Instant::now() < until, "{command}"),
            }
            std::thread::sleep(Duration::from_millis(20));
        };
        std::fs::remove_file(folder.join("code")).unwrap();
        assert_eq!((code.trim(), error.as_str()), (BROKEN_PIPE.to_string().as_str(), ""), "{command}");
    }
}

#[test]
fn materials_of_a_study_stay_apart_whatever_their_names() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    std::fs::create_dir(folder.join("tables")).unwrap();
    run(folder, &["synth", "matte", "-o", "m.binary"], OK);
    let names = ["\u{1}", "\u{2}"].map(|end| "l".repeat(247) + end);
    for name in &names {
        std::fs::hard_link(folder.join("m.binary"), folder.join("tables").join(format!("{name}.binary"))).unwrap();
    }
    let study = ["study", "tables", "--only", "negative", "--ratios", "1%", "--size", "8", "--spp", "1"];
    // Too long a path is known before the work.
    let deep = "d".repeat(250);
    let out = vec![deep.as_str(); 15].join("/") + "/" + &"e".repeat(200);
    let start = Instant::now();
    let (_, error) = run(folder, &[&study[..], &["--out", &out]].concat(), OPERATION);
    assert!(error.contains("too long") && start.elapsed() < Duration::from_secs(20), "{error}");

    let materials = names.join(",");
    let args = [&study[..], &["--materials", &materials, "--out", "out", "--quick"]].concat();
    let (_, notes) = run(folder, &args, OK);
    assert_eq!(notes.matches("is called").count(), 2, "{notes}");
    let pictures = std::fs::read_dir(folder.join("out")).unwrap().map(|entry| entry.unwrap().file_name());
    let pictures: Vec<String> = pictures.map(|name| name.into_string().unwrap()).collect();
    let pictures = pictures.iter().filter(|name| name.starts_with("negative-") && name.ends_with(".png"));
    assert_eq!(pictures.count(), 2);
    let csv = std::fs::read_to_string(folder.join("out/negative.csv")).unwrap();
    let mut materials: Vec<&str> = csv.lines().skip(1).filter_map(|line| line.split(',').next()).collect();
    materials.sort_unstable();
    materials.dedup();
    assert_eq!(materials.len(), 2, "{csv}");
}

#[test]
fn names_too_long_for_an_output_are_refused_before_the_work() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let name = format!("{}.csbrdf", "n".repeat(248));
    file(folder, &name, ["R", "G", "B"]);
    let (_, error) = run(folder, &["prune", &name, "--channels", "R"], OPERATION);
    assert!(error.contains("choose a shorter name"), "{error}");
}
