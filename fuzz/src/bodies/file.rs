//! A whole file of arbitrary bytes, under tight limits: opened, verified, decoded, evaluated.

use std::time::Instant;

use csbrdf::Bytes;
use csbrdf::base::error::Error;
use csbrdf::brdf::Brdf;
use csbrdf::brdf::importance::Importance;
use csbrdf::decode::{PrunedPolicy, Reader};

use super::seal::sealed;
use super::{LIMITS, TIGHT, is_value, same_bits};

/// The same with hardly any operations and bytes: a call does what it does without bounds, or names the one that it would break, and
/// in either case ends soon.
fn within_tight_limits(data: &[u8], reader: &Reader) {
    let start = Instant::now();
    let Ok(tight) = Reader::open_with_limits(Bytes::from(data.to_vec()), TIGHT) else { return };
    let tight = tight.with_pruned(PrunedPolicy::Coarse);
    for block in 0..reader.block_count().min(4) {
        let values = |reader: &Reader| {
            let mut values = vec![f32::NAN; reader.block_values(block).expect("a block")];
            reader.block_into(block, &mut values).map(|()| values)
        };
        match (values(reader), values(&tight)) {
            (Ok(usual), Ok(tight)) => assert!(same_bits(&usual, &tight)),
            (Err(_), Err(_)) | (Ok(_), Err(Error::LimitExceeded { .. })) => {}
            (usual, tight) => panic!("block {block}: {usual:?} {tight:?}"),
        }
        let counts = tight.block_origins(block);
        assert!(counts.is_err() || counts.ok() == reader.block_origins(block).ok());
        let _ = (tight.block_info(block), tight.block_origin(block));
    }
    let _ = Importance::new(&tight);
    if let Ok(brdf) = Brdf::from_reader(tight.with_one_budget()) {
        let mut value = vec![0.0; brdf.reader().grid().channels().len()];
        for _ in 0..4 {
            let _ = brdf.eval_into([0.1, 0.2, 0.9], [-0.6, 0.1, 0.7], &mut value);
        }
    }
    assert!(start.elapsed().as_secs() < 10, "far more than the budget");
}

pub fn run(data: &[u8]) {
    let data = sealed(data);
    let Ok(reader) = Reader::open_with_limits(Bytes::from(data.to_vec()), LIMITS) else { return };
    let reader = reader.with_pruned(PrunedPolicy::Coarse);
    within_tight_limits(&data, &reader);
    let channels = reader.grid().channels().len();
    if reader.grid().positions() * channels > LIMITS.table_values {
        assert!(reader.decode_all().is_err() && reader.decode_table().is_err() && reader.verify().len() == 1);
        return;
    }
    let damage = reader.verify();
    assert!(damage.iter().all(|e| !e.to_string().is_empty()));
    let decoded = reader.decode_all();
    // The table's way and the blocks' way agree on what can be decoded.
    let each = |block| reader.block_into(block, &mut vec![0.0; reader.block_values(block).expect("a block")]);
    assert_eq!(decoded.is_ok(), (0..reader.block_count()).all(|block| each(block).is_ok()));
    assert!(decoded.is_ok() || !damage.is_empty(), "verify misses what does not decode");
    if let Ok(values) = &decoded {
        assert!(values.iter().all(is_value));
        let table = reader.decode_table().expect("all blocks decode");
        assert!(table.values().iter().all(|v| v.is_finite() && *v >= 0.0));
        if let Ok(exact) = reader.source_table() {
            assert_eq!(exact.len(), values.len());
        }
    }
    for block in 0..reader.block_count().min(4) {
        let _ = (reader.block_info(block), reader.block_origin(block));
    }
    if let Ok(brdf) = Brdf::from_reader(reader) {
        let (wi, wo) = ([[0.1, 0.2, 0.9], [0.0, 0.0, 1.0]], [[-0.6, 0.1, 0.7], [0.9, 0.0, 0.1]]);
        let (mut value, mut many) = (vec![f32::NAN; channels], vec![f32::NAN; 2 * channels]);
        let single = brdf.eval_into(wi[0], wo[0], &mut value);
        assert!(single.is_ok() || decoded.is_err(), "what decodes can be evaluated");
        if single.is_ok() {
            assert!(value.iter().all(is_value));
            if brdf.eval_many(&wi, &wo, &mut many).is_ok() {
                assert!(same_bits(&many[..channels], &value));
            }
        }
    }
}
