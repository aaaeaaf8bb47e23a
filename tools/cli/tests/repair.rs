//! Damaged files through the tool: what is left, what is said, and the exit codes.

mod common;

use std::path::Path;
use std::process::Command;

use common::{BAD_INPUT, OK, USAGE};

/// Runs a command line in a folder, expects its exit code, and gives standard error.
fn csbrdf(folder: &Path, line: &str, code: i32) -> String {
    let command = &mut Command::new(env!("CARGO_BIN_EXE_csbrdf"));
    let output = command.args(line.split_whitespace()).current_dir(folder).output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{line}: {text}");
    text
}

/// Values of a .binary file that differ, and how many are -1 in the second only.
fn differences(a: &Path, b: &Path) -> (usize, usize) {
    let (a, b) = (std::fs::read(a).unwrap(), std::fs::read(b).unwrap());
    assert_eq!(a.len(), b.len());
    let pairs = a[12..].chunks_exact(8).zip(b[12..].chunks_exact(8)).filter(|(a, b)| a != b);
    pairs.fold((0, 0), |(n, missing), (_, b)| (n + 1, missing + usize::from(b == (-1f64).to_le_bytes())))
}

#[test]
fn a_damaged_file_is_salvaged_and_repaired() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let path = |name: &str| folder.join(name);
    csbrdf(folder, "synth pearl -o t.binary", OK);
    csbrdf(folder, "encode --block 15,15,60 --spare t.binary -o good.csbrdf -q", OK);
    csbrdf(folder, "encode --block 15,15,60 t.binary -o plain.csbrdf -q", OK);
    let good = std::fs::read(path("good.csbrdf")).unwrap();
    let size = |name: &str| std::fs::metadata(path(name)).unwrap().len();
    assert!((500..5000).contains(&(size("good.csbrdf") - size("plain.csbrdf"))));

    // An intact file: nothing to say, nothing lost.
    csbrdf(folder, "decode good.csbrdf -o whole.binary", OK);
    let said = csbrdf(folder, "decode --salvage good.csbrdf -o same.binary", OK);
    assert!(said.contains("108 blocks of 108 intact"), "{said}");
    assert_eq!(differences(&path("whole.binary"), &path("same.binary")), (0, 0));

    // The header and a record.
    let mut bad = good.clone();
    bad[40..300].fill(0);
    let last = good.len() * 2 / 3;
    bad[last] ^= 8;
    std::fs::write(path("bad.csbrdf"), &bad).unwrap();
    csbrdf(folder, "decode bad.csbrdf -o x.binary", BAD_INPUT);
    let said = csbrdf(folder, "decode --salvage bad.csbrdf -o left.binary", BAD_INPUT);
    for part in
        ["section table", "spare copy", "block ", "RECS bytes", "checksum", "107 blocks of 108 intact, 1 lost with"]
    {
        assert!(said.contains(part), "{part} in {said}");
    }
    let (changed, missing) = differences(&path("whole.binary"), &path("left.binary"));
    assert!(changed == missing && missing > 0 && missing <= 3 * 15 * 15 * 60, "{changed}, {missing}");
    csbrdf(folder, "decode --salvage bad.csbrdf -o left.npy", BAD_INPUT);

    let said = csbrdf(folder, "repair bad.csbrdf", BAD_INPUT);
    assert!(said.contains("bad.repaired.csbrdf has what is left"), "{said}");
    // Lost is not pruned: to verify, to what decodes, and in the index.
    let said = csbrdf(folder, "verify bad.repaired.csbrdf", BAD_INPUT);
    assert!(said.contains("1 of 108 blocks is lost (") && said.contains("intact copy"), "{said}");
    let said = csbrdf(folder, "decode bad.repaired.csbrdf -o x.binary", 1);
    assert!(said.contains("was lost to damage") && !said.contains("pruned"), "{said}");
    csbrdf(folder, "eval --coarse --angles 30,0,35,180 --trace some.trace bad.repaired.csbrdf", OK);
    csbrdf(folder, "prune --trace some.trace bad.repaired.csbrdf -o pruned.csbrdf", OK);
    let said = csbrdf(folder, "verify pruned.csbrdf", BAD_INPUT);
    assert!(said.contains("1 of 108 blocks is lost ("), "{said}");
    csbrdf(folder, "decode --coarse bad.repaired.csbrdf -o repaired.binary", OK);
    assert_eq!(differences(&path("left.binary"), &path("repaired.binary")), (0, 0));
    let information = &mut Command::new(env!("CARGO_BIN_EXE_csbrdf"));
    let information = information.args(["info", "--json", "bad.repaired.csbrdf"]).current_dir(folder).output().unwrap();
    assert!(String::from_utf8_lossy(&information.stdout).contains("\"repaired\""));

    // Damage that costs nothing: what was there, byte for byte.
    bad[last] ^= 8;
    std::fs::write(path("head.csbrdf"), &bad).unwrap();
    csbrdf(folder, "repair head.csbrdf -o again.csbrdf", OK);
    assert!(std::fs::read(path("again.csbrdf")).unwrap() == good);

    // A cut file, and one of which nothing is left.
    std::fs::write(path("cut.csbrdf"), &good[..last]).unwrap();
    let said = csbrdf(folder, "decode --salvage cut.csbrdf -o cut.binary", BAD_INPUT);
    assert!(said.contains("beyond the end of the file"), "{said}");
    let plain = std::fs::read(path("plain.csbrdf")).unwrap();
    std::fs::write(path("none.csbrdf"), [&[0; 400][..], &plain[400..]].concat()).unwrap();
    csbrdf(folder, "decode --salvage none.csbrdf -o none.binary", BAD_INPUT);
    csbrdf(folder, "repair none.csbrdf -o none2.csbrdf", BAD_INPUT);
    assert!(!path("none.binary").exists() && !path("none2.csbrdf").exists());
    csbrdf(folder, "decode --salvage --fill bad.csbrdf -o x.binary", USAGE);
}
