//! Writes golden files into a folder: `cargo run --release --example golden -- tests/data/v1`.
//!
//! For new features only: files that exist are left alone, since golden files are read forever. Add the sums that `cargo test --test golden` then prints to `hashes.txt` and `eval.txt`.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::PathBuf;

use csbrdf::brdf::eval::Brdf;
use csbrdf::brdf::touched::Touched;
use csbrdf::codec::fourier::Basis;
use csbrdf::codec::sample::Sampling;
use csbrdf::decode::Reader;
use csbrdf::edit::prune::Pruner;
use csbrdf::encode::contract::Contract;
use csbrdf::encode::{Encoder, Preset};
use csbrdf::format::metadata::Metadata;
use csbrdf::table::BrdfTable;
use csbrdf::table::block::Partition;
use csbrdf::table::grid::{Axis, AxisName, Channel, Grid, MERL_SCALE, Mapping};
use csbrdf::table::synth::Recipe;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("usage: golden FOLDER")?);
    for (name, encoder, table) in features()? {
        let path = folder.join(name).with_extension("csbrdf");
        if path.exists() {
            println!("{} exists, left alone", path.display());
            continue;
        }
        std::fs::write(&path, encoder.encode(&table)?.bytes)?;
        println!("{} written", path.display());
    }
    type Change = fn(&[u8]) -> Result<Vec<u8>, Failure>;
    let changed: [(&str, &str, Change); 3] = [
        ("dct-dependent-profile", "pruned", pruned),
        ("final-profile", "final-pruned", pruned),
        ("final-profile", "later-minor-version", later),
    ];
    for (from, to, change) in changed {
        let path = folder.join(to).with_extension("csbrdf");
        if path.exists() {
            println!("{} exists, left alone", path.display());
            continue;
        }
        std::fs::write(&path, change(&std::fs::read(folder.join(from).with_extension("csbrdf"))?)?)?;
        println!("{} written", path.display());
    }
    Ok(())
}

/// The same file as of version 1.1, with a section at its end that nobody knows, but that may be skipped (spec section 3.1).
fn later(bytes: &[u8]) -> Result<Vec<u8>, Failure> {
    const NEWS: &[u8] = b"what version 1.1 brings";
    let sections = usize::from(u16::from_le_bytes([bytes[14], bytes[15]]));
    let table = 32 + 20 * sections;
    let entry =
        [&b"NEWS"[..], &1u32.to_le_bytes(), &(NEWS.len() as u64).to_le_bytes(), &crc32fast::hash(NEWS).to_le_bytes()];
    let entry = entry.concat();
    let mut head = bytes[..28].to_vec();
    head[10..12].copy_from_slice(&1u16.to_le_bytes());
    head[14..16].copy_from_slice(&(sections as u16 + 1).to_le_bytes());
    let length = bytes.len() + entry.len() + NEWS.len();
    head[16..24].copy_from_slice(&(length as u64).to_le_bytes());
    let crc = crc32fast::hash(&[&head[..], &bytes[32..table], &entry].concat());
    let (body, end) = bytes[table..].split_at(bytes.len() - table - 8);
    Ok([&head[..], &crc.to_le_bytes(), &bytes[32..table], &entry, body, NEWS, end].concat())
}

/// Two of three blocks of a file, a little coarser.
fn pruned(bytes: &[u8]) -> Result<Vec<u8>, Failure> {
    let reader = Reader::open(bytes)?;
    let blocks: String = (0..reader.block_count()).filter(|b| b % 3 != 1).map(|b| format!("{b}\n")).collect();
    let index = Brdf::open(Reader::open(bytes)?)?.touched().index_crc();
    let trace = format!("csbrdf trace 1\nblocks {} index {index:x}\n{blocks}", reader.block_count());
    Ok(Pruner::new().blocks(&Touched::from_text(&trace)?).detail(0.01).prune(&reader)?.bytes)
}

/// MERL's axes with fewer bins.
fn small(lens: [usize; 3]) -> Result<Grid, Failure> {
    let merl = Grid::merl();
    let axes: Vec<Axis> = merl.axes().iter().zip(lens).map(|(&axis, len)| Axis { len, ..axis }).collect();
    Ok(Grid::new(axes, merl.channels().to_vec())?)
}

