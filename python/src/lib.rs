//! Compiled part of the Python package `trilink`. Its functions take and return plain values (numbers, text, JSON,
//! functions that give access to tables), which the modules of the package wrap in the public interface.

mod arrow;
mod call;
mod config;
mod error;
mod interrupt;
mod mocap;
mod module;
mod objective;
mod simulate;
mod table;

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::prelude::*;
use pyo3::types::PyTuple;
use trilink::inspect::{Query, find, query};

use error::Failure;
use table::accessor;

/// Runs the program `trilink` with the given command line and returns its exit status.
fn main(py: Python<'_>, line: Vec<OsString>) -> u8 {
    py.detach(|| trilink::cli::main_with(line))
}

/// Reads a table, or selected columns and rows of a table, given by its path or by its name in `folder` (by default, the
/// folder of tables in the configuration). Returns the path and access to the table.
fn read<'py>(
    py: Python<'py>,
    (table, folder, config): (String, Option<PathBuf>, Option<PathBuf>),
    columns: Vec<String>,
    condition: Option<String>,
) -> PyResult<Bound<'py, PyTuple>> {
    let (path, frame) = py.detach(|| {
        let folder = match folder {
            Some(folder) => folder,
            None => config::load(config.as_deref())?.paths.derived,
        };
        let path = find(&folder, &table)?;
        let view = query(&path, &Query { columns, condition, ..Query::default() })?;
        let columns = view.columns.iter().map(|column| column.name.as_str());
        Ok::<_, Failure>((path, view.frame.select(columns)?))
    })?;
    (path.display().to_string(), accessor(py, frame)?).into_pyobject(py)
}
