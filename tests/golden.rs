//! Golden files: one a feature of the format, read forever. Never written anew to make a test pass.
//!
//! `tests/data/v1/hashes.txt` holds, for each file, CRC-32s of the decoded binary32 values, of the binary64 values,
//! of the validity and, of lossless files, of the source values: what every machine, build and thread count must give.
//! `tests/data/v1/eval.txt` holds, for each file that can be evaluated at directions, CRC-32s of binary32 values there.
//! What was found is printed: `tools/cross.sh` compares these lines between machines.

use std::path::Path;

use csbrdf::BrdfOptions;
use csbrdf::codec::sample::SplitMix64;
use csbrdf::decode::{Origin, PrunedPolicy, Reader};
use csbrdf::table::coords::Lookup;

/// The lines of a list: file, then checksums in hexadecimal.
fn sums(list: &'static str) -> impl Iterator<Item = (String, Vec<u32>)> {
    list.lines().filter(|line| !line.starts_with('#') && !line.is_empty()).map(|line| {
        let mut fields = line.split_whitespace();
        let name = fields.next().expect("a name").to_string();
        (name, fields.map(|field| u32::from_str_radix(field, 16).expect("hexadecimal")).collect())
    })
}

/// File, three checksums, and of a lossless file that of its source values.
fn expected() -> Vec<(String, [u32; 3], Option<u32>)> {
    let split = |(name, sums): (String, Vec<u32>)| (name, [sums[0], sums[1], sums[2]], sums.get(3).copied());
    sums(include_str!("data/v1/hashes.txt")).map(split).collect()
}

fn crc(values: &[f32]) -> u32 {
    crc32fast::hash(&values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())
}

fn read(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/v1").join(name);
    std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

#[test]
fn golden_files_decode_to_their_bits() {
    let list = expected();
    assert!(list.len() >= 6);
    let mut wrong = Vec::new();
    for (name, sums, _) in list {
        let bytes = read(&name);
        let reader =
            Reader::open(&bytes[..]).unwrap_or_else(|e| panic!("{name}: {e}")).with_pruned(PrunedPolicy::Coarse);
        assert!(reader.verify().is_empty(), "{name}");
        let table = reader.decode_table().unwrap();
        let double: Vec<u8> = table.values().iter().flat_map(|v| v.to_le_bytes()).collect();
        let valid: Vec<u8> = table.valid().iter().map(|&v| u8::from(v)).collect();
        let got = [crc(&reader.decode_all().unwrap()), crc32fast::hash(&double), crc32fast::hash(&valid)];
        let line = format!("{name} {:08x} {:08x} {:08x}", got[0], got[1], got[2]);
        println!("{line}");
        if got != sums {
            wrong.push(line);
        }
    }
    assert!(wrong.is_empty(), "decoded bits have changed:\n{}", wrong.join("\n"));
}

#[test]
fn checksums_are_looked_at_whatever_the_build() {
    let (name, ..) = &expected()[0];
    let bytes = read(name);
    let reader = Reader::open(&bytes[..]).unwrap();
    for section in reader.directory().sections().iter().filter(|section| !section.range.is_empty()) {
        let mut bad = bytes.clone();
        bad[section.range.end - 1] ^= 1;
        let refused = Reader::open(&bad[..]).map_or(true, |reader| !reader.verify().is_empty());
        assert!(refused, "{name}: a flipped bit of {} goes unseen", section.name());
    }
}

/// Pairs of directions, made without the system's sines, whose bits are not those of every machine.
fn directions() -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let mut random = SplitMix64(2013);
    let mut uniform = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    // Length does not matter; one in nine is below the horizon.
    let mut direction = || [2.0 * uniform() - 1.0, 2.0 * uniform() - 1.0, 1.125 * uniform() - 0.125];
    let (mut wi, mut wo): (Vec<_>, Vec<_>) = (0..500).map(|_| (direction(), direction())).unzip();
    // The normal, grazing, retroreflection, opposite directions, lengths whose squares overflow or vanish.
    let edges = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [1e-200, 0.0, 1e-200], [3e300, -4e300, 1e299]];
    for a in edges {
        for b in edges {
            wi.push(a);
            wo.push(b);
        }
    }
    (wi, wo)
}

