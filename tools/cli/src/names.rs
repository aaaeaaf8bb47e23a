//! What outputs and messages call an input: different inputs differently, whatever their names are.

use std::ffi::OsStr;
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::path::label;
use crate::text::clean;
use crate::text::hex;

/// Most bytes of a name that becomes part of a file's name: file systems take 255, and more is put before and after.
pub const LONGEST: usize = 120;

/// Digits of the hash that stands for what a name cannot show.
const DIGITS: usize = 12;

/// A name that can be shown and be part of a file's name: the name itself, or what can be shown of it and a hash of it.
pub fn safe(name: &OsStr) -> String {
    let shown = clean(&name.to_string_lossy());
    if shown.len() <= LONGEST && name == shown.as_str() {
        return shown;
    }
    let mut end = shown.len().min(LONGEST - DIGITS - 1);
    while !shown.is_char_boundary(end) {
        end -= 1;
    }
    format!("{}-{}", &shown[..end], hash(name))
}

/// What a page or a table calls a path: itself, with a hash of it where it cannot be shown as it is.
pub fn shown(path: &Path) -> String {
    let name = clean(&label(path));
    if name == label(path) && path.to_str().is_some() { name } else { format!("{name} ({})", hash(path.as_os_str())) }
}

fn hash(name: &OsStr) -> String {
    hex(&Sha256::digest(name.as_encoded_bytes()))[..DIGITS].into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_different() {
        assert_eq!(safe("alum-bronze".as_ref()), "alum-bronze");
        let long = "\u{e9}".repeat(100);
        let others = ["a\u{1}", "a\u{2}", "a\u{FFFD}", "a\u{202E}", &long, &long[2..]];
        let mut safe: Vec<String> = others.iter().map(|name| safe(name.as_ref())).collect();
        assert!(safe.iter().all(|name| name.len() <= LONGEST && clean(name) == *name), "{safe:?}");
        assert_eq!(safe[2], "a\u{FFFD}");
        safe.sort_unstable();
        safe.dedup();
        assert_eq!(safe.len(), others.len());
        let [one, two] = ["in/a\u{1}", "in/a\u{2}"].map(|path| shown(path.as_ref()));
        assert!(one != two && one.starts_with("in/a\u{FFFD} ("), "{one} {two}");
        assert_eq!(shown("in/a".as_ref()), "in/a");
    }

    #[cfg(unix)]
    #[test]
    fn names_that_are_no_text_stay_different() {
        use std::os::unix::ffi::OsStrExt;
        let [one, two] = [b"a\xFF", b"a\xFE"].map(|name| OsStr::from_bytes(name));
        assert_ne!(safe(one), safe(two));
        assert_ne!(shown(one.as_ref()), shown(two.as_ref()));
    }
}
