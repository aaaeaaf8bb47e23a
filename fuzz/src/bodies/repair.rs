//! A golden file damaged in several places, then salvaged and repaired: what comes out is the original, or it is reported as lost. The
//! first byte chooses the file, six bytes a damage follow: kind, fill, two of the place, two of the length.
//!
//! Checksums are not put right here: they are what salvage goes by.

use std::ops::Range;
use std::sync::OnceLock;

use csbrdf::Limits;
use csbrdf::base::error::Error;
use csbrdf::codec::sample::SplitMix64;
use csbrdf::decode::{PrunedPolicy, Reader};
use csbrdf::edit::salvage::{Damage, Outcome, Salvaged, repair, salvage_with_limits};
use csbrdf::format::metadata::Metadata;

use super::golden::GOLDEN;
use super::salvage::check_report;
use super::same_bits;

const LIMITS: Limits =
    Limits { table_values: 1 << 18, block_values: 1 << 18, operations: 1_000_000_000, bytes: 1 << 28 };

/// Damages of one file.
const MOST: usize = 4;
/// Kinds of damage.
pub const KINDS: u8 = 11;

/// Most values of a table, or it takes too long.
const VALUES: usize = 1 << 15;

/// A golden file and what is in it, decoded once.
struct Original {
    file: &'static [u8],
    reader: Reader<&'static [u8]>,
    sections: Vec<Range<usize>>,
    blocks: Vec<Block>,
    /// Values of each block if nothing is left of it but its mean; none for old drafts, which have no pruned blocks.
    means: Option<Vec<Vec<f32>>>,
    metadata: String,
}

/// What is known of a block.
struct Block {
    values: Vec<f32>,
    valid: Vec<bool>,
    errors: [u32; 2],
    /// Bits of the source values of a lossless file.
    exact: Option<Vec<u64>>,
}

impl Original {
    fn of(file: &'static [u8]) -> Original {
        let reader = Reader::open(file).expect("golden files open").with_pruned(PrunedPolicy::Coarse);
        let blocks = (0..reader.block_count()).map(|block| {
            let values = of_block(&reader, block).expect("a golden file decodes");
            let valid = reader.block_validity(block).expect("a golden file decodes");
            Block { values, valid, errors: errors(&reader, block), exact: exact(&reader, block) }
        });
        let (blocks, sections) = (blocks.collect(), places(&reader));
        let means = means(&reader);
        let metadata = said(reader.metadata());
        Original { file, reader, sections, blocks, means, metadata }
    }
}

/// Golden files of some size, spare, lossless, pruned ones and old drafts among them.
fn originals() -> &'static [OnceLock<Original>] {
    static ORIGINALS: OnceLock<Vec<OnceLock<Original>>> = OnceLock::new();
    ORIGINALS.get_or_init(|| small().map(|_| OnceLock::new()).collect())
}

fn small() -> impl Iterator<Item = &'static [u8]> {
    let values = |file: &[u8]| {
        let reader = Reader::open(file).expect("golden files open");
        reader.grid().positions() * reader.grid().channels().len()
    };
    let wanted = move |(name, file): &&(&str, &[u8])| values(file) <= VALUES || *name == "final-pruned";
    GOLDEN.iter().filter(wanted).map(|(_, file)| *file)
}

pub fn run(data: &[u8]) {
    let Some((&file, damages)) = data.split_first() else { return };
    let number = usize::from(file) % originals().len();
    let file = || small().nth(number).expect("a number below their count");
    let original = originals()[number].get_or_init(|| Original::of(file()));
    let mut bad = original.file.to_vec();
    damages.as_chunks::<6>().0.iter().take(MOST).for_each(|d| damage(*d, &original.sections, &mut bad));
    check(original, &bad);
}

/// Panics unless what is left of a damaged file is the original's, and all else is said.
fn check(original: &Original, bad: &[u8]) {
    let good = original.file;
    let salvaged = match salvage_with_limits(bad, LIMITS) {
        Ok(salvaged) => salvaged,
        Err(e) => {
            assert!(good != bad && !e.to_string().is_empty(), "{e}");
            return assert!(repair(bad, LIMITS).is_err(), "repair has what salvage has not");
        }
    };
    check_report(&salvaged);
    assert_eq!(good == bad, salvaged.damage().is_empty(), "damage is reported if there is any");
    kept(original, salvaged.reader(), salvaged.lost(), "salvage");
    described(original, &salvaged);
    only_what_was_hit(original, bad, &salvaged);
    match repair(bad, LIMITS) {
        Ok(repaired) => {
            agree(&salvaged, &repaired.salvaged);
            if salvaged.is_whole() {
                assert!(repaired.bytes == good, "restored, it says, and is not: {:?}", salvaged.damage());
            }
            written(original, &repaired.bytes, salvaged.lost());
        }
        // Files of old drafts have no place for what is lost.
        Err(Error::InvalidArgument(_)) => {
            assert!(!salvaged.lost().is_empty() && (1..4).contains(&original.reader.version().2));
        }
        Err(e) => panic!("what salvage opens is not repaired: {e}"),
    }
}

