//! The orthonormal bases, and synthesis from their coefficients in the decoder's exact arithmetic (spec section 4.4).
//!
//! Coefficients of a block have the block's shape. Along each axis they are ordered by frequency, low ones first,
//! so that what matters gathers in the corner at index 0.

mod dct;
mod dft;
#[cfg(feature = "encode")]
pub mod forward;

use std::sync::OnceLock;

use crate::base::budget::make_room;
use crate::base::error::Result;
use crate::base::portable::cos_turn;
use crate::base::simd::Level;

#[cfg(feature = "encode")]
pub use dft::partners;

/// An orthonormal basis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum Basis {
    /// Separable DCT-II.
    Dct = 0,
    /// Discrete Fourier transform of a real signal. Of each pair of conjugate coefficients c, c* the one of lower
    /// index holds sqrt(2) Re c and the other sqrt(2) Im c, c being the coefficient at the lower index.
    Dft = 1,
}

impl Basis {
    /// Name on the command line and in reports.
    pub fn as_str(self) -> &'static str {
        match self {
            Basis::Dct => "dct",
            Basis::Dft => "dft",
        }
    }
}

/// A coefficient of a block: its position, and the value.
pub(crate) type Term = (u32, f32);

/// Buffers of a synthesis.
#[derive(Debug, Default)]
pub(crate) struct Lines {
    /// The DFT's whole spectra.
    sums: Vec<f32>,
    /// What comes of one axis and goes into the next.
    buffers: [Vec<f32>; 2],
    /// Numbers of the lines that have a term, of the axis at hand.
    used: Vec<u32>,
}

/// The tables of one axis length.
#[derive(Debug)]
pub(crate) struct AxisTable {
    pub(crate) n: usize,
    /// DCT: `[k][i]` for the first half of the positions, and zeros to read beyond. DFT: `[f][i]`, `cos(2 pi f i / n) / sqrt(n)`.
    pub(crate) cos: Vec<f32>,
    /// DFT: `[f][i]`, `sin(2 pi f i / n) / sqrt(n)`.
    sin: Vec<f32>,
}

impl Lines {
    /// What they take in memory.
    pub(crate) fn bytes(&self) -> usize {
        let [from, to] = &self.buffers;
        4 * (self.sums.capacity() + from.capacity() + to.capacity() + self.used.capacity())
    }
}

impl AxisTable {
    // Small by a constant: the squares of all lengths add up to 2^22 at most (`MAX_TABLE_ENTRIES`).
    fn new(basis: Basis, n: usize) -> AxisTable {
        match basis {
            Basis::Dct => {
                let half = n.div_ceil(2);
                let length = n as u64;
                let turn: Vec<f64> = (0..4 * length).map(|j| cos_turn(j, 4 * length)).collect();
                let mut cos = Vec::with_capacity(n * half + dct::PADDING);
                for k in 0..n {
                    let norm = (if k == 0 { 1.0 } else { 2.0 } / n as f64).sqrt();
                    cos.extend((0..half).map(|i| (turn[k * (2 * i + 1) % (4 * n)] * norm) as f32));
                }
                cos.resize(n * half + dct::PADDING, 0.0);
                AxisTable { n, cos, sin: Vec::new() }
            }
            Basis::Dft => {
                let norm = (1.0 / n as f64).sqrt();
                // The sine is the cosine three quarters of a turn later.
                let turns = |quarters: u64| -> Vec<f32> {
                    let length = n as u64;
                    (0..length).map(|j| (cos_turn(4 * j + quarters * length, 4 * length) * norm) as f32).collect()
                };
                let products = |turn: Vec<f32>| (0..n * n).map(|fi| turn[(fi / n) * (fi % n) % n]).collect();
                AxisTable { n, cos: products(turns(0)), sin: products(turns(3)) }
            }
        }
    }
}

/// Rebuilds blocks from coefficients; keeps the tables of the axis lengths it was made for.
#[derive(Debug)]
pub(crate) struct Synthesis {
    basis: Basis,
    tables: Vec<(usize, OnceLock<AxisTable>)>,
}

