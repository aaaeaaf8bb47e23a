//! MERL `.binary` tables (Matusik et al. 2003).
//!
//! Three little-endian int32 (theta_h bins, theta_d bins, phi_d bins: 90, 90 and 180, or 360 without reciprocity),
//! then one plane of float64 for each of R, G, B, index `phi_d + n * (theta_d + 90 * theta_h)`. Times 1/1500,
//! 1.15/1500 and 1.66/1500 the values are in 1/sr; negative ones were not measured.

use std::io::Write;

use crate::base::bits::read_f64_into;
use crate::base::error::{Error, Result};
use crate::table::Table;
use crate::table::grid::{Grid, MERL_SCALE};

const NAME: &str = "MERL table";
const HEADER: usize = 12;

/// How names of such files end.
pub const EXTENSION: &str = "binary";

/// Reads a table from the bytes of a `.binary` file.
///
/// # Errors
/// `Truncated` if it is short, `Corrupt` if a dimension is not MERL's or bytes follow the planes.
pub fn read_merl(data: &[u8]) -> Result<Table> {
    let (grid, planes) = read_header(data)?;
    let expected = bytes_of(&grid);
    if (data.len() as u64) < expected {
        return Err(Error::Truncated { section: NAME, expected, got: data.len() as u64 });
    }
    if data.len() as u64 > expected {
        let what = format!("{} bytes follow the last plane", data.len() as u64 - expected);
        return Err(Error::corrupt(NAME, expected, what));
    }
    let mut values = vec![0.0; grid.positions() * 3];
    read_f64_into(planes, &mut values);
    Table::from_values(grid, values)
}

/// Bytes of the whole file by its first ones; of fewer than the header's, those of the header.
#[cfg(feature = "encode")]
pub(super) fn length(head: &[u8]) -> Result<u64> {
    if head.len() < HEADER {
        return Ok(HEADER as u64);
    }
    read_header(head).map(|(grid, _)| bytes_of(&grid))
}

fn bytes_of(grid: &Grid) -> u64 {
    (HEADER + 8 * 3 * grid.positions()) as u64
}

/// The grid by the dimensions, and what follows them.
fn read_header(data: &[u8]) -> Result<(Grid, &[u8])> {
    let Some((header, planes)) = data.split_at_checked(HEADER) else {
        return Err(Error::Truncated { section: NAME, expected: HEADER as u64, got: data.len() as u64 });
    };
    // Each dimension by itself: tables with the right product and wrong dimensions exist.
    let dims: Vec<i32> = header.chunks_exact(4).map(|b| crate::base::bits::read_int(b, 4)).collect();
    for (axis, (&dim, allowed)) in dims.iter().zip([&[90][..], &[90], &[180, 360]]).enumerate() {
        if !allowed.contains(&dim) {
            let name = ["theta_h", "theta_d", "phi_d"][axis];
            let what = format!("{name} has {dim} bins, expected {allowed:?}; is this a MERL .binary file?");
            return Err(Error::corrupt(NAME, 4 * axis as u64, what));
        }
    }
    Ok((if dims[2] == 360 { Grid::merl_360() } else { Grid::merl() }, planes))
}

/// Writes a table as a `.binary` file: missing entries as -1, or, if `fill` is set, as the values filled in.
///
/// # Errors
/// `InvalidArgument` if the table is not on MERL's grid; `Io` if the writer fails.
pub fn write_merl(table: &Table, fill: bool, mut out: impl Write) -> Result<()> {
    let grid = table.grid();
    let merl = [Grid::merl(), Grid::merl_360()];
    if merl.iter().all(|m| m.axes() != grid.axes()) || grid.channels().len() != 3 {
        return Err(Error::InvalidArgument(
            "the table is not on MERL's grid (theta_h 90, theta_d 90, phi_d 180 or 360, RGB); write it as .npy".into(),
        ));
    }
    for axis in grid.axes() {
        out.write_all(&(axis.len as i32).to_le_bytes())?;
    }
    let mut bytes = Vec::with_capacity(8 * grid.positions());
    for (c, channel) in grid.channels().iter().enumerate() {
        // One for tables that were read from MERL's units.
        let scale = channel.scale / MERL_SCALE[c];
        bytes.clear();
        for (value, &valid) in table.plane(c).iter().zip(table.valid_plane(c)) {
            let value = if valid || fill { (value * scale).min(f64::MAX) } else { -1.0 };
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        out.write_all(&bytes)?;
    }
    Ok(())
}

/// Writes a table of exactly these values as a `.binary` file, one plane per channel: what was read from one becomes it again.
///
/// # Errors
/// `InvalidArgument` if the grid is not MERL's, in MERL's units, or the values are not as many as its; `Io` if the writer
/// fails.
pub fn write_merl_values(grid: &Grid, values: &[f64], mut out: impl Write) -> Result<()> {
    if [Grid::merl(), Grid::merl_360()].iter().all(|merl| merl != grid) || values.len() != grid.positions() * 3 {
        return Err(Error::InvalidArgument("the table is not a MERL table; only these have the form .binary".into()));
    }
    for axis in grid.axes() {
        out.write_all(&(axis.len as i32).to_le_bytes())?;
    }
    for chunk in values.chunks(1 << 13) {
        let bytes: Vec<u8> = chunk.iter().flat_map(|value| value.to_le_bytes()).collect();
        out.write_all(&bytes)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes_of(dims: [i32; 3], entries: usize) -> Vec<u8> {
        let mut bytes: Vec<u8> = dims.iter().flat_map(|d| d.to_le_bytes()).collect();
        for i in 0..entries {
            let value = if i % 5 == 0 { -1.0 } else { i as f64 * 1e-3 };
            bytes.extend_from_slice(&value.to_le_bytes());
        }
        bytes
    }

    #[test]
    #[cfg_attr(miri, ignore = "whole tables of MERL's size")]
    fn bytes_survive_reading_and_writing() {
        for phi_d in [180, 360] {
            let bytes = bytes_of([90, 90, phi_d], 90 * 90 * phi_d as usize * 3);
            let table = read_merl(&bytes).unwrap();
            assert_eq!(table.grid().shape(), [1, 90, 90, phi_d as usize]);
            assert_eq!(table.plane(1)[7], (90 * 90 * phi_d as usize + 7) as f64 * 1e-3);
            let mut back = Vec::new();
            write_merl(&table, false, &mut back).unwrap();
            assert!(back == bytes);
            back.clear();
            write_merl_values(table.grid(), table.values(), &mut back).unwrap();
            assert!(back == bytes);
        }
    }

    #[test]
    #[cfg_attr(miri, ignore = "whole tables of MERL's size")]
    fn wrong_dimensions_and_lengths_are_refused() {
        let n = 90 * 90 * 180 * 3;
        // The product alone would pass.
        for dims in [[180, 90, 90], [90, 180, 90], [90, 90, 90], [-90, -90, 180], [0, 0, 0]] {
            assert!(matches!(read_merl(&bytes_of(dims, 10)), Err(Error::Corrupt { .. })), "{dims:?}");
        }
        assert!(matches!(read_merl(&bytes_of([90, 90, 180], n - 1)), Err(Error::Truncated { .. })));
        assert!(matches!(read_merl(&bytes_of([90, 90, 180], n + 1)), Err(Error::Corrupt { .. })));
        assert!(matches!(read_merl(&[90, 0, 0]), Err(Error::Truncated { .. })));
        // Half the table of 360 bins is not a table of 180 bins.
        assert!(matches!(read_merl(&bytes_of([90, 90, 360], n)), Err(Error::Truncated { .. })));
    }
}
