//! From the tables of `derived/` to tables beside them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::{FitData, Fitted, OnEvent, fit};
use crate::config::Config;
use crate::store::{
    BootstrapRow, ComparisonRow, CycleRow, FitRow, PredictionRow, ProfileRow, Provenance,
    RobotParameterRow, Rows, StartRow, StoreError, Table, TrialRow, cycles_path,
};
use crate::trial::is_valid_id;

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
    let mut input = Input::new(config);
    let trials: Vec<TrialRow> = input.rows(&derived.join("trials.parquet"))?;
    let mut cycles = BTreeMap::new();
    for trial in trials.iter().filter(|trial| is_valid_id(&trial.trial)) {
        let path = cycles_path(derived, &trial.trial);
        if path.exists() {
            cycles.insert(trial.trial.clone(), input.rows::<CycleRow>(&path)?);
        }
    }
    let path = derived.join("robot_parameters.parquet");
    let robots: Vec<RobotParameterRow> =
        if path.exists() { input.rows(&path)? } else { Vec::new() };
    let provenance = input.provenance();
    let fitted = fit(config, &FitData { trials, cycles, robots }, on_event);
    let write = |name: &str, table: Table| {
        let path: PathBuf = derived.join(format!("{name}.parquet"));
        table.write(&path, &provenance)
    };
    write("fits", FitRow::to_table(&fitted.fits))?;
    write("starts", StartRow::to_table(&fitted.starts))?;
    write("profiles", ProfileRow::to_table(&fitted.profiles))?;
    write("bootstrap", BootstrapRow::to_table(&fitted.bootstrap))?;
    write("comparison", ComparisonRow::to_table(&fitted.comparison))?;
    write("predictions", PredictionRow::to_table(&fitted.predictions))?;
    Ok(fitted)
}

/// What is read, and the fingerprint of it and of the keys that a fit reads.
struct Input {
    hash: blake3::Hasher,
}

impl Input {
    fn new(config: &Config) -> Self {
        let keys =
            serde_json::to_vec(&(&config.fit, &config.robot, &config.gait, &config.campaign))
                .expect("a configuration is plain data");
        let mut hash = blake3::Hasher::new();
        hash.update(&keys);
        Self { hash }
    }

    fn rows<R: Rows>(&mut self, path: &Path) -> Result<Vec<R>, StoreError> {
        let bytes = std::fs::read(path)
            .map_err(|source| StoreError::Read { path: path.to_owned(), source })?;
        self.hash.update(&bytes);
        R::from_table(&Table::read(path)?)
    }

    fn provenance(&self) -> Provenance {
        Provenance { input: self.hash.finalize().to_hex().to_string() }
    }
}
