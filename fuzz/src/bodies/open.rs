//! Opening arbitrary bytes: header sections, index, metadata, and what can be asked without touching a block.

use csbrdf::brdf::eval::Brdf;
use csbrdf::decode::Reader;

use super::seal::sealed;

pub fn run(data: &[u8]) {
    let data = sealed(data);
    let reader = match Reader::open(&data[..]) {
        Ok(reader) => reader,
        Err(e) => return assert!(!e.to_string().is_empty()),
    };
    let _ = reader.metadata();
    let shape = reader.grid().shape();
    let (partition, blocks) = (reader.partition(), reader.block_count());
    let last = shape.map(|n| n - 1);
    let (block, index) = partition.locate(last).expect("inside the grid");
    let place = partition.block(block).expect("an existing block");
    assert!(index < place.positions() && place.positions() <= partition.largest_block());
    assert_eq!(partition.locate(shape), None);
    // Records follow each other and fill their section.
    let records = reader.directory().sections().iter().find(|s| s.name() == "RECS").expect("it was opened");
    let (first, last) = (reader.record_range(0).expect("a block"), reader.record_range(blocks - 1).expect("a block"));
    assert_eq!((first.start, last.end), (records.range.start, records.range.end));
    assert!(reader.record_range(blocks).is_err() && reader.block_values(blocks).is_err());
    let _ = Brdf::open(reader);
}
