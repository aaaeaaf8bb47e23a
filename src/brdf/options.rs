//! How a file is opened for evaluation.

use std::sync::atomic::{AtomicU64, AtomicUsize};
use std::sync::{Mutex, OnceLock};

use arc_swap::ArcSwapOption;

use super::Brdf;
use super::cache::{CACHE_BLOCKS, DEFAULT_BYTES, FREE, SPARSE_BLOCKS, SPARSE_SHARE};
use crate::base::budget::Budget;
use crate::base::bytes::Bytes;
use crate::base::error::Result;
use crate::decode::{PrunedPolicy, Reader};
use crate::base::limits::Limits;
use crate::table::coords::Lookup;
use crate::table::parameterization::Parameterization;

/// How to open a file for evaluation: limits, cache, lookup, what pruned blocks give.
///
/// ```no_run
/// # use csbrdf::{BrdfOptions, Limits, PrunedPolicy};
/// let options = BrdfOptions::new().cache_bytes(8 << 20).pruned(PrunedPolicy::Coarse);
/// let brdf = options.limits(Limits { table_values: 1 << 24, ..Limits::default() }).open("chrome.csbrdf")?;
/// # Ok::<(), csbrdf::Error>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct BrdfOptions {
    limits: Limits,
    pruned: PrunedPolicy,
    lookup: Lookup,
    cache_bytes: usize,
    any_axes: bool,
}

impl Default for BrdfOptions {
    fn default() -> BrdfOptions {
        BrdfOptions::new()
    }
}

impl BrdfOptions {
    /// Default limits, an error for pruned blocks, linear lookup, a cache of 64 MiB.
    pub fn new() -> BrdfOptions {
        BrdfOptions {
            limits: Limits::default(),
            pruned: PrunedPolicy::default(),
            lookup: Lookup::Linear,
            cache_bytes: DEFAULT_BYTES,
            any_axes: false,
        }
    }

    /// What the file may cost.
    pub fn limits(self, limits: Limits) -> BrdfOptions {
        BrdfOptions { limits, ..self }
    }

    /// What blocks give that were pruned from the file, or lost.
    pub fn pruned(self, pruned: PrunedPolicy) -> BrdfOptions {
        BrdfOptions { pruned, ..self }
    }

    /// Linear between bin centres, or the nearest bin.
    pub fn lookup(self, lookup: Lookup) -> BrdfOptions {
        BrdfOptions { lookup, ..self }
    }

    /// Most bytes of the cache: three quarters for decoded blocks, at least one of them, and the rest for coefficients of blocks. Where
    /// those do not fit, blocks are rebuilt without them.
    pub fn cache_bytes(self, bytes: usize) -> BrdfOptions {
        BrdfOptions { cache_bytes: bytes, ..self }
    }

    /// Whether to open files as well whose axes are not angles of directions: evaluating them is `InvalidArgument` then, everything else
    /// works. For programs that take any file.
    pub fn any_axes(self, any: bool) -> BrdfOptions {
        BrdfOptions { any_axes: any, ..self }
    }

    /// Maps and opens a file; [`Reader::open_path`] says what must not happen to it meanwhile.
    ///
    /// # Errors
    /// As [`Reader::open_path`]; `InvalidArgument` if the axes of the file are not angles of directions.
    #[cfg(feature = "mmap")]
    pub fn open(self, path: impl AsRef<std::path::Path>) -> Result<Brdf> {
        let path = path.as_ref();
        self.from_bytes(crate::base::map::map_file(path)?).map_err(|e| e.in_file(path))
    }

    /// Opens a file in memory.
    ///
    /// # Errors
    /// As [`Reader::open`]; `InvalidArgument` if the axes of the file are not angles of directions.
    #[allow(clippy::wrong_self_convention)] // from bytes, by these options
    pub fn from_bytes(self, bytes: impl Into<Bytes>) -> Result<Brdf> {
        self.from_reader(Reader::open_with_limits(bytes.into(), self.limits)?.with_pruned(self.pruned))
    }

    /// Evaluates an open file, whose own limits and answer for pruned blocks stay.
    ///
    /// # Errors
    /// `InvalidArgument` if the axes of the file are not angles of directions.
    #[allow(clippy::wrong_self_convention)] // as above
    pub fn from_reader(self, reader: Reader) -> Result<Brdf> {
        let parameterization = match Parameterization::of(reader.grid()) {
            Err(why) if !self.any_axes => return Err(why),
            found => found.ok(),
        };
        let blocks = reader.block_count();
        let sparse_most = self.cache_bytes / SPARSE_SHARE;
        Ok(Brdf {
            budget: Budget::new(reader.limits(), reader.len()),
            free: if reader.one_budget().is_some() { (reader.len() as u64 >> 17 << 14).min(FREE) } else { FREE },
            lookup: self.lookup,
            cache: (0..blocks.min(CACHE_BLOCKS)).map(|_| ArcSwapOption::empty()).collect(),
            cache_bytes: AtomicUsize::new(0),
            cache_most: self.cache_bytes - sparse_most,
            hand: AtomicUsize::new(0),
            sparse: (0..blocks.min(SPARSE_BLOCKS)).map(|_| ArcSwapOption::empty()).collect(),
            sparse_bytes: AtomicUsize::new(0),
            sparse_most,
            touched: (0..blocks.div_ceil(64)).map(|_| AtomicU64::new(0)).collect(),
            rebuilt: AtomicUsize::new(0),
            scratch: Mutex::default(),
            parameterization,
            importance: OnceLock::new(),
            making: Mutex::default(),
            reader,
        })
    }
}
