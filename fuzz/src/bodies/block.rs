//! One record of arbitrary bytes within a golden file: what random bytes as a whole file would seldom reach. The first byte
//! chooses the file, the second the block.

use csbrdf::decode::{PrunedPolicy, Reader, Scratch};

use super::golden::chosen;
use super::seal::sealed;
use super::{is_value, same_bits};

pub fn run(data: &[u8]) {
    let [file, block, bytes @ ..] = data else { return };
    let file = chosen(*file);
    let original = Reader::open(file).expect("golden files open");
    let block = usize::from(*block) % original.block_count();
    let record = original.record_range(block).expect("an existing block");
    let mut changed = file.to_vec();
    for (to, from) in changed[record].iter_mut().zip(bytes) {
        *to = *from;
    }
    let changed = sealed(&changed);
    let reader = Reader::open(&changed[..]).expect("the header is as it was").with_pruned(PrunedPolicy::Coarse);
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
    let (valid, origins, info) = (reader.block_validity(block), reader.block_origin(block), reader.block_info(block));
    if fresh.is_ok() {
        assert!(values.iter().all(is_value) && same_bits(&values, &again));
        let (valid, info) = (valid.expect("it decodes"), info.expect("it decodes"));
        assert_eq!((valid.len(), origins.expect("it decodes").len()), (values.len(), values.len()));
        assert_eq!(valid.iter().filter(|v| **v).count(), info.valid.iter().sum::<usize>());
        let spectrum = reader.coefficients(block).expect("it decodes");
        assert_eq!(
            (spectrum.valid.len(), spectrum.components.len() * spectrum.block.positions()),
            (values.len(), values.len())
        );
        if let Ok(exact) = reader.source_block(block) {
            assert_eq!(exact.len(), values.len());
        }
    }
}
