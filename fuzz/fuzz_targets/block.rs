#![no_main]

libfuzzer_sys::fuzz_target!(init: csbrdf_fuzz::on_one_thread(), |data: &[u8]| csbrdf_fuzz::bodies::block::run(data));
