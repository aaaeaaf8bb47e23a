//! Choice of the block shape (encoder only).
//!
//! No shape is best everywhere: blocks long in phi_d win where an isotropic table is smooth in it, short ones where
//! it is not. Measured at step 0.1 with the opponent transform, kB / log rms: alum-bronze 15x15x15 93 / .0091,
//! 6x10x60 67 / .0073, 9x9x180 57 / .0066; RGL golden yellow 95 / .0093, 77 / .0083, 83 / .0097; RGL paper white
//! 41 / .0053, 36 / .0052 (9x9x36: 36 / .0050), 40 / .0069. So a few shapes are tried on the whole table with short
//! solves and the cheapest is taken.

use rayon::prelude::*;

use crate::base::error::Result;
use crate::codec::dependent::Quantization;
use crate::codec::entropy::Walk;
use crate::codec::range::Counter;
use crate::codec::contexts::CONTEXTS;
use crate::encode::quantised::Quantized;
use crate::table::block::Partition;

/// Iterations of the solves of a trial: enough to rank shapes.
pub(in crate::encode) const ITERATIONS: usize = 10;

/// Bytes that each block costs in index and record besides its coefficients.
const OVERHEAD: f64 = 13.0;

/// Shapes to try for a table with `axes` axes, slowest axis first.
pub(in crate::encode) fn candidates(axes: usize) -> Vec<Vec<usize>> {
    let listed: &[&[usize]] = match axes {
        1 => &[&[180], &[36]],
        2 => &[&[9, 36], &[9, 180]],
        3 => &[&[9, 9, 36], &[6, 10, 60], &[9, 9, 180]],
        _ => &[&[5, 6, 6, 18], &[5, 6, 10, 10]],
    };
    listed.iter().map(|shape| shape.to_vec()).collect()
}

/// Cost of coding blocks so: bits, plus squared error at the exchange rate of the quantiser.
///
/// Changing the rounding at a fixed shape buys squared error at 0.07 squared steps a bit (alum-bronze and golden
/// yellow at step 0.1); two shapes are compared at that rate.
pub(in crate::encode) fn trial(
    partition: &Partition,
    blocks: impl IndexedParallelIterator<Item = Result<Quantized>>,
    step: f64,
) -> Result<f64> {
    let (counter, errors) = blocks
        .try_fold(
            || (Counter::new(CONTEXTS), Walk::default(), Vec::new()),
            |(mut counter, mut walk, mut errors), block| {
                let block = block?;
                let coded = walk.code(&mut counter, Quantization::Scalar, block.shape, &block.coefficients);
                debug_assert!(coded.is_ok(), "the quantiser bounds the coefficients");
                errors.push(block.squared_error);
                Ok((counter, walk, errors))
            },
        )
        .map(|part: Result<_>| part.map(|(counter, _, errors)| (counter, errors)))
        .try_reduce(
            || (Counter::new(CONTEXTS), Vec::new()),
            |(mut counter, mut errors), (other, more)| {
                counter.add(&other);
                errors.extend(more);
                Ok((counter, errors))
            },
        )?;
    // Summed in the order of the blocks, so that the choice does not depend on the number of threads.
    let squared_error: f64 = errors.iter().sum();
    Ok(counter.bits() + 8.0 * OVERHEAD * partition.block_count() as f64 + squared_error / (0.07 * step * step))
}
