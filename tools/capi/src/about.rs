//! What the axes, channels and entries of a file are.

use std::ffi::c_char;

use codec::table::grid::{AxisName, Mapping};

use super::boundary::{bytes, check_length, guard, invalid, shared, write, write_text};
use super::{csbrdf_brdf, csbrdf_status};

/// csbrdf_axis.quantity: anything that this library knows no angle for.
pub const CSBRDF_AXIS_OTHER: u32 = 0;
/// csbrdf_axis.quantity: elevation of the half vector, from the normal.
pub const CSBRDF_AXIS_THETA_H: u32 = 1;
/// csbrdf_axis.quantity: azimuth of the half vector.
pub const CSBRDF_AXIS_PHI_H: u32 = 2;
/// csbrdf_axis.quantity: elevation of the difference vector, from the half vector.
pub const CSBRDF_AXIS_THETA_D: u32 = 3;
/// csbrdf_axis.quantity: azimuth of the difference vector.
pub const CSBRDF_AXIS_PHI_D: u32 = 4;
/// csbrdf_axis.quantity: elevation of the incident direction.
pub const CSBRDF_AXIS_THETA_I: u32 = 5;
/// csbrdf_axis.quantity: azimuth of the incident direction.
pub const CSBRDF_AXIS_PHI_I: u32 = 6;
/// csbrdf_axis.quantity: elevation of the outgoing direction.
pub const CSBRDF_AXIS_THETA_O: u32 = 7;
/// csbrdf_axis.quantity: azimuth of the outgoing direction.
pub const CSBRDF_AXIS_PHI_O: u32 = 8;

// The numbers are the library's own.
const _: () = assert!(CSBRDF_AXIS_OTHER == AxisName::Other as u32 && CSBRDF_AXIS_THETA_H == AxisName::ThetaH as u32);
const _: () = assert!(CSBRDF_AXIS_PHI_H == AxisName::PhiH as u32 && CSBRDF_AXIS_THETA_D == AxisName::ThetaD as u32);
const _: () = assert!(CSBRDF_AXIS_PHI_D == AxisName::PhiD as u32 && CSBRDF_AXIS_THETA_I == AxisName::ThetaI as u32);
const _: () = assert!(CSBRDF_AXIS_PHI_I == AxisName::PhiI as u32 && CSBRDF_AXIS_THETA_O == AxisName::ThetaO as u32);
const _: () = assert!(CSBRDF_AXIS_PHI_O == AxisName::PhiO as u32 && AxisName::ALL.len() == 9);

/// An axis of the grid.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct csbrdf_axis {
    /// What it measures: CSBRDF_AXIS_...
    pub quantity: u32,
    /// How its bins are spread: bin coordinate u, bin i from i to i + 1, is the angle start + (end - start) * t, with
    /// t = u / bins to this power, 1 (equal bins) or 2 (bins that are narrow near `start`: theta_h of MERL).
    pub power: u32,
    /// Number of bins, at least 1.
    pub bins: usize,
    /// Angle at the lower edge of the first bin, radians.
    pub start: f64,
    /// Angle at the upper edge of the last bin, radians.
    pub end: f64,
}

/// What an axis measures, from where to where. `axis` counts from 0, the slowest, to what csbrdf_axis_count() gives, less
/// one; unlike csbrdf_grid_shape() there are no axes of one bin in front.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_grid_axis(
    brdf: *const csbrdf_brdf,
    axis: usize,
    out: *mut csbrdf_axis,
) -> csbrdf_status {
    guard(|| {
        // SAFETY: the header asks for an open handle.
        let grid = unsafe { shared(brdf, "brdf") }?.reader().grid();
        let Some(found) = grid.axes().get(axis) else {
            return Err(invalid(format!("axis {axis} does not exist, the file has {}", grid.axes().len())));
        };
        let power = match found.mapping {
            Mapping::Linear => 1,
            Mapping::Square => 2,
            _ => return Err(invalid(format!("axis {axis} has a mapping that this library cannot state"))),
        };
        let found =
            csbrdf_axis { quantity: found.name as u32, power, bins: found.len, start: found.start, end: found.end };
        // SAFETY: the header asks for a place to write to.
        unsafe { write(out, found, "out") }
    })
}

/// Name of a channel in UTF-8, such as "R": at most `size` bytes with the terminating NUL go to `name`, cut between
/// characters; `*wavelength` becomes its centre in nanometres, 0 for broad-band channels such as R, G, B.
///
/// `wavelength` may be NULL, and so may `name` if `size` is 0. 256 bytes are enough for every name. The format allows any
/// character in a name: to C, one with a NUL within ends there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_channel(
    brdf: *const csbrdf_brdf,
    channel: usize,
    name: *mut c_char,
    size: usize,
    wavelength: *mut f64,
) -> csbrdf_status {
    guard(|| {
        // SAFETY: the header asks for an open handle.
        let grid = unsafe { shared(brdf, "brdf") }?.reader().grid();
        let Some(found) = grid.channels().get(channel) else {
            return Err(invalid(format!("channel {channel} does not exist, the file has {}", grid.channels().len())));
        };
        if name.is_null() && size > 0 {
            return Err(invalid("name is NULL"));
        }
        // SAFETY: the header asks for `size` bytes, and for a place to write to or NULL.
        unsafe {
            write_text(&found.name, name, size);
            if !wavelength.is_null() {
                write(wavelength, found.wavelength.unwrap_or(0.0), "wavelength")?;
            }
        }
        Ok(())
    })
}

/// Which values of a block were measured: 1 for each that was, 0 for each that the encoder filled in, in the order of
/// csbrdf_decode_block(). In a block that was pruned none counts as measured.
///
/// `length` must be what csbrdf_block_size() gives.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_block_validity(
    brdf: *const csbrdf_brdf,
    block: usize,
    out: *mut u8,
    length: usize,
) -> csbrdf_status {
    guard(|| {
        // SAFETY: the header asks for an open handle.
        let reader = unsafe { shared(brdf, "brdf") }?.reader();
        check_length("out", length, Some(reader.block_values(block)?))?;
        let valid = reader.block_validity(block)?;
        // SAFETY: the header asks for `length` bytes that nobody else uses.
        let out = unsafe { bytes(out, length, "out") }?;
        out.iter_mut().zip(valid).for_each(|(out, valid)| *out = u8::from(valid));
        Ok(())
    })
}
