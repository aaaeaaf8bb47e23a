//! What the contexts of a coefficient depend on (spec section 4.6).

use super::{Coded, Extents};
use crate::codec::contexts::{EXPONENT, MAGNITUDE_LEVELS, NUMBER_BITS, SIGNIFICANT, SIGNIFICANT_EACH, SIGNIFICANT_ODD};
use crate::codec::dependent::State;

const LEVELS: usize = 12;
const POSITIONS: usize = 4;
const SISTERS: usize = 3;
const _: () = assert!(SISTERS * POSITIONS * LEVELS == SIGNIFICANT_EACH);

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
            quiet[i] = contexts[i] + level(sums[i]);
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
        base + self.class * SIGNIFICANT_EACH + usize::from(context)
    }

    /// First context of its magnitude.
    #[inline(always)]
    pub(crate) fn exponents(&self, i: usize, [one, two]: [u32; 2]) -> usize {
        let sum = u32::from(self.sums[i]) + 2 * one + two + 3 * u32::from(self.sisters[i]);
        let level = usize::from(LEVEL[sum.min(255) as usize]).saturating_sub(3).min(MAGNITUDE_LEVELS - 1);
        EXPONENT + (self.class * MAGNITUDE_LEVELS + level) * NUMBER_BITS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Place of a coefficient in magnitudes that are padded as the walk does it, by its indices plus one.
    fn place([_, n1, n2, n3]: [usize; 4], [i, j, k, l]: [usize; 4]) -> usize {
        ((i * (n1 + 1) + j) * (n2 + 2) + k) * (n3 + 3) + l + 1
    }

    fn coded(shape: [usize; 4], magnitudes: &[u8]) -> Coded {
        let mut coded = Coded::default();
        coded.reserve(super::super::padded(shape)).unwrap();
        for (at, magnitude) in crate::table::block::positions(shape).zip(magnitudes) {
            coded.magnitudes[place(shape, at.map(|at| at + 1))] = *magnitude;
        }
        coded
    }

    proptest! {
        /// Section 4.6 of the specification, for one coefficient after the other.
        #[test]
        fn contexts_are_those_of_the_specification(
            shape in (1usize..4, 1usize..4, 1usize..5, 1usize..40), class in 0usize..3, seed in any::<u64>(), zeros in 0u64..10,
            one in prop_oneof![0u32..4, 0u32..256], two in prop_oneof![0u32..4, 0u32..256], steps in 0usize..4
        ) {
            let shape = <[usize; 4]>::from(shape);
            let mut random = crate::codec::sample::SplitMix64(seed);
            let n: usize = shape.iter().product();
            let mut magnitude = || match (random.next_u64() % 10, random.next_u64()) {
                (kind, _) if kind < zeros => 0,
                (9, any) => any as u8,
                (_, any) => (any % 6) as u8,
            };
            let magnitudes: [Vec<u8>; 2] = std::array::from_fn(|_| (0..n).map(|_| magnitude()).collect());
            let index = |[i, j, k, l]: [usize; 4]| ((i * shape[1] + j) * shape[2] + k) * shape[3] + l;
            let [now, sister] = [0, 1].map(|channel| coded(shape, &magnitudes[channel]));
            let mut all_quarters = Vec::new();
            quarters(shape, &mut all_quarters);
            let [origin, above, before, outer] = [[1; 4], [1, 1, 0, 1], [1, 0, 1, 1], [0, 1, 1, 1]].map(|at| place(shape, at));
            let neighbours = Neighbours { above: origin - above, before: origin - before, outer: origin - outer };
            let from = (steps * WIDTH).min((shape[3] - 1) / WIDTH * WIDTH);
            for at in crate::table::block::positions(shape).filter(|at| at[3] == from) {
                let [i, j, k, _] = at;
                let start = place(shape, at.map(|at| at + 1));
                let step = Step::new(class, &now, &sister, start, neighbours, &all_quarters[i + j + k + from..]);
                for l in from..shape[3].min(from + WIDTH) {
                    let m = |di: usize, dj: usize, dk: usize, l: usize| match (i.checked_sub(di), j.checked_sub(dj), k.checked_sub(dk)) {
                        (Some(i), Some(j), Some(k)) if l < shape[3] => u32::from(magnitudes[0][index([i, j, k, l])]),
                        _ => 0,
                    };
                    // j - 1 and k + 1: of the row before along the second axis.
                    let diagonal = if j > 0 && k + 1 < shape[2] { u32::from(magnitudes[0][index([i, j - 1, k + 1, l])]) } else { 0 };
                    let sum = 2 * (one + m(0, 0, 1, l) + m(0, 1, 0, l)) + two + m(0, 0, 1, l + 1) + m(0, 1, 0, l + 1) + diagonal
                        + m(1, 0, 0, l);
                    let sister = u32::from(magnitudes[1][index([i, j, k, l])]);
                    let level = |sum: u32| match sum {
                        0..=6 => sum as usize,
                        7..=8 => 7,
                        9..=11 => 8,
                        12..=16 => 9,
                        17..=28 => 10,
                        _ => 11,
                    };
                    let place = (4 * (i + j + k + l) / shape.iter().sum::<usize>()).min(3);
                    let context = ((class * 3 + sister.min(2) as usize) * 4 + place) * 12 + level(sum);
                    let mut state = State::default();
                    prop_assert_eq!(step.significant(l - from, [one, two], state), SIGNIFICANT + context);
                    state = state.after(1);
                    prop_assert_eq!(step.significant(l - from, [one, two], state), SIGNIFICANT_ODD + context);
                    let magnitude = level(sum + 3 * sister).saturating_sub(3).min(7);
                    prop_assert_eq!(step.exponents(l - from, [one, two]), EXPONENT + (class * 8 + magnitude) * 25);
                }
            }
        }
    }
}
