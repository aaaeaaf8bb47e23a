//! The body of each target, and what they share. None panics, whatever the bytes.

#[cfg(feature = "cli")]
pub mod args;
pub mod block;
pub mod capi;
pub mod differential;
#[cfg(feature = "cli")]
pub mod encode;
pub mod eval;
pub mod fields;
pub mod file;
pub mod golden;
pub mod index;
#[cfg(feature = "cli")]
pub mod manifest;
pub mod merl;
pub mod open;
#[cfg(feature = "cli")]
pub mod prune;
pub mod recipe;
#[cfg(feature = "cli")]
pub mod repair;
pub mod salvage;
#[cfg(feature = "cli")]
pub mod samples;
pub mod seal;
pub mod sections;
pub mod stale;
pub mod structured;
pub mod trace;

use csbrdf::Limits;

type Body = fn(&[u8]);

/// Target and body.
pub const ALL: &[(&str, Body)] = &[
    ("open", open::run),
    ("block", block::run),
    ("file", file::run),
    ("eval", eval::run),
    ("stale", stale::run),
    ("salvage", salvage::run),
    #[cfg(feature = "cli")]
    ("repair", repair::run),
    ("structured", structured::run),
    #[cfg(feature = "cli")]
    ("prune", prune::run),
    ("trace", trace::run),
    #[cfg(feature = "cli")]
    ("encode", encode::run),
    ("merl", merl::run),
    #[cfg(feature = "cli")]
    ("samples", samples::run),
    #[cfg(feature = "cli")]
    ("args", args::run),
    #[cfg(feature = "cli")]
    ("manifest", manifest::run),
    ("capi", capi::run),
];

/// Tables as small as those of the golden files: a hostile header does not cost a run its time.
const LIMITS: Limits =
    Limits { table_values: 1 << 16, block_values: 1 << 14, operations: 1_000_000_000, bytes: 1 << 28 };

/// What a call hardly does anything with.
const TIGHT: Limits = Limits { operations: 1 << 14, bytes: 1 << 14, ..LIMITS };

/// What the format promises of every value.
fn is_value(value: &f32) -> bool {
    value.is_finite() && *value >= 0.0
}

fn same_bits(a: &[f32], b: &[f32]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}
