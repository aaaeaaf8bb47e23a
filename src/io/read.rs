//! What an outside file is, by its first bytes, and the table in it: the one list that all commands and messages go by.

use std::ffi::OsStr;
use std::path::Path;

use super::{merl, samples};
use crate::base::error::{Error, Result};
use crate::format::MAGIC;
use crate::table::Table;
use crate::table::grid::Grid;

/// How to read a table from the bytes of an outside file.
#[derive(Clone, Debug)]
pub struct ReadOptions {
    grid: Option<Grid>,
    lists: bool,
}

impl Default for ReadOptions {
    fn default() -> ReadOptions {
        ReadOptions::new()
    }
}

impl ReadOptions {
    /// All formats; lists of measurements are read onto the grid that they name.
    pub fn new() -> ReadOptions {
        ReadOptions { grid: None, lists: true }
    }

    /// The grid that lists of measurements are read onto, as [`samples::read_samples`] takes it.
    pub fn grid(self, grid: Grid) -> ReadOptions {
        ReadOptions { grid: Some(grid), ..self }
    }

    /// Whether lists of measurements are read too, or refused as text: a program may want to be asked for what is sparse.
    pub fn lists(self, lists: bool) -> ReadOptions {
        ReadOptions { lists, ..self }
    }
}

/// A format that is known by its first bytes ([`recognise`]).
#[derive(Debug)]
#[non_exhaustive]
pub struct Format {
    /// What messages call it.
    pub name: &'static str,
    /// How names of such files usually end, without the dot, if that says anything; what a file is goes by its bytes.
    pub extension: Option<&'static str>,
    recognises: fn(&[u8], &ReadOptions) -> bool,
    content: Content,
}

#[derive(Debug)]
enum Content {
    /// A table, and its file's length by the first bytes where they state it.
    Table { read: fn(&[u8], &ReadOptions) -> Result<Table>, length: fn(&[u8]) -> Result<Option<u64>> },
    /// Known, but no table that is read: what it is and what to do.
    Refused(&'static str),
}

/// The list, in the order in which they are asked. MERL's tables have no magic: what nobody else knows is taken for one, and its
/// reader says which of its dimensions is not MERL's.
static FORMATS: [Format; 6] = [
    refused("nothing", |head, _| head.is_empty(), "the file is empty; give a MERL .binary table"),
    refused(
        "csbrdf file",
        |head, _| head.starts_with(&MAGIC),
        "is a csbrdf file already; give the table that it was made from",
    ),
    refused(
        "RGL tensor file",
        |head, _| head.starts_with(b"tensor_file"),
        "is an RGL tensor file; give a table on MERL's grid",
    ),
    Format {
        name: "list of measurements",
        extension: Some("csv"),
        recognises: |head, options| options.lists && samples::is_list(head),
        content: Content::Table {
            read: |bytes, options| samples::read_samples(bytes, options.grid.clone()).map(|samples| samples.table),
            length: |_| Ok(None),
        },
    },
    refused("text", |head, _| is_text(head), "is a text file; give a MERL .binary table"),
    Format {
        name: "MERL .binary table",
        extension: Some(merl::EXTENSION),
        recognises: |_, _| true,
        content: Content::Table {
            read: |bytes, _| merl::read_merl(bytes),
            length: |head| merl::length(head).map(Some),
        },
    },
];

const fn refused(name: &'static str, is: fn(&[u8], &ReadOptions) -> bool, what: &'static str) -> Format {
    Format { name, extension: None, recognises: is, content: Content::Refused(what) }
}

fn is_text(head: &[u8]) -> bool {
    head.iter().take(64).all(|c| c.is_ascii_graphic() || c.is_ascii_whitespace())
}

/// What a file is, by its first bytes: 64 are enough, but for lists of measurements, whose column names come after comments.
///
/// # Errors
/// `NotATable`, with what it looks like and what to do, if it is none of the formats that tables are read from.
pub fn recognise(head: &[u8], options: &ReadOptions) -> Result<&'static Format> {
    let found = FORMATS.iter().find(|format| (format.recognises)(head, options));
    match found.map(|format| (format, &format.content)) {
        Some((format, Content::Table { .. })) => Ok(format),
        Some((_, Content::Refused(what))) => Err(Error::NotATable((*what).into())),
        None => Err(Error::NotATable(format!("is in no known format; known are: {}", names()))),
    }
}

/// Names of the formats that are read.
fn names() -> String {
    let read = FORMATS.iter().filter(|format| matches!(format.content, Content::Table { .. }));
    read.map(|format| format.name).collect::<Vec<_>>().join(", ")
}

