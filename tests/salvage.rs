//! What is left of damaged files, and files repaired.
#![cfg(feature = "encode")]

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::OnceLock;

use csbrdf::Limits;
use csbrdf::base::error::Error;
use csbrdf::decode::Reader;
use csbrdf::edit::salvage::{Options, Outcome, Salvaged, repair, salvage, salvage_with};
use csbrdf::encode::Encoder;
use csbrdf::table::Table;
use csbrdf::table::grid::Grid;
use csbrdf::table::synth::Recipe;

fn table() -> Table {
    let grid = Grid::merl().with_lengths(&[10, 12, 16]).unwrap();
    Recipe { holes: 0.03, noise: 0.02, ..Recipe::named("satin-paint").unwrap() }.synthesise(&grid).unwrap()
}

fn encoder() -> Encoder {
    Encoder::new().block_shape(&[5, 3, 8]).quality(0.02)
}

fn plain() -> &'static [u8] {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| encoder().encode(&table()).unwrap().bytes)
}

fn spare() -> &'static [u8] {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| encoder().spare(true).encode(&table()).unwrap().bytes)
}

fn lossless() -> &'static [u8] {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| encoder().lossless(true).encode(&table()).unwrap().bytes)
}

fn section(bytes: &[u8], name: &str) -> Range<usize> {
    let reader = Reader::open(bytes).unwrap();
    reader.directory().sections().iter().find(|s| s.name() == name).unwrap().range.clone()
}

fn block<D: AsRef<[u8]>>(reader: &Reader<D>, number: usize) -> (Vec<f32>, Vec<bool>) {
    let mut values = vec![0.0; reader.block_values(number).unwrap()];
    reader.block_into(number, &mut values).unwrap();
    (values, reader.block_validity(number).unwrap())
}

/// All blocks that are not lost are those of the intact file, the others have no valid entry.
fn check(good: &[u8], salvaged: &Salvaged) {
    let good = Reader::open(good).unwrap();
    for number in 0..good.block_count() {
        let (values, valid) = block(salvaged.reader(), number);
        if salvaged.lost().contains(&number) {
            assert!(!valid.contains(&true));
        } else {
            assert!((values, valid) == block(&good, number), "block {number}, {:?}", salvaged.damage());
        }
    }
}

/// Repaired, the file is valid and holds what was salvaged; if nothing is lost it is what it was.
fn check_repair(good: &[u8], bad: &[u8]) -> Vec<usize> {
    let repaired = repair(bad, Limits::default()).unwrap();
    let reader = Reader::open(&repaired.bytes[..]).unwrap();
    let damage = reader.verify();
    assert!(damage.is_empty(), "{damage:?}");
    let lost = repaired.salvaged.lost().to_vec();
    check(good, &repaired.salvaged);
    assert_eq!(repaired.salvaged.is_whole(), repaired.bytes == good);
    assert_eq!(reader.lost_blocks().collect::<Vec<_>>(), lost);
    for number in (0..reader.block_count()).filter(|number| !lost.contains(number)) {
        assert!(block(&reader, number) == block(&Reader::open(good).unwrap(), number));
    }
    let again = salvage(&repaired.bytes).unwrap();
    assert!(again.damage().is_empty());
    lost
}

#[test]
fn intact_files_are_left_alone() {
    for good in [plain(), spare(), lossless()] {
        let salvaged = salvage(good).unwrap();
        assert!(salvaged.damage().is_empty() && salvaged.lost().is_empty());
        assert_eq!(salvaged.lost_entries(), 0);
        check(good, &salvaged);
        assert!(repair(good, Limits::default()).unwrap().bytes == good);
    }
    assert!(lossless().windows(4).any(|w| w == b"SPAR") && !plain().windows(4).any(|w| w == b"SPAR"));
}

