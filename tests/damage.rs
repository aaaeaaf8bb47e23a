//! Damaged, cut and foreign bytes: every one is refused with its place, none panics.
#![cfg(feature = "encode")]

use csbrdf::Limits;
use csbrdf::base::error::Error;
use csbrdf::decode::Reader;
use csbrdf::encode::contract::Contract;
use csbrdf::encode::{Encoder, Preset};
use csbrdf::format::{END_MARKER, MAGIC};
use csbrdf::table::Table;
use csbrdf::table::grid::Grid;
use csbrdf::table::synth::Recipe;
use std::sync::OnceLock;

fn table() -> Table {
    let grid = Grid::merl().with_lengths(&[10, 12, 16]).unwrap();
    Recipe { holes: 0.03, ..Recipe::named("satin-paint").unwrap() }.synthesise(&grid).unwrap()
}

/// A small file with every class of block that random holes and the horizon bring about.
fn file() -> &'static [u8] {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| Encoder::new().block_shape(&[5, 6, 8]).encode(&table()).unwrap().bytes)
}

/// The first error that opening, decoding and verifying give.
fn first_error(data: &[u8]) -> Option<Error> {
    match Reader::open(data) {
        Err(e) => Some(e),
        Ok(reader) => {
            let all = reader.decode_all().err();
            let verified = reader.verify().into_iter().next();
            all.or(verified)
        }
    }
}

#[test]
fn every_flipped_bit_is_detected() {
    let good = file();
    assert!(first_error(good).is_none());
    for bit in 0..8 * good.len() {
        let mut bad = good.to_vec();
        bad[bit / 8] ^= 1 << (bit % 8);
        assert!(first_error(&bad).is_some(), "bit {bit} of {}", 8 * good.len());
    }
}

#[test]
fn every_cut_is_detected() {
    let good = file();
    for length in 0..good.len() {
        let error = Reader::open(&good[..length]).err().expect("a cut file does not open");
        let named = matches!(error, Error::Truncated { .. } | Error::NotCsbrdf { .. });
        assert!(named, "{length}: {error}");
    }
    let mut longer = good.to_vec();
    longer.push(0);
    assert!(Reader::open(&longer).is_err());
}

#[test]
fn damage_in_a_record_costs_that_block_only() {
    let good = file();
    let intact = Reader::open(good).unwrap();
    let reference = intact.decode_all().unwrap();
    assert!(!reference.is_empty());
    for hurt in [0, 3, intact.block_count() - 1] {
        let mut bad = good.to_vec();
        bad[intact.block_info(hurt).unwrap().record.start] ^= 0x55;
        let reader = Reader::open(&bad[..]).unwrap();
        for block in 0..reader.block_count() {
            let mut values = vec![0.0; reader.block_values(block).unwrap()];
            let mut expected = values.clone();
            intact.block_into(block, &mut expected).unwrap();
            match reader.block_into(block, &mut values) {
                Ok(()) => assert!(block != hurt && values == expected),
                Err(e) => {
                    assert_eq!(block, hurt);
                    let place = intact.block_info(block).unwrap().record.start;
                    assert!(e.to_string().contains(&format!("RECS at offset {place}")), "{e}");
                }
            }
        }
        // The section's own checksum and the record's.
        assert_eq!(reader.verify().len(), 2);
    }
}

#[test]
fn swapped_records_are_detected() {
    let good = file();
    let reader = Reader::open(good).unwrap();
    let records: Vec<_> = (0..reader.block_count()).map(|b| reader.block_info(b).unwrap().record).collect();
    let mut swaps = 0;
    for (i, a) in records.iter().enumerate() {
        for b in records[i + 1..].iter().filter(|b| b.len() == a.len()) {
            let mut bad = good.to_vec();
            bad[a.clone()].copy_from_slice(&good[b.clone()]);
            bad[b.clone()].copy_from_slice(&good[a.clone()]);
            if bad != good {
                assert!(Reader::open(&bad[..]).unwrap().decode_all().is_err());
                swaps += 1;
            }
        }
    }
    assert!(swaps > 0, "the file has no two records of one length");
}

