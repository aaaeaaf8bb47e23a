//! The contexts of a record's range coder by number: the tables of spec sections 4.6, 4.8, 4.9 and 4.11.
//!
//! Each block of contexts has its first number here and how many they are; what picks one within stands with the code that does.

use super::dependent::Quantization;

/// Components beyond the second share their contexts.
pub(super) const CLASSES: usize = 3;
/// Counts of ones before a number's leading bit, and the bits of the longest number: 24 and none.
pub(crate) const NUMBER_BITS: usize = 25;
/// Levels of the surroundings that choose among the contexts of a magnitude.
pub(super) const MAGNITUDE_LEVELS: usize = 8;
/// Sisters, places and levels that choose among those of whether a coefficient is nonzero.
pub(super) const SIGNIFICANT_EACH: usize = 3 * 4 * 12;

// Coefficients (4.6).
pub(super) const ANY: usize = 0;
pub(super) const EXTENT: usize = ANY + CLASSES;
pub(super) const ROW: usize = EXTENT + CLASSES * 4 * 16;
pub(crate) const SIGNIFICANT: usize = ROW + CLASSES * 3 * 3 * 3;
pub(super) const EXPONENT: usize = SIGNIFICANT + CLASSES * SIGNIFICANT_EACH;
pub(super) const MANTISSA: usize = EXPONENT + CLASSES * MAGNITUDE_LEVELS * NUMBER_BITS;
/// Number of contexts of coefficients, but those of odd states. The grazing profile has no others.
pub(crate) const COEFFICIENTS: usize = MANTISSA + NUMBER_BITS;

// What follows is numbered from its first context.

/// First context of masks (4.8), and their number: eight bands, left, above, sister.
pub(crate) const MASKS: usize = COEFFICIENTS;
pub(super) const MASK_BANDS: usize = 8;
pub(super) const MASK_CONTEXTS: usize = MASK_BANDS * 8;

/// First context of exact zeros (4.9); states of the channel before; number of contexts.
pub(crate) const ZEROS: usize = MASKS + MASK_CONTEXTS;
pub(super) const ZERO_STATES: usize = 4;
pub(super) const ZERO_ANY: usize = 0;
pub(super) const ZERO_ALL: usize = ZERO_ANY + ZERO_STATES;
pub(super) const ZERO_EACH: usize = ZERO_ALL + ZERO_STATES;
pub(super) const ZERO_CONTEXTS: usize = ZERO_EACH + 32;

/// First context of corrections (4.11); kinds of what the channels before say, and slopes; number of contexts.
pub(crate) const CORRECTIONS: usize = ZEROS + ZERO_CONTEXTS;
pub(super) const CORRECTION_KINDS: usize = 1 + 3 + 2 * 3;
pub(super) const CORRECTION_SLOPES: usize = 5;
pub(super) const CORRECTION_ANY: usize = 0;
pub(super) const CORRECTION_ROW: usize = CORRECTION_ANY + 3;
pub(super) const CORRECTION_PRESENT: usize = CORRECTION_ROW + 3 * 3;
pub(super) const CORRECTION_EXPONENT: usize = CORRECTION_PRESENT + CORRECTION_KINDS * CORRECTION_SLOPES * 2;
pub(super) const CORRECTION_MANTISSA: usize = CORRECTION_EXPONENT + 2 * NUMBER_BITS;
pub(super) const CORRECTION_SIGN: usize = CORRECTION_MANTISSA + NUMBER_BITS;
pub(super) const CORRECTION_CONTEXTS: usize = CORRECTION_SIGN + 3 * 3;

/// Number of contexts where all multiples of the step are allowed. (Drafts 1 and 2 end before the zeros.)
const SCALAR: usize = CORRECTIONS + CORRECTION_CONTEXTS;
/// First context of whether a coefficient is nonzero where the state has the odd multiples, and their number. Contexts of their own for the
/// magnitudes there saved less than their probabilities took.
pub(crate) const SIGNIFICANT_ODD: usize = SCALAR;
pub(crate) const ODD_CONTEXTS: usize = EXPONENT - SIGNIFICANT;
/// Number of all contexts, which dependent quantisation has.
pub(crate) const CONTEXTS: usize = SIGNIFICANT_ODD + ODD_CONTEXTS;

/// Number of contexts of a file's range coder.
pub(crate) fn contexts(quantization: Quantization) -> usize {
    match quantization {
        Quantization::Scalar => SCALAR,
        Quantization::Dependent => CONTEXTS,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers of the specification's tables.
    #[test]
    fn numbers_are_those_of_the_specification() {
        assert_eq!([ANY, EXTENT, ROW, SIGNIFICANT, EXPONENT, MANTISSA], [0, 3, 195, 276, 708, 1308]);
        assert_eq!([MASKS, ZEROS, CORRECTIONS, SIGNIFICANT_ODD], [1333, 1397, 1437, 1633]);
        assert_eq!([ZERO_ANY, ZERO_ALL, ZERO_EACH].map(|at| ZEROS + at), [1397, 1401, 1405]);
        let corrections = [
            CORRECTION_ANY,
            CORRECTION_ROW,
            CORRECTION_PRESENT,
            CORRECTION_EXPONENT,
            CORRECTION_MANTISSA,
            CORRECTION_SIGN,
        ];
        assert_eq!(corrections.map(|at| CORRECTIONS + at), [1437, 1440, 1449, 1549, 1599, 1624]);
        assert_eq!([Quantization::Scalar, Quantization::Dependent].map(contexts), [1633, 2065]);
    }
}
