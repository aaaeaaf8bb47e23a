//! Measuring only what is needed: plan, measurements, file, as a lab sees it.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

/// Settings that encode fast.
const FAST: [&str; 4] = ["--preset", "paper", "--quality", "0.5"];

struct Run {
    code: i32,
    stdout: String,
    stderr: String,
}

fn run_with(args: &[&str], input: Stdio) -> Run {
    let output = Command::new(env!("CARGO_BIN_EXE_csbrdf")).args(args).stdin(input).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8_lossy(&bytes).into_owned();
    let run = Run { code: output.status.code().unwrap(), stdout: text(output.stdout), stderr: text(output.stderr) };
    assert!(!run.stderr.contains("panicked"), "{}", run.stderr);
    run
}

fn run(args: &[&str]) -> Run {
    run_with(args, Stdio::null())
}

#[track_caller]
fn done(args: &[&str]) -> Run {
    let run = run(args);
    assert_eq!(run.code, 0, "{args:?}: {}", run.stderr);
    run
}

#[track_caller]
fn fails(args: &[&str], code: i32, parts: &[&str]) {
    let run = run(args);
    assert_eq!((run.code, run.stdout.as_str()), (code, ""), "{}", run.stderr);
    assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
    for part in parts {
        assert!(run.stderr.contains(part), "{part:?} is not in {:?}", run.stderr);
    }
}

fn json(args: &[&str]) -> Value {
    serde_json::from_str(&done(args).stdout).unwrap()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap()
}

fn path(folder: &Path, name: &str) -> String {
    let path: PathBuf = folder.join(name);
    path.to_str().unwrap().into()
}

#[test]
fn from_a_plan_to_a_file_that_is_near_the_whole_table() {
    let folder = folder();
    let at = |name| path(folder.path(), name);
    let (table, list, file) = (at("matte.binary"), at("list.csv"), at("list.csbrdf"));
    done(&["synth", "matte", "-o", &table]);
    let plan = done(&["plan", "--sampling", "2%", "--seed", "9", "--fill", &table, "-o", &list]);
    assert!(plan.stderr.contains("bins to measure, 2.3 % of 1,112,344"), "{}", plan.stderr);
    let encode = done(&[&["encode", "--samples", &list], &FAST[..]].concat());
    assert!(encode.stderr.contains("0 rows without a measurement, 0 repeated"), "{}", encode.stderr);

    let compared = json(&["compare", &table, &file, "--json", "--render", "0"]);
    assert!(compared["overall"]["log_rms"].as_f64().unwrap() < 0.1, "{compared}");
    // Filled in, all over: nothing that is possible is called impossible.
    let filled = at("filled.binary");
    done(&["decode", &file, "--fill", "-o", &filled]);
    let compared = json(&["compare", &table, &filled, "--json", "--render", "0"]);
    assert_eq!(compared["only_in_reference"], 0);
    assert!(compared["overall"]["log_rms"].as_f64().unwrap() < 0.3, "{compared}");
    let info = json(&["info", &file, "--json"]);
    let rows = std::fs::read_to_string(&list).unwrap().lines().count() - 3;
    let origins = &info["origins"];
    assert_eq!(origins["sampled"], 3 * rows, "{info}");
    assert_eq!(origins["measured"], 0);
    assert_eq!(origins["impossible"], 3 * 343_956);
    assert_eq!(origins["filled"], 3 * (1_458_000 - 343_956 - rows));

    // Through pipes, the rows the other way round: the same bytes.
    let text = std::fs::read_to_string(&list).unwrap();
    let mut lines: Vec<&str> = text.lines().collect();
    lines[3..].reverse();
    let (turned, other) = (at("turned.csv"), at("turned.csbrdf"));
    std::fs::write(&turned, lines.join("\n")).unwrap();
    let args = [&["encode", "--samples", "-", "-q", "-o", &other, "--meta", "source_sha256=x"], &FAST[..]].concat();
    let piped = run_with(&args, std::fs::File::open(&turned).unwrap().into());
    assert_eq!((piped.code, piped.stderr.as_str()), (0, ""));
    let (one, two) = (at("one.binary"), at("two.binary"));
    done(&["decode", &file, "-o", &one]);
    done(&["decode", &other, "-o", &two]);
    assert!(std::fs::read(one).unwrap() == std::fs::read(two).unwrap());
}

