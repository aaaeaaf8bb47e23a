//! The header sections: GRID, CODE and PART (spec sections 3.2 to 3.4).

use crate::base::bits::ByteReader;
use crate::base::error::{Error, Result};
use crate::codec::channel::{ChannelTransform, MAX_MATRIX_CHANNELS};
use crate::codec::dependent::Quantization;
use crate::codec::fourier::Basis;
use crate::codec::sample::Sampling;
use crate::base::limits::{EPS_RANGE, MAX_CHANNELS, STEP_RANGE, check_block};
use crate::format::{is_compact, is_dependent};
use crate::table::block::Partition;
use crate::table::grid::{Axis, AxisName, Channel, Grid, Mapping};

/// How a file's values were coded: everything that its blocks share.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Coding {
    /// Basis of the coefficients.
    pub basis: Basis,
    /// Which multiples of the step coefficients may be.
    pub quantization: Quantization,
    /// Constant of the tone map ln(f + eps), 1/sr.
    pub eps: f64,
    /// Sampling of the valid entries.
    pub sampling: Sampling,
    /// Seed from which every block's seed is derived.
    pub seed: u64,
    /// Transform over the channels.
    pub transform: ChannelTransform,
    /// Quantiser step of each component.
    pub steps: Vec<f32>,
    /// Reconstruction shrink of magnitudes 1, and 2 and above, in 1/256 of a step.
    pub shrink: [i8; 2],
    /// Elevation (cosine) from which bins are predicted valid; `None`: all are.
    pub horizon: Option<f64>,
    /// Whether records store which measured entries are exactly zero.
    pub zeros: bool,
    /// Multiples of this are added to the log values of single entries; `None`: there are no corrections.
    pub correction: Option<f32>,
}

/// Tone maps: 1 is ln(f + eps).
const TONE_LN: u8 = 1;
/// Entropy coders: 1 is the adaptive binary range coder of spec sections 4.6 and 4.7.
const ENTROPY_RANGE: u8 = 1;
/// The same with dependent quantisation.
const ENTROPY_DEPENDENT: u8 = 2;

/// A finite positive number.
fn positive(reader: &ByteReader, name: &str, value: f64) -> Result<f64> {
    if value.is_finite() && value > 0.0 {
        return Ok(value);
    }
    Err(reader.corrupt(format!("{name} is {value}, must be positive and finite")))
}

/// One of the codes of a reserved-beyond enumeration.
fn one_of<T: Copy>(reader: &ByteReader, name: &str, all: &[T], code: u8) -> Result<T> {
    all.get(usize::from(code)).copied().ok_or_else(|| reader.corrupt(format!("{name} {code} is reserved")))
}

fn zero(reader: &ByteReader, value: u32) -> Result<()> {
    if value == 0 { Ok(()) } else { Err(reader.corrupt(format!("reserved field holds {value}, not 0"))) }
}

/// An argument error of a constructor, which has seen the whole section: its start is the place.
fn here<'a>(reader: &'a ByteReader) -> impl Fn(Error) -> Error + 'a {
    |e| reader.corrupt_section(e.to_string())
}

pub(crate) fn read_grid(mut r: ByteReader) -> Result<Grid> {
    // Number of axes, 1 to 4.
    let axes = r.u8()?;
    let mut list = Vec::new();
    for _ in 0..axes.min(5) {
        // Each axis: name, mapping, two reserved bytes, length, angles of its two ends.
        let name = r.u8()?;
        let name = one_of(&r, "axis name", &AxisName::ALL, name)?;
        let mapping = r.u8()?;
        let mapping = one_of(&r, "axis mapping", &[Mapping::Linear, Mapping::Square], mapping)?;
        let reserved = r.u16()?;
        zero(&r, reserved.into())?;
        let len = r.u32()? as usize;
        list.push(Axis { name, len, mapping, start: r.f64()?, end: r.f64()? });
    }
    // Number of channels, 1 to 4096.
    let count = usize::from(r.u16()?);
    if count > MAX_CHANNELS {
        return Err(r.corrupt(format!("{count} channels, at most {MAX_CHANNELS} are allowed")));
    }
    let mut channels = Vec::new();
    for _ in 0..count {
        // Each channel: scale of the source's units, wavelength in nm (0 for none), length of the name, name.
        let scale = r.f64()?;
        let scale = positive(&r, "channel scale", scale)?;
        let wavelength = r.f64()?;
        let length = usize::from(r.u8()?);
        let bytes = r.bytes(length)?;
        let name = std::str::from_utf8(bytes).map_err(|_| r.corrupt("channel name is not UTF-8"))?;
        let wavelength = (wavelength.to_bits() != 0).then_some(wavelength);
        channels.push(Channel { name: name.to_string(), wavelength, scale });
    }
    let grid = Grid::new(list, channels).map_err(here(&r))?;
    r.finish()?;
    Ok(grid)
}

