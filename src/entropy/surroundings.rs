//! What the contexts of a coefficient depend on (spec section 4.6).

use super::{Coded, EXPONENT, EXPONENTS, Extents, MAGNITUDE_LEVELS, SIGNIFICANT, SIGNIFICANT_ODD};
use crate::dependent::State;

const LEVELS: usize = 12;
const POSITIONS: usize = 4;
const SISTERS: usize = 3;
/// Contexts of whether a coefficient is nonzero, of a channel.
pub(super) const CONTEXTS: usize = SISTERS * POSITIONS * LEVELS;

/// Level of a weighted sum of neighbouring magnitudes, 0 to 11. All from 29 on are one: sums may end at 255.
#[inline(always)]
const fn level(sum: u8) -> u8 {
    let small = if sum < 6 { sum } else { 6 };
    small + (sum >= 7) as u8 + (sum >= 9) as u8 + (sum >= 12) as u8 + (sum >= 17) as u8 + (sum >= 29) as u8
}

static LEVEL: [u8; 256] = {
    let mut table = [0; 256];
    let mut sum = 0;
    while sum < 256 {
        table[sum] = level(sum as u8);
        sum += 1;
    }
    table
};

/// Coefficients of a row whose surroundings are looked at together: bytes of a vector.
pub(crate) const WIDTH: usize = 16;

/// Offsets to the neighbouring rows in the padded magnitudes.
#[derive(Clone, Copy)]
pub(super) struct Neighbours {
    pub(super) above: usize,
    pub(super) before: usize,
    pub(super) outer: usize,
}

/// Fills in the quarter of each sum of frequencies among those that the extents allow, and as many more as a step may go beyond.
pub(super) fn quarters(extents: Extents, quarters: &mut Vec<u8>) {
    let total: usize = extents.iter().sum();
    quarters.clear();
    for quarter in 0..POSITIONS {
        quarters.resize(((quarter + 1) * total).div_ceil(POSITIONS), quarter as u8);
    }
    quarters.resize(total + WIDTH, POSITIONS as u8 - 1);
}

/// What is known of the coefficients of a step before its row is coded.
pub(crate) struct Step {
    class: usize,
    /// Weighted sums of the neighbours' magnitudes on rows coded before.
    sums: [u8; WIDTH],
    /// Magnitudes at the same place in the channel before.
    sisters: [u8; WIDTH],
    /// Contexts of whether the coefficient is nonzero, less the level; and with that of the sum alone.
    contexts: [u8; WIDTH],
    quiet: [u8; WIDTH],
}

/// Numbers that end at 255.
#[inline(always)]
fn plus(mut a: [u8; WIDTH], b: [u8; WIDTH]) -> [u8; WIDTH] {
    for i in 0..WIDTH {
        a[i] = a[i].saturating_add(b[i]);
    }
    a
}

impl Step {
    /// From a place in the padded magnitudes on; `quarters` begin at the first coefficient's.
    #[inline(always)]
    pub(super) fn new(
        class: usize,
        now: &Coded,
        sister: &Coded,
        at: usize,
        neighbours: Neighbours,
        quarters: &[u8],
    ) -> Step {
        let bytes = |from: &[u8], at: usize| -> [u8; WIDTH] { std::array::from_fn(|i| from[at..][..WIDTH][i]) };
        let Neighbours { above, before, outer } = neighbours;
        let magnitudes = &now.magnitudes[..];
        let twice = plus(bytes(magnitudes, at - above), bytes(magnitudes, at - before));
        let mut sums = plus(twice, twice);
        for once in [at - above + 1, at - before + 1, at - before + above, at - outer] {
            sums = plus(sums, bytes(magnitudes, once));
        }
        let sisters = bytes(&sister.magnitudes, at);
        let mut contexts = bytes(quarters, 0);
        for i in 0..WIDTH {
            contexts[i] += sisters[i].min(SISTERS as u8 - 1) * POSITIONS as u8;
        }
        contexts.iter_mut().for_each(|context| *context *= LEVELS as u8);
        let mut quiet = [0; WIDTH];
        for i in 0..WIDTH {
            quiet[i] = sums[i].min(6);
        }
        for start in [7, 9, 12, 17, 29] {
            for i in 0..WIDTH {
                quiet[i] += u8::from(sums[i] >= start);
            }
        }
        for i in 0..WIDTH {
            quiet[i] += contexts[i];
        }
        Step { class, sums, sisters, contexts, quiet }
    }

    /// Context of whether the coefficient is nonzero, with the two magnitudes before it on the row.
    #[inline(always)]
    pub(crate) fn significant(&self, i: usize, [one, two]: [u32; 2], state: State) -> usize {
        let base = if state.is_odd() { SIGNIFICANT_ODD } else { SIGNIFICANT };
        // Mostly so: the processor then need not wait for a sum and its level.
        let context = if one | two == 0 {
            self.quiet[i]
        } else {
            self.contexts[i] + LEVEL[(u32::from(self.sums[i]) + 2 * one + two).min(255) as usize]
        };
        base + self.class * CONTEXTS + usize::from(context)
    }

    /// First context of its magnitude.
    #[inline(always)]
    pub(crate) fn exponents(&self, i: usize, [one, two]: [u32; 2]) -> usize {
        let sum = u32::from(self.sums[i]) + 2 * one + two + 3 * u32::from(self.sisters[i]);
        let level = usize::from(LEVEL[sum.min(255) as usize]).saturating_sub(3).min(MAGNITUDE_LEVELS - 1);
        EXPONENT + (self.class * MAGNITUDE_LEVELS + level) * EXPONENTS
    }
}
