use super::*;
use crate::format::file::write_file;

fn sample() -> Vec<u8> {
    write_file((1, 0, 4), &[(GRID, false, vec![1, 2, 3]), ("XTRA", true, vec![]), (INDEX, false, vec![4])])
}

/// The layout of spec section 3.1 byte for byte; the sums are those of Python's zlib.
#[test]
fn bytes_are_those_of_the_specification() {
    let hex: String =
        write_file((1, 0, 4), &[(GRID, false, vec![1, 2, 3])]).iter().map(|b| format!("{b:02x}")).collect();
    let preamble = "8b4353420d0a1a0a01000000040001003f00000000000000000000005650fd6a";
    let table = "475249440000000003000000000000001d80bc55";
    assert_eq!(hex, [preamble, table, "010203", "4353425244462e0a"].concat());
}

#[test]
fn sections_are_found_and_checked() {
    let data = sample();
    let directory = Directory::read(&data).unwrap();
    assert_eq!(directory.sections().len(), 3);
    assert_eq!(directory.open(&data, GRID).unwrap().bytes(3).unwrap(), [1, 2, 3]);
    assert!(directory.open(&data, RECORDS).is_err());
    let mut bad = data.clone();
    bad[PREAMBLE + 3 * ENTRY] ^= 1;
    assert!(Directory::read(&bad).unwrap().open(&bad, GRID).is_err());
}

#[test]
fn every_flip_and_cut_of_the_directory_is_seen() {
    let data = sample();
    for bit in 0..8 * (PREAMBLE + 3 * ENTRY) {
        let mut bad = data.clone();
        bad[bit / 8] ^= 1 << (bit % 8);
        assert!(Directory::read(&bad).is_err(), "bit {bit}");
    }
    for cut in 0..data.len() {
        assert!(Directory::read(&data[..cut]).is_err(), "cut {cut}");
    }
}

#[test]
fn unknown_sections_are_skipped_only_if_they_say_so() {
    assert!(Directory::read(&write_file((1, 0, 4), &[("XTRA", true, vec![])])).is_ok());
    let refused = Directory::read(&write_file((1, 0, 4), &[("XTRA", false, vec![])])).unwrap_err();
    assert!(refused.to_string().contains("XTRA"));
}

#[test]
fn names_are_ascii_and_occur_once() {
    for name in [GRID, "XTRA"] {
        let twice = write_file((1, 0, 4), &[(name, true, vec![]), (name, true, vec![])]);
        assert!(Directory::read(&twice).unwrap_err().to_string().contains("occurs twice"), "{name}");
    }
    let foreign = Directory::read(&write_file((1, 0, 4), &[(b"X\xffRA", true, vec![])])).unwrap_err();
    assert!(foreign.to_string().contains("not ASCII"), "{foreign}");
}

#[test]
fn the_lossless_layer_is_unknown_to_early_drafts() {
    for draft in [0, 1, 2, 3, 5] {
        let early = [1, 2].contains(&draft);
        assert!(Directory::read(&write_file((1, 0, draft), &[(LOSSLESS, true, vec![])])).is_ok(), "{draft}");
        let needed = Directory::read(&write_file((1, 0, draft), &[(LOSSLESS, false, vec![])]));
        assert_eq!(needed.is_err(), early, "{draft}");
    }
}

#[test]
fn other_files_are_named() {
    let says = |data: &[u8]| Directory::read(data).unwrap_err().to_string();
    assert!(says(b"").contains("empty"));
    assert!(says(b"hello, world").contains("text"));
    assert!(says(&[0x5A, 0, 0, 0, 0x5A, 0]).contains("MERL"));
    assert!(says(b"\x8BCSB\n\x1A\n").contains("line ends"));
    assert!(says(b"\x0BCSB\r\n\x1A\n").contains("high bit"));
    assert!(says(&MAGIC[..5]).contains("truncated"));
    let mut newer = sample();
    newer[8] = 2;
    assert!(says(&newer).contains("version 2.0"), "{}", says(&newer));
}
