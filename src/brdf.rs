//! A file as a BRDF: values, sampling and densities at pairs of directions; what of the file they touched.

mod cache;
mod eval;
pub mod importance;
mod options;
pub mod touched;

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};

use arc_swap::ArcSwapOption;

use crate::base::budget::Budget;
use crate::base::bytes::Bytes;
use crate::base::error::Result;
use crate::decode::Reader;
use crate::decode::point::Sparse;
use crate::table::coords::Lookup;
use crate::table::parameterization::Parameterization;
use cache::{Cached, Scratches};
use importance::Importance;
use touched::Touched;

pub use options::BrdfOptions;

/// Evaluates a file at directions; rebuilds blocks when that pays and keeps some of them.
///
/// A block is first looked up by its coefficients; once that has taken as long as rebuilding it would, it is rebuilt. So a scene
/// that touches few values of a block does not pay for it, and a cache that is too small costs no more than twice what it must.
///
/// Shared between threads by reference: finding a block in the cache takes no lock.
///
/// What it decodes counts towards [`Limits::operations`](crate::base::limits::Limits::operations) over its whole life, less 65 us for each look-up that finds nothing in the
/// cache: a file whose blocks are too large for the cache ends in `LimitExceeded`, where it would be rebuilt for ever. Of a reader with
/// [one budget](Reader::with_one_budget) that discount grows with the bytes of the file, and files below 128 kB have none.
pub struct Brdf {
    reader: Reader,
    lookup: Lookup,
    /// Block b lives at b modulo the length. Blocks leave by the clock rule: in turn, but those used meanwhile a round later.
    cache: Vec<ArcSwapOption<Cached>>,
    cache_bytes: AtomicUsize,
    cache_most: usize,
    hand: AtomicUsize,
    /// Coefficients of blocks, likewise.
    sparse: Vec<ArcSwapOption<Sparse>>,
    /// Bytes of them, and the most that are kept.
    sparse_bytes: AtomicUsize,
    sparse_most: usize,
    /// Blocks that were looked at, a bit each.
    touched: Vec<AtomicU64>,
    /// How often a block was rebuilt.
    rebuilt: AtomicUsize,
    /// Buffers of decodes, as many as [`KEPT_SCRATCHES`] hold.
    scratch: Mutex<Scratches>,
    /// Of all look-ups together, where the reader has none.
    budget: Budget<'static>,
    /// Operations that a look-up brings with it.
    free: u64,
    /// `None` if directions have no place on the file's grid.
    parameterization: Option<Parameterization>,
    /// What draws directions, once somebody asked for it; made by one thread.
    importance: OnceLock<Importance>,
    making: Mutex<()>,
}

impl Brdf {
    /// Maps and opens a file, with the default options.
    ///
    /// ```no_run
    /// let brdf = csbrdf::Brdf::open("chrome.csbrdf")?;
    /// let rgb: [f32; 3] = brdf.eval([0.3, 0.0, 0.9], [-0.5, 0.1, 0.8])?; // 1/sr
    /// # Ok::<(), csbrdf::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Reader::open_path`]; `InvalidArgument` if the axes of the file are not angles of directions.
    #[cfg(feature = "mmap")]
    pub fn open(path: impl AsRef<std::path::Path>) -> Result<Brdf> {
        BrdfOptions::new().open(path)
    }

    /// Opens a file in memory, with the default options.
    ///
    /// # Errors
    /// As [`Reader::open`]; `InvalidArgument` if the axes of the file are not angles of directions.
    pub fn from_bytes(bytes: impl Into<Bytes>) -> Result<Brdf> {
        BrdfOptions::new().from_bytes(bytes)
    }

    /// Evaluates an open file, with the default cache and lookup.
    ///
    /// # Errors
    /// `InvalidArgument` if the axes of the file are not angles of directions.
    pub fn from_reader(reader: Reader) -> Result<Brdf> {
        BrdfOptions::new().from_reader(reader)
    }

    /// The file.
    pub fn reader(&self) -> &Reader {
        &self.reader
    }

    /// Gives the file back; what was decoded of it is dropped, and [`Brdf::touched`] with it.
    pub fn into_reader(self) -> Reader {
        self.reader
    }

    /// The blocks that were looked at so far; [`Touched`] says what for.
    pub fn touched(&self) -> Touched {
        let bit = |b: usize| self.touched[b / 64].load(Ordering::Relaxed) >> (b % 64) & 1 == 1;
        Touched::new((0..self.reader.block_count()).map(bit).collect(), self.reader.index_crc())
    }

    /// Bytes of the records of these blocks: what was read of the file besides its other sections.
    pub fn bytes_touched(&self) -> usize {
        let touched = self.touched();
        let lengths =
            touched.blocks().iter().enumerate().filter(|(_, t)| **t).map(|(b, _)| self.reader.record_length(b));
        lengths.sum()
    }

    /// How often a block was rebuilt so far, blocks that had left the cache again included.
    pub fn blocks_rebuilt(&self) -> usize {
        self.rebuilt.load(Ordering::Relaxed)
    }

    /// All values in 1/sr, as [`Reader::decode_all`]: `[channel]`, then the axes of the grid, the last one fastest.
    ///
    /// # Errors
    /// As [`Reader::decode_all`].
    pub fn decode(&self) -> Result<Vec<f32>> {
        self.reader.decode_all()
    }
}
