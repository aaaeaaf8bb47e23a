//! The whole table of a file as an output, with what was not measured marked.

use csbrdf::decode::Reader;
use csbrdf::io::merl::write_merl;
use csbrdf::io::npy::write_npy_f32;
use csbrdf::table::block::Block;

use crate::args::{DecodeArgs, FormatArg};
use crate::failure::{Failure, Outcome};
use crate::guard::Guard;
use crate::output::Target;

/// Value of an entry that was not measured, as in MERL's tables.
pub const MISSING: f32 = -1.0;

/// The whole table.
pub fn write_whole<D: AsRef<[u8]> + Sync>(
    reader: &Reader<D>,
    args: &DecodeArgs,
    format: FormatArg,
    target: &Target,
    guard: &Guard,
) -> Outcome {
    let failed = |e: csbrdf::Error| Failure::in_file(&args.input, &e);
    if format == FormatArg::Binary {
        let table = reader.decode_table().map_err(failed)?;
        // Refused before a file is begun if the grid is not MERL's.
        return target.write(guard, |out| write_merl(&table, args.fill, out));
    }
    let mut values = reader.decode_all().map_err(failed)?;
    if !args.fill {
        mark_missing(reader, &mut values).map_err(failed)?;
    }
    target.write(guard, |out| write_npy_f32(&values, &array_shape(reader, reader.grid().shape()), out))
}

/// Where a block lies in the table.
pub fn place<D: AsRef<[u8]>>(reader: &Reader<D>, number: usize) -> csbrdf::Result<Block> {
    let missing = || csbrdf::Error::InvalidArgument(format!("block {number} does not exist"));
    reader.partition().block(number).ok_or_else(missing)
}

/// Overwrites the values that are not valid.
pub fn mark(values: &mut [f32], valid: &[bool]) {
    for (value, _) in values.iter_mut().zip(valid).filter(|(_, valid)| !**valid) {
        *value = MISSING;
    }
}

/// Overwrites what the recovery filled in.
fn mark_missing<D: AsRef<[u8]>>(reader: &Reader<D>, values: &mut [f32]) -> csbrdf::Result<()> {
    let (shape, n) = (reader.grid().shape(), reader.grid().positions());
    let mut block = Vec::new();
    for number in 0..reader.block_count() {
        let valid = reader.block_validity(number)?;
        if valid.iter().all(|v| *v) {
            continue;
        }
        let place = place(reader, number)?;
        block.resize(place.positions(), 0.0);
        for (plane, valid) in values.chunks_exact_mut(n).zip(valid.chunks_exact(place.positions())) {
            place.gather(shape, plane, &mut block);
            mark(&mut block, valid);
            place.scatter(shape, &block, plane);
        }
    }
    Ok(())
}

/// Channels, then the axes of the table without the padding.
pub fn array_shape<D: AsRef<[u8]>>(reader: &Reader<D>, padded: [usize; 4]) -> Vec<usize> {
    let axes = reader.grid().axes().len();
    [&[reader.grid().channels().len()], &padded[padded.len() - axes..]].concat()
}
