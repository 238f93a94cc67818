#![no_main]
libfuzzer_sys::fuzz_target!(|data: &[u8]| pmac_dpram_fuzz::service::body(data));
