//! Fuzzes the derived table after which the target is named: whatever its content, each command that reads the table
//! ends with results or an error. The first byte of the input selects the command.

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