/// Any bit outside the payload: nothing is lost if it is said to be restored, and what is not proven is lost by name: never a wrong value. In
/// a record: that block. The table is small, so that little vouches for its sections: those of measured tables are proven more often.
#[test]
fn one_flipped_bit_is_restored_or_named() {
    let good = plain();
    let records = section(good, "RECS");
    let reader = Reader::open(good).unwrap();
    // Of each section, the bits that were tried, and those that were restored.
    let mut tried: BTreeMap<String, [usize; 2]> = BTreeMap::new();
    for bit in (0..8 * good.len()).step_by(7) {
        let mut bad = good.to_vec();
        bad[bit / 8] ^= 1 << (bit % 8);
        let sections = reader.directory().sections();
        let name = sections.iter().find(|s| s.range.contains(&(bit / 8))).map_or("frame".into(), |s| s.name());
        let count = tried.entry(name.clone()).or_default();
        count[0] += 1;
        let salvaged = match salvage(&bad) {
            Ok(salvaged) => salvaged,
            Err(e) => {
                let text = e.to_string();
                assert!(text.contains(&name) && text.contains("--evidence"), "bit {bit}: {text}");
                // The guess is right, and said to be one.
                let guessed = salvage_with(&bad, &Options::default().evidence(14)).unwrap();
                assert!(
                    matches!(guessed.damage()[0].outcome, Outcome::Assumed { bits: 14..32 }) && !guessed.is_whole()
                );
                check(good, &guessed);
                continue;
            }
        };
        assert!(!salvaged.damage().is_empty(), "bit {bit}");
        check(good, &salvaged);
        let hurt = |b: &usize| reader.block_info(*b).unwrap().record.contains(&(bit / 8));
        if records.contains(&(bit / 8)) {
            assert_eq!(salvaged.lost(), (0..reader.block_count()).filter(hurt).collect::<Vec<_>>(), "bit {bit}");
        } else if name != "INDX" {
            assert!(salvaged.lost().is_empty(), "bit {bit}");
        }
        count[1] += usize::from(salvaged.is_whole());
        if bit % 11 == 0 || salvaged.is_whole() {
            assert_eq!(check_repair(good, &bad), salvaged.lost(), "bit {bit}");
        }
    }
    let share = |name: &str| tried[name][1] as f64 / tried[name][0] as f64;
    for (name, least) in [("frame", 1.0), ("GRID", 1.0), ("CODE", 1.0), ("PART", 1.0), ("INDX", 0.5)] {
        assert!(share(name) >= least, "{name}: {:?}", tried[name]);
    }
    // PROB is long: its checksum and records prove 28 bits or so, so its guess is right, but a guess. Nothing else vouches for a text or a profile.
    assert_eq!(share("PROB"), 0.0);
    assert_eq!((share("META"), share("RECS")), (0.0, 0.0));
}

#[test]
fn a_spare_copy_makes_up_for_any_damage_before_the_records() {
    let good = spare();
    let head = section(good, "RECS").start;
    let index = section(good, "INDX");
    for (start, length) in [(0, head), (0, 32), (32, 160), (192, 64), (index.end - 90, 150), (index.start, index.len())]
    {
        let mut bad = good.to_vec();
        bad[start..start + length].fill(0x5A);
        assert!(Reader::open(&bad[..]).is_err(), "nothing is taken from the copy silently");
        assert!(check_repair(good, &bad).is_empty(), "{start}, {length}");
    }
    // The copy itself, or both but in different places.
    let copy = section(good, "SPAR");
    let mut bad = good.to_vec();
    bad[copy.start + 40..copy.end - 100].fill(0);
    assert!(Reader::open(&bad[..]).unwrap().verify().len() == 1 && check_repair(good, &bad).is_empty());
    bad[10] ^= 4;
    assert!(check_repair(good, &bad).is_empty());
    // Damage in both, of different sections.
    let mut bad = good.to_vec();
    bad[section(good, "PROB")].fill(3);
    bad[copy.start + index.start..copy.start + index.end].fill(3);
    assert!(check_repair(good, &bad).is_empty());
    // A copy of something else, its checksums right.
    let mut bad = good.to_vec();
    bad[copy.start + 300] ^= 1;
    let end = copy.end - 8;
    let crc = crc32fast::hash(&bad[copy.start..end]).to_le_bytes();
    bad[end..end + 4].copy_from_slice(&crc);
    let entry = 32 + 20 * (usize::from(bad[14]) - 1) + 16;
    let crc = crc32fast::hash(&bad[copy.clone()]).to_le_bytes();
    bad[entry..entry + 4].copy_from_slice(&crc);
    let table = [&bad[..28], &bad[32..32 + 20 * usize::from(bad[14])]].concat();
    bad[28..32].copy_from_slice(&crc32fast::hash(&table).to_le_bytes());
    let damage = Reader::open(&bad[..]).unwrap().verify();
    assert!(damage.len() == 1 && damage[0].to_string().contains("SPAR"), "{damage:?}");
}

