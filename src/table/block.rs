//! Partition of the grid into blocks (spec section 4.2).
//!
//! The grid is cut into tiles, each tile into blocks of one of the file's block shapes; tiles at the grid's far
//! edges and blocks at their tile's far edges may be short. One tile that covers the grid gives one block shape
//! everywhere. Blocks are numbered tile after tile, last axis fastest.

mod memory;
mod shares;

pub(crate) use self::memory::{Place, Target};
pub(crate) use self::shares::Shares;
use crate::base::error::{Error, Result};
use crate::base::limits::{MAX_AXIS_LEN, MAX_BLOCK_AXIS, MAX_BLOCK_POSITIONS, MAX_BLOCKS, MAX_POSITIONS, MAX_TABLE_ENTRIES};

/// A box of grid positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// First position, padded in front to four axes.
    pub origin: [usize; 4],
    /// Lengths, padded in front with ones.
    pub shape: [usize; 4],
}

impl Block {
    /// Number of positions.
    pub fn positions(&self) -> usize {
        self.shape.iter().product()
    }

    /// The part at a place among those of a shape that this block is cut into; at the far edges they may be short.
    fn part(&self, at: [usize; 4], shape: [usize; 4]) -> Block {
        Block {
            origin: std::array::from_fn(|i| self.origin[i] + at[i] * shape[i]),
            shape: std::array::from_fn(|i| shape[i].min(self.shape[i] - at[i] * shape[i])),
        }
    }

    /// Calls `row(start in the plane, start in the block, length)` for each run along the last axis.
    fn rows(&self, grid: [usize; 4], mut row: impl FnMut(usize, usize, usize)) {
        let [o0, o1, o2, o3] = self.origin;
        let [n0, n1, n2, n3] = self.shape;
        let mut at = 0;
        for i in o0..o0 + n0 {
            for j in o1..o1 + n1 {
                for k in o2..o2 + n2 {
                    row(((i * grid[1] + j) * grid[2] + k) * grid[3] + o3, at, n3);
                    at += n3;
                }
            }
        }
    }

    /// Copies this block out of a plane of shape `grid`.
    pub fn gather<T: Copy>(&self, grid: [usize; 4], plane: &[T], block: &mut [T]) {
        self.rows(grid, |from, to, n| block[to..to + n].copy_from_slice(&plane[from..from + n]));
    }

    /// Copies this block into a plane of shape `grid`, the inverse of [`Block::gather`].
    pub fn scatter<T: Copy>(&self, grid: [usize; 4], block: &[T], plane: &mut [T]) {
        self.rows(grid, |to, from, n| plane[to..to + n].copy_from_slice(&block[from..from + n]));
    }
}

/// The cut of a grid into tiles and blocks; knows the block of every position in constant time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Partition {
    grid: [usize; 4],
    tile: [usize; 4],
    by_tile: [Divisor; 4],
    /// Tiles along each axis.
    tiles: [usize; 4],
    shapes: Vec<[usize; 4]>,
    by_shape: Vec<[Divisor; 4]>,
    /// Shape number of each tile.
    tile_shape: Vec<u8>,
    /// Number of the first block of each tile, then the number of blocks.
    first: Vec<u32>,
}

fn div_ceil(a: [usize; 4], b: [usize; 4]) -> [usize; 4] {
    std::array::from_fn(|i| a[i].div_ceil(b[i]))
}

/// Divides positions on an axis, below 2^16, by a length of at most 2^16: look-ups would wait for a dozen divisions each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Divisor(u64);

impl Divisor {
    fn new(length: usize) -> Divisor {
        Divisor((1u64 << 32).div_ceil(length as u64))
    }

    /// The quotient, rounded down. What the reciprocal is too large by comes to less than 2^-16 in the quotient, and that is a
    /// length's share away from the next integer.
    #[inline(always)]
    fn divide(self, position: usize) -> usize {
        ((position as u64 * self.0) >> 32) as usize
    }
}

/// Index of a four-axis coordinate, last axis fastest.
fn linear(at: [usize; 4], shape: [usize; 4]) -> usize {
    ((at[0] * shape[1] + at[1]) * shape[2] + at[2]) * shape[3] + at[3]
}

/// Coordinate of an index, the inverse of [`linear`].
pub(crate) fn unravel(mut index: usize, shape: [usize; 4]) -> [usize; 4] {
    let mut at = [0; 4];
    for axis in (0..4).rev() {
        at[axis] = index % shape[axis];
        index /= shape[axis];
    }
    at
}

