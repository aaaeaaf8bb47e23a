//! What a renderer does without csbrdf, to measure beside it: reads the raw table, looks values up in it.

use std::path::Path;

use csbrdf::codec::sample::SplitMix64;
use csbrdf::table::coords::{Lookup, taps};
use csbrdf::{Grid, Parameterization};

/// Random directions over the hemisphere, of light and of sensor, for `count` look-ups.
pub fn directions(count: usize, random: &mut SplitMix64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let mut direction = || {
        let mut uniform = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        let (z, phi) = (uniform(), std::f64::consts::TAU * uniform());
        let r = (1.0 - z * z).sqrt();
        [r * phi.cos(), r * phi.sin(), z]
    };
    (0..count).map(|_| (direction(), direction())).unzip()
}

/// Interpolates in a table in memory, `[channel][position]`, as `Brdf::eval` does.
pub fn look_up((grid, map): (&Grid, &Parameterization), table: &[f32], wi: [f64; 3], wo: [f64; 3], value: &mut [f32]) {
    value.fill(0.0);
    let n = grid.positions();
    if let Some(at) = map.coordinates(wi, wo) {
        for &(position, weight) in taps(grid, at, Lookup::Linear).as_slice() {
            for (c, sum) in value.iter_mut().enumerate() {
                *sum += table[c * n + position] * weight as f32;
            }
        }
    }
}

/// A file of a MERL table's form: twelve bytes of header, then its values in double precision.
pub fn write(path: &Path, values: usize) -> std::io::Result<()> {
    std::fs::write(path, vec![0x3F; 12 + 8 * values])
}

/// Reads it whole and converts it to single precision.
pub fn read(path: &Path) -> std::io::Result<Vec<f32>> {
    let bytes = std::fs::read(path)?;
    let values = bytes[12..].chunks_exact(8).map(|b| b.try_into().map(|b| f64::from_le_bytes(b) as f32));
    values.collect::<Result<Vec<f32>, _>>().map_err(std::io::Error::other)
}
