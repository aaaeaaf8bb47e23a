#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| csbrdf_fuzz::bodies::manifest::run(data));