/// Values at directions, from coefficients and from rebuilt blocks, one by one and many at once.
#[test]
fn evaluations_are_as_they_were() {
    let (wi, wo) = directions();
    let mut got = Vec::new();
    for (name, ..) in expected() {
        let bytes = read(&name);
        let options = BrdfOptions::new().pruned(PrunedPolicy::Coarse);
        if options.from_bytes(bytes.clone()).is_err() {
            // Axes that are no angles of directions.
            continue;
        }
        let crcs = [Lookup::Linear, Lookup::Nearest].map(|lookup| {
            let brdf = options.lookup(lookup).from_bytes(bytes.clone()).unwrap();
            let channels = brdf.reader().grid().channels().len();
            let mut many = vec![0.0; wi.len() * channels];
            brdf.eval_many(&wi, &wo, &mut many).unwrap();
            assert!(many.iter().any(|v| *v > 0.0), "{name}");
            // Without room no coefficients are kept: nearly every value has its block rebuilt, so not of every pair.
            let brdf = options.lookup(lookup).cache_bytes(0).from_bytes(bytes.clone()).unwrap();
            let mut value = vec![0.0; channels];
            for (i, many) in many.chunks_exact(channels).enumerate().step_by(16) {
                brdf.eval_into(wi[i], wo[i], &mut value).unwrap();
                assert_eq!(crc(&value), crc(many), "{name}, {lookup:?}, pair {i}");
            }
            crc(&many)
        });
        println!("{name} {:08x} {:08x}", crcs[0], crcs[1]);
        got.push((name, crcs.to_vec()));
    }
    let expected: Vec<_> = sums(include_str!("data/v1/eval.txt")).collect();
    assert!(got.len() >= 6 && got == expected, "values at directions have changed");
}

#[test]
fn golden_files_cover_the_features() {
    use csbrdf::codec::channel::ChannelTransform;
    use csbrdf::codec::dependent::Quantization;
    use csbrdf::codec::fourier::Basis;
    use csbrdf::codec::sample::Sampling;
    use csbrdf::format::record::ValidityClass;
    let (mut features, mut classes, mut origins) = (Vec::new(), Vec::new(), Vec::new());
    for (name, ..) in expected() {
        let bytes = read(&name);
        let reader = Reader::open(&bytes[..]).unwrap();
        let coding = reader.coding();
        features.push(if coding.basis == Basis::Dct { "dct" } else { "dft" });
        features.push(if coding.transform == ChannelTransform::None { "separate" } else { "matrix" });
        features.push(if coding.sampling == Sampling::Every { "every" } else { "bernoulli" });
        features.push(if coding.horizon.is_some() { "horizon" } else { "no horizon" });
        features.push(if coding.correction.is_some() { "corrections" } else { "no corrections" });
        features.push(["", "1-D", "2-D", "3-D", "4-D"][reader.grid().axes().len()]);
        features.push(if reader.grid().channels().len() > 16 { "spectral" } else { "few channels" });
        features.push(if coding.quantization == Quantization::Dependent { "dependent" } else { "scalar" });
        features.push(if coding.zeros { "zeros" } else { "no zeros" });
        features.push(if reader.has_profile() { "profile" } else { "no profile" });
        features.push(if coding.correction.is_some() { "corrections" } else { "no corrections" });
        features.push(if reader.partition().shapes().len() > 1 { "tiled" } else { "uniform" });
        features.push(if reader.is_lossless() { "lossless" } else { "lossy" });
        features.push(match reader.version() {
            (1, 0, 0) => "version 1.0",
            (1, 1, 0) => "a later minor version",
            (1, 0, draft) => ["", "draft 1", "draft 2", "draft 3", "draft 4", "draft 5"][usize::from(draft)],
            _ => "another version",
        });
        for b in 0..reader.block_count() {
            classes.push(reader.block_info(b).unwrap().class);
            origins.extend(reader.block_origin(b).unwrap());
        }
    }
    let wanted = [
        "version 1.0",
        "a later minor version",
        "draft 1",
        "draft 2",
        "draft 3",
        "draft 4",
        "draft 5",
        "dct",
        "dft",
        "separate",
        "matrix",
        "every",
        "bernoulli",
        "horizon",
        "no horizon",
        "spectral",
        "tiled",
        "dependent",
        "scalar",
    ];
    for feature in wanted.iter().chain(&["1-D", "3-D", "4-D", "uniform", "corrections", "no corrections", "lossless"]) {
        assert!(features.contains(feature), "no golden file with {feature}");
    }
    for class in ValidityClass::ALL {
        assert!(classes.contains(&class), "no golden file with a block of class {}", class.as_str());
    }
    for origin in [Origin::Sampled, Origin::Measured, Origin::Filled, Origin::Impossible] {
        assert!(origins.contains(&origin), "no golden file with {origin:?} entries");
    }
}

