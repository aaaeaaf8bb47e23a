//! Sets: many materials, each a file of its own, and a manifest that says what they are.
//!
//! A material is read from its own file alone; nothing is shared between the files. SHARED_TABLE

pub mod check;
pub mod manifest;
pub mod table;
