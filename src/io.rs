//! Outside formats, one file each, and the one list that says which of them a file is ([`read`]).

pub mod merl;
#[cfg(feature = "encode")]
pub mod npy;
#[cfg(feature = "encode")]
mod read;
#[cfg(feature = "encode")]
pub mod samples;

#[cfg(feature = "encode")]
pub use read::{Format, ReadOptions, is_named_as_table, read, recognise};
