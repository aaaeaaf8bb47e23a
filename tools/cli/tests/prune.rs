//! A file cut down to what a scene looks at: trace, prune, and the same picture.

mod common;

use std::path::Path;
use std::process::{Command, Output};

use common::{BAD_INPUT, OK, OPERATION, USAGE};

/// Runs a command line in a folder, and expects its exit code.
fn csbrdf(folder: &Path, line: &str, code: i32) -> Output {
    let command = &mut Command::new(env!("CARGO_BIN_EXE_csbrdf"));
    let output = command.args(line.split_whitespace()).current_dir(folder).output().unwrap();
    assert_eq!(output.status.code(), Some(code), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_scene_keeps_its_picture_in_a_smaller_file() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let size = |name: &str| std::fs::metadata(folder.join(name)).unwrap().len();
    csbrdf(folder, "synth pearl -o t.binary", OK);
    csbrdf(folder, "encode --fast t.binary -q", OK);
    csbrdf(folder, "render t.csbrdf -o a.png --trace ball --size 24 --samples 8", OK);
    csbrdf(folder, "eval t.csbrdf --angles 89,0,88,10 --trace one", OK);
    csbrdf(folder, "prune t.csbrdf --trace ball -o ball.csbrdf", OK);
    assert!(size("ball.csbrdf") < size("t.csbrdf"));
    csbrdf(folder, "verify ball.csbrdf", OK);

    // The picture of the trace is the same; more of the material is an error, or coarse if that is asked for.
    csbrdf(folder, "render ball.csbrdf -o b.png --size 24 --samples 8", OK);
    assert!(std::fs::read(folder.join("a.png")).unwrap() == std::fs::read(folder.join("b.png")).unwrap());
    let whole = stderr(&csbrdf(folder, "decode ball.csbrdf -o whole.npy", OPERATION));
    assert!(whole.contains("was pruned") && whole.contains("--coarse"), "{whole}");
    assert!(!folder.join("whole.npy").exists());
    csbrdf(folder, "decode ball.csbrdf -o whole.npy --coarse", OK);
    let information = csbrdf(folder, "info ball.csbrdf", OK);
    assert!(String::from_utf8_lossy(&information.stdout).contains("pruned"));

    // A single look-up needs next to nothing; two traces are joined; detail makes it smaller still.
    csbrdf(folder, "prune t.csbrdf --trace one -o one.csbrdf", OK);
    assert!(size("one.csbrdf") < size("ball.csbrdf"));
    csbrdf(folder, "prune t.csbrdf --trace one --trace ball -o both.csbrdf", OK);
    assert!(size("both.csbrdf") >= size("ball.csbrdf"));
    csbrdf(folder, "prune t.csbrdf --trace ball --detail 0.05 -o thin.csbrdf", OK);
    assert!(size("thin.csbrdf") < size("ball.csbrdf"));

    // A trace of another file, what is no trace, and a file that is there already.
    let other = stderr(&csbrdf(folder, "prune one.csbrdf --trace ball -o x.csbrdf", USAGE));
    assert!(other.contains("another file"), "{other}");
    csbrdf(folder, "prune t.csbrdf --trace a.png -o x.csbrdf", BAD_INPUT);
    csbrdf(folder, "prune t.csbrdf --trace ball -o one.csbrdf", OPERATION);
    assert!(!folder.join("x.csbrdf").exists());
}

#[test]
fn a_channel_alone_stays_what_it_was() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
    csbrdf(folder, "synth pearl -o t.binary", OK);
    csbrdf(folder, "encode --fast --channels separate t.binary -q", OK);
    let figures = stderr(&csbrdf(folder, "prune t.csbrdf --channels G -o g.csbrdf", OK));
    assert!(figures.contains("1 of 3 channels"), "{figures}");
    csbrdf(folder, "verify g.csbrdf", OK);
    csbrdf(folder, "prune t.csbrdf --channels 2,R -o rb.csbrdf", OK);
    assert!(read("g.csbrdf").len() * 5 < read("t.csbrdf").len() * 3);
    assert!(read("rb.csbrdf").len() < read("t.csbrdf").len());

    // Arrays of NumPy: channels one after the other, behind a header.
    for name in ["t", "g", "rb"] {
        csbrdf(folder, &format!("decode {name}.csbrdf --format npy -o {name}.npy --fill"), OK);
    }
    let plane = 4 * 90 * 90 * 180;
    let planes = |name: &str, count: usize| {
        let bytes = read(name);
        bytes[bytes.len() - count * plane..].to_vec()
    };
    let [r, g, b] = [0, 1, 2].map(|c| planes("t.npy", 3)[c * plane..(c + 1) * plane].to_vec());
    assert!(planes("g.npy", 1) == g && planes("rb.npy", 2) == [r, b].concat());

    // With a trace, where the file is a single channel's.
    csbrdf(folder, "eval t.csbrdf --angles 30,0,35,180 --trace one", OK);
    csbrdf(folder, "prune t.csbrdf --trace one --channels B -o one.csbrdf", OK);
    assert!(read("one.csbrdf").len() * 2 < read("rb.csbrdf").len());

    // Names that are none, none at all, and channels that are coded together.
    let unknown = stderr(&csbrdf(folder, "prune t.csbrdf --channels Y -o x.csbrdf", USAGE));
    assert!(unknown.contains("no channel `Y`; there are R, G, B"), "{unknown}");
    csbrdf(folder, "prune t.csbrdf --channels R,0 -o x.csbrdf", USAGE);
    csbrdf(folder, "prune t.csbrdf -o x.csbrdf", USAGE);
    csbrdf(folder, "encode --fast t.binary -o opponent.csbrdf -q", OK);
    let together = stderr(&csbrdf(folder, "prune opponent.csbrdf --channels R -o x.csbrdf", USAGE));
    assert!(together.contains("--channels separate"), "{together}");
    assert!(!folder.join("x.csbrdf").exists());
}
