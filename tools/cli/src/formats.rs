//! What an input is, and how long, by its first bytes: looked at before the rest is read.

use std::path::Path;

use csbrdf::Error;
use csbrdf::decode::Reader;
use csbrdf::format::MAGIC;
use csbrdf::io::samples::read_samples;
use csbrdf::io::{self, ReadOptions};
use csbrdf::table::Table;
use csbrdf::table::grid::Grid;

use crate::failure::Failure;
use crate::sets::manifest::{LIMIT, Manifest};

/// Most bytes that are read from a pipe: it may never end.
pub const STREAM_LIMIT: u64 = 1 << 30;

/// Larger files are mapped. Up to here they are read, and a file that another process cuts short meanwhile is an error as any other; in
/// a map it would end this process by SIGBUS. Files of some 20 kB take no longer so; one block of a lossless file of 20 MB takes 32 ms
/// of a processor in place of 4, and a comparison with a MERL table of 35 MB 539 in place of 492.
pub const READ_LIMIT: u64 = 1 << 28;

/// What a command can make something of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A csbrdf file.
    Csbrdf,
    /// What may be left of one, or the file of a set that is known by its hash: the first bytes need not be right.
    Damaged,
    /// A table in an outside format, of those that `csbrdf::io` knows.
    Merl,
    /// The manifest of a set.
    Manifest,
    /// A list of measurements.
    List,
}

/// Either form of a table.
pub const TABLE: &[Kind] = &[Kind::Csbrdf, Kind::Merl];

/// How long an input is by its own word.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Length {
    Exactly(u64),
    AtMost(u64),
}

/// Bytes of the preamble of a csbrdf file, which state its length.
const PREAMBLE: usize = 32;
/// Bytes of the head of an outside table, which state its length.
const DIMENSIONS: usize = 12;

/// Bytes that are enough to know what an input is: preamble and longest section table, a few lines of a list.
pub fn head(kinds: &[Kind]) -> u64 {
    if kinds.contains(&Kind::List) { 1 << 16 } else { 2048 }
}

/// Bytes that are enough to see that an input is of none of the kinds, unless these are blanks: magic, dimensions, a brace. What is
/// damaged and what is a list takes all of the head.
pub fn least(kinds: &[Kind]) -> u64 {
    let long = kinds.iter().any(|kind| matches!(kind, Kind::Damaged | Kind::List));
    if long { head(kinds) } else { DIMENSIONS as u64 }
}

/// The length that the first bytes state, of an input of which `all` bytes can be had. Fails if it is of none of the kinds.
pub fn length(path: &Path, head: &[u8], all: u64, kinds: &[Kind]) -> Result<Length, Failure> {
    let accepts = |kind: Kind| kinds.contains(&kind);
    if accepts(Kind::Damaged) {
        return damaged(path, head, all);
    }
    if accepts(Kind::List) {
        return list(path, head, all);
    }
    if accepts(Kind::Manifest) && Manifest::is_likely(head) {
        return Ok(Length::AtMost(LIMIT as u64));
    }
    if accepts(Kind::Merl) && !(accepts(Kind::Csbrdf) && head.starts_with(&MAGIC)) {
        let stated = table_format(path, head)?.length(head).map_err(|e| Failure::in_file(path, &e))?;
        return Ok(stated.map_or(Length::AtMost(STREAM_LIMIT), Length::Exactly));
    }
    // The reader itself says what is wrong with a head alone, or how much is missing behind it.
    let least = if head.starts_with(&MAGIC) { PREAMBLE.min(head.len()) } else { head.len() };
    match Reader::open(&head[..least]).map(|_| ()) {
        Err(Error::Truncated { expected, .. }) => Ok(Length::Exactly(expected)),
        Err(e) => Err(Failure::in_file(path, &e)),
        Ok(()) => Ok(Length::Exactly(head.len() as u64)),
    }
}

/// How tables are read: a list of measurements is asked for by `--samples`.
fn options() -> ReadOptions {
    ReadOptions::new().lists(false)
}

/// The outside format of a table by its first bytes; fails if they are those of something else.
pub fn table_format(path: &Path, bytes: &[u8]) -> Result<&'static io::Format, Failure> {
    io::recognise(bytes, &options()).map_err(|e| Failure::in_file(path, &e))
}

/// The table in the bytes of an outside file.
pub fn read_table(bytes: &[u8]) -> csbrdf::Result<Table> {
    io::read(bytes, &options())
}

