//! Ctrl-C while the library works.

use std::panic::resume_unwind;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use trilink_base::cancel::CancelToken;

/// How often Python is asked for signals.
const INTERVAL: Duration = Duration::from_millis(20);

/// Does work on a thread of its own without the interpreter's lock, while this one lets Python
/// handle signals. Where its handler raises an exception, as that of Ctrl-C does, the work is asked
/// to stop and the exception is raised after it, unless the work's own result says how far it was.
///
/// # Errors
/// What a handler of a signal raised.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    cancel: &CancelToken,
    work: impl FnOnce() -> T + Send,
    says_so: impl FnOnce(&T) -> bool,
) -> PyResult<T> {
    let mut raised = None;
    let result = py.detach(|| {
        thread::scope(|scope| {
            let (done, is_done) = channel::<()>();
            let worker = scope.spawn(move || {
                // Dropped at the end, also by a panic.
                let _done = done;
                work()
            });
            while let Err(RecvTimeoutError::Timeout) = is_done.recv_timeout(INTERVAL) {
                if let Err(exception) = Python::attach(|py| py.check_signals()) {
                    cancel.cancel();
                    raised.get_or_insert(exception);
                }
            }
            worker.join().unwrap_or_else(|panic| resume_unwind(panic))
        })
    });
    match raised {
        Some(exception) if !says_so(&result) => Err(exception),
        _ => Ok(result),
    }
}
