//! Whatever `wheels/TRIAL.parquet` holds, the report ends with its pages or an error.

#![no_main]

use trilink_fuzz::{Project, begin, table};

libfuzzer_sys::fuzz_target!(init: begin(), |data: &[u8]| table(&Project::of_trial("wheels"), data));
