//! A set that is being made: which of its files are finished, so that a run that was interrupted is gone on with.
//!
//! While a set is made, its folder holds a record, one line of JSON for each file: what the manifest will say of it. A line is on
//! the disk before its file has its name, so that every file that a run has finished is in the record, whatever ended the run.
//! The next run with the same settings keeps a file if the record, or else the manifest of a finished set, states its bytes and
//! those of its table. A file that neither states is made again, and kept if it comes out the same.

use std::collections::HashMap;
use std::fs::{File, TryLockError};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::SystemTime;

use csbrdf::decode::Reader;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::manifest::{self, LIMIT, Manifest, Material};
use crate::failure::{Failure, Outcome, note};
use crate::formats::Kind;
use crate::guard::exists;
use crate::input;
use crate::source;
use crate::text::hex;

/// Name of the record in the folder of the set.
pub const NAME: &str = ".csbrdf-set.jsonl";
const FORMAT: &str = "csbrdf-unfinished-set";
const VERSION: u64 = 1;

/// What is said of a set that was made otherwise.
const OTHERWISE: &str = "with other settings or another version of csbrdf";

/// The first line of a record.
#[derive(Serialize, Deserialize)]
struct Head {
    format: String,
    version: u64,
    /// As in the manifest.
    settings: String,
}

/// See the module.
pub struct Set {
    folder: PathBuf,
    settings: String,
    force: bool,
    /// What the record says, or the manifest.
    finished: HashMap<String, Material>,
    /// The bytes of the manifest of an earlier run.
    manifest: Option<Vec<u8>>,
    record: Mutex<Record>,
}

/// The record, locked as long as it is open.
struct Record {
    file: File,
    entries: usize,
}

impl Set {
    /// Begins a set of these file names in a folder, or goes on with one. Fails if something else is there and `force` is not set.
    pub fn open(folder: &Path, settings: &str, names: &[String], force: bool) -> Result<Set, Failure> {
        let (mut file, begun) = open_record(folder)?;
        let text = read_record(&folder.join(NAME), &mut file)?;
        let parsed = Parsed::of(&text);
        let goes_on = parsed.settings.as_deref() == Some(settings);
        let checked = check_manifest(folder, settings, names, force).and_then(|manifest| {
            if !force {
                check_others(folder, names)?;
                let left = parsed.finished.keys().find(|name| folder.join(name).exists());
                if let (false, Some(name)) = (goes_on, left) {
                    let what = format!("was made {OTHERWISE} by a run that did not end; --force replaces it");
                    return Err(Failure::operation(format!("{}: {what}", folder.join(name).display())));
                }
            }
            Ok(manifest)
        });
        let manifest = match checked {
            Ok(manifest) => manifest,
            Err(failure) => {
                if begun {
                    let _ = std::fs::remove_file(folder.join(NAME));
                }
                return Err(failure);
            }
        };
        if !begun {
            remove_leftovers(folder);
        }
        let mut finished = HashMap::new();
        let mut bytes = None;
        if let Some((manifest, text)) = manifest {
            // Asked to replace what is there, a run makes again all but what it has made itself before it was interrupted.
            if !force {
                finished.extend(manifest.materials.into_iter().map(|m| (m.file.clone(), m)));
            }
            bytes = Some(text);
        }
        let mut record = Record { file, entries: 0 };
        if goes_on {
            record.entries = parsed.finished.len();
            finished.extend(parsed.finished);
            record.cut(parsed.whole).map_err(|e| Failure::io(&folder.join(NAME), &e))?;
        } else {
            let head = Head { format: FORMAT.into(), version: VERSION, settings: settings.into() };
            let begin = record.cut(0).and_then(|()| record.append(&head));
            begin.map_err(|e| Failure::io(&folder.join(NAME), &e))?;
        }
        let (folder, settings) = (folder.to_path_buf(), settings.to_string());
        Ok(Set { folder, settings, force, finished, manifest: bytes, record: Mutex::new(record) })
    }

    /// What the manifest says of a file that is there already and is what this run would make of a table; `None` if it is to be
    /// made. Fails if it is another one and may not be replaced.
    pub fn finished(&self, path: &Path, table: &Path, bytes: &[u8]) -> Result<Option<Material>, Failure> {
        if !is_there(path)? {
            return Ok(None);
        }
        let source = hex(&Sha256::digest(bytes));
        let otherwise = |what: &str| match self.force {
            true => Ok(None),
            false => Err(Failure::operation(format!("{}: {what}; --force replaces it", path.display()))),
        };
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let Some(material) = self.finished.get(&name) else {
            return match stated(path) {
                Some(stated) if stated != source => otherwise("was made from another table"),
                Some(_) => Ok(None),
                None => otherwise("exists already, and is no file of this set"),
            };
        };
        if material.source_sha256 != source || table.file_name().is_none_or(|name| *name != *material.source_file) {
            return otherwise("was made from another table");
        }
        let own = input::read_within(path, &[Kind::Damaged])?;
        if own.as_ref().len() as u64 != material.bytes || hex(&Sha256::digest(own.as_ref())) != material.sha256 {
            return otherwise("is not the file that an earlier run wrote; it was changed or damaged");
        }
        Ok(Some(material.clone()))
    }

