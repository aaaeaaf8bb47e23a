//! Radiance pictures (.hdr): texels of a mantissa each for red, green and blue and one exponent for the three, in rows that
//! are plain or of run lengths (Ward, "Real Pixels", Graphics Gems II; `color.c` of Radiance).

use std::io::{BufRead, Read};

use super::{Map, Refused, texels};

const SIGNATURES: [&[u8]; 2] = [b"#?RADIANCE", b"#?RGBE"];
/// Most bytes of a line of the header.
const MOST_LINE: u64 = 1 << 12;
/// Most lines of the header.
const MOST_LINES: usize = 1 << 12;
/// Widths that rows of run lengths by component can have.
const RUN_WIDTHS: std::ops::RangeInclusive<usize> = 8..=0x7FFF;

/// Red, green, blue and exponent.
type Rgbe = [u8; 4];

/// Whether a file that begins so is a Radiance picture.
pub fn is_of(head: &[u8]) -> bool {
    SIGNATURES.iter().any(|s| head.starts_with(s))
}

/// Reads a picture whose rows run from the top and from the left.
pub fn read(mut from: impl BufRead) -> Result<Map, Refused> {
    // Lines of text up to an empty one: variables such as the format. Those of the exposure are not applied.
    for count in 0.. {
        let line = line(&mut from)?;
        match line.split_once('=') {
            _ if line.is_empty() => break,
            _ if count == MOST_LINES => return malformed(format!("more than {MOST_LINES} lines of header")),
            Some((key, format)) if key.trim() == "FORMAT" && format.trim() != "32-bit_rle_rgbe" => {
                return malformed(format!("the format is {:.20}, expected 32-bit_rle_rgbe", format.trim()));
            }
            _ => {}
        }
    }
    // The size, rows first.
    let size = line(&mut from)?;
    let words: Vec<&str> = size.split_whitespace().collect();
    let [height, width] = match words[..] {
        ["-Y", height, "+X", width] => [height, width].map(|n| n.parse::<u32>().ok().map(|n| n as usize)),
        _ => [None; 2],
    };
    let (Some(width), Some(height)) = (width, height) else {
        return malformed(format!("the size is \"{size:.40}\", expected \"-Y height +X width\""));
    };
    let mut map = Map { width, height, texels: Vec::new() };
    if texels(width, height)? == 0 {
        return Ok(map);
    }
    // The rows. Nothing is allocated for those that do not come.
    let mut row = vec![[0; 4]; width];
    for _ in 0..height {
        read_row(&mut from, &mut row)?;
        map.texels.extend(row.iter().copied().map(radiance));
    }
    Ok(map)
}

fn malformed<T>(what: String) -> Result<T, Refused> {
    Err(Refused::Malformed(what))
}

/// The next line of the header without its end.
fn line(from: &mut impl BufRead) -> Result<String, Refused> {
    let mut line = Vec::new();
    from.take(MOST_LINE).read_until(b'\n', &mut line)?;
    if line.pop() != Some(b'\n') {
        return malformed("the header does not end".into());
    }
    Ok(String::from_utf8_lossy(&line).into_owned())
}

/// The linear radiance of a texel; exponent 0 is black.
fn radiance([r, g, b, e]: Rgbe) -> [f32; 3] {
    let unit = if e == 0 { 0.0 } else { (f64::from(e) - 136.0).exp2() };
    [r, g, b].map(|c| (unit * f64::from(c)) as f32)
}

