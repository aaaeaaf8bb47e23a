//! What `info` gathers from a file.

use std::path::Path;

use csbrdf::decode::{BlockInfo, Origin, Reader, State};
use csbrdf::format::record::ValidityClass;
use rayon::prelude::*;
use serde_json::Value;

use crate::failure::{Failure, Outcome};
use crate::input::{self, Bytes, label};

/// Origins and their names, in the order of [`Block::origins`].
pub const ORIGINS: [(&str, Origin); 4] = [
    ("sampled", Origin::Sampled),
    ("measured", Origin::Measured),
    ("filled", Origin::Filled),
    ("impossible", Origin::Impossible),
];

/// Most damaged parts that are listed.
const MOST_DAMAGE: usize = 1 << 12;

/// Numbers that are kept of blocks at a time.
const AT_ONCE: usize = 1 << 18;

/// Class and checksum of a record.
const RECORD_OVERHEAD: usize = 5;

/// One block that could be read.
pub struct Block {
    /// Its number.
    pub number: usize,
    /// What the file says about it.
    pub info: BlockInfo,
    /// Entries of each origin, as in [`ORIGINS`].
    pub origins: [usize; 4],
}

/// Figures of all blocks.
#[derive(Default)]
pub struct Summary {
    /// Blocks of each class, in the order of [`classes_of_blocks`].
    pub classes: [usize; ValidityClass::ALL.len() + 1],
    /// Entries of each origin, as in [`ORIGINS`].
    pub origins: [usize; 4],
    /// Largest sampling ratio.
    pub ratio: f64,
    /// Number of the block with the largest error, and that error.
    pub worst: Option<(usize, f32)>,
    /// Bytes of records beside class and checksum.
    coded: usize,
    /// Of the bounds on the errors: sum of squares over valid entries, their number, the largest.
    squares: f64,
    valid: usize,
    max: f64,
}

impl Summary {
    fn add(&mut self, block: &Block) {
        let info = &block.info;
        let class = if info.state == State::Lost { ValidityClass::ALL.len() } else { info.class as usize };
        self.classes[class] += 1;
        self.origins.iter_mut().zip(block.origins).for_each(|(sum, count)| *sum += count);
        self.ratio = self.ratio.max(info.ratio);
        // The last of those that have it.
        if self.worst.is_none_or(|(_, max)| info.max.total_cmp(&max).is_ge()) {
            self.worst = Some((block.number, info.max));
        }
        self.coded += info.record.len().saturating_sub(RECORD_OVERHEAD);
        let valid: usize = info.valid.iter().sum();
        if valid > 0 {
            self.squares += f64::from(info.rms).powi(2) * valid as f64;
            self.max = self.max.max(info.max.into());
        }
        self.valid += valid;
    }
}

/// Names of the classes of blocks: those of their records, where pruned ones that damage took are a class of their own.
pub fn classes_of_blocks() -> impl Iterator<Item = &'static str> {
    ValidityClass::ALL.into_iter().map(ValidityClass::as_str).chain([LOST])
}

/// That of one block.
pub fn class_of(info: &BlockInfo) -> &'static str {
    if info.state == State::Lost { LOST } else { info.class.as_str() }
}

const LOST: &str = "lost";

/// A file and figures about it.
pub struct Contents {
    /// Name for messages.
    pub name: String,
    /// Size of the file.
    pub bytes: usize,
    /// Major, minor, draft.
    pub version: (u16, u16, u16),
    /// The file.
    pub reader: Reader<Bytes>,
    /// Section names and sizes, "frame" for what is outside of them.
    pub sections: Vec<(String, usize)>,
    /// Of its blocks, damaged ones left out.
    pub summary: Summary,
    /// Metadata as a JSON object.
    pub metadata: Value,
    /// What could not be read.
    pub damage: Vec<String>,
}