impl Synthesis {
    /// For blocks whose axis lengths are among `lengths`; tables are made at first use.
    pub(crate) fn new(basis: Basis, lengths: &[usize]) -> Synthesis {
        let mut lengths = lengths.to_vec();
        lengths.sort_unstable();
        lengths.dedup();
        Synthesis { basis, tables: lengths.into_iter().map(|n| (n, OnceLock::new())).collect() }
    }

    #[expect(clippy::expect_used, reason = "blocks have the lengths of the partition, whose list `new` got")]
    pub(crate) fn axis(&self, n: usize) -> &AxisTable {
        let at = self.tables.binary_search_by_key(&n, |t| t.0).expect("a length of the partition");
        self.tables[at].1.get_or_init(|| AxisTable::new(self.basis, n))
    }

    /// The value at every position of a block whose coefficients are all zero but that at index 0, by what the sums come to; `None` for
    /// a basis whose sums may differ.
    pub(crate) fn constant(&self, shape: [usize; 4], mean: f32) -> Option<f32> {
        (self.basis == Basis::Dct).then(|| dct::constant(shape.map(|n| self.axis(n)), mean))
    }

    /// The values of a block from its coefficients: that at index 0, be it zero, then in the order of positions those that are not zero.
    pub(crate) fn synthesize(
        &self,
        level: Level,
        shape: [usize; 4],
        terms: &[Term],
        values: &mut [f32],
        lines: &mut Lines,
    ) -> Result<()> {
        debug_assert!(terms.first().is_some_and(|term| term.0 == 0), "the coefficient at index 0");
        let axes = shape.map(|n| self.axis(n));
        match self.basis {
            Basis::Dct if terms.len() > 1 => {
                // At most what the block has; the loops lengthen them, to fewer mostly.
                for buffer in &mut lines.buffers {
                    make_room(buffer, values.len())?;
                }
                make_room(&mut lines.used, values.len().min(terms.len()))?;
                level.run(dct::Synthesize { axes, terms, values, lines });
            }
            Basis::Dct => level.run(dct::Synthesize { axes, terms, values, lines }),
            Basis::Dft => {
                lines.sums.clear();
                make_room(&mut lines.sums, dft::sums(shape))?;
                values.fill(0.0);
                terms.iter().for_each(|&(position, value)| values[position as usize] = value);
                level.run(dft::Synthesize { axes, values, scratch: &mut lines.sums });
            }
        }
        Ok(())
    }

    /// Bytes of the buffers that a synthesis takes, terms included.
    pub(crate) fn bytes(&self, shape: [usize; 4]) -> usize {
        let n: usize = shape.iter().product();
        let terms = size_of::<Term>() * n;
        match self.basis {
            Basis::Dct => terms + 4 * (2 * n + n / shape[3].max(1)),
            Basis::Dft => terms + 4 * dft::sums(shape),
        }
    }

    /// About the multiply-adds of a synthesis from `terms` terms.
    pub(crate) fn work(&self, shape: [usize; 4], terms: usize) -> u64 {
        let n = shape.iter().product::<usize>() as u64;
        let mut lengths = shape.into_iter().rev().filter(|n| *n > 1).map(|n| n as u64);
        match self.basis {
            Basis::Dft => 4 * n * lengths.sum::<u64>(),
            Basis::Dct if terms < 2 => n / 4,
            Basis::Dct => {
                let last = lengths.next().unwrap_or(1);
                let terms = terms as u64;
                let (mut inner, mut lines) = (last, terms.min(n / last));
                // Each term to both sums of half a row; then of each line that has any to half the positions of the next axis.
                let mut work = terms * last.max(16) + lines * last;
                for length in lengths {
                    work += lines * length.div_ceil(2) * inner;
                    inner *= length;
                    lines = lines.min(n / inner);
                }
                work
            }
        }
    }
}
