//! Whatever `pipeline.toml` and `trials.toml` say, they are refused or can be worked with.

#![no_main]

libfuzzer_sys::fuzz_target!(|text: &[u8]| trilink_fuzz::settings(text));