impl Contents {
    /// Reads all of a file but the coefficients.
    pub fn of(path: &Path, data: Bytes) -> Result<Contents, Failure> {
        let bytes = data.as_ref().len();
        let reader = input::reader(data).map_err(|e| Failure::in_file(path, &e))?;
        let mut sections: Vec<(String, usize)> =
            reader.directory().sections().iter().map(|s| (s.name(), s.range.len())).collect();
        let inside: usize = sections.iter().map(|s| s.1).sum();
        sections.push(("frame".into(), bytes.saturating_sub(inside)));
        let mut damage = Vec::new();
        let metadata = match reader.metadata() {
            Ok(metadata) => serde_json::to_value(metadata).unwrap_or(Value::Null),
            Err(e) => {
                damage.push(e.to_string());
                Value::Null
            }
        };
        let (mut summary, mut more) = (Summary::default(), 0);
        for_each_block(&reader, |found| {
            match found {
                Ok(block) => summary.add(&block),
                Err(e) if is_limit(&e) => return Err(Failure::in_file(path, &e)),
                Err(e) if damage.len() < MOST_DAMAGE => damage.push(e.to_string()),
                Err(_) => more += 1,
            }
            Ok(())
        })?;
        damage.extend((more > 0).then(|| format!("and {more} blocks more; `csbrdf verify` lists them")));
        let (name, version) = (label(path), reader.version());
        Ok(Contents { name, bytes, version, reader, sections, summary, metadata, damage })
    }

    /// Calls `each` with all blocks in order that can be read.
    pub fn for_each_block(&self, mut each: impl FnMut(&Block) -> Outcome) -> Outcome {
        for_each_block(&self.reader, |found| found.map_or(Ok(()), |block| each(&block)))
    }

    /// Bytes a block that are neither coefficients nor masks.
    pub fn side_per_block(&self) -> f64 {
        let coded = self.summary.coded;
        let exact = self.sections.iter().find(|(name, _)| name == "EXCT").map_or(0, |(_, bytes)| *bytes);
        self.bytes.saturating_sub(coded + exact) as f64 / self.reader.block_count() as f64
    }

    /// Bounds on rms and largest error over the valid entries, from those of the blocks.
    pub fn error_bounds(&self) -> (f64, f64) {
        let Summary { squares, valid, max, .. } = self.summary;
        ((squares / valid.max(1) as f64).sqrt(), max)
    }

    /// Rms and largest error that the encoder measured and noted in the metadata.
    pub fn measured_errors(&self) -> Option<(f64, f64)> {
        let encoder = self.metadata.get("encoder")?;
        Some((encoder.get("log_rms")?.as_f64()?, encoder.get("log_max")?.as_f64()?))
    }

    /// The part of a padded shape that belongs to axes.
    pub fn unpadded<'a>(&self, padded: &'a [usize; 4]) -> &'a [usize] {
        &padded[padded.len() - self.reader.grid().axes().len()..]
    }

    /// Number, shapes and layout of the blocks.
    pub fn partition_text(&self) -> String {
        let partition = self.reader.partition();
        let count = self.reader.block_count();
        if let Some(per_axis) = partition.blocks_per_axis() {
            let (per_axis, shape) = (by(self.unpadded(&per_axis)), by(self.unpadded(&partition.shapes()[0])));
            return format!("{count} ({per_axis}) of {shape}");
        }
        let tiles = partition.tile_shapes();
        let tile = by(self.unpadded(&partition.tile()));
        let of_shape = |(i, shape): (usize, &[usize; 4])| {
            let uses = tiles.iter().filter(|t| usize::from(**t) == i).count();
            format!("{} in {uses}", by(self.unpadded(shape)))
        };
        let shapes: Vec<String> = partition.shapes().iter().enumerate().map(of_shape).collect();
        format!("{count} in {} tiles of {tile}; shapes: {}", tiles.len(), shapes.join(", "))
    }
}

/// Lengths with crosses between them.
pub fn by(lengths: &[usize]) -> String {
    lengths.iter().map(usize::to_string).collect::<Vec<_>>().join(" x ")
}

/// Calls `each` with what is known of every block, in order. As many are kept as few numbers take: a file may have millions.
fn for_each_block(reader: &Reader<Bytes>, mut each: impl FnMut(csbrdf::Result<Block>) -> Outcome) -> Outcome {
    let at_once = (AT_ONCE / (16 + reader.grid().channels().len())).max(1);
    for first in (0..reader.block_count()).step_by(at_once) {
        let numbers = first..reader.block_count().min(first + at_once);
        let found: Vec<csbrdf::Result<Block>> = numbers.into_par_iter().map(|number| block(reader, number)).collect();
        found.into_iter().try_for_each(&mut each)?;
    }
    Ok(())
}

fn block(reader: &Reader<Bytes>, number: usize) -> csbrdf::Result<Block> {
    Ok(Block { number, info: reader.block_info(number)?, origins: reader.block_origins(number)? })
}

/// Whether the file is too much, not damaged.
fn is_limit(error: &csbrdf::Error) -> bool {
    matches!(error.kind(), csbrdf::Error::LimitExceeded { .. } | csbrdf::Error::OutOfMemory { .. })
}
