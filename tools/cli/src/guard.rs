//! What an output may not replace unless it is asked for by name: files that exist, the inputs themselves, and the measurement that
//! an input was made from, which may exist nowhere else.

use std::fs::Metadata as Found;
use std::io::Read;
use std::path::{Path, PathBuf};

use csbrdf::decode::Reader;
use csbrdf::format::metadata::Metadata;
use sha2::{Digest, Sha256};

use crate::failure::{Failure, Outcome};
use crate::path::{folder_of, is_dash, label};
use crate::sets::manifest::is_plain;
use crate::source;
use crate::text::hex;

/// See the module.
#[derive(Clone, Debug, Default)]
pub struct Guard {
    force: bool,
    replace_source: bool,
    inputs: Vec<PathBuf>,
    sources: Vec<Stated>,
}

/// What the metadata of a file state of its source.
#[derive(Clone, Debug)]
struct Stated {
    of: String,
    name: Option<String>,
    sha256: Option<String>,
}

impl Guard {
    /// Of a command with --force and --replace-source, or without.
    pub fn new(force: bool, replace_source: bool) -> Guard {
        Guard { force, replace_source, ..Guard::default() }
    }

    /// As if with --force.
    pub fn forced(mut self) -> Guard {
        self.force = true;
        self
    }

    /// Guards an input too.
    pub fn input(mut self, path: &Path) -> Guard {
        if !is_dash(path) {
            self.inputs.push(path.to_path_buf());
        }
        self
    }

    /// Guards inputs too.
    pub fn inputs<'a>(self, paths: impl IntoIterator<Item = &'a PathBuf>) -> Guard {
        paths.into_iter().fold(self, |guard, path| guard.input(path))
    }

    /// Guards the source of a file too, as far as its metadata can be read and name one.
    pub fn source_of<D: AsRef<[u8]>>(self, path: &Path, reader: &Reader<D>) -> Guard {
        match reader.metadata() {
            Ok(metadata) => self.stated(path, &metadata),
            Err(_) => self,
        }
    }

    /// Guards the source that metadata name.
    pub fn stated(mut self, path: &Path, metadata: &Metadata) -> Guard {
        let (name, sha256) = (metadata.source_file.clone(), metadata.source_sha256.clone());
        if name.is_some() || sha256.is_some() {
            self.sources.push(Stated { of: label(path), name, sha256 });
        }
        self
    }

    /// Whether a file that exists may be replaced, were it neither input nor source.
    pub fn replaces(&self) -> bool {
        self.force || self.replace_source
    }

    /// Fails if a file that exists may not be replaced.
    pub fn check(&self, path: &Path) -> Outcome {
        let Ok(found) = std::fs::metadata(path) else { return Ok(()) };
        if !found.is_file() || self.replace_source {
            return Ok(());
        }
        let same = |other: &Path| {
            std::fs::metadata(other).is_ok_and(|other_found| is_same((path, &found), (other, &other_found)))
        };
        if self.inputs.iter().any(|input| same(input)) {
            return Err(refused(path, "is an input itself"));
        }
        for stated in &self.sources {
            // The name in the folder of the output: by way of the file system, which knows other spellings of it.
            let name = stated.name.as_deref().filter(|name| is_plain(name));
            if name.is_some_and(|name| same(&folder_of(path).join(name))) {
                return Err(refused(path, &format!("has the name of the table that {} was made from", stated.of)));
            }
        }
        if !self.force {
            return Err(exists(path));
        }
        let stated: Vec<_> = self.sources.iter().filter_map(|s| Some((&s.of, s.sha256.as_deref()?))).collect();
        if stated.is_empty() {
            return Ok(());
        }
        let hash = hash_of(path)?;
        match stated.iter().find(|(_, stated)| hash.eq_ignore_ascii_case(stated)) {
            Some((of, _)) => Err(refused(path, &format!("is the table that {of} was made from, by its SHA-256"))),
            None => Ok(()),
        }
    }
}

fn refused(path: &Path, what: &str) -> Failure {
    let remedy = "name another output, or give --replace-source to replace it all the same";
    Failure::operation(format!("{}: {what}; {remedy}", path.display()))
}

/// The failure to replace a file without --force.
pub fn exists(path: &Path) -> Failure {
    Failure::operation(format!("{}: exists already; --force replaces it", path.display()))
}

/// Whether two paths lead to one file, through whatever links and spellings.
fn is_same((path, found): (&Path, &Found), (other, other_found): (&Path, &Found)) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let _ = (path, other);
        (found.dev(), found.ino()) == (other_found.dev(), other_found.ino())
    }
    #[cfg(not(unix))]
    {
        let _ = (found, other_found);
        matches!((path.canonicalize(), other.canonicalize()), (Ok(one), Ok(two)) if one == two)
    }
}

/// SHA-256 of a regular file as it is now.
pub fn hash_of(path: &Path) -> Result<String, Failure> {
    let (file, length) = source::open_regular(path)?;
    let (mut from, mut hash, mut part) = (file.take(length), Sha256::new(), vec![0; 1 << 16]);
    loop {
        match from.read(&mut part) {
            Ok(0) => return Ok(hex(&hash.finalize())),
            Ok(read) => hash.update(&part[..read]),
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(Failure::io(path, &e)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_and_sources_are_not_replaced_by_force_alone() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in ["in", "table", "copy", "other"] {
            std::fs::write(at(name), if name == "copy" { "table" } else { name }).unwrap();
        }
        std::fs::hard_link(at("in"), at("hard")).unwrap();
        std::fs::create_dir(at("sub")).unwrap();
        let metadata = Metadata {
            source_file: Some("table".into()),
            source_sha256: Some(hex(&Sha256::digest(b"table")).to_uppercase()),
            ..Metadata::default()
        };
        let guard = |force, replace| Guard::new(force, replace).input(&at("in")).stated(Path::new("f"), &metadata);
        for name in ["in", "hard", "sub/../in", "table", "copy"] {
            assert!(guard(true, false).check(&at(name)).is_err(), "{name}");
            assert!(guard(false, false).check(&at(name)).is_err(), "{name}");
            assert!(guard(false, true).check(&at(name)).is_ok(), "{name}");
        }
        assert!(guard(true, false).check(&at("other")).is_ok() && guard(false, false).check(&at("other")).is_err());
        assert!(guard(false, false).check(&at("new")).is_ok());
        // A name that leads elsewhere is none.
        let metadata = Metadata { source_file: Some("../other".into()), ..Metadata::default() };
        assert!(Guard::new(true, false).stated(Path::new("f"), &metadata).check(&at("other")).is_ok());
    }
}
