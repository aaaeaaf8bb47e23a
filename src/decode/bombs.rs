//! Small files that claim much, written with valid checksums: what they cost is bounded by the caller's limits, and refused before
//! it is paid.

mod make;

use std::time::Instant;

use self::make::{Bomb, QUANTIZATION, WORST, wide, worst};
use super::{PrunedPolicy, Reader};
use crate::base::bytes::Bytes;
use crate::base::error::Error;
use crate::codec::contexts::contexts;
use crate::edit::salvage::salvage_with_limits;
use crate::base::limits::Limits;
use crate::format::directory;
use crate::format::file::write_file;
use crate::format::header::{write_grid, write_partition};
use crate::format::probabilities::write_probabilities;
use crate::format::profile::CodedProfile;

fn is_limit<T>(result: Result<T, Error>) -> bool {
    matches!(result, Err(Error::LimitExceeded { .. }))
}

#[test]
fn tables_and_blocks_of_any_size_are_refused_by_limits() {
    // 2^28 values in 64 records of 5 bytes.
    let bomb = Bomb { lens: [512, 256, 256], channels: 8, block: [64, 128, 64], ..Bomb::default() };
    let file = bomb.file();
    assert!(file.len() < 2000);
    let tight = Limits { table_values: 1 << 20, ..Limits::default() };
    let reader = Reader::open_with_limits(&file[..], tight).unwrap();
    assert!(
        is_limit(reader.decode_all())
            && is_limit(reader.decode_table())
            && is_limit(reader.verify().pop().map_or(Ok(()), Err))
    );
    let tight = Limits { block_values: (1 << 22) - 1, ..Limits::default() };
    assert!(is_limit(Reader::open_with_limits(&file[..], tight)));
    assert!(is_limit(salvage_with_limits(&file, tight)));
    // One value more is no table of this crate's usual limits.
    let larger = Bomb { lens: [512, 257, 256], ..bomb };
    assert!(is_limit(Reader::open(larger.file()).unwrap().decode_all()));
}

/// Rows of one value: a list of them would take several times the memory of the values.
#[test]
fn short_rows_are_decoded() {
    let bomb = Bomb { lens: [2560, 2048, 1], block: [512, 512, 1], ..Bomb::default() };
    let file = bomb.with_coefficients(false).file();
    let reader = Reader::open(&file[..]).unwrap();
    let all = reader.decode_all().unwrap();
    let table = reader.decode_table().unwrap();
    let mut block = vec![0.0; reader.block_values(5).unwrap()];
    reader.block_into(5, &mut block).unwrap();
    let place = reader.place(5).unwrap();
    let mut expected = block.clone();
    place.gather(reader.grid().shape(), &all, &mut expected);
    assert!(block == expected && table.valid().iter().all(|v| *v) && block.iter().any(|v| *v != block[0]));
    assert!(table.values().iter().zip(&all).all(|(a, b)| (a - f64::from(*b)).abs() < 1e-5));
}

/// A profile of millions of values, in a section of some bytes.
#[test]
fn profiles_count_as_blocks() {
    let (channels, knots) = (2048, 64);
    let first = vec![0; 4 * channels];
    let profile = CodedProfile { knots, zone: 0.5, step: 0.1, first, coded: vec![], offset: 0 };
    let bomb = Bomb { lens: [64, 64, 1], block: [1, 1, 1], channels, profile: Some(profile), ..Bomb::default() };
    let file = Bomb { lens: [64, 1, 1], ..bomb }.file();
    assert!(Reader::open(&file[..]).is_ok());
    let tight = Limits { block_values: 1 << 20, ..Limits::default() };
    assert!(is_limit(Reader::open_with_limits(&file[..], tight)));
}

