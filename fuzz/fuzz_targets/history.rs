//! Whatever `history.parquet` holds, a run is added to it or there is an error.

#![no_main]

use trilink_fuzz::{begin, history, program};

libfuzzer_sys::fuzz_target!(init: begin(program), |data: &[u8]| history(program, data));
