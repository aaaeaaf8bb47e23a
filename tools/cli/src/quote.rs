//! Text inside HTML, JSON, CSV and shell commands.

use std::borrow::Cow;
use std::fmt::Write;

use crate::text::is_hidden;

/// Text as content or quoted attribute of HTML and SVG.
pub fn html(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // Control characters are not allowed in a page, not even as references; others turn its text around.
            c if is_hidden(c) && !matches!(c, '\n' | '\t') => out.push('\u{FFFD}'),
            c => out.push(c),
        }
    }
    out
}

/// JSON with hidden characters as escapes: the same value to a program, and harmless on a terminal. In JSON they stand within
/// strings alone, but for line ends between its parts.
pub fn json(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if !is_hidden(c) || c == '\n' {
            out.push(c);
            continue;
        }
        for unit in c.encode_utf16(&mut [0; 2]) {
            // Writing to a string does not fail.
            let _ = write!(out, "\\u{unit:04x}");
        }
    }
    out
}

/// A field of a CSV row (RFC 4180). Spreadsheets take text that begins like a formula for one, and may run commands by it: an
/// apostrophe before it makes it text to them. Numbers stay numbers. Hidden characters but line ends are replaced.
pub fn csv(field: &str) -> Cow<'_, str> {
    const FORMULA: [char; 10] = ['=', '+', '-', '@', '\t', '\r', '\u{FF1D}', '\u{FF0B}', '\u{FF0D}', '\u{FF20}'];
    let is_formula = field.starts_with(FORMULA) && field.parse::<f64>().is_err();
    let is_hidden = |c: char| is_hidden(c) && c != '\n';
    // Semicolons and tabs part fields in some countries' spreadsheets.
    let is_quoted = field.contains([',', '"', '\n', '\r', ';', '\t']);
    if !is_formula && !is_quoted && !field.contains(is_hidden) {
        return field.into();
    }
    let mut out = String::with_capacity(field.len() + 8);
    out.extend(is_quoted.then_some('"'));
    out.extend(is_formula.then_some('\''));
    for c in field.chars() {
        match c {
            '"' => out.push_str("\"\""),
            c if is_hidden(c) => out.push('\u{FFFD}'),
            c => out.push(c),
        }
    }
    out.extend(is_quoted.then_some('"'));
    out.into()
}

/// A word of a POSIX shell's command.
pub fn shell(word: &str) -> Cow<'_, str> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./,:=+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.into()
    } else {
        format!("'{}'", word.replace('\'', r"'\''")).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_is_shown_not_obeyed() {
        assert_eq!(html("<b a=\"1\" c='2'>&\u{1b}"), "&lt;b a=&quot;1&quot; c=&#39;2&#39;&gt;&amp;\u{FFFD}");
    }

    #[test]
    fn hidden_characters_turn_no_page_around_and_are_escapes_in_json() {
        assert_eq!(html("a\u{202E}b\u{2028}\n\u{E0041}"), "a\u{FFFD}b\u{FFFD}\n\u{FFFD}");
        let value = serde_json::json!({"a\u{9b}": "\u{202E}\u{7f}\n\u{E0041}\u{E9}\\"});
        let text = json(&serde_json::to_string_pretty(&value).unwrap());
        assert_eq!(text, "{\n  \"a\\u009b\": \"\\u202e\\u007f\\n\\udb40\\udc41\u{E9}\\\\\"\n}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap(), value);
    }

    #[test]
    fn text_is_no_formula_and_numbers_are_numbers() {
        let formulas = ["=1+1", "+a", "-2+3", "@SUM(A1)", "\t=1", "\r=1", "\u{FF1D}1", "-", "=\"a\""];
        let texts = [
            "'=1+1",
            "'+a",
            "'-2+3",
            "'@SUM(A1)",
            "\"'\u{FFFD}=1\"",
            "\"'\u{FFFD}=1\"",
            "'\u{FF1D}1",
            "'-",
            "\"'=\"\"a\"\"\"",
        ];
        assert_eq!(formulas.map(csv), texts);
        for number in ["-1.5", "+3", "-1e-7", "-inf", "0"] {
            assert_eq!(csv(number), number);
        }
        assert_eq!(["a=b", "a;=1", "a\u{202E}b"].map(csv), ["a=b", "\"a;=1\"", "a\u{FFFD}b"]);
    }

    #[test]
    fn fields_stay_one() {
        assert_eq!(["a b", "a,b", "a\"b", "a\nb"].map(csv), ["a b", "\"a,b\"", "\"a\"\"b\"", "\"a\nb\""]);
    }

    #[test]
    fn words_stay_one() {
        assert_eq!(["a/b-1.x", "a b", "", "it's", "$x"].map(shell), ["a/b-1.x", "'a b'", "''", r"'it'\''s'", "'$x'"]);
    }
}