impl Partition {
    /// One block shape everywhere; `block` is clipped to the grid.
    ///
    /// # Errors
    /// As [`Partition::tiled`].
    pub fn uniform(grid: [usize; 4], block: [usize; 4]) -> Result<Partition> {
        let clipped = std::array::from_fn(|i| block[i].min(grid[i]));
        Partition::tiled(grid, grid, vec![clipped], vec![0])
    }

    /// Tiles of shape `tile`; tile `t` (last axis fastest) is cut into blocks of `shapes[tile_shape[t]]`.
    ///
    /// # Errors
    /// `InvalidArgument` if a length is zero or larger than what it divides, if a shape number is out of range, or
    /// if the blocks are more or larger than the format allows.
    pub fn tiled(
        grid: [usize; 4],
        tile: [usize; 4],
        shapes: Vec<[usize; 4]>,
        tile_shape: Vec<u8>,
    ) -> Result<Partition> {
        let bad = |what: String| Err(Error::InvalidArgument(what));
        let within = |inner: [usize; 4], outer: [usize; 4]| (0..4).all(|i| (1..=outer[i]).contains(&inner[i]));
        let positions = grid.iter().try_fold(1usize, |n, &len| n.checked_mul(len));
        let bounded = positions.is_some_and(|n| n as u64 <= MAX_POSITIONS);
        if !bounded || grid.iter().any(|&n| n == 0 || n > MAX_AXIS_LEN) {
            return bad(format!("the grid {grid:?} is empty or beyond the format's limits"));
        }
        if !within(tile, grid) {
            return bad(format!("tile {tile:?} does not fit the grid {grid:?}"));
        }
        if shapes.is_empty() || shapes.len() > 256 {
            return bad(format!("{} block shapes, allowed are 1 to 256", shapes.len()));
        }
        for shape in &shapes {
            if !within(*shape, tile) {
                return bad(format!("block shape {shape:?} does not fit the tile {tile:?}"));
            }
            if shape.iter().any(|&n| n > MAX_BLOCK_AXIS) {
                return bad(format!("block shape {shape:?} has an axis longer than {MAX_BLOCK_AXIS}"));
            }
            let positions = shape.iter().product::<usize>();
            if positions > MAX_BLOCK_POSITIONS {
                return bad(format!("a block of {positions} positions, at most {MAX_BLOCK_POSITIONS} are allowed"));
            }
        }
        let tiles = div_ceil(grid, tile);
        if tile_shape.len() != tiles.iter().product::<usize>() {
            return bad(format!("{} tile shapes for {tiles:?} tiles", tile_shape.len()));
        }
        let (by_tile, by_shape) = (tile.map(Divisor::new), shapes.iter().map(|s| s.map(Divisor::new)).collect());
        let mut partition = Partition { grid, tile, by_tile, tiles, shapes, by_shape, tile_shape, first: vec![0] };
        let mut blocks = 0;
        for t in 0..partition.tile_shape.len() {
            if usize::from(partition.tile_shape[t]) >= partition.shapes.len() {
                return bad(format!("tile {t} has shape {} of {}", partition.tile_shape[t], partition.shapes.len()));
            }
            blocks += div_ceil(partition.tile_box(t).shape, partition.shape_of(t)).iter().product::<usize>();
            if blocks > MAX_BLOCKS {
                return bad(format!("more than {MAX_BLOCKS} blocks"));
            }
            partition.first.push(blocks as u32);
        }
        let entries: usize = partition.axis_lengths().iter().map(|n| n * n).sum();
        if entries > MAX_TABLE_ENTRIES {
            return bad(format!("the squares of the block lengths add up to {entries}, above {MAX_TABLE_ENTRIES}"));
        }
        Ok(partition)
    }

    fn shape_of(&self, tile: usize) -> [usize; 4] {
        self.shapes[usize::from(self.tile_shape[tile])]
    }

    fn tile_box(&self, tile: usize) -> Block {
        Block { origin: [0; 4], shape: self.grid }.part(unravel(tile, self.tiles), self.tile)
    }

    /// Shape of the grid.
    pub fn grid(&self) -> [usize; 4] {
        self.grid
    }

    /// Shape of a full tile.
    pub fn tile(&self) -> [usize; 4] {
        self.tile
    }

    /// The block shapes in use.
    pub fn shapes(&self) -> &[[usize; 4]] {
        &self.shapes
    }

    /// Shape number of each tile.
    pub fn tile_shapes(&self) -> &[u8] {
        &self.tile_shape
    }

    /// Number of blocks.
    pub fn block_count(&self) -> usize {
        self.first[self.first.len() - 1] as usize
    }

