//! Tables through the encoder and back through the reader.
#![cfg(feature = "encode")]

use csbrdf::codec::fourier::Basis;
use csbrdf::codec::sample::{Sampling, SplitMix64};
use csbrdf::decode::{Origin, Reader};
use csbrdf::encode::{ChannelCoding, Encoder, Preset};
use csbrdf::format::record::ValidityClass;
use csbrdf::table::Table;
use csbrdf::table::grid::{Axis, AxisName, Channel, Grid, Mapping};
use csbrdf::table::synth::Recipe;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI};

fn grid(lens: &[usize], channels: usize) -> Grid {
    use AxisName::*;
    let names: &[AxisName] = match lens.len() {
        1 => &[ThetaH],
        2 => &[ThetaH, ThetaD],
        3 => &[ThetaH, ThetaD, PhiD],
        _ => &[ThetaH, PhiH, ThetaD, PhiD],
    };
    let axes = names
        .iter()
        .zip(lens)
        .map(|(&name, &len)| Axis {
            name,
            len,
            mapping: if name == ThetaH { Mapping::Square } else { Mapping::Linear },
            start: 0.0,
            end: match name {
                PhiD => PI,
                PhiH => 2.0 * PI,
                _ => FRAC_PI_2,
            },
        })
        .collect();
    let channel = |i| Channel { name: format!("c{i}"), wavelength: None, scale: 1.0 };
    Grid::new(axes, (0..channels).map(channel).collect()).unwrap()
}

fn material(lens: [usize; 3], name: &str) -> Table {
    let axes = grid(&lens, 3).axes().to_vec();
    let rgb = Grid::new(axes, Grid::rgb_channels([1.0; 3])).unwrap();
    Recipe { noise: 0.01, holes: 0.02, ..Recipe::named(name).unwrap() }.synthesise(&rgb).unwrap()
}

/// Everything that must hold of any table and its file.
fn check(table: &Table, encoder: &Encoder, eps: f64) -> Reader<Vec<u8>> {
    let encoded = encoder.encode(table).unwrap();
    let reader = Reader::open(encoded.bytes).unwrap();
    assert!(reader.verify().is_empty());
    assert_eq!(reader.grid(), table.grid());
    let values = reader.decode_all().unwrap();
    assert!(values.iter().all(|v| v.is_finite() && *v >= 0.0));
    let decoded = reader.decode_table().unwrap();
    assert_eq!(decoded.valid(), table.valid());
    assert!(decoded.values().iter().all(|v| v.is_finite() && *v >= 0.0));

    let n = table.grid().positions();
    let shape = table.grid().shape();
    let (mut squares, mut largest) = (0.0, 0f64);
    for number in 0..reader.block_count() {
        let info = reader.block_info(number).unwrap();
        let size = info.block.positions();
        let mut alone = vec![0.0; reader.block_values(number).unwrap()];
        reader.block_into(number, &mut alone).unwrap();
        let origins = reader.block_origin(number).unwrap();
        let (mut block_squares, mut block_max, mut block_valid) = (0.0, 0f64, 0usize);
        for c in 0..table.grid().channels().len() {
            let plane = |values: &[f32]| {
                let mut block = vec![0.0; size];
                info.block.gather(shape, &values[c * n..(c + 1) * n], &mut block);
                block
            };
            assert_eq!(plane(&values), alone[c * size..(c + 1) * size], "block decode equals full decode");
            let (mut original, mut valid) = (vec![0.0; size], vec![false; size]);
            let mut back = vec![0.0; size];
            info.block.gather(shape, table.plane(c), &mut original);
            info.block.gather(shape, table.valid_plane(c), &mut valid);
            info.block.gather(shape, decoded.plane(c), &mut back);
            assert_eq!(info.valid[c], valid.iter().filter(|v| **v).count());
            let origins = &origins[c * size..(c + 1) * size];
            assert_eq!(info.sampled[c], origins.iter().filter(|o| **o == Origin::Sampled).count());
            for i in 0..size {
                assert_eq!(valid[i], matches!(origins[i], Origin::Sampled | Origin::Measured));
                if valid[i] {
                    let error = ((original[i] + eps).ln() - (back[i] + eps).ln()).abs();
                    block_squares += error * error;
                    block_max = block_max.max(error);
                    block_valid += 1;
                }
            }
        }
        // The stated errors are of the single-precision logarithm; exp and ln add their rounding.
        let slack = 1e-6 + 1e-5;
        let rms = (block_squares / block_valid.max(1) as f64).sqrt();
        assert!(rms <= f64::from(info.rms) + slack, "block {number}: {rms} {}", info.rms);
        assert!(block_max <= f64::from(info.max) + slack, "block {number}: {block_max} {}", info.max);
        squares += block_squares;
        largest = largest.max(block_max);
    }
    let rms = (squares / table.valid_count() as f64).sqrt();
    assert!((rms - encoded.report.log_rms).abs() < 1e-5 + 1e-4 * rms, "{rms} {}", encoded.report.log_rms);
    assert!((largest - encoded.report.log_max).abs() < 1e-4 + 1e-4 * largest);
    reader
}

