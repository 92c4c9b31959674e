//! Commands of the program, called with a command line.

use std::ffi::OsString;

use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyTuple};
use trilink::cli::{Caller, ErrorKind, Returned, Shown};
use trilink_base::cancel::CancelToken;

use crate::error::Failure;
use crate::interrupt::interruptible;
use crate::table::accessor;

/// Calls a command and returns its result: whether something needs attention, JSON, tables by name, notes and warnings.
/// `progress` is `bars` (on a terminal), `lines` (written to `sys.stderr`), or empty.
pub fn call<'py>(
    py: Python<'py>,
    line: Vec<OsString>,
    progress: &str,
) -> PyResult<Bound<'py, PyTuple>> {
    let shown = match progress {
        "bars" => Shown::Bars,
        "lines" => Shown::Lines,
        _ => Shown::Nothing,
    };
    let cancel = CancelToken::default();
    let caller = Caller { shown, line: write_line, cancel: cancel.clone() };
    let returned = interruptible(
        py,
        &cancel,
        || trilink::cli::call(&line, caller),
        // The message of an interrupted command describes its progress.
        |result| matches!(result, Err(error) if error.kind == ErrorKind::Cancelled),
    )?;
    let Returned { needs_attention, json, tables, notes, warnings } =
        returned.map_err(Failure::from)?;
    let tables = tables.into_iter().map(|(name, frame)| Ok((name, accessor(py, frame)?)));
    let tables: Vec<(&str, Bound<PyCFunction>)> = tables.collect::<PyResult<_>>()?;
    (needs_attention, json, tables, notes, warnings).into_pyobject(py)
}

/// Writes a line to Python's `sys.stderr`; write errors are ignored.
fn write_line(line: &str) {
    Python::attach(|py| {
        let written = py
            .import("sys")
            .and_then(|sys| sys.getattr("stderr"))
            .and_then(|stderr| stderr.call_method1("write", (format!("{line}\n"),)));
        drop(written);
    });
}
