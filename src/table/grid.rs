//! The sampling grid of a table: named angular axes and channels.

use crate::base::error::{Error, Result};
use crate::base::limits::{MAX_ANGLE, MAX_AXES, MAX_AXIS_LEN, MAX_CHANNEL_NAME, MAX_CHANNELS, MAX_POSITIONS};

/// What an axis of the grid measures. All angles are in radians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum AxisName {
    /// Anything without an angular meaning known to this version.
    Other = 0,
    /// Half-angle elevation, from the normal, 0 to pi/2 (Rusinkiewicz 1998).
    ThetaH = 1,
    /// Half-angle azimuth, 0 to 2 pi.
    PhiH = 2,
    /// Difference-angle elevation, from the half vector, 0 to pi/2.
    ThetaD = 3,
    /// Difference-angle azimuth; 0 to pi where reciprocity is assumed, else 0 to 2 pi.
    PhiD = 4,
    /// Elevation of the incident direction, 0 to pi/2.
    ThetaI = 5,
    /// Azimuth of the incident direction, 0 to 2 pi.
    PhiI = 6,
    /// Elevation of the outgoing direction, 0 to pi/2.
    ThetaO = 7,
    /// Azimuth of the outgoing direction, 0 to 2 pi.
    PhiO = 8,
}

impl AxisName {
    /// All names, in the order of their codes.
    pub const ALL: [AxisName; 9] = [
        AxisName::Other,
        AxisName::ThetaH,
        AxisName::PhiH,
        AxisName::ThetaD,
        AxisName::PhiD,
        AxisName::ThetaI,
        AxisName::PhiI,
        AxisName::ThetaO,
        AxisName::PhiO,
    ];

    /// The field's usual spelling.
    pub fn as_str(self) -> &'static str {
        ["other", "theta_h", "phi_h", "theta_d", "phi_d", "theta_i", "phi_i", "theta_o", "phi_o"][self as usize]
    }

    /// True for azimuths: the axis closes on itself, its last bin is a neighbour of its first.
    pub fn is_periodic(self) -> bool {
        matches!(self, AxisName::PhiH | AxisName::PhiD | AxisName::PhiI | AxisName::PhiO)
    }
}

/// How the bins of an axis are spread over its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum Mapping {
    /// Equal bins: `angle = start + (end - start) * t`.
    Linear = 0,
    /// Bins that are narrow near `start`: `angle = start + (end - start) * t^2` (MERL's theta_h).
    Square = 1,
}

/// One axis of the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// What it measures.
    pub name: AxisName,
    /// Number of bins, at least 1.
    pub len: usize,
    /// Spread of the bins over `start..end`.
    pub mapping: Mapping,
    /// Angle at the lower edge of the first bin, radians.
    pub start: f64,
    /// Angle at the upper edge of the last bin, radians.
    pub end: f64,
}

impl Axis {
    /// Angle (radians) at bin coordinate `u` in 0..=len; bin `i` covers `i..i + 1`, its centre is `i + 0.5`.
    pub fn angle(&self, u: f64) -> f64 {
        let t = u / self.len as f64;
        let t = match self.mapping {
            Mapping::Linear => t,
            Mapping::Square => t * t,
        };
        self.start + (self.end - self.start) * t
    }

    /// Bin coordinate of an angle (radians), the inverse of [`Axis::angle`], clamped to 0..=len.
    pub fn coordinate(&self, angle: f64) -> f64 {
        let t = ((angle - self.start) / (self.end - self.start)).clamp(0.0, 1.0);
        let t = match self.mapping {
            Mapping::Linear => t,
            Mapping::Square => t.sqrt(),
        };
        t * self.len as f64
    }
}

/// One channel of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// "R", "G", "B", or a free name of at most 255 bytes.
    pub name: String,
    /// Centre wavelength in nanometres; `None` for broad-band channels such as R, G, B.
    pub wavelength: Option<f64>,
    /// Factor from the units of the source file to 1/sr (MERL: 1/1500, 1.15/1500, 1.66/1500).
    pub scale: f64,
}

/// MERL's channel scales to 1/sr: R, G, B.
pub const MERL_SCALE: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];