/// The draft decides what there may be.
pub(crate) fn read_coding(mut r: ByteReader, channels: usize, draft: u16) -> Result<Coding> {
    let compact = is_compact(draft);
    // Basis: 0 DCT-II, 1 DFT.
    let basis = r.u8()?;
    let basis = one_of(&r, "basis", &[Basis::Dct, Basis::Dft], basis)?;
    // Tone map: 1.
    let tone = r.u8()?;
    if tone != TONE_LN {
        return Err(r.corrupt(format!("tone map {tone} is reserved")));
    }
    // Entropy coder: 1, or 2 with dependent quantisation, from draft 4 on.
    let quantization = match r.u8()? {
        ENTROPY_RANGE => Quantization::Scalar,
        ENTROPY_DEPENDENT if is_dependent(draft) => Quantization::Dependent,
        other => return Err(r.corrupt(format!("entropy coder {other} is reserved"))),
    };
    // Channel transform: 0 none, 1 matrix.
    let transform = r.u8()?;
    // Shrink of magnitude 1, and of 2 and above, in 1/256 of a step, signed.
    let shrink = [r.u8()? as i8, r.u8()? as i8];
    // Horizon: 0 none, 1 threshold follows at its place.
    let has_horizon = r.u8()?;
    // Exact zeros: 0 none, 1 stored by the records; reserved before draft 3.
    let zeros = match r.u8()? {
        0 => false,
        1 if compact => true,
        other => return Err(r.corrupt(format!("the code {other} for exact zeros is reserved"))),
    };
    // Constant of the tone map.
    let eps = r.f64()?;
    if !EPS_RANGE.contains(&eps) {
        return Err(r.corrupt(format!("eps is {eps}, must be within {EPS_RANGE:?}")));
    }
    // Elevation of the horizon, a cosine; 0 where there is none.
    let threshold = r.f64()?;
    let horizon = match has_horizon {
        0 if threshold.to_bits() == 0 => None,
        1 if (-1.0..=1.0).contains(&threshold) => Some(threshold),
        _ => return Err(r.corrupt(format!("horizon flag {has_horizon} with elevation {threshold}"))),
    };
    // Seed of the file.
    let seed = r.u64()?;
    // Sampling ratio times 2^32; 0 stands for every valid entry.
    let sampling = match r.u32()? {
        0 => Sampling::Every,
        threshold => Sampling::Bernoulli { threshold },
    };
    // Quantiser step of each component.
    let mut steps = Vec::with_capacity(channels);
    for _ in 0..channels {
        let step = r.f32()?;
        if !STEP_RANGE.contains(&step) {
            return Err(r.corrupt(format!("quantiser step is {step}, must be within {STEP_RANGE:?}")));
        }
        steps.push(step);
    }
    // Matrix of the channel transform, row after row.
    let transform = match transform {
        0 => ChannelTransform::None,
        1 if channels <= MAX_MATRIX_CHANNELS => {
            let mut matrix = Vec::with_capacity(channels * channels);
            for _ in 0..channels * channels {
                let entry = r.f32()?;
                if !(-1.001..=1.001).contains(&entry) {
                    return Err(r.corrupt(format!("channel matrix holds {entry}, not within -1 to 1")));
                }
                matrix.push(entry);
            }
            ChannelTransform::Matrix(matrix)
        }
        other => return Err(r.corrupt(format!("channel transform {other} of {channels} channels is reserved"))),
    };
    // Correction step, from draft 3 on; 0 where there are no corrections.
    let correction = match if compact { r.f32()? } else { 0.0 } {
        none if none.to_bits() == 0 => None,
        step if STEP_RANGE.contains(&step) => Some(step),
        step => return Err(r.corrupt(format!("correction step is {step}, must be 0 or within {STEP_RANGE:?}"))),
    };
    r.finish()?;
    Ok(Coding { basis, quantization, eps, sampling, seed, transform, steps, shrink, horizon, zeros, correction })
}

