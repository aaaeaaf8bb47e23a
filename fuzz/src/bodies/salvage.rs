//! A damaged file: the head gives the damage, done to the file that follows after its checksums were put right. What is left of it agrees
//! with what is said of it.

#[cfg(feature = "cli")]
use csbrdf::decode::Reader;
use csbrdf::edit::salvage::{Salvaged, salvage_with_limits};

use super::seal::seal;
use super::{LIMITS, is_value};

/// Bytes before the file.
pub const HEAD: usize = 12;

pub fn run(data: &[u8]) {
    let Some((head, file)) = data.split_first_chunk::<HEAD>() else { return };
    let mut file = seal(file);
    damage(head, &mut file);
    let salvaged = match salvage_with_limits(&file, LIMITS) {
        Ok(salvaged) => salvaged,
        Err(e) => return assert!(!e.to_string().is_empty()),
    };
    check_report(&salvaged);
    left(&salvaged);
    #[cfg(feature = "cli")]
    repaired(&file, &salvaged);
}

/// Bits of the first byte: one bit flipped, the end cut off, bytes overwritten, bytes taken out, zeros put in. Two bytes a number, then
/// four the place.
fn damage(head: &[u8; HEAD], file: &mut Vec<u8>) {
    let [ways, fill, a, b, c, d, at @ .., _, _] = *head;
    let (first, second) = (usize::from(u16::from_le_bytes([a, b])), usize::from(u16::from_le_bytes([c, d])));
    if file.is_empty() {
        return;
    }
    let at = u32::from_le_bytes(at) as usize % file.len();
    if ways & 1 != 0 {
        file[at] ^= 1 << (fill % 8);
    }
    if ways & 2 != 0 {
        file.truncate(file.len() - first.min(file.len()));
    }
    let place = at.min(file.len())..(at + second).min(file.len());
    if ways & 4 != 0 {
        file[place.clone()].fill(fill);
    }
    if ways & 8 != 0 {
        file.drain(place.clone());
    }
    if ways & 16 != 0 {
        file.splice(place.start..place.start, std::iter::repeat_n(0, second));
    }
}

/// Numbers that belong together.
pub(super) fn check_report(salvaged: &Salvaged) {
    let (reader, lost) = (salvaged.reader(), salvaged.lost());
    assert!(lost.is_sorted_by(|a, b| a < b) && lost.last().is_none_or(|last| *last < reader.block_count()));
    assert!(lost.iter().all(|block| salvaged.place(*block).is_some()));
    let entries = reader.grid().positions() * reader.grid().channels().len();
    assert!(
        salvaged.lost_entries() <= entries
            && (lost.len() < reader.block_count()) == (salvaged.lost_entries() < entries)
    );
    // A mean that is not known is that of a lost block.
    assert!((0..reader.block_count()).all(|block| salvaged.has_mean(block) || lost.contains(&block)));
    assert!(lost.is_empty() || !salvaged.damage().is_empty());
    assert!(salvaged.damage().iter().all(|damage| !damage.what.is_empty() && damage.bytes.start <= damage.bytes.end));
}

/// Values that are left.
fn left(salvaged: &Salvaged) {
    let reader = salvaged.reader();
    if reader.grid().positions() * reader.grid().channels().len() > LIMITS.table_values {
        return assert!(reader.decode_all().is_err());
    }
    let decoded = reader.decode_all();
    assert!(decoded.as_ref().map_or(true, |values| values.iter().all(is_value)));
    // A lost block is its mean, if nothing that all blocks need is damaged beyond what checksums see.
    for &block in salvaged.lost().iter().take(4) {
        let mut values = vec![f32::NAN; reader.block_values(block).expect("a block")];
        let result = reader.block_into(block, &mut values);
        assert!(result.is_ok() || decoded.is_err());
        assert!(reader.block_validity(block).map_or(decoded.is_err(), |valid| !valid.contains(&true)));
    }
    match salvaged.source_table(-1.0) {
        Ok((values, missing)) => assert!(values.len() <= LIMITS.table_values && missing <= reader.block_count()),
        Err(e) => assert!(!e.to_string().is_empty()),
    }
}

/// What is written of it is a file, and nothing more is lost.
#[cfg(feature = "cli")]
fn repaired(file: &[u8], salvaged: &Salvaged) {
    let Ok(repaired) = csbrdf::edit::salvage::repair(file, LIMITS) else { return };
    let again = Reader::open_with_limits(&repaired.bytes[..], LIMITS).expect("a repaired file");
    assert_eq!(again.block_count(), salvaged.reader().block_count());
    let second = salvage_with_limits(&repaired.bytes, LIMITS).expect("a repaired file");
    assert!(second.lost().is_empty());
}
