//! Small damage undone by a checksum alone: where four neighbouring bytes at most are wrong, the CRC-32 shows what they were for every
//! place that they could be at.

/// The reflected polynomial of CRC-32 (spec section 3.1).
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// Four bytes to be combined by exclusive or, and where.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Patch {
    pub(super) at: usize,
    pub(super) change: [u8; 4],
}

impl Patch {
    pub(super) fn apply(self, bytes: &mut [u8]) {
        bytes[self.at..self.at + 4].iter_mut().zip(self.change).for_each(|(byte, change)| *byte ^= change);
    }

    /// Whether it is one bit that changes.
    pub(super) fn is_one_bit(self) -> bool {
        u32::from_le_bytes(self.change).is_power_of_two()
    }

    /// Bits that it takes to write the change down: which of eight for one bit, otherwise the bytes from the first to the last that change.
    pub(super) fn cost(self) -> u32 {
        let last = self.change.iter().rposition(|&c| c != 0).unwrap_or(0);
        if self.is_one_bit() { 3 } else { 8 * (last - (self.place() - self.at) + 1) as u32 }
    }

    /// What was done, for people.
    pub(super) fn describe(self) -> String {
        match self.cost() {
            3 => "one bit was flipped".into(),
            8 => "one byte was mended".into(),
            bits => format!("{} bytes were mended", bits / 8),
        }
    }

    /// Place of the first byte that changes.
    pub(super) fn place(self) -> usize {
        self.at + self.change.iter().position(|&c| c != 0).unwrap_or(0)
    }
}

/// The register before eight zero bits went through it.
fn undo_zero_byte(mut register: u32) -> u32 {
    for _ in 0..8 {
        // The bit that went out was set if the polynomial came in, which its highest bit shows.
        register = if register >> 31 == 1 { (register ^ POLYNOMIAL) << 1 | 1 } else { register << 1 };
    }
    register
}

/// For every place of four bytes in `length` of them, the last first, the one change there that changes their CRC-32 by `difference`
/// (exclusive or).
pub(super) fn patches(length: usize, difference: u32) -> impl Iterator<Item = Patch> {
    // Four bytes that go into a register of zero leave what four zero bytes make of them.
    let start = (0..4).fold(difference, |register, _| undo_zero_byte(register));
    let registers = std::iter::successors(Some(start), |register| Some(undo_zero_byte(*register)));
    let places = (0..(length + 1).saturating_sub(4)).rev();
    places.zip(registers).map(|(at, register)| Patch { at, change: register.to_le_bytes() })
}

/// The one flipped bit that explains the difference, and no other does; it may have been flipped in the checksum itself, which
/// is `Some(None)`.
pub(super) fn one_bit(length: usize, difference: u32) -> Option<Option<Patch>> {
    if difference.is_power_of_two() {
        return Some(None);
    }
    // A bit is within up to four windows.
    let mut found: Option<Patch> = None;
    for patch in patches(length, difference).filter(|patch| patch.is_one_bit()) {
        if found.is_some_and(|other| other.place() != patch.place()) {
            return None;
        }
        found = Some(patch);
    }
    found.map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_flip_of_a_bit_is_undone() {
        let good: Vec<u8> = (0..if cfg!(miri) { 20 } else { 300u32 }).map(|i| ((i * i * 7) >> 3) as u8).collect();
        let crc = crc32fast::hash(&good);
        for bit in 0..8 * good.len() {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            one_bit(bad.len(), crc ^ crc32fast::hash(&bad)).unwrap().unwrap().apply(&mut bad);
            assert!(bad == good, "{bit}");
        }
        for bit in 0..32 {
            assert_eq!(one_bit(good.len(), 1 << bit), Some(None));
        }
    }

    #[test]
    fn any_four_bytes_are_among_the_changes() {
        let good: Vec<u8> = (0..if cfg!(miri) { 20 } else { 100 }).collect();
        for at in 0..good.len() - 3 {
            let mut bad = good.clone();
            bad[at..at + 4].copy_from_slice(&[200, 7, 0xFF, 1]);
            let difference = crc32fast::hash(&good) ^ crc32fast::hash(&bad);
            assert_eq!(one_bit(bad.len(), difference), None);
            let all: Vec<Patch> = patches(bad.len(), difference).collect();
            assert_eq!(all.len(), good.len() - 3);
            // Each of them gives the checksum, one of them the bytes.
            for patch in &all {
                let mut mended = bad.clone();
                patch.apply(&mut mended);
                assert_eq!(crc32fast::hash(&mended), crc32fast::hash(&good));
                assert_eq!(mended == good, patch.at == at);
            }
        }
        assert_eq!(patches(3, 5).count() + patches(0, 5).count(), 0);
    }
}
