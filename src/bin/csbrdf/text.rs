//! Numbers and names as text.

/// Control characters replaced: names out of files must not steer the terminal, and a message is one line.
pub fn clean(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { '\u{FFFD}' } else { c }).collect()
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

/// Nine significant digits, enough to tell any two single-precision numbers apart; `%g` of C.
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
}
