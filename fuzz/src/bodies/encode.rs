//! Small tables of any shape and any bits, encoded with any settings, then decoded: what the encoder writes verifies, decodes
//! finite and not negative, has the table's validity, and keeps every bound that it states.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use arbitrary::{Result, Unstructured};
use csbrdf::assess::proof::prove;
use csbrdf::base::error::Error;
use csbrdf::codec::fourier::Basis;
use csbrdf::codec::sample::Sampling;
use csbrdf::decode::{PrunedPolicy, Reader};
use csbrdf::encode::contract::Contract;
use csbrdf::encode::{ChannelCoding, Effort, Encoder, Preset};
use csbrdf::table::Table;
use csbrdf::table::grid::{Axis, AxisName, Channel, Grid, Mapping};

use super::{is_value, same_bits};

/// Most values of a table.
const VALUES: usize = 600;

const SPECIAL: [f64; 16] = [
    0.0,
    -0.0,
    -1.0,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN_POSITIVE,
    5e-324,
    1e-310,
    1e300,
    1e38,
    1e-38,
    1e-3,
    1e9,
    f64::MIN,
];

pub fn run(data: &[u8]) {
    let mut u = Unstructured::new(data);
    let Ok(encoder) = encoder(&mut u) else { return };
    let Ok(Some(table)) = table(&mut u) else { return };
    let encoded = match encoder.0.encode(&table) {
        Ok(encoded) => encoded,
        Err(Error::InvalidArgument(_) | Error::ContractNotMet(_)) => return,
        Err(e) => panic!("{e}"),
    };
    let reader = Reader::open(&encoded.bytes[..]).expect("the encoder's files open").with_pruned(PrunedPolicy::Refuse);
    assert!(reader.verify().is_empty(), "{:?}", reader.verify());
    assert_eq!(reader.grid(), table.grid());
    let values = reader.decode_all().expect("it verifies");
    assert!(values.iter().all(is_value));
    let mut blocks = vec![f32::NAN; values.len()];
    let (shape, n) = (table.grid().shape(), table.grid().positions());
    for number in 0..reader.block_count() {
        let place = reader.partition().block(number).expect("a block");
        let mut block = vec![f32::NAN; reader.block_values(number).expect("a block")];
        reader.block_into(number, &mut block).expect("it verifies");
        for (plane, block) in blocks.chunks_exact_mut(n).zip(block.chunks_exact(place.positions())) {
            place.scatter(shape, block, plane);
        }
    }
    assert!(same_bits(&values, &blocks));
    let decoded = reader.decode_table().expect("it verifies");
    assert!(decoded.values().iter().all(|v| v.is_finite() && *v >= 0.0));
    assert_eq!(decoded.valid(), table.valid());
    assert_eq!(reader.is_lossless(), encoder.1);
    // Bounds of each block, figures of the metadata, contract, and of lossless files every bit.
    let proof = prove(&table, &reader).expect("the same grid");
    assert!(proof.broken.is_empty(), "{:?}", proof.broken);
}

