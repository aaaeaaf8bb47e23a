//! Runs of the tool that end: in time, or as failures. Each test uses some of it.
#![allow(dead_code)]

use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use csbrdf::io::merl::write_merl_values;
use csbrdf::table::grid::Grid;

/// The tool.
pub const TOOL: &str = env!("CARGO_BIN_EXE_csbrdf");

/// Longest time that a run takes; more is a hang.
const PATIENCE: Duration = Duration::from_secs(60);

/// A finished run.
#[derive(Debug)]
pub struct Run {
    /// `None` if a signal ended it.
    pub code: Option<i32>,
    pub stdout: Vec<u8>,
    pub stderr: String,
}

impl Run {
    /// Asserts the exit code.
    #[track_caller]
    pub fn expect(self, code: i32) -> Run {
        assert_eq!(self.code, Some(code), "{}", self.stderr);
        self
    }

    /// Asserts that a line of standard error has all of `parts`.
    #[track_caller]
    pub fn says(self, parts: &[&str]) -> Run {
        let found = self.stderr.lines().any(|line| parts.iter().all(|part| line.contains(part)));
        assert!(found, "no line with {parts:?} in {:?}", self.stderr);
        self
    }

    /// Asserts a failure of one line with all of `parts`.
    #[track_caller]
    pub fn fails(self, code: i32, parts: &[&str]) -> Run {
        let run = self.expect(code).says(parts);
        assert!(run.stderr.lines().count() == 1 && run.stderr.starts_with("csbrdf: "), "{}", run.stderr);
        run
    }
}

/// Starts a command in a folder, its outputs to be collected.
pub fn start(folder: &Path, command: &[&str], stdin: Stdio) -> Child {
    let mut process = Command::new(command[0]);
    process.args(&command[1..]).current_dir(folder).stdin(stdin).stdout(Stdio::piped()).stderr(Stdio::piped());
    process.spawn().unwrap()
}

/// Waits for the end of a process, and ends it if it hangs.
#[track_caller]
pub fn end(mut child: Child) -> Run {
    let (stdout, stderr) = (child.stdout.take().unwrap(), child.stderr.take().unwrap());
    let collect = |mut from: Box<dyn Read + Send>| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            from.read_to_end(&mut bytes).unwrap();
            bytes
        })
    };
    let (stdout, stderr) = (collect(Box::new(stdout)), collect(Box::new(stderr)));
    let begun = Instant::now();
    let status = loop {
        match child.try_wait().unwrap() {
            Some(status) => break status,
            None if begun.elapsed() > PATIENCE => {
                child.kill().unwrap();
                child.wait().unwrap();
                panic!("it hangs");
            }
            None => std::thread::sleep(Duration::from_millis(2)),
        }
    };
    let stderr = String::from_utf8(stderr.join().unwrap()).unwrap();
    assert!(!stderr.contains("panicked"), "{stderr}");
    Run { code: status.code(), stdout: stdout.join().unwrap(), stderr }
}

/// Runs the tool in a folder.
#[track_caller]
pub fn run(folder: &Path, args: &[&str]) -> Run {
    end(start(folder, &[&[TOOL], args].concat(), Stdio::null()))
}

/// Runs a line of the shell with the tool as `$0`.
#[track_caller]
pub fn shell(folder: &Path, line: &str) -> Run {
    end(start(folder, &["sh", "-c", line, TOOL], Stdio::null()))
}

/// The bytes of a MERL table, most of it not measured, so that it is encoded soon.
pub fn table(phase: f64) -> Vec<u8> {
    let grid = Grid::merl();
    let n = grid.positions();
    let near = |i: usize| i / (90 * 180) < 15 && i / 180 % 90 < 15;
    let value = |i: usize| if near(i % n) { (i as f64 * 0.001 + phase).sin() + 1.1 } else { -1.0 };
    let values: Vec<f64> = (0..3 * n).map(value).collect();
    let mut table = Vec::new();
    write_merl_values(&grid, &values, &mut table).unwrap();
    table
}

/// Names of all files in a folder, hidden ones included.
pub fn names(folder: &Path) -> Vec<String> {
    let names = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}