/// Shape and meaning of a table: 1 to 4 axes, slowest first, and its channels.
///
/// ```
/// use csbrdf::{Axis, AxisName, Channel, Grid, Mapping};
///
/// // Two directions of an isotropic material, at 31 wavelengths.
/// let angle = |name, len, end| Axis { name, len, mapping: Mapping::Linear, start: 0.0, end };
/// let quarter = std::f64::consts::FRAC_PI_2;
/// let axes =
///     vec![angle(AxisName::ThetaI, 18, quarter), angle(AxisName::ThetaO, 18, quarter), angle(AxisName::PhiO, 36, 4.0 * quarter)];
/// let channel = |nm: f64| Channel { name: format!("{nm}nm"), wavelength: Some(nm), scale: 1.0 };
/// let grid = Grid::new(axes, (0..31).map(|i| channel(400.0 + 10.0 * f64::from(i))).collect())?;
/// assert_eq!(grid.positions(), 18 * 18 * 36);
/// # Ok::<(), csbrdf::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    axes: Vec<Axis>,
    channels: Vec<Channel>,
}

impl Grid {
    /// A grid of the given axes (slowest first) and channels.
    ///
    /// # Errors
    /// `InvalidArgument` if a count, length, range or scale is outside the format's limits.
    pub fn new(axes: Vec<Axis>, channels: Vec<Channel>) -> Result<Grid> {
        let bad = |what: String| Err(Error::InvalidArgument(what));
        if axes.is_empty() || axes.len() > MAX_AXES {
            return bad(format!("a grid has 1 to {MAX_AXES} axes, not {}", axes.len()));
        }
        for axis in &axes {
            if axis.len == 0 || axis.len > MAX_AXIS_LEN {
                return bad(format!(
                    "axis {} has {} bins, allowed are 1 to {MAX_AXIS_LEN}",
                    axis.name.as_str(),
                    axis.len
                ));
            }
            let bounded = axis.start.abs() <= MAX_ANGLE && axis.end.abs() <= MAX_ANGLE;
            if !(bounded && axis.start < axis.end) {
                let (name, start, end) = (axis.name.as_str(), axis.start, axis.end);
                return bad(format!("axis {name} has the range {start}..{end}, empty or beyond {MAX_ANGLE}"));
            }
        }
        let named = |name: AxisName| name != AxisName::Other && axes.iter().filter(|a| a.name == name).count() > 1;
        if let Some(axis) = axes.iter().find(|a| named(a.name)) {
            return bad(format!("two axes are named {}", axis.name.as_str()));
        }
        let positions = axes.iter().try_fold(1usize, |n, a| n.checked_mul(a.len)).unwrap_or(usize::MAX);
        if positions == usize::MAX || positions as u64 > MAX_POSITIONS {
            return bad(format!("a grid of {positions} positions, at most {MAX_POSITIONS} are allowed"));
        }
        if channels.is_empty() || channels.len() > MAX_CHANNELS {
            return bad(format!("a grid has 1 to {MAX_CHANNELS} channels, not {}", channels.len()));
        }
        for channel in &channels {
            if channel.name.len() > MAX_CHANNEL_NAME {
                return bad(format!(
                    "channel name of {} bytes, at most {MAX_CHANNEL_NAME} allowed",
                    channel.name.len()
                ));
            }
            if !(channel.scale.is_finite() && channel.scale > 0.0) {
                return bad(format!("channel {:?} has scale {}, must be positive", channel.name, channel.scale));
            }
            if channel.wavelength.is_some_and(|w| !(w.is_finite() && w > 0.0)) {
                return bad(format!("channel {:?} has a wavelength that is not positive", channel.name));
            }
        }
        Ok(Grid { axes, channels })
    }

    /// MERL's grid: theta_h (90, square), theta_d (90), phi_d (180 over half a turn, by reciprocity), channels R, G, B.
    pub fn merl() -> Grid {
        Grid::merl_with(180, std::f64::consts::PI)
    }

    /// MERL's grid without reciprocity: phi_d of 360 bins over a whole turn.
    pub fn merl_360() -> Grid {
        Grid::merl_with(360, 2.0 * std::f64::consts::PI)
    }