/// An index cannot claim more blocks than the records have bytes, nor a damaged file more than it has room for.
#[test]
fn blocks_are_bounded_by_bytes() {
    let bomb = Bomb { lens: [256, 256, 64], block: [256, 256, 64], ..Bomb::default() };
    let many = Bomb { block: [1, 1, 1], lens: bomb.lens, ..Bomb::default() };
    let mut sections = vec![
        (directory::GRID, false, write_grid(&bomb.grid())),
        (directory::PARTITION, false, write_partition(&many.partition(), 3)),
        (directory::PROBABILITIES, false, write_probabilities(&vec![None; contexts(QUANTIZATION)])),
        (directory::INDEX, false, (1u32 << 22).to_le_bytes().to_vec()),
        (directory::RECORDS, false, vec![0; 4096]),
    ];
    let small = Bomb::default().file();
    let coding = Reader::open(&small[..]).unwrap().section(directory::CODING).unwrap().unwrap();
    sections.insert(1, (directory::CODING, false, coding));
    let file = write_file((1, 0, 4), &sections);
    let start = Instant::now();
    assert!(matches!(Reader::open(&file[..]), Err(Error::Corrupt { section: "INDX", .. })));
    assert!(salvage_with_limits(&file, Limits::default()).is_err());
    // A cut file that says it had records for all of them.
    let mut cut = write_file((1, 0, 4), &[&sections[..5], &[(directory::RECORDS, false, vec![0; 5 << 22])]].concat());
    cut.truncate(1000);
    assert!(is_limit(salvage_with_limits(&cut, Limits::default())));
    assert!(start.elapsed().as_secs() < 5);
}

/// Of many damaged blocks not all are listed.
#[test]
fn lists_of_damage_are_bounded() {
    let bomb = Bomb { lens: [64, 64, 48], block: [1, 1, 1], ..Bomb::default() };
    let mut file = bomb.file();
    let records = Reader::open(&file[..]).unwrap().directory().find(directory::RECORDS).unwrap().range.clone();
    file[records].fill(9);
    let reader = Reader::open(&file[..]).unwrap();
    assert!((1 << 16..=2 << 16).contains(&reader.verify().len()));
    assert!(reader.decode_all().is_err());
}

/// The list of lengths in EXCT is as long as it says, or an error; it is read when bits are asked for, and has room for eight bytes a
/// block, which the block takes in the file as well.
#[test]
fn lists_of_lengths_are_bounded() {
    let bomb = Bomb { lens: [64, 64, 16], block: [1, 1, 1], ..Bomb::default() };
    let blocks = bomb.partition().block_count();
    for (lengths, part) in [(0, 0), (blocks - 1, 4), (blocks, 0), (blocks, u32::MAX), (blocks, 4)] {
        let mut exact = (blocks as u32).to_le_bytes().to_vec();
        exact.extend([0; 8]);
        exact.extend([part; 1].repeat(lengths).iter().flat_map(|length: &u32| length.to_le_bytes()));
        exact.extend(crc32fast::hash(&exact).to_le_bytes());
        let reader = Reader::open(Bomb { exact: Some(exact), ..bomb.clone() }.file()).unwrap();
        assert!(reader.is_lossless() && reader.source_block(0).is_err() && reader.source_table().is_err());
        assert!(!reader.verify().is_empty() && reader.decode_all().is_ok());
    }
}

/// JSON that is deep, or wide, or of many small objects: an error, or some tens of megabytes.
#[test]
fn metadata_are_bounded() {
    let open = |text: &[u8]| {
        let mut metadata = (text.len() as u32).to_le_bytes().to_vec();
        metadata.extend(zstd::bulk::compress(text, 3).unwrap());
        Reader::open(Bomb { metadata: Some(metadata), ..Bomb::default() }.file()).unwrap().metadata()
    };
    for (deep, close) in [("[", ""), ("{\"a\":", ""), ("[", "]"), ("{\"a\":[", "]}")] {
        let n = 500_000 / deep.len();
        let text = format!("{{\"other\":{}{}}}", deep.repeat(n), close.repeat(n));
        assert!(open(text.as_bytes()).is_err());
    }
    assert!(open(wide().as_bytes()).is_ok());
    assert!(is_limit(open(("{\"other\":[{\"\":0}".to_string() + &",{\"\":0}".repeat(1 << 14) + "]}").as_bytes())));
    // A frame of more than it says.
    let mut metadata = 100u32.to_le_bytes().to_vec();
    metadata.extend(zstd::bulk::compress(&vec![b' '; 1 << 28], 3).unwrap());
    assert!(metadata.len() < 50_000);
    assert!(Reader::open(Bomb { metadata: Some(metadata), ..Bomb::default() }.file()).unwrap().metadata().is_err());
}

