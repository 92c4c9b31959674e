//! Fuzzes `pipeline.toml` and `trials.toml`: any content is either rejected or usable by all stages.

#![no_main]

libfuzzer_sys::fuzz_target!(|text: &[u8]| trilink_fuzz::settings(text));
