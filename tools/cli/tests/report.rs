//! `csbrdf report` as its users see it: one run, and the commands that it prints.
#![cfg(unix)]

use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;

fn run_in(folder: &Path, words: &[&str]) -> Output {
    let output =
        Command::new(env!("CARGO_BIN_EXE_csbrdf")).args(words).current_dir(folder).stdin(Stdio::null()).output();
    let output = output.unwrap();
    assert!(!String::from_utf8_lossy(&output.stderr).contains("panicked"), "{output:?}");
    output
}

fn ok(folder: &Path, words: &[&str]) -> String {
    let output = run_in(folder, words);
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn fails(folder: &Path, words: &[&str], code: i32, part: &str) {
    let output = run_in(folder, words);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{stderr}");
    assert!(stderr.starts_with("csbrdf: ") && stderr.lines().count() == 1 && stderr.contains(part), "{stderr}");
}

fn names(folder: &Path) -> Vec<String> {
    std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

/// Rows of a CSV file as fields; none of these holds a quote or a line break.
fn rows(path: &Path) -> Vec<Vec<String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut rows = Vec::new();
    for line in text.lines() {
        let mut fields = vec![String::new()];
        let mut quoted = false;
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => fields.push(String::new()),
                c => fields.last_mut().unwrap().push(c),
            }
        }
        rows.push(fields);
    }
    rows
}

/// Leaves of a MERL table the first bins of theta_h alone: the fewer entries are valid, the less is to be solved.
fn keep_theta_h(path: &Path, bins: usize) {
    let mut bytes = std::fs::read(path).unwrap();
    for plane in bytes[12..].chunks_exact_mut(90 * 90 * 180 * 8) {
        plane[bins * 90 * 180 * 8..].chunks_exact_mut(8).for_each(|v| v.copy_from_slice(&f64::to_le_bytes(-1.0)));
    }
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn a_report_is_complete_and_its_commands_give_its_points() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    ok(at, &["synth", "satin-paint", "-o", "a satin.binary", "--noise", "0.003", "--holes", "0.0005"]);
    keep_theta_h(&at.join("a satin.binary"), 10);
    let report = ["report", "a satin.binary", "--out", "r", "--grid", "quick", "--ratios", "5%", "--threads", "2"];
    let few = ["--encode", "--iterations 5 --seed 3", "--trace-iterations", "20", "--render", "32", "--quiet"];
    assert_eq!(ok(at, &[&report[..], &few[..]].concat()), "");

    let points = rows(&at.join("r/report.csv"));
    let column = |name: &str| points[0].iter().position(|c| c == name).unwrap();
    assert!(points.len() > 8 && points.iter().all(|row| row.len() == points[0].len()));
    for row in &points[1..] {
        let number = |name: &str| row[column(name)].parse::<f64>().unwrap();
        assert!(number("bytes") > 1000.0 && number("log_rms") > 0.0 && number("log_max") > number("log_rms"));
        assert!(number("encode_seconds") > 0.0 && number("decode_seconds") > 0.0 && number("render_psnr_db") > 10.0);
        assert!(number("missed_sigma") <= number("solves") && number("iterations") <= 5.0 * number("solves"));
    }
    // One command each of a fully and a thinly sampled setting, by a shell as a user would.
    let tool = Path::new(env!("CARGO_BIN_EXE_csbrdf")).parent().unwrap().display();
    let path = format!("{tool}:{}", std::env::var("PATH").unwrap());
    for preset in ["archive", "paper"] {
        let row = points.iter().rev().find(|row| row[column("preset")] == preset).unwrap();
        let command = &row[column("command")];
        assert!(command.starts_with("csbrdf encode 'a satin.binary' --preset "), "{command}");
        let status = Command::new("sh").args(["-c", command]).current_dir(at).env("PATH", &path).status();
        assert!(status.unwrap().success(), "{command}");
        let made = names(at).into_iter().filter(|name| name.ends_with(".csbrdf")).collect::<Vec<_>>();
        assert_eq!(made.len(), 1);
        let file = at.join(&made[0]);
        assert_eq!(std::fs::metadata(&file).unwrap().len().to_string(), row[column("bytes")]);
        let compared = ok(at, &["compare", "a satin.binary", file.to_str().unwrap(), "--json", "--render", "0"]);
        let compared: Value = serde_json::from_str(&compared).unwrap();
        let rms: f64 = row[column("log_rms")].parse().unwrap();
        assert!((compared["overall"]["log_rms"].as_f64().unwrap() / rms - 1.0).abs() < 1e-4);
        let info: Value = serde_json::from_str(&ok(at, &["info", "--json", file.to_str().unwrap()])).unwrap();
        assert!(info.to_string().contains(&format!("\"log_rms\":{rms}")), "{info}");
        std::fs::remove_file(file).unwrap();
    }

    let page = std::fs::read_to_string(at.join("r/report.html")).unwrap();
    for part in ["encode, s", "decode, ms", "file, kB", "Pareto", "smooth", "glossy", "stiff", "duality gap"] {
        assert!(page.contains(part), "{part}");
    }
    // Self-contained: the only addresses are the name of SVG and places in the page.
    assert_eq!(page.matches("http").count(), page.matches("http://www.w3.org/2000/svg").count());
    assert!(!page.contains("<script") && !page.contains("url(") && !page.contains("NaN"));
    for row in &points[1..] {
        assert!(page.contains(&row[column("command")].replace('\'', "&#39;")));
    }
    for link in page.split("href=\"#").skip(1) {
        let anchor = link.split('"').next().unwrap();
        assert!(page.contains(&format!("id=\"{anchor}\"")), "{anchor}");
    }
    let traces = rows(&at.join("r/traces.csv"));
    assert!(traces.len() > 100 && traces.iter().all(|row| row.len() == traces[0].len()));

    let mut files = names(&at.join("r"));
    files.sort();
    assert_eq!(files, ["report.csv", "report.html", "traces.csv"]);

    // An earlier report stays.
    fails(at, &report, 1, "--force");
}

#[test]
fn what_can_fail_does_so_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("text.binary"), "not a table").unwrap();
    fails(at, &["report", "none.binary"], 1, "none.binary");
    fails(at, &["report", "text.binary"], 3, "is a text file");
    fails(at, &["report", "-"], 2, "standard input");
    fails(at, &["report", "none.binary", "--encode", "--nonsense"], 2, "--nonsense");
    assert_eq!(names(at), ["text.binary"]);
}