    fn merl_with(phi_d: usize, phi_end: f64) -> Grid {
        use std::f64::consts::FRAC_PI_2;
        let axis = |name, len, mapping, end| Axis { name, len, mapping, start: 0.0, end };
        let axes = vec![
            axis(AxisName::ThetaH, 90, Mapping::Square, FRAC_PI_2),
            axis(AxisName::ThetaD, 90, Mapping::Linear, FRAC_PI_2),
            axis(AxisName::PhiD, phi_d, Mapping::Linear, phi_end),
        ];
        Grid { axes, channels: Grid::rgb_channels(MERL_SCALE) }
    }

    /// The same axes, cut into other numbers of bins, slowest first; the same channels.
    ///
    /// # Errors
    /// `InvalidArgument` if it is not one number an axis, or as [`Grid::new`].
    pub fn with_lengths(&self, lengths: &[usize]) -> Result<Grid> {
        if lengths.len() != self.axes.len() {
            return Err(Error::InvalidArgument(format!("{} lengths for {} axes", lengths.len(), self.axes.len())));
        }
        let axes = self.axes.iter().zip(lengths).map(|(&axis, &len)| Axis { len, ..axis }).collect();
        Grid::new(axes, self.channels.clone())
    }

    /// Channels R, G, B with the given scales to 1/sr.
    pub fn rgb_channels(scale: [f64; 3]) -> Vec<Channel> {
        ["R", "G", "B"]
            .iter()
            .zip(scale)
            .map(|(name, scale)| Channel { name: name.to_string(), wavelength: None, scale })
            .collect()
    }

    /// The axes, slowest first.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The channels, in the order of the planes.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// Axis lengths padded in front with ones to four: the shape every stage works on.
    pub fn shape(&self) -> [usize; 4] {
        let mut shape = [1; 4];
        for (padded, axis) in shape[4 - self.axes.len()..].iter_mut().zip(&self.axes) {
            *padded = axis.len;
        }
        shape
    }

    /// Number of grid positions (entries of one channel).
    pub fn positions(&self) -> usize {
        self.axes.iter().map(|a| a.len).product()
    }

    /// The position of the axis named so, if there is one.
    pub fn find(&self, name: AxisName) -> Option<usize> {
        self.axes.iter().position(|a| a.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merl_angles_are_the_published_ones() {
        let grid = Grid::merl();
        assert_eq!(grid.shape(), [1, 90, 90, 180]);
        let theta_h = grid.axes()[0];
        // The MERL reader maps theta_h to bin 90 * sqrt(theta_h / 90 deg).
        let deg = 10.0f64;
        let bin = 90.0 * (deg / 90.0).sqrt();
        assert!((theta_h.coordinate(deg.to_radians()) - bin).abs() < 1e-12);
        assert!((theta_h.angle(bin) - deg.to_radians()).abs() < 1e-12);
        assert!((grid.axes()[2].angle(179.5).to_degrees() - 179.5).abs() < 1e-9);
    }

    #[test]
    fn other_lengths_keep_what_the_axes_mean() {
        let grid = Grid::merl().with_lengths(&[30, 20, 10]).unwrap();
        assert_eq!(grid.shape(), [1, 30, 20, 10]);
        assert_eq!(grid.channels(), Grid::merl().channels());
        let ends = |grid: &Grid| grid.axes().iter().map(|axis| axis.angle(axis.len as f64)).collect::<Vec<_>>();
        assert_eq!(ends(&grid), ends(&Grid::merl()));
        for lengths in [&[30, 20][..], &[30, 20, 10, 3], &[30, 0, 10]] {
            assert!(Grid::merl().with_lengths(lengths).is_err(), "{lengths:?}");
        }
    }

    #[test]
    fn absurd_grids_are_refused() {
        let axis = Grid::merl().axes()[0];
        let channels = Grid::rgb_channels([1.0; 3]);
        assert!(Grid::new(vec![], channels.clone()).is_err());
        assert!(Grid::new(vec![axis; 5], channels.clone()).is_err());
        assert!(Grid::new(vec![Axis { len: 0, ..axis }], channels.clone()).is_err());
        assert!(Grid::new(vec![axis; 2], channels.clone()).is_err());
        assert!(Grid::new(vec![Axis { end: 1e7, ..axis }], channels.clone()).is_err());
        assert!(Grid::new(vec![Axis { end: f64::NAN, ..axis }], channels.clone()).is_err());
        assert!(Grid::new(vec![axis], vec![]).is_err());
        assert!(Grid::new(vec![axis], Grid::rgb_channels([1.0, 0.0, 1.0])).is_err());
    }
}
