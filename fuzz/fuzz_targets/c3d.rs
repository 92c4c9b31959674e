//! Whatever bytes a C3D file has, reading it gives markers or an error.

#![no_main]

libfuzzer_sys::fuzz_target!(|file: &[u8]| trilink_fuzz::markers("fuzzed.c3d", file));
