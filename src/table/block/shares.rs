//! Planes of the grid cut into shares, each with blocks of its own: threads can then fill blocks without waiting for each other.
//!
//! A share is a box of whole blocks that spans all of the axes behind one, its depth: so its places are few and long runs of memory,
//! where a list of the rows of every block can take more memory than their values. Shares meet in few cache lines, too, for which
//! threads wait.

use super::memory::Memory;
use super::{Block, Partition, div_ceil, linear, unravel};

/// Most shares, a few hundred bytes each, and most runs, 16 bytes each.
const MAX_SHARES: usize = 1 << 16;
const MAX_RUNS: usize = 1 << 22;

/// The cut.
pub(crate) struct Shares<'p> {
    partition: &'p Partition,
    /// Runs are pieces of this axis, with all of those behind.
    depth: usize,
    /// In order of their tiles, a fixed number in each.
    cells: Vec<Cell>,
    tiles: usize,
    /// Number of the first share of each cell, then the number of shares.
    first: Vec<usize>,
}

/// The tiles that share their places along the axes up to the depth.
struct Cell {
    /// Of all of them together.
    bounds: Block,
    /// Of a full share. Along an axis either of whole tiles or, if all agree on that, of one block.
    shape: [usize; 4],
    /// Shares along each axis.
    counts: [usize; 4],
    /// Number of the first tile; the others follow.
    tile: usize,
}

impl Shares<'_> {
    /// As few as there are from `least` on, or the most that there are, if their runs in all planes do not take more memory than they
    /// may.
    pub(crate) fn new(partition: &Partition, planes: usize, least: usize) -> Shares<'_> {
        let (mut best, mut most) = (None, 1);
        for depth in 0..4 {
            if most >= least {
                break;
            }
            let (count, runs) = Shares::counts(partition, depth);
            if count > most && count <= MAX_SHARES && runs.saturating_mul(planes) <= MAX_RUNS {
                (best, most) = (Some(depth), count);
            }
        }
        best.map_or_else(|| Shares::whole(partition), |depth| Shares::at_depth(partition, depth))
    }

    /// One share.
    fn whole(partition: &Partition) -> Shares<'_> {
        let bounds = Block { origin: [0; 4], shape: partition.grid };
        let cells = vec![Cell { bounds, shape: partition.grid, counts: [1; 4], tile: 0 }];
        Shares { partition, depth: 0, cells, tiles: partition.tile_shape.len(), first: vec![0, 1] }
    }

    fn at_depth(partition: &Partition, depth: usize) -> Shares<'_> {
        let tiles = partition.tiles[depth + 1..].iter().product();
        let mut first = vec![0];
        let cells = Cell::all(partition, depth).inspect(|cell| {
            first.push(first[first.len() - 1] + cell.counts.iter().product::<usize>());
        });
        let cells = cells.collect();
        Shares { partition, depth, cells, tiles, first }
    }

    /// Number of shares at a depth, and of their runs in one plane.
    fn counts(partition: &Partition, depth: usize) -> (usize, usize) {
        let of_cell = |cell: Cell| {
            let lines: usize = cell.bounds.shape[..depth].iter().product();
            (cell.counts.iter().product::<usize>(), lines * cell.counts[depth])
        };
        Cell::all(partition, depth).map(of_cell).fold((0, 0), |sums, (shares, runs)| (sums.0 + shares, sums.1 + runs))
    }

    pub(crate) fn count(&self) -> usize {
        self.first[self.first.len() - 1]
    }

    fn cell_of(&self, share: usize) -> (&Cell, [usize; 4]) {
        let number = self.first.partition_point(|&first| first <= share) - 1;
        let cell = &self.cells[number];
        (cell, unravel(share - self.first[number], cell.counts))
    }

    fn bounds(&self, share: usize) -> Block {
        let (cell, at) = self.cell_of(share);
        cell.bounds.part(at, cell.shape)
    }

    /// Number of positions of a share.
    pub(crate) fn positions(&self, share: usize) -> usize {
        self.bounds(share).positions()
    }

    /// Numbers and places of the blocks of a share.
    pub(crate) fn blocks(&self, share: usize) -> impl Iterator<Item = (usize, Block)> {
        let (cell, at) = self.cell_of(share);
        (cell.tile..cell.tile + self.tiles).flat_map(move |tile| {
            let (bounds, shape) = (self.partition.tile_box(tile), self.partition.shape_of(tile));
            let counts = div_ceil(bounds.shape, shape);
            // The one of the share, or all.
            let one = |axis: usize| axis <= self.depth && cell.shape[axis] == shape[axis];
            let from: [usize; 4] = std::array::from_fn(|axis| if one(axis) { at[axis] } else { 0 });
            let some = std::array::from_fn(|axis| if one(axis) { 1 } else { counts[axis] });
            let first = self.partition.first[tile] as usize;
            super::positions(some).map(move |within| {
                let at: [usize; 4] = std::array::from_fn(|axis| from[axis] + within[axis]);
                (first + linear(at, counts), bounds.part(at, shape))
            })
        })
    }

    /// The memory of each share in planes of the grid.
    pub(crate) fn memory<'a, T>(&self, planes: &'a mut [T]) -> Vec<Memory<'a, T>> {
        let Shares { partition, depth, .. } = *self;
        let (grid, all) = (partition.grid, planes.len());
        let plane_count = all / grid.iter().product::<usize>();
        let mut memory: Vec<Memory<'a, T>> = (0..self.count())
            .map(|share| {
                let bounds = self.bounds(share);
                let runs = Vec::with_capacity(plane_count * bounds.shape[..depth].iter().product::<usize>());
                Memory { runs, planes: plane_count, grid, depth, bounds }
            })
            .collect();
        let behind: usize = grid[depth + 1..].iter().product();
        let along = if self.cells.len() == 1 { 1 } else { partition.tiles[depth] };
        let mut before = [1; 4];
        before[..depth].copy_from_slice(&grid[..depth]);
        let mut covered = 0;
        for (number, mut line) in planes.chunks_exact_mut(grid[depth] * behind).enumerate() {
            // Where the line is along the axes before, and the first of the cells that it meets.
            let at = unravel(number % before.iter().product::<usize>(), before);
            let cell = (0..depth).fold(0, |cell, axis| cell * partition.tiles[axis] + at[axis] / partition.tile[axis]);
            for number in cell * along..(cell + 1) * along {
                let cell = &self.cells[number];
                let (of_cell, rest) = line.split_at_mut(cell.bounds.shape[depth] * behind);
                let share = (0..depth).fold(0, |share, axis| {
                    share * cell.counts[axis] + (at[axis] - cell.bounds.origin[axis]) / cell.shape[axis]
                });
                let shares = &mut memory[self.first[number] + share * cell.counts[depth]..];
                for (memory, run) in shares.iter_mut().zip(of_cell.chunks_mut(cell.shape[depth] * behind)) {
                    covered += run.len();
                    memory.runs.push(run);
                }
                line = rest;
            }
        }
        // Runs are disjoint, so that as many places as there are means all of them. Who hands in memory without values relies on it.
        assert_eq!(covered, all, "shares cover whole planes of the grid");
        memory
    }
}