/// Without a copy: three bytes of the index cost nothing where enough records behind them prove it, otherwise all blocks; so does more of it:
/// all of them.
#[test]
fn an_index_is_as_good_as_the_records_prove() {
    let good = plain();
    let index = section(good, "INDX");
    let blocks = Reader::open(good).unwrap().block_count();
    let mut restored = 0;
    for at in index.start..index.end - 2 {
        let mut bad = good.to_vec();
        bad[at..at + 3].iter_mut().for_each(|byte| *byte ^= 0x5A);
        let salvaged = salvage(&bad).unwrap();
        check(good, &salvaged);
        let lost = salvaged.lost();
        assert_eq!(lost, (blocks - lost.len()..blocks).collect::<Vec<_>>(), "{at}");
        assert_eq!(lost.is_empty(), salvaged.is_whole(), "{at}");
        // What is behind the damage proves nothing.
        assert!(!salvaged.is_whole() || at + 12 < index.end, "{at}");
        restored += usize::from(salvaged.is_whole());
    }
    assert!(3 * restored > index.len(), "{restored} of {}", index.len());
    let mut left = Vec::new();
    for at in [index.start + 4, index.start + index.len() / 2, index.end - 40] {
        let mut bad = good.to_vec();
        bad[at..at + 20].fill(0x77);
        let lost = check_repair(good, &bad);
        assert_eq!(lost, (blocks - lost.len()..blocks).collect::<Vec<_>>());
        left.push(blocks - lost.len());
    }
    // Without a proven change no mean is proven: damage at the start of the stream would show in no length.
    assert_eq!(left, [0; 3]);
}

#[test]
fn what_nothing_can_be_decoded_without_is_named() {
    for name in ["GRID", "CODE", "PART", "PROB"] {
        let range = section(plain(), name);
        let mut bad = plain().to_vec();
        bad[range.start..range.start + 12].iter_mut().for_each(|byte| *byte ^= 0x99);
        let error = salvage(&bad).err().unwrap().to_string();
        assert!(error.contains(name) && error.contains("beyond repair"), "{error}");
    }
    let mut bad = plain().to_vec();
    bad[40..100].fill(0);
    assert!(matches!(salvage(&bad).err().unwrap(), Error::Corrupt { .. }));
    assert!(matches!(salvage(b"hello, world").err().unwrap(), Error::NotCsbrdf { .. }));
    // META costs the metadata.
    let meta = section(plain(), "META");
    let mut bad = plain().to_vec();
    bad[meta.start + 9..meta.start + 20].fill(0);
    assert!(check_repair(plain(), &bad).is_empty());
}

#[test]
fn cut_files_keep_the_records_that_are_whole() {
    let good = plain();
    let reader = Reader::open(good).unwrap();
    let records = section(good, "RECS");
    for length in records.start..good.len() {
        let salvaged = salvage(&good[..length]).unwrap();
        let gone = |b: &usize| reader.block_info(*b).unwrap().record.end > length;
        assert_eq!(salvaged.lost(), (0..reader.block_count()).filter(gone).collect::<Vec<_>>(), "{length}");
        if length % 97 == 0 || length + 9 > records.end {
            check_repair(good, &good[..length]);
        }
    }
    // Without records nothing is left; without the whole index it is not known what there was.
    for good in [plain(), spare(), lossless()] {
        for length in 0..section(good, "RECS").start {
            let _ = salvage(&good[..length]);
        }
    }
    assert_eq!(salvage(&good[..records.start - 1]).unwrap().lost().len(), reader.block_count());
    assert!(salvage(&good[..section(good, "INDX").end - 1]).is_err());
    // Bytes after the end, and bytes that are missing in the middle.
    let mut bad = good.to_vec();
    bad.extend([7; 100]);
    assert!(check_repair(good, &bad).is_empty());
    let mut bad = good.to_vec();
    bad.drain(records.start + records.len() / 2..records.start + records.len() / 2 + 17);
    let lost = check_repair(good, &bad);
    assert!((1..=2).contains(&lost.len()), "{lost:?}");
}

#[test]
fn exact_values_are_lost_block_by_block() {
    let good = lossless();
    let (exact, records) = (section(good, "EXCT"), section(good, "RECS"));
    let reference = Reader::open(good).unwrap().source_table().unwrap();
    let left = |salvaged: &Salvaged, gone: usize| {
        let (values, lost) = salvaged.source_table(-1.0).unwrap();
        assert_eq!(lost, gone);
        let same = |(a, b): &(&f64, &f64)| a.to_bits() == b.to_bits();
        let n = values.iter().zip(&reference).filter(same).count();
        assert!(values.iter().zip(&reference).all(|pair| same(&pair) || *pair.0 == -1.0));
        n
    };
    let head = 4 + 8 * 3 + 4 * Reader::open(good).unwrap().block_count() + 4;
    for (bytes, blocks, gone) in [
        (exact.start + head + 60..exact.start + head + 61, 0, 1),
        (exact.start + 40..exact.start + 41, 0, 0),
        (records.start + 7..records.start + 8, 1, 1),
    ] {
        let mut bad = good.to_vec();
        bad[bytes.start] ^= 0x10;
        let salvaged = salvage(&bad).unwrap();
        assert_eq!(salvaged.lost().len(), blocks);
        let n = left(&salvaged, gone);
        assert!(n >= reference.len() * 4 / 5 && (n < reference.len()) == (gone > 0), "{n}");
        check_repair(good, &bad);
        // What was lost stays so, and is an error.
        let repaired = repair(&bad, Limits::default()).unwrap();
        assert_eq!(left(&salvage(&repaired.bytes).unwrap(), gone), n);
        assert_eq!(Reader::open(&repaired.bytes[..]).unwrap().source_table().is_err(), gone > 0);
    }
    // The head of the section: all source values, no others.
    let mut bad = good.to_vec();
    bad[exact.start..exact.start + 40].fill(1);
    let salvaged = salvage(&bad).unwrap();
    assert!(salvaged.lost().is_empty() && salvaged.source_table(-1.0).is_err());
    check_repair(good, &bad);
    // Cut within it.
    let salvaged = salvage(&good[..exact.end - exact.len() / 2]).unwrap();
    assert!(salvaged.lost().is_empty() && salvaged.source_table(-1.0).unwrap().1 > 1);
    check_repair(good, &good[..exact.end - exact.len() / 2]);
}

