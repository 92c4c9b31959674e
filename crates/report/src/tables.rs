//! What the report is made of: the tables that the stages before it left.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use trilink_tables::{
    BootstrapRow, CheckRow, Columns, ComparisonRow, FitRow, OptimumMapRow, OptimumRow,
    PredictionRow, ProfileRow, Reader, RobotParameterRow, SharedFitRow, StartRow, StoreError,
    Table, TrialRow, is_there,
};

use super::ReportError;
use super::series::Source;
use crate::ReportInput;

/// Tables that are read, and what the report lacks without them, empty of what is only there if it was asked for;
/// it cannot be without the first.
const TABLES: [(&str, &str); 13] = [
    ("trials", "no trial is listed"),
    ("checks", "no check is listed"),
    ("fits", "no model is fitted"),
    ("alternative_fits", "what the other gait input gives is not listed"),
    ("shared_fits", "what campaigns share is not listed"),
    ("predictions", "no model is drawn"),
    ("comparison", "no model is compared"),
    ("starts", "no search is drawn"),
    ("profiles", "no profile is drawn"),
    ("bootstrap", "no replicate is drawn"),
    ("robot_parameters", "no measured parameter of a robot is listed"),
    ("optima", ""),
    ("optimum_maps", ""),
];

/// The tables that are read, where they are there.
pub(crate) fn table_paths(derived: &Path) -> Vec<PathBuf> {
    TABLES.map(|(name, _)| table_path(derived, name)).into()
}

/// Rows of `derived/`.
#[derive(Debug, Default)]
pub(crate) struct Tables {
    /// Fingerprint of the marker files and of all else that the trials were computed from.
    pub input: Option<String>,
    pub trials: Vec<TrialRow>,
    pub checks: Vec<CheckRow>,
    pub fits: Vec<FitRow>,
    /// Driven by the other gait than the configured one.
    pub alternative_fits: Vec<FitRow>,
    /// Of all campaigns of a robot together.
    pub shared_fits: Vec<SharedFitRow>,
    pub predictions: Vec<PredictionRow>,
    pub comparison: Vec<ComparisonRow>,
    pub starts: Vec<StartRow>,
    pub profiles: Vec<ProfileRow>,
    pub bootstrap: Vec<BootstrapRow>,
    /// Of releases and coast-downs.
    pub robots: Vec<RobotParameterRow>,
    /// What `trilink optimise --keep` left.
    pub optima: Vec<OptimumRow>,
    pub optimum_maps: Vec<OptimumMapRow>,
    /// Sentences on tables that are not there.
    pub missing: Vec<String>,
}

