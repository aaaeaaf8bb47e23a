//! The manifest of a set, JSON: what its files are, where they come from and how far off they are (spec/manifest.md).
//!
//! The same tables and settings give the same manifest, byte for byte: it holds no times, folders or dates.

use std::collections::HashSet;
use std::io::Write;
use std::path::{Component, Path};

use csbrdf::decode::Reader;
use csbrdf::encode::Encoded;
use csbrdf::encode::contract::{Contract, Figures};
use csbrdf::format::metadata::Metadata;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use crate::encode::hex;
use crate::failure::Failure;
use crate::output::Target;

/// Its name in the folder of the files.
pub const NAME: &str = "manifest.json";
const FORMAT: &str = "csbrdf-manifest";
const VERSION: u64 = 1;
/// Most bytes of a manifest: some 100,000 materials.
const LIMIT: usize = 1 << 26;

/// A set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// [`VERSION`]; a reader refuses others. Keys that it does not know it ignores.
    pub version: u64,
    /// Tool and version that wrote the manifest.
    pub tool: String,
    /// In the order in which they were given.
    pub materials: Vec<Material>,
}

/// One file of a set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Name of the material.
    pub name: String,
    /// Name of its file in the folder of the manifest.
    pub file: String,
    /// Length of the file.
    pub bytes: u64,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// Name of the table that the file was made from, without folders.
    pub source_file: String,
    /// SHA-256 of that table's bytes, hexadecimal.
    pub source_sha256: String,
    /// Entries of all channels.
    pub entries: u64,
    /// Valid ones among them.
    pub valid: u64,
    /// Sampled ones among these.
    pub sampled: u64,
    /// Quantiser step, log domain.
    pub step: f32,
    /// Root mean square error of ln(f + eps) over the valid entries.
    pub log_rms: f64,
    /// Largest error of ln(f + eps) over the valid entries.
    pub log_max: f64,
    /// What the file was asked to keep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contract: Option<Kept>,
    /// The file's metadata but for what stands above and what the encoder says of itself: licence, authors and so on.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub metadata: Map<String, Value>,
}

/// A contract of the encoder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// `max_error`, `rmse`, `psnr_db`, `bytes` or `ratio`.
    pub name: String,
    /// The bound.
    pub asked: f64,
    /// The file's figure.
    pub achieved: f64,
}

impl Kept {
    /// A contract and what the file says of it.
    pub fn of(contract: Contract, encoded: &Encoded) -> csbrdf::Result<Kept> {
        let stated = Reader::open(&encoded.bytes[..])?.metadata()?.encoder.unwrap_or_default();
        let report = &encoded.report;
        let figures = Figures {
            bytes: encoded.bytes.len() as u64,
            entries: report.entries,
            log_rms: report.log_rms,
            log_max: report.log_max,
            psnr: stated["contract"]["achieved"].as_f64(),
        };
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

    /// Bytes of the table in float64 over those of the file.
    pub fn ratio(&self) -> f64 {
        8.0 * self.entries as f64 / self.bytes.max(1) as f64
    }
}

impl Manifest {
    /// The manifest of these files.
    pub fn new(materials: Vec<Material>) -> Manifest {
        let tool = concat!("csbrdf ", env!("CARGO_PKG_VERSION")).into();
        Manifest { format: FORMAT.into(), version: VERSION, tool, materials }
    }

    /// Bytes of all files.
    pub fn bytes(&self) -> u64 {
        self.materials.iter().fold(0, |sum, m| sum.saturating_add(m.bytes))
    }

    /// Bytes of all tables in float64 over those of all files.
    pub fn ratio(&self) -> f64 {
        8.0 * self.materials.iter().map(|m| m.entries as f64).sum::<f64>() / self.bytes().max(1) as f64
    }

    /// Writes it, with a line end.
    pub fn write(&self, out: &mut dyn Write) -> csbrdf::Result<()> {
        serde_json::to_writer_pretty(&mut *out, self).map_err(std::io::Error::from)?;
        Ok(out.write_all(b"\n")?)
    }

    /// Whether bytes are JSON rather than a csbrdf file.
    pub fn is_likely(bytes: &[u8]) -> bool {
        bytes.iter().find(|b| !b.is_ascii_whitespace()) == Some(&b'{')
    }

    /// Reads one. File names in it are names without folders, and no file is there twice.
    pub fn read(path: &Path, bytes: &[u8]) -> Result<Manifest, Failure> {
        let bad = |what: String| Failure::bad_input(path, what);
        if bytes.len() > LIMIT {
            return Err(Failure::unsupported(path, format!("a manifest has at most {LIMIT} bytes")));
        }
        // What it is before what it says: another version may say it in another way.
        let value: Value =
            serde_json::from_slice(bytes).map_err(|e| bad(format!("is damaged, or no manifest: {e}")))?;
        if value["format"] != FORMAT {
            return Err(bad(format!("is no manifest of csbrdf files: \"format\" is not \"{FORMAT}\"")));
        }
        if value["version"] != VERSION {
            let what = format!("manifest version {}, this build reads {VERSION}; update csbrdf", value["version"]);
            return Err(Failure::unsupported(path, what));
        }
        let manifest: Manifest = serde_json::from_value(value).map_err(|e| bad(format!("damaged manifest: {e}")))?;
        let mut files = HashSet::new();
        for material in &manifest.materials {
            for name in [&material.file, &material.source_file] {
                if !is_plain(name) {
                    return Err(bad(format!("{name:?} is not the name of a file in one folder")));
                }
            }
            if !files.insert(&material.file) {
                return Err(bad(format!("{:?} is listed twice", material.file)));
            }
        }
        Ok(manifest)
    }
}

/// Whether text names a file in a folder, not one elsewhere.
fn is_plain(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    let single = matches!((parts.next(), parts.next()), (Some(Component::Normal(part)), None) if part == name);
    single && !name.contains(['/', '\\', '\0'])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_elsewhere_are_refused() {
        assert!(["a.csbrdf", "a b", "ä.csbrdf", "..a"].into_iter().all(is_plain));
        assert!(["", ".", "..", "/a", "a/b", "a/", "./a", "../a", "a\\b", "a\0"].iter().all(|n| !is_plain(n)));
    }

    #[test]
    fn what_is_no_manifest_is_told() {
        let path = Path::new("m.json");
        let read = |text: &str| Manifest::read(path, text.as_bytes()).map_err(|f| f.code());
        let head = r#""format": "csbrdf-manifest", "tool": "t""#;
        assert_eq!(read(&format!("{{{head}, \"version\": 1, \"materials\": [], \"new\": 3}}")).unwrap().materials, []);
        assert_eq!(read(&format!("{{{head}, \"version\": 2, \"materials\": 7}}")), Err(4));
        for text in ["{", "{}", "[1]", "{\"format\": 1}", &format!("{{{head}, \"version\": 1, \"materials\": [{{}}]}}")]
        {
            assert_eq!(read(text), Err(3), "{text}");
        }
        assert!(Manifest::is_likely(b" \n{}") && !Manifest::is_likely(b"") && !Manifest::is_likely(b"CSBRDF{"));
    }
}