    /// Notes a file that is about to get its name. True if it is there already with these bytes, which are then kept; fails if
    /// another one is there that may not be replaced.
    pub fn begin(&self, path: &Path, bytes: &[u8], material: &Material) -> Result<bool, Failure> {
        let kept = is_there(path)? && input::read_within(path, &[Kind::Damaged])?.as_ref() == bytes;
        if !kept && !self.force && is_there(path)? {
            let what = format!("exists already, and was made {OTHERWISE}; --force replaces it");
            return Err(Failure::operation(format!("{}: {what}", path.display())));
        }
        let failed = |e: std::io::Error| Failure::io(&self.folder.join(NAME), &e);
        let mut record = self.record.lock().map_err(|_| Failure::operation("a thread failed".into()))?;
        record.append(material).map_err(failed)?;
        record.entries += 1;
        Ok(kept)
    }

    /// The manifest of an earlier run, if these bytes are the same.
    pub fn has_manifest(&self, bytes: &[u8]) -> bool {
        self.manifest.as_deref() == Some(bytes)
    }

    /// Hash of the settings.
    pub fn settings(&self) -> &str {
        &self.settings
    }

    /// Ends the set: the manifest says all that the record did.
    pub fn finish(self) -> Outcome {
        let path = self.folder.join(NAME);
        std::fs::remove_file(&path).map_err(|e| Failure::io(&path, &e))
    }

    /// Leaves the set unfinished, and no record where nothing was.
    pub fn leave(self) -> Outcome {
        match self.record.lock().is_ok_and(|record| record.entries == 0) {
            true => self.finish(),
            false => Ok(()),
        }
    }
}

impl Record {
    fn cut(&mut self, length: u64) -> std::io::Result<()> {
        self.file.set_len(length)?;
        self.file.seek(SeekFrom::Start(length)).map(|_| ())
    }

    /// A line, on the disk when this returns.
    fn append(&mut self, line: &impl Serialize) -> std::io::Result<()> {
        let mut text = serde_json::to_vec(line)?;
        text.push(b'\n');
        self.file.write_all(&text)?;
        self.file.sync_data()
    }
}

/// What a record says.
#[derive(Default)]
struct Parsed {
    settings: Option<String>,
    finished: HashMap<String, Material>,
    /// Bytes of its whole lines.
    whole: u64,
}

impl Parsed {
    /// A run that was interrupted may have left a part of a line at the end, and no file for it.
    fn of(text: &[u8]) -> Parsed {
        let mut parsed = Parsed::default();
        for line in text.split_inclusive(|b| *b == b'\n').filter(|line| line.ends_with(b"\n")) {
            if parsed.whole == 0 {
                match serde_json::from_slice::<Head>(line) {
                    Ok(head) if head.format == FORMAT && head.version == VERSION => {
                        parsed.settings = Some(head.settings)
                    }
                    _ => break,
                }
            } else if let Ok(material) = serde_json::from_slice::<Material>(line)
                && material.check().is_ok()
            {
                parsed.finished.insert(material.file.clone(), material);
            }
            parsed.whole += line.len() as u64;
        }
        parsed
    }
}

/// Whether the set in a folder is unfinished.
pub fn is_in(folder: &Path) -> bool {
    std::fs::symlink_metadata(folder.join(NAME)).is_ok_and(|found| found.is_file())
}

/// Opens the record and locks it; true if there was none.
fn open_record(folder: &Path) -> Result<(File, bool), Failure> {
    let path = folder.join(NAME);
    let failed = |e: std::io::Error| Failure::io(&path, &e);
    for _ in 0..3 {
        let made = File::options().read(true).write(true).create_new(true).open(&path);
        let (file, begun) = match made {
            Ok(file) => (file, true),
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {
                let found = std::fs::symlink_metadata(&path).map_err(failed)?;
                if !found.is_file() {
                    return Err(Failure::operation(format!("{}: is no regular file; remove it", path.display())));
                }
                (File::options().read(true).write(true).open(&path).map_err(failed)?, false)
            }
            Err(e) => return Err(failed(e)),
        };
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => {
                let what = "another csbrdf encode is making this set; wait for its end";
                return Err(Failure::operation(format!("{}: {what}", folder.display())));
            }
            // Where nothing can be locked, nothing is.
            Ok(()) | Err(TryLockError::Error(_)) => {}
        }
        // The other one may have ended, and its record with it, before this one had the lock.
        if path.exists() && (begun || is_linked(&file)) {
            return Ok((file, begun));
        }
    }
    Err(Failure::operation(format!("{}: other runs begin and end there; try again", folder.display())))
}

fn is_linked(file: &File) -> bool {
    #[cfg(unix)]
    return file.metadata().is_ok_and(|found| std::os::unix::fs::MetadataExt::nlink(&found) > 0);
    #[cfg(not(unix))]
    {
        let _ = file;
        true
    }
}

