//! MERL tables of arbitrary bytes. A table has 35 MB: an input stands for one where its thirteenth byte says so, its last bytes
//! repeated to the length that the header asks for, or nearly.

use csbrdf::io::merl::{read_merl, write_merl, write_merl_values};

const HEADER: usize = 12;

pub fn run(data: &[u8]) {
    check(data);
    let Some((header, [b'*', excess, pattern @ ..])) = data.split_at_checked(HEADER) else { return };
    let bins: Vec<i32> =
        header.chunks_exact(4).map(|b| i32::from_le_bytes(b.try_into().expect("four bytes"))).collect();
    if pattern.is_empty() || bins[..2] != [90, 90] || ![180, 360].contains(&bins[2]) {
        return;
    }
    let length = (3 * 8 * 90 * 90 * bins[2] as usize).saturating_add_signed(isize::from(*excess as i8));
    let planes = pattern.iter().copied().cycle().take(length);
    let table: Vec<u8> = header.iter().copied().chain(planes).collect();
    assert_eq!(check(&table), *excess == 0);
}

/// Whether it was read, and by its first bytes too; then its validity is as documented and its bytes come back.
fn check(data: &[u8]) -> bool {
    let by_its_bytes = csbrdf::io::read(data, &csbrdf::io::ReadOptions::new().lists(false));
    let Ok(table) = read_merl(data) else {
        assert!(by_its_bytes.is_err());
        return false;
    };
    assert!(by_its_bytes.is_ok_and(|other| other.valid() == table.valid()));
    let valid = |x: &f64| x.is_finite() && *x >= 0.0;
    assert!(table.values().iter().zip(table.valid()).all(|(value, v)| valid(value) == *v));
    let mut back = Vec::new();
    write_merl_values(table.grid(), table.values(), &mut back).expect("MERL's grid");
    assert!(back == data);
    back.clear();
    write_merl(&table, false, &mut back).expect("MERL's grid");
    assert_eq!(back.len(), data.len());
    true
}
