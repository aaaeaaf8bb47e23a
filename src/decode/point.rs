//! Single values of a block from its coefficients, where so few are wanted that rebuilding the block would cost more.
//!
//! The sums of section 4.4 of the spec at one position, in the same order: the same bits as from the whole block.

use std::sync::atomic::AtomicU32;

use super::{Reader, Scratch};
use crate::blocks::BlockCodec;
use crate::base::budget::{Budget, make_room, with_room};
use crate::base::error::{Error, Result};
use crate::codec::channel::ChannelTransform;
use crate::codec::fourier::{AxisTable, Basis};
use crate::codec::tone::inverse_tone_map;
use crate::table::block::Block;

/// The coefficients of a block that are not zero.
#[derive(Debug)]
pub(crate) struct Sparse {
    pub(crate) block: usize,
    place: Block,
    components: Vec<Component>,
    /// Exact zeros, a bit for each of `[channel][position]`; empty where there are none.
    zeros: Vec<u8>,
    /// Look-ups that were answered from it, dear ones as several.
    pub(crate) uses: AtomicU32,
    /// Operations of one position's values.
    pub(crate) work: u64,
}

/// Rows along the last axis in order, and what they hold.
#[derive(Debug, Default)]
struct Component {
    rows: Vec<Row>,
    /// Index along the last axis, coefficient.
    entries: Vec<(u32, f32)>,
}

#[derive(Debug)]
struct Row {
    /// Along the first three axes.
    at: [u32; 3],
    /// Where its entries end.
    end: usize,
}

/// Sums over the even and the odd frequencies of an axis, at one position.
struct Sums<'a> {
    table: &'a AxisTable,
    /// The position or its mirror image, whichever is in the first half.
    column: usize,
    mirrored: bool,
    sums: [f32; 2],
}

