//! Whatever the derived table holds that the target has its name from, each command that reads it
//! ends with results or an error.

#![no_main]

use trilink_fuzz::{begin, program, table};

libfuzzer_sys::fuzz_target!(
    init: begin(program),
    |data: &[u8]| table(program, env!("CARGO_BIN_NAME"), data)
);
