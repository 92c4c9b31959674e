//! `trilink`: reads the command line and calls the library.

use std::process::ExitCode;

/// Replacement for musl's allocator, in which all threads share one lock.
#[cfg(target_env = "musl")]
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    trilink::cli::main()
}
