//! The section GRAZ (spec section 3.9): the coded tables of the grazing profile.

use crate::base::bits::ByteReader;
use crate::base::budget::{Budget, Fault, filled, make_room};
use crate::base::error::Result;
use crate::base::simd::Level;
use crate::codec::dependent::Quantization;
use crate::codec::contexts::COEFFICIENTS;
use crate::codec::entropy::{Coefficients, MAX_MAGNITUDE, Walk};
use crate::codec::fourier::{Basis, Lines, Synthesis};
use crate::base::limits::MAX_KNOTS;
use crate::codec::profile::{Profile, TABLES, bins};
use crate::codec::quantize::dequantize_mean;
use crate::codec::range::Decoder;
use crate::base::limits::{MAX_BLOCK_AXIS, STEP_RANGE, check_block};
use crate::table::grid::Grid;

const NO_MEMORY: &str = "no memory for its tables";
const NO_AXES: &str = "a profile needs the axes theta_h, theta_d, phi_d in this order";

/// A profile as it is in the file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CodedProfile {
    pub(crate) knots: usize,
    pub(crate) zone: f32,
    pub(crate) step: f32,
    /// Coefficients at index 0, `[table][component]`.
    pub(crate) first: Vec<i32>,
    /// Output of the range coder.
    pub(crate) coded: Vec<u8>,
    /// Offset of the section within the file.
    pub(crate) offset: u64,
}

pub(crate) fn read_profile(mut r: ByteReader, grid: &Grid) -> Result<CodedProfile> {
    let offset = r.offset();
    let channels = grid.channels().len();
    let Some(bins) = bins(grid) else {
        return Err(r.corrupt(NO_AXES));
    };
    // Number of knots.
    let knots = usize::from(r.u8()?);
    if !(2..=MAX_KNOTS).contains(&knots) {
        return Err(r.corrupt(format!("{knots} knots, allowed are 2 to {MAX_KNOTS}")));
    }
    for n in bins {
        if n > MAX_BLOCK_AXIS {
            return Err(r.corrupt(format!("a profile over {n} bins, at most {MAX_BLOCK_AXIS} are allowed")));
        }
        check_block([1, 1, n, knots], channels).map_err(|what| r.corrupt(what))?;
    }
    // Reserved.
    let reserved = r.bytes(3)?;
    if reserved != [0; 3] {
        return Err(r.corrupt("a reserved field is not 0"));
    }
    // Elevation, a cosine, from which the profile is zero.
    let zone = r.f32()?;
    if !(1e-6..=1.0).contains(&zone) {
        return Err(r.corrupt(format!("the profile's zone is {zone}, must be within 1e-6 to 1")));
    }
    // Quantiser step of all tables.
    let step = r.f32()?;
    if !STEP_RANGE.contains(&step) {
        return Err(r.corrupt(format!("quantiser step is {step}, must be within {STEP_RANGE:?}")));
    }
    // Coefficients at index 0, table after table, component fastest.
    let mut first = Vec::with_capacity(TABLES * channels);
    for _ in 0..TABLES * channels {
        let q = r.u32()? as i32;
        if q.unsigned_abs() > MAX_MAGNITUDE {
            return Err(r.corrupt(format!("mean {q} is beyond {MAX_MAGNITUDE}")));
        }
        first.push(q);
    }
    // The other coefficients, to the end of the section.
    Ok(CodedProfile { knots, zone, step, first, coded: r.rest().to_vec(), offset })
}

impl CodedProfile {
    /// Values of the largest table, all components.
    pub(crate) fn values(&self, grid: &Grid) -> usize {
        bins(grid).map_or(0, |bins| bins[0].max(bins[1])) * self.knots * grid.channels().len()
    }

    /// Shape of a component of a table.
    fn shape(&self, bins: [usize; 2], table: usize) -> [usize; 4] {
        [1, 1, bins[table / 2], self.knots]
    }

    /// Shapes of the tables over theta_h and over theta_d.
    pub(crate) fn shapes(&self, grid: &Grid) -> Option<[[usize; 4]; 2]> {
        bins(grid).map(|bins| [self.shape(bins, 0), self.shape(bins, 2)])
    }

