//! From the tables of `derived/` to tables beside them.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::plan::{FitPlan, plan};
use super::{FitData, FitInput, Fitted, OnEvent, fit_except};
use crate::config::Config;
use crate::store::{Columns, How, StageState, StoreError, Table, TrialRow, cycles_path, flatten};
use crate::trial::is_valid_id;

/// The tables of a fit.
pub(super) const TABLES: [&str; 6] = [
    "fits.parquet",
    "starts.parquet",
    "profiles.parquet",
    "bootstrap.parquet",
    "comparison.parquet",
    "predictions.parquet",
];

/// Fits all campaigns to `derived/trials.parquet` and writes `fits.parquet`, `starts.parquet`,
/// `profiles.parquet`, `bootstrap.parquet`, `comparison.parquet` and `predictions.parquet` beside
/// it. The tables of cycles and `robot_parameters.parquet` are read where they are there.
///
/// # Errors
/// The trials cannot be read or the tables not written. A model that cannot be fitted is a
/// row with a status.
pub fn fit_folder(
    config: &Config,
    derived: &Path,
    on_event: OnEvent,
) -> Result<Fitted, StoreError> {
    let known = StageState::default();
    Ok(fit_planned(config, derived, plan(config, derived, &known, How::FORCE)?, on_event)?.0)
}

/// [`fit_folder`] of those models only that the plan does not keep. The tables are those that a
/// fit of all would have left. Gives what to record, too.
///
/// # Errors
/// A table cannot be written.
pub fn fit_planned(
    config: &Config,
    derived: &Path,
    mut plan: FitPlan,
    on_event: OnEvent,
) -> Result<(Fitted, StageState), StoreError> {
    let Some(data) = plan.data.take().filter(|_| !plan.redo.is_empty()) else {
        let state = plan.state();
        return Ok((plan.into_fitted(), state));
    };
    let provenance = plan.provenance();
    let mut state = StageState {
        settings: flatten(config),
        things: plan.things(),
        inputs: plan.inputs,
        order: plan.order,
        ..StageState::default()
    };
    let fitted = fit_except(&FitInput::all(config), &data, plan.kept, on_event);
    for (name, table) in TABLES.into_iter().zip(fitted.to_tables()) {
        let stamp = table.write_if_changed(&derived.join(name), &provenance)?;
        state.outputs.insert(name.to_owned(), stamp);
    }
    state.input = provenance.input;
    Ok((fitted, state))
}

/// Files that a fit writes.
pub fn table_paths(derived: &Path) -> Vec<PathBuf> {
    TABLES.map(|name| derived.join(name)).into()
}

/// Files that a fit reads.
///
/// # Errors
/// There is no table of trials.
pub(super) fn input_paths(derived: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let trials = derived.join("trials.parquet");
    match std::fs::metadata(&trials) {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return Err(StoreError::NotIngested { path: trials });
        }
        _ => {}
    }
    let mut paths = vec![trials, derived.join("robot_parameters.parquet")];
    let folder = derived.join("cycles");
    match std::fs::read_dir(&folder) {
        Ok(entries) => {
            let tables = entries.flatten().map(|entry| entry.path());
            paths.extend(tables.filter(|path| path.extension().is_some_and(|e| e == "parquet")));
        }
        Err(error) if error.kind() == ErrorKind::NotFound => {}
        Err(source) => return Err(StoreError::Read { path: folder, source }),
    }
    paths.retain(|path| path.is_file());
    Ok(paths)
}

/// What is fitted.
pub(super) fn read_data(derived: &Path) -> Result<FitData, StoreError> {
    let trials: Vec<TrialRow> = rows(&derived.join("trials.parquet"))?;
    let mut cycles = BTreeMap::new();
    for trial in trials.iter().filter(|trial| is_valid_id(&trial.trial)) {
        let path = cycles_path(derived, &trial.trial);
        if path.exists() {
            cycles.insert(trial.trial.clone(), rows(&path)?);
        }
    }
    let path = derived.join("robot_parameters.parquet");
    let robots = if path.exists() { rows(&path)? } else { Vec::new() };
    Ok(FitData { trials, cycles, robots })
}

/// The tables that a fit left.
pub(super) fn read_fitted(derived: &Path) -> Result<Fitted, StoreError> {
    let [fits, starts, profiles, bootstrap, comparison, predictions] =
        TABLES.map(|name| derived.join(name));
    Ok(Fitted {
        fits: rows(&fits)?,
        starts: rows(&starts)?,
        profiles: rows(&profiles)?,
        bootstrap: rows(&bootstrap)?,
        comparison: rows(&comparison)?,
        predictions: rows(&predictions)?,
    })
}

fn rows<R: Columns>(path: &Path) -> Result<Vec<R>, StoreError> {
    R::from_table(&Table::read(path)?)
}

impl Fitted {
    fn to_tables(&self) -> [Table; 6] {
        [
            Columns::to_table(&self.fits),
            Columns::to_table(&self.starts),
            Columns::to_table(&self.profiles),
            Columns::to_table(&self.bootstrap),
            Columns::to_table(&self.comparison),
            Columns::to_table(&self.predictions),
        ]
    }
}
