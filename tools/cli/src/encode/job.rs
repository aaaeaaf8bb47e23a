//! One table at a time: read, encoded, written; or, in a set, the file that is there already.

use std::path::{Path, PathBuf};
use std::time::Instant;

use csbrdf::encode::Encoder;
use csbrdf::encode::contract::Contract;
use csbrdf::format::metadata::Metadata;
use csbrdf::table::Table;
use sha2::{Digest, Sha256};

use super::{contract, describe, parse};
use crate::args::EncodeArgs;
use crate::failure::Failure;
use crate::formats::Kind;
use crate::guard::Guard;
use crate::input::{self, Bytes};
use crate::output::Target;
use crate::sets::manifest::{Kept, Material};
use crate::sets::unfinished::Set;
use crate::text::hex;
use crate::text::percent;
use crate::{plan, samples};

/// The figures of one encoded file.
pub struct Done {
    pub bytes: usize,
    pub ratio: f64,
    pub log_rms: f64,
    pub log_max: f64,
    /// What the line says of the contract, if there is one.
    pub contract: String,
    /// Samples and valid entries.
    pub sampled: [usize; 2],
    pub seconds: f64,
    /// It was there already, and is what would have been made.
    pub kept: bool,
    /// For the manifest.
    pub material: Material,
}

/// A table to encode.
pub struct Input {
    pub path: PathBuf,
    /// It is one of those in a folder that was named, and must be within it.
    pub in_folder: bool,
}

/// What holds for all tables.
pub struct Job<'a> {
    pub args: &'a EncodeArgs,
    pub encoder: Encoder,
    pub metadata: Metadata,
    pub guard: Guard,
    /// The set that the files become, if they become one.
    pub set: Option<Set>,
    pub quiet: bool,
}

impl Input {
    fn read(&self, kinds: &[Kind]) -> Result<Bytes, Failure> {
        if self.in_folder { input::read_within(&self.path, kinds) } else { input::read(&self.path, kinds) }
    }
}

impl Job<'_> {
    /// One file of a table, or of a set the one that is there.
    pub fn encode(&self, input: &Input, target: &Target, progress: &(dyn Fn(f64) + Sync)) -> Result<Done, Failure> {
        let (start, args, path) = (Instant::now(), self.args, &input.path);
        let source = input.read(if args.samples.is_some() { &[Kind::List] } else { &[Kind::Merl] })?;
        let bytes = source.as_ref();
        match (&self.set, target) {
            (Some(set), Target::File(file)) => {
                if let Some(material) = set.finished(file, path, bytes)? {
                    return Ok(Done::kept(material, start));
                }
            }
            _ => target.check(&self.guard)?,
        }
        let (table, described) = self.table(path, bytes)?;
        // Of the table as MERL writes it, also where a list of measurements came in.
        let size = 12 + 8 * table.values().len();
        // Of these very bytes, whatever --meta says of where they come from.
        let source_sha256 = match (&self.metadata.source_sha256, &described.source_sha256) {
            (None, Some(hash)) => hash.clone(),
            _ => hex(&Sha256::digest(bytes)),
        };
        drop(source);
        let encoded = self.encoder.clone().metadata(described.clone()).encode_with(&table, progress);
        let encoded = encoded.map_err(|e| Failure::in_file(path, &e))?;
        drop(table);
        let guard = self.guard.clone().stated(path, &described);
        let report = &encoded.report;
        let contract = contract(args);
        let kept = contract.map(|contract| Kept::of(contract, &encoded)).transpose();
        let kept = kept.map_err(|e| Failure::in_file(path, &e))?;
        let material = Material::new((path, source_sha256), target, described, kept, &encoded);
        let contract = match contract {
            None => String::new(),
            Some(Contract::MaxError(_)) => {
                format!("step {:.4}, {} corrected, ", report.step, percent(report.corrected, report.valid))
            }
            Some(_) => format!("step {:.4}, ", report.step),
        };
        let kept = match (&self.set, target) {
            (Some(set), Target::File(file)) => set.begin(file, &encoded.bytes, &material)?,
            _ => false,
        };
        if !kept {
            target.write(&guard, |out| Ok(out.write_all(&encoded.bytes)?))?;
        }
        encoded.report.needs_limit().into_iter().for_each(|values| input::note_needed_limit(target, values));
        Ok(Done {
            bytes: encoded.bytes.len(),
            ratio: size as f64 / encoded.bytes.len() as f64,
            log_rms: encoded.report.log_rms,
            log_max: encoded.report.log_max,
            contract,
            sampled: [encoded.report.sampled, encoded.report.valid],
            seconds: start.elapsed().as_secs_f64(),
            kept,
            material,
        })
    }

    /// The table in the bytes of an input, and the metadata of its file.
    fn table(&self, path: &Path, bytes: &[u8]) -> Result<(Table, Metadata), Failure> {
        if self.args.samples.is_none() {
            return parse(path, bytes, &self.metadata);
        }
        let table = samples::table(path, bytes, self.args.grid.as_deref().map(plan::merl), self.quiet)?;
        let metadata = describe(path, hex(&Sha256::digest(bytes)), &table, &self.metadata)?;
        Ok((table, metadata))
    }
}

impl Done {
    /// Of a file that is there already.
    fn kept(material: Material, start: Instant) -> Done {
        Done {
            bytes: material.bytes as usize,
            ratio: (12 + 8 * material.entries) as f64 / material.bytes.max(1) as f64,
            log_rms: material.log_rms,
            log_max: material.log_max,
            contract: String::new(),
            sampled: [material.sampled, material.valid].map(|n| n as usize),
            seconds: start.elapsed().as_secs_f64(),
            kept: true,
            material,
        }
    }
}
