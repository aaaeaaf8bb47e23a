//! One record of arbitrary bytes within a valid file: what random bytes as a whole file would seldom reach.
//! The first byte chooses the file, the second the block; checksums are off under `cfg(fuzzing)`.
#![no_main]

use csbrdf::decode::{Reader, Scratch};
use libfuzzer_sys::fuzz_target;

const FILES: [&[u8]; 9] = [
    include_bytes!("../../tests/data/v1/dct-opponent-mask.csbrdf"),
    include_bytes!("../../tests/data/v1/dft-sampled-horizon.csbrdf"),
    include_bytes!("../../tests/data/v1/dct-tiled.csbrdf"),
    include_bytes!("../../tests/data/v1/dct-mask-per-channel-extremes.csbrdf"),
    include_bytes!("../../tests/data/v1/dct-4d-spectral.csbrdf"),
    include_bytes!("../../tests/data/v1/dft-1d.csbrdf"),
    include_bytes!("../../tests/data/v1/dft-4d-coarse-extremes.csbrdf"),
    include_bytes!("../../tests/data/v1/dct-1d-single-positions.csbrdf"),
    include_bytes!("../../tests/data/v1/dct-fine-step.csbrdf"),
];

fuzz_target!(|data: &[u8]| {
    let [file, block, bytes @ ..] = data else { return };
    let file = FILES[usize::from(*file) % FILES.len()];
    let Ok(original) = Reader::open(file) else { panic!("golden files open") };
    let block = usize::from(*block) % original.block_count();
    let record = original.block_info(block).expect("golden files are intact").record;
    let mut changed = file.to_vec();
    for (to, from) in changed[record].iter_mut().zip(bytes) {
        *to = *from;
    }
    let reader = Reader::open(&changed[..]).expect("the header is as it was");
    let mut values = vec![f32::NAN; reader.block_values(block).expect("an existing block")];
    let fresh = reader.block_into(block, &mut values);
    // A scratch that another block has used, and a buffer with other contents, change nothing.
    let mut scratch = Scratch::default();
    let other = (block + 1) % reader.block_count();
    let mut sink = vec![0.0; reader.block_values(other).expect("an existing block")];
    let _ = reader.block_with(other, &mut scratch, &mut sink);
    let mut again = vec![7.0; values.len()];
    let stale = reader.block_with(block, &mut scratch, &mut again);
    assert_eq!(fresh.is_ok(), stale.is_ok());
    if fresh.is_ok() {
        assert!(values.iter().all(|v| v.is_finite() && *v >= 0.0));
        assert!(values == again);
    }
    let _ = (reader.block_validity(block), reader.block_origin(block), reader.block_info(block));
});
