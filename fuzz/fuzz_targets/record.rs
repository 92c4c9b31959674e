//! Whatever `up-to-date.json` holds, a run ends with results or an error.

#![no_main]

libfuzzer_sys::fuzz_target!(init: trilink_fuzz::begin(), |data: &[u8]| trilink_fuzz::record(data));
