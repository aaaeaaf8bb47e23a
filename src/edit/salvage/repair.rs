//! A valid file anew from a damaged one.

use serde_json::json;

use super::head::TABLE;
use super::{Options, Outcome, Salvaged, salvage_with};
use crate::base::error::{Error, Result};
use crate::base::limits::Limits;
use crate::base::version::FINAL;
use crate::decode::Reader;
use crate::format::directory;
use crate::format::file::{write_file, write_file_with_spare};
use crate::format::index::{Entry, write_index};
use crate::format::is_dependent;
use crate::format::metadata::Metadata;

/// A repaired file.
#[non_exhaustive]
pub struct Repaired {
    /// The file. That which was damaged bit for bit if nothing was lost.
    pub bytes: Vec<u8>,
    /// What was found, and what is lost.
    pub salvaged: Salvaged,
}

/// Writes a valid file with all that is left of a damaged one ([`super::salvage`]), and opens and verifies it before it is given out.
///
/// Records that are intact stay byte for byte. Blocks that are lost become pruned ones that are marked as lost, with their mean from the
/// index; where that is lost as well, they have that of the block before. `encoder` in the metadata says so under `repaired` and no longer
/// states a contract or errors. Metadata that are damaged are left out. A spare copy is written anew.
///
/// # Errors
/// As [`super::salvage`]; `InvalidArgument` if blocks are lost of a file of a draft before 4, whose probabilities cannot be kept; `Corrupt` if
/// what was left does not decode although its checksums are right.
pub fn repair(data: &[u8], limits: Limits) -> Result<Repaired> {
    repair_with(data, &Options::default().limits(limits))
}

/// As [`repair`], with the caller's limits and evidence.
///
/// # Errors
/// As [`repair`].
pub fn repair_with(data: &[u8], options: &Options) -> Result<Repaired> {
    let salvaged = salvage_with(data, options)?;
    let was = &salvaged.was;
    if !salvaged.lost().is_empty() && !is_dependent(was.version().2) {
        let what = "files of drafts before 4 cannot hold lost blocks; use decode --salvage and encode the table again";
        return Err(Error::InvalidArgument(what.into()));
    }
    let sections = sections(data, &salvaged)?;
    let (major, minor, draft) = was.version();
    // Lost blocks are pruned ones, which the final version has.
    let version = (major, minor, if salvaged.lost().is_empty() { draft } else { FINAL });
    let spare = was.sections().iter().any(|s| s.id == directory::SPARE.as_bytes());
    let bytes = if spare { write_file_with_spare(version, &sections) } else { write_file(version, &sections) };
    check(&bytes, &salvaged, options)?;
    Ok(Repaired { bytes, salvaged })
}

/// Name, whether it may be skipped, bytes.
type Section = (Vec<u8>, bool, Vec<u8>);

/// The sections of the repaired file: those that are left, in their order.
fn sections(data: &[u8], salvaged: &Salvaged) -> Result<Vec<Section>> {
    let (reader, whole) = (salvaged.reader(), salvaged.is_whole());
    let mut sections: Vec<Section> = Vec::new();
    for section in salvaged.was.sections() {
        let name = section.name();
        let bytes = match &name[..] {
            directory::SPARE => None,
            directory::INDEX => match reader.section(directory::INDEX)? {
                // Also what other drafts have in its place.
                Some(bytes) if salvaged.lost().is_empty() => Some(bytes),
                _ => Some(index(reader)),
            },
            directory::METADATA if !whole => None,
            known => match KNOWN.iter().find(|name| **name == known) {
                Some(name) => reader.section(name)?,
                // Of an unknown section nobody can say whether it is still true of a file that is not whole.
                None => data.get(section.range.clone()).filter(|_| whole).map(<[u8]>::to_vec),
            },
        };
        if name == directory::RECORDS && !whole {
            sections.push((directory::METADATA.into(), true, metadata(salvaged)?));
        }
        // Not the name for people, which is longer where it is no text.
        sections.extend(bytes.map(|bytes| (section.id.to_vec(), section.skippable, bytes)));
    }
    Ok(sections)
}

