//! Entry points for the fuzz targets, shared with the tests, which run the same checks on a small scale.

#[path = "../../tests/it/common/temporary.rs"]
mod temporary;
#[path = "../../tests/it/common/fuzz.rs"]
mod inputs;

use std::path::Path;

pub use inputs::*;

/// Runs the program with the arguments in `line` on the configuration file `config`, and returns its exit status.
pub fn program(config: &Path, line: &str) -> i32 {
    let options = ["trilink", "-q", "-c"].into_iter().map(Into::into).chain([config.into()]);
    let line = options.chain(line.split(' ').map(Into::into)).collect();
    let status = i32::from(trilink::cli::main_with(line));
    // A status above 128 means that a signal has arrived, which is meant for the fuzzer.
    if status > 128 {
        std::process::exit(status);
    }
    status
}
