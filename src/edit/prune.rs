//! A smaller file for a scene: the blocks that it looked at, the channels that it needs, as fine as it needs them.

mod channels;
mod recode;

use serde_json::json;

use crate::base::budget::Budget;
use crate::base::error::{Error, Result};
use crate::base::version::VERSION;
use crate::blocks::BlockCodec;
use crate::brdf::touched::Touched;
use crate::codec::contexts::contexts;
use crate::codec::range::{Coder, Counter, Encoder};
use crate::decode::Reader;
use crate::encode::fit_probabilities;
use crate::format::directory;
use crate::format::file::write_file;
use crate::format::header::{write_coding, write_grid};
use crate::format::index::{Entry, PRUNED, UNKNOWN_ERROR, encode_error, write_index};
use crate::format::is_dependent;
use crate::format::probabilities::write_probabilities;
use crate::format::profile::write_profile;
use crate::format::record::{Record, ValidityClass};
use channels::Selection;
use recode::{Recoder, Remains};

/// What a pruned file holds.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PrunedFile {
    /// The file.
    pub bytes: Vec<u8>,
    /// Blocks that it keeps, with the coefficients that the detail leaves them; those without valid entries among them.
    pub kept: usize,
    /// Blocks of which it keeps the mean alone.
    pub pruned: usize,
    /// Blocks among these that the trace names, but the file that was pruned had no more than their means either. A scene that
    /// was traced with these means gets them again; what they stand for is only in the file before.
    pub gone: usize,
}

/// What to leave out of a file, nothing unless a setting says so; then [`Pruner::prune`].
#[derive(Clone, Debug, Default)]
pub struct Pruner<'a> {
    touched: Option<&'a Touched>,
    channels: Option<Vec<usize>>,
    detail: f64,
}

impl<'a> Pruner<'a> {
    /// Leaves nothing out.
    pub fn new() -> Pruner<'a> {
        Pruner::default()
    }

    /// Of blocks that were not touched keeps the means alone ([`PrunedPolicy::Coarse`](crate::decode::PrunedPolicy::Coarse)).
    pub fn blocks(self, touched: &'a Touched) -> Pruner<'a> {
        Pruner { touched: Some(touched), ..self }
    }

    /// Keeps these channels, by number from 0 in any order; in the file they stay in their order.
    pub fn channels(self, channels: &[usize]) -> Pruner<'a> {
        Pruner { channels: Some(channels.to_vec()), ..self }
    }

    /// The rms error in the log domain that each block may gain by losing its finest coefficients; 0 at first.
    pub fn detail(self, detail: f64) -> Pruner<'a> {
        Pruner { detail, ..self }
    }

    /// The file without what is to be left out. What is kept decodes to the same bits, unless detail was to be lost.
    ///
    /// The errors that the index states grow with the detail lost, and where fewer channels share them. What restores the source's
    /// bits is dropped, and the metadata no longer state a contract.
    ///
    /// # Errors
    /// `InvalidArgument` if the trace is of another file, the file of a draft before 4, or `detail` not a finite number from 0 on or not
    /// possible: corrections (a contract on the largest error) need all coefficients. Likewise if there are no such channels, one is named
    /// twice, or the file mixes them with others (a matrix of spec section 3.3): no file with fewer
    /// components gives the same bits. `Corrupt` if the file is damaged.
    pub fn prune<D: AsRef<[u8]>>(&self, reader: &Reader<D>) -> Result<PrunedFile> {
        let bad = |what: &str| Err(Error::InvalidArgument(what.into()));
        let detail = self.detail;
        if let Some(touched) = self.touched {
            touched.check(reader)?;
        }
        if !is_dependent(reader.version().2) {
            return bad("files of drafts before 4 cannot be pruned; encode the table again");
        }
        if !(detail.is_finite() && detail >= 0.0) {
            return bad("the detail to lose must be a finite rms error in the log domain, 0 or more");
        }
        if detail > 0.0 && reader.coding().correction.is_some() {
            return bad(
                "the file keeps a largest error by corrections, which need all coefficients; prune it without --detail",
            );
        }
        let selection = match &self.channels {
            Some(channels) => Selection::new(reader.header(), channels)?,
            None => None,
        };
        let call = reader.call();
        let job = Job { reader, touched: self.touched, selection: selection.as_ref(), detail, budget: &call };
        let channels = reader.grid().channels().len() as u64;
        call.hold(reader.block_count() as u64 * (ENTRY + 4 * channels))?;
        match &selection {
            Some(selection) => job.with_channels(selection),
            None => {
                let mut sections = Vec::new();
                for name in [directory::GRID, directory::CODING, directory::PARTITION, directory::PROBABILITIES] {
                    sections.extend(reader.section(name)?.map(|bytes| (name, false, bytes)));
                }
                let profile = reader.section(directory::PROFILE)?;
                sections.extend(profile.map(|bytes| (directory::PROFILE, false, bytes)));
                job.finish(reader.header(), sections)
            }
        }
    }
}