fn damage([kind, fill, a, b, c, d]: [u8; 6], sections: &[Range<usize>], bad: &mut Vec<u8>) {
    if bad.is_empty() {
        return;
    }
    let (place, length) = (u32::from(u16::from_le_bytes([a, b])), usize::from(u16::from_le_bytes([c, d])));
    let mut at = (place as usize * bad.len()) >> 16;
    let few = 1 + length % 64;
    let kind = kind % KINDS;
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
fn places(reader: &Reader<&[u8]>) -> Vec<Range<usize>> {
    let mut places: Vec<_> = reader.directory().sections().iter().map(|s| s.range.clone()).collect();
    places.insert(0, 0..places[0].start);
    places
}

/// Two stretches of a file, one in the place of the other.
fn swap(bytes: &mut Vec<u8>, a: &Range<usize>, b: &Range<usize>) {
    let (first, second) = if a.start <= b.start { (a, b) } else { (b, a) };
    if first != second && second.end <= bytes.len() {
        let parts = [&bytes[..first.start], &bytes[second.clone()], &bytes[first.end..second.start]];
        *bytes = [&parts.concat()[..], &bytes[first.clone()], &bytes[second.end..]].concat();
    }
}

/// Every value that is not reported as lost has the original's bits, exact ones as well.
fn kept<D: AsRef<[u8]>>(original: &Original, reader: &Reader<D>, lost: &[usize], who: &str) {
    assert_eq!(reader.block_count(), original.blocks.len(), "{who}");
    for (block, right) in original.blocks.iter().enumerate() {
        // Exact values are lost block by block, by an error.
        let exact = exact(reader, block);
        assert!(exact.is_none() || exact == right.exact, "{who}: wrong source values of block {block}");
        if lost.binary_search(&block).is_ok() {
            assert!(exact.is_none(), "{who}: source values of block {block}, which is lost");
            continue;
        }
        let values = of_block(reader, block).unwrap_or_else(|e| panic!("{who}: block {block} is not lost: {e}"));
        assert!(
            same_bits(&values, &right.values),
            "{who}: wrong values of block {block}, which is not reported as lost"
        );
        assert!(
            reader.block_validity(block).is_ok_and(|valid| valid == right.valid),
            "{who}: validity of block {block}"
        );
        assert_eq!(errors(reader, block), right.errors, "{who}: errors of block {block}");
    }
}

fn of_block<D: AsRef<[u8]>>(reader: &Reader<D>, block: usize) -> Result<Vec<f32>, Error> {
    let mut values = vec![f32::NAN; reader.block_values(block)?];
    reader.block_into(block, &mut values).map(|()| values)
}

fn errors<D: AsRef<[u8]>>(reader: &Reader<D>, block: usize) -> [u32; 2] {
    let info = reader.block_info(block).expect("a block that decodes");
    [info.rms.to_bits(), info.max.to_bits()]
}

fn exact<D: AsRef<[u8]>>(reader: &Reader<D>, block: usize) -> Option<Vec<u64>> {
    reader.source_block(block).ok().map(|values| values.into_iter().map(f64::to_bits).collect())
}

fn said(metadata: Result<Metadata, Error>) -> String {
    format!("{:?}", metadata.map(|m| (m.name, m.encoder)))
}

/// What the file says of itself is the original's.
fn described(original: &Original, salvaged: &Salvaged) {
    let reader = salvaged.reader();
    assert_eq!(reader.grid(), original.reader.grid());
    assert_eq!(reader.coding(), original.reader.coding());
    let is_lost = |damage: &Damage| damage.section == "META" && damage.outcome == Outcome::Lost;
    if !salvaged.damage().iter().any(is_lost) {
        assert_eq!(said(reader.metadata()), original.metadata);
    }
    // The mean of a lost block is known, or it is said that it is not.
    let Some(means) = &original.means else { return };
    for &block in salvaged.lost().iter().filter(|&&block| salvaged.has_mean(block)) {
        let same = same_bits(&of_block(reader, block).expect("a mean"), &means[block]);
        assert!(same, "block {block} has another mean than it had, and it is said to be known");
    }
}

/// Values of blocks of which nothing is left but the mean.
fn means(original: &Reader<&[u8]>) -> Option<Vec<Vec<f32>>> {
    let index = original.directory().sections().iter().find(|s| s.name() == "INDX").expect("it was opened");
    let trace = format!("csbrdf trace 1\nblocks {} index {:08x}\n", original.block_count(), index.crc);
    let touched = csbrdf::brdf::touched::Touched::from_text(&trace).ok()?;
    let pruned = csbrdf::edit::prune::Pruner::new().blocks(&touched).prune(original).ok()?;
    let means = Reader::open(&pruned.bytes[..]).expect("what prune makes opens").with_pruned(PrunedPolicy::Coarse);
    Some((0..means.block_count()).map(|block| of_block(&means, block).expect("a mean")).collect())
}

/// Damage within RECS costs the blocks whose records it hits and no others.
fn only_what_was_hit(original: &Original, bad: &[u8], salvaged: &Salvaged) {
    let (good, original) = (original.file, &original.reader);
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
fn written(original: &Original, bytes: &[u8], lost: &[usize]) {
    let strict = Reader::open_with_limits(bytes, LIMITS).expect("a repaired file opens");
    assert!(strict.verify().is_empty(), "a repaired file is damaged: {:?}", strict.verify());
    assert!(lost.iter().all(|&block| of_block(&strict, block).is_err()), "what is lost is given out");
    kept(original, &strict.with_pruned(PrunedPolicy::Coarse), lost, "repair");
    let again = repair(bytes, LIMITS).expect("a repaired file is repaired again");
    assert!(again.salvaged.damage().is_empty() && again.salvaged.lost().is_empty());
    assert!(again.bytes == bytes, "a repaired file does not repair to itself");
}