impl Cell {
    /// Those of a depth.
    fn all(partition: &Partition, depth: usize) -> impl Iterator<Item = Cell> {
        let tiles: usize = partition.tiles[depth + 1..].iter().product();
        (0..partition.tile_shape.len()).step_by(tiles).map(move |tile| {
            let mut bounds = partition.tile_box(tile);
            bounds.shape[depth + 1..].copy_from_slice(&partition.grid[depth + 1..]);
            let mut shape = partition.shape_of(tile);
            for (axis, length) in shape.iter_mut().enumerate() {
                let agreed = (tile..tile + tiles).all(|other| partition.shape_of(other)[axis] == *length);
                if axis > depth || !agreed {
                    *length = bounds.shape[axis];
                }
            }
            Cell { bounds, shape, counts: div_ceil(bounds.shape, shape), tile }
        })
    }
}

#[cfg(test)]
mod tests {
    use std::mem::MaybeUninit;

    use super::super::tests::any_partition;
    use super::*;
    use proptest::prelude::*;

    /// Tiles that disagree, and channels: neither lists nor shares beyond what they may be.
    #[test]
    fn shares_are_bounded() {
        let [tile, grid] = [[128, 128, 1023, 16], [128, 128, 1024, 16]];
        let partition = Partition::tiled(grid, tile, vec![[1, 1, 1, 16], [2, 2, 1, 16]], vec![0, 1]).unwrap();
        assert_eq!(Shares::new(&partition, 1, 8).count(), 1);
        let partition = Partition::uniform([1, 2048, 1024, 16], [1, 1, 1, 16]).unwrap();
        assert_eq!(Shares::new(&partition, 1, 8).count(), 2048);
        assert_eq!(Shares::new(&partition, 4, 5000).count(), 2048);
        let partition = Partition::uniform([65536, 1, 1, 1], [1; 4]).unwrap();
        assert_eq!(Shares::new(&partition, 256, 8).count(), 1);
        assert_eq!(Shares::new(&partition, 64, 8).count(), 65536);
        assert_eq!(Shares::new(&partition, 1, 1).count(), 1);
        // A deeper cut that gives no more.
        let partition =
            Partition::tiled([1, 90, 90, 180], [1, 18, 18, 180], vec![[1, 18, 18, 180]], vec![0; 25]).unwrap();
        assert_eq!(Shares::new(&partition, 3, 64).depth, 2);
    }

