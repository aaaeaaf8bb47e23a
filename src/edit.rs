//! From a file to another: pruned for a scene, or what damage left of it.

#[cfg(feature = "encode")]
pub mod prune;
pub mod salvage;