    /// Most positions of a block.
    pub fn largest_block(&self) -> usize {
        self.shapes.iter().map(|shape| shape.iter().product()).max().unwrap_or(1)
    }

    /// Number of positions of each block, in order of their numbers; what dividing by each number would cost is saved.
    pub(crate) fn sizes(&self) -> impl Iterator<Item = usize> {
        // Within a tile all blocks but the last along an axis have one length; runs of the fastest axis at a time, since
        // iterators nested for each axis would take a tenth of opening a file.
        let rows = (0..self.tile_shape.len()).flat_map(|tile| {
            let (bounds, shape) = (self.tile_box(tile).shape, self.shape_of(tile));
            let counts = div_ceil(bounds, shape);
            let length = move |axis: usize, at: usize| shape[axis].min(bounds[axis] - at * shape[axis]);
            (0..counts[0] * counts[1] * counts[2]).map(move |row| {
                let [i, j, k] = [row / counts[2] / counts[1], row / counts[2] % counts[1], row % counts[2]];
                let area = length(0, i) * length(1, j) * length(2, k);
                (counts[3] - 1, area * shape[3].min(bounds[3]), area * length(3, counts[3] - 1))
            })
        });
        rows.flat_map(|(whole, positions, last)| std::iter::repeat_n(positions, whole).chain(std::iter::once(last)))
    }

    /// Number of blocks along each axis, if one tile covers the grid.
    pub fn blocks_per_axis(&self) -> Option<[usize; 4]> {
        (self.tile_shape.len() == 1).then(|| div_ceil(self.grid, self.shape_of(0)))
    }

    /// Every length that a block has along some axis, edges included.
    pub(crate) fn axis_lengths(&self) -> Vec<usize> {
        let mut lengths = Vec::new();
        for axis in 0..4 {
            let short_tile = self.grid[axis] % self.tile[axis];
            for tile in [self.tile[axis], short_tile] {
                for shape in &self.shapes {
                    lengths.extend([shape[axis].min(tile), tile % shape[axis]]);
                }
            }
        }
        lengths.retain(|&n| n > 0);
        lengths.sort_unstable();
        lengths.dedup();
        lengths
    }

    /// Place and shape of a block; `None` past the last one.
    pub fn block(&self, block: usize) -> Option<Block> {
        if block >= self.block_count() {
            return None;
        }
        let tile = self.first.partition_point(|&first| first as usize <= block) - 1;
        let bounds = self.tile_box(tile);
        let shape = self.shape_of(tile);
        let at = unravel(block - self.first[tile] as usize, div_ceil(bounds.shape, shape));
        Some(bounds.part(at, shape))
    }

    /// Block of a grid position and the position's index within it; `None` outside the grid.
    pub fn locate(&self, position: [usize; 4]) -> Option<(usize, usize)> {
        self.find(position).map(|found| (found.block, linear(found.within, found.shape)))
    }

    /// Block of a grid position, the block's shape, and the place in it; `None` outside the grid.
    #[inline]
    pub(crate) fn find(&self, position: [usize; 4]) -> Option<Found> {
        if (0..4).any(|i| position[i] >= self.grid[i]) {
            return None;
        }
        let at: [usize; 4] = std::array::from_fn(|i| self.by_tile[i].divide(position[i]));
        let tile = linear(at, self.tiles);
        let number = usize::from(self.tile_shape[tile]);
        let (full, by_shape) = (&self.shapes[number], &self.by_shape[number]);
        let (mut block, mut within, mut shape) = (0, [0; 4], [1; 4]);
        for i in 0..4 {
            let origin = at[i] * self.tile[i];
            let length = self.tile[i].min(self.grid[i] - origin);
            let inner = position[i] - origin;
            let across = by_shape[i].divide(inner);
            within[i] = inner - across * full[i];
            shape[i] = full[i].min(length - across * full[i]);
            block = block * (by_shape[i].divide(length - 1) + 1) + across;
        }
        Some(Found { block: self.first[tile] as usize + block, shape, within })
    }
}

/// Where a position is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Found {
    pub(crate) block: usize,
    /// Shape of the block.
    pub(crate) shape: [usize; 4],
    /// Place in the block.
    pub(crate) within: [usize; 4],
}