/// Tight limits on operations and bytes: each call is within them, or names the one that it would break, and ends soon.
#[test]
fn every_call_draws_on_the_budget() {
    use crate::assess::lint::lint_brdf;
    use crate::brdf::Brdf;
    use crate::brdf::importance::Importance;
    use crate::edit::prune::Pruner;
    for name in ["corner", "corner-dft", "corrections", "drawn", "lossless", "rows", "profile-wide"] {
        let file = worst(name);
        let start = Instant::now();
        for limits in [
            Limits { operations: 0, bytes: 1 << 24, ..Limits::default() },
            Limits { operations: 1 << 20, bytes: 0, ..Limits::default() },
        ] {
            let open = || {
                Reader::open_with_limits(Bytes::from(file.clone()), limits)
                    .map(|reader| reader.with_pruned(PrunedPolicy::Coarse))
            };
            let reader = match open() {
                Ok(reader) => reader,
                Err(e) => {
                    assert!(matches!(e, Error::LimitExceeded { .. }), "{name}: {e}");
                    continue;
                }
            };
            let named = |what: &str, result: Result<(), Error>| {
                assert!(
                    matches!(&result, Ok(()) | Err(Error::LimitExceeded { .. } | Error::Corrupt { .. })),
                    "{name}, {what}: {result:?}"
                );
                result.is_err()
            };
            let mut values = vec![0.0; reader.block_values(0).unwrap()];
            let mut refused = named("block", reader.block_into(0, &mut values));
            refused |= named("validity", reader.block_validity(0).map(|_| ()));
            refused |= named("origin", reader.block_origin(0).map(|_| ()));
            refused |= named("origins", reader.block_origins(0).map(|_| ()));
            refused |= named("info", reader.block_info(0).map(|_| ()));
            refused |= named("importance", Importance::new(&reader).map(|_| ()));
            refused |= named("prune", Pruner::new().channels(&[0]).detail(0.0).prune(&reader).map(|_| ()));
            let brdf = Brdf::from_reader(reader).unwrap();
            let mut value = vec![0.0; brdf.reader().grid().channels().len()];
            refused |= named("eval", brdf.eval_into([0.3, 0.1, 0.9], [-0.4, 0.2, 0.8], &mut value));
            refused |= named("lint", lint_brdf(&brdf).map(|_| ()));
            assert!(refused, "{name}: within {limits:?}");
        }
        assert!(start.elapsed().as_secs() < 30, "{name}: {:?}", start.elapsed());
    }
}

/// Blocks that the cache cannot hold together are not rebuilt for ever, and what one leaves behind is not kept.
#[test]
fn look_ups_in_turn_end() {
    use crate::brdf::BrdfOptions;
    let file = worst("alternating");
    let limits = Limits { operations: 200_000_000, ..Limits::default() };
    let open = |one: bool| {
        let reader = Reader::open_with_limits(Bytes::from(file.clone()), limits).unwrap();
        let reader = if one { reader.with_one_budget() } else { reader };
        BrdfOptions::new().cache_bytes(1 << 20).from_reader(reader).unwrap()
    };
    for one in [false, true] {
        let (brdf, start) = (open(one), Instant::now());
        // Half vectors near the normal and near the horizon.
        let pairs = [([0.0, 0.0, 1.0], [0.1, 0.0, 0.995]), ([0.97, 0.0, 0.24], [0.97, 0.0, 0.24])];
        let refused = (0..10_000).find_map(|i| brdf.eval(pairs[i % 2].0, pairs[i % 2].1).err());
        assert!(is_limit::<()>(Err(refused.expect("refused"))), "{one}");
        assert!(start.elapsed().as_secs() < 30);
    }
}

