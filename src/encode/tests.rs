//! The presets and settings on small tables.

use super::*;
use crate::codec::sample::Sampling;
use crate::decode::Reader;
use crate::table::block::Partition;
use crate::table::grid::Grid;
use crate::table::synth::Recipe;

fn table() -> Table {
    Recipe::named("satin-paint").unwrap().synthesise(&Grid::merl().with_lengths(&[20, 20, 36]).unwrap()).unwrap()
}

/// A caller may give every tile a block shape of its own.
#[test]
fn tiles_may_have_shapes_of_their_own() {
    let table = table();
    let shapes = vec![[1, 5, 5, 18], [1, 10, 4, 7], [1, 10, 10, 36]];
    let partition = Partition::tiled(table.grid().shape(), [1, 10, 10, 36], shapes, vec![0, 1, 2, 1]).unwrap();
    let blocks = partition.block_count();
    let bytes = Encoder::new().partition(partition).encode(&table).unwrap().bytes;
    let reader = Reader::open(bytes).unwrap();
    assert_eq!(reader.block_count(), blocks);
    assert!(reader.verify().is_empty());
    let comparison = crate::assess::metrics::compare(&table, &reader.decode_table().unwrap()).unwrap();
    assert!(comparison.overall.log_rms < 0.03, "{comparison:?}");
    assert_eq!(comparison.only_in_reference + comparison.only_in_other, 0);
}

/// From the same samples, several times nearer than the paper's setting; and what the file says of its samples holds.
#[test]
fn sparse_recovers_more_from_the_same_samples() {
    let table = table();
    let ratio = Sampling::from_ratio(0.05).unwrap();
    let encode = |preset| Encoder::new().preset(preset).sampling(ratio).encode(&table).unwrap();
    let (paper, sparse) = (encode(Preset::Paper), encode(Preset::Sparse));
    assert!(sparse.report.log_rms < 0.25 * paper.report.log_rms, "{:?} {:?}", sparse.report, paper.report);
    assert_eq!(sparse.report.sampled, paper.report.sampled);
    let reader = Reader::open(sparse.bytes).unwrap();
    let sampled: usize = (0..reader.block_count()).flat_map(|b| reader.block_info(b).unwrap().sampled).sum();
    assert_eq!(sampled, sparse.report.sampled);
}

/// With every valid entry a sample, the trend fills the holes and leaves the rest alone.
#[test]
fn a_trend_fills_holes() {
    let full = table();
    let mut random = crate::codec::sample::SplitMix64(3);
    let n = full.grid().positions();
    let keep: Vec<bool> = (0..n).map(|_| random.next_u64().is_multiple_of(10)).collect();
    let valid = full.valid().iter().enumerate().map(|(i, v)| *v && keep[i % n]).collect();
    let sparse = Table::from_parts(full.grid().clone(), full.values().to_vec(), valid).unwrap();
    let encoded = Encoder::new().preset(Preset::Sparse).sampling(Sampling::Every).encode(&sparse).unwrap();
    assert!(encoded.report.log_rms < 0.02, "{:?}", encoded.report);
    let decoded = Reader::open(encoded.bytes).unwrap().decode_all().unwrap();
    let filled = full.valid().iter().enumerate().filter(|(i, v)| **v && !keep[i % n]);
    let (sum, count) = filled.fold((0.0, 0), |(sum, count), (i, _)| {
        let scale = full.grid().channels()[i / n].scale;
        let truth = crate::codec::tone::tone_map(full.values()[i] * scale, 1e-3);
        (sum + (truth - crate::codec::tone::tone_map(decoded[i].into(), 1e-3)).powi(2), count + 1)
    });
    let rms = (sum / f64::from(count)).sqrt();
    assert!(rms < 0.05, "{rms}");
}

/// A block whose ratio is doubled up to every entry is as good as one of a file that samples every entry.
#[test]
fn blocks_doubled_to_every_entry_hold_what_was_measured() {
    let grid = Grid::merl().with_lengths(&[6, 5, 7]).unwrap();
    let mut random = crate::codec::sample::SplitMix64(8);
    let values: Vec<f64> = (0..grid.positions() * 3).map(|_| 1e3 * (random.next_u64() >> 54) as f64).collect();
    let table = Table::from_values(grid, values).unwrap();
    let encoder = Encoder::new().block_shape(&[6, 5, 7]).quality(0.01).iterations(1);
    let all = encoder.encode(&table).unwrap().report;
    let encoded = encoder.clone().sampling_for(0.01).encode(&table).unwrap();
    assert_eq!(encoded.report.sampled, encoded.report.valid);
    assert!(encoded.report.log_rms < 1.01 * all.log_rms, "{:?} {all:?}", encoded.report);
    let settings = Reader::open(encoded.bytes).unwrap().metadata().unwrap().encoder.unwrap();
    assert_eq!(settings["trend"], true);
}

