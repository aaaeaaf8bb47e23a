//! A golden file damaged in several places, then salvaged and repaired: what comes out is the original, or it is reported as lost. The
//! first byte chooses the file, six bytes a damage follow: kind, fill, two of the place, two of the length.
//!
//! Checksums are not put right here: they are what salvage goes by. A build whose reader ignores them is refused.

use std::ops::Range;

use csbrdf::decode::{Pruned, Reader};
use csbrdf::error::Error;
use csbrdf::format::Limits;
use csbrdf::format::metadata::Metadata;
use csbrdf::salvage::{Damage, Outcome, Salvaged, repair, salvage_with_limits};
use csbrdf::sample::SplitMix64;

use super::golden::chosen;
use super::salvage::told;
use super::same_bits;

const LIMITS: Limits =
    Limits { table_values: 1 << 16, block_values: 1 << 16, operations: 1_000_000_000, bytes: 1 << 28 };

/// Damages of one file.
const MOST: usize = 4;
/// Kinds of damage.
pub const KINDS: u8 = 11;

pub fn run(data: &[u8]) {
    let Some((&file, damages)) = data.split_first() else { return };
    let good = chosen(file);
    let mut bad = good.to_vec();
    damages.as_chunks::<6>().0.iter().take(MOST).for_each(|d| damage(*d, good, &mut bad));
    check(good, &bad);
}

/// Panics unless what is left of a damaged file is the original's, and all else is said.
pub fn check(good: &[u8], bad: &[u8]) {
    let original = Reader::open(good).expect("golden files open").with_pruned(Pruned::Coarse);
    assert!(sees_damage(good), "this reader ignores checksums: build it without cfg(fuzzing)");
    let salvaged = match salvage_with_limits(bad, LIMITS) {
        Ok(salvaged) => salvaged,
        Err(e) => {
            assert!(good != bad && !e.to_string().is_empty(), "{e}");
            return assert!(repair(bad, LIMITS).is_err(), "repair has what salvage has not");
        }
    };
    told(&salvaged);
    assert_eq!(good == bad, salvaged.damage().is_empty(), "damage is reported if there is any");
    kept(&original, salvaged.reader(), salvaged.lost(), "salvage");
    described(&original, &salvaged);
    only_what_was_hit(&original, good, bad, &salvaged);
    match repair(bad, LIMITS) {
        Ok(repaired) => {
            agree(&salvaged, &repaired.salvaged);
            if is_whole(&salvaged) {
                assert!(repaired.bytes == good, "restored, it says, and is not: {:?}", salvaged.damage());
            }
            written(&original, &repaired.bytes, salvaged.lost());
        }
        // Files of old drafts have no place for what is lost.
        Err(Error::InvalidArgument(_)) => {
            assert!(!salvaged.lost().is_empty() && (1..4).contains(&original.version().2))
        }
        Err(e) => panic!("what salvage opens is not repaired: {e}"),
    }
}

fn damage([kind, fill, a, b, c, d]: [u8; 6], good: &[u8], bad: &mut Vec<u8>) {
    if bad.is_empty() {
        return;
    }
    let (place, length) = (u32::from(u16::from_le_bytes([a, b])), usize::from(u16::from_le_bytes([c, d])));
    let mut at = (place as usize * bad.len()) >> 16;
    let few = 1 + length % 64;
    let kind = kind % KINDS;
    let sections = places(good);
    if kind >= 8 {
        // At the start or the end of a section, where the head of RECS, EXCT and INDX is, and the last words of their coders.
        let section = &sections[usize::from(fill) % sections.len()];
        let from = if kind == 8 { section.start } else { section.end.saturating_sub(1 + usize::from(b % 8)) };
        at = from.min(bad.len() - 1);
    }
    let end = bad.len();
    let range = |n: usize| at..(at + n).min(end);
    let mut random = SplitMix64(u64::from(place) << 32 | u64::from(fill) << 16 | length as u64);
    match kind {
        0 => bad[at] ^= 1 << (fill % 8),
        // Any bytes; a burst, none of which stays; zeros.
        1 | 8 => bad[range(few)].iter_mut().for_each(|byte| *byte = random.next_u64() as u8),
        2 => bad[range(few)].iter_mut().for_each(|byte| *byte ^= 1 + (random.next_u64() % 255) as u8),
        3 => bad[range(1 + length % 1024)].fill(if fill == 1 { 0xFF } else { 0 }),
        4 => bad.truncate(bad.len() - (length % 2048).min(bad.len())),
        5 => drop(bad.splice(at..at, std::iter::repeat_n(fill, few))),
        6 => drop(bad.drain(range(few))),
        7 => swap(bad, &sections[usize::from(fill) % sections.len()], &sections[usize::from(a) % sections.len()]),
        // Few bytes at a section's end: what one checksum explains in many ways.
        9 => bad[range(1 + length % 5)].iter_mut().for_each(|byte| *byte = random.next_u64() as u8),
        // Bits here and there in a stretch.
        _ => (0..1 + length % 8).for_each(|_| {
            let bit = random.next_u64() as usize % (8 * range(256).len());
            bad[at + bit / 8] ^= 1 << (bit % 8);
        }),
    }
}

