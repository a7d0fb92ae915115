#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| world_encodings::fuzz::world(bytes));
