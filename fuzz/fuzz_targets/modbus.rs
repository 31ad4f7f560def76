#![no_main]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| softtwin_tests::inputs::modbus(bytes));
