//! The manifest of a set, JSON: what its files are, where they come from and how far off they are (spec/manifest.md).
//!
//! The same tables and settings give the same manifest, byte for byte: it holds no times, folders or dates.

use std::collections::HashSet;
use std::io::Write;
use std::path::{Component, Path};

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Its name in the folder of the files.
pub const NAME: &str = "manifest.json";
/// Tool and version.
pub const TOOL: &str = concat!("csbrdf ", env!("CARGO_PKG_VERSION"));
const FORMAT: &str = "csbrdf-manifest";
const VERSION: u64 = 1;
/// Most bytes of a manifest: some 100,000 materials.
pub const LIMIT: usize = 1 << 26;
/// Most memory that its JSON may take.
const MEMORY: usize = 1 << 29;
/// Most characters of a reason to refuse one, which may cite it.
const REASON: usize = 300;

/// Why a manifest is not read.
#[derive(Debug)]
pub enum Refused {
    /// It is damaged, or none.
    Bad(String),
    /// It is of another version, or too large.
    Unsupported(String),
}

/// A set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// [`FORMAT`].
    pub format: String,
    /// [`VERSION`]; a reader refuses others. Keys that it does not know it ignores.
    pub version: u64,
    /// Tool and version that wrote the manifest.
    pub tool: String,
    /// SHA-256 of the encoder's settings and the metadata given, hexadecimal: the same for the same settings and version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settings: Option<String>,
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
    /// Quantiser step that was asked for, log domain: with dependent quantisation the file's own is 0.65 of it.
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

impl Material {
    /// Why it cannot be one, if it cannot.
    pub fn check(&self) -> Result<(), String> {
        if let Some(name) = [&self.file, &self.source_file].into_iter().find(|name| !is_plain(name)) {
            return Err(format!("{name:?} is not the name of a file in one folder"));
        }
        let is_hash = |text: &str| text.len() == 64 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
        if let Some(hash) = [&self.sha256, &self.source_sha256].into_iter().find(|hash| !is_hash(hash)) {
            return Err(format!("{:?} is no SHA-256 in lower-case hexadecimal digits", hash.get(..80).unwrap_or(hash)));
        }
        Ok(())
    }

    /// Bytes of the table in float64 over those of the file.
    pub fn ratio(&self) -> f64 {
        8.0 * self.entries as f64 / self.bytes.max(1) as f64
    }
}

impl Manifest {
    /// The manifest of these files, made with settings of this hash.
    pub fn new(settings: &str, materials: Vec<Material>) -> Manifest {
        let (format, tool) = (FORMAT.into(), TOOL.into());
        Manifest { format, version: VERSION, tool, settings: Some(settings.into()), materials }
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
    pub fn read(bytes: &[u8]) -> Result<Manifest, Refused> {
        if bytes.len() > LIMIT {
            return Err(Refused::unsupported(format!("a manifest has at most {LIMIT} bytes")));
        }
        // What it is before what it says: another version may say it in another way.
        let head: Head = match serde_json::from_slice(bytes) {
            Ok(head) if Manifest::is_likely(bytes) => head,
            Ok(_) => return Err(Refused::bad("is no manifest of csbrdf files".into())),
            Err(e) => return Err(Refused::bad(format!("is damaged, or no manifest of csbrdf files: {e}"))),
        };
        if head.format != FORMAT {
            return Err(Refused::bad(format!("is no manifest of csbrdf files: \"format\" is not \"{FORMAT}\"")));
        }
        if head.version != VERSION {
            let what = format!("manifest version {}, this build reads {VERSION}; update csbrdf", head.version);
            return Err(Refused::unsupported(what));
        }
        if memory(bytes) > MEMORY {
            return Err(Refused::unsupported("it holds more objects and values than a manifest may".into()));
        }
        let manifest: Manifest =
            serde_json::from_slice(bytes).map_err(|e| Refused::bad(format!("damaged manifest: {e}")))?;
        let mut files = HashSet::new();
        for material in &manifest.materials {
            material.check().map_err(Refused::bad)?;
            if !files.insert(&material.file) {
                return Err(Refused::bad(format!("{:?} is listed twice", material.file)));
            }
        }
        Ok(manifest)
    }
}

/// What decides whether the rest can be read.
#[derive(Deserialize)]
struct Head {
    format: String,
    version: u64,
}

impl Refused {
    fn bad(what: String) -> Refused {
        Refused::Bad(what.chars().take(REASON).collect())
    }

    fn unsupported(what: String) -> Refused {
        Refused::Unsupported(what.chars().take(REASON).collect())
    }
}

/// About the most that JSON takes in memory once it is read: an object has room for eleven keys from the first on, a list doubles when
/// it is full.
fn memory(text: &[u8]) -> usize {
    let of = |byte: &u8| match byte {
        b'{' => 640,
        b'[' => 128,
        b',' => 64,
        _ => 1,
    };
    text.iter().map(of).sum()
}

/// Whether text names a file in a folder, not one elsewhere.
pub fn is_plain(name: &str) -> bool {
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
        let read = |text: &str| match Manifest::read(text.as_bytes()) {
            Ok(manifest) => Ok(manifest),
            Err(Refused::Bad(_)) => Err(3),
            Err(Refused::Unsupported(_)) => Err(4),
        };
        let head = r#""format": "csbrdf-manifest", "tool": "t""#;
        assert_eq!(read(&format!("{{{head}, \"version\": 1, \"materials\": [], \"new\": 3}}")).unwrap().materials, []);
        assert_eq!(read(&format!("{{{head}, \"version\": 2, \"materials\": 7}}")), Err(4));
        for text in ["{", "{}", "[1]", "{\"format\": 1}", &format!("{{{head}, \"version\": 1, \"materials\": [{{}}]}}")]
        {
            assert_eq!(read(text), Err(3), "{text}");
        }
        // Bytes that are no text, and JSON that is deep.
        for text in [&b"{\"format\": \"\xFF\"}"[..], &[&b"{\"a\":"[..], &[b'['; 100_000]].concat()] {
            assert!(matches!(Manifest::read(text), Err(Refused::Bad(_))));
        }
        let material = r#"{"name":"","file":"a","bytes":0,"sha256":"H","source_file":"b","source_sha256":"H","entries":0,
            "valid":0,"sampled":0,"step":1,"log_rms":0,"log_max":0,"metadata":{"a":V}}"#;
        let material = material.replace('H', &"0".repeat(64));
        let with =
            |value: &str| format!("{{{head}, \"version\": 1, \"materials\": [{}]}}", material.replace('V', value));
        assert!(read(&with("[]")).is_ok());
        assert_eq!(read(&with(&["[".repeat(1000), "]".repeat(1000)].concat())), Err(3));
        // A twentieth of the largest manifest, but a hundred times that in memory.
        assert_eq!(read(&with(&format!("[{}0]", "{\"\":0},".repeat(1 << 20)))), Err(4));
        let long = format!("{{{head}, \"version\": \"{}\"}}", "1".repeat(1 << 20));
        assert!(matches!(Manifest::read(long.as_bytes()), Err(Refused::Bad(what)) if what.len() < 1000));
        assert!(Manifest::is_likely(b" \n{}") && !Manifest::is_likely(b"") && !Manifest::is_likely(b"CSBRDF{"));
    }
}