/// Section table and sections.
fn places(file: &[u8]) -> Vec<Range<usize>> {
    let reader = Reader::open(file).expect("golden files open");
    let sections: Vec<_> = reader.directory().sections().iter().map(|s| s.range.clone()).collect();
    [vec![0..sections[0].start], sections].concat()
}

/// Two stretches of a file, one in the place of the other.
fn swap(bytes: &mut Vec<u8>, a: &Range<usize>, b: &Range<usize>) {
    let (first, second) = if a.start <= b.start { (a, b) } else { (b, a) };
    if first != second && second.end <= bytes.len() {
        let parts = [&bytes[..first.start], &bytes[second.clone()], &bytes[first.end..second.start]];
        *bytes = [&parts.concat()[..], &bytes[first.clone()], &bytes[second.end..]].concat();
    }
}

/// Whether nothing is lost, as far as is said.
fn is_whole(salvaged: &Salvaged) -> bool {
    salvaged.lost().is_empty() && salvaged.damage().iter().all(|damage| damage.outcome == Outcome::Restored)
}

/// Every value that is not reported as lost has the original's bits, exact ones as well.
fn kept<D: AsRef<[u8]>>(original: &Reader<&[u8]>, reader: &Reader<D>, lost: &[usize], who: &str) {
    assert_eq!(reader.block_count(), original.block_count(), "{who}");
    for block in 0..original.block_count() {
        // Exact values are lost block by block, by an error.
        if let Ok(exact) = reader.exact_block(block) {
            let right = original.exact_block(block).expect("the original is intact");
            let same = exact.iter().zip(&right).all(|(a, b)| a.to_bits() == b.to_bits());
            assert!(same && exact.len() == right.len(), "{who}: wrong exact values of block {block}");
        }
        if lost.binary_search(&block).is_ok() {
            assert!(reader.exact_block(block).is_err(), "{who}: exact values of block {block}, which is lost");
            continue;
        }
        let values = of_block(reader, block).unwrap_or_else(|e| panic!("{who}: block {block} is not lost: {e}"));
        let right = of_block(original, block).expect("the original is intact");
        assert!(same_bits(&values, &right), "{who}: wrong values of block {block}, which is not reported as lost");
        let valid = (reader.block_validity(block).ok(), original.block_validity(block).ok());
        assert_eq!(valid.0, valid.1, "{who}: block {block}");
        let known = reader.block_info(block).expect("a block");
        let right = original.block_info(block).expect("a block");
        assert_eq!(
            (known.rms.to_bits(), known.max.to_bits()),
            (right.rms.to_bits(), right.max.to_bits()),
            "{who}: {block}"
        );
    }
}

fn of_block<D: AsRef<[u8]>>(reader: &Reader<D>, block: usize) -> Result<Vec<f32>, Error> {
    let mut values = vec![f32::NAN; reader.block_values(block)?];
    reader.block_into(block, &mut values).map(|()| values)
}

