//! What blocks take out of the table: the log values, validity and values of their entries.

use crate::codec::tone::tone_map;
use crate::table::Table;
use crate::table::block::Block;

/// Log value of a valid entry. Source values up to f64::MAX times a scale above 1 may overflow: the log stays finite all the same.
pub(super) fn entry_log(value: f64, scale: f64, eps: f64) -> f64 {
    tone_map((value * scale).min(f64::MAX), eps)
}

/// Log values and validity of a block, `[channel][position]`; zero where not valid.
pub(super) fn gather_log(table: &Table, block: &Block, eps: f64) -> (Vec<f64>, Vec<bool>) {
    let (n, valid) = (block.positions(), gather_valid(table, block));
    let mut log = gather_values(table, block);
    for (c, channel) in table.grid().channels().iter().enumerate() {
        for (value, &valid) in log[c * n..(c + 1) * n].iter_mut().zip(&valid[c * n..]) {
            *value = if valid { entry_log(*value, channel.scale, eps) } else { 0.0 };
        }
    }
    (log, valid)
}

/// Values of a block in the units of the source, `[channel][position]`.
pub(super) fn gather_values(table: &Table, block: &Block) -> Vec<f64> {
    let n = block.positions();
    let mut values = vec![0.0; n * table.grid().channels().len()];
    for (channel, values) in values.chunks_exact_mut(n).enumerate() {
        block.gather(table.grid().shape(), table.plane(channel), values);
    }
    values
}

/// Validity of a block, `[channel][position]`.
pub(super) fn gather_valid(table: &Table, block: &Block) -> Vec<bool> {
    let n = block.positions();
    let mut valid = vec![false; n * table.grid().channels().len()];
    for (channel, valid) in valid.chunks_exact_mut(n).enumerate() {
        block.gather(table.grid().shape(), table.valid_plane(channel), valid);
    }
    valid
}
