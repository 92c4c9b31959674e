//! Compiled part of the Python package `trilink`. Its functions take and return plain values (numbers, text, JSON,
//! capsules), which `trilink/__init__.py` wraps in the public interface.

mod arrow;
mod config;
mod error;
mod interrupt;
mod module;
mod simulate;

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use polars::prelude::DataFrame;
use pyo3::prelude::*;
use pyo3::types::PyCFunction;
use serde_json::json;
use trilink::build::{
    RerunOptions, RunError, RunResults, Watch, check_unconfigured, run as run_pipeline,
};
use trilink::cli::watch;
use trilink::inspect::{Query, find, meaning, query, unit};
use trilink_base::cancel::CancelToken;
use trilink_tables::config::Config;

use error::Failure;
use interrupt::interruptible;

/// Runs the program `trilink` with the given command line and returns its exit status.
fn main(py: Python<'_>, line: Vec<OsString>) -> u8 {
    py.detach(|| trilink::cli::main_with(line))
}

/// Arguments of [`run`], passed from Python as JSON.
#[derive(serde::Deserialize)]
struct RunRequest {
    config: Option<PathBuf>,
    folders: Option<Vec<PathBuf>>,
    only: bool,
    force: bool,
    verify: bool,
    wait: bool,
    progress: Option<Progress>,
}

/// How the progress of a run is displayed.
#[derive(PartialEq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
enum Progress {
    /// Progress bar on a terminal.
    Bars,
    /// One line on `sys.stderr` for each step.
    Lines,
}

/// Runs all stages of the pipeline and returns the results as JSON.
fn run(py: Python<'_>, request: &str) -> PyResult<String> {
    let RunRequest { config, folders, only, force, verify, wait, progress } =
        serde_json::from_str(request).map_err(Failure::from)?;
    let is_configured = Config::file(config.as_deref()).is_some();
    let mut config = config::load(config.as_deref())?;
    if let Some(folders) = folders {
        config.paths.replace_raw(folders);
    }
    if !is_configured {
        check_unconfigured(&config).map_err(Failure::from)?;
    }
    let options = RerunOptions { force, verify, only };
    let cancel = CancelToken::default();
    let finished = interruptible(
        py,
        &cancel,
        || match progress {
            Some(progress) => {
                let watch = watch(progress == Progress::Bars, write_line, cancel.clone());
                run_pipeline(&config, options, wait, &watch)
            }
            None => run_pipeline(&config, options, wait, &Unwatched(cancel.clone())),
        },
        // The error returned by an interrupted run describes the progress.
        |result| matches!(result, Err(RunError::Interrupted { .. })),
    )?
    .map_err(Failure::from)?;
    let needs_a_person = finished.ingested.needs_a_person()
        || finished.history_problem.is_some()
        || !finished.reported.damaged.is_empty();
    let answer = json!({
        "was_up_to_date": finished.was_up_to_date,
        "needs_a_person": needs_a_person,
        "results": RunResults::new(&finished),
        "stages": finished.stages,
        "history_problem": finished.history_problem,
        "damaged": finished.reported.damaged,
        "derived": config.paths.derived,
    });
    Ok(answer.to_string())
}

/// Observer of a run that displays no progress; its token can cancel the run.
struct Unwatched(CancelToken);

impl Watch for Unwatched {
    fn cancel_token(&self) -> CancelToken {
        self.0.clone()
    }
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

/// Returns the path of a table, which is given by its path or by its name in `folder` (by default, the folder of tables
/// in the configuration).
fn path_of(table: &str, folder: Option<&Path>, config: Option<&Path>) -> Result<PathBuf, Failure> {
    match folder {
        Some(folder) => Ok(find(folder, table)?),
        None => Ok(find(&config::load(config)?.paths.derived, table)?),
    }
}

/// Arguments of [`read`], passed from Python as JSON.
#[derive(serde::Deserialize)]
struct ReadRequest {
    table: String,
    folder: Option<PathBuf>,
    config: Option<PathBuf>,
    columns: Vec<String>,
    condition: Option<String>,
}

/// Table that was read: its path, the description of its columns as JSON, its number of rows, and the function that
/// returns a capsule with an Arrow stream of the table.
type ReadTable<'py> = (String, String, usize, Bound<'py, PyCFunction>);

/// Reads a table, or selected columns and rows of a table.
fn read<'py>(py: Python<'py>, request: &str) -> PyResult<ReadTable<'py>> {
    let request: ReadRequest = serde_json::from_str(request).map_err(Failure::from)?;
    let ReadRequest { table, folder, config, columns, condition } = request;
    let (path, frame) = py.detach(|| -> Result<(PathBuf, DataFrame), Failure> {
        let path = path_of(&table, folder.as_deref(), config.as_deref())?;
        let view = query(&path, &Query { columns, condition, ..Query::default() })?;
        let columns = view.columns.iter().map(|column| column.name.as_str());
        let mut frame = view.frame.select(columns)?;
        frame.align_chunks();
        Ok((path, frame))
    })?;
    let names = frame.get_column_names().into_iter();
    let columns: Vec<_> = names
        .map(|name| json!({ "name": &**name, "unit": unit(name), "meaning": meaning(name) }))
        .collect();
    let columns = serde_json::Value::from(columns).to_string();
    let rows = frame.height();
    Ok((path.display().to_string(), columns, rows, arrow::streams(py, frame)?))
}
