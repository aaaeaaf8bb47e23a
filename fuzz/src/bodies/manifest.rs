//! The manifest of a set, from arbitrary bytes: read or refused; what was read names files of one folder and comes back from what is
//! written of it.

use std::collections::HashSet;
use std::path::Path;

#[allow(dead_code)]
#[path = "../../../tools/cli/src/sets/manifest.rs"]
mod sets;

use sets::{Manifest, Refused};

pub fn run(data: &[u8]) {
    let manifest = match Manifest::read(data) {
        Ok(manifest) => manifest,
        // A line of a message, whatever it cites.
        Err(Refused::Bad(what) | Refused::Unsupported(what)) => {
            return assert!((1..=300).contains(&what.chars().count()));
        }
    };
    assert!(Manifest::is_likely(data));
    let mut files = HashSet::new();
    for material in &manifest.materials {
        for name in [&material.file, &material.source_file] {
            assert!(Path::new("folder").join(name).parent() == Some(Path::new("folder")), "{name:?}");
            assert!(Path::new(name).file_name().is_some_and(|own| own == &**name), "{name:?}");
        }
        assert!(files.insert(&material.file) && material.sha256.len() == 64);
        assert!(material.ratio() >= 0.0);
    }
    assert!(manifest.ratio() >= 0.0 && manifest.materials.iter().all(|m| m.bytes <= manifest.bytes()));
    let mut text = Vec::new();
    manifest.write(&mut text).expect("memory does not refuse");
    assert!(Manifest::read(&text).is_ok_and(|again| again == manifest));
}
