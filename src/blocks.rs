//! One block codec for the reader, the encoder and pruning: a block's record to log values and back.
//!
//! `codec` has what all blocks of a file share and the way from a record to log values, `code` the way back; `values` makes values of log
//! values, `cost` and `head_cost` count what it takes before it is taken. The stages themselves are in `codec/`, the bytes in `format/`.

mod buffer;
#[cfg(feature = "encode")]
pub(crate) mod code;
pub(crate) mod codec;
mod cost;
pub(crate) mod head_cost;
pub(crate) mod lossless;
pub(crate) mod values;

pub(crate) use codec::BlockCodec;
#[cfg(feature = "encode")]
pub(crate) use codec::without_zeros;
pub use codec::Scratch;
