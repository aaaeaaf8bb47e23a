//! From coefficients, validity and corrections to a record's coded bytes (spec section 3.8), the inverse of
//! [`BlockCodec::rebuild`].

use super::codec::{BlockCodec, without_zeros};
use crate::base::budget::Fault;
use crate::base::error::Result;
use crate::codec::contexts::{CORRECTIONS, MASKS, ZEROS};
use crate::codec::correct::{self, Decoded};
use crate::codec::entropy::Walk;
use crate::codec::range::Coder;
use crate::codec::zeros::code_zeros;
use crate::format::record::ValidityClass;
use crate::table::block::Block;

/// What a record is coded from.
pub(crate) struct Contents<'a> {
    pub(crate) class: ValidityClass,
    /// Validity, `[channel][position]` or one for all channels.
    pub(crate) masks: &'a [bool],
    /// Exact zeros, `[channel][position]`; empty if there are none.
    pub(crate) zeros: &'a [bool],
    /// `[component][position]`, the first of each plane zero.
    pub(crate) coefficients: &'a [i32],
    /// Corrections and the log values before them, `[channel][position]`, if the file has a correction step.
    pub(crate) corrections: Option<(&'a [i32], &'a [f32])>,
}

/// Buffers of a thread that codes records.
#[derive(Default)]
pub(crate) struct Coding {
    walk: Walk,
    correct: correct::Walk,
}

impl BlockCodec {
    /// Codes a record's contents, for a range encoder or to count; nothing for a class that has no coded bytes.
    pub(crate) fn code<C: Coder>(
        &self,
        coder: &mut C,
        block: &Block,
        contents: &Contents,
        buffers: &mut Coding,
    ) -> Result<(), Fault> {
        let &Contents { class, masks, zeros, coefficients, corrections } = contents;
        if class.is_mean_only() {
            return Ok(());
        }
        if matches!(class, ValidityClass::Mask | ValidityClass::MaskPerChannel) {
            self.mask_model().code(coder, MASKS, block, &mut masks.to_vec());
        }
        if self.coding.zeros {
            let channels = self.grid.channels().len();
            code_zeros(coder, ZEROS, block.shape, channels, || masks, &mut zeros.to_vec())?;
        }
        let walked = buffers.walk.code(coder, self.coding.quantization, block.shape, coefficients);
        walked.map_err(|_| "an extent or a coefficient is out of range")?;
        if let (Some(step), Some((corrections, log))) = (self.coding.correction, corrections) {
            let masks = &without_zeros(masks, zeros)?;
            let decoded = Decoded { shape: block.shape, masks, log, step };
            let coded = buffers.correct.code(coder, CORRECTIONS, decoded, &mut corrections.to_vec());
            coded.map_err(|_| "a correction is out of range")?;
        }
        Ok(())
    }
}
