//! Entries whose measured value is exactly zero (spec section 4.9).
//!
//! Where a measurement fell below its floor, its logarithm has an edge that no sparse spectrum holds. Such entries are
//! told apart by a mask and decode to exactly zero; to the transform they are holes.

use crate::range::Coder;

/// States of a channel's zeros within a block, and that of "no channel before".
const STATES: usize = 4;
const NONE: usize = 0;
const SOME: usize = 1;
const ALL: usize = 2;
const FIRST: usize = 3;

const ANY_ZERO: usize = 0;
const ALL_ZERO: usize = ANY_ZERO + STATES;
const ZERO: usize = ALL_ZERO + STATES;
/// Number of contexts for zeros.
pub(crate) const CONTEXTS: usize = ZERO + 32;

/// Codes which of a block's valid entries are zero, `[channel][position]`; empty if none is, as a decoder leaves it then.
/// `masks` is the validity of all channels, or of each; nobody asks for it where nothing is zero.
pub(crate) fn code_zeros<'a, C: Coder>(
    coder: &mut C,
    contexts: usize,
    shape: [usize; 4],
    channels: usize,
    masks: impl FnOnce() -> &'a [bool],
    zeros: &mut Vec<bool>,
) {
    let n: usize = shape.iter().product();
    let [_, n1, n2, n3] = shape;
    let (mut masks, mut told) = (Some(masks), None);
    if C::READS {
        zeros.clear();
    }
    let mut before = FIRST;
    for channel in 0..channels {
        let given = if C::READS { &[] } else { zeros.get(channel * n..(channel + 1) * n).unwrap_or_default() };
        let any = coder.bit(contexts + ANY_ZERO + before, given.contains(&true));
        if !any {
            before = NONE;
            continue;
        }
        if C::READS {
            zeros.resize(channels * n, false);
        }
        if let Some(masks) = masks.take() {
            told = Some(masks());
        }
        let masks = told.unwrap_or_default();
        let valid = if masks.len() == n { masks } else { &masks[channel * n..(channel + 1) * n] };
        let (done, zeros) = zeros.split_at_mut(channel * n);
        let zeros = &mut zeros[..n];
        let sister = done.len().checked_sub(n).map(|start| &done[start..]);
        let lacking = zeros.iter().zip(valid).any(|(z, v)| !*z && *v);
        let full = coder.bit(contexts + ALL_ZERO + before, !lacking);
        if full {
            before = ALL;
            zeros.copy_from_slice(valid);
            continue;
        }
        before = SOME;
        for i in 0..n {
            if !valid[i] {
                zeros[i] = false;
                continue;
            }
            let (k, j, plane) = (i % n3, i / n3 % n2, i / (n3 * n2) % n1);
            let context = usize::from(k > 0 && zeros[i - 1])
                | usize::from(j > 0 && zeros[i - n3]) << 1
                | usize::from(plane > 0 && zeros[i - n3 * n2]) << 2
                | usize::from(sister.is_some_and(|s| s[i])) << 3
                | usize::from(k > 1 && zeros[i - 2]) << 4;
            zeros[i] = coder.bit(contexts + ZERO + context, zeros[i]);
        }
    }
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::range::{Decoder, Encoder};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decoding_undoes_coding(
            shape in prop::array::uniform4(1usize..5), channels in 1usize..4, common in any::<bool>(), seed in any::<u64>(),
            density in 0u64..5
        ) {
            let n: usize = shape.iter().product();
            let mut random = crate::sample::SplitMix64(seed);
            let masks: Vec<bool> = (0..if common { n } else { channels * n }).map(|_| !random.next_u64().is_multiple_of(4)).collect();
            let zeros: Vec<bool> = (0..channels * n)
                .map(|i| random.next_u64() % 4 < density && masks[i % masks.len()])
                .collect();
            let probabilities = vec![30000; CONTEXTS];
            let mut encoder = Encoder::new(&probabilities);
            code_zeros(&mut encoder, 0, shape, channels, || &masks, &mut zeros.clone());
            let bytes = encoder.finish();
            let mut decoded = vec![true; 5];
            code_zeros(&mut Decoder::new(&probabilities, &bytes), 0, shape, channels, || &masks, &mut decoded);
            prop_assert_eq!(decoded, if zeros.contains(&true) { zeros } else { Vec::new() });
        }
    }
}