/// All calls of one budget, each of which is within the limits.
#[test]
fn many_calls_draw_on_one_budget() {
    let file = Bomb { lens: [64; 3], block: [16; 3], channels: 3, ..Bomb::default() }.with_coefficients(true).file();
    let limits = Limits { operations: 1 << 20, ..Limits::default() };
    let reader = Reader::open_with_limits(&file[..], limits).unwrap();
    let mut values = vec![0.0; reader.block_values(0).unwrap()];
    for _ in 0..3 {
        (0..64).for_each(|block| reader.block_into(block, &mut values).unwrap());
    }
    let whole = reader.decode_all().unwrap();
    let reader = reader.with_one_budget();
    // What the file's bytes buy as well.
    let calls = (0..100_000).take_while(|i| reader.block_into(i % 64, &mut values).is_ok()).count();
    assert!((10..10_000).contains(&calls), "{calls}");
    assert!(is_limit(reader.block_into(0, &mut values)) && is_limit(reader.block_info(0)));
    // Whole tables go by their size.
    assert_eq!(reader.decode_all().unwrap(), whole);
}

/// As many threads as there is memory for, and the same values.
#[test]
fn threads_wait_for_memory() {
    let file = Bomb { lens: [64; 3], block: [32; 3], channels: 3, ..Bomb::default() }.with_coefficients(true).file();
    let whole = Reader::open(&file[..]).unwrap().decode_all().unwrap();
    let limits = |bytes| Limits { bytes, ..Limits::default() };
    let reader = Reader::open_with_limits(&file[..], limits(4 << 20)).unwrap();
    assert!((1..8).contains(&reader.most_scratches()));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
    pool.install(|| {
        assert_eq!(reader.decode_all().unwrap(), whole);
        assert!(reader.verify().is_empty());
        let tight = Reader::open_with_limits(&file[..], limits(1 << 16)).unwrap();
        assert!(is_limit(tight.decode_all()) && is_limit(tight.verify().pop().map_or(Ok(()), Err)));
    });
}

/// Writes all of the worst files into the folder that BOMBS names, for `tools/bombs.py`.
#[test]
#[ignore = "writes files"]
fn write_bombs() {
    let Ok(folder) = std::env::var("BOMBS") else { return };
    for name in WORST {
        std::fs::write(std::path::Path::new(&folder).join(format!("{name}.csbrdf")), worst(name)).unwrap();
    }
}

/// Peak memory of the process, kB.
fn peak() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}

/// What the worst files cost with the usual limits. Each in a process of its own, and written by one before:
/// `MAKE=1 BOMB=name cargo test --release --lib -- --ignored --nocapture bombs_cost`, then without MAKE.
#[test]
#[ignore = "takes gigabytes and minutes"]
fn bombs_cost() {
    let name = std::env::var("BOMB").unwrap_or_default();
    let path = std::env::temp_dir().join(format!("bomb-{name}.csbrdf"));
    if std::env::var("MAKE").is_ok() {
        std::fs::write(&path, worst(&name)).unwrap();
        return;
    }
    let Ok(bytes) = std::fs::read(&path) else { return };
    let (before, start) = (peak(), Instant::now());
    let reader = Reader::open(&bytes[..]).unwrap().with_pruned(PrunedPolicy::Coarse);
    let opened = start.elapsed();
    let open_peak = peak() - before;
    let text = reader.metadata().map(|m| m.other.len());
    let answered = start.elapsed() - opened;
    let meta_peak = peak() - before;
    let start = Instant::now();
    let mut all = reader.decode_all().unwrap();
    let decoded = start.elapsed();
    all.truncate(1);
    println!(
        "| {name} | {} | {:.0} ms, {} MB | {:.0} ms, {} MB ({text:?}) | {:.2} s, {} MB |",
        bytes.len(),
        opened.as_secs_f64() * 1e3,
        open_peak / 1000,
        answered.as_secs_f64() * 1e3,
        meta_peak / 1000,
        decoded.as_secs_f64(),
        (peak() - before) / 1000
    );
}
