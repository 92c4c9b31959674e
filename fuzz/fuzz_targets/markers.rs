//! Whatever bytes a marker file has, reading it gives markers or an error.

#![no_main]

use trilink_fuzz::markers;

const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];

libfuzzer_sys::fuzz_target!(|file: &[u8]| {
    // A packed file may grow a hundredfold; what comes out of it is fuzzed as it is.
    if !file.starts_with(GZIP_MAGIC) {
        markers("fuzzed.csv", file);
        markers("fuzzed.c3d", file);
    }
});