pub(crate) fn read_partition(mut r: ByteReader, grid: &Grid) -> Result<Partition> {
    let axes = grid.axes().len();
    let shape = |r: &mut ByteReader| -> Result<[usize; 4]> {
        let mut shape = [1; 4];
        for n in &mut shape[4 - axes..] {
            *n = r.u32()? as usize;
        }
        Ok(shape)
    };
    // Shape of a tile, one length an axis.
    let tile = shape(&mut r)?;
    // Number of block shapes less one, then the shapes.
    let count = usize::from(r.u8()?) + 1;
    let shapes = (0..count).map(|_| shape(&mut r)).collect::<Result<Vec<_>>>()?;
    if tile.contains(&0) {
        return Err(r.corrupt("a tile has length zero"));
    }
    // Shape number of each tile; the product cannot overflow, grids are bounded.
    let tiles: usize = (0..4).map(|i| grid.shape()[i].div_ceil(tile[i])).product();
    let choice = r.bytes(tiles)?.to_vec();
    let partition = Partition::tiled(grid.shape(), tile, shapes, choice).map_err(here(&r))?;
    for &shape in partition.shapes() {
        check_block(shape, grid.channels().len()).map_err(|what| here(&r)(Error::InvalidArgument(what)))?;
    }
    r.finish()?;
    Ok(partition)
}

#[cfg(feature = "encode")]
pub(crate) use write::*;

#[cfg(feature = "encode")]
mod write {
    use super::*;
    use crate::base::bits::ByteWriter;

    pub(crate) fn write_grid(grid: &Grid) -> Vec<u8> {
        let mut w = ByteWriter::default();
        w.u8(grid.axes().len() as u8);
        for axis in grid.axes() {
            w.u8(axis.name as u8);
            w.u8(axis.mapping as u8);
            w.u16(0);
            w.u32(axis.len as u32);
            w.f64(axis.start);
            w.f64(axis.end);
        }
        w.u16(grid.channels().len() as u16);
        for channel in grid.channels() {
            w.f64(channel.scale);
            w.f64(channel.wavelength.unwrap_or(0.0));
            w.u8(channel.name.len() as u8);
            w.bytes(channel.name.as_bytes());
        }
        w.0
    }

    pub(crate) fn write_coding(coding: &Coding) -> Vec<u8> {
        let mut w = ByteWriter::default();
        w.u8(coding.basis as u8);
        w.u8(TONE_LN);
        w.u8(match coding.quantization {
            Quantization::Scalar => ENTROPY_RANGE,
            Quantization::Dependent => ENTROPY_DEPENDENT,
        });
        w.u8(u8::from(coding.transform != ChannelTransform::None));
        w.u8(coding.shrink[0] as u8);
        w.u8(coding.shrink[1] as u8);
        w.u8(u8::from(coding.horizon.is_some()));
        w.u8(u8::from(coding.zeros));
        w.f64(coding.eps);
        w.f64(coding.horizon.unwrap_or(0.0));
        w.u64(coding.seed);
        w.u32(match coding.sampling {
            Sampling::Every => 0,
            Sampling::Bernoulli { threshold } => threshold,
        });
        coding.steps.iter().for_each(|&step| w.f32(step));
        if let ChannelTransform::Matrix(matrix) = &coding.transform {
            matrix.iter().for_each(|&entry| w.f32(entry));
        }
        w.f32(coding.correction.unwrap_or(0.0));
        w.0
    }

    pub(crate) fn write_partition(partition: &Partition, axes: usize) -> Vec<u8> {
        let mut w = ByteWriter::default();
        let shape = |w: &mut ByteWriter, shape: [usize; 4]| shape[4 - axes..].iter().for_each(|&n| w.u32(n as u32));
        shape(&mut w, partition.tile());
        w.u8((partition.shapes().len() - 1) as u8);
        partition.shapes().iter().for_each(|&s| shape(&mut w, s));
        w.bytes(partition.tile_shapes());
        w.0
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;

    fn reader(bytes: &[u8]) -> ByteReader<'_> {
        ByteReader::new(bytes, 0, "TEST")
    }

