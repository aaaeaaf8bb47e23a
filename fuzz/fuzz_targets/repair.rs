#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(init: csbrdf_fuzz::on_one_thread(), |data: &[u8]| csbrdf_fuzz::bodies::repair::run(data));
