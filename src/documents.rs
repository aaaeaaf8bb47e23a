//! The Rust snippets of the documents, compiled as doc tests; `tools/documents.py` runs those in other languages.

#[doc = include_str!("../README.md")]
pub struct Readme;

#[doc = include_str!("../docs/guide/renderer.md")]
pub struct Renderer;

#[doc = include_str!("../SECURITY.md")]
pub struct Security;
