//! Whatever the derived table holds that the target has its name from, each command that reads it
//! ends with results or an error. The input's first byte says which command.

#![no_main]

use trilink_fuzz::{begin, program, readers, table};

libfuzzer_sys::fuzz_target!(
    init: begin(program),
    |data: &[u8]| {
        let Some((first, rest)) = data.split_first() else { return };
        let name = env!("CARGO_BIN_NAME");
        let readers = readers(name);
        table(program, name, readers[usize::from(*first) % readers.len()], rest);
    }
);
