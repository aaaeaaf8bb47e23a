//! The body of each target, and what they share. None panics, whatever the bytes.

pub mod args;
pub mod block;
pub mod capi;
pub mod encode;
pub mod eval;
pub mod file;
pub mod golden;
pub mod merl;
pub mod open;
pub mod prune;
pub mod samples;
pub mod seal;
pub mod sections;
pub mod stale;
pub mod trace;

use csbrdf::format::Limits;

type Body = fn(&[u8]);

/// Target and body.
pub const ALL: [(&str, Body); 12] = [
    ("open", open::run),
    ("block", block::run),
    ("file", file::run),
    ("eval", eval::run),
    ("stale", stale::run),
    ("prune", prune::run),
    ("trace", trace::run),
    ("encode", encode::run),
    ("merl", merl::run),
    ("samples", samples::run),
    ("args", args::run),
    ("capi", capi::run),
];

/// Tables as small as those of the golden files: a hostile header does not cost a run its time.
const LIMITS: Limits = Limits { table_values: 1 << 16, block_values: 1 << 14 };

/// What the format promises of every value.
fn is_value(value: &f32) -> bool {
    value.is_finite() && *value >= 0.0
}

fn same_bits(a: &[f32], b: &[f32]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}
