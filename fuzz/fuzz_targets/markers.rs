//! Whatever bytes a marker file has, reading it gives markers or an error.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use trilink::vicon::{parse_markers, sections};

const GZIP_MAGIC: &[u8] = &[0x1f, 0x8b];

fuzz_target!(|file: &[u8]| {
    // A packed file may grow a hundredfold; what comes out of it is fuzzed as it is.
    if file.starts_with(GZIP_MAGIC) {
        return;
    }
    for name in ["fuzzed.csv", "fuzzed.c3d"] {
        let path = Path::new(name);
        let _ = sections(path, file);
        let Ok(markers) = parse_markers(path, file) else { continue };
        assert!(!markers.frames.is_empty() && !markers.labels.is_empty());
        assert!(markers.frames.windows(2).all(|pair| pair[0] < pair[1]));
        for row in 0..markers.frames.len() {
            for position in markers.row_mm(row) {
                let missing = position.iter().filter(|x| x.is_nan()).count();
                assert!(missing == 0 || missing == 3);
            }
        }
    }
});
