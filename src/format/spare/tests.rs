use super::*;
use crate::format::directory::RECORDS;
use crate::format::file::{write_file, write_file_with_spare};

fn file() -> Vec<u8> {
    write_file_with_spare((1, 0, 4), &[("GRID", false, vec![1, 2, 3]), (RECORDS, false, vec![9; 30])])
}

/// Spec section 3.11 byte for byte.
#[test]
fn bytes_are_those_of_the_specification() {
    let file = file();
    let head = PREAMBLE + 3 * ENTRY + 3;
    let section = &file[head + 30..file.len() - 8];
    let mut copy = file[..head].to_vec();
    copy[28..32].fill(0);
    copy[32 + 40 + 16..32 + 60].fill(0);
    assert_eq!(section[..head], copy);
    assert_eq!(section[head..head + 4], (head as u32).to_le_bytes());
    assert_eq!(section[head + 4..head + 8], crc32fast::hash(&section[..head + 4]).to_le_bytes());
    assert_eq!(section[head + 8..], *b"SPAR");
    assert!(Directory::read(&file).is_ok_and(|directory| agrees(&file, &directory)));
}

#[test]
fn the_head_comes_back_from_wherever_the_section_is() {
    let good = file();
    let head = PREAMBLE + 3 * ENTRY + 3;
    let mut bad = good.clone();
    bad[..head].fill(0);
    for tail in [0, 5] {
        bad.truncate(good.len() - tail);
        assert_eq!(restore(find(&bad).unwrap()).unwrap(), good[..head]);
    }
    // A flip in the copy.
    for bit in 0..8 * (good.len() - 8 - head - 30) {
        let mut bad = good.clone();
        bad[head + 30 + bit / 8] ^= 1 << (bit % 8);
        assert!(find(&bad).and_then(restore).is_none(), "{bit}");
    }
    let without = write_file((1, 0, 4), &[(RECORDS, false, vec![1; 50])]);
    assert!(find(&without).is_none());
}
