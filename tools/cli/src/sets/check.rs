//! A folder against its manifest: each file is there, has the bytes that the manifest states, is whole by its own
//! checksums and says of itself what the manifest says of it; and no other .csbrdf file is there.

use std::collections::HashSet;
use std::path::Path;

use serde_json::Value;
use sha2::{Digest, Sha256};

use super::manifest::{Manifest, Material};
use super::{entry, unfinished};
use crate::failure::{Failure, Outcome, note};
use crate::formats::Kind;
use crate::formats::READ_LIMIT;
use crate::input::{self, Bytes, is_dash, label};
use crate::source::{self, Source};
use crate::text::hex;
use crate::text::{clean, grouped};
use crate::verify::file::{Original, Results, verify};

/// Verifies a set; with a folder of the tables it was made from, their files against these. What is found is reported file
/// by file.
pub fn run(path: &Path, bytes: &[u8], originals: Option<&Path>, results: &mut Results) -> Outcome {
    if is_dash(path) {
        return Err(Failure::usage(
            "a manifest is checked against the folder that it is in; name it, not standard input",
        ));
    }
    if let Some(folder) = originals.filter(|folder| !folder.is_dir()) {
        let what = "is not a folder; for a manifest --against takes the folder of the tables";
        return Err(Failure::operation(format!("{}: {what}", folder.display())));
    }
    let manifest = super::read(path, bytes)?;
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut failed = 0;
    for material in &manifest.materials {
        let (text, result) = file(folder, &manifest, material, originals);
        failed += usize::from(result.is_err());
        results.result(text, result)?;
    }
    let extra = extra(folder, &manifest)?;
    for name in &extra {
        let what = match unfinished::is_in(folder) {
            true => {
                "is not in the manifest: the set is not finished; run its csbrdf encode again, which keeps and lists it"
            }
            false => "is not in the manifest; encode the set again with its table, or move it to another folder",
        };
        results.result(String::new(), Err(Failure::operation(format!("{}: {what}", folder.join(name).display()))))?;
    }
    let (name, count) = (clean(&label(path)), manifest.materials.len());
    if failed == 0 && extra.is_empty() {
        let text = format!("{name}: ok, {count} materials, {} bytes\n", grouped(manifest.bytes() as usize));
        return results.result(text, Ok(()));
    }
    if !results.quiet {
        let extra = if extra.is_empty() { String::new() } else { format!(", {} not in the manifest", extra.len()) };
        note(&format!("{name}: {failed} of {count} failed{extra}"));
    }
    Ok(())
}

/// One file of the set.
fn file(folder: &Path, manifest: &Manifest, material: &Material, originals: Option<&Path>) -> (String, Outcome) {
    let path = folder.join(&material.file);
    if std::fs::symlink_metadata(&path).is_err_and(|e| e.kind() == std::io::ErrorKind::NotFound) {
        let what = "is missing; fetch it again, or encode its table again";
        return (String::new(), Err(Failure::operation(format!("{}: {what}", path.display()))));
    }
    let bytes = match read(&path, material) {
        Ok(bytes) => bytes,
        Err(failure) => return (String::new(), Err(failure)),
    };
    let (length, hash) = (bytes.as_ref().len() as u64, hex(&Sha256::digest(bytes.as_ref())));
    if (length, &hash) != (material.bytes, &material.sha256) {
        return differs(&path, bytes, manifest, material, &hash);
    }
    let statements = statements(material, bytes.as_ref());
    let table = originals.map(|folder| folder.join(&material.source_file));
    let original = table.as_deref().map(|table| Original { table, sha256: Some(&material.source_sha256) });
    let (text, result) = verify(&path, bytes, original.as_ref());
    let result = result.and_then(|()| match &statements[..] {
        [] => Ok(()),
        all => Err(Failure::bad_input(&path, format!("the manifest says otherwise: {}", all.join(", ")))),
    });
    (text, result)
}

/// The bytes of a file, whatever they are: it is known by its hash. But a long one of another length is not read for that.
fn read(path: &Path, material: &Material) -> Result<Bytes, Failure> {
    let source = source::open_within(path)?;
    match source {
        Source::Regular { length, .. } if length > READ_LIMIT && length != material.bytes => {
            let what = format!("has {length} bytes, the manifest states {}; fetch the file again", material.bytes);
            Err(Failure::bad_input(path, what))
        }
        source => source.read(path, &[Kind::Damaged]),
    }
}

/// What is wrong with a file that is not the one that the manifest states.
fn differs(path: &Path, bytes: Bytes, manifest: &Manifest, material: &Material, hash: &str) -> (String, Outcome) {
    let length = bytes.as_ref().len();
    let other = manifest.materials.iter().find(|other| other.sha256 == hash);
    // Where it is damaged, by its own checksums; that it is whole otherwise is no comfort.
    let (text, own) = verify(path, bytes, None);
    let text = if own.is_ok() { String::new() } else { text };
    let what = match other {
        Some(other) => format!("holds the bytes of {}; exchange them", other.file),
        None if length as u64 != material.bytes => {
            let (got, stated) = (grouped(length), grouped(material.bytes as usize));
            format!("has {got} bytes, the manifest states {stated}; fetch the file again")
        }
        None => format!("has SHA-256 {hash}, the manifest states {}; fetch the file again", material.sha256),
    };
    (text, Err(Failure::bad_input(path, what)))
}

/// What the manifest states of a file and the file itself otherwise; nothing of what it does not say.
fn statements(material: &Material, bytes: &[u8]) -> Vec<String> {
    let Ok(reader) = input::reader(bytes) else { return Vec::new() };
    let Ok(metadata) = reader.metadata() else { return Vec::new() };
    let encoder = metadata.encoder.unwrap_or_default();
    let mut found = Vec::new();
    let mut compare = |what: &str, stated: f64, own: Option<f64>| {
        if let Some(own) = own.filter(|own| *own != stated) {
            found.push(format!("{what} is {own}, not {stated}"));
        }
    };
    let own = |key: &str| encoder.get(key).and_then(Value::as_f64);
    let entries = reader.grid().positions() * reader.grid().channels().len();
    compare("entries", material.entries as f64, Some(entries as f64));
    compare("valid", material.valid as f64, own("valid"));
    compare("sampled", material.sampled as f64, own("sampled"));
    compare("log_rms", material.log_rms, own("log_rms"));
    compare("log_max", material.log_max, own("log_max"));
    if let Some(kept) = &material.contract {
        let own = encoder.get("contract");
        compare(&kept.name, kept.asked, own.and_then(|c| c.get(&kept.name)).and_then(Value::as_f64));
        compare("achieved", kept.achieved, own.and_then(|c| c.get("achieved")).and_then(Value::as_f64));
    }
    found
}

/// The .csbrdf files of the folder that the manifest does not list, by name.
fn extra(folder: &Path, manifest: &Manifest) -> Result<Vec<String>, Failure> {
    let listed: HashSet<&str> = manifest.materials.iter().map(|m| m.file.as_str()).collect();
    let mut extra = entry::files(folder)?;
    extra.retain(|name| !listed.contains(name.as_str()));
    Ok(extra)
}