    /// Calls `each` with the number, the shape and the coefficients, but for those at index 0, of one table after the other.
    fn for_each_table(
        &self,
        bins: [usize; 2],
        channels: usize,
        mut each: impl FnMut(usize, [usize; 4], &Coefficients) -> Result<(), &'static str>,
    ) -> Result<(), &'static str> {
        // What all of it may take was counted before (`Reader::prepare`).
        let budget = Budget::unbounded();
        let mut decoder = Decoder::new(&[1 << 15; COEFFICIENTS], &self.coded);
        let (mut walk, mut coefficients) = (Walk::default(), Coefficients::default());
        for t in 0..TABLES {
            let shape = self.shape(bins, t);
            walk.decode(&mut decoder, Quantization::Scalar, shape, channels, &mut coefficients, &budget).map_err(
                |fault| match fault {
                    Fault::Damaged(what) => what,
                    Fault::Refused(_) => NO_MEMORY,
                },
            )?;
            each(t, shape, &coefficients)?;
        }
        if decoder.unread() > 0 {
            return Err("bytes are left over after the last coefficient");
        }
        Ok(())
    }

    /// Rebuilds the tables.
    pub(crate) fn decode(&self, grid: &Grid) -> Result<Profile, &'static str> {
        let bins = bins(grid).ok_or(NO_AXES)?;
        let channels = grid.channels().len();
        let synthesis = Synthesis::new(Basis::Dct, &[1, bins[0], bins[1], self.knots]);
        let (mut lines, mut terms) = (Lines::default(), Vec::new());
        let mut tables: [Vec<f32>; TABLES] = Default::default();
        self.for_each_table(bins, channels, |t, shape, coefficients| {
            let n = shape.iter().product();
            tables[t] = filled(0.0, channels * n).map_err(|_| NO_MEMORY)?;
            for (c, values) in tables[t].chunks_exact_mut(n).enumerate() {
                let term = |&(position, q): &(u32, i32)| (position, dequantize_mean(self.step, q));
                terms.clear();
                make_room(&mut terms, 1 + coefficients.of_channel(c).len()).map_err(|_| NO_MEMORY)?;
                terms.push(term(&(0, self.first[t * channels + c])));
                terms.extend(coefficients.of_channel(c).iter().map(term));
                synthesis.synthesize(Level::detect(), shape, &terms, values, &mut lines).map_err(|_| NO_MEMORY)?;
            }
            Ok(())
        })?;
        Profile::new(grid, self.knots, self.zone, tables)
    }
}

#[cfg(feature = "encode")]
pub(crate) use write::write_profile;

#[cfg(feature = "encode")]
mod write {
    use super::*;
    use crate::base::bits::ByteWriter;
    use crate::codec::range::Encoder;

    impl CodedProfile {
        /// The same with some of its components alone, in the order given; the profile of these stays bit for bit.
        pub(crate) fn with_components(&self, grid: &Grid, components: &[usize]) -> Result<CodedProfile, &'static str> {
            let bins = bins(grid).ok_or(NO_AXES)?;
            let channels = grid.channels().len();
            let mut encoder = Encoder::new(&vec![1 << 15; COEFFICIENTS]);
            let mut walk = Walk::default();
            self.for_each_table(bins, channels, |_, shape, coefficients| {
                let n = shape.iter().product();
                let planes = coefficients.to_planes(channels, n).map_err(|_| NO_MEMORY)?;
                let kept: Vec<i32> = components.iter().flat_map(|&c| &planes[c * n..][..n]).copied().collect();
                walk.code(&mut encoder, Quantization::Scalar, shape, &kept)
                    .map_err(|_| "an extent or a coefficient is out of range")
            })?;
            let first = self.first.chunks_exact(channels).flat_map(|first| components.iter().map(|&c| first[c]));
            Ok(CodedProfile { first: first.collect(), coded: encoder.finish(), ..self.clone() })
        }
    }

    pub(crate) fn write_profile(profile: &CodedProfile) -> Vec<u8> {
        let mut w = ByteWriter::default();
        w.u8(profile.knots as u8);
        w.bytes(&[0; 3]);
        w.f32(profile.zone);
        w.f32(profile.step);
        profile.first.iter().for_each(|&q| w.u32(q as u32));
        w.bytes(&profile.coded);
        w.0
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::table::grid::{Axis, Channel};

    fn grid() -> Grid {
        let merl = Grid::merl();
        let axes = merl.axes().iter().map(|&axis| Axis { len: 2, ..axis }).collect();
        Grid::new(axes, vec![Channel { name: "Y".into(), wavelength: None, scale: 1.0 }]).unwrap()
    }

    /// Spec section 3.9 byte for byte: two knots, zone 0.25, step 0.5, four first coefficients.
    #[test]
    fn bytes_are_those_of_the_specification() {
        let profile =
            CodedProfile { knots: 2, zone: 0.25, step: 0.5, first: vec![1, -2, 3, 0], coded: vec![0xAA], offset: 90 };
        let bytes = [
            &[2, 0, 0, 0][..],
            &[0, 0, 0x80, 0x3E],
            &[0, 0, 0, 0x3F],
            &[1, 0, 0, 0, 0xFE, 0xFF, 0xFF, 0xFF, 3, 0, 0, 0, 0, 0, 0, 0],
            &[0xAA],
        ]
        .concat();
        assert_eq!(write_profile(&profile), bytes);
        let read = |bytes: &[u8]| read_profile(ByteReader::new(bytes, 90, "GRAZ"), &grid());
        assert_eq!(read(&bytes).unwrap(), profile);
        // A knot, a reserved byte, a zone and a step that are not allowed; a section that is short.
        for (at, byte) in [(0, 1), (0, 65), (2, 1), (7, 0xC0), (11, 0)] {
            let mut bad = bytes.clone();
            bad[at] = byte;
            assert!(read(&bad).is_err(), "{at}: {byte}");
        }
        assert!((0..28).all(|length| read(&bytes[..length]).is_err()));
    }
}
