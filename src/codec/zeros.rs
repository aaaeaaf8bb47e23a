//! Entries whose measured value is exactly zero (spec section 4.9).
//!
//! Where a measurement fell below its floor, its logarithm has an edge that no sparse spectrum holds. Such entries are
//! marked by a mask and decode to exactly zero; to the transform they are holes.

use crate::base::budget::lengthen;
use crate::base::error::Result;
use crate::codec::contexts::{ZERO_ALL, ZERO_ANY, ZERO_EACH};
use crate::codec::range::Coder;

/// States of a channel's zeros within a block, and that of "no channel before", four in all.
const NONE: usize = 0;
const SOME: usize = 1;
const ALL: usize = 2;
const FIRST: usize = 3;

/// Bits of a context: whether the one before on the row is zero, and the one before that.
const LAST: usize = 1;
const SECOND: usize = 1 << 4;
const INVALID: u8 = 255;

/// Codes which of a block's valid entries are zero, `[channel][position]`, of no others; empty stands for none, and is what a decoder
/// leaves where the stream says so.
/// `masks` is the validity of all channels, or of each; nobody asks for it where nothing is zero.
/// One function of 86 lines: encoder and decoder walk the same contexts, and a part would take all of them along.
pub(crate) fn code_zeros<'a, C: Coder>(
    coder: &mut C,
    contexts: usize,
    shape: [usize; 4],
    channels: usize,
    masks: impl FnOnce() -> &'a [bool],
    zeros: &mut Vec<bool>,
) -> Result<()> {
    let n: usize = shape.iter().product();
    let [_, n1, n2, n3] = shape;
    let (mut masks, mut asked) = (Some(masks), None);
    if C::READS {
        zeros.clear();
    }
    let (nothing, mut around) = (vec![false; n3], vec![0; n3]);
    let mut before = FIRST;
    for channel in 0..channels {
        let given = if C::READS { &[] } else { zeros.get(channel * n..(channel + 1) * n).unwrap_or_default() };
        let any = coder.bit(contexts + ZERO_ANY + before, given.contains(&true));
        if !any {
            before = NONE;
            continue;
        }
        if C::READS {
            lengthen(zeros, channels * n, false)?;
        }
        if let Some(masks) = masks.take() {
            asked = Some(masks());
        }
        let masks = asked.unwrap_or_default();
        let valid = if masks.len() == n { masks } else { &masks[channel * n..(channel + 1) * n] };
        let (done, zeros) = zeros.split_at_mut(channel * n);
        let zeros = &mut zeros[..n];
        let sister = done.len().checked_sub(n).map(|start| &done[start..]);
        let lacking = zeros.iter().zip(valid).any(|(z, v)| !*z && *v);
        let full = coder.bit(contexts + ZERO_ALL + before, !lacking);
        if full {
            before = ALL;
            zeros.copy_from_slice(valid);
            continue;
        }
        before = SOME;
        let mut held = std::mem::take(coder);
        for row in 0..n / n3 {
            let start = row * n3;
            let (done, line) = zeros.split_at_mut(start);
            let line = &mut line[..n3];
            let above = if row % n2 > 0 { &done[start - n3..][..n3] } else { &nothing[..] };
            let outer = if row / n2 % n1 > 0 { &done[start - n3 * n2..][..n3] } else { &nothing[..] };
            let sister = sister.map_or(&nothing[..], |sister| &sister[start..][..n3]);
            let valid = &valid[start..][..n3];
            // What is known of each entry but those on the row; nothing is coded of what is no valid one.
            for (k, around) in around.iter_mut().enumerate() {
                let context = u8::from(above[k]) << 1 | u8::from(outer[k]) << 2 | u8::from(sister[k]) << 3;
                *around = if valid[k] { context } else { INVALID };
            }
            let around = &around[..n3];
            // By whether the two before on the row are zero. Runs go in loops of their own: the processor then guesses what comes of a
            // decision, where it would wait for it to know the next one's context.
            let (mut k, mut before) = (0, [false, false]);
            while k < n3 {
                before = match before {
                    [false, false] => {
                        while k < n3 && !code(&mut held, contexts, around[k], 0, &mut line[k]) {
                            k += 1;
                        }
                        [true, false]
                    }
                    [true, true] => {
                        while k < n3 && code(&mut held, contexts, around[k], LAST | SECOND, &mut line[k]) {
                            k += 1;
                        }
                        [false, true]
                    }
                    [last, _] => {
                        let two = if last { LAST } else { SECOND };
                        [code(&mut held, contexts, around[k], two, &mut line[k]), last]
                    }
                };
                k += 1;
            }
        }
        *coder = held;
    }
    Ok(())
}

