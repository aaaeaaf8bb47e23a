//! What `info` gathers from a file.

use std::path::Path;

use csbrdf::decode::{BlockInfo, Origin, Reader};
use rayon::prelude::*;
use serde_json::Value;

use crate::failure::Failure;
use crate::input::{Bytes, label};

/// Origins and their names, in the order of [`Block::origins`].
pub const ORIGINS: [(&str, Origin); 4] = [
    ("sampled", Origin::Sampled),
    ("measured", Origin::Measured),
    ("filled", Origin::Filled),
    ("impossible", Origin::Impossible),
];

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
    /// Its blocks, damaged ones left out.
    pub blocks: Vec<Block>,
    /// Metadata as a JSON object.
    pub metadata: Value,
    /// What could not be read.
    pub damage: Vec<String>,
}

impl Contents {
    /// Reads all of a file but the coefficients.
    pub fn of(path: &Path, data: Bytes) -> Result<Contents, Failure> {
        let bytes = data.as_ref().len();
        let reader = Reader::open(data).map_err(|e| Failure::in_file(path, &e))?;
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
        let found: Vec<csbrdf::Result<Block>> =
            (0..reader.block_count()).into_par_iter().map(|number| block(&reader, number)).collect();
        let mut blocks = Vec::with_capacity(found.len());
        for result in found {
            match result {
                Ok(block) => blocks.push(block),
                Err(e) => damage.push(e.to_string()),
            }
        }
        Ok(Contents { name: label(path), bytes, version: reader.version(), reader, sections, blocks, metadata, damage })
    }

    /// Entries of each origin, as in [`ORIGINS`].
    pub fn origins(&self) -> [usize; 4] {
        std::array::from_fn(|i| self.blocks.iter().map(|b| b.origins[i]).sum())
    }

    /// Bytes a block that are neither coefficients nor masks.
    pub fn side_per_block(&self) -> f64 {
        let coded: usize = self.blocks.iter().map(|b| b.info.record.len().saturating_sub(RECORD_OVERHEAD)).sum();
        let exact = self.sections.iter().find(|(name, _)| name == "EXCT").map_or(0, |(_, bytes)| *bytes);
        self.bytes.saturating_sub(coded + exact) as f64 / self.reader.block_count() as f64
    }

    /// Bounds on rms and largest error over the valid entries, from those of the blocks.
    pub fn error_bounds(&self) -> (f64, f64) {
        let (mut squares, mut count, mut max) = (0.0, 0usize, 0.0f64);
        for block in &self.blocks {
            let valid: usize = block.info.valid.iter().sum();
            if valid > 0 {
                squares += f64::from(block.info.rms).powi(2) * valid as f64;
                max = max.max(block.info.max.into());
            }
            count += valid;
        }
        ((squares / count.max(1) as f64).sqrt(), max)
    }

    /// Number of the block with the largest error.
    pub fn worst_block(&self) -> Option<usize> {
        self.blocks.iter().max_by(|a, b| a.info.max.total_cmp(&b.info.max)).map(|b| b.number)
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

fn block(reader: &Reader<Bytes>, number: usize) -> csbrdf::Result<Block> {
    let info = reader.block_info(number)?;
    let mut origins = [0; 4];
    for origin in reader.block_origin(number)? {
        if let Some(i) = ORIGINS.iter().position(|(_, o)| *o == origin) {
            origins[i] += 1;
        }
    }
    Ok(Block { number, info, origins })
}