fn linear(name: AxisName, len: usize, end: f64) -> Axis {
    Axis { name, len, mapping: Mapping::Linear, start: 0.0, end }
}

/// A table that grows towards grazing directions, as measured ones do: the root of both cosines divides it.
fn grazing(grid: Grid) -> Result<BrdfTable, Failure> {
    let recipe = Recipe::named("satin-paint").ok_or("no such recipe")?;
    let table = Recipe { noise: 0.001, seed: 12, ..recipe }.synthesise(&grid)?;
    let mut values = table.values().to_vec();
    let [_, _, nd, np] = grid.shape();
    let angle = |axis: usize, i: usize| grid.axes()[axis].angle(i as f64 + 0.5);
    for (i, value) in values.iter_mut().enumerate() {
        let i = i % grid.positions();
        let [h, d, p] = [angle(0, i / (nd * np)), angle(1, i / np % nd), angle(2, i % np)];
        let (middle, swing) = (h.cos() * d.cos(), h.sin() * d.sin() * p.cos());
        let cosines = (middle - swing).max(0.02) * (middle + swing).max(0.02);
        *value *= if *value > 0.0 { cosines.powf(-0.5) } else { 1.0 };
    }
    Ok(BrdfTable::from_parts(grid, values, table.valid().to_vec())?)
}