impl<'a> Sums<'a> {
    fn new(table: &'a AxisTable, position: usize) -> Sums<'a> {
        let mirror = table.n - 1 - position;
        Sums { table, column: position.min(mirror), mirrored: mirror < position, sums: [0.0; 2] }
    }

    fn add(&mut self, frequency: usize, value: f32) {
        if self.table.n == 1 {
            // The one coefficient of a single position is its value.
            self.sums[0] = value;
            return;
        }
        let half = self.table.n.div_ceil(2);
        self.sums[frequency % 2] += value * self.table.cos[frequency * half + self.column];
    }

    /// The value, and zero sums for the next line.
    fn take(&mut self) -> f32 {
        let [even, odd] = std::mem::take(&mut self.sums);
        match (self.table.n, self.mirrored) {
            (1, _) => even,
            (_, false) => even + odd,
            (_, true) => even - odd,
        }
    }
}

impl Sparse {
    /// What it takes in memory.
    pub(crate) fn bytes(&self) -> usize {
        let of = |component: &Component| {
            size_of::<Component>()
                + component.rows.capacity() * size_of::<Row>()
                + component.entries.capacity() * size_of::<(u32, f32)>()
        };
        size_of::<Sparse>() + self.zeros.capacity() + self.components.iter().map(of).sum::<usize>()
    }
}

impl Component {
    fn value(&self, axes: [&AxisTable; 4], within: [usize; 4]) -> f32 {
        let [mut first, mut second, mut third, mut fourth] = [0, 1, 2, 3].map(|a| Sums::new(axes[a], within[a]));
        let mut start = 0;
        for (number, row) in self.rows.iter().enumerate() {
            for &(frequency, value) in &self.entries[start..row.end] {
                fourth.add(frequency as usize, value);
            }
            start = row.end;
            let [i, j, k] = row.at.map(|at| at as usize);
            third.add(k, fourth.take());
            let next = self.rows.get(number + 1).map(|row| row.at);
            let goes_on = |axes: usize| next.is_some_and(|next| next[..axes] == row.at[..axes]);
            if !goes_on(2) {
                second.add(j, third.take());
            }
            if !goes_on(1) {
                first.add(i, second.take());
            }
        }
        first.take()
    }
}

impl BlockCodec {
    /// What the scratch holds after a record was decoded.
    fn sparse(&self, block: usize, place: &Block, means: &[i32], scratch: &Scratch) -> Result<Sparse> {
        let [_, n1, n2, n3] = place.shape;
        // One a channel.
        let mut components = Vec::with_capacity(means.len());
        let mut terms = Vec::new();
        for (c, &mean) in means.iter().enumerate() {
            self.dequantize(c, scratch.coefficients.of_channel(c), mean, &mut terms)?;
            let mut component = Component { rows: Vec::new(), entries: with_room(terms.len())? };
            let rows = terms.chunk_by(|a, b| a.0 as usize / n3 == b.0 as usize / n3).count();
            make_room(&mut component.rows, rows)?;
            for row in terms.chunk_by(|a, b| a.0 as usize / n3 == b.0 as usize / n3) {
                let number = row[0].0 as usize / n3;
                component.entries.extend(row.iter().map(|(position, value)| (*position % n3 as u32, *value)));
                let at = [number / n2 / n1, number / n2 % n1, number % n2].map(|at| at as u32);
                component.rows.push(Row { at, end: component.entries.len() });
            }
            components.push(component);
        }
        let bits = |zeros: &[bool]| zeros.iter().rev().fold(0, |bits, zero| bits << 1 | u8::from(*zero));
        let zeros = scratch.zeros.contains(&true).then(|| scratch.zeros.chunks(8).map(bits).collect());
        let zeros = zeros.unwrap_or_default();
        let entries: usize = components.iter().map(|component| component.entries.len()).sum();
        let rows: usize = components.iter().map(|component| component.rows.len()).sum();
        let here = Block { shape: [1; 4], ..*place };
        let mixed = if self.coding.transform == ChannelTransform::None { 1 } else { means.len() };
        let work =
            (2 * entries + 6 * rows + 8 * means.len() + mixed * means.len()) as u64 + self.work_of_profile(&here);
        Ok(Sparse { block, place: *place, components, zeros, uses: AtomicU32::new(0), work })
    }
}

impl<D: AsRef<[u8]>> Reader<D> {
    /// The coefficients of a block. `None` where its single values are not to be had without the others: the DFT, or a file
    /// with corrections.
    pub(crate) fn sparse_block(&self, block: usize, scratch: &mut Scratch, budget: &Budget) -> Result<Option<Sparse>> {
        if self.codec.coding.basis == Basis::Dft || self.codec.coding.correction.is_some() {
            return Ok(None);
        }
        let place = self.place(block)?;
        // Points take the profile.
        self.prepare(budget)?;
        self.decode_coefficients(block, &place, scratch, budget)?;
        // Terms, and entries with a row each at most.
        let _held = budget.holding(48 * scratch.coefficients.len() as u64)?;
        self.codec.sparse(block, &place, self.index.means(block), scratch).map(Some)
    }

    /// About the bytes that a block's coefficients take: two of them a byte of the record, with their rows.
    pub(crate) fn likely_sparse_bytes(&self, block: usize) -> usize {
        let zeros = if self.codec.coding.zeros { self.block_values(block).unwrap_or(0) / 8 } else { 0 };
        zeros + size_of::<Sparse>() + 24 * self.index.record(block).len()
    }

    /// BRDF values in 1/sr of all channels at a place in a block.
    pub(crate) fn point(&self, sparse: &Sparse, within: [usize; 4], value: &mut [f32]) -> Result<()> {
        let Sparse { place, components, zeros, .. } = sparse;
        let axes = self.codec.axes(place.shape);
        for (value, component) in value.iter_mut().zip(components) {
            *value = component.value(axes, within);
        }
        let here = Block { origin: std::array::from_fn(|a| place.origin[a] + within[a]), shape: [1; 4] };
        self.codec
            .add_profile(&here, value)
            .map_err(|what| Error::corrupt("GRAZ", self.codec.coded_profile.as_ref().map_or(0, |p| p.offset), what))?;
        self.codec.to_channels(value);
        let [_, n1, n2, n3] = place.shape;
        let index = ((within[0] * n1 + within[1]) * n2 + within[2]) * n3 + within[3];
        let eps = self.codec.coding.eps as f32;
        for (c, value) in value.iter_mut().enumerate() {
            let at = c * place.positions() + index;
            let zero = zeros.get(at / 8).is_some_and(|bits| bits >> (at % 8) & 1 == 1);
            *value = if zero { 0.0 } else { inverse_tone_map(*value, eps) };
        }
        Ok(())
    }
}