#[test]
fn a_plan_is_text_that_says_how_it_was_drawn() {
    let folder = folder();
    let plan = done(&["plan", "--ratio", "0.001", "--seed", "5", "--block-shape", "9,9,36", "--grid", "360"]);
    let lines: Vec<&str> = plan.stdout.lines().collect();
    let rows = lines.len() - 3;
    assert!(lines[0].starts_with("# csbrdf plan version="), "{}", lines[0]);
    for part in ["grid=360", "seed=5", "block=9x9x36", &format!("rows={rows}"), "candidates=2224688"] {
        assert!(lines[0].contains(part), "{part} {}", lines[0]);
    }
    assert!(lines[2].starts_with("theta_h_bin,theta_d_bin,phi_d_bin,theta_h_deg,") && plan.stderr.is_empty());
    assert!((2400..2800).contains(&rows), "{rows}");
    // The same again; another with another seed; never over a file that is there.
    let list = path(folder.path(), "list.csv");
    let args = ["plan", "--ratio", "0.1%", "--block", "9,9,36", "--grid", "360", "-q", "-o", &list, "--seed"];
    assert_eq!(done(&[&args[..], &["5"]].concat()).stderr, "");
    assert_eq!(std::fs::read_to_string(&list).unwrap(), plan.stdout);
    fails(&[&args[..], &["6"]].concat(), 1, &["exists already"]);
    done(&[&args[..], &["6", "--force"]].concat());
    assert_ne!(std::fs::read_to_string(&list).unwrap(), plan.stdout);
}

#[test]
fn a_plan_keeps_to_the_bins_of_a_table() {
    let folder = folder();
    let (table, list) = (path(folder.path(), "t.binary"), path(folder.path(), "t.csv"));
    done(&["synth", "matte", "--holes", "0.5", "-o", &table]);
    done(&["plan", "--sampling", "1%", "--valid", &table, "--fill", &table, "-o", &list]);
    let text = std::fs::read_to_string(&list).unwrap();
    assert!(text.lines().skip(3).all(|row| !row.contains(",-1.0")));
    done(&["plan", "--sampling", "1%", "--fill", &table, "-o", &list, "--force"]);
    assert!(std::fs::read_to_string(&list).unwrap().contains(",-1.0"));
    fails(&["plan", "--grid", "360", "--fill", &table], 3, &["t.binary", "--grid 180 or 360"]);
    fails(&["plan", "--valid", "-", "--fill", "-"], 2, &["only one"]);
}

#[test]
fn mistakes_in_a_list_are_named_by_file_line_and_column() {
    let folder = folder();
    let list = path(folder.path(), "lab.csv");
    let head = "# lab\ntheta_h_bin,theta_d_bin,phi_d_bin,r,g,b\n1,2,3,1,1,1\n";
    let encode = ["encode", "--samples", &list, "--force"];
    for (rows, parts) in [
        ("1,2,4,1,1,x\n", ["lab.csv", "line 4: column b: \"x\" is not a number"]),
        ("1,2,200,1,1,1\n", ["lab.csv", "line 4: column phi_d_bin: 200 is out of range, 0 to 179"]),
        ("1,2,4,nan,1,1\n", ["lab.csv", "line 4: column r: is not a number"]),
        ("1,2,4,1,1\n", ["lab.csv", "line 4: 5 fields"]),
    ] {
        std::fs::write(&list, format!("{head}{rows}")).unwrap();
        fails(&encode, 3, &parts);
    }
    std::fs::write(&list, "theta_h_bin,theta_d_bin,phi_d_bin\n1,2,3\n").unwrap();
    fails(&encode, 3, &["column r is missing", "1/sr"]);
    std::fs::write(&list, [0u8; 100]).unwrap();
    fails(&encode, 3, &["is no text"]);
    // Usage.
    for extra in [&["--sampling", "5%"][..], &["--seed", "1"], &["t.binary"], &["--grid", "90"]] {
        assert_eq!(run(&[&encode[..], extra].concat()).code, 2, "{extra:?}");
    }
    assert_eq!(run(&["encode", "t.binary", "--grid", "180"]).code, 2);
    fails(&["encode", "--samples", "no-such.csv"], 1, &["no-such.csv", "check the path"]);
}
