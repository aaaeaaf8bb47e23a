//! The entry of a file in the manifest, from what the encoder says of it.

use std::path::Path;

use csbrdf::decode::Reader;
use csbrdf::encode::Encoded;
use csbrdf::encode::contract::Contract;
use csbrdf::format::metadata::Metadata;
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use super::manifest::{Kept, Material};
use crate::failure::Failure;
use crate::output::Target;
use crate::text::hex;

impl Kept {
    /// A contract and what the file says of it.
    pub fn of(contract: Contract, encoded: &Encoded) -> csbrdf::Result<Kept> {
        let stated = Reader::open(&encoded.bytes[..])?.metadata()?.encoder.unwrap_or_default();
        let mut figures = encoded.figures();
        figures.psnr = stated["contract"]["achieved"].as_f64();
        Ok(Kept { name: contract.name().into(), asked: contract.asked(), achieved: contract.figure(&figures) })
    }
}

impl Material {
    /// The entry of a file that was just made of an input with this hash, whatever the metadata say of their source.
    pub fn new(
        (input, source_sha256): (&Path, String),
        target: &Target,
        metadata: Metadata,
        contract: Option<Kept>,
        encoded: &Encoded,
    ) -> Material {
        let text = |part: Option<&std::ffi::OsStr>| part.map_or(String::new(), |p| p.to_string_lossy().into_owned());
        let (bytes, report) = (&encoded.bytes, &encoded.report);
        let name = metadata.name.unwrap_or_else(|| text(input.file_stem()));
        let rest = Metadata {
            name: None,
            source_file: metadata.source_file.filter(|name| *name != text(input.file_name())),
            source_sha256: metadata.source_sha256.filter(|hash| *hash != source_sha256),
            tool: None,
            encoder: None,
            ..metadata
        };
        Material {
            name,
            file: match target {
                Target::File(path) => text(path.file_name()),
                Target::Stdout => String::new(),
            },
            bytes: bytes.len() as u64,
            sha256: hex(&Sha256::digest(bytes)),
            source_file: text(input.file_name()),
            source_sha256,
            entries: report.entries as u64,
            valid: report.valid as u64,
            sampled: report.sampled as u64,
            step: report.step,
            log_rms: report.log_rms,
            log_max: report.log_max,
            contract,
            metadata: match serde_json::to_value(rest) {
                Ok(Value::Object(map)) => map,
                _ => Map::new(),
            },
        }
    }
}

/// The .csbrdf files of a folder but hidden ones, by name.
pub fn files(folder: &Path) -> Result<Vec<String>, Failure> {
    let failed = |e: std::io::Error| Failure::io(folder, &e);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        let name = name.to_string_lossy();
        if name.ends_with(".csbrdf") && !name.starts_with('.') {
            files.push(name.into_owned());
        }
    }
    files.sort_unstable();
    Ok(files)
}