fn features() -> Result<Vec<(&'static str, Encoder, BrdfTable)>, Failure> {
    let recipe = |name: &str| Recipe::named(name).ok_or("no such recipe");
    let metadata = Metadata {
        name: Some("satin paint, synthetic".into()),
        licence: Some("CC0-1.0".into()),
        ..Metadata::default()
    };
    let masked =
        Recipe { noise: 0.01, holes: 0.02, seed: 4, ..recipe("satin-paint")? }.synthesise(&small([18, 20, 36])?)?;
    let sampled = Recipe { noise: 0.003, ..recipe("rough-metal")? }.synthesise(&small([18, 18, 30])?)?;
    let tiled = recipe("satin-paint")?.synthesise(&small([20, 20, 36])?)?;
    let shapes = vec![[1, 5, 5, 18], [1, 10, 4, 7], [1, 10, 10, 36]];
    let tiles = Partition::tiled(tiled.grid().shape(), [1, 10, 10, 36], shapes, vec![0, 1, 2, 1])?;

    let matte = recipe("matte")?.synthesise(&small([8, 9, 10])?)?;
    let mut values = matte.values().to_vec();
    let last = values.len() - 500;
    values[3] = -1.0;
    values[last..].fill(-1.0);
    (values[100], values[101]) = (1e300, 1e-300);
    let extremes = BrdfTable::from_values(matte.grid().clone(), values)?;

    let axes = vec![
        linear(AxisName::ThetaI, 4, FRAC_PI_2),
        linear(AxisName::PhiI, 6, 2.0 * PI),
        linear(AxisName::ThetaO, 5, FRAC_PI_2),
        linear(AxisName::PhiO, 7, 2.0 * PI),
    ];
    let band = |i: usize| Channel { name: String::new(), wavelength: Some(400.0 + 15.0 * i as f64), scale: 1.0 };
    let grid = Grid::new(axes, (0..20).map(band).collect())?;
    let n = grid.positions();
    let value = |i: usize| {
        let p = i % n;
        if p % 17 == 5 { -1.0 } else { 0.1 + 0.05 * (p as f64 * 0.05).sin() + 0.002 * (i / n) as f64 }
    };
    let spectral = BrdfTable::from_values(grid, (0..n * 20).map(value).collect())?;

    let luminance = Channel { name: "luminance".into(), wavelength: None, scale: 2.0 };
    let line = Grid::new(vec![linear(AxisName::Other, 37, 1.0)], vec![luminance])?;
    let line = BrdfTable::from_values(line, (0..37).map(|i| 1.0 / (1.0 + f64::from(i))).collect())?;

    // A step so coarse that logs end below ln(eps), and beyond what exp can hold in either precision.
    let axes = vec![
        linear(AxisName::PhiH, 3, 2.0 * PI),
        linear(AxisName::ThetaH, 2, FRAC_PI_2),
        linear(AxisName::ThetaD, 5, FRAC_PI_2),
        linear(AxisName::PhiD, 4, PI),
    ];
    let grid = Grid::new(axes, vec![Channel { name: "Y".into(), wavelength: None, scale: 1e-3 }])?;
    let value = |i: usize| [1e300, 0.0, f64::MAX, 1e-300, 1.0, -1.0][i * i % 6];
    let coarse = BrdfTable::from_values(grid, (0..120).map(value).collect())?;

    let short = Grid::new(vec![linear(AxisName::ThetaH, 5, FRAC_PI_2)], Grid::rgb_channels([1.0; 3]))?;
    let short = BrdfTable::from_values(short, (0..15).map(|i| 0.1 + f64::from(i * i % 7)).collect())?;
    let fine = recipe("mirror-like")?.synthesise(&small([6, 6, 8])?)?;

    // Few steps to the coefficients, many corrections: holes that differ by channel, four channels, spikes.
    let axes = small([8, 9, 12])?.axes().to_vec();
    let channel = |i: usize| Channel { name: format!("c{i}"), wavelength: None, scale: [1.0, 0.5, 2.0, 1.0][i] };
    let grid = Grid::new(axes, (0..4).map(channel).collect())?;
    let n = grid.positions();
    let value = |i: usize| match i % n * 7 % 61 {
        _ if i % 97 == 11 => -1.0,
        3 => 1e5,
        5 => 1e-9 * (i / n) as f64,
        p => 0.2 + 0.1 * (p as f64 * 0.3).sin() + 0.01 * (i / n) as f64,
    };
    let spiky = BrdfTable::from_values(grid, (0..4 * n).map(value).collect())?;
    let glossy = Recipe { noise: 0.02, ..recipe("rough-metal")? }.synthesise(&small([18, 18, 30])?)?;
    let corrected = |shape: &[usize], e| Encoder::new().block_shape(shape).contract(Contract::MaxError(e));

    let ratio = Sampling::from_ratio(0.2).ok_or("a ratio")?;
    let by_block = recipe("satin-paint")?.synthesise(&small([12, 12, 24])?)?;
    let by_block_encoder = Encoder::new().preset(Preset::Sparse).block_shape(&[6, 6, 8]).sampling_for(0.03).seed(9);
    let paper = Encoder::new().preset(Preset::Paper).block_shape(&[6, 6, 10]).sampling(ratio).seed(42);
    let coarse_encoder = Encoder::new().basis(Basis::Dft).block_shape(&[2, 2, 5, 3]).quality(60.0).eps(1e-300);
    // A channel that is zero over a region, another at single entries, and a steep course near the horizon.
    let steep = Recipe { noise: 0.003, ..recipe("rough-metal")? }.synthesise(&small([30, 30, 60])?)?;
    let n = steep.grid().positions();
    let mut values = steep.values().to_vec();
    for (i, value) in values.iter_mut().enumerate().filter(|(_, value)| **value > 0.0) {
        let (h, d, p) = (i % n / 1800, i / 60 % 30, i % 60);
        let region = i / n == 2 && h.abs_diff(12) + d.abs_diff(8) + p.abs_diff(20) / 3 < 9;
        if region || (i / n == 0 && i % 997 == 0) {
            *value = 0.0;
        }
    }
    let zeros = BrdfTable::from_values(steep.grid().clone(), values)?;
    // Many digits, few digits in 1/sr, and marks of missing entries of many kinds.
    let mut values = recipe("satin-paint")?.synthesise(&small([8, 9, 10])?)?.values().to_vec();
    let n = values.len() / 3;
    for (i, value) in values.iter_mut().enumerate().filter(|(i, v)| **v >= 0.0 && i / n == 1) {
        *value = f64::from((*value * MERL_SCALE[i / n]) as f32) / MERL_SCALE[i / n];
    }
    let marks = [-1.0, f64::NAN, f64::INFINITY, -0.0, f64::NEG_INFINITY, f64::from_bits(0xFFF0_0000_0000_0123), 0.0];
    // In the first block only: the second has holes of one kind.
    let marked = values.iter_mut().enumerate().filter(|(i, _)| i % n < n / 2).step_by(41);
    marked.zip(marks.into_iter().cycle()).for_each(|((_, value), mark)| *value = mark);
    let exact = BrdfTable::from_values(small([8, 9, 10])?, values)?;
    // Indices of all sizes, many of them, beside rows of few; a DFT; corrections on top; and drawn samples, whose integers do
    // not depend on each other.
    let rough =
        Recipe { noise: 0.1, holes: 0.05, seed: 8, ..recipe("rough-metal")? }.synthesise(&small([12, 14, 24])?)?;
    let even = recipe("satin-paint")?.synthesise(&small([9, 10, 21])?)?;
    let drawn = Recipe { noise: 0.003, seed: 3, ..recipe("satin-paint")? }.synthesise(&small([12, 12, 18])?)?;
    let drawn_encoder = Encoder::new().preset(Preset::Paper).block_shape(&[6, 12, 9]).sampling(ratio).seed(5);
    Ok(vec![
        ("dct-spare", Encoder::new().block_shape(&[6, 9, 12]).spare(true), drawn.clone()),
        ("final-profile", Encoder::new(), grazing(small([30, 30, 36])?)?),
        ("final-corrected", corrected(&[12, 7, 12], 0.1), rough.clone()),
        ("final-lossless", Encoder::new().block_shape(&[8, 3, 10]).lossless(true), exact.clone()),
        ("final-4d-spectral", Encoder::new().block_shape(&[4, 3, 5, 7]).quality(0.01), spectral.clone()),
        ("final-dft-sampled", drawn_encoder.clone(), drawn.clone()),
        ("final-sampled-by-block", by_block_encoder.clone(), by_block.clone()),
        ("final-tiled", Encoder::new().partition(tiles.clone()), tiled.clone()),
        ("dct-dependent-profile", Encoder::new(), grazing(small([30, 30, 36])?)?),
        ("dct-dependent", Encoder::new().quality(0.02).block_shape(&[6, 7, 24]), rough.clone()),
        ("dft-dependent", Encoder::new().basis(Basis::Dft).quality(0.05), even),
        ("dct-dependent-corrected", corrected(&[12, 7, 12], 0.1), rough),
        ("dft-sampled-draft-4", drawn_encoder, drawn),
        ("dct-dependent-lossless", Encoder::new().block_shape(&[8, 3, 10]).lossless(true), exact.clone()),
        ("dct-dependent-grazing-zeros", Encoder::new().quality(0.05), zeros.clone()),
        ("dct-dependent-4d-spectral", Encoder::new().block_shape(&[4, 3, 5, 7]).quality(0.01), spectral.clone()),
        ("dct-lossless", Encoder::new().block_shape(&[4, 9, 10]).lossless(true), exact),
        ("dct-grazing-zeros", Encoder::new(), zeros),
        ("dct-opponent-mask", Encoder::new().block_shape(&[6, 5, 12]).metadata(metadata), masked),
        ("dft-sampled-horizon", paper, sampled),
        ("dct-tiled", Encoder::new().partition(tiles), tiled),
        ("dct-mask-per-channel-extremes", Encoder::new().block_shape(&[4, 9, 5]), extremes),
        ("dct-4d-spectral", Encoder::new().block_shape(&[3, 6, 3, 7]), spectral),
        ("dft-4d-coarse-extremes", coarse_encoder, coarse),
        ("dct-1d-single-positions", Encoder::new().block_shape(&[2]), short),
        ("dct-fine-step", Encoder::new().block_shape(&[6, 6, 8]).quality(1e-4), fine),
        ("dct-sampled-by-block", by_block_encoder, by_block),
        ("dct-corrected-channels", corrected(&[4, 5, 12], 0.01), spiky),
        ("dct-corrected-opponent", corrected(&[6, 6, 10], 0.05), glossy),
        ("dft-1d", Encoder::new().basis(Basis::Dft).block_shape(&[16]).quality(0.01), line),
    ])
}