    proptest! {
        /// Every block is in one share, whose memory is the block's places in both planes.
        #[test]
        fn shares_have_the_places_of_their_blocks(partition in any_partition(), depth in prop::option::of(0usize..4)) {
            let n = partition.grid().iter().product::<usize>();
            let expected: Vec<u32> = (1..=2 * n as u32).collect();
            let mut planes = vec![MaybeUninit::new(0u32); 2 * n];
            let shares = depth.map_or_else(|| Shares::whole(&partition), |depth| Shares::at_depth(&partition, depth));
            let mut found = vec![false; partition.block_count()];
            let mut memory = shares.memory(&mut planes);
            prop_assert_eq!(memory.len(), shares.count());
            for (share, memory) in memory.iter_mut().enumerate() {
                let places: usize = memory.runs.iter().map(|run| run.len()).sum();
                prop_assert_eq!(places, 2 * shares.positions(share));
                let mut positions = 0;
                for (number, block) in shares.blocks(share) {
                    prop_assert_eq!(Some(block), partition.block(number));
                    prop_assert!(!std::mem::replace(&mut found[number], true));
                    positions += block.positions();
                    let mut values = vec![0; 2 * block.positions()];
                    for (plane, values) in expected.chunks_exact(n).zip(values.chunks_exact_mut(block.positions())) {
                        block.gather(partition.grid(), plane, values);
                    }
                    memory.of_block(&block).put_all(&values);
                }
                prop_assert_eq!(positions, shares.positions(share));
            }
            prop_assert!(found.iter().all(|found| *found));
            // SAFETY: all are written above, before as well.
            #[allow(unsafe_code)]
            let values: Vec<u32> = planes.iter().map(|place| unsafe { place.assume_init() }).collect();
            prop_assert_eq!(values, expected);
        }

        /// One value for each row, and rows one after the other.
        #[test]
        fn rows_are_in_order(partition in any_partition(), depth in prop::option::of(0usize..4)) {
            let n = partition.grid().iter().product::<usize>();
            let (mut filled, mut by_row) = (vec![0u32; 3 * n], vec![0u32; 3 * n]);
            let shares = depth.map_or_else(|| Shares::whole(&partition), |depth| Shares::at_depth(&partition, depth));
            let memory = shares.memory(&mut filled).into_iter().zip(shares.memory(&mut by_row));
            for (share, (mut filled, mut by_row)) in memory.enumerate() {
                for (number, block) in shares.blocks(share) {
                    let length = block.shape[3];
                    let rows = block.positions() / length;
                    let values: Vec<u32> = (0..3 * rows).map(|row| (1 + number * 1000 + row) as u32).collect();
                    filled.of_block(&block).fill(&values, length);
                    let mut target = by_row.of_block(&block);
                    let mut row = 0;
                    while let Some(planes) = target.next_row() {
                        for (plane, places) in planes.into_iter().enumerate() {
                            places.iter_mut().enumerate().for_each(|(i, place)| *place = values[plane * rows + row + i / length]);
                        }
                        row += target.length() / length;
                    }
                    prop_assert_eq!(row, rows);
                }
            }
            prop_assert!(filled.iter().all(|value| *value > 0));
            prop_assert_eq!(filled, by_row);
        }

        /// As few as there are from those asked for on, or the most.
        #[test]
        fn shares_are_as_few_as_they_may_be(partition in any_partition(), least in 0usize..50) {
            let counts: Vec<usize> = (0..4).map(|depth| Shares::at_depth(&partition, depth).count()).collect();
            for (depth, count) in counts.iter().enumerate() {
                let shares = Shares::at_depth(&partition, depth);
                let runs = shares.memory(&mut vec![0u8; partition.grid().iter().product()]).iter().map(|memory| memory.runs.len()).sum();
                prop_assert_eq!(Shares::counts(&partition, depth), (*count, runs));
            }
            let count = Shares::new(&partition, 1, least).count();
            let enough = counts.iter().find(|count| **count >= least);
            let expected = if least < 2 { 1 } else { *enough.unwrap_or(counts.iter().max().unwrap()) };
            prop_assert_eq!(count, expected);
        }
    }
}
