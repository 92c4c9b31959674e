//! Trials of a table that was made elsewhere: typed in, read off a figure, or of another program.
//!
//! Its columns have the names that `trials.parquet` gives them. It needs `campaign`, `omega_rad_s`
//! and one of `d_m` and `v_m_s`; what else is not there was not measured.

mod cells;
mod units;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use polars::prelude::DataType;
use trilink_base::Named;
use trilink_robot::metrics::Metric;
use trilink_tables::config::{
    Config, GaitInput, ParameterSource, SigmaKind, did_you_mean, nearest,
};
use trilink_tables::trial::{NEEDED_OMEGA, OMEGA_RAD_S, TrialKind, is_valid_name};
use trilink_tables::{
    Columns as _, StoreError, Table, TrialRow, TrialStatus, numbers, texts, truths,
};

use cells::{Cell, Cells};

/// What a fit cannot do without.
const NEEDED: [(&str, &str); 2] = [
    ("campaign", "the name that the trial's campaign has in the configuration"),
    ("omega_rad_s", "the trial's frequency"),
];
/// Mistakes that are named; the others are counted.
const MOST_NAMED: usize = 200;

/// The trials of a table, and how they are fitted.
#[derive(Debug)]
pub struct OwnTable {
    pub trials: Vec<TrialRow>,
    /// What a person should know of how it was read.
    pub notes: Vec<String>,
    /// Of the file's bytes.
    pub hash: String,
    has_debiased: bool,
}

/// Why a table cannot be fitted.
#[derive(Debug, thiserror::Error)]
pub enum OwnTableError {
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Store(#[from] StoreError),
    /// All that is wrong with it.
    #[error("{}: {problems}", path.display())]
    Wrong { path: PathBuf, problems: String },
}

impl OwnTableError {
    fn wrong(path: &Path, mut problems: Vec<String>) -> Self {
        let more = problems.len().saturating_sub(MOST_NAMED);
        problems.truncate(MOST_NAMED);
        if more > 0 {
            problems.push(format!("and {more} more"));
        }
        Self::Wrong { path: path.to_owned(), problems: problems.join("\n  ") }
    }
}

/// What is wrong, with the row where it is.
type Problems = Vec<(Option<usize>, String)>;

impl OwnTable {
    /// Reads CSV or Parquet. Trials that failed or are not of kind `gait` are left out.
    ///
    /// # Errors
    /// The file cannot be read; or all that is wrong with it.
    pub fn read(path: &Path, config: &Config) -> Result<Self, OwnTableError> {
        let cells = Cells::read(path)?;
        let mut problems: Problems = cells.problems.iter().map(|of| (None, of.clone())).collect();
        let (rows, mut notes) = rows(&cells, &mut problems)?;
        let is_fitted =
            |row: &TrialRow| row.kind == TrialKind::Gait && row.status != TrialStatus::Failed;
        let fitted = rows.iter().enumerate().filter(|(_, row)| is_fitted(row));
        let fitted: Vec<_> = fitted.collect();
        check(&fitted, &cells, config, &mut problems);
        problems.extend(units::mistakes(&fitted, config));
        if !problems.is_empty() {
            problems.sort_by_key(|(row, _)| *row);
            let problems = problems.into_iter().map(|(row, problem)| match row {
                Some(row) => format!("{}, {problem}", cells.places[row]),
                None => problem,
            });
            return Err(OwnTableError::wrong(path, problems.collect()));
        }
        let all = rows.len();
        let trials: Vec<TrialRow> = rows.into_iter().filter(is_fitted).collect();
        if trials.len() < all {
            let left_out = all - trials.len();
            notes.push(format!("{left_out} rows are left out: failed, or not of kind gait"));
        }
        let has_debiased = cells.names.iter().any(|name| name.ends_with("_debiased"));
        Ok(Self { trials, notes, hash: cells.hash, has_debiased })
    }

