//! Records coded again, without the channels and the detail that a pruned file does not keep.

use super::channels::Selection;
use crate::base::budget::{Budget, Fault, repeated, with_room};
use crate::base::error::Result;
use crate::blocks::code::{Coding, Contents};
use crate::blocks::{BlockCodec, Scratch};
use crate::codec::quantize::Quantizer;
use crate::codec::range::{Coder, Decoder};
use crate::encode::classify;
use crate::format::record::{Record, ValidityClass};
use crate::table::block::{Block, positions};

/// Bytes and operations of a coefficient whose frequency is compared with others.
const FOUND: u64 = size_of::<(f64, usize, f64)>() as u64;
const SORTED: u64 = 100;

/// Takes records apart and codes what is left of them.
pub(super) struct Recoder<'a> {
    source: &'a BlockCodec,
    /// Of the pruned file.
    target: &'a BlockCodec,
    /// `None`: all channels.
    selection: Option<&'a Selection>,
    /// Rms error that a block may gain, log domain.
    detail: f64,
    scratch: Scratch,
    coding: Coding,
}

/// What a record held, less what is not kept.
pub(super) struct Remains {
    pub(super) class: ValidityClass,
    /// Valid entries of what is kept, times this, are those of the record; infinite if none are left.
    pub(super) valid_before: f64,
    /// Rms error gained over the valid entries at most, log domain.
    pub(super) lost: f64,
    /// As in [`Scratch`].
    masks: Vec<bool>,
    zeros: Vec<bool>,
    coefficients: Vec<i32>,
    /// With the log values before them, `[channel][position]`, if the file has a correction step.
    corrections: Option<(Vec<i32>, Vec<f32>)>,
}

impl<'a> Recoder<'a> {
    pub(super) fn new(
        source: &'a BlockCodec,
        target: &'a BlockCodec,
        selection: Option<&'a Selection>,
        detail: f64,
    ) -> Recoder<'a> {
        let (scratch, coding) = Default::default();
        Recoder { source, target, selection, detail, scratch, coding }
    }

    /// Takes a record with coefficients apart.
    pub(super) fn take_apart(
        &mut self,
        block: &Block,
        record: &Record,
        means: &[i32],
        budget: &Budget,
    ) -> Result<Remains, Fault> {
        let Recoder { source, target, selection, detail, scratch, .. } = self;
        let corrected = source.coding.correction.is_some();
        if corrected {
            source.rebuild(block, record, means, scratch, budget)?;
        } else {
            let probabilities = source.probabilities.get().map_err(|_| "its probabilities are damaged")?;
            let mut decoder = Decoder::new(probabilities, record.coded);
            source.decode_record(block, record.class, &mut decoder, scratch, budget)?;
            decoder.check_end()?;
        }
        let n = block.positions();
        let mut remains = Remains {
            class: record.class,
            valid_before: 1.0,
            lost: 0.0,
            masks: repeated(&scratch.masks, 1)?,
            zeros: repeated(&scratch.zeros, 1)?,
            coefficients: scratch.coefficients.to_planes(source.grid.channels().len(), n)?,
            corrections: None,
        };
        if let Some(selection) = selection {
            remains.select(selection, source, target, block);
            if corrected {
                let corrections = selection.of_channels(&scratch.corrections, n);
                let means = selection.of_components(means, 1);
                target.rebuild_uncoded(block, &remains.coefficients, &means, scratch)?;
                remains.corrections = Some((corrections, scratch.log.to_vec()));
            }
        }
        let values = remains.coefficients.len() as f64;
        let nonzero = scratch.coefficients.len() as u64;
        let lost = match *detail > 0.0 {
            true => {
                let _held = budget.holding(FOUND * nonzero)?;
                budget.spend(SORTED * nonzero)?;
                drop_finest(target, block, &mut remains.coefficients, *detail * *detail * values)?
            }
            false => 0.0,
        };
        if lost > 0.0 {
            // All of it may be lost where something was measured, whose errors the index states.
            let masks = source.masks_of(block, scratch)?;
            let masks = selection.map_or_else(|| masks.clone(), |selection| selection.of_channels(&masks, n));
            let valid = masks.iter().filter(|valid| **valid).count();
            remains.lost = (lost / valid.max(1) as f64).sqrt();
        }
        Ok(remains)
    }

    /// Codes what is left of a record.
    pub(super) fn code<C: Coder>(&mut self, coder: &mut C, block: &Block, remains: &Remains) -> Result<(), Fault> {
        let Remains { class, masks, zeros, coefficients, corrections, .. } = remains;
        let corrections = corrections.as_ref().map(|(corrections, log)| (&corrections[..], &log[..]));
        let contents = Contents { class: *class, masks, zeros, coefficients, corrections };
        self.target.code(coder, block, &contents, &mut self.coding)
    }
}

impl Remains {
    fn select(&mut self, selection: &Selection, source: &BlockCodec, target: &BlockCodec, block: &Block) {
        let n = block.positions();
        let [before, after] = [source, target].map(|codec| codec.grid.channels().len());
        self.valid_before = before as f64 / after as f64;
        self.coefficients = selection.of_components(&self.coefficients, n);
        if !self.zeros.is_empty() {
            self.zeros = selection.of_channels(&self.zeros, n);
        }
        if self.class == ValidityClass::MaskPerChannel {
            let valid = |masks: &[bool]| masks.iter().filter(|valid| **valid).count() as f64;
            let of_all = valid(&self.masks);
            let masks = selection.of_channels(&self.masks, n);
            self.valid_before = of_all / valid(&masks);
            (self.class, self.masks) = match classify(target, block, &masks) {
                // Its coefficients stay: what they fill in is to stay too.
                (ValidityClass::None, _) => (ValidityClass::Mask, masks[..n].to_vec()),
                (ValidityClass::Mask, mask) => (ValidityClass::Mask, mask),
                (class, _) => (class, masks),
            };
        }
    }
}

/// Sets the coefficients of the highest frequencies to zero while their squares sum to at most `most`; the sum.
///
/// The frequency is in half periods a bin, over all axes. Along a row it grows, so that a row loses its tail: what is left of it goes
/// through the same states of the dependent quantiser as before.
fn drop_finest(codec: &BlockCodec, place: &Block, coefficients: &mut [i32], most: f64) -> Result<f64> {
    let n = place.positions();
    let mut finest: Vec<(f64, usize, f64)> = with_room(coefficients.iter().filter(|q| **q != 0).count())?;
    let shrink = codec.coding.shrink.map(|s| f32::from(s) / 256.0);
    for (component, plane) in coefficients.chunks_exact(n).enumerate() {
        let quantizer = Quantizer { step: codec.coding.steps[component], shrink };
        for (at, (k, &q)) in positions(place.shape).zip(plane).enumerate().filter(|(_, (_, q))| **q != 0) {
            let frequency = (0..4).map(|a| (k[a] as f64 / place.shape[a] as f64).powi(2)).sum();
            finest.push((frequency, component * n + at, f64::from(quantizer.dequantize(q)).powi(2)));
        }
    }
    // No two are equal: no place twice.
    finest.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
    let mut lost = 0.0;
    for (_, at, square) in finest {
        if lost + square > most {
            break;
        }
        lost += square;
        coefficients[at] = 0;
    }
    Ok(lost)
}
