#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| proto::fuzz::node_messages(bytes));