    fn spectral() -> Grid {
        let axis = |name, len| Axis { name, len, mapping: Mapping::Linear, start: 0.0, end: 1.5 };
        let axes = vec![
            axis(AxisName::ThetaI, 3),
            axis(AxisName::PhiI, 5),
            axis(AxisName::ThetaO, 4),
            axis(AxisName::PhiO, 7),
        ];
        let channel = |i| Channel { name: String::new(), wavelength: Some(400.0 + f64::from(i)), scale: 1.0 };
        Grid::new(axes, (0..195).map(channel).collect()).unwrap()
    }

    #[test]
    fn grids_round_trip_and_reject_reserved_values() {
        for grid in [Grid::merl(), Grid::merl_360(), spectral()] {
            let bytes = write_grid(&grid);
            assert_eq!(read_grid(reader(&bytes)).unwrap(), grid);
            for cut in 0..bytes.len() {
                assert!(read_grid(reader(&bytes[..cut])).is_err());
            }
            for (at, value) in [(0, 5), (0, 0), (1, 9), (2, 2), (3, 1)] {
                let mut bad = bytes.clone();
                bad[at] = value;
                assert!(read_grid(reader(&bad)).is_err(), "byte {at} = {value}");
            }
        }
    }

    #[test]
    fn codings_round_trip_and_reject_reserved_values() {
        let coding = Coding {
            basis: Basis::Dft,
            quantization: Quantization::Dependent,
            eps: 1e-3,
            sampling: Sampling::from_ratio(0.05).unwrap(),
            seed: 99,
            transform: ChannelTransform::opponent(),
            steps: vec![0.1, 0.2, 0.3],
            shrink: [20, -3],
            horizon: Some(-0.061),
            zeros: true,
            correction: Some(0.19),
        };
        let bytes = write_coding(&coding);
        assert_eq!(read_coding(reader(&bytes), 3, 4).unwrap(), coding);
        for (at, value) in [(0, 2), (1, 0), (2, 0), (3, 2), (6, 2), (7, 2)] {
            let mut bad = bytes.clone();
            bad[at] = value;
            assert!(read_coding(reader(&bad), 3, 4).is_err(), "byte {at} = {value}");
        }
        let nan = Coding { eps: f64::NAN, ..coding.clone() };
        assert!(read_coding(reader(&write_coding(&nan)), 3, 4).is_err());
        let zero = Coding { steps: vec![0.1, 0.0, 0.1], ..coding.clone() };
        assert!(read_coding(reader(&write_coding(&zero)), 3, 4).is_err());
        // Drafts before the third have no exact zeros, and end before the correction step.
        let plain = Coding { quantization: Quantization::Scalar, zeros: false, correction: None, ..coding.clone() };
        let old = write_coding(&plain);
        assert_eq!(read_coding(reader(&old[..old.len() - 4]), 3, 2).unwrap(), plain);
        let zeros = write_coding(&Coding { zeros: true, ..plain.clone() });
        assert!(read_coding(reader(&zeros[..zeros.len() - 4]), 3, 2).is_err());
        assert!(read_coding(reader(&old), 3, 2).is_err());
        assert_eq!(read_coding(reader(&old), 3, 3).unwrap(), plain);
        // Dependent quantisation came with the fourth.
        assert!(read_coding(reader(&bytes), 3, 3).is_err());
        for step in [-0.0, -0.1, 1e-13, 1e7, f32::NAN] {
            let bad = Coding { correction: Some(step), ..coding.clone() };
            assert!(read_coding(reader(&write_coding(&bad)), 3, 4).is_err(), "{step}");
        }
    }

    #[test]
    fn partitions_round_trip() {
        let grid = Grid::merl();
        let tiled = Partition::tiled(grid.shape(), [1, 45, 90, 180], vec![[1, 15, 15, 15], [1, 9, 9, 36]], vec![1, 0]);
        for partition in [tiled.unwrap(), Partition::uniform(grid.shape(), [1, 15, 15, 15]).unwrap()] {
            let bytes = write_partition(&partition, 3);
            assert_eq!(read_partition(reader(&bytes), &grid).unwrap(), partition);
            for cut in 0..bytes.len() {
                assert!(read_partition(reader(&bytes[..cut]), &grid).is_err());
            }
        }
    }
}
