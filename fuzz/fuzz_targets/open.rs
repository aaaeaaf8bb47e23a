//! Opening arbitrary bytes: header sections, index, metadata, and what can be asked without touching a block.
#![no_main]

use csbrdf::decode::Reader;
use csbrdf::eval::Brdf;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let Ok(reader) = Reader::open(data) else { return };
    let _ = reader.metadata();
    let shape = reader.grid().shape();
    let last = shape.map(|n| n - 1);
    let (block, index) = reader.partition().locate(last).expect("inside the grid");
    let place = reader.partition().block(block).expect("an existing block");
    assert!(index < place.positions());
    assert_eq!(reader.partition().locate(shape), None);
    let _ = Brdf::open(reader);
});