    /// The configuration of its campaigns, such that nothing is asked for that no table of trials
    /// has: the command drives the models where the gait of a trial was not measured.
    pub fn configure(&mut self, config: &Config) -> Config {
        let mut config = config.clone();
        config.campaign.retain(|name, _| self.trials.iter().any(|of| of.campaign == *name));
        let lacks_gait = |trial: &TrialRow| {
            let gait = config.gait[&config.campaign[&trial.campaign].gait].to_gait();
            let both = gait.joints.iter().zip(&trial.gait);
            both.into_iter().any(|(commanded, measured)| {
                let [offset, amplitude, phase] =
                    [measured.offset_rad, measured.amplitude_rad, measured.phase_rad];
                commanded.is_some() && !(offset + amplitude + phase).is_finite()
            })
        };
        let lacking = self.trials.iter().filter(|trial| lacks_gait(trial)).count();
        if lacking > 0 && config.fit.gait_input == GaitInput::Measured {
            config.fit.gait_input = GaitInput::Commanded;
            self.notes.push(format!(
                "the commanded gait drives the models: {lacking} of {} trials have no measured one",
                self.trials.len()
            ));
        }
        if config.fit.robot_parameters == ParameterSource::Measured {
            config.fit.robot_parameters = ParameterSource::Configured;
            self.notes.push("the robots' parameters are those of the configuration".to_owned());
        }
        if !self.has_debiased {
            config.fit.sigma = SigmaKind::Raw;
        }
        config
    }
}

/// The rows of a table; its columns that nobody knows are notes.
fn rows(
    cells: &Cells,
    problems: &mut Problems,
) -> Result<(Vec<TrialRow>, Vec<String>), OwnTableError> {
    let blank = TrialRow::to_table(&[TrialRow::blank()]).frame;
    let known: Vec<&str> = blank.columns().iter().map(|column| column.name().as_str()).collect();
    let is_unknown = |name: &&String| !known.contains(&name.as_str());
    let unknown: Vec<&String> = cells.names.iter().filter(is_unknown).collect();
    let note = |name: &&String| {
        format!("column `{name}` is not read{}", did_you_mean(name, known.iter().copied()))
    };
    let notes = unknown.iter().map(note).collect();
    let mut seen = BTreeSet::new();
    for name in cells.names.iter().filter(|name| !seen.insert(*name)) {
        problems.push((None, format!("column `{name}`: found two of them, needed one")));
    }
    let missing = |name: &str, needed: &str| {
        let meant = nearest(name, unknown.iter().map(|name| name.as_str()));
        let meant = meant.map_or(String::new(), |meant| format!("; is it `{meant}`?"));
        (None, format!("column `{name}`: found no such column, needed {needed}{meant}"))
    };
    let is_there = |name: &str| cells.names.iter().any(|other| other == name);
    let gone = NEEDED.iter().filter(|(name, _)| !is_there(name));
    problems.extend(gone.map(|(name, needed)| missing(name, needed)));
    if !is_there("d_m") && !is_there("v_m_s") {
        problems.push(missing("d_m", "it or `v_m_s`"));
    }
    let count = cells.places.len();
    let columns = blank.columns().iter().map(|column| {
        let name = column.name().as_str();
        let Some(index) = cells.names.iter().position(|other| other == name) else {
            return column.new_from_index(0, count);
        };
        let given = &cells.columns[index];
        match column.dtype() {
            DataType::String => {
                let texts_of: Vec<String> = given
                    .iter()
                    .enumerate()
                    .map(|(row, cell)| text(name, cell, row, problems))
                    .collect();
                texts(name, texts_of.iter().map(String::as_str))
            }
            DataType::Boolean => {
                let truths_of = given.iter().enumerate();
                truths(
                    name,
                    truths_of.map(|(row, cell)| truth(name, cell, row, problems)).collect(),
                )
            }
            dtype => {
                let is_whole = dtype.is_integer();
                let numbers_of = given.iter().enumerate();
                let numbers_of =
                    numbers_of.map(|(row, cell)| number(name, is_whole, cell, row, problems));
                numbers(name, numbers_of.collect())
            }
        }
    });
    let mut rows = TrialRow::from_table(&Table::new(columns.collect()))?;
    for (number, row) in rows.iter_mut().enumerate().filter(|(_, row)| row.trial.is_empty()) {
        row.trial = format!("row-{}", number + 1);
    }
    Ok((rows, notes))
}

/// The text of a cell; what has to be one of some names has the first where it is missing or wrong.
fn text(column: &str, cell: &Cell, row: usize, problems: &mut Problems) -> String {
    let text = match cell {
        Cell::Missing => String::new(),
        Cell::Number(_, text) | Cell::Text(text) => text.clone(),
    };
    let (names, first): (Vec<&str>, &str) = match column {
        "kind" => (TrialKind::ALL.iter().map(Named::as_name).collect(), TrialKind::Gait.as_name()),
        "status" => {
            (TrialStatus::ALL.iter().map(Named::as_name).collect(), TrialStatus::Ok.as_name())
        }
        _ => return text,
    };
    if names.contains(&text.as_str()) {
        return text;
    }
    if !text.is_empty() {
        let needed = names.join(", ");
        problems.push((Some(row), format!("column `{column}`: found `{text}`, needed {needed}")));
    }
    first.to_owned()
}

/// Whether a cell says yes or no; neither where it is missing or wrong.
fn truth(column: &str, cell: &Cell, row: usize, problems: &mut Problems) -> Option<bool> {
    let found = match cell {
        Cell::Missing => return None,
        Cell::Number(_, text) | Cell::Text(text) => text,
    };
    let truth = found.to_lowercase().parse().ok();
    if truth.is_none() {
        let needed = "needed true or false";
        problems.push((Some(row), format!("column `{column}`: found `{found}`, {needed}")));
    }
    truth
}

/// The number of a cell; NaN where it is missing or wrong.
fn number(column: &str, is_whole: bool, cell: &Cell, row: usize, problems: &mut Problems) -> f64 {
    let is_size = column.ends_with("_se")
        || column.ends_with("_amplitude_rad")
        || Metric::of_column(column).is_some_and(|metric| metric.definition().is_size);
    let needed = match (is_whole, is_size, column) {
        (true, ..) => "a whole number",
        (_, _, "omega_rad_s") => NEEDED_OMEGA,
        (_, true, _) => "a number that is not below 0",
        _ => "a number",
    };
    let is_right = |number: f64| {
        number.is_finite()
            && !(is_whole && (number.fract() != 0.0 || number < 0.0))
            && !(is_size && number < 0.0)
            && (column != "omega_rad_s" || OMEGA_RAD_S.contains(&number))
    };
    let found = match cell {
        Cell::Missing => return f64::NAN,
        Cell::Number(number, _) if is_right(*number) => return *number,
        Cell::Number(_, text) | Cell::Text(text) => text.clone(),
    };
    problems.push((Some(row), format!("column `{column}`: found `{found}`, needed {needed}")));
    f64::NAN
}

/// Finds what is wrong with the rows that are to be fitted.
fn check(fitted: &[(usize, &TrialRow)], cells: &Cells, config: &Config, problems: &mut Problems) {
    if fitted.is_empty() && problems.is_empty() {
        problems.push((None, "found no trial, needed a row at least".to_owned()));
    }
    let is_there = |name: &str| cells.names.iter().any(|other| other == name);
    // What is wrong with a cell is not said of its row, too.
    let known_wrong: BTreeSet<usize> = problems.iter().filter_map(|(row, _)| *row).collect();
    let campaigns: Vec<&str> = config.campaign.keys().map(String::as_str).collect();
    let mut unknown: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
    let mut names: BTreeMap<&str, usize> = BTreeMap::new();
    for &(row, trial) in fitted {
        let TrialRow { trial: name, campaign, omega_rad_s, metrics, .. } = trial;
        let mut add = |problem: String| problems.push((Some(row), problem));
        if is_there("campaign") && !config.campaign.contains_key(campaign) {
            unknown.entry(campaign).or_insert((row, 0)).1 += 1;
        }
        if let Some(first) = names.insert(name, row) {
            let found = format!("the name of {}, too", cells.places[first]);
            add(format!("column `trial`: found `{name}`, {found}, needed another one"));
        }
        if !is_valid_name(name) {
            let needed = "needed letters, digits, `.`, `_`, `-`";
            add(format!("column `trial`: found `{name}`, {needed}"));
        }
        if known_wrong.contains(&row) {
            continue;
        }
        if is_there("omega_rad_s") && omega_rad_s.is_nan() {
            add("column `omega_rad_s`: found nothing, needed a frequency".to_owned());
        }
        let has_metric = metrics.d_m > 0.0 || metrics.v_m_s > 0.0;
        if (is_there("d_m") || is_there("v_m_s")) && !has_metric {
            add("columns `d_m`, `v_m_s`: found nothing above 0, needed one of them".to_owned());
        }
    }
    for (campaign, (row, count)) in unknown {
        let found = if campaign.is_empty() { "nothing".into() } else { format!("`{campaign}`") };
        let rows = if count > 1 { format!(" in {count} rows") } else { String::new() };
        let meant = did_you_mean(campaign, campaigns.iter().copied());
        let needed = format!("needed one of {}{meant}", campaigns.join(", "));
        problems.push((Some(row), format!("column `campaign`: found {found}{rows}, {needed}")));
    }
}
