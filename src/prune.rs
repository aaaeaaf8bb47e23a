//! A smaller file for a scene: the blocks that it looked at, as fine as it needs them.

use serde_json::json;

use crate::block::{Block, positions};
use crate::decode::{Header, MASKS, Reader, Scratch, ZEROS};
use crate::entropy::Walk;
use crate::error::{Error, Result};
use crate::format::directory::{self, write_file};
use crate::format::index::{Entry, UNKNOWN_ERROR, encode_error, write_index};
use crate::format::record::{Record, ValidityClass};
use crate::format::{VERSION, is_dependent};
use crate::quantize::Quantizer;
use crate::range::{Decoder, Encoder};
use crate::touched::Touched;
use crate::zeros::code_zeros;

/// What a pruned file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct PrunedFile {
    /// The file.
    pub bytes: Vec<u8>,
    /// Blocks that it keeps, with the coefficients that `detail` leaves them; those without valid entries among them.
    pub kept: usize,
    /// Blocks of which it keeps the mean alone.
    pub pruned: usize,
}

/// The file with only the blocks that were touched; of the others it keeps the means
/// ([`Pruned::Coarse`](crate::decode::Pruned::Coarse)).
///
/// `detail` is the rms error in the log domain that each block may gain by losing its finest coefficients; with 0 blocks
/// stay bit for bit. The errors that the index states grow with it. What restores the source's bits is dropped, and the metadata no
/// longer tell a contract.
///
/// # Errors
/// `InvalidArgument` if the trace is of another file, the file of a draft before 4, or `detail` not a finite number from 0 on or not
/// possible: corrections (a contract on the largest error) need all coefficients. `Corrupt` if the file is damaged.
pub fn prune<D: AsRef<[u8]>>(reader: &Reader<D>, touched: &Touched, detail: f64) -> Result<PrunedFile> {
    let bad = |what: &str| Err(Error::InvalidArgument(what.into()));
    touched.check(reader.block_count(), reader.index_crc())?;
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
    let mut thinner = Thinner { header: reader.header(), detail, scratch: Scratch::default(), walk: Walk::default() };
    let (mut entries, mut records, mut kept) = (Vec::new(), Vec::new(), 0);
    for (block, touched) in touched.blocks().iter().enumerate() {
        let record = reader.record(block)?;
        let mut errors = reader.error_codes(block);
        let bytes = match record.class {
            ValidityClass::None | ValidityClass::Pruned => reader.record_bytes(block).to_vec(),
            _ if !touched => {
                errors = [UNKNOWN_ERROR; 2];
                Record { class: ValidityClass::Pruned, doublings: 0, coded: &[] }.write(block as u32)
            }
            _ if detail == 0.0 => reader.record_bytes(block).to_vec(),
            class => {
                let place = reader.place(block)?;
                let thinned = thinner.thin(&place, &record).map_err(|what| reader.bad_record(block, what))?;
                match thinned {
                    Some(Thinned { coded, lost }) => {
                        let rms = f64::from(reader.stated_errors(block).0) + lost;
                        errors = [encode_error(rms), UNKNOWN_ERROR];
                        Record { class, doublings: record.doublings, coded: &coded }.write(block as u32)
                    }
                    None => reader.record_bytes(block).to_vec(),
                }
            }
        };
        kept += usize::from(record.class == ValidityClass::None || *touched && record.class != ValidityClass::Pruned);
        entries.push(Entry { length: bytes.len() as u32, errors, means: reader.means(block).to_vec() });
        records.extend(bytes);
    }
    let pruned = reader.block_count() - kept;
    let mut sections = Vec::new();
    for name in [directory::GRID, directory::CODING, directory::PARTITION, directory::PROBABILITIES, directory::PROFILE]
    {
        if let Some(bytes) = reader.section(name)? {
            sections.push((name, false, bytes));
        }
    }
    sections.push((directory::INDEX, false, write_index(reader.partition(), &entries)));
    sections.push((directory::METADATA, true, metadata(reader, kept, detail)?));
    sections.push((directory::RECORDS, false, records));
    Ok(PrunedFile { bytes: write_file(VERSION, &sections), kept, pruned })
}

/// The file's metadata with what was done to it, without what is no longer so.
fn metadata<D: AsRef<[u8]>>(reader: &Reader<D>, kept: usize, detail: f64) -> Result<Vec<u8>> {
    let mut metadata = reader.metadata()?;
    let mut encoder = metadata.encoder.take().unwrap_or_else(|| json!({}));
    if let Some(encoder) = encoder.as_object_mut() {
        for stale in ["contract", "corrected", "lossless", "log_rms", "log_max", "valid", "sampled"] {
            encoder.remove(stale);
        }
        let pruned = json!({ "blocks": reader.block_count(), "kept": kept, "detail": detail });
        encoder.insert("pruned".into(), pruned);
    }
    metadata.encoder = Some(encoder);
    metadata.write()
}

/// Takes the finest coefficients out of records.
struct Thinner<'a> {
    header: &'a Header,
    detail: f64,
    scratch: Scratch,
    walk: Walk,
}

/// A record without its finest coefficients.
struct Thinned {
    coded: Vec<u8>,
    /// Rms error gained, log domain.
    lost: f64,
}