/// Old files: values as far as they go, but no new file if blocks are lost. Metadata alone cost nothing else in any.
#[test]
fn files_of_old_drafts_are_salvaged() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/v1");
    let mut drafts = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "csbrdf") {
            continue;
        }
        let good = std::fs::read(&path).unwrap();
        let draft = Reader::open(&good[..]).unwrap().version().2;
        drafts.push(draft);
        let reader = Reader::open(&good[..]).unwrap();
        let record = reader.block_info(reader.block_count() / 2).unwrap().record;
        let mut bad = good.clone();
        bad[record.start] ^= 0x40;
        let salvaged = salvage(&bad).unwrap();
        assert_eq!(salvaged.lost(), [reader.block_count() / 2]);
        let pruned = path.to_string_lossy().contains("pruned");
        if !pruned {
            check(&good, &salvaged);
        }
        assert_eq!(repair(&bad, Limits::default()).is_ok(), draft == 0 || draft > 3, "{}", path.display());
        assert!(repair(&good, Limits::default()).unwrap().bytes == good, "{}", path.display());
        let mut bad = good.clone();
        bad[section(&good, "META")][..3].fill(0xFF);
        if !pruned {
            assert!(check_repair(&good, &bad).is_empty(), "{}", path.display());
        }
    }
    assert!([0, 1, 3, 5].iter().all(|draft| drafts.contains(draft)), "{drafts:?}");
}

/// Damage of any kind and place: what is said to be restored is the file, and no block that is left is another.
#[test]
fn nothing_wrong_is_said_to_be_restored() {
    let mut random = csbrdf::codec::sample::SplitMix64(11);
    for round in 0..600usize {
        let good = [plain(), spare(), lossless()][round % 3];
        let mut bad = good.to_vec();
        let mut below = |n: usize| (random.next_u64() >> 11) as usize % n;
        let reader = Reader::open(good).unwrap();
        let sections = reader.directory().sections();
        for _ in 0..1 + round % 2 {
            // By section, so that the small ones are hit as often.
            let range = sections[below(sections.len())].range.clone();
            let at = range.start + below(range.len());
            let length = (1 + below([1, 4, 64][round / 3 % 3])).min(bad.len() - at);
            bad[at..at + length].fill_with(|| below(256) as u8);
        }
        let Ok(repaired) = repair(&bad, Limits::default()) else { continue };
        assert_eq!(repaired.salvaged.is_whole(), repaired.bytes == good, "round {round}");
        check(good, &repaired.salvaged);
    }
}

/// Whatever the bytes, also under a right checksum of the section table: an answer, no panic.
#[test]
fn any_bytes_are_survived() {
    let mut random = csbrdf::codec::sample::SplitMix64(3);
    for round in 0..4000usize {
        let mut bad = [plain(), spare(), lossless()][round % 3].to_vec();
        let head = section(plain(), "RECS").start;
        for _ in 0..1 + round % 4 {
            let at = 8 + random.next_u64() as usize % (head - 8);
            bad[at] = [0, 0xFF, 0x80, random.next_u64() as u8][round % 4];
        }
        let count = usize::from(u16::from_le_bytes([bad[14], bad[15]]));
        if round % 5 > 0 && 32 + 20 * count < bad.len() {
            let table = [&bad[..28], &bad[32..32 + 20 * count]].concat();
            bad[28..32].copy_from_slice(&crc32fast::hash(&table).to_le_bytes());
        }
        if round % 7 == 0 {
            bad.truncate(random.next_u64() as usize % bad.len());
        }
        if let Ok(salvaged) = salvage(&bad) {
            let _ = (salvaged.reader().decode_table(), salvaged.source_table(0.0), repair(&bad, Limits::default()));
        }
    }
}