/// Fails unless the file can be read, and has the section table that it had if nothing is lost: all its checksums, then.
fn check(bytes: &[u8], salvaged: &Salvaged, options: &Options) -> Result<()> {
    let reader = Reader::open_with_limits(bytes, options.limits)?;
    let is_same = || reader.directory() == &salvaged.was;
    if salvaged.is_whole() && !is_same() {
        return Err(Error::corrupt(
            TABLE,
            0,
            "what was restored is not what the section table says; fetch the file again",
        ));
    }
    reader.verify_within(&reader.call()).into_iter().next().map_or(Ok(()), Err)
}

/// Sections that are taken over as they are.
const KNOWN: [&str; 8] = [
    directory::GRID,
    directory::CODING,
    directory::PARTITION,
    directory::PROBABILITIES,
    directory::PROFILE,
    directory::METADATA,
    directory::RECORDS,
    directory::LOSSLESS,
];

fn index(reader: &Reader<Vec<u8>>) -> Vec<u8> {
    let entry = |block| Entry {
        length: reader.record_length(block) as u32,
        errors: reader.error_codes(block),
        means: reader.means(block).to_vec(),
    };
    write_index(reader.partition(), &(0..reader.block_count()).map(entry).collect::<Vec<_>>())
}

/// The metadata with what was lost, without what is no longer so.
fn metadata(salvaged: &Salvaged) -> Result<Vec<u8>> {
    let mut metadata = salvaged.reader().metadata().unwrap_or_else(|_| Metadata::default());
    let mut encoder = metadata.encoder.take().unwrap_or_else(|| json!({}));
    if let Some(encoder) = encoder.as_object_mut() {
        if !salvaged.lost().is_empty() {
            for stale in ["contract", "corrected", "log_rms", "log_max", "valid", "sampled"] {
                encoder.remove(stale);
            }
        }
        if !salvaged.reader().is_lossless() {
            encoder.remove("lossless");
        }
        let known = salvaged.lost().iter().filter(|&&block| salvaged.has_mean(block)).count();
        let reader = salvaged.reader();
        let mut repaired = json!({
            "blocks": reader.block_count(),
            "lost": reader.lost_blocks().count(),
            "means_lost": salvaged.lost().len() - known,
            "exact_lost": salvaged.lost_source(),
        });
        let assumed = salvaged.damage().iter().filter_map(|damage| match damage.outcome {
            Outcome::Assumed { bits } => Some(json!({ "section": damage.section, "evidence_bits": bits })),
            _ => None,
        });
        let assumed: Vec<_> = assumed.collect();
        if !assumed.is_empty() {
            repaired["assumed"] = assumed.into();
        }
        encoder.insert("repaired".into(), repaired);
    }
    metadata.encoder = Some(encoder);
    metadata.write()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A section of a later version, its name no text: what people read in its place has other bytes.
    #[test]
    fn names_of_sections_stay_as_they_are() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/v1/final-profile.csbrdf");
        let golden = Reader::open(std::fs::read(folder).unwrap()).unwrap();
        let known = golden.directory().sections().iter().filter(|section| section.id != directory::SPARE.as_bytes());
        let mut sections: Vec<(Vec<u8>, bool, Vec<u8>)> = known
            .map(|section| {
                let name =
                    KNOWN.into_iter().chain([directory::INDEX]).find(|name| name.as_bytes() == section.id).unwrap();
                (section.id.to_vec(), section.skippable, golden.section(name).unwrap().unwrap())
            })
            .collect();
        sections.push((vec![0x1F, b'"', 0, b'x'], true, vec![1, 2, 3]));
        for good in [write_file(golden.version(), &sections), write_file_with_spare(golden.version(), &sections)] {
            let mut bad = good.clone();
            bad.pop();
            assert!(repair(&bad, Limits::default()).unwrap().bytes == good);
        }
    }
}
