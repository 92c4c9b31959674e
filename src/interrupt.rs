//! Ctrl-C: the first one stops the work between two steps, the second one at once.
//!
//! Work is abandoned by unwinding from wherever it is: rayon carries that from its threads to the
//! caller, and every file that is not yet in its place is removed on the way. No step has to say
//! that it was cut short, and no result of half the steps can be taken for one of all.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// A shell's exit status of what a signal has ended is this and its number.
const STATUS: i32 = 128;

/// Number of the signal that asked to stop; 0 for none.
static ASKED: OnceLock<Arc<AtomicUsize>> = OnceLock::new();

/// Work that was abandoned.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Interrupted {
    /// How far it was, such as `12 of 42 trials`; may be empty.
    pub done: String,
}

/// Listens for Ctrl-C and for being asked to end from now on.
///
/// # Errors
/// The system does not allow it.
pub(crate) fn listen() -> std::io::Result<()> {
    let asked = ASKED.get_or_init(Arc::default);
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
    ASKED.get_or_init(Arc::default).store(SIGINT as usize, Ordering::Relaxed);
}

/// Takes back that work was asked to stop: what is begun from now on goes on.
pub fn forget() {
    ASKED.get_or_init(Arc::default).store(0, Ordering::Relaxed);
}

/// The exit status of a program that was asked to stop.
pub(crate) fn exit_status() -> Option<u8> {
    let signal = ASKED.get().map_or(0, |asked| asked.load(Ordering::Relaxed));
    (signal != 0).then(|| u8::try_from(STATUS as usize + signal).unwrap_or(u8::MAX))
}

/// Abandons the work if that was asked for, by unwinding to [`abandonable`]; `done` says how far it is.
pub fn stop_if_asked(done: impl FnOnce() -> String) {
    if exit_status().is_some() {
        resume_unwind(Box::new(Interrupted { done: done() }));
    }
}

/// Does work that [`stop_if_asked`] may abandon.
///
/// # Errors
/// It was abandoned.
pub fn abandonable<T>(work: impl FnOnce() -> T) -> Result<T, Interrupted> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| match payload.downcast() {
        Ok(interrupted) => *interrupted,
        Err(panic) => resume_unwind(panic),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_goes_on_while_nobody_asks_it_to_stop() {
        assert_eq!(abandonable(|| stop_if_asked(String::new)), Ok(()));
    }

    #[test]
    fn abandoned_work_says_how_far_it_was() {
        let interrupted = Interrupted { done: "1 of 2 trials".to_owned() };
        let abandoned = interrupted.clone();
        assert_eq!(abandonable(|| resume_unwind(Box::new(abandoned))), Err::<(), _>(interrupted));
    }
}