/// The table in the bytes of an outside file, whatever its format.
///
/// ```
/// use csbrdf::io::{ReadOptions, read};
///
/// let list = b"theta_h_bin,theta_d_bin,phi_d_bin,r,g,b\n3,4,5,0.25,0.5,0.75\n";
/// let table = read(list, &ReadOptions::new())?;
/// assert_eq!(table.valid_count(), 3);
/// # Ok::<(), csbrdf::Error>(())
/// ```
///
/// # Errors
/// As [`recognise`], then `Truncated` or `Corrupt` as the format's own reader says.
pub fn read(bytes: &[u8], options: &ReadOptions) -> Result<Table> {
    recognise(bytes, options)?.read(bytes, options)
}

impl Format {
    /// The table in the bytes of a file of this format.
    ///
    /// # Errors
    /// `Truncated` or `Corrupt`.
    pub fn read(&self, bytes: &[u8], options: &ReadOptions) -> Result<Table> {
        match &self.content {
            Content::Table { read, .. } => read(bytes, options),
            Content::Refused(what) => Err(Error::NotATable((*what).into())),
        }
    }

    /// Bytes of the file, as far as its first bytes state them; at least those that will. `None` if they do not.
    ///
    /// # Errors
    /// `Corrupt` if the first bytes cannot be those of such a file.
    pub fn length(&self, head: &[u8]) -> Result<Option<u64>> {
        match &self.content {
            Content::Table { length, .. } => length(head),
            Content::Refused(_) => Ok(None),
        }
    }
}

/// Whether a file's name says that a table is in it: for folders, where not all that is there is meant. Lists of measurements are named one by one.
pub fn is_named_as_table(path: &Path) -> bool {
    path.extension() == Some(OsStr::new(merl::EXTENSION))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &[u8] = b"# csbrdf plan grid=360\n\n Theta_h_bin , theta_d_bin,phi_d_bin,r,g,b\n1,2,359,0.5,0.5,0.5\n";

    #[test]
    fn first_bytes_say_what_a_file_is() {
        let merl: Vec<u8> = [90i32, 90, 360].iter().flat_map(|n| n.to_le_bytes()).collect();
        let options = ReadOptions::new();
        let found = recognise(&merl, &options).unwrap();
        assert_eq!((found.name, found.extension), ("MERL .binary table", Some("binary")));
        assert_eq!(found.length(&merl).unwrap(), Some(12 + 8 * 3 * 90 * 90 * 360));
        assert_eq!(found.length(&merl[..5]).unwrap(), Some(12));
        assert!(matches!(found.length(&[7; 12]), Err(Error::Corrupt { .. })));
        let list = recognise(LIST, &options).unwrap();
        assert_eq!((list.name, list.length(LIST).unwrap()), ("list of measurements", None));
        for (bytes, what) in [
            (&b""[..], "empty"),
            (&MAGIC, "csbrdf file already"),
            (b"tensor_file\0\x01", "RGL tensor file"),
            (b"theta_h theta_d phi_d\n1 2 3\n", "is a text file"),
            (b"a,b\n1,2\n", "is a text file"),
        ] {
            let error = read(bytes, &options).unwrap_err();
            assert!(matches!(&error, Error::NotATable(found) if found.contains(what)), "{error}");
            assert!(error.to_string().contains(what));
        }
        let refused = read(LIST, &options.lists(false)).unwrap_err();
        assert!(matches!(refused, Error::NotATable(_)), "{refused}");
        assert_eq!(names(), "list of measurements, MERL .binary table");
    }

    #[test]
    fn tables_are_those_of_their_readers() {
        let table = read(LIST, &ReadOptions::new()).unwrap();
        assert_eq!(table, samples::read_samples(LIST, None).unwrap().table);
        assert_eq!(table.grid(), &Grid::merl_360());
        let bin = b"theta_h_bin,theta_d_bin,phi_d_bin,r,g,b\n1,2,3,1,1,1\n";
        let on = |options| read(bin, &options).unwrap().grid().shape()[3];
        assert_eq!([on(ReadOptions::new()), on(ReadOptions::new().grid(Grid::merl_360()))], [180, 360]);
        let cut: Vec<u8> = [90i32, 90, 180].iter().flat_map(|n| n.to_le_bytes()).collect();
        assert!(matches!(read(&cut, &ReadOptions::new()), Err(Error::Truncated { .. })));
        assert!(is_named_as_table(Path::new("a/chrome.binary")) && !is_named_as_table(Path::new("a/list.csv")));
    }
}
