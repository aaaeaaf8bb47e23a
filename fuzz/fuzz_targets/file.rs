//! A whole file of arbitrary bytes, under tight limits: opened, verified, decoded, evaluated.
#![no_main]

use csbrdf::decode::{Pruned, Reader};
use csbrdf::eval::Brdf;
use csbrdf::format::Limits;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    let limits = Limits { table_values: 1 << 16, block_values: 1 << 14 };
    let Ok(reader) = Reader::open_with_limits(data, limits) else { return };
    let reader = reader.with_pruned(Pruned::Coarse);
    if reader.grid().positions() * reader.grid().channels().len() > limits.table_values {
        assert!(reader.decode_all().is_err());
        return;
    }
    let _ = reader.verify();
    if let Ok(values) = reader.decode_all() {
        assert!(values.iter().all(|v| v.is_finite() && *v >= 0.0));
        let _ = reader.exact_table();
        let table = reader.decode_table().expect("all blocks decode");
        assert!(table.values().iter().all(|v| v.is_finite() && *v >= 0.0));
    }
    for block in 0..reader.block_count().min(4) {
        let _ = (reader.block_info(block), reader.block_origin(block));
    }
    let channels = reader.grid().channels().len();
    if let Ok(brdf) = Brdf::open(reader) {
        let mut value = vec![f32::NAN; channels];
        if brdf.eval_into([0.1, 0.2, 0.9], [-0.6, 0.1, 0.7], &mut value).is_ok() {
            assert!(value.iter().all(|v| v.is_finite() && *v >= 0.0));
            let mut many = vec![f32::NAN; 2 * channels];
            let (wi, wo) = ([[0.1, 0.2, 0.9], [0.0, 0.0, 1.0]], [[-0.6, 0.1, 0.7], [0.9, 0.0, 0.1]]);
            if brdf.eval_many(&wi, &wo, &mut many).is_ok() {
                assert_eq!(many[..channels], value);
            }
        }
        if let Ok(importance) = brdf.importance() {
            let sample = importance.sample([0.3, 0.1, 0.5], [0.2, 0.7]).expect("above the horizon");
            assert!(sample.pdf.is_finite() && sample.pdf > 0.0);
        }
    }
});
