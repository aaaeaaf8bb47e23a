//! A file as a BRDF: values, sampling and densities at pairs of directions; what of the file they touched.

pub mod eval;
pub mod importance;
pub mod touched;