/// Few samples where a table is smooth, more where it is not, and in the end the error that was asked for.
#[test]
fn samples_go_where_they_are_needed() {
    let table = table();
    let encoder = Encoder::new().preset(Preset::Sparse).block_shape(&[5, 5, 9]);
    let encoded = encoder.sampling_for(0.03).encode(&table).unwrap();
    assert!(encoded.report.log_rms <= 0.03, "{:?}", encoded.report);
    let reader = Reader::open(encoded.bytes).unwrap();
    let infos: Vec<_> = (0..reader.block_count()).map(|b| reader.block_info(b).unwrap()).collect();
    let with = |small: bool| infos.iter().filter(|i| i.valid[0] > 0 && (i.ratio < 0.1) == small).count();
    assert!(with(true) > 0 && with(false) > 0, "{} {}", with(true), with(false));
}

#[test]
fn a_target_below_the_quantisers_error_is_refused() {
    let error = Encoder::new().sampling_for(0.005).encode(&table()).unwrap_err().to_string();
    assert!(error.contains("quality"), "{error}");
}

/// A profile is taken where it saves bytes; and exact zeros stay exact, with it or without.
#[test]
fn profiles_save_bytes_and_zeros_are_exact() {
    let grid = Grid::merl().with_lengths(&[30, 30, 60]).unwrap();
    let plain = Recipe::named("satin-paint").unwrap().synthesise(&grid).unwrap();
    let n = grid.positions();
    let mut values = plain.values().to_vec();
    for (p, at) in crate::table::block::positions(grid.shape()).enumerate() {
        let angle = |axis: usize| grid.axes()[axis].angle(at[1 + axis] as f64 + 0.5);
        let (h, d, phi) = (angle(0), angle(1), angle(2));
        // Of light and of sensor, as a measurement that loses its light below 8 degrees would.
        let elevation = |sign: f64| h.cos() * d.cos() + sign * h.sin() * d.sin() * phi.cos();
        let course = |sign: f64| 2.0 * (0.15 / elevation(sign).max(0.004)).ln().max(0.0);
        for c in 0..3 {
            if plain.valid()[c * n + p] {
                values[c * n + p] *= (-course(-1.0) - course(1.0)).exp();
                if c == 2 && at[1] > 12 && at[2] < 9 {
                    values[c * n + p] = 0.0;
                }
            }
        }
    }
    let table = Table::from_parts(grid, values, plain.valid().to_vec()).unwrap();
    let with = Encoder::new().block_shape(&[10, 10, 60]).encode(&table).unwrap();
    let without = Encoder::new().block_shape(&[10, 10, 60]).profile(false).encode(&table).unwrap();
    let (a, b) = (with.bytes.len() as f64, without.bytes.len() as f64);
    assert!(Reader::open(&with.bytes[..]).unwrap().has_profile(), "{a} {b}");
    assert!(a < 0.9 * b && with.report.log_rms < 1.1 * without.report.log_rms, "{a} {b} {:?}", with.report);
    for bytes in [with.bytes, without.bytes] {
        let reader = Reader::open(bytes).unwrap();
        let (single, double) = (reader.decode_all().unwrap(), reader.decode_table().unwrap());
        for (i, value) in table.values().iter().enumerate().filter(|(i, _)| table.valid()[*i]) {
            assert!(*value != 0.0 || (single[i] == 0.0 && double.values()[i] == 0.0), "{i}");
        }
    }
}

/// More effort, no more bytes at equal error than a little above.
#[test]
fn efforts_trade_seconds_for_bytes() {
    let table = table();
    let encode = |effort| Encoder::new().effort(effort).encode(&table).unwrap();
    let [fast, standard, thorough] = [Effort::Fast, Effort::Standard, Effort::Thorough].map(encode);
    // Bytes fall with the error at least in proportion.
    let cost = |encoded: &Encoded| encoded.bytes.len() as f64 * encoded.report.log_rms;
    assert!(cost(&standard) <= 1.02 * cost(&fast) && cost(&thorough) <= 1.02 * cost(&standard));
    for encoded in [&fast, &standard, &thorough] {
        assert!(encoded.report.log_rms < 0.03, "{:?}", encoded.report);
    }
}
