//! NumPy `.npy` output, version 1.0 of the format: float32 or float64, C order.

use std::io::Write;

use crate::base::error::Result;

/// Writes the header; the values follow as little-endian bytes.
fn write_header(descr: &str, shape: &[usize], mut out: impl Write) -> Result<()> {
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    // Magic, version and length take 10 bytes; the whole is padded to a multiple of 64 and ends in a line feed.
    let padding = 63 - (10 + header.len()) % 64;
    header.push_str(&" ".repeat(padding));
    header.push('\n');
    out.write_all(b"\x93NUMPY\x01\x00")?;
    out.write_all(&(header.len() as u16).to_le_bytes())?;
    out.write_all(header.as_bytes())?;
    Ok(())
}

/// Writes an array of float32.
///
/// # Errors
/// `Io` if the writer fails.
pub fn write_npy_f32(values: &[f32], shape: &[usize], mut out: impl Write) -> Result<()> {
    write_header("<f4", shape, &mut out)?;
    let mut bytes = Vec::with_capacity(4 << 16);
    for chunk in values.chunks(1 << 16) {
        bytes.clear();
        bytes.extend(chunk.iter().flat_map(|v| v.to_le_bytes()));
        out.write_all(&bytes)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_is_aligned_and_says_the_shape() {
        let mut out = Vec::new();
        write_npy_f32(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[2, 3], &mut out).unwrap();
        let header_len = usize::from(u16::from_le_bytes([out[8], out[9]]));
        assert_eq!((10 + header_len) % 64, 0);
        assert_eq!(out.len(), 10 + header_len + 24);
        let header = std::str::from_utf8(&out[10..10 + header_len]).unwrap();
        assert!(header.starts_with("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, ), }"));
        assert!(header.ends_with('\n'));
        assert_eq!(out[10 + header_len..][..8], [0, 0, 0x80, 0x3F, 0, 0, 0, 0x40]);
    }
}