/// Of what may be damaged anywhere, anything that is not large is read; of the rest the head must show what it was.
fn damaged(path: &Path, head: &[u8], all: u64) -> Result<Length, Failure> {
    const SECTIONS: [&[u8]; 5] = [b"GRID", b"CODE", b"PART", b"PROB", b"INDX"];
    let of_magic = head.iter().zip(&MAGIC).filter(|(byte, magic)| byte == magic).count();
    let of_table = SECTIONS.iter().filter(|name| head.windows(4).any(|bytes| bytes == **name)).count();
    if all > READ_LIMIT && of_magic < MAGIC.len() / 2 && of_table < 2 {
        let what = "its first bytes are not those of a csbrdf file, and it is too long to look for one in it";
        return Err(Failure::bad_input(path, what));
    }
    Ok(Length::AtMost(STREAM_LIMIT))
}

/// A list may be long; its column names come first and must be those of a list.
fn list(path: &Path, head: &[u8], all: u64) -> Result<Length, Failure> {
    if head.starts_with(&MAGIC) || head.iter().take(64).any(|b| *b == 0) {
        return Err(Failure::bad_input(path, "is no text; --samples takes a list as csbrdf plan makes them"));
    }
    if all > head.len() as u64 {
        let mut end = 0;
        let names = head.split_inclusive(|b| *b == b'\n').find(|line| {
            end += line.len();
            !line.starts_with(b"#") && !line.trim_ascii().is_empty()
        });
        if names.is_none_or(|line| !line.ends_with(b"\n")) {
            let what = format!("no line of column names ends in its first {} bytes; begin with one", head.len());
            return Err(Failure::bad_input(path, what));
        }
        match read_samples(&head[..end], Some(Grid::merl())) {
            // Behind the names nothing was given to be read.
            Err(Error::Corrupt { what, offset, .. }) if offset < end as u64 => {
                return Err(Failure::bad_input(path, what));
            }
            _ => {}
        }
    }
    Ok(Length::AtMost(STREAM_LIMIT))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(head: &[u8], kinds: &[Kind]) -> Result<Length, Failure> {
        length(Path::new("x"), head, STREAM_LIMIT, kinds)
    }

    #[test]
    fn the_first_bytes_say_what_it_is_and_how_long() {
        let merl: Vec<u8> = [90i32, 90, 180].iter().flat_map(|n| n.to_le_bytes()).collect();
        assert_eq!(of(&merl, TABLE).unwrap(), Length::Exactly(34_992_012));
        let mut preamble = [&MAGIC[..], &[1, 0, 0, 0, 0, 0, 6, 0]].concat();
        preamble.extend(777u64.to_le_bytes());
        preamble.extend([0; 8]);
        for kinds in [TABLE, &[Kind::Csbrdf], &[Kind::Csbrdf, Kind::Manifest]] {
            assert_eq!(of(&preamble, kinds).unwrap(), Length::Exactly(777));
        }
        assert_eq!(of(b" {", &[Kind::Csbrdf, Kind::Manifest]).unwrap(), Length::AtMost(LIMIT as u64));
        for kinds in
            [TABLE, &[Kind::Csbrdf], &[Kind::Csbrdf, Kind::Manifest], &[Kind::Merl], &[Kind::List], &[Kind::Damaged]]
        {
            for wrong in [vec![0; 2048], vec![0xFF; 2048], b"y\n".repeat(1024), b" ".repeat(2048)] {
                assert!(of(&wrong, kinds).is_err(), "{kinds:?} {:?}", &wrong[..2]);
            }
        }
        assert!(of(&preamble, &[Kind::Merl]).is_err() && of(b"{", TABLE).is_err());
    }

    #[test]
    fn a_damaged_file_is_known_by_what_is_left() {
        let mut head = [&MAGIC[..], &[1; 24], b"GRID", &[2; 16], b"CODE"].concat();
        head.resize(2048, 7);
        assert!(of(&head, &[Kind::Damaged]).is_ok());
        head[..4].fill(0);
        assert!(of(&head, &[Kind::Damaged]).is_ok());
        head[..8].fill(0);
        assert!(of(&head, &[Kind::Damaged]).is_ok());
        head[8..40].fill(0);
        assert!(of(&head, &[Kind::Damaged]).is_err());
        // A small file is looked through whatever is in it.
        assert!(length(Path::new("x"), &head, 5000, &[Kind::Damaged]).is_ok());
    }

    #[test]
    fn a_long_list_begins_as_one() {
        let names = b"# grid=360\n\ntheta_h_bin,theta_d_bin,phi_d_bin,r,g,b\n1,2,359,,,\n";
        assert!(of(names, &[Kind::List]).is_ok());
        assert!(of(&names[..30], &[Kind::List]).is_err());
        assert!(of(&b"#\n".repeat(100), &[Kind::List]).is_err());
        assert!(of(b"a,b\n1,2\n", &[Kind::List]).is_err());
    }
}
