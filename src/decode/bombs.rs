//! Small files that claim much, written with valid checksums: what they cost is bounded by the caller's limits, and refused before
//! it is paid.

use std::time::Instant;

use super::{Pruned, Reader};
use crate::block::Partition;
use crate::channel::ChannelTransform;
use crate::decode::contexts;
use crate::dependent::Quantization;
use crate::entropy::Walk;
use crate::error::Error;
use crate::format::Limits;
use crate::format::directory::{self, write_file};
use crate::format::header::{Coding, write_coding, write_grid, write_partition};
use crate::format::index::{Entry, write_index};
use crate::format::probabilities::write_probabilities;
use crate::format::profile::{CodedProfile, write_profile};
use crate::format::record::{Record, ValidityClass};
use crate::fourier::Basis;
use crate::grid::{Axis, AxisName, Channel, Grid, Mapping};
use crate::range::Encoder;
use crate::salvage::salvage_with_limits;
use crate::sample::Sampling;

/// A file of one shape of blocks, all with the same coded bytes.
#[derive(Clone)]
struct Bomb {
    lens: [usize; 3],
    channels: usize,
    block: [usize; 3],
    class: ValidityClass,
    coded: Vec<u8>,
    profile: Option<CodedProfile>,
    metadata: Option<Vec<u8>>,
    exact: Option<Vec<u8>>,
    basis: Basis,
}

const QUANTIZATION: Quantization = Quantization::Scalar;

impl Default for Bomb {
    fn default() -> Bomb {
        let class = ValidityClass::None;
        let (lens, block) = ([8; 3], [8; 3]);
        let (coded, basis) = (vec![], Basis::Dct);
        Bomb { lens, channels: 1, block, class, coded, profile: None, metadata: None, exact: None, basis }
    }
}

fn even_odds() -> Vec<u16> {
    vec![1 << 15; contexts(QUANTIZATION)]
}

impl Bomb {
    fn grid(&self) -> Grid {
        let axis = |name, len| Axis { name, len, mapping: Mapping::Linear, start: 0.0, end: 1.5 };
        let names = [AxisName::ThetaH, AxisName::ThetaD, AxisName::PhiD];
        let axes = names.into_iter().zip(self.lens).map(|(name, len)| axis(name, len)).collect();
        let channel = |_| Channel { name: String::new(), wavelength: None, scale: 1.0 };
        Grid::new(axes, (0..self.channels).map(channel).collect()).unwrap()
    }

    fn partition(&self) -> Partition {
        let [a, b, c] = self.block;
        Partition::uniform(self.grid().shape(), [1, a, b, c]).unwrap()
    }

    fn file(&self) -> Vec<u8> {
        let (grid, partition) = (self.grid(), self.partition());
        let coding = Coding {
            basis: self.basis,
            quantization: QUANTIZATION,
            eps: 1e-3,
            sampling: Sampling::Every,
            seed: 0,
            transform: ChannelTransform::None,
            steps: vec![0.1; self.channels],
            shrink: [0; 2],
            horizon: None,
            zeros: false,
            correction: None,
        };
        let (mut records, mut entries) = (Vec::new(), Vec::new());
        for block in 0..partition.block_count() {
            let record = Record { class: self.class, doublings: 0, coded: &self.coded }.write(block as u32);
            entries.push(Entry { length: record.len() as u32, errors: [0; 2], means: vec![0; self.channels] });
            records.extend(record);
        }
        let mut sections = vec![
            (directory::GRID, false, write_grid(&grid)),
            (directory::CODING, false, write_coding(&coding)),
            (directory::PARTITION, false, write_partition(&partition, 3)),
            (directory::PROBABILITIES, false, write_probabilities(&vec![None; contexts(QUANTIZATION)])),
        ];
        sections.extend(self.profile.as_ref().map(|profile| (directory::PROFILE, false, write_profile(profile))));
        sections.push((directory::INDEX, false, write_index(&partition, &entries)));
        sections.extend(self.metadata.clone().map(|metadata| (directory::METADATA, true, metadata)));
        sections.push((directory::RECORDS, false, records));
        sections.extend(self.exact.clone().map(|exact| (directory::EXACT, true, exact)));
        write_file((1, 0, 4), &sections)
    }

    /// The same with coefficients in every block, as many as there are or the last one alone.
    fn with_coefficients(self, all: bool) -> Bomb {
        let n: usize = self.block.iter().product();
        let mut planes = vec![0i32; n * self.channels];
        for plane in planes.chunks_exact_mut(n) {
            plane[1..].fill(i32::from(all));
            plane[n - 1] = 1;
        }
        let [a, b, c] = self.block;
        let mut coder = Encoder::new(&even_odds());
        Walk::default().code(&mut coder, QUANTIZATION, [1, a, b, c], &planes).unwrap();
        Bomb { class: ValidityClass::All, coded: coder.finish(), ..self }
    }
}

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
    let mut cut = write_file((1, 0, 4), &[&sections[..5], &[(directory::RECORDS, false, vec![0; 1 << 22])]].concat());
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
        assert!(reader.is_lossless() && reader.exact_block(0).is_err() && reader.exact_table().is_err());
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

/// A megabyte of as many objects as may be, and of numbers.
fn wide() -> String {
    let objects = "{\"other\":[".to_string() + &"{\"\":0},".repeat((1 << 14) - 2);
    objects.clone() + &"0,".repeat(((1 << 20) - objects.len() - 3) / 2) + "0]}"
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
        std::fs::write(&path, worst(&name).file()).unwrap();
        return;
    }
    let Ok(bytes) = std::fs::read(&path) else { return };
    let (before, start) = (peak(), Instant::now());
    let reader = Reader::open(&bytes[..]).unwrap().with_pruned(Pruned::Coarse);
    let opened = start.elapsed();
    let open_peak = peak() - before;
    let text = reader.metadata().map(|m| m.other.len());
    let told = start.elapsed() - opened;
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
        told.as_secs_f64() * 1e3,
        meta_peak / 1000,
        decoded.as_secs_f64(),
        (peak() - before) / 1000
    );
}

/// A file by its name.
fn worst(name: &str) -> Bomb {
    let base = Bomb::default;
    match name {
        "empty" => Bomb { lens: [512, 256, 256], channels: 8, block: [64, 128, 64], ..base() },
        "corner" => Bomb { lens: [512, 1024, 512], block: [1, 1024, 512], ..base() }.with_coefficients(false),
        "corner-dft" => {
            Bomb { lens: [512, 1024, 512], block: [1, 1024, 512], basis: Basis::Dft, ..base() }.with_coefficients(false)
        }
        "full" => Bomb { lens: [64, 512, 1024], block: [1, 512, 1024], ..base() }.with_coefficients(true),
        "rows" => Bomb { lens: [16384, 16384, 1], block: [512, 1024, 1], ..base() },
        "blocks" => Bomb { lens: [256, 256, 64], block: [1, 1, 1], ..base() },
        "spectral" => Bomb { lens: [64, 64, 1], channels: 4096, block: [1, 1, 1], ..base() },
        "metadata" => {
            let mut metadata = (wide().len() as u32).to_le_bytes().to_vec();
            metadata.extend(zstd::bulk::compress(wide().as_bytes(), 3).unwrap());
            Bomb { metadata: Some(metadata), ..base() }
        }
        _ => panic!("no bomb {name}"),
    }
}