fn bytes<const N: usize>(from: &mut impl Read) -> Result<[u8; N], Refused> {
    let mut bytes = [0; N];
    from.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn read_row(from: &mut impl Read, row: &mut [Rgbe]) -> Result<(), Refused> {
    // Two bytes of 2 and the width announce run lengths by component: no texel that is scaled as it should be begins so.
    let first: Rgbe = bytes(from)?;
    let width = row.len();
    if !RUN_WIDTHS.contains(&width) || first[..2] != [2, 2] || first[2] > 127 {
        return read_plain(from, first, row);
    }
    let stated = usize::from(u16::from_be_bytes([first[2], first[3]]));
    if stated != width {
        return malformed(format!("a row of {stated} texels in a picture of {width}"));
    }
    for component in 0..4 {
        let mut at = 0;
        while at < width {
            // A count, then that many bytes; above 128 a run of one byte, 128 less.
            let [count] = bytes(from)?;
            let (length, run) = if count > 128 { (count - 128, Some(bytes::<1>(from)?[0])) } else { (count, None) };
            let end = at + usize::from(length);
            let Some(part) = row.get_mut(at..end) else { return too_long(width) };
            for texel in part {
                texel[component] = match run {
                    Some(byte) => byte,
                    None => bytes::<1>(from)?[0],
                };
            }
            at = end;
        }
    }
    Ok(())
}

/// Texel by texel; mantissas of 1, 1, 1 repeat the texel before as often as the last byte says, in base 256 if several follow each other.
fn read_plain(from: &mut impl Read, first: Rgbe, row: &mut [Rgbe]) -> Result<(), Refused> {
    let (mut at, mut shift, mut texel) = (0, 0, first);
    while at < row.len() {
        if texel[..3] == [1, 1, 1] {
            let Some(before) = at.checked_sub(1).map(|i| row[i]) else {
                return malformed("a row begins with a run".into());
            };
            let count = usize::from(texel[3]).checked_shl(shift).filter(|_| shift < 32).unwrap_or(usize::MAX);
            let Some(run) = row.get_mut(at..at.saturating_add(count)) else { return too_long(row.len()) };
            run.fill(before);
            (at, shift) = (at + count, shift + 8);
        } else {
            row[at] = texel;
            (at, shift) = (at + 1, 0);
        }
        if at < row.len() {
            texel = bytes(from)?;
        }
    }
    Ok(())
}

fn too_long<T>(width: usize) -> Result<T, Refused> {
    malformed(format!("a row is longer than the picture, {width} texels"))
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::prelude::*;
    use proptest::sample::Index;

    use super::*;

    fn file(width: usize, height: usize, rows: &[u8]) -> Vec<u8> {
        let mut file =
            format!("#?RADIANCE\n# by hand\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n").into_bytes();
        file.extend(rows);
        file
    }

    fn refusal(file: &[u8]) -> String {
        match read(file) {
            Err(Refused::Malformed(what) | Refused::TooLarge(what)) => what,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn texels_are_mantissas_times_a_power_of_two() {
        assert_eq!(radiance([128, 64, 1, 129]), [1.0, 0.5, 1.0 / 128.0]);
        assert_eq!(radiance([9, 9, 9, 0]), [0.0; 3]);
        assert_eq!(radiance([1, 2, 255, 1]), [1.0, 2.0, 255.0].map(|c: f32| c * f32::from_bits(1 << 14)));
        assert_eq!(radiance([255, 0, 0, 255])[0], 255.0 * 2f32.powi(119));
    }

    #[test]
    fn rows_plain_and_of_both_runs() {
        // Narrow rows are plain, even if they look like runs.
        let map = read(&file(2, 1, &[2, 2, 0, 130, 4, 0, 0, 129])[..]).unwrap();
        assert_eq!((map.width, map.height), (2, 1));
        assert_eq!(map.texels, [[2, 2, 0, 130], [4, 0, 0, 129]].map(radiance));
        // A texel and three repeats of it, then one more.
        let map = read(&file(5, 1, &[7, 8, 9, 128, 1, 1, 1, 3, 5, 5, 5, 128])[..]).unwrap();
        assert_eq!(map.texels[..4], [radiance([7, 8, 9, 128]); 4]);
        assert_eq!(map.texels[4], radiance([5, 5, 5, 128]));
        // 258 repeats are two in the low byte and one in the next.
        let map = read(&file(259, 1, &[7, 8, 9, 128, 1, 1, 1, 2, 1, 1, 1, 1])[..]).unwrap();
        assert_eq!(map.texels, [radiance([7, 8, 9, 128]); 259]);
        // Runs by component: red of one run, green literal, blue of both, one exponent.
        let mut rows = vec![2, 2, 0, 9, 137, 50, 9, 1, 2, 3, 4, 5, 6, 7, 8, 9, 132, 20];
        rows.extend([5, 1, 2, 3, 4, 5, 137, 128]);
        let map = read(&file(9, 1, &rows)[..]).unwrap();
        let blue = [20, 20, 20, 20, 1, 2, 3, 4, 5];
        let expected: Vec<_> = (0..9).map(|i| radiance([50, i as u8 + 1, blue[i], 128])).collect();
        assert_eq!(map.texels, expected);
    }

    #[test]
    fn what_is_damaged_or_too_large_is_refused() {
        assert!(is_of(b"#?RADIANCE\n") && is_of(b"#?RGBE\n") && !is_of(b"#?RAD") && !is_of(b""));
        let good = file(9, 2, &[[2, 2, 0, 9, 137, 1, 137, 2, 137, 3, 137, 128]; 2].concat());
        assert_eq!(read(&good[..]).unwrap().texels.len(), 18);
        for end in 0..good.len() {
            assert!(read(&good[..end]).is_err(), "{end}");
        }
        for (rows, what) in [
            (&[2, 2, 0, 8, 136, 1][..], "a row of 8"),
            (&[2, 2, 0, 9, 138, 1], "longer than"),
            (&[2, 2, 0, 9, 8, 1, 2, 3, 4, 5, 6, 7, 8, 2, 1, 1], "longer than"),
            (&[1, 1, 1, 5, 0, 0, 0, 0], "begins with a run"),
            (&[3, 1, 1, 5, 1, 1, 1, 9], "longer than"),
            (&[3, 1, 1, 5, 1, 1], "ends in the middle"),
        ] {
            assert!(refusal(&file(9, 1, rows)).contains(what), "{what}");
        }
        // Repeats whose number does not end.
        let endless = [&[3, 1, 1, 5][..], &[1, 1, 1, 0].repeat(40), &[1, 1, 1, 1]].concat();
        assert!(refusal(&file(9, 1, &endless)).contains("longer than"));
        // Sizes are refused before anything is allocated for them; rows are allocated as they come.
        for side in [u32::MAX as usize, 1 << 15] {
            assert!(refusal(&file(side, side, &[])).contains("smaller map"));
        }
        assert!(refusal(&file(1 << 12, 1 << 13, &[])).contains("ends in the middle"));
        for (size, what) in [
            ("+Y 2 +X 2", "+Y 2"),
            ("-Y 2 -X 2", "-X 2"),
            ("+X 2 -Y 2", "+X 2"),
            ("-Y -2 +X 2", "-Y -2"),
            ("-Y 2 +X", "expected"),
            ("-Y 99999999999 +X 1", "9999"),
            ("", "\"\""),
        ] {
            assert!(refusal(format!("#?RADIANCE\n\n{size}\n").as_bytes()).contains(what), "{size}");
        }
        assert!(refusal(b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n").contains("32-bit_rle_xyze"));
        assert!(refusal(&b"#?RADIANCE ".repeat(9999)).contains("does not end"));
        assert!(refusal(&b"#?RADIANCE\n".repeat(9999)).contains("lines of header"));
        // An empty picture is one; the environment refuses it.
        for (width, height) in [(0, u32::MAX as usize), (u32::MAX as usize, 0)] {
            assert!(read(&file(width, height, &[])[..]).unwrap().texels.is_empty());
        }
    }
    #[test]
    fn comments_and_other_variables_are_passed_over() {
        let texel = [128, 64, 1, 129];
        let plain = read(&file(1, 1, &texel)[..]).unwrap();
        let header = b"#?RGBE\n# -Y 9 +X 9\nEXPOSURE=2\nnot a variable\n FORMAT = 32-bit_rle_rgbe\n\n-Y 1 +X 1\n";
        let map = read(&[&header[..], &texel].concat()[..]).unwrap();
        assert_eq!((map.width, map.height, map.texels), (1, 1, plain.texels));
    }

    proptest! {
        /// Any bytes for rows give a picture of the stated size or are refused.
        #[test]
        fn any_rows(width in 0usize..40, height in 0usize..6, rows in vec(row_byte(), 0..400)) {
            if let Ok(map) = read(&file(width, height, &rows)[..]) {
                prop_assert_eq!((map.width, map.height, map.texels.len()), (width, height, width * height));
            }
        }

        /// So do any bytes for the whole file, and a file of which some bytes are changed.
        #[test]
        fn any_file(bytes in vec(any::<u8>(), 0..200), changes in vec((any::<Index>(), any::<u8>()), 1..4)) {
            let _ = read(&bytes[..]);
            let mut changed = file(9, 2, &[[2, 2, 0, 9, 137, 1, 137, 2, 137, 3, 137, 128]; 2].concat());
            for (at, byte) in changes {
                let at = at.index(changed.len());
                changed[at] = byte;
            }
            if let Ok(map) = read(&changed[..]) {
                prop_assert_eq!(map.texels.len(), map.width * map.height);
            }
        }
    }

    /// Bytes that often announce runs of either kind.
    fn row_byte() -> impl Strategy<Value = u8> {
        prop_oneof![Just(1), Just(2), 0u8..40, 128u8..170, any::<u8>()]
    }
}
