//! Lists of measurements, CSV of arbitrary bytes: read or refused with a line. The first byte chooses the grid.

use csbrdf::base::error::Error;
use csbrdf::io::samples::{LARGEST, read_samples};
use csbrdf::table::grid::{Grid, MERL_SCALE};

pub fn run(data: &[u8]) {
    let [grid, list @ ..] = data else { return };
    let grid = [None, Some(Grid::merl()), Some(Grid::merl_360())][usize::from(*grid) % 3].clone();
    match read_samples(list, grid) {
        Ok(samples) => {
            assert!(samples.bins > 0 && samples.rows == samples.bins + samples.unmeasured + samples.repeated);
            assert_eq!(samples.table.valid_count(), 3 * samples.bins);
            for (plane, scale) in (0..3).zip(MERL_SCALE) {
                let (values, valid) = (samples.table.plane(plane), samples.table.valid_plane(plane));
                let measured = values.iter().zip(valid).filter(|(_, valid)| **valid).map(|(value, _)| value * scale);
                assert!(measured.into_iter().all(|value| (0.0..=LARGEST * 1.001).contains(&value)));
            }
        }
        Err(Error::Corrupt { .. }) => {}
        Err(e) => panic!("{e}"),
    }
}
