//! Handling of Ctrl-C (SIGINT) and SIGTERM: the first signal cancels the work after the current step, and the second
//! one ends the process at once.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use trilink_base::cancel::CancelToken;

/// Offset of the exit status of a process that was ended by a signal; shells use 128 + signal number.
const SIGNAL_STATUS_OFFSET: i32 = 128;

/// Number of the last signal received, or 0.
static SIGNAL: LazyLock<Arc<AtomicUsize>> = LazyLock::new(Arc::default);

/// Cancellation token of the running command, cancelled by SIGINT and SIGTERM.
static COMMAND: LazyLock<CancelToken> = LazyLock::new(CancelToken::default);

/// Returns the token that cancels the command of this process.
pub(crate) fn token() -> &'static CancelToken {
    &COMMAND
}

/// Installs the handlers of SIGINT and SIGTERM.
///
/// # Errors
/// Returns an error if the operating system refuses a handler.
pub(crate) fn listen() -> std::io::Result<()> {
    // Exceeding the file-size limit becomes a write error instead of ending the process.
    #[cfg(unix)]
    flag::register(signal_hook::consts::SIGXFSZ, Arc::default())?;
    let is_second = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // The conditional shutdown comes first, so that the first signal finds the flag unset.
        let status = SIGNAL_STATUS_OFFSET + signal;
        flag::register_conditional_shutdown(signal, status, Arc::clone(&is_second))?;
        flag::register(signal, Arc::clone(&is_second))?;
        flag::register_usize(signal, Arc::clone(&SIGNAL), signal as usize)?;
        flag::register(signal, COMMAND.flag())?;
    }
    Ok(())
}

/// Returns the exit status for a command that was cancelled by a signal; `None` if there was no signal.
pub(crate) fn exit_status() -> Option<u8> {
    let signal = SIGNAL.load(Ordering::Relaxed);
    (signal != 0).then(|| u8::try_from(SIGNAL_STATUS_OFFSET as usize + signal).unwrap_or(u8::MAX))
}
