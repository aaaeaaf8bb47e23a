//! The input of `csbrdf encode --samples`: a list of measurements.

use std::path::Path;

use csbrdf::Error;
use csbrdf::io::samples::read_samples;
use csbrdf::table::Table;
use csbrdf::table::grid::Grid;

use crate::failure::{Failure, note};
use crate::path::label;
use crate::text::{grouped, percent};

/// The table of a list; what was measured goes to standard error.
pub fn table(path: &Path, bytes: &[u8], grid: Option<Grid>, quiet: bool) -> Result<Table, Failure> {
    let samples = read_samples(bytes, grid).map_err(|e| match e {
        // The line says where, not the offset.
        Error::Corrupt { what, .. } => Failure::bad_input(path, what),
        other => Failure::in_file(path, &other),
    })?;
    if !quiet {
        let bins = percent(samples.bins, samples.table.grid().positions());
        note(&format!(
            "{}: {} rows, {} bins measured ({bins} of all), {} rows without a measurement, {} repeated",
            label(path),
            grouped(samples.rows),
            grouped(samples.bins),
            grouped(samples.unmeasured),
            grouped(samples.repeated)
        ));
    }
    Ok(samples.table)
}