/// Samples of a file whose records double the ratio; the counts are those of spec/decode.py.
#[test]
fn samples_of_doubled_ratios_are_as_they_were() {
    let bytes = read("dct-sampled-by-block.csbrdf");
    let reader = Reader::open(&bytes[..]).unwrap();
    let infos: Vec<_> = (0..reader.block_count()).map(|b| reader.block_info(b).unwrap()).collect();
    let sampled: Vec<usize> = infos.iter().map(|info| info.sampled[0]).collect();
    assert_eq!(sampled, [288, 288, 17, 265, 286, 265, 234, 278, 234, 60, 190, 60]);
    assert!(infos.iter().any(|info| info.ratio == 1.0) && infos.iter().any(|info| info.ratio < 0.1));
}

/// Bits of the source, marks of missing entries included, as a whole and by block. The sum is that of
/// spec/decode.py too.
#[test]
fn exact_values_are_as_they_were() {
    let bytes = read("dct-lossless.csbrdf");
    let reader = Reader::open(&bytes[..]).unwrap();
    assert!(reader.is_lossless());
    let exact = reader.source_table().unwrap();
    let sum = crc32fast::hash(&exact.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    let listed =
        expected().into_iter().find(|(name, ..)| name == "dct-lossless.csbrdf").and_then(|(_, _, exact)| exact);
    assert_eq!(Some(sum), listed, "{sum:08x}");
    // A NaN, its sign and payload.
    assert!(exact.iter().any(|v| v.to_bits() == 0xFFF0_0000_0000_0123));
    let (place, block) = (reader.partition().block(1).unwrap(), reader.source_block(1).unwrap());
    let mut expected = vec![0.0; place.positions()];
    place.gather(reader.grid().shape(), &exact[..reader.grid().positions()], &mut expected);
    assert!(block.iter().zip(&expected).all(|(a, b)| a.to_bits() == b.to_bits()));
}

/// Sections of unknown names that say they may be skipped do not keep a file from being read.
#[test]
fn a_section_of_a_later_version_is_skipped() {
    const PREAMBLE: usize = 32;
    const ENTRY: usize = 20;
    let old = read("final-tiled.csbrdf");
    let plain = Reader::open(&old[..]).unwrap().decode_all().unwrap();
    let sections = usize::from(u16::from_le_bytes([old[14], old[15]]));
    let extra = b"from the future";
    for (flags, read) in [(1u32, true), (0, false), (3, false)] {
        let table_end = PREAMBLE + sections * ENTRY;
        let mut new = old[..table_end].to_vec();
        new.extend_from_slice(b"XTRA");
        new.extend_from_slice(&flags.to_le_bytes());
        new.extend_from_slice(&(extra.len() as u64).to_le_bytes());
        new.extend_from_slice(&crc32fast::hash(extra).to_le_bytes());
        new.extend_from_slice(&old[table_end..old.len() - 8]);
        new.extend_from_slice(extra);
        new.extend_from_slice(&old[old.len() - 8..]);
        // A minor version that this build does not know.
        new[10..12].copy_from_slice(&7u16.to_le_bytes());
        new[14..16].copy_from_slice(&(sections as u16 + 1).to_le_bytes());
        let length = new.len() as u64;
        new[16..24].copy_from_slice(&length.to_le_bytes());
        let mut summed = new[..28].to_vec();
        summed.extend_from_slice(&new[PREAMBLE..table_end + ENTRY]);
        new[28..32].copy_from_slice(&crc32fast::hash(&summed).to_le_bytes());
        match Reader::open(&new[..]) {
            Ok(reader) => assert!(read && reader.decode_all().unwrap() == plain && reader.verify().is_empty()),
            Err(e) => assert!(!read, "{e}"),
        }
    }
}
