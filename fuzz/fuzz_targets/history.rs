//! Fuzzes `history.parquet`: whatever its content, a run is added to the file or an error is returned.

#![no_main]

use trilink_fuzz::{begin, history, program};

libfuzzer_sys::fuzz_target!(init: begin(program), |data: &[u8]| history(program, data));