#[test]
fn foreign_and_newer_files_are_named() {
    let says = |data: &[u8]| Reader::open(data).err().expect("refused").to_string();
    assert!(says(b"").contains("empty"));
    assert!(says(b"<html>not found</html>").contains("text"));
    assert!(says(&90i32.to_le_bytes().repeat(3)).contains("MERL"));
    assert!(says(&[0; 100]).contains("not a csbrdf file"));
    for (at, more, name) in [(8, 1, "version 2.0 is not known"), (12, 6, "version 1.0 draft 6 is not known")] {
        let mut newer = file().to_vec();
        newer[at] += more;
        assert!(says(&newer).contains(name), "{}", says(&newer));
    }
    let text_mode: Vec<u8> = file().iter().copied().filter(|&b| b != b'\r').collect();
    assert!(says(&text_mode).contains("binary mode"));
    assert!(file().starts_with(&MAGIC) && file().ends_with(&END_MARKER));
}

#[test]
fn limits_are_the_callers() {
    let n = table().values().len();
    let reader = Reader::open_with_limits(file(), Limits { table_values: n - 1, ..Limits::default() }).unwrap();
    assert!(matches!(reader.decode_all(), Err(Error::LimitExceeded { .. })));
    assert!(matches!(reader.decode_table(), Err(Error::LimitExceeded { .. })));
    let tight = Limits { block_values: 5 * 6 * 8 * 3 - 1, ..Limits::default() };
    assert!(matches!(Reader::open_with_limits(file(), tight), Err(Error::LimitExceeded { .. })));
}

#[test]
fn calls_with_wrong_arguments_are_refused() {
    let reader = Reader::open(file()).unwrap();
    assert!(reader.block_into(reader.block_count(), &mut []).is_err());
    assert!(reader.block_into(0, &mut [0.0; 7]).is_err());
    assert!(reader.block_info(usize::MAX).is_err());
    assert!(reader.block_origin(usize::MAX).is_err());
}

#[test]
fn corrected_files_are_checked_as_well() {
    let encoder = Encoder::new().block_shape(&[5, 6, 8]).contract(Contract::MaxError(0.02));
    let encoded = encoder.encode(&table()).unwrap();
    assert!(encoded.report.corrected > 0);
    for bit in (0..8 * encoded.bytes.len()).step_by(13) {
        let mut bad = encoded.bytes.clone();
        bad[bit / 8] ^= 1 << (bit % 8);
        assert!(first_error(&bad).is_some(), "bit {bit}");
    }
}

#[test]
fn paper_files_are_checked_as_well() {
    let bytes = Encoder::new().preset(Preset::Paper).encode(&table()).unwrap().bytes;
    for bit in (0..8 * bytes.len()).step_by(13) {
        let mut bad = bytes.clone();
        bad[bit / 8] ^= 1 << (bit % 8);
        assert!(first_error(&bad).is_some(), "bit {bit}");
    }
}

/// What restores the bits may be damaged without harm to the values, and in one block without harm to the others.
#[test]
fn damage_in_exact_bits_costs_that_block_only() {
    let table = table();
    let good = Encoder::new().block_shape(&[5, 6, 8]).lossless(true).encode(&table).unwrap().bytes;
    let intact = Reader::open(&good[..]).unwrap();
    assert!(intact.is_lossless() && intact.verify().is_empty());
    let plain = intact.decode_all().unwrap();
    let section = intact.directory().sections().iter().find(|s| s.name() == "EXCT").unwrap().range.clone();
    // Number of blocks, an entry of each channel, lengths, checksum; then the blocks.
    let head = 4 + 8 * 3 + 4 * intact.block_count() + 4;
    for byte in (section.start..section.start + head).chain(section.clone().step_by(211)) {
        let mut bad = good.clone();
        bad[byte] ^= 1 << (byte % 8);
        let reader = Reader::open(&bad[..]).unwrap();
        if byte % 3 == 0 {
            assert!(reader.decode_all().unwrap() == plain && !reader.verify().is_empty());
        }
        let hurt: Vec<bool> = (0..reader.block_count()).map(|block| reader.source_block(block).is_err()).collect();
        let count = hurt.iter().filter(|hurt| **hurt).count();
        assert_eq!(count, if byte - section.start < head { hurt.len() } else { 1 }, "byte {byte}");
        if byte % 5 != 0 {
            continue;
        }
        for block in (0..hurt.len()).filter(|&block| !hurt[block]) {
            let same = |(a, b): (&f64, &f64)| a.to_bits() == b.to_bits();
            assert!(reader.source_block(block).unwrap().iter().zip(&intact.source_block(block).unwrap()).all(same));
        }
    }
}

