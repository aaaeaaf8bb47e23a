//! The quantised coefficients of a block, as few as they are.

use super::OutOfRange;

/// Those that are not zero, by channel; that at index 0 of each is kept in the file's index, and is not among them.
#[derive(Debug, Default)]
pub(crate) struct Coefficients {
    /// Position in the block, and the integer, in the order of positions.
    entries: Vec<(u32, i32)>,
    /// Where the entries of each channel end.
    ends: Vec<usize>,
    /// Entries that there may be.
    most: usize,
    /// Rows and integers that a decoder went through.
    steps: u64,
    /// Bytes that it could not have.
    refused: Option<u64>,
}

/// Bytes of an entry.
const ENTRY: usize = size_of::<(u32, i32)>();

impl Coefficients {
    pub(crate) fn clear(&mut self) {
        self.entries.clear();
        self.ends.clear();
        self.steps = 0;
    }

    /// None, and room for as many as a number of bytes holds.
    pub(super) fn begin(&mut self, bytes: u64) {
        self.clear();
        self.most = usize::try_from(bytes / ENTRY as u64).unwrap_or(usize::MAX);
        self.refused = None;
    }

    /// Room for `more`. How many there are is known when they are decoded only.
    #[inline(always)]
    pub(super) fn make_room(&mut self, more: usize) -> Result<(), OutOfRange> {
        self.count_steps(more);
        let all = self.entries.len() + more;
        if all <= self.entries.capacity() && all <= self.most {
            return Ok(());
        }
        self.grow(more)
    }

    #[cold]
    fn grow(&mut self, more: usize) -> Result<(), OutOfRange> {
        let all = self.entries.len() + more;
        if all > self.most || self.entries.try_reserve(more).is_err() {
            self.refused = Some((all as u64).saturating_mul(ENTRY as u64));
            return Err(OutOfRange);
        }
        Ok(())
    }

    /// Bytes that the last decode could not have, if it ended for that.
    pub(super) fn refused(&mut self) -> Option<u64> {
        self.refused.take()
    }

    #[inline(always)]
    pub(super) fn count_steps(&mut self, steps: usize) {
        self.steps += steps as u64;
    }

    /// Rows and integers that the decoder went through.
    pub(crate) fn steps(&self) -> u64 {
        self.steps
    }

    /// How many there are.
    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    /// What it takes in memory.
    pub(crate) fn bytes(&self) -> usize {
        self.entries.capacity() * ENTRY + self.ends.capacity() * size_of::<usize>()
    }

    /// Adds one to the channel at hand, beyond those that it has.
    #[inline(always)]
    pub(super) fn push(&mut self, position: usize, q: i32) {
        // A block has at most 2^21 positions.
        self.entries.push((position as u32, q));
    }

    pub(super) fn end_channel(&mut self) {
        self.ends.push(self.entries.len());
    }

    /// Those of a channel; none where none were coded.
    pub(crate) fn of_channel(&self, channel: usize) -> &[(u32, i32)] {
        let start = channel.checked_sub(1).and_then(|before| self.ends.get(before).copied()).unwrap_or(0);
        self.ends.get(channel).map_or(&[], |&end| &self.entries[start..end])
    }

    /// Those of planes of `positions` positions, `[channel][position]`.
    #[cfg(feature = "encode")]
    pub(crate) fn of_planes(planes: &[i32], positions: usize) -> Coefficients {
        let mut coefficients = Coefficients { most: usize::MAX, ..Coefficients::default() };
        for plane in planes.chunks_exact(positions) {
            let nonzero = plane.iter().enumerate().skip(1).filter(|(_, q)| **q != 0);
            nonzero.for_each(|(position, &q)| coefficients.push(position, q));
            coefficients.end_channel();
        }
        coefficients
    }

    /// Planes of all channels, `[channel][position]`, zero where nothing is.
    #[cfg(feature = "encode")]
    pub(crate) fn to_planes(&self, channels: usize, positions: usize) -> crate::base::error::Result<Vec<i32>> {
        let mut planes = crate::base::budget::filled(0, channels * positions)?;
        for (channel, plane) in planes.chunks_exact_mut(positions).enumerate() {
            self.of_channel(channel).iter().for_each(|&(position, q)| plane[position as usize] = q);
        }
        Ok(planes)
    }
}
