use super::{Origin, PrunedPolicy, Reader, Scratch};
use crate::base::simd::Level;
use crate::format::record::{Record, ValidityClass};
use crate::table::block::positions;

/// The golden files.
fn golden() -> Vec<(String, Vec<u8>)> {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/v1");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "csbrdf"));
    assert!(files.len() > 20);
    // Those of the final version have all its features.
    files
        .retain(|path| !cfg!(miri) || path.file_stem().is_some_and(|name| name.to_string_lossy().starts_with("final")));
    files.sort();
    files.into_iter().map(|path| (path.display().to_string(), std::fs::read(path).unwrap())).collect()
}

/// Those that are decoded as a whole: under Miri the smallest, of one and of four axes.
fn whole() -> Vec<(String, Vec<u8>)> {
    if !cfg!(miri) {
        return golden();
    }
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/v1");
    let small = ["dct-1d-single-positions", "dft-1d", "dft-4d-coarse-extremes"];
    small.map(|name| (name.to_string(), std::fs::read(format!("{folder}/{name}.csbrdf")).unwrap())).to_vec()
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

/// The vector instructions of this machine and those of every machine give the same bits.
#[test]
fn every_level_gives_the_same_bits() {
    for (name, bytes) in whole() {
        let mut reader = Reader::open(bytes).unwrap().with_pruned(PrunedPolicy::Coarse);
        let best = bits(&reader.decode_all().unwrap());
        for level in Level::all() {
            reader.codec.level = level;
            assert!(bits(&reader.decode_all().unwrap()) == best, "{name}, {level:?}");
        }
    }
}

/// Single values, from the coefficients, are those of the whole block bit by bit.
#[test]
fn points_are_those_of_the_block() {
    let mut scratch = Scratch::default();
    let mut some = 0;
    for (name, bytes) in whole() {
        let reader = Reader::open(bytes).unwrap().with_pruned(PrunedPolicy::Coarse);
        let channels = reader.grid().channels().len();
        for block in 0..reader.block_count() {
            let mut whole = vec![0.0; reader.block_values(block).unwrap()];
            reader.block_into(block, &mut whole).unwrap();
            let Some(sparse) = reader.sparse_block(block, &mut scratch, &reader.call()).unwrap() else { continue };
            let place = reader.place(block).unwrap();
            for (index, within) in positions(place.shape).enumerate().step_by(7) {
                let mut value = vec![f32::NAN; channels];
                reader.point(&sparse, within, &mut value).unwrap();
                let expected: Vec<f32> = whole.iter().skip(index).step_by(place.positions()).copied().collect();
                assert!(bits(&value) == bits(&expected), "{name}, block {block}, {within:?}: {value:?} {expected:?}");
                some += 1;
            }
        }
    }
    assert!(some > if cfg!(miri) { 2 } else { 10_000 });
}

/// Values on their way into the table and into a block are the same bits; a wrong length is refused.
#[test]
fn the_table_is_its_blocks() {
    for (name, bytes) in whole() {
        let reader = Reader::open(bytes).unwrap().with_pruned(PrunedPolicy::Coarse);
        let (shape, n) = (reader.grid().shape(), reader.grid().positions());
        let mut expected = vec![0.0; n * reader.grid().channels().len()];
        for block in 0..reader.block_count() {
            let place = reader.place(block).unwrap();
            let mut values = vec![0.0; reader.block_values(block).unwrap()];
            reader.block_into(block, &mut values).unwrap();
            for (plane, values) in expected.chunks_exact_mut(n).zip(values.chunks_exact(place.positions())) {
                place.scatter(shape, values, plane);
            }
        }
        let mut table = vec![f32::NAN; expected.len()];
        reader.decode_all_into(&mut table).unwrap();
        assert!(bits(&table) == bits(&expected), "{name}");
        assert!(reader.decode_all_into(&mut table[1..]).is_err());
    }
}

/// Buffers hold what the block before left, of another shape or file: nothing of it comes through.
#[test]
fn what_a_scratch_holds_does_not_matter() {
    let mut stale = Scratch::default();
    let (mut decoded, mut refused) = (0, 0);
    for (name, bytes) in whole() {
        let reader = Reader::open(bytes).unwrap().with_pruned(PrunedPolicy::Coarse);
        for block in (0..reader.block_count()).rev() {
            let mut fresh = vec![0.0; reader.block_values(block).unwrap()];
            reader.block_into(block, &mut fresh).unwrap();
            // What a record of nonsense leaves behind, be it refused at once, halfway or not at all.
            let place = reader.place(block).unwrap();
            let garbage: Vec<u8> = (0..200).map(|i| (((block + 3) * (i + 7) * 89) >> 3) as u8).collect();
            let record = Record { class: ValidityClass::All, doublings: 0, coded: &garbage };
            match reader.codec.components(&place, &record, reader.index.means(block), &mut stale, &reader.call()) {
                Ok(_) => decoded += 1,
                Err(_) => refused += 1,
            }
            let mut values = vec![f32::NAN; fresh.len()];
            reader.block_with(block, &mut stale, &mut values).unwrap();
            assert!(bits(&values) == bits(&fresh), "{name}, block {block}");
        }
    }
    assert!(cfg!(miri) || decoded > 0 && refused > 0, "{decoded} decoded, {refused} refused");
}

/// What opening leaves for the first block, with a right checksum and nothing sensible in it: an error there that names it, once.
#[cfg(feature = "encode")]
#[test]
fn probabilities_out_of_range_are_an_error_of_the_first_block() {
    use crate::base::error::Error;
    use crate::base::version::VERSION;
    use crate::format::directory;

    let (_, bytes) = golden().into_iter().find(|(name, _)| name.ends_with("final-profile.csbrdf")).unwrap();
    let reader = Reader::open(&bytes[..]).unwrap();
    let names = ["GRID", "CODE", "PART", "PROB", "GRAZ", "INDX", "META", "RECS"];
    let mut sections: Vec<_> =
        names.iter().filter_map(|name| Some((*name, *name == "META", reader.section(name).unwrap()?))).collect();
    for (name, _, section) in &mut sections {
        if *name == directory::PROBABILITIES {
            // The count of contexts, then a chain of ones: a difference with too many bits.
            section.truncate(2);
            section.extend([0; 60]);
        }
    }
    let bytes = crate::format::file::write_file(VERSION, &sections);
    let reader = Reader::open(&bytes[..]).unwrap();
    let mut values = vec![0.0; reader.block_values(1).unwrap()];
    let named = |e: &Error| matches!(e, Error::Corrupt { section, .. } if *section == directory::PROBABILITIES);
    assert!(named(&reader.block_into(1, &mut values).unwrap_err()));
    assert!(named(&reader.decode_all().unwrap_err()));
    assert!(named(&reader.block_validity(1).unwrap_err()));
    let damage = reader.verify();
    assert!(damage.len() == 1 && named(&damage[0]), "{damage:?}");
}

/// What the reader says of a block agrees with what is decoded. Blocks of three axes that Miri gets through.
#[test]
fn the_smallest_block_of_each_file_is_as_it_is_told() {
    for (name, bytes) in golden() {
        let reader = Reader::open(&bytes[..]).unwrap().with_pruned(PrunedPolicy::Coarse);
        let block = (0..reader.block_count()).min_by_key(|block| reader.block_values(*block).unwrap()).unwrap();
        let mut values = vec![f32::NAN; reader.block_values(block).unwrap()];
        if cfg!(miri) && values.len() > 100 {
            continue;
        }
        reader.block_into(block, &mut values).unwrap();
        assert!(values.iter().all(|v| v.is_finite() && *v >= 0.0), "{name}");
        let info = reader.block_info(block).unwrap();
        let (validity, origins) = (reader.block_validity(block).unwrap(), reader.block_origin(block).unwrap());
        let count = |origin| origins.iter().filter(|o| **o == origin).count();
        assert_eq!(info.valid.iter().sum::<usize>(), validity.iter().filter(|v| **v).count(), "{name}");
        assert_eq!(info.sampled.iter().sum::<usize>(), count(Origin::Sampled), "{name}");
        assert_eq!(info.valid.iter().sum::<usize>(), count(Origin::Sampled) + count(Origin::Measured), "{name}");
        if reader.is_lossless() {
            assert_eq!(reader.source_block(block).unwrap().len(), values.len(), "{name}");
        }
    }
}