/// All positions of a shape, last axis fastest.
pub(crate) fn positions(shape: [usize; 4]) -> impl Iterator<Item = [usize; 4]> {
    let total: usize = shape.iter().product();
    let mut at = [0; 4];
    (0..total).map(move |_| {
        let here = at;
        for axis in (0..4).rev() {
            at[axis] += 1;
            if at[axis] < shape[axis] {
                break;
            }
            at[axis] = 0;
        }
        here
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(super) fn any_partition() -> impl Strategy<Value = Partition> {
        let axes = || prop::array::uniform4(1usize..if cfg!(miri) { 5 } else { 9 });
        (axes(), axes(), prop::collection::vec(axes(), 1..4), any::<u64>()).prop_map(|(grid, tile, shapes, seed)| {
            let tile: [usize; 4] = std::array::from_fn(|i| tile[i].min(grid[i]));
            let shapes: Vec<_> = shapes.iter().map(|s| std::array::from_fn(|i| s[i].min(tile[i]))).collect();
            let tiles = div_ceil(grid, tile).iter().product::<usize>();
            let choice = (0..tiles).map(|t| ((seed >> (t % 60)) as usize % shapes.len()) as u8).collect();
            Partition::tiled(grid, tile, shapes, choice).unwrap()
        })
    }

    #[test]
    fn divisors_divide() {
        for length in [1usize, 2, 3, 5, 7, 18, 90, 180, 255, 256, 257, 1024, 32767, 40000, 65535, 65536] {
            let divisor = Divisor::new(length);
            let mut positions = (0..65536).step_by(if cfg!(miri) { 1021 } else { 1 });
            assert!(positions.all(|position| divisor.divide(position) == position / length), "{length}");
        }
    }

    proptest! {
        #[test]
        fn blocks_cover_every_position_once(partition in any_partition()) {
            let grid = partition.grid();
            let n = grid.iter().product::<usize>();
            let mut owner = vec![None; n];
            for b in 0..partition.block_count() {
                let block = partition.block(b).unwrap();
                for i in 0..block.positions() {
                    let at = unravel(i, block.shape);
                    let position: [usize; 4] = std::array::from_fn(|a| block.origin[a] + at[a]);
                    prop_assert_eq!(partition.locate(position), Some((b, i)));
                    prop_assert_eq!(owner[linear(position, grid)].replace(b), None);
                }
            }
            let lengths = partition.axis_lengths();
            for b in 0..partition.block_count() {
                prop_assert!(partition.block(b).unwrap().shape.iter().all(|n| lengths.contains(n)));
            }
            prop_assert!(owner.iter().all(Option::is_some));
            prop_assert_eq!(partition.block(partition.block_count()), None);
        }

        #[test]
        fn scatter_undoes_gather(partition in any_partition()) {
            let n = partition.grid().iter().product::<usize>();
            let plane: Vec<u32> = (0..n as u32).collect();
            let mut back = vec![0; n];
            for b in 0..partition.block_count() {
                let block = partition.block(b).unwrap();
                let mut values = vec![0; block.positions()];
                block.gather(partition.grid(), &plane, &mut values);
                block.scatter(partition.grid(), &values, &mut back);
            }
            prop_assert_eq!(plane, back);
        }
    }

    #[test]
    fn merl_in_paper_blocks() {
        let partition = Partition::uniform([1, 90, 90, 180], [1, 15, 15, 15]).unwrap();
        assert_eq!(partition.block_count(), 432);
        assert_eq!(partition.blocks_per_axis(), Some([1, 6, 6, 12]));
        assert_eq!(partition.locate([0, 16, 89, 31]), Some((6 * 12 + 5 * 12 + 2, (15 + 14) * 15 + 1)));
    }

    #[test]
    fn impossible_partitions_are_refused() {
        let grid = [1, 90, 90, 180];
        assert!(Partition::uniform(grid, [1, 0, 15, 15]).is_err());
        assert!(Partition::tiled(grid, [1, 91, 90, 180], vec![[1; 4]], vec![0]).is_err());
        assert!(Partition::tiled(grid, grid, vec![], vec![0]).is_err());
        assert!(Partition::tiled([1 << 32, 1 << 32, 1, 1], [1; 4], vec![[1; 4]], vec![]).is_err());
        let all_lengths: Vec<_> = (769..1025).map(|n| [1, 1, 1, n]).collect();
        assert!(Partition::tiled([1, 1, 1, 1024], [1, 1, 1, 1024], all_lengths, vec![0]).is_err());
        assert!(Partition::tiled(grid, grid, vec![[1, 15, 15, 15]], vec![1]).is_err());
        assert!(Partition::tiled(grid, grid, vec![[1, 15, 15, 15]], vec![0, 0]).is_err());
        assert!(Partition::uniform([1, 4096, 4096, 4], [1; 4]).is_err());
        assert!(Partition::uniform([1, 4096, 4096, 4], [1, 2048, 1, 1]).is_err());
    }
}
