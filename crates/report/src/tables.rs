//! Tables written by the earlier stages, from which the report is made.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use trilink_tables::{
    BootstrapRow, CheckRow, Columns, Comparison, ComparisonRow, FitRow, OptimumMapRow, OptimumRow,
    PrecisionRow, PredictionRow, ProfileRow, Reader, RobotParameterRow, SharedFitRow, StartRow,
    StoreError, Table, TrialRow,
};

use super::ReportError;
use super::series::Source;
use crate::ReportInput;

/// Defines the optional tables that are read from `derived/`: field, type of the rows, name, and a string that says
/// what the report lacks if the table is missing (empty for tables that exist only on request).
macro_rules! tables {
    ($($(#[$meta:meta])* $field:ident: $row:ty = $name:literal, $without:literal;)*) => {
        /// Names of the optional tables, which are read in addition to `trials`.
        const TABLES: &[&str] = &[$($name),*];

        /// Rows of all tables in `derived/`.
        #[derive(Debug, Default)]
        pub(crate) struct Tables {
            /// Fingerprint of all inputs of the trials: marker files, trial lists and configuration. `None` if the
            /// table of trials does not state it.
            pub input: Option<String>,
            pub trials: Vec<TrialRow>,
            $($(#[$meta])* pub $field: Vec<$row>,)*
            /// Sentences that name missing tables and say what the report therefore lacks.
            pub missing: Vec<String>,
        }

        impl Tables {
            fn with_trials(
                trials: &Table,
                derived: &Path,
                reader: &Reader,
            ) -> Result<Self, ReportError> {
                let mut missing = Vec::new();
                Ok(Self {
                    input: trials.input.clone(),
                    trials: TrialRow::from_table(trials)?,
                    $($field: rows(derived, reader, ($name, $without), &mut missing)?,)*
                    missing,
                })
            }
        }
    };
}

tables! {
    checks: CheckRow = "checks", "the checks are not listed in this report";
    fits: FitRow = "fits", "no model is fitted";
    /// Fits with the alternative gait input (measured instead of commanded gait, or vice versa).
    alternative_fits: FitRow = "alternative_fits", "the fits with the other gait input are not listed";
    /// Fits of a model to all campaigns of a robot, or of robots with common wheels, together.
    shared_fits: SharedFitRow = "shared_fits", "the shared fits of campaigns are not listed";
    predictions: PredictionRow = "predictions", "no model is drawn";
    comparison: ComparisonRow = "comparison", "no model is compared";
    precision: PrecisionRow = "precision", "the repeatability of the metrics is not listed";
    starts: StartRow = "starts", "no search is drawn";
    profiles: ProfileRow = "profiles", "no profile is drawn";
    bootstrap: BootstrapRow = "bootstrap", "no replicate is drawn";
    /// Robot parameters measured in joint-release and coast-down trials.
    robots: RobotParameterRow = "robot_parameters", "the measured robot parameters are not listed in this report";
    /// Optimal gaits stored by `trilink optimise --keep`.
    optima: OptimumRow = "optima", "";
    optimum_maps: OptimumMapRow = "optimum_maps", "";
}

/// Returns the paths of all tables that the report reads, whether or not the files exist.
pub(crate) fn table_paths(derived: &Path) -> Vec<PathBuf> {
    [TRIALS, RESIDUALS].iter().chain(TABLES).map(|name| table_path(derived, name)).collect()
}

const TRIALS: &str = "trials";
/// Table that the report's comparison with the baseline reads.
const RESIDUALS: &str = "residuals";

impl Tables {
    /// Reads the tables in the folder `derived` and sorts the rows by campaign, model and frequency. Only
    /// `trials.parquet` must exist.
    ///
    /// # Errors
    /// Returns an error if `trials.parquet` does not exist, or if a table cannot be read, has too many rows or lacks a
    /// column.
    pub(crate) fn read(derived: &Path, reader: &Reader) -> Result<Self, ReportError> {
        let path = table_path(derived, TRIALS);
        let Some(trials) = read(derived, reader, TRIALS)? else {
            return Err(StoreError::NotIngested { path }.into());
        };
        let mut tables = Self::with_trials(&trials, derived, reader)?;
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

    /// Returns the tables from which quantities are plotted against frequency.
    pub(crate) fn source<'t>(&'t self, config: &'t ReportInput) -> Source<'t> {
        let sigma = config.sigma;
        let Self { trials, predictions, fits, comparison, .. } = self;
        Source { trials, predictions, fits, comparison, sigma, input: config }
    }

    /// Returns whether an optimum is outdated, that is, computed with coefficients other than those of the current fit.
    pub(crate) fn is_outdated(&self, optimum: &OptimumRow) -> bool {
        /// Maximum relative difference that is attributed to rounding in a conversion to another unit and back.
        const SAME: f64 = 1e-9;
        self.fits
            .iter()
            .find(|fit| fit.campaign == optimum.campaign && fit.model == optimum.model)
            .is_none_or(|fit| {
                let mut both = fit.parameters.iter().zip(optimum.parameters.iter());
                both.any(|((_, of_fit), (_, had))| (of_fit - had).abs() > SAME * of_fit.abs())
            })
    }

    /// Returns the rows of `optimum_maps` that belong to a campaign's optima, except those of outdated optima.
    pub(crate) fn maps_of(&self, campaign: &str) -> impl Iterator<Item = &OptimumMapRow> {
        let best = self.optima.iter().filter(|of| of.rank == 1 && !self.is_outdated(of));
        let known: Vec<_> = best.map(|of| (of.campaign.as_str(), of.model, of.objective)).collect();
        let of_campaign = self.optimum_maps.iter().filter(move |row| row.campaign == campaign);
        of_campaign
            .filter(move |row| known.contains(&(row.campaign.as_str(), row.model, row.objective)))
    }

    /// Returns the fit of a campaign's preferred model; `None` if no model is preferred.
    pub(crate) fn preferred(&self, campaign: &str) -> Option<&FitRow> {
        let mut compared = self.comparison.iter();
        let row = compared.find(|row| row.campaign == campaign && row.preferred)?;
        self.fits.iter().find(|fit| fit.campaign == campaign && fit.model == row.model)
    }

    /// Returns the result of comparing the models fitted to a campaign; `None` if they were not compared.
    pub(crate) fn compared(&self, campaign: &str) -> Option<Comparison<'_>> {
        let rows = self.comparison.iter().filter(|row| row.campaign == campaign);
        Comparison::new(rows, &self.fits)
    }

    /// Returns the names of all campaigns that occur in the configuration or the tables.
    pub(crate) fn campaigns<'a>(&'a self, config: &'a ReportInput) -> BTreeSet<&'a str> {
        let configured = config.campaigns();
        let measured = self.trials.iter().map(|row| row.campaign.as_str());
        let fitted = self.fits.iter().map(|row| row.campaign.as_str());
        configured.chain(measured).chain(fitted).filter(|name| !name.is_empty()).collect()
    }
}

fn table_path(derived: &Path, name: &str) -> PathBuf {
    derived.join(format!("{name}.parquet"))
}

/// Reads a table by name; returns `None` if the file does not exist.
fn read(derived: &Path, reader: &Reader, name: &str) -> Result<Option<Table>, ReportError> {
    match reader.bounded_table(&table_path(derived, name)) {
        Err(error) if error.is_not_there() => Ok(None),
        table => Ok(Some(table?)),
    }
}

/// Reads the rows of a table. If the table does not exist, a sentence that says what the report lacks (`without`) is
/// appended to `missing`.
///
/// A table that exists only on request (its `without` is empty) is skipped if another version of `trilink` wrote it.
fn rows<R: Columns>(
    derived: &Path,
    reader: &Reader,
    (name, without): (&str, &str),
    missing: &mut Vec<String>,
) -> Result<Vec<R>, ReportError> {
    let is_regular = !without.is_empty();
    let Some(table) = read(derived, reader, name)? else {
        missing
            .extend(is_regular.then(|| format!("Table {name}.parquet does not exist: {without}.")));
        return Ok(Vec::new());
    };
    match R::from_table(&table) {
        Err(error) if !is_regular && error.is_schema_mismatch() => {
            missing.push(format!("{error}: run `trilink optimise --keep` again."));
            Ok(Vec::new())
        }
        rows => Ok(rows?),
    }
}
