//! Which blocks of a file a scene has looked at, to keep only those: `csbrdf prune`.

use std::fmt::Write as _;

use crate::error::{Error, Result};

/// First line of a trace.
const TITLE: &str = "csbrdf trace 1";

/// A set of blocks of one file.
///
/// As text, a *trace*: the title, a line `blocks N index X` with the number of the file's blocks and the CRC-32 of its index in
/// hexadecimal, then block numbers from 0 or ranges `FIRST-LAST` of them, in ascending order, one a line. Lines that begin with #
/// are comments.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Touched {
    blocks: Vec<bool>,
    index_crc: u32,
}

impl Touched {
    pub(crate) fn new(blocks: Vec<bool>, index_crc: u32) -> Touched {
        Touched { blocks, index_crc }
    }

    /// Whether each block was looked at.
    pub fn blocks(&self) -> &[bool] {
        &self.blocks
    }

    /// CRC-32 of the file's index section: traces of one file can be told from those of another.
    pub fn index_crc(&self) -> u32 {
        self.index_crc
    }

    /// Number of blocks that were looked at.
    pub fn count(&self) -> usize {
        self.blocks.iter().filter(|t| **t).count()
    }

    /// Adds what another trace of the same file touched.
    ///
    /// # Errors
    /// `InvalidArgument` if it is of another file.
    pub fn merge(&mut self, other: &Touched) -> Result<()> {
        self.check(other.blocks.len(), other.index_crc)?;
        self.blocks.iter_mut().zip(&other.blocks).for_each(|(touched, other)| *touched |= *other);
        Ok(())
    }

    /// Fails unless the trace is of a file with so many blocks and this sum of its index.
    pub(crate) fn check(&self, blocks: usize, index_crc: u32) -> Result<()> {
        if (self.blocks.len(), self.index_crc) == (blocks, index_crc) {
            return Ok(());
        }
        Err(Error::InvalidArgument(format!(
            "the trace is of another file: {} blocks with index {:08x}, the file has {blocks} with {index_crc:08x}; trace the scene \
             again with this file",
            self.blocks.len(),
            self.index_crc
        )))
    }

    /// The trace as text.
    pub fn to_text(&self) -> String {
        let mut text = format!("{TITLE}\nblocks {} index {:08x}\n", self.blocks.len(), self.index_crc);
        let mut at = 0;
        while let Some(first) = (at..self.blocks.len()).find(|&b| self.blocks[b]) {
            at = (first..self.blocks.len()).find(|&b| !self.blocks[b]).unwrap_or(self.blocks.len());
            // Writing to a string does not fail.
            let _ = match at - 1 {
                last if last > first => writeln!(text, "{first}-{last}"),
                _ => writeln!(text, "{first}"),
            };
        }
        text
    }

    /// Reads a trace.
    ///
    /// # Errors
    /// `Corrupt` with the offset of the line that cannot be read.
    pub fn from_text(text: &str) -> Result<Touched> {
        let mut offset = 0;
        let mut lines = text.split_inclusive('\n').map(|line| {
            let at = offset;
            offset += line.len() as u64;
            (at, line.trim())
        });
        let corrupt = |at: u64, what: String| Error::corrupt("trace", at, what);
        match lines.next() {
            Some((_, TITLE)) => {}
            _ => return Err(corrupt(0, format!("the first line is not `{TITLE}`"))),
        }
        let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let (at, line) = lines.next().unwrap_or((text.len() as u64, ""));
        let numbers = line.strip_prefix("blocks ").and_then(|rest| rest.split_once(" index "));
        let numbers = numbers.and_then(|(n, crc)| Some((n.parse().ok()?, u32::from_str_radix(crc, 16).ok()?)));
        let (count, index_crc): (usize, u32) =
            numbers.ok_or_else(|| corrupt(at, format!("`{line}` is not `blocks N index X`")))?;
        if count > crate::format::MAX_BLOCKS {
            return Err(corrupt(at, format!("{count} blocks, a file has {} at most", crate::format::MAX_BLOCKS)));
        }
        let mut blocks = vec![false; count];
        let mut next = 0;
        for (at, line) in lines {
            let (first, last) = line.split_once('-').unwrap_or((line, line));
            let range = first.parse::<usize>().ok().zip(last.parse::<usize>().ok());
            let Some((first, last)) = range.filter(|&(first, last)| next <= first && first <= last && last < count)
            else {
                return Err(corrupt(
                    at,
                    format!("`{line}` is not a block or range of blocks from {next} to {count} excluded"),
                ));
            };
            blocks[first..=last].fill(true);
            next = last + 1;
        }
        Ok(Touched { blocks, index_crc })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn text_comes_back(blocks in prop::collection::vec(any::<bool>(), 0..200), index_crc: u32) {
            let touched = Touched { blocks, index_crc };
            prop_assert_eq!(Touched::from_text(&touched.to_text()).unwrap(), touched);
        }

        #[test]
        fn any_text_is_read_or_refused(text in "(csbrdf trace 1\n)?(blocks [0-9]{1,9} index [0-9a-f]{1,8}\n)?([0-9]{1,3}(-[0-9]{1,3})?\n){0,4}.{0,20}") {
            let _ = Touched::from_text(&text);
        }
    }

    #[test]
    fn the_text_is_as_documented() {
        let touched = Touched { blocks: [0, 1, 1, 1, 0, 1].map(|b| b == 1).to_vec(), index_crc: 0xABC };
        assert_eq!(touched.to_text(), "csbrdf trace 1\nblocks 6 index 00000abc\n1-3\n5\n");
        let commented = "csbrdf trace 1\r\n# made by hand\r\nblocks 6 index abc\r\n\r\n1-3\r\n5";
        assert_eq!(Touched::from_text(commented).unwrap(), touched);
    }

    #[test]
    fn wrong_lines_are_named() {
        let says = |text: &str| Touched::from_text(text).unwrap_err().to_string();
        assert!(says("").contains("first line"));
        assert!(says("csbrdf trace 1\n").contains("blocks N index X"));
        assert!(says("csbrdf trace 1\nblocks 99999999999 index 0\n").contains("at most"));
        let head = "csbrdf trace 1\nblocks 6 index 0\n";
        for bad in ["6", "2-1", "3\n3", "-1", "1-", "x"] {
            assert!(says(&format!("{head}{bad}\n")).contains("not a block"), "{bad}");
        }
    }

    #[test]
    fn only_traces_of_one_file_merge() {
        let trace = |blocks: [bool; 2], index_crc| Touched { blocks: blocks.to_vec(), index_crc };
        let mut touched = trace([true, false], 1);
        touched.merge(&trace([false, true], 1)).unwrap();
        assert_eq!(touched.count(), 2);
        assert!(touched.merge(&trace([true, true], 2)).is_err());
    }
}
