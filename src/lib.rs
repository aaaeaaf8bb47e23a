//! Codec and file format for measured BRDFs.
#![cfg_attr(not(feature = "encode"), allow(dead_code))]

pub mod block;
pub mod channel;
pub mod coords;
pub mod decode;
#[cfg(feature = "encode")]
pub mod encode;
mod entropy;
pub mod error;
mod bits;
mod exact;
pub mod format;
pub mod fourier;
pub mod grid;
mod horizon;
#[cfg(feature = "mmap")]
pub mod map;
mod mask;
#[cfg(feature = "encode")]
pub mod metrics;
pub mod quantize;
mod range;
#[cfg(feature = "encode")]
pub mod render;
pub mod sample;
#[cfg(feature = "encode")]
pub mod solve;
pub mod table;
pub mod tone;

pub use error::{Error, Result};
