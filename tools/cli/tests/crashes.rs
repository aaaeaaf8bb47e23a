//! Inputs that once failed a fuzz target, or come close to it: each goes through the body of its target, which it names,
//! `tests/crashes/TARGET-WHAT.EXTENSION`. Checksums are put right first, as the fuzzer has the decoder ignore them.
// The C ABI's body.
#![allow(unsafe_code)]

// The C ABI calls the codec so.
extern crate csbrdf as codec;

// The mutator of files needs more of it.
#[allow(dead_code)]
#[path = "../../../fuzz/src/bodies/mod.rs"]
mod bodies;

use std::path::Path;

use bodies::golden::GOLDEN;
use bodies::{capi, eval, salvage, stale};

fn folder(name: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests").join(name);
    let paths = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_file());
    let named = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_string();
    let mut files: Vec<_> = paths.map(|path| (named(&path), std::fs::read(&path).unwrap())).collect();
    files.sort();
    files
}

fn body(target: &str) -> fn(&[u8]) {
    bodies::ALL.iter().find(|(name, _)| *name == target).unwrap_or_else(|| panic!("no target {target}")).1
}

#[test]
fn no_input_fails_its_target_again() {
    let inputs = folder("crashes");
    assert!(!inputs.is_empty());
    for (name, bytes) in inputs {
        println!("{name}");
        let target = name.split(['-', '.']).next().unwrap();
        body(target)(&bytes);
    }
}

/// What the fuzzer starts from passes every target that takes a file.
#[test]
fn golden_files_pass_the_targets() {
    for (number, (name, file)) in GOLDEN.iter().enumerate() {
        println!("{name}");
        // Detail or none, of all channels and of some.
        for (channels, detail) in [(0, 0), (0, 16), (0b1, 0), (0b110, 0), (0b101010, 0), (0b100, 16)] {
            body("prune")(&[number as u8, channels << 2 | u8::from(detail > 0), detail, 0xFF, 0x0F, 0xFF, 0x55]);
        }
        for target in ["open", "file"] {
            body(target)(file);
        }
        for (target, head) in
            [("eval", eval::HEAD), ("stale", stale::HEAD), ("salvage", salvage::HEAD), ("capi", capi::HEAD)]
        {
            for fill in [0, 7, 0x45] {
                body(target)(&[&vec![fill; head], *file].concat());
            }
        }
    }
}

#[test]
fn no_golden_file_is_left_out() {
    let files = folder("data/v1").into_iter().filter_map(|(name, _)| name.strip_suffix(".csbrdf").map(String::from));
    let (mut there, mut named): (Vec<_>, Vec<_>) = (files.collect(), GOLDEN.iter().map(|(name, _)| *name).collect());
    there.sort();
    named.sort();
    assert_eq!(there, named);
}

/// Checksums put right are those that the encoder wrote: of every part, or damage would not get past them.
#[test]
fn sealing_restores_every_checksum() {
    use csbrdf::decode::{Pruned, Reader};
    for (name, file) in GOLDEN {
        assert!(bodies::seal::sealed(file) == *file, "{name}");
        let reader = Reader::open(*file).unwrap();
        let mut torn = file.to_vec();
        for block in 0..reader.block_count() {
            let end = reader.record_range(block).unwrap().end;
            torn[end - 4..end].fill(0x55);
        }
        if let Some(exact) = reader.directory().sections().iter().find(|s| s.name() == "EXCT") {
            torn[exact.range.end - 4..exact.range.end].fill(0x55);
        }
        torn[28..32].fill(0);
        let sealed = bodies::seal::sealed(&torn);
        assert!(sealed == *file, "{name}");
        assert!(Reader::open(&sealed[..]).unwrap().with_pruned(Pruned::Coarse).verify().is_empty(), "{name}");
    }
}

/// Files for `tools/differential.py`: CSBRDF_DIFFERENTIAL names the folder, CSBRDF_FILES says how many (200), CSBRDF_FIRST the number of the
/// first (0).
#[test]
#[ignore = "writes files for another decoder"]
fn files_for_the_decoder_that_was_written_from_the_spec() {
    let number = |name: &str, otherwise| std::env::var(name).map_or(otherwise, |text| text.parse().expect("a number"));
    let folder = std::path::PathBuf::from(std::env::var_os("CSBRDF_DIFFERENTIAL").expect("CSBRDF_DIFFERENTIAL"));
    std::fs::create_dir_all(&folder).unwrap();
    let first = number("CSBRDF_FIRST", 0);
    let mut list = String::new();
    for number in first..first + number("CSBRDF_FILES", 200) {
        let file = bodies::differential::file(number);
        list += &format!("{number}.csbrdf {}\n", bodies::differential::verdict(&file));
        std::fs::write(folder.join(format!("{number}.csbrdf")), file).unwrap();
    }
    std::fs::write(folder.join("verdicts.txt"), list).unwrap();
}
