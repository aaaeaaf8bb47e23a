//! Validity masks of blocks, predicted from the horizon (spec section 4.8).

use crate::codec::contexts::MASK_BANDS as BANDS;
use crate::codec::range::Coder;
use crate::table::block::Block;
use crate::table::horizon::Horizon;


/// Width of a band of elevations that share contexts.
const BAND: f64 = 0.01;

/// Predicts validity from a file's horizon threshold, or "all valid" where there is none.
#[derive(Clone, Debug)]
pub(crate) struct MaskModel {
    horizon: Option<(Horizon, f64)>,
}

impl MaskModel {
    pub(crate) fn new(horizon: Option<Horizon>, threshold: Option<f64>) -> MaskModel {
        MaskModel { horizon: horizon.zip(threshold) }
    }

    // Small by a constant, here and below: a byte a position, of which a block has 2^21 at most (`MAX_BLOCK_POSITIONS`).
    /// Band of elevations of each position of a block; those of `BANDS / 2` and above are predicted valid.
    fn bands(&self, block: &Block) -> Vec<u8> {
        let Some((horizon, threshold)) = &self.horizon else { return vec![BANDS as u8 - 1; block.positions()] };
        let half = (BANDS / 2) as f64;
        let band = |elevation: f64| {
            let above = elevation - threshold;
            // Conversion rounds down what is not negative.
            let band = (half + above / BAND).clamp(0.0, 2.0 * half - 1.0) as u8;
            // The quotient may round to zero where the difference is negative.
            if above < 0.0 { band.min(BANDS as u8 / 2 - 1) } else { band }
        };
        let mut bands = Vec::with_capacity(block.positions());
        horizon.for_each(block, |elevation| bands.push(band(elevation)));
        bands
    }

    /// The mask that the horizon alone predicts.
    pub(crate) fn predict(&self, block: &Block) -> Vec<bool> {
        let Some((horizon, threshold)) = &self.horizon else { return vec![true; block.positions()] };
        let mut mask = Vec::with_capacity(block.positions());
        horizon.for_each(block, |elevation| mask.push(elevation - threshold >= 0.0));
        mask
    }

    /// Codes masks `[mask][position]` of a block; a decoder overwrites what it is given.
    pub(crate) fn code<C: Coder>(&self, coder: &mut C, contexts: usize, block: &Block, masks: &mut [bool]) {
        let bands = self.bands(block);
        let mut held = std::mem::take(coder);
        let n = block.positions();
        let [_, _, n2, n3] = block.shape;
        let predicted = |band: u8| usize::from(band) >= BANDS / 2;
        let mut context = vec![0; n3];
        for m in 0..masks.len() / n {
            let (done, mask) = masks.split_at_mut(m * n);
            let sister = done.len().checked_sub(n).map(|start| &done[start..]);
            for row in 0..n / n3 {
                let start = row * n3;
                let (done, line) = mask.split_at_mut(start);
                let line = &mut line[..n3];
                let bands = &bands[start..][..n3];
                let above = (row % n2 > 0).then(|| &done[start - n3..][..n3]);
                let sister = sister.map(|sister| &sister[start..][..n3]);
                for (k, context) in context.iter_mut().enumerate() {
                    let known = |row: Option<&[bool]>| row.map_or(predicted(bands[k]), |row| row[k]);
                    *context = bands[k] * 8 + u8::from(known(above)) * 2 + u8::from(known(sister));
                }
                // Runs go in loops of their own, as those of zeros.
                let (mut k, mut left) = (0, predicted(bands[0]));
                while k < n3 {
                    let with_left = contexts + usize::from(left) * 4;
                    while k < n3 {
                        line[k] = held.bit(with_left + usize::from(context[k]), line[k]);
                        if line[k] != left {
                            break;
                        }
                        k += 1;
                    }
                    left = !left;
                    k += 1;
                }
            }
        }
        *coder = held;
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::codec::range::{Decoder, Encoder};
    use crate::table::grid::Grid;
    use proptest::prelude::*;

    /// Section 4.8 of the specification, entry after entry.
    fn by_the_specification(model: &MaskModel, coder: &mut impl Coder, block: &Block, masks: &[bool]) {
        let (bands, n, shape) = (model.bands(block), block.positions(), block.shape);
        for m in 0..masks.len() / n {
            for (p, [_, _, k, l]) in crate::table::block::positions(shape).enumerate() {
                let predicted = bands[p] >= 4;
                let left = if l > 0 { masks[m * n + p - 1] } else { predicted };
                let above = if k > 0 { masks[m * n + p - shape[3]] } else { predicted };
                let sister = if m > 0 { masks[(m - 1) * n + p] } else { predicted };
                let context =
                    usize::from(bands[p]) * 8 + usize::from(left) * 4 + usize::from(above) * 2 + usize::from(sister);
                coder.bit(context, masks[m * n + p]);
            }
        }
    }

    proptest! {
        #[test]
        fn bits_are_those_of_the_specification(
            flips in prop::collection::vec(any::<u16>(), 0..300), threshold in prop::option::of(-0.1f64..0.5), phi in 0usize..140
        ) {
            let block = Block { origin: [0, 60, 45, phi], shape: [1, 5, 4, 40] };
            let n = block.positions();
            let model = MaskModel::new(Horizon::new(&Grid::merl()), threshold);
            let mut masks = [model.predict(&block), model.predict(&block)].concat();
            flips.iter().map(|flip| usize::from(*flip) % (2 * n)).for_each(|at| masks[at] = !masks[at]);
            let probabilities = vec![30000; crate::codec::contexts::MASK_CONTEXTS];
            let [mut plain, mut encoder] = [Encoder::new(&probabilities), Encoder::new(&probabilities)];
            by_the_specification(&model, &mut plain, &block, &masks);
            model.code(&mut encoder, 0, &block, &mut masks);
            prop_assert_eq!(plain.finish(), encoder.finish());
        }

        #[test]
        fn decoding_undoes_coding(flips in prop::collection::vec(any::<u16>(), 0..60), threshold in prop::option::of(-0.1f64..0.5)) {
            let block = Block { origin: [0, 60, 45, 30], shape: [1, 7, 8, 9] };
            let n = block.positions();
            let model = MaskModel::new(Horizon::new(&Grid::merl()), threshold);
            let mut masks = [model.predict(&block), model.predict(&block)].concat();
            for flip in flips {
                let at = usize::from(flip) % (2 * n);
                masks[at] = !masks[at];
            }
            let probabilities = vec![30000; crate::codec::contexts::MASK_CONTEXTS];
            let mut encoder = Encoder::new(&probabilities);
            model.code(&mut encoder, 0, &block, &mut masks.clone());
            let bytes = encoder.finish();
            let mut decoded = vec![false; 2 * n];
            model.code(&mut Decoder::new(&probabilities, &bytes), 0, &block, &mut decoded);
            prop_assert_eq!(decoded, masks);
        }
    }
}
