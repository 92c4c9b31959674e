//! What the report is made of: the tables that the stages before it left.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use trilink_tables::{
    BootstrapRow, CheckRow, Columns, Comparison, ComparisonRow, FitRow, OptimumMapRow, OptimumRow,
    PredictionRow, ProfileRow, Reader, RobotParameterRow, SharedFitRow, StartRow, StoreError,
    Table, TrialRow,
};

use super::ReportError;
use super::series::Source;
use crate::ReportInput;

/// Defines the rows of `derived/` by their tables: what the report lacks without each, empty of what is only
/// there if it was asked for.
macro_rules! tables {
    ($($(#[$meta:meta])* $field:ident: $row:ty = $name:literal, $without:literal;)*) => {
        /// Tables that are read beside the first, which must be there.
        const TABLES: &[&str] = &[$($name),*];

        /// Rows of `derived/`.
        #[derive(Debug, Default)]
        pub(crate) struct Tables {
            /// Fingerprint of the marker files and of all else that the trials were computed from.
            pub input: Option<String>,
            pub trials: Vec<TrialRow>,
            $($(#[$meta])* pub $field: Vec<$row>,)*
            /// Sentences on tables that are not there.
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
    checks: CheckRow = "checks", "no check is listed";
    fits: FitRow = "fits", "no model is fitted";
    /// Driven by the other gait than the configured one.
    alternative_fits: FitRow = "alternative_fits", "what the other gait input gives is not listed";
    /// Of all campaigns of a robot together.
    shared_fits: SharedFitRow = "shared_fits", "what campaigns share is not listed";
    predictions: PredictionRow = "predictions", "no model is drawn";
    comparison: ComparisonRow = "comparison", "no model is compared";
    starts: StartRow = "starts", "no search is drawn";
    profiles: ProfileRow = "profiles", "no profile is drawn";
    bootstrap: BootstrapRow = "bootstrap", "no replicate is drawn";
    /// Of releases and coast-downs.
    robots: RobotParameterRow = "robot_parameters", "no measured parameter of a robot is listed";
    /// What `trilink optimise --keep` left.
    optima: OptimumRow = "optima", "";
    optimum_maps: OptimumMapRow = "optimum_maps", "";
}

/// The tables that are read, where they are there.
pub(crate) fn table_paths(derived: &Path) -> Vec<PathBuf> {
    [TRIALS].iter().chain(TABLES).map(|name| table_path(derived, name)).collect()
}

const TRIALS: &str = "trials";

impl Tables {
    /// Reads the tables of a folder. Only `trials.parquet` must be there; rows come in the
    /// order of campaign, model and frequency, whatever their order in the files.
    ///
    /// # Errors
    /// There is no `trials.parquet`, or a table cannot be read, has too many rows or lacks a column.
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

    /// What came out of the comparison of a campaign's models.
    pub(crate) fn compared(&self, campaign: &str) -> Option<Comparison<'_>> {
        let rows = self.comparison.iter().filter(|row| row.campaign == campaign);
        Comparison::new(rows, &self.fits)
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

/// The rows of a table with what the report lacks `without` it. One that no run makes is left out where it is of
/// another version.
fn rows<R: Columns>(
    derived: &Path,
    reader: &Reader,
    (name, without): (&str, &str),
    missing: &mut Vec<String>,
) -> Result<Vec<R>, ReportError> {
    let is_made_by_a_run = !without.is_empty();
    let Some(table) = read(derived, reader, name)? else {
        missing.extend(
            is_made_by_a_run.then(|| format!("Table {name}.parquet is not there: {without}.")),
        );
        return Ok(Vec::new());
    };
    match R::from_table(&table) {
        Err(error) if !is_made_by_a_run && error.is_schema_mismatch() => {
            missing.push(format!("{error}: `trilink optimise --keep` makes it anew."));
            Ok(Vec::new())
        }
        rows => Ok(rows?),
    }
}
