#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| web_server::fuzz::call(bytes));
