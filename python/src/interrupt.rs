//! Handling of Ctrl-C during long-running calls.

use std::panic::resume_unwind;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use trilink_base::cancel::CancelToken;

/// Interval between checks for signals.
const INTERVAL: Duration = Duration::from_millis(20);

/// Runs `work` on another thread, without holding the interpreter lock, while the calling thread lets Python handle
/// signals.
///
/// If a signal handler raises an exception, as the handler for Ctrl-C does, `cancel` is triggered. Once the work has
/// ended, the exception is returned in place of the result, unless `reports_interruption` returns true for the result,
/// because the result itself describes the interruption.
///
/// # Errors
/// Returns the exception that a signal handler raised.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    cancel: &CancelToken,
    work: impl FnOnce() -> T + Send,
    reports_interruption: impl FnOnce(&T) -> bool,
) -> PyResult<T> {
    let mut raised = None;
    let result = py.detach(|| {
        thread::scope(|scope| {
            let (done_sender, done) = channel::<()>();
            let worker = scope.spawn(move || {
                // The sender is dropped when the work ends, even if it panics.
                let _done_sender = done_sender;
                work()
            });
            while let Err(RecvTimeoutError::Timeout) = done.recv_timeout(INTERVAL) {
                if let Err(exception) = Python::attach(|py| py.check_signals()) {
                    cancel.cancel();
                    raised.get_or_insert(exception);
                }
            }
            worker.join().unwrap_or_else(|panic| resume_unwind(panic))
        })
    });
    match raised {
        Some(exception) if !reports_interruption(&result) => Err(exception),
        _ => Ok(result),
    }
}
