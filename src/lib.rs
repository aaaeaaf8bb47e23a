//! Codec and file format for measured BRDFs.
//!
//! A measured BRDF is a table of reflectance over half/difference angles, 35 MB a material for MERL. csbrdf stores
//! it as sparse Fourier coefficients of the logarithm, block by block (Seylan, Ergun, Ozturk, "BRDF Reconstruction
//! Using Compressive Sensing", WSCG 2013), and gives single blocks or values back without reading the rest. The
//! format is described in `spec/csbrdf.md`; the modules below follow the data through it.
//!
//! Encode a table, open the file, decode it:
//!
//! ```
//! # #[cfg(feature = "encode")] {
//! use csbrdf::synth::Recipe;
//! use csbrdf::{Encoder, Reader};
//!
//! let table = Recipe::named("satin-paint").unwrap().merl()?;
//! let encoded = Encoder::new().block_shape(&[15, 15, 15]).encode(&table)?;
//! assert!(encoded.bytes.len() * 100 < 8 * table.values().len());
//! assert!(encoded.report.log_rms < 0.02);
//!
//! let reader = Reader::open(encoded.bytes)?;
//! let values: Vec<f32> = reader.decode_all()?; // 1/sr, [channel][theta_h][theta_d][phi_d]
//! let mut block = vec![0.0; reader.block_values(7)?];
//! reader.block_into(7, &mut block)?; // one block alone
//! # assert!(values.iter().chain(&block).all(|v| v.is_finite() && *v >= 0.0));
//! # }
//! # Ok::<(), csbrdf::Error>(())
//! ```
//!
//! Evaluate a file at directions (bytes in memory here; `Reader::open_path` maps a file):
//!
//! ```
//! # #[cfg(feature = "encode")] {
//! # use csbrdf::{Encoder, Grid, synth::Recipe};
//! # let table = Recipe::named("matte").unwrap().merl()?;
//! # let bytes = Encoder::new().block_shape(&[15, 15, 30]).encode(&table)?.bytes;
//! use csbrdf::Brdf;
//!
//! let brdf = Brdf::from_bytes(bytes)?;
//! let [r, g, b] = brdf.eval([0.3, 0.0, 0.9], [-0.5, 0.1, 0.8])?; // 1/sr
//! assert!(r > 0.0 && g > 0.0 && b > 0.0);
//! # }
//! # Ok::<(), csbrdf::Error>(())
//! ```
//!
//! # Features
//!
//! By default the reader and `mmap`, which maps files: eight small crates. `parallel` decodes whole tables on all cores, `metadata` reads
//! provenance (serde, zstd), `encode` adds the encoder with the l1 solver, metrics and pictures. The tool is a package of its own,
//! `tools/cli`. (`unstable` shows the inside to the packages of the repository; no promise is made of it.)
#![cfg_attr(not(all(feature = "encode", feature = "unstable")), allow(dead_code))]
// What reads files gives an error for any bytes; where it could panic by intent, the place says why it does not.
#![cfg_attr(
    not(any(test, feature = "encode")),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

/// Modules that are public with the feature `unstable` alone.
macro_rules! inside {
    ($(mod $name:ident;)*) => { $(
        #[cfg(feature = "unstable")]
        #[doc(hidden)]
        pub mod $name;
        #[cfg(not(feature = "unstable"))]
        mod $name;
    )* };
}

pub mod assess;
pub mod edit;
#[cfg(feature = "encode")]
pub mod io;

/// Where blocks lie, what a file says of them, and what they are synthesised from.
pub mod block {
    pub use crate::codec::fourier::Basis;
    pub use crate::decode::{BlockInfo, Origin, Scratch, Spectrum, State};
    pub use crate::format::record::ValidityClass;
    pub use crate::table::block::{Block, Partition};
}

/// What a file says of all its blocks: how they are coded, and which sections it has.
pub mod file {
    pub use crate::codec::channel::ChannelTransform;
    pub use crate::codec::dependent::Quantization;
    pub use crate::codec::sample::Sampling;
    pub use crate::format::directory::{Directory, Section};
    pub use crate::format::header::Coding;
}

// What the tool, the bindings and the measuring programs need of the inside: no promise is made of it.
inside! {
    mod base;
    mod blocks;
    mod brdf;
    mod codec;
    mod decode;
    mod format;
    mod table;
}
#[cfg(feature = "encode")]
inside! {
    mod encode;
}
#[cfg(not(feature = "encode"))]
mod io;

#[cfg(all(doctest, feature = "encode"))]
mod documents;

pub use base::bytes::Bytes;
pub use base::error::{Error, Result};
pub use base::limits::Limits;
pub use brdf::importance::{Importance, Sample};
pub use brdf::touched::Touched;
pub use brdf::{Brdf, BrdfOptions};
pub use decode::{PrunedPolicy, Reader};
#[cfg(feature = "encode")]
pub use encode::contract::{Contract, Figures};
#[cfg(feature = "encode")]
pub use encode::{ChannelCoding, Effort, Encoded, Encoder, Preset, Report};
#[cfg(feature = "metadata")]
pub use format::metadata::Metadata;
pub use table::Table;
pub use table::coords::Lookup;
pub use table::grid::{Axis, AxisName, Channel, Grid, Mapping};
pub use table::parameterization::Parameterization;
#[cfg(feature = "encode")]
pub use table::synth;
