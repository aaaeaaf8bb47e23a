//! Outside formats, one file each.

pub mod merl;
#[cfg(feature = "encode")]
pub mod npy;
#[cfg(feature = "encode")]
pub mod samples;
