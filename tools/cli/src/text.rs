//! Numbers and names as text.

use unicode_properties::{GeneralCategory, UnicodeGeneralCategory};

/// Whether a character steers what shows the text in place of being shown: control characters, line and paragraph
/// separators, format characters (the writing direction U+202E, the byte order mark, joiners and spaces of no width, tags),
/// and letters that are blank.
pub fn is_hidden(c: char) -> bool {
    use GeneralCategory::{Control, Format, LineSeparator, ParagraphSeparator};
    // Those of ASCII need no table.
    match c {
        ' '..='~' => false,
        // Fillers and vowels without a shape, the joiner of graphemes, the Mongolian separators, the blank of Braille.
        '\u{34F}'
        | '\u{115F}'
        | '\u{1160}'
        | '\u{17B4}'
        | '\u{17B5}'
        | '\u{180B}'..='\u{180F}'
        | '\u{2800}'
        | '\u{3164}'
        | '\u{FFA0}' => true,
        c => matches!(c.general_category(), Control | Format | LineSeparator | ParagraphSeparator),
    }
}

/// Hidden characters replaced: names out of files must not steer the terminal, and a message is one line.
pub fn clean(text: &str) -> String {
    text.chars().map(|c| if is_hidden(c) { '\u{FFFD}' } else { c }).collect()
}

/// The same of a text of several lines.
pub fn clean_lines(text: &str) -> String {
    text.chars().map(|c| if is_hidden(c) && c != '\n' { '\u{FFFD}' } else { c }).collect()
}

/// A count with its thousands set apart.
pub fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::with_capacity(digits.len() * 4 / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// Nine significant digits, enough to distinguish any two single-precision numbers; `%g` of C.
pub fn nine_digits(x: f32) -> String {
    let exponent = if x == 0.0 || !x.is_finite() { 0 } else { f64::from(x).abs().log10().floor() as i32 };
    if (-5..9).contains(&exponent) {
        let decimals = (8 - exponent).max(0) as usize;
        let text = format!("{x:.decimals$}");
        match text.contains('.') {
            true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
            false => text,
        }
    } else {
        format!("{x:.8e}")
    }
}

/// A figure in dB, where infinite means equal.
pub fn decibel(x: f64) -> String {
    if x == f64::INFINITY { "equal".into() } else { format!("{x:.2}") }
}

/// A share in percent.
pub fn percent(part: usize, whole: usize) -> String {
    format!("{:.1} %", 100.0 * part as f64 / whole.max(1) as f64)
}

/// Four significant digits or so, for errors.
pub fn error_figure(x: f64) -> String {
    match x {
        0.0 => "0".into(),
        x if !x.is_finite() => "unknown".into(),
        x if x < 1e-4 => format!("{x:.2e}"),
        x if x < 1.0 => format!("{x:.5}"),
        x => format!("{x:.3}"),
    }
}

/// Bytes in hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_are_set_apart() {
        assert_eq!([0, 999, 1000, 34992012].map(grouped), ["0", "999", "1,000", "34,992,012"]);
    }

    #[test]
    fn nine_digits_read_back_exactly() {
        for x in [0.0, 1.0, 0.1, 1234567.9, 1e-5, 9.999_999e-5, 1e-30, 3.4e38, f32::MIN_POSITIVE, 1e9, 999_999_940.0] {
            assert_eq!(nine_digits(x).parse::<f32>().unwrap(), x, "{}", nine_digits(x));
        }
        assert_eq!(nine_digits(0.25), "0.25");
    }

    #[test]
    fn control_characters_are_shown_not_obeyed() {
        assert_eq!(clean("a\u{1b}[31m\nb"), "a\u{FFFD}[31m\u{FFFD}b");
    }

    #[test]
    fn nor_are_other_characters_that_do_not_show() {
        let hidden = [
            0x00, 0x09, 0x7F, 0x85, 0x9B, 0xAD, 0x34F, 0x61C, 0x115F, 0x180E, 0x200B, 0x200D, 0x200E, 0x200F, 0x2028,
            0x2029, 0x202A, 0x202E, 0x2060, 0x2066, 0x2069, 0x206F, 0x3164, 0xFEFF, 0xFFA0, 0xFFF9, 0xE0001, 0xE007F,
        ];
        for c in hidden.map(|c| char::from_u32(c).unwrap()) {
            assert_eq!(clean(&format!("a{c}b")), "a\u{FFFD}b", "{c:?}");
            let kept = if c == '\n' { "\n" } else { "\u{FFFD}" };
            assert_eq!(clean_lines(&c.to_string()), kept, "{c:?}");
        }
        let shown = "Azaz09 ~!\u{A0}\u{E9}e\u{301}\u{3B8}\u{5D0}\u{4E2D}\u{1F3A8}\u{FFFD}";
        assert_eq!(clean(shown), shown);
        assert_eq!(clean_lines("a\nb"), "a\nb");
    }
}
