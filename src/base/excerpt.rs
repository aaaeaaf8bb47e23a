//! Foreign text in messages: a line of a file, a name, may be of any length.

use std::borrow::Cow;

/// Most characters of foreign text that a message quotes.
pub const MOST: usize = 80;

/// The text, or its beginning and how much is left out.
pub fn excerpt(text: &str) -> Cow<'_, str> {
    match text.char_indices().nth(MOST) {
        None => text.into(),
        Some((end, _)) => {
            let (shown, rest) = text.split_at(end);
            format!("{shown}... ({} more bytes)", rest.len()).into()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_is_said() {
        assert_eq!(excerpt("short"), "short");
        let fits = "\u{e9}".repeat(MOST);
        assert_eq!(excerpt(&fits), fits);
        assert_eq!(excerpt(&format!("{fits}\u{e9}z")), format!("{fits}... (3 more bytes)"));
    }
}
