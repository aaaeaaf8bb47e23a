//! The ground that all else stands on: errors, budgets, bits, portable elementary functions, vectors, maps of files.

pub(crate) mod bits;
pub(crate) mod budget;
pub mod bytes;
pub mod error;
pub mod limits;
#[doc(hidden)]
pub mod excerpt;
#[cfg(feature = "mmap")]
pub mod map;
pub(crate) mod portable;
#[cfg(feature = "encode")]
pub mod real;
pub(crate) mod simd;
pub mod version;
