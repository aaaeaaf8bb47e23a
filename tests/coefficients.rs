//! Blocks synthesised from their plain description alone, as a decoder does that has only the documentation of `Spectrum`.

use std::f64::consts::{PI, SQRT_2, TAU};
use std::path::Path;

use csbrdf::block::{Basis, Spectrum};
use csbrdf::{Error, Limits, PrunedPolicy, Reader};

/// Blocks of more positions are left out: the sums here are of all by all.
const MOST: usize = 1 << 15;

fn unravel(mut index: usize, shape: [usize; 4]) -> [usize; 4] {
    let mut at = [0; 4];
    for axis in (0..4).rev() {
        at[axis] = index % shape[axis];
        index /= shape[axis];
    }
    at
}

/// The DCT's functions along one axis, by their formula.
fn cosine(k: usize, i: usize, n: usize) -> f64 {
    let weight = if k == 0 { 1.0 / n as f64 } else { 2.0 / n as f64 };
    weight.sqrt() * (PI * (k * (2 * i + 1)) as f64 / (2 * n) as f64).cos()
}

fn dct(position: usize, at: [usize; 4], shape: [usize; 4]) -> f64 {
    let k = unravel(position, shape);
    (0..4).map(|axis| cosine(k[axis], at[axis], shape[axis])).product()
}

/// Signed frequency 0, 1, -1, 2, -2, ... at an index, modulo the length.
fn frequency(j: usize, n: usize) -> usize {
    if j % 2 == 1 { j.div_ceil(2) } else { (n - j / 2) % n }
}

/// Section 4.4: of a pair of conjugates the lower index holds the real part, the higher the imaginary one.
fn dft(position: usize, at: [usize; 4], shape: [usize; 4]) -> f64 {
    let f: [usize; 4] = {
        let j = unravel(position, shape);
        std::array::from_fn(|axis| frequency(j[axis], shape[axis]))
    };
    let index = |f: [usize; 4]| {
        (0..4).fold(0, |index, axis| {
            let n = shape[axis];
            index * n + (0..n).find(|&j| frequency(j, n) == f[axis]).unwrap()
        })
    };
    let partner = index(std::array::from_fn(|axis| (shape[axis] - f[axis]) % shape[axis]));
    let angle: f64 = (0..4).map(|axis| TAU * (f[axis] * at[axis] % shape[axis]) as f64 / shape[axis] as f64).sum();
    let root = (shape.iter().product::<usize>() as f64).sqrt();
    match partner.cmp(&position) {
        std::cmp::Ordering::Equal => angle.cos() / root,
        std::cmp::Ordering::Greater => SQRT_2 * angle.cos() / root,
        std::cmp::Ordering::Less => SQRT_2 * angle.sin() / root,
    }
}

/// The five steps, at one position; values of all channels in 1/sr.
fn values_at(spectrum: &Spectrum, index: usize) -> Vec<f64> {
    let (n, channels) = (spectrum.block.positions(), spectrum.components.len());
    let shape = spectrum.block.shape;
    let at = unravel(index, shape);
    let function = match spectrum.basis {
        Basis::Dct => dct,
        Basis::Dft => dft,
        other => panic!("{other:?} has no sums here"),
    };
    let mut x: Vec<f64> = (0..channels)
        .map(|t| spectrum.components[t].iter().map(|&(p, s)| f64::from(s) * function(p as usize, at, shape)).sum())
        .collect();
    for (t, x) in x.iter_mut().enumerate() {
        *x += spectrum.profile.get(t * n + index).map_or(0.0, |p| f64::from(*p));
    }
    (0..channels)
        .map(|c| {
            let mut log = match &spectrum.matrix {
                Some(matrix) => (0..channels).map(|t| x[t] * f64::from(matrix[t * channels + c])).sum(),
                None => x[c],
            };
            let correction = spectrum.corrections.get(c * n + index).map_or(0, |m| *m);
            log += f64::from(correction) * f64::from(spectrum.correction_step);
            let zero = spectrum.zeros.get(c * n + index).is_some_and(|zero| *zero);
            if zero { 0.0 } else { (log.exp() - f64::from(spectrum.eps)).max(0.0).min(f64::from(f32::MAX)) }
        })
        .collect()
}

fn golden() -> Vec<std::path::PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/v1");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "csbrdf"));
    files.sort();
    files
}

#[test]
fn the_description_alone_gives_the_values() {
    let (mut blocks, mut seen) = (0, [false; 6]);
    for path in golden() {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let reader = Reader::open(std::fs::read(&path).unwrap()).unwrap().with_pruned(PrunedPolicy::Coarse);
        for block in 0..reader.block_count() {
            let spectrum = reader.coefficients(block).unwrap();
            let n = spectrum.block.positions();
            assert_eq!(spectrum.valid, reader.block_validity(block).unwrap(), "{name} {block}");
            assert!(
                spectrum.components.iter().all(|c| c[0].0 == 0 && c.is_sorted_by(|a, b| a.0 < b.0)),
                "{name} {block}"
            );
            let features = [
                spectrum.basis == Basis::Dft,
                !spectrum.profile.is_empty(),
                spectrum.matrix.is_some(),
                spectrum.corrections.iter().any(|m| *m != 0),
                spectrum.zeros.contains(&true),
                spectrum.valid.contains(&false),
            ];
            seen.iter_mut().zip(features).for_each(|(seen, has)| *seen |= has);
            let mut values = vec![0.0; reader.block_values(block).unwrap()];
            reader.block_into(block, &mut values).unwrap();
            if n > MOST {
                continue;
            }
            blocks += 1;
            for index in (0..n).step_by(1 + n / 64) {
                for (c, value) in values_at(&spectrum, index).into_iter().enumerate() {
                    let expected = f64::from(values[c * n + index]);
                    // The smallest numbers of single precision have no digits left.
                    let within = 1e-4 * (expected + f64::from(spectrum.eps)) + f64::from(f32::MIN_POSITIVE);
                    assert!((value - expected).abs() <= within, "{name} {block} {index} {c}: {value} {expected}");
                }
            }
        }
    }
    assert!(blocks > 100, "{blocks}");
    assert_eq!(seen, [true; 6]);
}

#[test]
fn checks_and_budget_are_those_of_a_block() {
    let path = golden().into_iter().find(|path| path.ends_with("final-profile.csbrdf")).unwrap();
    let bytes = std::fs::read(path).unwrap();
    let reader = Reader::open(&bytes[..]).unwrap();
    let past = reader.coefficients(reader.block_count());
    assert!(matches!(past, Err(Error::InvalidArgument(_))), "{past:?}");
    // A record with a bit turned.
    let mut hurt = bytes.clone();
    hurt[reader.record_range(0).unwrap().end - 5] ^= 4;
    let found = Reader::open(hurt).unwrap().coefficients(0);
    assert!(matches!(found, Err(Error::Corrupt { section: "RECS", .. })), "{found:?}");
    // One budget for all calls ends.
    let reader = Reader::open_with_limits(bytes, Limits::default()).unwrap().with_one_budget();
    let refused = (0..100_000_000u64).find_map(|_| reader.coefficients(0).err());
    assert!(matches!(refused, Some(Error::LimitExceeded { .. })), "{refused:?}");
}
