//! Which blocks of a file a scene has looked at, to keep only those: `csbrdf prune`.

use std::fmt::Write as _;
use std::io::{BufRead, Read};

use crate::base::budget::filled;
use crate::base::error::{Error, Result};
use crate::base::excerpt::excerpt;
use crate::decode::Reader;

/// First line of a trace.
const TITLE: &str = "csbrdf trace 1";
/// Most bytes of a line, comments among them.
const MAX_LINE: usize = 4096;
/// Most bytes of a trace: all blocks of the largest file, one a line, and as much again.
const MAX_BYTES: u64 = 1 << 28;

/// A set of blocks of one file.
///
/// As text, a *trace*: the title, a line `blocks N index X` with the number of the file's blocks and the CRC-32 of its index in
/// hexadecimal, then block numbers from 0 or ranges `FIRST-LAST` of them, in ascending order, one a line. Lines that begin with #
/// are comments.
///
/// ```no_run
/// let brdf = csbrdf::Brdf::open("chrome.csbrdf")?;
/// brdf.eval([0.3, 0.0, 0.9], [-0.5, 0.1, 0.8])?;
/// std::fs::write("scene.trace", brdf.touched().to_text())?; // for `csbrdf prune --trace`
/// # Ok::<(), csbrdf::Error>(())
/// ```
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

    /// CRC-32 of the file's index section: it keeps traces of one file apart from those of another.
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
        if (self.blocks.len(), self.index_crc) != (other.blocks.len(), other.index_crc) {
            return Err(Error::InvalidArgument(format!(
                "the traces are of two files: the one so far of {}, the one to add of {}; trace both scenes with one file",
                self.file(),
                other.file()
            )));
        }
        self.blocks.iter_mut().zip(&other.blocks).for_each(|(touched, other)| *touched |= *other);
        Ok(())
    }

    /// Fails unless the trace is of this file.
    ///
    /// # Errors
    /// `InvalidArgument` if it is of another.
    pub fn check<D: AsRef<[u8]>>(&self, reader: &Reader<D>) -> Result<()> {
        let (blocks, index_crc) = (reader.block_count(), reader.index_crc());
        if (self.blocks.len(), self.index_crc) == (blocks, index_crc) {
            return Ok(());
        }
        Err(Error::InvalidArgument(format!(
            "the trace is of another file: of {}, the file has {blocks} blocks with index {index_crc:08x}; trace the scene \
             again with this file",
            self.file()
        )))
    }

    /// What a message calls the file that the trace is of.
    fn file(&self) -> String {
        format!("{} blocks with index {:08x}", self.blocks.len(), self.index_crc)
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

    /// Reads a trace from its text.
    ///
    /// # Errors
    /// As [`Touched::read`].
    pub fn from_text(text: &str) -> Result<Touched> {
        Touched::read(text.as_bytes())
    }

    /// Reads a trace line by line, to the first that is none: what is no trace is not read to its end, which a device or a pipe
    /// may not have.
    ///
    /// # Errors
    /// `Corrupt` with the offset of the line that cannot be read or has more than 4096 bytes; `LimitExceeded` if there are more
    /// than 2^28 bytes; `Io` of the reader; `OutOfMemory`.
    pub fn read(from: impl BufRead) -> Result<Touched> {
        let mut lines = Lines { from, line: Vec::new(), next: 0 };
        if lines.fill()?.is_none_or(|(_, line)| line.trim_ascii() != TITLE.as_bytes()) {
            return Err(corrupt(0, format!("the first line is not `{TITLE}`")));
        }
        let (at, line) = lines.next()?.unwrap_or((lines.next, String::new()));
        let numbers = line.strip_prefix("blocks ").and_then(|rest| rest.split_once(" index "));
        let numbers = numbers.and_then(|(n, crc)| Some((n.parse().ok()?, u32::from_str_radix(crc, 16).ok()?)));
        let (count, index_crc): (usize, u32) =
            numbers.ok_or_else(|| corrupt(at, format!("`{}` is not `blocks N index X`", excerpt(&line))))?;
        if count > crate::base::limits::MAX_BLOCKS {
            return Err(corrupt(at, format!("{count} blocks, a file has {} at most", crate::base::limits::MAX_BLOCKS)));
        }
        let mut blocks = filled(false, count)?;
        let mut next = 0;
        while let Some((at, line)) = lines.next()? {
            let (first, last) = line.split_once('-').unwrap_or((&line, &line));
            let range = first.parse::<usize>().ok().zip(last.parse::<usize>().ok());
            let Some((first, last)) = range.filter(|&(first, last)| next <= first && first <= last && last < count)
            else {
                let line = excerpt(&line);
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

fn corrupt(at: u64, what: String) -> Error {
    Error::corrupt("trace", at, what)
}

/// The lines of a text of which no more is held than one.
struct Lines<R> {
    from: R,
    line: Vec<u8>,
    /// Offset of the next.
    next: u64,
}

impl<R: BufRead> Lines<R> {
    /// The next line and its offset, or the beginning of one that is too long.
    fn fill(&mut self) -> Result<Option<(u64, &[u8])>> {
        let at = self.next;
        self.line.clear();
        let read = self.from.by_ref().take(MAX_LINE as u64 + 1).read_until(b'\n', &mut self.line)?;
        self.next += read as u64;
        if self.next > MAX_BYTES {
            return Err(Error::LimitExceeded { what: "bytes of the trace", got: self.next, limit: MAX_BYTES });
        }
        Ok((read > 0).then_some((at, &self.line)))
    }

    /// The next line that is neither blank nor a comment, without blanks at its ends.
    fn next(&mut self) -> Result<Option<(u64, String)>> {
        while let Some((at, line)) = self.fill()? {
            if line.len() > MAX_LINE {
                let begin = String::from_utf8_lossy(&line[..MAX_LINE]).into_owned();
                let begin: String = begin.chars().take(crate::base::excerpt::MOST).collect();
                return Err(corrupt(at, format!("the line that begins `{begin}` has more than {MAX_LINE} bytes")));
            }
            let text = std::str::from_utf8(line).map_err(|_| corrupt(at, "the line is no text".into()))?.trim();
            if !text.is_empty() && !text.starts_with('#') {
                return Ok(Some((at, text.into())));
            }
        }
        Ok(None)
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
        let refused = touched.merge(&trace([true, true], 2)).unwrap_err().to_string();
        assert!(
            refused.contains("so far of 2 blocks with index 00000001, the one to add of 2 blocks with index 00000002")
        );
    }

    /// A reader of the same byte for ever that counts how often it is read.
    struct Endless<'a>(&'a [u8], usize);

    impl Read for Endless<'_> {
        fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
            assert!(self.1 < 10_000_000, "reads on");
            self.1 += into.len();
            into.iter_mut().zip(self.0.iter().cycle()).for_each(|(byte, from)| *byte = *from);
            Ok(into.len())
        }
    }

    #[test]
    fn what_has_no_end_is_read_to_the_first_wrong_line() {
        let says = |head: &'static str, rest: &[u8]| {
            let from = std::io::BufReader::new(head.as_bytes().chain(Endless(rest, 0)));
            Touched::read(from).unwrap_err().to_string()
        };
        for rest in [&b"\0"[..], b"x", b"\n", b"csbrdf trace 1"] {
            assert!(says("", rest).contains("first line is not"), "{rest:?}");
        }
        assert!(says("csbrdf trace 1\n", b"a\n").contains("`a` is not `blocks N index X`"));
        let head = "csbrdf trace 1\nblocks 6 index 0\n";
        assert!(says(head, b"\0").contains("has more than 4096 bytes"));
        assert!(says(head, b"1\n").contains("offset 34: `1` is not a block"));
        let comment = says("csbrdf trace 1\n#", b"\xFF");
        assert!(comment.contains("more than 4096 bytes") && comment.len() < 400, "{comment}");
    }

    #[test]
    fn long_lines_are_quoted_in_part() {
        let text = format!("csbrdf trace 1\nblocks 6 index 0\n{}\n", "x".repeat(2000));
        let refused = Touched::from_text(&text).unwrap_err().to_string();
        assert!(refused.contains("xxx... (1920 more bytes)` is not a block") && refused.len() < 300, "{refused}");
    }
}
