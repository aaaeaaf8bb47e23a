#![no_main]

use libfuzzer_sys::{fuzz_mutator, fuzz_target};

fuzz_target!(init: csbrdf_fuzz::on_one_thread(), |data: &[u8]| csbrdf_fuzz::bodies::salvage::run(data));

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    csbrdf_fuzz::mutate::sections(data, size, max_size, seed, csbrdf_fuzz::bodies::salvage::HEAD)
});