#[test]
fn materials_come_back_within_the_step() {
    for name in Recipe::NAMES {
        let table = material([18, 20, 36], name);
        for step in [0.02f32, 0.1] {
            let report = Encoder::new().quality(step).encode(&table).unwrap().report;
            // Orthonormal basis and transform: the rms error of the values is that of the coefficients, at most
            // the dead zone's (1 - rounding) step and on these tables far below half of it.
            assert!(report.log_rms < 0.5 * f64::from(step), "{name} {step}: {}", report.log_rms);
            check(&table, &Encoder::new().quality(step), 1e-3);
        }
    }
}

#[test]
fn every_basis_shape_and_channel_mode_round_trips() {
    let table = material([18, 20, 36], "satin-paint");
    for basis in [Basis::Dct, Basis::Dft] {
        for shape in [vec![5, 5, 5], vec![7, 6, 11], vec![100, 100, 100], vec![4, 9]] {
            for channels in [ChannelCoding::Separate, ChannelCoding::Opponent] {
                let encoder = Encoder::new().basis(basis).block_shape(&shape).channels(channels).seed(3);
                check(&table, &encoder, 1e-3);
            }
        }
    }
}

#[test]
fn sampled_recovery_beats_the_mean_and_improves_with_the_ratio() {
    let table = material([30, 30, 60], "satin-paint");
    let mut last = f64::INFINITY;
    for ratio in [0.02, 0.1, 0.4] {
        let encoder = Encoder::new().preset(Preset::Paper).sampling(Sampling::from_ratio(ratio).unwrap());
        let reader = check(&table, &encoder, 1e-3);
        let sampled: usize =
            (0..reader.block_count()).map(|b| reader.block_info(b).unwrap().sampled.iter().sum::<usize>()).sum();
        let share = sampled as f64 / table.values().len() as f64;
        assert!((share / ratio - 1.0).abs() < 0.1, "{share} for {ratio}");
        let rms = encoder.encode(&table).unwrap().report.log_rms;
        assert!(rms < last, "{ratio}: {rms}, before {last}");
        last = rms;
    }
    assert!(last < 0.1);
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let table = material([18, 20, 36], "pearl");
    let on = |threads: usize, encoder: &Encoder| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| encoder.encode(&table).unwrap().bytes)
    };
    for encoder in [Encoder::new(), Encoder::new().preset(Preset::Paper).seed(5)] {
        let one = on(1, &encoder);
        assert!(one == on(2, &encoder) && one == on(5, &encoder));
        assert_eq!(one, on(1, &encoder.clone()));
    }
    assert!(
        on(1, &Encoder::new().preset(Preset::Paper).seed(5)) != on(1, &Encoder::new().preset(Preset::Paper).seed(6))
    );
}

#[test]
fn grids_of_one_to_four_axes_and_many_channels() {
    for (lens, channels) in
        [(&[7][..], 1), (&[9, 10], 2), (&[6, 7, 8], 5), (&[4, 5, 6, 7], 3), (&[1, 1, 1], 3), (&[3, 4], 40)]
    {
        let grid = grid(lens, channels);
        let n = grid.positions() * channels;
        let values = (0..n).map(|i| if i % 11 == 3 { -1.0 } else { (i as f64 * 0.01).sin().abs() }).collect();
        let table = Table::from_values(grid, values).unwrap();
        check(&table, &Encoder::new(), 1e-3);
    }
}

#[test]
fn extreme_tables_stay_finite() {
    let lens = [6, 7, 8];
    let n = 3 * 6 * 7 * 8;
    let all = |value: f64| vec![value; n];
    let with = |base: f64, at: &[(usize, f64)]| {
        let mut values = vec![base; n];
        at.iter().for_each(|&(i, v)| values[i] = v);
        values
    };
    let tables = [
        ("constant", all(0.25)),
        ("zero", all(0.0)),
        ("denormal", all(f64::MIN_POSITIVE / 8.0)),
        ("largest", all(f64::MAX)),
        ("1e-9 beside 1e5", (0..n).map(|i| if i % 2 == 0 { 1e-9 } else { 1e5 }).collect()),
        ("1e-300 beside 1e300", (0..n).map(|i| if i % 7 == 0 { 1e300 } else { 1e-300 }).collect()),
        ("one spike", with(1e-3, &[(100, 1e4)])),
        ("one valid entry", with(-1.0, &[(77, 0.5)])),
        ("two valid entries", with(f64::NAN, &[(77, 0.5), (n - 1, 3.0)])),
        ("infinities", with(0.1, &[(0, f64::INFINITY), (1, f64::NEG_INFINITY), (n - 1, f64::NAN)])),
        ("negative zero", all(-0.0)),
    ];
    for (name, values) in tables {
        let table = Table::from_values(grid(&lens, 3), values).unwrap();
        for encoder in [Encoder::new(), Encoder::new().preset(Preset::Paper), Encoder::new().basis(Basis::Dft)] {
            let reader = check(&table, &encoder.block_shape(&[4, 4, 5]), 1e-3);
            assert!(reader.block_count() == 8, "{name}");
        }
    }
}

