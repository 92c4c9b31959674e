//! Work that is asked to stop.
//!
//! Work is abandoned by unwinding from wherever it is: rayon carries that from its threads to the
//! caller, and every file that is not yet in its place is removed on the way. No step has to say
//! that it was cut short, and no result of half the steps can be taken for one of all.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

/// Number of the signal that asked to stop; 0 for none.
static ASKED: OnceLock<Arc<AtomicUsize>> = OnceLock::new();

/// Asked.
pub fn asked() -> &'static Arc<AtomicUsize> {
    ASKED.get_or_init(Arc::default)
}

/// Work that was abandoned.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Interrupted {
    /// How far it was, such as `12 of 42 trials`; may be empty.
    pub done: String,
}

/// Abandons the work if that was asked for, by unwinding to [`abandonable`]; `done` says how far it is.
pub fn stop_if_asked(done: impl FnOnce() -> String) {
    if asked().load(Ordering::Relaxed) != 0 {
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
