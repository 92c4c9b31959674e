//! Ctrl-C: the first one stops the work between two steps, the second one at once.
//!
//! Work is abandoned by unwinding from wherever it is: rayon carries that from its threads to the
//! caller, and every file that is not yet in its place is removed on the way. No step has to say
//! that it was cut short, and no result of half the steps can be taken for one of all.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;
use trilink_base::cancel::asked;
pub use trilink_base::cancel::{Interrupted, abandonable, stop_if_asked};

/// A shell's exit status of what a signal has ended is this and its number.
const STATUS: i32 = 128;

/// Listens for Ctrl-C and for being asked to end from now on.
///
/// # Errors
/// The system does not allow it.
pub(crate) fn listen() -> std::io::Result<()> {
    let asked = asked();
    // A limit on the size of files is an error of who writes, not the end.
    #[cfg(unix)]
    flag::register(signal_hook::consts::SIGXFSZ, Arc::default())?;
    let is_second = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        // In this order: the first signal finds the flag down and raises it.
        flag::register_conditional_shutdown(signal, STATUS + signal, Arc::clone(&is_second))?;
        flag::register(signal, Arc::clone(&is_second))?;
        flag::register_usize(signal, Arc::clone(asked), signal as usize)?;
    }
    Ok(())
}

/// Asks all work of this program to stop, as the first Ctrl-C does.
pub fn ask() {
    asked().store(SIGINT as usize, Ordering::Relaxed);
}

/// Takes back that work was asked to stop: what is begun from now on goes on.
pub fn forget() {
    asked().store(0, Ordering::Relaxed);
}

/// The exit status of a program that was asked to stop.
pub(crate) fn exit_status() -> Option<u8> {
    let signal = asked().load(Ordering::Relaxed);
    (signal != 0).then(|| u8::try_from(STATUS as usize + signal).unwrap_or(u8::MAX))
}
