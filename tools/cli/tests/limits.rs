//! The tool's bounds on what a file or the environment may cost, and how they are raised.

mod common;
#[path = "common/tool.rs"]
mod tool;

use std::path::Path;

use common::{OK, UNSUPPORTED, USAGE};
use tool::{run, shell};

fn golden(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/v1").join(name);
    path.into_os_string().into_string().unwrap()
}

/// Each command that reads whole tables obeys `--limit`, whatever the file; what asks for blocks alone does not need it.
#[test]
fn larger_tables_than_the_limit_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = golden("final-profile.csbrdf");
    let info = run(folder.path(), &["info", "--json", &file]).expect(OK);
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    let bins: Vec<u64> = info["axes"].as_array().unwrap().iter().map(|axis| axis["bins"].as_u64().unwrap()).collect();
    let values = bins.iter().product::<u64>() * info["channels"].as_array().unwrap().len() as u64;
    let (enough, less) = (values.to_string(), (values - 1).to_string());
    let commands: [&[&str]; 4] = [
        &["decode", &file, "-f", "-o", "whole.npy"],
        &["verify", &file],
        &["compare", &file, &file],
        &["decode", "--salvage", &file, "-f", "-o", "whole.npy"],
    ];
    for command in commands {
        let says = format!("above the limit of {less}");
        run(folder.path(), &[command, &["--limit", &less]].concat()).expect(UNSUPPORTED).says(&[&says, "--limit"]);
        run(folder.path(), &[command, &["--limit", &enough]].concat()).expect(OK);
    }
    run(folder.path(), &["decode", &file, "--block", "0", "--limit", "1", "-o", "block.npy"]).expect(OK);
    for wrong in ["0", "-1", "1T", "k", "99999999999999999999"] {
        run(folder.path(), &["verify", &file, "--limit", wrong]).expect(USAGE);
    }
    for right in ["1k", "1M", "8G"] {
        run(folder.path(), &["verify", &file, "--limit", right]).expect(if right == "1k" { UNSUPPORTED } else { OK });
    }
}

/// A number of threads that no machine has is not taken at its word.
#[test]
fn threads_by_the_thousand_are_not_made() {
    let folder = tempfile::tempdir().unwrap();
    let file = golden("final-profile.csbrdf");
    let run = shell(folder.path(), &format!("RAYON_NUM_THREADS=100000 \"$0\" verify '{file}'"));
    run.expect(OK).says(&["256", "threads"]);
}
