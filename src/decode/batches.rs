//! Tables whose blocks have rows so short and so many that a list of them would take more memory than the values.

use super::table::map_blocks;
use super::{Reader, Scratch};
use crate::block::Block;
use crate::error::Result;

/// Most rows that are listed, 16 bytes each.
const MAX_ROWS: usize = 1 << 22;
/// Values that a batch of blocks has at least, and blocks that it has at most.
const BATCH_VALUES: usize = 1 << 22;
const BATCH_BLOCKS: usize = 1 << 16;

impl<D: AsRef<[u8]>> Reader<D> {
    /// Whether the rows of all blocks are too many to list.
    pub(super) fn has_short_rows(&self) -> bool {
        let (mut rows, channels) = (0, self.grid().channels().len());
        (0..self.block_count()).any(|block| {
            let row_count = |block: Block| block.shape[..3].iter().product::<usize>();
            rows += self.partition().block(block).map_or(0, row_count) * channels;
            rows > MAX_ROWS
        })
    }
}

impl<D: AsRef<[u8]> + Sync> Reader<D> {
    /// `decode` on every block, some at a time on all threads, and `put` with what it gives, one after the other.
    pub(super) fn in_batches<T: Send>(
        &self,
        decode: impl Fn(&mut Scratch, usize) -> Result<T> + Sync + Send,
        mut put: impl FnMut(Block, T),
    ) -> Result<()> {
        let mut first = 0;
        while first < self.block_count() {
            let (mut end, mut values) = (first, 0);
            while end < self.block_count() && values < BATCH_VALUES && end - first < BATCH_BLOCKS {
                values += self.block_values(end)?;
                end += 1;
            }
            for (block, decoded) in (first..end).zip(map_blocks(first..end, &decode)?) {
                put(self.place(block)?, decoded);
            }
            first = end;
        }
        Ok(())
    }

    /// Puts the values of a block into the planes of the table.
    pub(super) fn scatter<T: Copy>(&self, block: Block, values: &[T], planes: &mut [T]) {
        let planes = planes.chunks_exact_mut(self.grid().positions());
        for (plane, values) in planes.zip(values.chunks_exact(block.positions())) {
            block.scatter(self.grid().shape(), values, plane);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::Pruned;

    #[test]
    fn batches_give_the_table() {
        let (usual, small) = ("dct-tiled", "dct-1d-single-positions");
        let name = if cfg!(miri) { small } else { usual };
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/v1");
        let file = std::fs::read(format!("{folder}/{name}.csbrdf")).unwrap();
        let reader = Reader::open(&file[..]).unwrap().with_pruned(Pruned::Coarse);
        assert!(!reader.has_short_rows());
        let expected = reader.decode_all().unwrap();
        let mut table = vec![0.0; expected.len()];
        let decode = |scratch: &mut Scratch, block| {
            let mut values = vec![0.0; reader.block_values(block)?];
            reader.block_with(block, scratch, &mut values).map(|()| values)
        };
        reader.in_batches(decode, |block, values| reader.scatter(block, &values, &mut table)).unwrap();
        assert!(table == expected);
    }
}
