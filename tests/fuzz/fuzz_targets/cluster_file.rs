#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| setup::fuzz::cluster_file(bytes));
