//! Fuzzes C3D files: reading arbitrary bytes gives markers or an error.

#![no_main]

libfuzzer_sys::fuzz_target!(|file: &[u8]| trilink_fuzz::markers("fuzzed.c3d", file));
