//! The quantised coefficients of a block, as few as they are.

/// Those that are not zero, by channel; that at index 0 of each is kept in the file's index, and is not among them.
#[derive(Debug, Default)]
pub(crate) struct Coefficients {
    /// Position in the block, and the integer, in the order of positions.
    entries: Vec<(u32, i32)>,
    /// Where the entries of each channel end.
    ends: Vec<usize>,
}

impl Coefficients {
    pub(crate) fn clear(&mut self) {
        self.entries.clear();
        self.ends.clear();
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

    /// Those of planes of so many positions, `[channel][position]`.
    #[cfg(feature = "encode")]
    pub(crate) fn of_planes(planes: &[i32], positions: usize) -> Coefficients {
        let mut coefficients = Coefficients::default();
        for plane in planes.chunks_exact(positions) {
            let nonzero = plane.iter().enumerate().skip(1).filter(|(_, q)| **q != 0);
            nonzero.for_each(|(position, &q)| coefficients.push(position, q));
            coefficients.end_channel();
        }
        coefficients
    }

    /// Planes of all channels, `[channel][position]`, zero where nothing is.
    #[cfg(feature = "encode")]
    pub(crate) fn to_planes(&self, channels: usize, positions: usize) -> Vec<i32> {
        let mut planes = vec![0; channels * positions];
        for (channel, plane) in planes.chunks_exact_mut(positions).enumerate() {
            self.of_channel(channel).iter().for_each(|&(position, q)| plane[position as usize] = q);
        }
        planes
    }
}