impl Tables {
    /// Reads the tables of a folder. Only `trials.parquet` must be there; rows come in the
    /// order of campaign, model and frequency, whatever their order in the files.
    ///
    /// # Errors
    /// There is no `trials.parquet`, or a table cannot be read, has too many rows or lacks a column.
    pub(crate) fn read(derived: &Path, reader: &Reader) -> Result<Self, ReportError> {
        let path = table_path(derived, "trials");
        let Some(trials) = read(derived, reader, "trials")? else {
            return Err(StoreError::NotIngested { path }.into());
        };
        let mut missing = Vec::new();
        for (name, without) in TABLES.iter().filter(|(_, without)| !without.is_empty()) {
            if !is_there(&table_path(derived, name))? {
                missing.push(format!("Table {name}.parquet is not there: {without}."));
            }
        }
        let optima = if_asked(derived, reader, "optima", &mut missing)?;
        let optimum_maps = if_asked(derived, reader, "optimum_maps", &mut missing)?;
        let mut tables = Self {
            input: trials.input.clone(),
            trials: TrialRow::from_table(&trials)?,
            checks: optional(derived, reader, "checks")?,
            fits: optional(derived, reader, "fits")?,
            alternative_fits: optional(derived, reader, "alternative_fits")?,
            shared_fits: optional(derived, reader, "shared_fits")?,
            predictions: optional(derived, reader, "predictions")?,
            comparison: optional(derived, reader, "comparison")?,
            starts: optional(derived, reader, "starts")?,
            profiles: optional(derived, reader, "profiles")?,
            bootstrap: optional(derived, reader, "bootstrap")?,
            robots: optional(derived, reader, "robot_parameters")?,
            optima,
            optimum_maps,
            missing,
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

    pub(crate) fn source<'t>(&'t self, config: &'t ReportInput) -> Source<'t> {
        let (sigma, models) = (config.sigma, config.models());
        let Self { trials, predictions, fits, comparison, .. } = self;
        Source { trials, predictions, fits, comparison, sigma, models }
    }

    /// Whether an optimum is of coefficients that are fitted no more.
    pub(crate) fn is_outdated(&self, optimum: &OptimumRow) -> bool {
        /// Relative difference of numbers that have been written in another unit.
        const SAME: f64 = 1e-9;
        let is_its = |fit: &&FitRow| fit.campaign == optimum.campaign && fit.model == optimum.model;
        self.fits.iter().find(is_its).is_none_or(|fit| {
            let mut both = fit.parameters.iter().zip(optimum.parameters.iter());
            both.any(|((_, of_fit), (_, had))| (of_fit - had).abs() > SAME * of_fit.abs())
        })
    }

    /// The maps of a campaign's optima, without those of coefficients that are fitted no more.
    pub(crate) fn maps_of(&self, campaign: &str) -> impl Iterator<Item = &OptimumMapRow> {
        let best = self.optima.iter().filter(|of| of.rank == 1 && !self.is_outdated(of));
        let known: Vec<_> = best.map(|of| (of.campaign.as_str(), of.model, of.objective)).collect();
        let of_campaign = self.optimum_maps.iter().filter(move |row| row.campaign == campaign);
        of_campaign
            .filter(move |row| known.contains(&(row.campaign.as_str(), row.model, row.objective)))
    }

    /// The fit of the campaign's preferred model.
    pub(crate) fn preferred(&self, campaign: &str) -> Option<&FitRow> {
        let mut compared = self.comparison.iter();
        let row = compared.find(|row| row.campaign == campaign && row.preferred)?;
        self.fits.iter().find(|fit| fit.campaign == campaign && fit.model == row.model)
    }

    /// Campaigns of the configuration and of the tables.
    pub(crate) fn campaigns<'a>(&'a self, config: &'a ReportInput) -> BTreeSet<&'a str> {
        let configured = config.campaigns().keys().map(String::as_str);
        let measured = self.trials.iter().map(|row| row.campaign.as_str());
        let fitted = self.fits.iter().map(|row| row.campaign.as_str());
        configured.chain(measured).chain(fitted).filter(|name| !name.is_empty()).collect()
    }
}

fn table_path(derived: &Path, name: &str) -> PathBuf {
    derived.join(format!("{name}.parquet"))
}

/// A table, if it is there.
fn read(derived: &Path, reader: &Reader, name: &str) -> Result<Option<Table>, ReportError> {
    match reader.bearable_table(&table_path(derived, name)) {
        Err(error) if error.is_not_there() => Ok(None),
        table => Ok(Some(table?)),
    }
}

fn optional<R: Columns>(
    derived: &Path,
    reader: &Reader,
    name: &str,
) -> Result<Vec<R>, ReportError> {
    let table = read(derived, reader, name)?;
    Ok(table.map_or(Ok(Vec::new()), |table| R::from_table(&table))?)
}

/// The rows of a table that no run makes: of another version it is left out.
fn if_asked<R: Columns>(
    derived: &Path,
    reader: &Reader,
    name: &str,
    missing: &mut Vec<String>,
) -> Result<Vec<R>, ReportError> {
    match optional(derived, reader, name) {
        Err(ReportError::Store(error)) if error.is_schema_mismatch() => {
            missing.push(format!("{error}: `trilink optimise --keep` makes it anew."));
            Ok(Vec::new())
        }
        found => found,
    }
}
