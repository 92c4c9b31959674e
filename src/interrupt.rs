//! Ctrl-C and SIGTERM: the first one stops the work between two steps, the second one at once.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use trilink_base::cancel::CancelToken;

/// A shell's exit status of what a signal has ended is this and its number.
const STATUS: i32 = 128;

/// Number of the signal that was received; 0 for none.
static SIGNAL: LazyLock<Arc<AtomicUsize>> = LazyLock::new(Arc::default);

/// Cancelled by SIGINT and SIGTERM.
static COMMAND: LazyLock<CancelToken> = LazyLock::new(CancelToken::default);

/// Cancels the command that this process runs.
pub(crate) fn token() -> &'static CancelToken {
    &COMMAND
}

/// Listens for Ctrl-C and for being asked to end from now on.
///
/// # Errors
/// The system does not allow it.
pub(crate) fn listen() -> std::io::Result<()> {
    // A limit on the size of files is an error of who writes, not the end.
    #[cfg(unix)]
    flag::register(signal_hook::consts::SIGXFSZ, Arc::default())?;
    let is_second = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: the first signal finds the flag down and raises it.
        flag::register_conditional_shutdown(signal, STATUS + signal, Arc::clone(&is_second))?;
        flag::register(signal, Arc::clone(&is_second))?;
        flag::register_usize(signal, Arc::clone(&SIGNAL), signal as usize)?;
        flag::register(signal, COMMAND.flag())?;
    }
    Ok(())
}

/// The exit status of a program that a signal cancelled.
pub(crate) fn exit_status() -> Option<u8> {
    let signal = SIGNAL.load(Ordering::Relaxed);
    (signal != 0).then(|| u8::try_from(STATUS as usize + signal).unwrap_or(u8::MAX))
}
