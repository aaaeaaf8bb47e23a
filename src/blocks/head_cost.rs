//! What reading the index and rebuilding the grazing profile take: operations of about a nanosecond, and bytes.

use crate::codec::fourier::Synthesis;
use crate::codec::profile::TABLES;
use crate::format::profile::CodedProfile;
use crate::table::grid::Grid;

/// A row or a place of a coefficient that is gone through, and a coefficient that is found.
pub(super) const STEP: u64 = 4;
pub(super) const COEFFICIENT: u64 = 12;
/// Multiply-adds in one operation.
pub(super) const AT_ONCE: u64 = 6;
/// A block of the index, and one of its means.
const ENTRY: u64 = 64;
const MEAN: u64 = 16;

/// Operations and bytes of reading an index.
pub(crate) fn of_index(blocks: usize, components: usize) -> [u64; 2] {
    let [blocks, means] = [blocks as u64, blocks.saturating_mul(components) as u64];
    [ENTRY * blocks + MEAN * means, 4 * means + (size_of::<usize>() as u64 + 2) * blocks]
}

/// Operations and bytes of rebuilding a profile, its tables side by side included.
pub(crate) fn of_profile(
    coded: &CodedProfile,
    grid: &Grid,
    synthesis: &Synthesis,
    shapes: [[usize; 4]; 2],
) -> [u64; 2] {
    let channels = grid.channels().len() as u64;
    let (mut work, mut bytes) = (0, 0);
    for shape in shapes {
        let n = shape.iter().product::<usize>();
        let values = n as u64 * channels;
        // Two tables of a shape.
        work += 2 * (values * (STEP + COEFFICIENT) + channels * synthesis.work(shape, n) / AT_ONCE);
        bytes += 2 * (4 * values + 4 * n as u64 * channels.next_multiple_of(4));
        // Coefficients of one at a time.
        bytes += 16 * values;
    }
    debug_assert!(TABLES == 4 && coded.knots > 0);
    [work, bytes]
}