impl Thinner<'_> {
    /// `None` if every coefficient is needed.
    fn thin(&mut self, place: &Block, record: &Record) -> Result<Option<Thinned>, &'static str> {
        let Thinner { header, detail, scratch, walk } = self;
        let probabilities = header.probabilities.get().map_err(|_| "its probabilities are damaged")?;
        let mut decoder = Decoder::new(probabilities, record.coded);
        header.decode_record(place, record.class, &mut decoder, scratch)?;
        decoder.check_end()?;
        // Beyond the extents a scratch holds what blocks before have left there.
        let n = place.positions();
        for (plane, extents) in scratch.coefficients.chunks_exact_mut(n).zip(&scratch.extents) {
            for (k, q) in positions(place.shape).zip(plane) {
                *q = if (0..4).all(|a| k[a] < extents[a]) { *q } else { 0 };
            }
        }
        let values = scratch.coefficients.len() as f64;
        let lost = drop_finest(header, place, &mut scratch.coefficients, *detail * *detail * values);
        if lost == 0.0 {
            return Ok(None);
        }
        let mut coder = Encoder::new(probabilities);
        if matches!(record.class, ValidityClass::Mask | ValidityClass::MaskPerChannel) {
            header.mask_model().code(&mut coder, MASKS, place, &mut scratch.masks.clone());
        }
        if header.coding.zeros {
            code_zeros(&mut coder, ZEROS, place.shape, &scratch.masks, &mut scratch.zeros);
        }
        let quantization = header.coding.quantization;
        walk.code(&mut coder, quantization, place.shape, &mut scratch.coefficients, &mut Vec::new())
            .map_err(|_| "an extent or a coefficient is out of range")?;
        Ok(Some(Thinned { coded: coder.finish(), lost: (lost / values).sqrt() }))
    }
}

/// Sets the coefficients of the highest frequencies to zero while their squares sum to at most `budget`; the sum.
///
/// The frequency is in half periods a bin, over all axes. Along a row it grows, so that a row loses its tail: what is left of it goes
/// through the same states of the dependent quantiser as before.
fn drop_finest(header: &Header, place: &Block, coefficients: &mut [i32], budget: f64) -> f64 {
    let n = place.positions();
    let mut finest: Vec<(f64, usize, f64)> = Vec::new();
    let shrink = header.coding.shrink.map(|s| f32::from(s) / 256.0);
    for (component, plane) in coefficients.chunks_exact(n).enumerate() {
        let quantizer = Quantizer { step: header.coding.steps[component], shrink };
        for (at, (k, &q)) in positions(place.shape).zip(plane).enumerate().filter(|(_, (_, q))| **q != 0) {
            let frequency = (0..4).map(|a| (k[a] as f64 / place.shape[a] as f64).powi(2)).sum();
            finest.push((frequency, component * n + at, f64::from(quantizer.dequantize(q)).powi(2)));
        }
    }
    finest.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
    let mut lost = 0.0;
    for (_, at, square) in finest {
        if lost + square > budget {
            break;
        }
        lost += square;
        coefficients[at] = 0;
    }
    lost
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::Pruned;
    use crate::encode::Encoder;
    use crate::grid::{Axis, AxisName, Grid, Mapping};
    use crate::table::BrdfTable;
    use crate::table::synth::Recipe;
    use std::f64::consts::{FRAC_PI_2, PI};

    const SHAPE: [usize; 3] = [9, 5, 12];

    fn table() -> BrdfTable {
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
        let pruned = prune(&reader, &trace(&reader, keep), 0.0).unwrap();
        assert_eq!(pruned.kept, (0..reader.block_count()).filter(|&b| keep(b)).count());
        assert!(pruned.bytes.len() < bytes.len());
        let small = open(&pruned.bytes);
        assert!(small.verify().is_empty());
        assert!(matches!(small.decode_all(), Err(Error::Pruned { block: 1 })));
        let coarse = open(&pruned.bytes).with_pruned(Pruned::Coarse);
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
        let table = BrdfTable::from_parts(table.grid().clone(), values, table.valid().to_vec()).unwrap();
        let bytes = Encoder::new().block_shape(&SHAPE).encode(&table).unwrap().bytes;
        let reader = open(&bytes);
        let all = trace(&reader, |_| true);
        let mut last = bytes.len();
        for detail in [0.02, 0.1, 0.5] {
            let pruned = prune(&reader, &all, detail).unwrap();
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
                let stated = |r: &Reader<&[u8]>| f64::from(r.stated_errors(number).0);
                assert!(stated(&small) >= stated(&reader) && stated(&small) <= (stated(&reader) + detail) * 1.1);
                assert_eq!(small.block_validity(number).unwrap(), reader.block_validity(number).unwrap());
            }
        }
    }

    #[test]
    fn what_cannot_be_pruned_is_refused() {
        let bytes = Encoder::new().block_shape(&SHAPE).encode(&table()).unwrap().bytes;
        let reader = open(&bytes);
        let all = trace(&reader, |_| true);
        for detail in [-0.1, f64::NAN, f64::INFINITY] {
            assert!(prune(&reader, &all, detail).is_err());
        }
        let other = Touched::new(all.blocks().to_vec(), !reader.index_crc());
        assert!(prune(&reader, &other, 0.0).unwrap_err().to_string().contains("another file"));
        // Once more, with a trace of the pruned file: what is gone stays so.
        let some = prune(&reader, &trace(&reader, |b| b != 0), 0.0).unwrap();
        let small = open(&some.bytes);
        let again = prune(&small, &trace(&small, |_| true), 0.0).unwrap();
        assert_eq!((again.kept, again.pruned), (some.kept, 1));
        assert!(matches!(block(&open(&again.bytes), 0), Err(Error::Pruned { block: 0 })));
    }
}