fn read_record(path: &Path, file: &mut File) -> Result<Vec<u8>, Failure> {
    let mut text = Vec::new();
    let read = file.take(LIMIT as u64 + 1).read_to_end(&mut text);
    read.map_err(|e| Failure::io(path, &e))?;
    if text.len() > LIMIT {
        return Err(Failure::unsupported(path, format!("a record of more than {LIMIT} bytes; remove it")));
    }
    Ok(text)
}

/// Removes temporary files of the run that was interrupted. Those of a command that is at work there now are such files for the
/// moment of a rename on Linux, and elsewhere newer as a rule; else that command fails and says so.
fn remove_leftovers(folder: &Path) {
    let now = SystemTime::now();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let old = entry.metadata().is_ok_and(|found| found.is_file() && found.modified().is_ok_and(|then| then < now));
        if name.starts_with(".csbrdf-") && name.ends_with(".tmp") && old {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// The manifest that is there, and its bytes. Fails if it is of something else and `force` is not set.
fn check_manifest(
    folder: &Path,
    settings: &str,
    names: &[String],
    force: bool,
) -> Result<Option<(Manifest, Vec<u8>)>, Failure> {
    let path = folder.join(manifest::NAME);
    if !is_there(&path)? {
        return Ok(None);
    }
    let text = input::read_within(&path, &[Kind::Damaged])?.as_ref().to_vec();
    let what = match Manifest::read(&text) {
        Err(_) => return if force { Ok(None) } else { Err(exists(&path)) },
        Ok(found) if found.settings.as_deref() != Some(settings) => {
            format!("exists already, of a set that was made {OTHERWISE}; --force replaces it")
        }
        Ok(found) => match found.materials.iter().find(|m| !names.contains(&m.file)) {
            Some(m) => format!("lists {}, which none of the tables given becomes; --force makes it without", m.file),
            None => return Ok(Some((found, text))),
        },
    };
    if force { Ok(None) } else { Err(Failure::operation(format!("{}: {what}", path.display()))) }
}

/// Fails, naming them, if files are there that would not be in the manifest.
fn check_others(folder: &Path, names: &[String]) -> Outcome {
    let mut others = super::entry::files(folder)?;
    others.retain(|name| !names.contains(name));
    let what =
        "none of the tables given becomes this file; move it elsewhere, or leave it out of the manifest by --force";
    let mut failures = others.iter().map(|name| Failure::operation(format!("{}: {what}", folder.join(name).display())));
    let Some(mut last) = failures.next() else { return Ok(()) };
    for failure in failures {
        last.report();
        last = failure;
    }
    Err(last)
}

/// Whether a regular file has this name; fails if anything else has.
fn is_there(path: &Path) -> Result<bool, Failure> {
    match std::fs::symlink_metadata(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(false),
        Err(e) => Err(Failure::io(path, &e)),
        Ok(_) => source::open_within(path).map(|_| true),
    }
}

/// The hash of its source that a file of this version states; `None` if it is none.
fn stated(path: &Path) -> Option<String> {
    let bytes = input::read_within(path, &[Kind::Csbrdf]).ok()?;
    let metadata = Reader::open(bytes).ok()?.metadata().ok()?;
    metadata.source_sha256.filter(|_| metadata.tool.as_deref() == Some(manifest::TOOL))
}

/// Says what became of a set that is not finished.
pub fn note_unfinished(folder: &Path) {
    let path = folder.join(manifest::NAME).display().to_string();
    note(&format!("{path}: not written, see above; the same command again keeps what is finished"));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn material(file: &str) -> Material {
        let json = format!(
            r#"{{"name":"","file":"{file}","bytes":3,"sha256":"{0}","source_file":"b","source_sha256":"{0}","entries":0,
            "valid":0,"sampled":0,"step":1,"log_rms":0,"log_max":0}}"#,
            "0".repeat(64)
        );
        serde_json::from_str(&json).unwrap()
    }

    #[test]
    fn a_record_that_ends_anywhere_says_what_it_says() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["a", "b"].map(String::from);
        let set = Set::open(folder.path(), "s", &names, false).unwrap();
        assert!(Set::open(folder.path(), "s", &names, false).is_err(), "two at a time");
        for name in &names {
            assert!(!set.begin(&folder.path().join(name), b"xyz", &material(name)).unwrap());
        }
        set.leave().unwrap();
        let path = folder.path().join(NAME);
        let text = std::fs::read(&path).unwrap();
        let lines: Vec<usize> = (0..text.len()).filter(|&i| text[i] == b'\n').map(|i| i + 1).collect();
        for cut in 0..=text.len() {
            std::fs::write(&path, &text[..cut]).unwrap();
            let set = Set::open(folder.path(), "s", &names, false).unwrap();
            assert_eq!(set.finished.len(), lines.iter().skip(1).filter(|end| **end <= cut).count(), "{cut}");
            drop(set);
            // Of other settings: nothing of it counts.
            std::fs::write(&path, &text[..cut]).unwrap();
            assert!(Set::open(folder.path(), "t", &names, false).unwrap().finished.is_empty());
        }
        Set::open(folder.path(), "s", &names, false).unwrap().leave().unwrap();
        assert!(!path.exists());
    }
}
