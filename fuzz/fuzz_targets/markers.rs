//! Fuzzes marker files: reading arbitrary bytes gives markers or an error.

#![no_main]

use trilink_fuzz::markers;

const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];

libfuzzer_sys::fuzz_target!(|file: &[u8]| {
    // A compressed file may expand a hundredfold; its decompressed content is fuzzed directly.
    if !file.starts_with(GZIP_MAGIC) {
        markers("fuzzed.csv", file);
        markers("fuzzed.c3d", file);
    }
});
