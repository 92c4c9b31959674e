//! Whatever `fits.parquet` holds, the stages that read it end with results or an error.

#![no_main]

use trilink_fuzz::{begin, table};

libfuzzer_sys::fuzz_target!(init: begin(), |data: &[u8]| table("fits.parquet", data));