/// Bytes of a value of a block that is coded again: planes of coefficients, of all channels and of those kept; what is decoded to
/// them, masks, exact zeros, corrections with the values before them, and the copies of those kept. Beside what the finest
/// coefficients take to be found.
const RECODED: u64 = 40;
/// Operations of coding a value again.
const RECODING: u64 = 16;
/// Bytes of an entry of the new index beside its means.
const ENTRY: u64 = 64;

type Section = (&'static str, bool, Vec<u8>);

/// One pruning.
struct Job<'a, D> {
    reader: &'a Reader<D>,
    touched: Option<&'a Touched>,
    selection: Option<&'a Selection>,
    detail: f64,
    budget: &'a Budget<'a>,
}

impl<D: AsRef<[u8]>> Job<'_, D> {
    /// Whether a block keeps its coefficients, if it has any.
    fn keeps(&self, block: usize) -> bool {
        self.touched.is_none_or(|touched| touched.blocks()[block])
    }

    /// A file of fewer channels: all records are coded again, with probabilities of their own.
    fn with_channels(&self, selection: &Selection) -> Result<PrunedFile> {
        let Job { reader, .. } = self;
        let mut codec = selection.header(reader.header())?;
        let mut counter = Counter::new(contexts(codec.coding.quantization));
        let mut recoder = Recoder::new(reader.header(), &codec, Some(selection), self.detail);
        for block in 0..reader.block_count() {
            let record = reader.record(block)?;
            if self.keeps(block) && !record.class.is_mean_only() {
                self.recode(&mut recoder, block, &record, &mut counter)?;
            }
        }
        let (codes, probabilities) = fit_probabilities(&counter, codec.coding.quantization);
        codec.probabilities = probabilities.into();
        let mut sections = vec![
            (directory::GRID, false, write_grid(&codec.grid)),
            (directory::CODING, false, write_coding(&codec.coding)),
        ];
        sections.extend(reader.section(directory::PARTITION)?.map(|bytes| (directory::PARTITION, false, bytes)));
        sections.push((directory::PROBABILITIES, false, write_probabilities(&codes)));
        let profile = codec.coded_profile.as_ref().map(write_profile);
        sections.extend(profile.map(|bytes| (directory::PROFILE, false, bytes)));
        self.finish(&codec, sections)
    }

    /// Codes what is kept of a block.
    fn recode<C: Coder>(&self, recoder: &mut Recoder, block: usize, record: &Record, coder: &mut C) -> Result<Remains> {
        let place = self.reader.place(block)?;
        self.reader.prepare(self.budget)?;
        let values = self.reader.block_values(block)? as u64;
        let _held = self.budget.holding(RECODED * values)?;
        self.budget.spend(RECODING * values)?;
        let remains = recoder.take_apart(&place, record, self.reader.means(block), self.budget).and_then(|remains| {
            recoder.code(coder, &place, &remains)?;
            Ok(remains)
        });
        remains.map_err(|fault| self.reader.fault(block, fault))
    }

    /// The file, after the sections that all blocks share.
    fn finish(&self, codec: &BlockCodec, mut sections: Vec<Section>) -> Result<PrunedFile> {
        let Job { reader, selection, detail, .. } = *self;
        let as_is = detail == 0.0 && selection.is_none();
        let mut recoder = Recoder::new(reader.header(), codec, selection, detail);
        let (mut entries, mut records, mut kept, mut gone) = (Vec::new(), Vec::new(), 0, 0);
        for block in 0..reader.block_count() {
            let record = reader.record(block)?;
            let mut errors = reader.error_codes(block);
            let bytes = match record.class {
                ValidityClass::None | ValidityClass::Pruned => reader.record_bytes(block).to_vec(),
                _ if !self.keeps(block) => {
                    errors = PRUNED;
                    Record { class: ValidityClass::Pruned, doublings: 0, coded: &[] }.write(block as u32)
                }
                _ if as_is => reader.record_bytes(block).to_vec(),
                _ => {
                    let mut coder = Encoder::new(codec.probabilities.get()?);
                    let Remains { class, valid_before, lost, .. } =
                        self.recode(&mut recoder, block, &record, &mut coder)?;
                    errors = self.errors(block, valid_before, lost);
                    Record { class, doublings: record.doublings, coded: &coder.finish() }.write(block as u32)
                }
            };
            let has_all = record.class == ValidityClass::None;
            kept += usize::from(has_all || self.keeps(block) && record.class != ValidityClass::Pruned);
            let named = self.touched.is_some_and(|touched| touched.blocks()[block]);
            gone += usize::from(named && record.class == ValidityClass::Pruned);
            let means = reader.means(block);
            let means = selection.map_or_else(|| means.to_vec(), |selection| selection.of_components(means, 1));
            entries.push(Entry { length: bytes.len() as u32, errors, means });
            records.extend(bytes);
        }
        let pruned = reader.block_count() - kept;
        sections.push((directory::INDEX, false, write_index(reader.partition(), &entries)));
        sections.push((directory::METADATA, true, self.metadata(kept)?));
        sections.push((directory::RECORDS, false, records));
        Ok(PrunedFile { bytes: write_file(VERSION, &sections), kept, pruned, gone })
    }

    /// Codes of the errors of what is kept of a block: the channels left out may have had none.
    fn errors(&self, block: usize, valid_before: f64, lost: f64) -> [u8; 2] {
        let (rms, max) = self.reader.stated_errors(block);
        let (rms, max) = (f64::from(rms), f64::from(max));
        // Of no valid entry there is no error.
        let (rms, max) =
            if valid_before.is_finite() { ((rms * valid_before.sqrt()).min(max), max) } else { (0.0, 0.0) };
        if lost == 0.0 { [rms, max].map(encode_error) } else { [encode_error(rms + lost), UNKNOWN_ERROR] }
    }

    /// The file's metadata with what was done to it, without what is no longer so.
    fn metadata(&self, kept: usize) -> Result<Vec<u8>> {
        let mut metadata = self.reader.metadata()?;
        let mut encoder = metadata.encoder.take().unwrap_or_else(|| json!({}));
        if let Some(encoder) = encoder.as_object_mut() {
            for stale in ["contract", "corrected", "lossless", "log_rms", "log_max", "valid", "sampled"] {
                encoder.remove(stale);
            }
            let mut pruned = json!({ "blocks": self.reader.block_count(), "kept": kept, "detail": self.detail });
            // Once channels are gone, how many there were stays in the metadata for good.
            let before = encoder.get("pruned").and_then(|pruned| pruned.get("channels")).cloned();
            let now = self.selection.map(|_| self.reader.grid().channels().len().into());
            if let Some(channels) = before.or(now) {
                pruned["channels"] = channels;
            }
            encoder.insert("pruned".into(), pruned);
        }
        metadata.encoder = Some(encoder);
        metadata.write()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::PrunedPolicy;
    use crate::encode::Encoder;
    use crate::table::Table;
    use crate::table::grid::{Axis, AxisName, Grid, Mapping};
    use crate::table::synth::Recipe;
    use std::f64::consts::{FRAC_PI_2, PI};

    const SHAPE: [usize; 3] = [9, 5, 12];

    fn table() -> Table {
        let axis = |name, len, mapping, end| Axis { name, len, mapping, start: 0.0, end };
        let axes = vec![
            axis(AxisName::ThetaH, 18, Mapping::Square, FRAC_PI_2),
            axis(AxisName::ThetaD, 15, Mapping::Linear, FRAC_PI_2),
            axis(AxisName::PhiD, 24, Mapping::Linear, PI),
        ];
        let grid = Grid::new(axes, Grid::rgb_channels([1.0; 3])).unwrap();
        let recipe = Recipe { noise: 0.02, holes: 0.05, ..Recipe::named("satin-paint").unwrap() };
        recipe.synthesise(&grid).unwrap()
    }

    fn open(bytes: &[u8]) -> Reader<&[u8]> {
        Reader::open(bytes).unwrap()
    }

    fn trace(reader: &Reader<&[u8]>, keep: impl Fn(usize) -> bool) -> Touched {
        Touched::new((0..reader.block_count()).map(keep).collect(), reader.index_crc())
    }

    fn block(reader: &Reader<&[u8]>, number: usize) -> Result<Vec<f32>> {
        let mut values = vec![0.0; reader.block_values(number)?];
        reader.block_into(number, &mut values)?;
        Ok(values)
    }

    #[test]
    fn kept_blocks_stay_bit_for_bit_and_others_are_refused_or_their_mean() {
        let encoder = Encoder::new().block_shape(&SHAPE).profile(false);
        let bytes = encoder.encode(&table()).unwrap().bytes;
        let reader = open(&bytes);
        let keep = |b: usize| b % 3 != 1;
        let pruned = Pruner::new().blocks(&trace(&reader, keep)).prune(&reader).unwrap();
        assert_eq!(pruned.kept, (0..reader.block_count()).filter(|&b| keep(b)).count());
        assert!(pruned.bytes.len() < bytes.len());
        let small = open(&pruned.bytes);
        assert!(small.verify().is_empty());
        assert!(matches!(small.decode_all(), Err(Error::Pruned { block: 1 })));
        let coarse = open(&pruned.bytes).with_pruned(PrunedPolicy::Coarse);
        coarse.decode_all().unwrap();
        for number in 0..reader.block_count() {
            let before = block(&reader, number).unwrap();
            if keep(number) {
                assert_eq!(block(&small, number).unwrap(), before);
                continue;
            }
            assert!(matches!(block(&small, number), Err(Error::Pruned { .. })));
            assert!(!coarse.block_validity(number).unwrap().contains(&true));
            // The geometric mean over the block of value + eps, by channel, as far as the mean is quantised.
            let after = block(&coarse, number).unwrap();
            let eps = reader.coding().eps as f32;
            let n = before.len() / 3;
            for (before, after) in before.chunks_exact(n).zip(after.chunks_exact(n)) {
                let mean = before.iter().map(|v| f64::from((v + eps).ln())).sum::<f64>() / n as f64;
                for value in after {
                    assert!((f64::from((value + eps).ln()) - mean).abs() < 1e-4, "{value} {}", mean.exp());
                }
            }
        }
    }

    #[test]
    fn detail_is_lost_within_what_is_allowed_and_the_index_says_so() {
        let table = table();
        // Masks and exact zeros in the records.
        let mut values = table.values().to_vec();
        values[3000..3100].fill(0.0);
        let table = Table::from_parts(table.grid().clone(), values, table.valid().to_vec()).unwrap();
        let bytes = Encoder::new().block_shape(&SHAPE).encode(&table).unwrap().bytes;
        let reader = open(&bytes);
        let all = trace(&reader, |_| true);
        let mut last = bytes.len();
        for detail in [0.02, 0.1, 0.5] {
            let pruned = Pruner::new().blocks(&all).detail(detail).prune(&reader).unwrap();
            assert!(pruned.bytes.len() < last, "{detail}");
            last = pruned.bytes.len();
            let small = open(&pruned.bytes);
            assert!(small.verify().is_empty());
            for number in 0..reader.block_count() {
                let (before, after) = (block(&reader, number).unwrap(), block(&small, number).unwrap());
                let eps = reader.coding().eps as f32;
                let apart = |(a, b): (&f32, &f32)| f64::from((a + eps).ln() - (b + eps).ln()).powi(2);
                let squares: f64 = before.iter().zip(&after).map(apart).sum();
                let lost = (squares / before.len() as f64).sqrt();
                assert!(lost <= detail * 1.001, "block {number}: {lost} for {detail}");
                let valid = small.block_validity(number).unwrap();
                assert_eq!(valid, reader.block_validity(number).unwrap());
                // Stated errors are those of valid entries, which may have all that was lost.
                let count = valid.iter().filter(|valid| **valid).count() as f64;
                let pairs = before.iter().zip(&after).zip(&valid).filter(|(_, valid)| **valid);
                let of_valid = (pairs.map(|(pair, _)| apart(pair)).sum::<f64>() / count).sqrt();
                let most = detail * (before.len() as f64 / count).sqrt();
                let stated = |r: &Reader<&[u8]>| f64::from(r.stated_errors(number).0);
                assert!(stated(&small) >= stated(&reader) && stated(&small) >= of_valid * 0.999, "block {number}");
                assert!(stated(&small) <= (stated(&reader) + most) * 1.1, "block {number}");
            }
        }
    }

    #[test]
    fn what_cannot_be_pruned_is_refused() {
        let bytes = Encoder::new().block_shape(&SHAPE).encode(&table()).unwrap().bytes;
        let reader = open(&bytes);
        let all = trace(&reader, |_| true);
        for detail in [-0.1, f64::NAN, f64::INFINITY] {
            assert!(Pruner::new().blocks(&all).detail(detail).prune(&reader).is_err());
        }
        let other = Touched::new(all.blocks().to_vec(), !reader.index_crc());
        assert!(Pruner::new().blocks(&other).prune(&reader).unwrap_err().to_string().contains("another file"));
        // Once more, with all of the pruned file: what is gone stays so.
        let some = Pruner::new().blocks(&trace(&reader, |b| b != 0)).prune(&reader).unwrap();
        let small = open(&some.bytes);
        let again = Pruner::new().prune(&small).unwrap();
        assert_eq!((again.kept, again.pruned), (some.kept, 1));
        assert!(matches!(block(&open(&again.bytes), 0), Err(Error::Pruned { block: 0 })));
        assert_eq!((some.gone, again.gone), (0, 0));
        // By a trace that names what is gone.
        let named = Pruner::new().blocks(&trace(&small, |b| b < 2)).prune(&small).unwrap();
        assert_eq!((named.gone, named.kept + named.pruned), (1, small.block_count()));
    }
}
