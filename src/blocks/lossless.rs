//! The bits of a block's source values from its part of EXCT (spec sections 3.10 and 4.12).

use crate::codec::lossless::{Decoded, Form, Walk, probabilities};
use crate::codec::range::Decoder;

/// The bits of a block from what the range coder gave for it.
pub(crate) fn decode_bits(decoded: Decoded, coded: &[u8], bits: &mut [u64]) -> Result<(), &'static str> {
    let mut decoder = Decoder::new(&probabilities(), coded);
    let mut forms = vec![Form::default(); decoded.scales.len()];
    Walk::default().code(&mut decoder, decoded, &mut forms, bits)?;
    if decoder.unread() > 0 {
        return Err("bytes are left over at its end");
    }
    Ok(())
}
