//! What this decoder makes of a file, as a line for `tools/differential.py`, which has the decoder that was written from the specification
//! alone say the same of it.

use csbrdf::Limits;
use csbrdf::base::error::Error;
use csbrdf::codec::sample::SplitMix64;
use csbrdf::decode::{PrunedPolicy, Reader};

use super::recipe;

/// More than any golden file has.
const LIMITS: Limits =
    Limits { table_values: 1 << 18, block_values: 1 << 18, operations: 1_000_000_000, bytes: 1 << 28 };

/// Changed files with their recipes, each the same for the same number.
pub fn file(number: u64) -> Vec<u8> {
    let mut random = SplitMix64(number);
    let mut byte = || (random.next_u64() >> 32) as u8;
    let changes = 1 + usize::from(byte()) % 3;
    let recipe: Vec<u8> = (0..1 + 6 * changes).map(|_| byte()).collect();
    recipe::make(&recipe).expect("a recipe has a byte")
}

/// `limit` if the file is larger than these files are to be; `refused` if no block decodes; otherwise the CRC-32 of the whole table in
/// binary64 and its validity, and of each block those of its values, validity and source values, and its counts of samples. What is
/// refused of these is `-`.
pub fn verdict(file: &[u8]) -> String {
    let reader = match Reader::open_with_limits(file, LIMITS) {
        Ok(reader) => reader.with_pruned(PrunedPolicy::Coarse),
        Err(Error::LimitExceeded { .. }) => return "limit".into(),
        Err(_) => return "refused".into(),
    };
    if reader.grid().positions().saturating_mul(reader.grid().channels().len()) > LIMITS.table_values {
        return "limit".into();
    }
    let blocks: Vec<String> = (0..reader.block_count()).map(|block| of_block(&reader, block)).collect();
    if blocks.iter().all(|block| block == "-") {
        return "refused".into();
    }
    let table = reader.decode_table().map(|table| {
        let valid: Vec<u8> = table.valid().iter().map(|&valid| u8::from(valid)).collect();
        format!("{:08x}/{:08x}", crc(table.values().iter().map(|v| v.to_le_bytes())), crc32fast::hash(&valid))
    });
    format!("{} {}", table.unwrap_or("-".into()), blocks.join(" "))
}

fn of_block(reader: &Reader<&[u8]>, block: usize) -> String {
    let mut values = vec![f32::NAN; reader.block_values(block).expect("a block")];
    if reader.block_into(block, &mut values).is_err() {
        return "-".into();
    }
    let valid: Vec<u8> = reader.block_validity(block).expect("it decodes").into_iter().map(u8::from).collect();
    let exact = reader.source_block(block).map(|exact| format!("{:08x}", crc(exact.iter().map(|v| v.to_le_bytes()))));
    let sampled = reader.block_info(block).expect("it decodes").sampled;
    let sampled: Vec<String> = sampled.iter().map(usize::to_string).collect();
    let values = crc(values.iter().map(|v| v.to_le_bytes()));
    let exact = exact.unwrap_or("-".into());
    format!("{values:08x}/{:08x}/{exact}/{}", crc32fast::hash(&valid), sampled.join(","))
}

fn crc<const N: usize>(bytes: impl Iterator<Item = [u8; N]>) -> u32 {
    crc32fast::hash(&bytes.flatten().collect::<Vec<u8>>())
}
