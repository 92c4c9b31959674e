//! Fits to a table of trials that another program produced.

use std::collections::BTreeMap;
use std::path::Path;

use trilink_fit::{FitData, Fitted, TABLES};
use trilink_ingest::own_table::OwnTable;
use trilink_tables::config::Config;
use trilink_tables::{Columns as _, Provenance, TrialRow};

use super::fit::FitStage;
use super::lock::hold_places;
use super::plan::hash_of;
use super::record::RECORD_FILE;
use super::steps::Steps;
use super::target::Key;
use super::{RunError, Watch};

const TRIALS: &str = "trials.parquet";

/// Fits every model to the campaigns in a table of trials that another program produced, and writes the tables of fits
/// and trials to the folder `home`. Results of an ingest are not changed.
///
/// # Errors
/// Returns an error if the table cannot be fitted, if `home` has tables of an ingest, if a table cannot be written,
/// or if another fit uses `home`.
pub fn fit_own_table(
    config: &Config,
    table: &Path,
    home: &Path,
    wait: bool,
    watch: &dyn Watch,
) -> Result<(OwnTable, Fitted), RunError> {
    // Every ingest writes both files.
    let is_of_ingest = [RECORD_FILE, "checks.parquet"].iter().any(|name| home.join(name).exists());
    if is_of_ingest || home == config.paths.derived {
        return Err(RunError::OwnTablePlace { home: home.to_owned() });
    }
    let mut own = OwnTable::read(table, config)?;
    let stage = FitStage::new(&own.configure(config));
    own.notes.iter().for_each(|note| watch.note(note));
    let files: Vec<_> = TABLES.iter().chain([&TRIALS]).map(|name| home.join(name)).collect();
    let _lock = hold_places(&[home.to_owned()], &files, wait, watch)?;
    let data = FitData::from(own.trials.clone());
    let specs = stage.specs_with(None);
    let steps = Steps::begin::<FitStage>(watch, specs.len(), "");
    let fitted = stage.fit(&data, BTreeMap::new(), &steps, &|_, _| {});
    let fitted = steps.end::<FitStage, _>(fitted)?;
    let settings: Vec<Key> = specs.into_iter().map(|spec| spec.key).collect();
    let provenance = Provenance { input: hash_of(&(&own.hash, settings)) };
    fitted.write(home, &provenance)?;
    TrialRow::to_table(&own.trials).write_if_changed(&home.join(TRIALS), &provenance)?;
    Ok((own, fitted))
}
