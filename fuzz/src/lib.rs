//! What the targets do: what a test does in small, with the program in the same process.

#[path = "../../tests/it/common/temporary.rs"]
mod temporary;
#[path = "../../tests/it/common/fuzz.rs"]
mod inputs;

use std::path::Path;

pub use inputs::*;

/// Runs the program on a configuration with a line of arguments; gives its exit status.
pub fn program(config: &Path, line: &str) -> i32 {
    let options = ["trilink", "-q", "-c"].into_iter().map(Into::into).chain([config.into()]);
    let line = options.chain(line.split(' ').map(Into::into)).collect();
    let status = i32::from(trilink::cli::main_with(line));
    // A signal is meant for the fuzzer.
    if status > 128 {
        std::process::exit(status);
    }
    status
}
