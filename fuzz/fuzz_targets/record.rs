//! Fuzzes `up-to-date.json`: whatever its content, a run ends with results or an error.

#![no_main]

use trilink_fuzz::{begin, program, record};

libfuzzer_sys::fuzz_target!(init: begin(program), |data: &[u8]| record(program, data));