#[test]
fn entries_are_told_apart_after_decoding() {
    let table = material([30, 30, 60], "rough-metal");
    let encoder = Encoder::new().preset(Preset::Paper).block_shape(&[5, 6, 10]).seed(1);
    let reader = check(&table, &encoder, 1e-3);
    let mut seen = std::collections::HashSet::new();
    let mut classes = std::collections::HashSet::new();
    for b in 0..reader.block_count() {
        seen.extend(reader.block_origin(b).unwrap());
        classes.insert(reader.block_info(b).unwrap().class.as_str());
    }
    assert_eq!(seen.len(), 4, "{seen:?}");
    assert!(classes.contains(ValidityClass::Mask.as_str()) && classes.contains(ValidityClass::None.as_str()));
}

#[test]
fn channels_may_have_masks_of_their_own() {
    let base = material([10, 12, 16], "matte");
    let mut values = base.values().to_vec();
    values[40] = -1.0;
    let n = base.grid().positions();
    values[2 * n..].fill(f64::NAN);
    let table = Table::from_values(base.grid().clone(), values).unwrap();
    let reader = check(&table, &Encoder::new().block_shape(&[5, 6, 8]), 1e-3);
    assert_eq!(reader.block_info(0).unwrap().class, ValidityClass::MaskPerChannel);
}

#[test]
fn blocks_beyond_the_limits_are_not_written() {
    let grid = grid(&[4, 128, 64], 600);
    let n = grid.positions() * 600;
    let table = Table::from_values(grid, vec![0.5; n]).unwrap();
    let refused = Encoder::new().block_shape(&[4, 128, 64]).encode(&table).unwrap_err();
    assert!(refused.to_string().contains("600 channels"), "{refused}");
    check(&table, &Encoder::new().block_shape(&[4, 8, 8]), 1e-3);
}

