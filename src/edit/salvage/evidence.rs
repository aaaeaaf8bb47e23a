//! What proves a mend: how sure it is, in bits, that bytes which were changed are those that were there.
//!
//! A CRC-32 that was used to find a change proves no more than what the choice left of it. Every place of four bytes has one change that
//! gives the right sum, so a sum that named such a change proves nothing; of the 8 n changes of one bit of n bytes one in
//! 2^32 / (8 n) gives it by chance. A mend has `e` bits of evidence if damage that it does not undo passes for damage that it does with a
//! probability of at most 2^-e. *Restored* is said from [`WANTED`] bits on; what has fewer is lost, unless the caller asks for less.
//!
//! - **A record, a section, the spare copy, as they are**: their own sum, 32 bits, nothing was chosen. (In a file of another length a
//!   record is also looked for at the same distance from the end: two places for all records together.)
//! - **A change in INDX**: `32 - c - log2 n - 2 + b` bits, where c is what the change takes to write down (3 bits for one bit, 8 for each
//!   byte from the first to the last that changes), n the bytes of the section, 2 for the kinds of changes that are tried, and b the bits
//!   that the records prove behind it: [`lengths`](super::index). With c = 32 the sum counts for nothing and b for all. Once the change
//!   is proven, the sum counts again for all that was not changed, to the last mean: other damage would have led to another change.
//! - **INDX without a change**: nothing: damage in the plain start of its coder shows in no length behind it.
//! - **One bit of another section**: the bits of it that nothing else vouches for, u of them, are where a wrong mend can hide: what it
//!   leaves wrong has a sum of zero, so it does not fit into 32 neighbouring bits ([`of_one_bit`] gives 32 then), and of others one in 2^32 / u
//!   is taken for one bit. What vouches for a field: that its value is the usual one of few ([`usual`](super::usual)), that records decode with
//!   it, or checksums of what it says. Records prove 8 bits at most: many do not use what is wrong.
//! - **One bit of the section table**: the checksum and the length of the section whose entry it is, or the one value that a field can have.

use super::Outcome;

/// Bits of evidence from which on a mend is said to be certain.
pub const WANTED: u32 = 32;

/// Bits of evidence of a mend that a checksum alone proves, of one flipped bit among `unvouched` ones that nothing else vouches for. `span`
/// bits lie from the first to the last of these.
pub(super) fn of_one_bit(unvouched: u64, span: u64) -> u32 {
    if span <= 32 { WANTED } else { 32u32.saturating_sub(bits_to_choose(unvouched)) }
}

/// Bits that it takes to name one of `n`, rounded up.
pub(super) fn bits_to_choose(n: u64) -> u32 {
    u64::BITS - n.saturating_sub(1).leading_zeros()
}

/// What becomes of a mend with this many bits of evidence.
pub(super) fn outcome(bits: u32) -> Outcome {
    if bits >= WANTED { Outcome::Restored } else { Outcome::Assumed { bits } }
}

/// Bits of evidence that a checksum alone gives for one flipped bit among `bytes` bytes.
pub(super) fn evidence_of_bit(bytes: usize) -> u32 {
    32u32.saturating_sub(bits_to_choose(8 * bytes as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choosing_takes_the_logarithm() {
        assert_eq!([0, 1, 2, 3, 4, 5, 1 << 20, (1 << 20) + 1].map(bits_to_choose), [0, 0, 1, 2, 2, 3, 20, 21]);
        assert_eq!(
            (of_one_bit(32, 32), of_one_bit(0, 0), of_one_bit(33, 33), of_one_bit(1024, 1024)),
            (32, 32, 26, 22)
        );
    }
}
