//! Decodes into buffers that are not empty, with a scratch that other blocks and another file have used: the same bits as with
//! fresh ones. The head gives fillings and blocks in order; the file follows.

use csbrdf::decode::{PrunedPolicy, Reader, Scratch};

use super::golden::chosen;
use super::seal::sealed;
use super::{LIMITS, is_value, same_bits};

/// Bytes before the file.
pub const HEAD: usize = 12;

pub fn run(data: &[u8]) {
    let Some((head, file)) = data.split_at_checked(HEAD) else { return };
    let file = sealed(file);
    let Ok(reader) = Reader::open_with_limits(&file[..], LIMITS) else { return };
    let reader = reader.with_pruned(PrunedPolicy::Coarse);
    let [fill, other, order @ ..] = head else { return };
    let fill = f32::from_bits(u32::from_le_bytes([*fill, !*fill, *fill, *fill]));
    let mut scratch = Scratch::default();
    let other = Reader::open(chosen(*other)).expect("golden files open").with_pruned(PrunedPolicy::Coarse);
    for (step, &number) in order.iter().enumerate() {
        if step % 4 == 3 {
            let block = usize::from(number) % other.block_count();
            let mut values = vec![fill; other.block_values(block).expect("a block")];
            other.block_with(block, &mut scratch, &mut values).expect("golden files decode");
            continue;
        }
        let block = usize::from(number) % reader.block_count();
        let mut fresh = vec![0.0; reader.block_values(block).expect("a block")];
        let mut stale = vec![fill; fresh.len()];
        let results = (reader.block_into(block, &mut fresh), reader.block_with(block, &mut scratch, &mut stale));
        assert_eq!(results.0.is_ok(), results.1.is_ok());
        if results.0.is_ok() {
            assert!(same_bits(&fresh, &stale) && stale.iter().all(is_value));
        }
    }
    let Ok(table) = reader.decode_all() else { return };
    let mut stale = vec![fill; table.len()];
    reader.decode_all_into(&mut stale).expect("it decoded before");
    assert!(same_bits(&table, &stale));
}