/// Settings, and whether they ask for a lossless file.
fn encoder(u: &mut Unstructured) -> Result<(Encoder, bool)> {
    let preset = *u.choose(&[Preset::Archive, Preset::Paper, Preset::Sparse])?;
    let lossless = u.ratio(1, 4)?;
    // Solves of tables that no model fits go on as long as they may.
    let mut encoder = Encoder::new().preset(preset).seed(u.arbitrary::<u8>()?.into()).iterations(40).lossless(lossless);
    let set: [u8; 2] = u.arbitrary()?;
    let on = |bit: usize| set[bit / 8] >> (bit % 8) & 1 == 1;
    if on(0) {
        encoder = encoder.basis(*u.choose(&[Basis::Dct, Basis::Dft])?);
    }
    if on(1) {
        let lengths = (0..u.int_in_range(1..=4)?).map(|_| u.int_in_range(1..=9)).collect::<Result<Vec<usize>>>()?;
        encoder = encoder.block_shape(&lengths);
    }
    if on(2) {
        let sampling = Sampling::from_ratio(f64::from(u.int_in_range(1..=256u16)?) / 256.0);
        encoder = encoder.sampling(sampling.expect("a ratio"));
    } else if on(3) {
        encoder = encoder.sampling_for(magnitude(u, -2, 1)?);
    }
    if on(4) {
        encoder = encoder.quality(magnitude(u, -13, 7)? as f32);
    }
    if on(5) {
        encoder = encoder.eps(magnitude(u, -301, 31)?);
    }
    if on(6) {
        encoder = encoder.rounding(f64::from(u.int_in_range(0..=8u8)?) / 16.0);
    }
    if on(7) {
        encoder = encoder.sigma(magnitude(u, -9, 3)?);
    }
    if on(8) {
        encoder = encoder.weighting(f64::from(u.int_in_range(0..=16u8)?) / 4.0);
    }
    if on(9) {
        encoder = encoder.trend(u.arbitrary()?);
    }
    if on(10) {
        encoder = encoder.profile(u.arbitrary()?);
    }
    if on(11) {
        encoder = encoder.effort(*u.choose(&[Effort::Fast, Effort::Standard, Effort::Thorough])?);
    }
    if on(12) {
        encoder = encoder.channels(*u.choose(&[ChannelCoding::Separate, ChannelCoding::Opponent])?);
    }
    // Up to six encodes. Not of a render PSNR: each takes two pictures, a second.
    if on(13) && on(14) {
        encoder = encoder.contract(match u.int_in_range(0..=15u8)? {
            0..=6 => Contract::MaxError(magnitude(u, -7, 3)?),
            7..=9 => Contract::Rmse(magnitude(u, -7, 3)?),
            10..=12 => Contract::Size(u.int_in_range(1..=20_000u16)?.into()),
            _ => Contract::Ratio(magnitude(u, -2, 4)?),
        });
    }
    Ok((encoder, lossless))
}

/// A positive number between two powers of ten.
fn magnitude(u: &mut Unstructured, least: i32, most: i32) -> Result<f64> {
    let exponent = u.int_in_range(least..=most)?;
    Ok(10f64.powi(exponent) * (1.0 + f64::from(u.arbitrary::<u8>()?) / 32.0))
}

/// `None` if it would be too large.
fn table(u: &mut Unstructured) -> Result<Option<Table>> {
    use AxisName::*;
    let lens = (0..u.int_in_range(1..=4)?).map(|_| u.int_in_range(1..=18)).collect::<Result<Vec<usize>>>()?;
    let channels: usize = *u.choose(&[3, 1, 2, 4, 5])?;
    if lens.iter().product::<usize>() * channels > VALUES {
        return Ok(None);
    }
    let names = *u.choose(&[
        [ThetaH, ThetaD, PhiD, PhiH],
        [ThetaH, PhiH, ThetaD, PhiD],
        [ThetaI, PhiI, ThetaO, PhiO],
        [Other, Other, Other, Other],
        [PhiD, ThetaD, ThetaH, Other],
    ])?;
    let mut axes = Vec::new();
    for (&len, name) in lens.iter().zip(names) {
        let end = match name {
            Other => 1.0,
            PhiD => *u.choose(&[PI, TAU])?,
            name if name.is_periodic() => TAU,
            _ => FRAC_PI_2,
        };
        // Ranges other than an angle's own as well.
        let (start, end) = if u.ratio(1, 16)? { (-end, 3.0 * end) } else { (0.0, end) };
        axes.push(Axis { name, len, mapping: *u.choose(&[Mapping::Linear, Mapping::Square])?, start, end });
    }
    let scale = *u.choose(&[1.0, 1.0 / 1500.0, 1e300, 1e-300, 1e5])?;
    let channel = |i| Channel { name: format!("c{i}"), wavelength: None, scale };
    let grid = Grid::new(axes, (0..channels).map(channel).collect()).expect("within the limits");
    let values = (0..grid.positions() * channels).map(|_| value(u)).collect::<Result<_>>()?;
    Ok(Some(Table::from_values(grid, values).expect("as many as the grid has")))
}

fn value(u: &mut Unstructured) -> Result<f64> {
    Ok(match u.arbitrary::<u8>()? {
        near @ 0..=127 => 1.0 + f64::from(near) / 128.0,
        special @ 128..=143 => SPECIAL[usize::from(special) - 128],
        144..=159 => f64::from_bits(u.arbitrary()?),
        power => 10f64.powi(i32::from(power) - 208) * (1.0 + f64::from(u.arbitrary::<u8>()?) / 256.0),
    })
}
