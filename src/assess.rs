//! What a file or a table is worth: error figures, proof of contracts, what is physically implausible, pictures, plans of
//! measurements.

#[cfg(any(feature = "encode", test))]
pub mod lint;
#[cfg(feature = "encode")]
pub mod metrics;
#[cfg(feature = "encode")]
pub mod plan;
#[cfg(feature = "encode")]
pub mod proof;
#[cfg(feature = "encode")]
pub mod render;
