//! Whatever `robot_parameters.parquet` holds, the stages that read it end with results or an error.

#![no_main]

libfuzzer_sys::fuzz_target!(init: trilink_fuzz::begin(), |data: &[u8]| trilink_fuzz::table("robot_parameters.parquet", data));
