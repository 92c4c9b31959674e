//! The compiled part of the Python module `trilink`. It takes and gives plain values: numbers, text,
//! JSON, capsules; `trilink/__init__.py` makes of them what a person calls.

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

/// Runs the program with a command line, and gives its exit status.
fn main(py: Python<'_>, line: Vec<OsString>) -> u8 {
    py.detach(|| trilink::cli::main_with(line))
}

/// What to run: JSON of this.
#[derive(serde::Deserialize)]
struct RunRequest {
    config: Option<PathBuf>,
    folders: Option<Vec<PathBuf>>,
    only: bool,
    force: bool,
    verify: bool,
    wait: bool,
    progress: Option<Shown>,
}

/// How a run's progress is shown.
#[derive(PartialEq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
enum Shown {
    /// On a terminal.
    Bars,
    /// On `sys.stderr`, whatever that is.
    Lines,
}

/// Ingests, fits and reports; gives JSON of what came of it.
fn run(py: Python<'_>, request: &str) -> PyResult<String> {
    let RunRequest { config, folders, only, force, verify, wait, progress } =
        serde_json::from_str(request).map_err(Failure::from)?;
    let is_configured = Config::file(config.as_deref()).is_some();
    let mut config = config::load(config.as_deref())?;
    if let Some(folders) = folders {
        config.paths.raw = folders;
    }
    if !is_configured {
        check_unconfigured(&config).map_err(Failure::from)?;
    }
    let options = RerunOptions { force, verify, only };
    // Which says how far it was.
    let is_stopped = |result: &Result<_, _>| matches!(result, Err(RunError::Interrupted { .. }));
    let cancel = CancelToken::default();
    let work = || match progress {
        Some(shown) => {
            let watch = watch(shown == Shown::Bars, write_line, cancel.clone());
            run_pipeline(&config, options, wait, &watch)
        }
        None => run_pipeline(&config, options, wait, &Unwatched(cancel.clone())),
    };
    let finished = interruptible(py, &cancel, work, is_stopped)?.map_err(Failure::from)?;
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

/// Shows nothing of a run that can be cancelled.
struct Unwatched(CancelToken);

impl Watch for Unwatched {
    fn cancel_token(&self) -> CancelToken {
        self.0.clone()
    }
}

/// Writes a line to `sys.stderr`. That it cannot be written ends nothing.
fn write_line(line: &str) {
    Python::attach(|py| {
        let written = py
            .import("sys")
            .and_then(|sys| sys.getattr("stderr"))
            .and_then(|stderr| stderr.call_method1("write", (format!("{line}\n"),)));
        drop(written);
    });
}

/// Where a table is: one of a folder of tables, or of the configuration's, or any file by its path.
fn path_of(table: &str, folder: Option<&Path>, config: Option<&Path>) -> Result<PathBuf, Failure> {
    match folder {
        Some(folder) => Ok(find(folder, table)?),
        None => Ok(find(&config::load(config)?.paths.derived, table)?),
    }
}

/// What to read: JSON of this.
#[derive(serde::Deserialize)]
struct ReadRequest {
    table: String,
    folder: Option<PathBuf>,
    config: Option<PathBuf>,
    columns: Vec<String>,
    condition: Option<String>,
}

/// A table that was read: its file, JSON of its columns, its number of rows, and what makes capsules
/// of its stream.
type ReadTable<'py> = (String, String, usize, Bound<'py, PyCFunction>);

fn read<'py>(py: Python<'py>, request: &str) -> PyResult<ReadTable<'py>> {
    let request: ReadRequest = serde_json::from_str(request).map_err(Failure::from)?;
    let ReadRequest { table, folder, config, columns, condition } = request;
    let read = || -> Result<(PathBuf, DataFrame), Failure> {
        let path = path_of(&table, folder.as_deref(), config.as_deref())?;
        let view = query(&path, &Query { columns, condition, ..Query::default() })?;
        let columns = view.columns.iter().map(|column| column.name.as_str());
        let mut frame = view.frame.select(columns)?;
        frame.align_chunks();
        Ok((path, frame))
    };
    let (path, frame) = py.detach(read)?;
    let column = |name: &str| json!({ "name": name, "unit": unit(name), "meaning": meaning(name) });
    let columns: Vec<_> = frame.get_column_names().into_iter().map(|name| column(name)).collect();
    let columns = serde_json::Value::from(columns).to_string();
    let rows = frame.height();
    Ok((path.display().to_string(), columns, rows, arrow::streams(py, frame)?))
}
