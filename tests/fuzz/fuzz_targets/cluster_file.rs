#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| cluster::fuzz::cluster_file(bytes));