/// Whether an entry is zero, by what is around it and whether the two before on the row are.
#[inline(always)]
fn code<C: Coder>(coder: &mut C, contexts: usize, around: u8, two_before: usize, zero: &mut bool) -> bool {
    *zero = around != INVALID && coder.bit(contexts + ZERO_EACH + (usize::from(around) | two_before), *zero);
    *zero
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::codec::range::{Decoder, Encoder};
    use proptest::prelude::*;

    /// Section 4.9 of the specification, entry after entry.
    fn by_the_specification(
        coder: &mut impl Coder,
        shape: [usize; 4],
        channels: usize,
        masks: &[bool],
        zeros: &[bool],
    ) {
        let n: usize = shape.iter().product();
        let mut before = FIRST;
        for channel in 0..channels {
            let (start, mask) = (channel * n, channel * n % masks.len());
            let of_channel = &zeros[start..start + n];
            let any = coder.bit(ZERO_ANY + before, of_channel.contains(&true));
            let all = any && coder.bit(ZERO_ALL + before, of_channel == &masks[mask..mask + n]);
            before = [NONE, SOME, ALL][usize::from(any) + usize::from(all)];
            if !any || all {
                continue;
            }
            for (p, [i, j, k, l]) in crate::table::block::positions(shape).enumerate() {
                let at = |[i, j, k, l]: [usize; 4]| of_channel[((i * shape[1] + j) * shape[2] + k) * shape[3] + l];
                let bits = [
                    l > 0 && at([i, j, k, l - 1]),
                    k > 0 && at([i, j, k - 1, l]),
                    j > 0 && at([i, j - 1, k, l]),
                    channel > 0 && zeros[start - n + p],
                    l > 1 && at([i, j, k, l - 2]),
                ];
                if masks[mask + p] {
                    let context: usize = bits.iter().enumerate().map(|(bit, set)| usize::from(*set) << bit).sum();
                    coder.bit(ZERO_EACH + context, of_channel[p]);
                }
            }
        }
    }

    proptest! {
        #[test]
        fn bits_are_those_of_the_specification(
            shape in (1usize..3, 1usize..4, 1usize..4, 1usize..40), channels in 1usize..4, common in any::<bool>(), seed in any::<u64>(),
            runs in 1u64..20
        ) {
            let shape = <[usize; 4]>::from(shape);
            let n: usize = shape.iter().product();
            let mut random = crate::codec::sample::SplitMix64(seed);
            let masks: Vec<bool> = (0..if common { n } else { channels * n }).map(|_| !random.next_u64().is_multiple_of(9)).collect();
            let mut zero = false;
            let zeros: Vec<bool> = (0..channels * n)
                .map(|i| {
                    zero ^= random.next_u64().is_multiple_of(runs);
                    zero && masks[i % masks.len()]
                })
                .collect();
            let probabilities: Vec<u16> = (0..crate::codec::contexts::ZERO_CONTEXTS).map(|_| random.next_u64() as u16 | 1).collect();
            let [mut plain, mut encoder] = [Encoder::new(&probabilities), Encoder::new(&probabilities)];
            by_the_specification(&mut plain, shape, channels, &masks, &zeros);
            code_zeros(&mut encoder, 0, shape, channels, || &masks, &mut zeros.clone()).unwrap();
            prop_assert_eq!(plain.finish(), encoder.finish());
        }

        #[test]
        fn decoding_undoes_coding(
            shape in prop::array::uniform4(1usize..5), channels in 1usize..4, common in any::<bool>(), seed in any::<u64>(),
            density in 0u64..5
        ) {
            let n: usize = shape.iter().product();
            let mut random = crate::codec::sample::SplitMix64(seed);
            let masks: Vec<bool> = (0..if common { n } else { channels * n }).map(|_| !random.next_u64().is_multiple_of(4)).collect();
            let zeros: Vec<bool> = (0..channels * n)
                .map(|i| random.next_u64() % 4 < density && masks[i % masks.len()])
                .collect();
            let probabilities = vec![30000; crate::codec::contexts::ZERO_CONTEXTS];
            let mut encoder = Encoder::new(&probabilities);
            code_zeros(&mut encoder, 0, shape, channels, || &masks, &mut zeros.clone()).unwrap();
            let bytes = encoder.finish();
            let mut decoded = vec![true; 5];
            code_zeros(&mut Decoder::new(&probabilities, &bytes), 0, shape, channels, || &masks, &mut decoded).unwrap();
            prop_assert_eq!(decoded, if zeros.contains(&true) { zeros } else { Vec::new() });
        }
    }
}