/// What the file says of itself is the original's.
fn described(original: &Reader<&[u8]>, salvaged: &Salvaged) {
    let reader = salvaged.reader();
    assert_eq!(reader.grid(), original.grid());
    assert_eq!(reader.coding(), original.coding());
    let is_lost = |damage: &Damage| damage.section == "META" && damage.outcome == Outcome::Lost;
    if !salvaged.damage().iter().any(is_lost) {
        let said = |metadata: Result<Metadata, Error>| format!("{:?}", metadata.map(|m| (m.name, m.encoder)));
        assert_eq!(said(reader.metadata()), said(original.metadata()));
    }
    // The mean of a lost block is known, or it is said that it is not.
    let Some(means) = means(original) else { return };
    let means = Reader::open(&means[..]).expect("what prune makes opens").with_pruned(Pruned::Coarse);
    for &block in salvaged.lost().iter().filter(|&&block| salvaged.has_mean(block)) {
        let (mean, right) = (of_block(reader, block), of_block(&means, block));
        let same = same_bits(&mean.expect("a mean"), &right.expect("a mean"));
        assert!(same, "block {block} has another mean than it had, and it is said to be known");
    }
}

/// The file with nothing but the means; none of old drafts, which have no pruned blocks.
fn means(original: &Reader<&[u8]>) -> Option<Vec<u8>> {
    let index = original.directory().sections().iter().find(|s| s.name() == "INDX").expect("it was opened");
    let trace = format!("csbrdf trace 1\nblocks {} index {:08x}\n", original.block_count(), index.crc);
    let touched = csbrdf::touched::Touched::from_text(&trace).ok()?;
    csbrdf::prune::Pruner::new().blocks(&touched).prune(original).ok().map(|pruned| pruned.bytes)
}

/// Damage within RECS costs the blocks whose records it hits and no others.
fn only_what_was_hit(original: &Reader<&[u8]>, good: &[u8], bad: &[u8], salvaged: &Salvaged) {
    let records = original.directory().sections().iter().find(|s| s.name() == "RECS").expect("it was opened");
    let range = records.range.clone();
    let elsewhere = || bad[..range.start] != good[..range.start] || bad[range.end..] != good[range.end..];
    if bad.len() != good.len() || elsewhere() {
        return;
    }
    let hit = |block: &usize| {
        let record = original.record_range(*block).expect("a block");
        bad[record.clone()] != good[record]
    };
    let hit: Vec<usize> = (0..original.block_count()).filter(hit).collect();
    assert_eq!(salvaged.lost(), hit);
    assert!(hit.iter().all(|&block| salvaged.has_mean(block)));
}

/// Repair reports what salvage does.
fn agree(a: &Salvaged, b: &Salvaged) {
    assert_eq!((a.damage(), a.lost(), a.lost_entries()), (b.damage(), b.lost(), b.lost_entries()));
    assert!((0..a.reader().block_count()).all(|block| a.has_mean(block) == b.has_mean(block)));
}

/// What repair writes is a file without damage that has what was left, and repairs to itself.
fn written(original: &Reader<&[u8]>, bytes: &[u8], lost: &[usize]) {
    let strict = Reader::open_with_limits(bytes, LIMITS).expect("a repaired file opens");
    assert!(strict.verify().is_empty(), "a repaired file is damaged: {:?}", strict.verify());
    assert!(lost.iter().all(|&block| of_block(&strict, block).is_err()), "what is lost is given out");
    kept(original, &strict.with_pruned(Pruned::Coarse), lost, "repair");
    let again = repair(bytes, LIMITS).expect("a repaired file is repaired again");
    assert!(again.salvaged.damage().is_empty() && again.salvaged.lost().is_empty());
    assert!(again.bytes == bytes, "a repaired file does not repair to itself");
}

/// Whether the reader of this build looks at checksums.
fn sees_damage(good: &[u8]) -> bool {
    let mut bad = good.to_vec();
    let records = Reader::open(good).expect("golden files open").record_range(0).expect("a block");
    bad[records.end - 1] ^= 1;
    Reader::open(&bad[..]).expect("its head is intact").block_info(0).is_err()
}
