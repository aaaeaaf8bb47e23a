//! Both directions of each stage between a block's log values and its record, in the order in which a decoder needs them
//! (spec section 4).

pub mod channel;
pub(crate) mod contexts;
pub(crate) mod correct;
pub mod dependent;
pub(crate) mod entropy;
pub mod fourier;
pub(crate) mod lossless;
pub(crate) mod mask;
pub(crate) mod profile;
pub mod quantize;
pub(crate) mod range;
pub mod sample;
pub mod tone;
pub(crate) mod zeros;