/// Hostile bytes under right checksums: refused or decoded, never a panic.
#[test]
fn any_exact_bits_are_survived() {
    let mut random = csbrdf::codec::sample::SplitMix64(5);
    let good = Encoder::new().block_shape(&[5, 6, 8]).lossless(true).encode(&table()).unwrap().bytes;
    let intact = Reader::open(&good[..]).unwrap();
    let section = intact.directory().sections().iter().find(|s| s.name() == "EXCT").unwrap().range.clone();
    let at = section.start + 4 + 8 * 3;
    let length = u32::from_le_bytes(good[at..at + 4].try_into().unwrap()) as usize;
    let first = at + 4 * intact.block_count() + 4;
    let mut refused = 0;
    for round in 0..300 {
        let mut bad = good.clone();
        let coded = &mut bad[first..first + length - 4];
        let from = if round % 2 == 0 { 0 } else { random.next_u64() as usize % coded.len() };
        coded[from..].fill_with(|| if round % 3 == 0 { 0xFF } else { random.next_u64() as u8 });
        let crc = crc32fast::hash(&[&[0; 4], &*coded].concat());
        bad[first + length - 4..first + length].copy_from_slice(&crc.to_le_bytes());
        refused += usize::from(Reader::open(&bad[..]).unwrap().source_block(0).is_err());
    }
    assert!(refused > 100, "{refused}");
}

/// Places of 64 bytes changed for each other, and zeros written over sectors and parts of them.
#[test]
fn swapped_and_zeroed_pieces_are_detected() {
    let good = file();
    let piece = |at: usize| at..(at + 64).min(good.len());
    let (mut swaps, mut zeros) = (0, 0);
    for a in (0..good.len() - 64).step_by(64) {
        for b in (a + 64..good.len() - 63).step_by(64) {
            let mut bad = good.to_vec();
            bad[piece(a)].copy_from_slice(&good[piece(b)]);
            bad[piece(b)].copy_from_slice(&good[piece(a)]);
            if bad != good {
                assert!(first_error(&bad).is_some(), "{a} and {b}");
                swaps += 1;
            }
        }
    }
    for size in [1, 8, 64, 512, 4096] {
        for at in (0..good.len()).step_by(size) {
            let mut bad = good.to_vec();
            bad[at..(at + size).min(good.len())].fill(0);
            if bad != good {
                assert!(first_error(&bad).is_some(), "{size} bytes at {at}");
                zeros += 1;
            }
        }
    }
    assert!(swaps > 100 && zeros > 1000, "{swaps}, {zeros}");
}

/// Some bytes changed at random, in one place or many.
#[test]
fn random_damage_is_detected() {
    let good = file();
    let mut random = csbrdf::codec::sample::SplitMix64(11);
    for round in 0..3000u64 {
        let mut bad = good.to_vec();
        for _ in 0..1 + round % 5 {
            let length = 1 + random.next_u64() as usize % [1, 4, 40][round as usize % 3];
            let at = random.next_u64() as usize % (good.len() - length);
            bad[at..at + length].fill_with(|| random.next_u64() as u8);
        }
        assert!(bad == good || first_error(&bad).is_some(), "round {round}");
    }
}
