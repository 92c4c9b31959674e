//! What the report is made of: the tables that the stages before it left.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::ReportError;
use super::series::Source;
use crate::report::ReportInput;
use crate::store::{
    BootstrapRow, CheckRow, Columns, ComparisonRow, FitRow, PredictionRow, ProfileRow, Reader,
    RobotParameterRow, StartRow, StoreError, TrialRow,
};

/// Tables that are read, and what the report lacks without one; it cannot be without the first.
const TABLES: [(&str, &str); 10] = [
    ("trials", "no trial is listed"),
    ("checks", "no check is listed"),
    ("fits", "no model is fitted"),
    ("alternative_fits", "what the other gait input gives is not listed"),
    ("predictions", "no model is drawn"),
    ("comparison", "no model is compared"),
    ("starts", "no search is drawn"),
    ("profiles", "no profile is drawn"),
    ("bootstrap", "no replicate is drawn"),
    ("robot_parameters", "no measured parameter of a robot is listed"),
];

/// The tables that are read, where they are there.
pub fn table_paths(derived: &Path) -> Vec<PathBuf> {
    TABLES.map(|(name, _)| table_path(derived, name)).into()
}

/// Rows of `derived/`.
#[derive(Debug, Default)]
pub struct Tables {
    /// Fingerprint of the marker files and of all else that the trials were computed from.
    pub input: Option<String>,
    pub trials: Vec<TrialRow>,
    pub checks: Vec<CheckRow>,
    pub fits: Vec<FitRow>,
    /// Driven by the other gait than the configured one.
    pub alternative_fits: Vec<FitRow>,
    pub predictions: Vec<PredictionRow>,
    pub comparison: Vec<ComparisonRow>,
    pub starts: Vec<StartRow>,
    pub profiles: Vec<ProfileRow>,
    pub bootstrap: Vec<BootstrapRow>,
    /// Of releases and coast-downs.
    pub robots: Vec<RobotParameterRow>,
    /// Sentences on tables that are not there.
    pub missing: Vec<String>,
}

impl Tables {
    /// Reads the tables of a folder. Only `trials.parquet` must be there; rows come in the
    /// order of campaign, model and frequency, whatever their order in the files.
    ///
    /// # Errors
    /// There is no `trials.parquet`, or a table cannot be read or lacks a column.
    pub fn read(derived: &Path, reader: &Reader) -> Result<Self, ReportError> {
        let path = table_path(derived, "trials");
        let trials = match reader.table(&path) {
            Err(error) if error.is_not_there() => {
                return Err(StoreError::NotIngested { path }.into());
            }
            trials => trials?,
        };
        let missing = TABLES.iter().filter(|(name, _)| !table_path(derived, name).exists());
        let mut tables = Self {
            input: trials.input.clone(),
            trials: TrialRow::from_table(&trials)?,
            checks: optional(derived, reader, "checks")?,
            fits: optional(derived, reader, "fits")?,
            alternative_fits: optional(derived, reader, "alternative_fits")?,
            predictions: optional(derived, reader, "predictions")?,
            comparison: optional(derived, reader, "comparison")?,
            starts: optional(derived, reader, "starts")?,
            profiles: optional(derived, reader, "profiles")?,
            bootstrap: optional(derived, reader, "bootstrap")?,
            robots: optional(derived, reader, "robot_parameters")?,
            missing: missing
                .map(|(name, without)| format!("Table {name}.parquet is not there: {without}."))
                .collect(),
        };
        tables.trials.sort_by(|a, b| {
            let key =
                |row: &TrialRow| (row.campaign.is_empty(), row.campaign.clone(), row.kind.name());
            key(a)
                .cmp(&key(b))
                .then(a.omega_commanded_rad_s.total_cmp(&b.omega_commanded_rad_s))
                .then_with(|| a.trial.cmp(&b.trial))
        });
        for fits in [&mut tables.fits, &mut tables.alternative_fits] {
            fits.sort_by(|a, b| (&a.campaign, a.model).cmp(&(&b.campaign, b.model)));
        }
        Ok(tables)
    }

    pub fn source(&self, config: &ReportInput) -> Source<'_> {
        let sigma = config.sigma;
        Source { trials: &self.trials, predictions: &self.predictions, sigma }
    }

    /// Campaigns of the configuration and of the tables.
    pub fn campaigns<'a>(&'a self, config: &'a ReportInput) -> BTreeSet<&'a str> {
        let configured = config.campaign.keys().map(String::as_str);
        let measured = self.trials.iter().map(|row| row.campaign.as_str());
        let fitted = self.fits.iter().map(|row| row.campaign.as_str());
        configured.chain(measured).chain(fitted).filter(|name| !name.is_empty()).collect()
    }
}

fn table_path(derived: &Path, name: &str) -> PathBuf {
    derived.join(format!("{name}.parquet"))
}

fn optional<R: Columns>(
    derived: &Path,
    reader: &Reader,
    name: &str,
) -> Result<Vec<R>, ReportError> {
    Ok(reader.rows_if_there(&table_path(derived, name))?.unwrap_or_default())
}
