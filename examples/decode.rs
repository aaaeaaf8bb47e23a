//! Decodes a file, as a whole and one block alone: `cargo run --release --example decode -- FILE.csbrdf`.

use csbrdf::{Reader, Result};

fn main() -> Result<()> {
    let path = std::env::args().nth(1).unwrap_or("tests/data/v1/final-corrected.csbrdf".into());
    let reader = Reader::open_path(&path)?;
    for axis in reader.grid().axes() {
        println!("{}: {} bins", axis.name.as_str(), axis.len);
    }

    // 1/sr, [channel], then the axes in order, the last one fastest.
    let values: Vec<f32> = reader.decode_all()?;
    println!("{} values, the largest is {}", values.len(), values.iter().copied().fold(0.0, f32::max));

    // One block reads its own record and nothing else of the file's data.
    let mut block = vec![0.0; reader.block_values(0)?];
    reader.block_into(0, &mut block)?;
    println!("block 0 of {}: {} values in {} bytes", reader.block_count(), block.len(), reader.record_range(0)?.len());
    Ok(())
}
