//! Whatever `history.parquet` holds, a run is added to it or there is an error.

#![no_main]

libfuzzer_sys::fuzz_target!(init: trilink_fuzz::begin(), |data: &[u8]| trilink_fuzz::history(data));
