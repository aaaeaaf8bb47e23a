//! The metadata section META (spec section 3.7): where the table came from, as JSON in a zstd frame.

#[cfg(feature = "metadata")]
mod present {
    use std::collections::BTreeMap;

    use serde::{Deserialize, Serialize};
    use serde_json::Value;

    use crate::base::bits::ByteReader;
    use crate::base::error::{Error, Result};
    use crate::base::excerpt::excerpt;
    use crate::base::limits::{MAX_METADATA, MAX_METADATA_OBJECTS};

    /// Provenance of a file. All fields are optional; unknown keys are kept in `other`.
    ///
    /// ```
    /// use csbrdf::Metadata;
    ///
    /// let metadata = Metadata { name: Some("chrome".into()), licence: Some("CC0".into()), ..Metadata::default() };
    /// # #[cfg(feature = "encode")]
    /// let encoder = csbrdf::Encoder::new().metadata(metadata);
    /// ```
    #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default)]
    pub struct Metadata {
        /// Name of the material.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub name: Option<String>,
        /// UUID of the material, if it has one.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub uuid: Option<String>,
        /// Version of the measurement, free text.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub version: Option<String>,
        /// Instrument that measured it.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub instrument: Option<String>,
        /// Date of the measurement, ISO 8601.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub date: Option<String>,
        /// Licence, SPDX expression preferred.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub licence: Option<String>,
        /// Copyright notices.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub copyrights: Vec<String>,
        /// Authors.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub authors: Vec<String>,
        /// Publications and addresses that it was taken from.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub sources: Vec<String>,
        /// File name of the source table, without folders.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub source_file: Option<String>,
        /// SHA-256 of the source table's bytes, hexadecimal.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub source_sha256: Option<String>,
        /// Tool and version that wrote the file.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub tool: Option<String>,
        /// The encoder's settings and what it achieved.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub encoder: Option<Value>,
        /// Everything else.
        #[serde(flatten)]
        pub other: BTreeMap<String, Value>,
    }

    /// Name of what [`MAX_METADATA_OBJECTS`] limits.
    const OBJECTS: &str = "objects and lists of the metadata";

    /// About the objects and lists of a text, those in strings as well.
    fn objects(text: &[u8]) -> usize {
        text.iter().filter(|byte| matches!(byte, b'{' | b'[')).count()
    }

    fn at_most(what: &'static str, got: usize, limit: usize) -> Result<()> {
        if got > limit {
            return Err(Error::LimitExceeded { what, got: got as u64, limit: limit as u64 });
        }
        Ok(())
    }

    impl Metadata {
        pub(crate) fn read(mut r: ByteReader) -> Result<Metadata> {
            // Length of the JSON text, then one zstd frame that holds it.
            let length = r.u32()? as usize;
            at_most("metadata size", length, MAX_METADATA)?;
            let place = r.clone();
            let frame = r.bytes(r.left())?;
            let text = zstd::bulk::decompress(frame, length).map_err(|e| place.corrupt(format!("zstd: {e}")))?;
            if text.len() != length {
                return Err(place.corrupt(format!("{} bytes of JSON, expected {length}", text.len())));
            }
            at_most(OBJECTS, objects(&text), MAX_METADATA_OBJECTS)?;
            serde_json::from_slice(&text).map_err(|e| place.corrupt(format!("JSON: {}", excerpt(&e.to_string()))))
        }

        #[cfg(feature = "encode")]
        pub(crate) fn write(&self) -> Result<Vec<u8>> {
            let text = serde_json::to_vec(self).map_err(|e| Error::InvalidArgument(format!("metadata: {e}")))?;
            at_most("metadata size", text.len(), MAX_METADATA)?;
            at_most(OBJECTS, objects(&text), MAX_METADATA_OBJECTS)?;
            // Free keys may not take the place of known ones: what is written must be readable.
            serde_json::from_slice::<Metadata>(&text).map_err(|e| {
                Error::InvalidArgument(format!(
                    "metadata: a free key has a known key's name: {}",
                    excerpt(&e.to_string())
                ))
            })?;
            let mut bytes = (text.len() as u32).to_le_bytes().to_vec();
            bytes.extend(zstd::bulk::compress(&text, 19)?);
            Ok(bytes)
        }
    }

    #[cfg(all(test, feature = "encode"))]
    mod tests {
        use super::*;

        #[test]
        fn round_trip_keeps_free_keys() {
            let mut metadata = Metadata { name: Some("alum".into()), authors: vec!["A".into()], ..Default::default() };
            metadata.other.insert("lab".into(), Value::from(3));
            let mut doubled = metadata.clone();
            doubled.other.insert("authors".into(), Value::from("B"));
            assert!(doubled.write().is_err());
            // As many objects as can be read again, and one more.
            for (n, fits) in [(MAX_METADATA_OBJECTS - 3, true), (MAX_METADATA_OBJECTS - 2, false)] {
                let mut many = metadata.clone();
                many.other.insert("list".into(), vec![serde_json::json!({}); n].into());
                let read = many.write().and_then(|b| Metadata::read(ByteReader::new(&b, 0, "META")));
                assert_eq!(read.is_ok_and(|read| read == many), fits, "{n}");
            }
            let bytes = metadata.write().unwrap();
            assert_eq!(Metadata::read(ByteReader::new(&bytes, 0, "META")).unwrap(), metadata);
        }

        #[test]
        fn bombs_and_rubbish_are_refused() {
            let frame = zstd::bulk::compress(&vec![b' '; MAX_METADATA + 1], 3).unwrap();
            for (length, frame) in [(u32::MAX, &frame[..]), (100, &frame[..]), (5, b"hello"), (0, b"")] {
                let bytes = [&length.to_le_bytes()[..], frame].concat();
                assert!(Metadata::read(ByteReader::new(&bytes, 0, "META")).is_err());
            }
        }
    }
}

#[cfg(feature = "metadata")]
pub use present::Metadata;