#[test]
fn settings_out_of_range_are_refused() {
    let table = material([6, 6, 6], "matte");
    let refused = |encoder: Encoder| assert!(encoder.encode(&table).is_err());
    refused(Encoder::new().quality(0.0));
    refused(Encoder::new().quality(f32::NAN));
    refused(Encoder::new().eps(-1.0));
    refused(Encoder::new().eps(f64::INFINITY));
    refused(Encoder::new().rounding(0.7));
    refused(Encoder::new().sigma(-1.0));
    refused(Encoder::new().sampling(Sampling::Bernoulli { threshold: 0 }));
    refused(Encoder::new().weighting(-1.0));
    refused(Encoder::new().weighting(f64::NAN));
    refused(Encoder::new().block_shape(&[]));
    refused(Encoder::new().block_shape(&[0, 5, 5]));
    refused(Encoder::new().block_shape(&[1, 1, 5, 5, 5]));
    let too_fine = Encoder::new().quality(1e-10).encode(&table).unwrap_err().to_string();
    assert!(too_fine.contains("too fine"), "{too_fine}");
    let empty = Table::from_values(grid(&[4, 4, 4], 3), vec![-1.0; 192]).unwrap();
    assert!(Encoder::new().encode(&empty).unwrap_err().to_string().contains("no valid entry"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn arbitrary_tables_round_trip(
        lens in prop::collection::vec(1usize..9, 1..5), channels in 1usize..5, seed in any::<u64>(),
        block in prop::collection::vec(1usize..9, 1..5), ratio in prop::option::of(0.05f64..1.0), dft in any::<bool>(),
        step in 0.001f32..1.0, exponent in 0i32..40,
    ) {
        let grid = grid(&lens, channels);
        let mut random = SplitMix64(seed);
        let mut values: Vec<f64> = (0..grid.positions() * channels)
            .map(|_| {
                let r = random.next_u64();
                let magnitude = 10f64.powi((r >> 8) as i32 % (exponent + 1) - exponent / 2);
                match r % 16 { 0 => -magnitude, 1 => f64::NAN, 2 => 0.0, _ => magnitude }
            })
            .collect();
        values[0] = 1.0;
        let table = Table::from_values(grid, values).unwrap();
        let sampling = ratio.map_or(Sampling::Every, |r| Sampling::from_ratio(r).unwrap());
        let basis = if dft { Basis::Dft } else { Basis::Dct };
        check(&table, &Encoder::new().basis(basis).sampling(sampling).block_shape(&block).quality(step).seed(seed), 1e-3);
    }
}

/// Any bits of any kind come back from a lossless file, by block and as a whole.
mod lossless {
    use csbrdf::decode::Reader;
    use csbrdf::encode::{Encoder, Preset};
    use csbrdf::table::Table;
    use csbrdf::table::grid::{Axis, Grid};
    use proptest::prelude::*;

    const LENS: [usize; 3] = [5, 4, 6];
    const N: usize = 3 * 5 * 4 * 6;

    fn bits() -> impl Strategy<Value = u64> {
        prop_oneof![
            4 => (1e-3f64..1e3).prop_map(f64::to_bits),
            2 => any::<u64>(),
            1 => prop::sample::select(vec![-0.0, 0.0, -1.0, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, 5e-324])
                .prop_map(f64::to_bits),
            1 => (1u64..1 << 52, any::<bool>()).prop_map(|(payload, sign)| payload | 0x7FF << 52 | u64::from(sign) << 63),
        ]
    }

    fn check(bits: &[u64], encoder: Encoder) {
        let grid = Grid::merl().with_lengths(&LENS).unwrap();
        let table = Table::from_values(grid, bits.iter().map(|&b| f64::from_bits(b)).collect()).unwrap();
        let reader = Reader::open(encoder.lossless(true).encode(&table).unwrap().bytes).unwrap();
        assert!(reader.is_lossless() && reader.verify().is_empty());
        assert_eq!(reader.metadata().unwrap().encoder.unwrap()["lossless"], true);
        let exact: Vec<u64> = reader.source_table().unwrap().iter().map(|x| x.to_bits()).collect();
        assert!(exact == bits);
        let n = N / 3;
        for number in 0..reader.block_count() {
            let (place, values) = (reader.partition().block(number).unwrap(), reader.source_block(number).unwrap());
            for (c, values) in values.chunks_exact(place.positions()).enumerate() {
                let mut expected = vec![0; values.len()];
                place.gather(reader.grid().shape(), &bits[c * n..(c + 1) * n], &mut expected);
                assert!(values.iter().map(|x| x.to_bits()).eq(expected));
            }
        }
        assert!(csbrdf::assess::proof::prove(&table, &reader).unwrap().broken.is_empty());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        #[test]
        fn any_bits_come_back(
            mut bits in prop::collection::vec(bits(), N),
            step in 0.01f32..3.0,
            paper in any::<bool>(),
        ) {
            bits[7] = 1f64.to_bits();
            let preset = if paper { Preset::Paper } else { Preset::Archive };
            check(&bits, Encoder::new().preset(preset).block_shape(&[3, 4, 4]).quality(step));
        }
    }

    /// Numbers that single or half precision held take the room of these.
    #[test]
    fn short_numbers_take_little_room() {
        let scales = csbrdf::table::grid::MERL_SCALE;
        let value = |i: usize| f64::from(2f32 + ((i * i) as f32 * 0.1).sin().round() / 8.0) / scales[i / (N / 3)];
        let bits: Vec<u64> = (0..N).map(|i| value(i).to_bits()).collect();
        check(&bits, Encoder::new());
        let grid = Grid::merl();
        let axes: Vec<Axis> = grid.axes().iter().zip(LENS).map(|(&axis, len)| Axis { len, ..axis }).collect();
        let grid = Grid::new(axes, grid.channels().to_vec()).unwrap();
        let table = Table::from_values(grid, bits.iter().map(|&b| f64::from_bits(b)).collect()).unwrap();
        // Both with the spare copy that lossless files always have.
        let encoder = Encoder::new().spare(true);
        let size = |lossless| encoder.clone().lossless(lossless).encode(&table).unwrap().bytes.len();
        let (with, without) = (size(true), size(false));
        assert!(with - without < 2 * N, "{with} {without}");
    }

    #[test]
    fn other_files_say_that_they_are_not() {
        let table = csbrdf::table::synth::Recipe::named("matte").unwrap();
        let table = table.synthesise(&Grid::merl().with_lengths(&LENS).unwrap()).unwrap();
        let reader = Reader::open(Encoder::new().encode(&table).unwrap().bytes).unwrap();
        assert!(!reader.is_lossless());
        assert!(reader.source_table().unwrap_err().to_string().contains("--lossless"));
        assert!(reader.source_block(0).is_err());
        let ratio = csbrdf::encode::contract::Contract::Ratio(2.0);
        assert!(Encoder::new().lossless(true).contract(ratio).encode(&table).is_err());
    }
}
