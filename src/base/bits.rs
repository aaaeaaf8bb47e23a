//! Integers and floats in bytes: the only endian code. Everything on the wire is little-endian.

use byteorder::{ByteOrder, LittleEndian as LE};

use crate::base::error::{Error, Result};

/// Reads fields from a section, knowing its name and place for errors.
#[derive(Clone, Debug)]
pub(crate) struct ByteReader<'a> {
    data: &'a [u8],
    at: usize,
    /// Offset of `data[0]` from the start of the file.
    base: u64,
    section: &'static str,
}

macro_rules! read_fixed {
    ($name:ident, $type:ty, $size:expr, $read:expr) => {
        pub(crate) fn $name(&mut self) -> Result<$type> {
            Ok($read(self.bytes($size)?))
        }
    };
}

impl<'a> ByteReader<'a> {
    pub(crate) fn new(data: &'a [u8], base: u64, section: &'static str) -> Self {
        ByteReader { data, at: 0, base, section }
    }

    /// The next `n` bytes.
    pub(crate) fn bytes(&mut self, n: usize) -> Result<&'a [u8]> {
        let rest = &self.data[self.at..];
        if n > rest.len() {
            return Err(Error::Truncated {
                section: self.section,
                expected: self.offset().saturating_add(n as u64),
                got: self.base + self.data.len() as u64,
            });
        }
        self.at += n;
        Ok(&rest[..n])
    }

    /// The next `N` bytes.
    pub(crate) fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let mut array = [0; N];
        array.copy_from_slice(self.bytes(N)?);
        Ok(array)
    }

    read_fixed!(u8, u8, 1, |b: &[u8]| b[0]);
    read_fixed!(u16, u16, 2, LE::read_u16);
    read_fixed!(u32, u32, 4, LE::read_u32);
    read_fixed!(u64, u64, 8, LE::read_u64);
    read_fixed!(f32, f32, 4, LE::read_f32);
    read_fixed!(f64, f64, 8, LE::read_f64);

    /// Offset of the next byte from the start of the file.
    pub(crate) fn offset(&self) -> u64 {
        self.base + self.at as u64
    }

    /// Bytes not yet read.
    pub(crate) fn left(&self) -> usize {
        self.data.len() - self.at
    }

    /// All bytes that are left.
    pub(crate) fn rest(self) -> &'a [u8] {
        &self.data[self.at..]
    }

    /// An error at the current place.
    pub(crate) fn corrupt(&self, what: impl Into<String>) -> Error {
        Error::corrupt(self.section, self.offset(), what)
    }

    /// An error of the section as a whole.
    pub(crate) fn corrupt_section(&self, what: impl Into<String>) -> Error {
        Error::corrupt(self.section, self.base, what)
    }

    /// Fails unless all bytes were read.
    pub(crate) fn finish(self) -> Result<()> {
        match self.data.len() - self.at {
            0 => Ok(()),
            left => Err(self.corrupt(format!("{left} bytes follow the last field"))),
        }
    }
}

/// Unsigned integer of `width` 1 to 4 bytes at the start of `data`.
pub(crate) fn read_uint(data: &[u8], width: usize) -> u32 {
    LE::read_uint(data, width) as u32
}

/// Signed integer of `width` 1 to 4 bytes at the start of `data`.
pub(crate) fn read_int(data: &[u8], width: usize) -> i32 {
    LE::read_int(data, width) as i32
}

/// `N` values of type f64 from consecutive bytes.
pub(crate) fn read_f64_into(data: &[u8], values: &mut [f64]) {
    LE::read_f64_into(data, values);
}

/// Appends fields to a byte vector.
#[derive(Debug, Default)]
pub(crate) struct ByteWriter(pub(crate) Vec<u8>);

macro_rules! write_fixed {
    ($($name:ident: $type:ty),*) => {
        $(pub(crate) fn $name(&mut self, value: $type) {
            self.0.extend_from_slice(&value.to_le_bytes());
        })*
    };
}

#[cfg_attr(not(feature = "encode"), allow(dead_code))]
impl ByteWriter {
    write_fixed!(u8: u8, u16: u16, u32: u32, u64: u64, f32: f32, f64: f64);

    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        self.0.extend_from_slice(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truncation_names_section_and_place() {
        let mut reader = ByteReader::new(&[1, 2, 3], 100, "GRID");
        assert_eq!(reader.u16().unwrap(), 0x0201);
        match reader.u32() {
            Err(Error::Truncated { section: "GRID", expected: 106, got: 103 }) => {}
            other => panic!("{other:?}"),
        }
        assert!(reader.finish().is_err());
    }

    #[test]
    fn widths_are_kept() {
        assert_eq!(read_int(&[0x70, 0xFE], 2), -400);
        assert_eq!(read_int(&[0xFF], 1), -1);
        assert_eq!(read_int(&[0, 0, 0x80], 3), -(1 << 23));
        assert_eq!(read_int(&[0, 0, 0, 0x80], 4), i32::MIN);
        assert_eq!(read_uint(&[0xFF, 0xFF, 0xFF], 3), (1 << 24) - 1);
        assert_eq!(read_uint(&[0xFF; 4], 4), u32::MAX);
    }
}
