//! What the targets do: what a test does in small, with the program in the same process.

#[path = "../../tests/common/fuzz.rs"]
mod inputs;

use std::path::Path;

pub use inputs::*;

/// Runs the program on a configuration with a line of arguments; gives its exit status.
pub fn program(config: &Path, line: &str) -> i32 {
    let options = ["trilink", "-q", "-c"].into_iter().map(Into::into).chain([config.into()]);
    trilink::cli::main_with(options.chain(line.split(' ').map(Into::into)).collect()).into()
}
