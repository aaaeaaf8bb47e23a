//! The input of `csbrdf encode --samples`: a list of measurements.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use csbrdf::Error;
use csbrdf::format::MAGIC;
use csbrdf::grid::Grid;
use csbrdf::table::BrdfTable;
use csbrdf::table::samples::read_samples;

use crate::failure::{Failure, Outcome, note};
use crate::input::{self, Bytes, is_dash, label};
use crate::text::{grouped, percent};

/// Most bytes of a list that comes through a pipe: twice that of all bins of the larger of MERL's grids.
const STREAM_LIMIT: u64 = 1 << 30;

/// Bytes by which a list is told from other files.
const HEAD: usize = 64;

/// The bytes of a list. Of a pipe or a device no more is read than its first bytes if these are no text.
pub fn read(path: &Path) -> Result<Bytes, Failure> {
    let failed = |e: std::io::Error| Failure::io(path, &e);
    let mut from: Box<dyn Read> = match is_dash(path) {
        true => Box::new(std::io::stdin().lock()),
        false if std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) => {
            Box::new(File::open(path).map_err(failed)?)
        }
        false => return input::read(path),
    };
    let mut bytes = Vec::new();
    from.by_ref().take(HEAD as u64).read_to_end(&mut bytes).map_err(failed)?;
    expect_text(path, &bytes)?;
    let read = from.take(STREAM_LIMIT).read_to_end(&mut bytes).map_err(failed)?;
    if read as u64 == STREAM_LIMIT {
        let what =
            format!("a list of {STREAM_LIMIT} bytes and more came through the pipe; write it to a file and name it");
        return Err(Failure::unsupported(path, what));
    }
    Ok(Bytes::Heap(bytes))
}

fn expect_text(path: &Path, bytes: &[u8]) -> Outcome {
    if bytes.starts_with(&MAGIC) || bytes.iter().take(HEAD).any(|b| *b == 0) {
        return Err(Failure::bad_input(path, "is no text; --samples takes a list as csbrdf plan makes them"));
    }
    Ok(())
}

/// The table of a list; what was measured goes to standard error.
pub fn table(path: &Path, bytes: &[u8], grid: Option<Grid>, quiet: bool) -> Result<BrdfTable, Failure> {
    expect_text(path, bytes)?;
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
