//! The groups of options in a long help, in the order in which they are shown.

pub(super) const QUALITY: &str = "How small or how good";
pub(super) const KEEP: &str = "What to keep";
pub(super) const SAMPLES: &str = "Recovery from samples";
pub(super) const OUTPUT: &str = "Output";
pub(super) const EXPERT: &str = "Expert";
pub(super) const EVERYWHERE: &str = "Everywhere";
