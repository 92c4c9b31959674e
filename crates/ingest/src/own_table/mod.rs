//! Reads trials from a user-supplied table: typed in, read off a figure, or written by another program.
//!
//! The columns have the same names as in `trials.parquet`. `campaign`, `omega_rad_s` and one of `d_m` and `v_m_s` are
//! required; all other missing columns count as not measured.

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
    Columns as _, StoreError, Table, TrialRow, TrialStatus, booleans, numbers, texts,
};

use cells::{Cell, Cells};

/// Required columns, each with the words that describe it in messages.
const REQUIRED: [(&str, &str); 2] = [
    ("campaign", "that contains the name of each trial's campaign, as in the configuration"),
    ("omega_rad_s", "that contains each trial's frequency"),
];
/// Maximum number of problems listed; the rest are only counted.
const MAX_LISTED: usize = 200;

/// Trials from a user-supplied table, with the information needed to fit them.
#[derive(Debug)]
pub struct OwnTable {
    pub trials: Vec<TrialRow>,
    /// Notes to the user on how the table was interpreted.
    pub notes: Vec<String>,
    /// Hash of the file's bytes, hexadecimal.
    pub hash: String,
    has_debiased: bool,
}

/// Reason why a user-supplied table cannot be fitted.
#[derive(Debug, thiserror::Error)]
pub enum OwnTableError {
    #[error("{}: cannot be read: {source}", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    #[error(transparent)]
    Store(#[from] StoreError),
    /// All problems found in the table, as one text.
    #[error("{}: {problems}", path.display())]
    Wrong { path: PathBuf, problems: String },
}

impl OwnTableError {
    fn wrong(path: &Path, mut problems: Vec<String>) -> Self {
        let more = problems.len().saturating_sub(MAX_LISTED);
        problems.truncate(MAX_LISTED);
        if more > 0 {
            problems.push(format!("and {more} more"));
        }
        Self::Wrong { path: path.to_owned(), problems: problems.join("\n  ") }
    }
}

/// Problems, each with its row index; `None` if a problem does not belong to a row.
type Problems = Vec<(Option<usize>, String)>;

impl OwnTable {
    /// Reads a CSV or Parquet file. Trials that failed or whose kind is not `gait` are left out.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, or if the table has problems, all of which are listed.
    pub fn read(path: &Path, config: &Config) -> Result<Self, OwnTableError> {
        let cells = Cells::read(path)?;
        let mut problems: Problems =
            cells.problems.iter().map(|problem| (None, problem.clone())).collect();
        let (rows, mut notes) = rows(&cells, &mut problems)?;
        let fitted: Vec<(usize, &TrialRow)> =
            rows.iter().enumerate().filter(|(_, row)| is_fitted(row)).collect();
        check(&fitted, &cells, config, &mut problems);
        problems.extend(units::mistakes(&fitted, config));
        if !problems.is_empty() {
            problems.sort_by_key(|(row, _)| *row);
            let problems = problems.into_iter().map(|(row, problem)| match row {
                Some(row) => format!("{}, {problem}", cells.row_names[row]),
                None => problem,
            });
            return Err(OwnTableError::wrong(path, problems.collect()));
        }
        let all = rows.len();
        let trials: Vec<TrialRow> = rows.into_iter().filter(is_fitted).collect();
        if trials.len() < all {
            let left_out = all - trials.len();
            notes.push(format!(
                "{left_out} rows are left out because their trials failed or are not of kind `gait`"
            ));
        }
        let has_debiased = cells.names.iter().any(|name| name.ends_with("_debiased"));
        Ok(Self { trials, notes, hash: cells.hash, has_debiased })
    }

    /// Returns `config` restricted to the table's campaigns and adapted to the table's content: the commanded gait
    /// drives the models if the measured gait is missing in any trial, the robots' parameters are the configured ones,
    /// and raw skid ratios are used if the table has no debiased ones. Adds notes on the first two of these changes.
    pub fn configure(&mut self, config: &Config) -> Config {
        let mut config = config.clone();
        config.campaign.retain(|name, _| self.trials.iter().any(|trial| trial.campaign == *name));
        let lacking = self.trials.iter().filter(|trial| lacks_gait(trial, &config)).count();
        if lacking > 0 && config.fit.gait_input == GaitInput::Measured {
            config.fit.gait_input = GaitInput::Commanded;
            self.notes.push(format!(
                "the models are driven by the commanded gait, because {lacking} of {} trials have no measured gait",
                self.trials.len()
            ));
        }
        if config.fit.robot_parameters == ParameterSource::Measured {
            config.fit.robot_parameters = ParameterSource::Configured;
            self.notes
                .push("the parameters of the robots are taken from the configuration".to_owned());
        }
        if !self.has_debiased {
            config.fit.sigma = SigmaKind::Raw;
        }
        config
    }
}

fn is_fitted(row: &TrialRow) -> bool {
    row.kind == TrialKind::Gait && row.status.has_metrics()
}

/// Returns whether a commanded joint of a trial has no measured gait.
fn lacks_gait(trial: &TrialRow, config: &Config) -> bool {
    let gait = config.gait[&config.campaign[&trial.campaign].gait].to_gait();
    gait.joints.iter().zip(&trial.gait).any(|(commanded, measured)| {
        let sum = measured.offset_rad + measured.amplitude_rad + measured.phase_rad;
        commanded.is_some() && !sum.is_finite()
    })
}

/// Builds the trial rows and adds the problems of columns and cells to `problems`. Also returns notes on columns with
/// unknown names, which are ignored.
fn rows(
    cells: &Cells,
    problems: &mut Problems,
) -> Result<(Vec<TrialRow>, Vec<String>), OwnTableError> {
    let blank = TrialRow::to_table(&[TrialRow::blank()]).frame;
    let known: Vec<&str> = blank.columns().iter().map(|column| column.name().as_str()).collect();
    let unknown: Vec<&String> =
        cells.names.iter().filter(|name| !known.contains(&name.as_str())).collect();
    let notes = unknown.iter().map(|name| {
        format!("column `{name}` is ignored{}", did_you_mean(name, known.iter().copied()))
    });
    let notes = notes.collect();
    let mut seen = BTreeSet::new();
    for name in cells.names.iter().filter(|name| !seen.insert(*name)) {
        problems.push((
            None,
            format!("column `{name}`: several columns have this name, but names must be unique"),
        ));
    }
    let missing = |name: &str, needed: &str| {
        let meant = nearest(name, unknown.iter().map(|name| name.as_str()));
        let meant = meant.map_or(String::new(), |meant| format!("; is `{meant}` meant?"));
        (None, format!("column `{name}` not found; expected a column {needed}{meant}"))
    };
    for (name, needed) in REQUIRED {
        if !cells.has_column(name) {
            problems.push(missing(name, needed));
        }
    }
    if !cells.has_column("d_m") && !cells.has_column("v_m_s") {
        problems.push(missing("d_m", "`d_m` or `v_m_s`"));
    }
    let count = cells.row_names.len();
    let columns = blank.columns().iter().map(|column| {
        let name = column.name().as_str();
        let Some(index) = cells.names.iter().position(|other| other == name) else {
            return column.new_from_index(0, count);
        };
        let given = &cells.columns[index];
        match column.dtype() {
            DataType::String => {
                let cells = given.iter().enumerate();
                let values: Vec<String> =
                    cells.map(|(row, cell)| text(name, cell, row, problems)).collect();
                texts(name, values.iter().map(String::as_str))
            }
            DataType::Boolean => {
                let cells = given.iter().enumerate();
                booleans(name, cells.map(|(row, cell)| truth(name, cell, row, problems)).collect())
            }
            dtype => {
                let is_whole = dtype.is_integer();
                let cells = given.iter().enumerate();
                let values = cells.map(|(row, cell)| number(name, is_whole, cell, row, problems));
                numbers(name, values.collect())
            }
        }
    });
    let mut rows = TrialRow::from_table(&Table::new(columns.collect()))?;
    for (number, row) in rows.iter_mut().enumerate().filter(|(_, row)| row.trial.is_empty()) {
        row.trial = format!("row-{}", number + 1);
    }
    Ok((rows, notes))
}

/// Returns the text of a cell. A missing or wrong cell yields `gait` in column `kind` and `ok` in column `status`; a
/// wrong cell is added to `problems`.
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

/// Returns the truth value of a cell; `None` if the cell is missing or wrong.
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

/// Returns the numerical value of a cell; NaN if the cell is missing or wrong.
fn number(column: &str, is_whole: bool, cell: &Cell, row: usize, problems: &mut Problems) -> f64 {
    let is_size = column.ends_with("_se")
        || column.ends_with("_amplitude_rad")
        || Metric::from_column(column).is_some_and(|metric| metric.definition().is_size);
    let needed = match (is_whole, is_size, column) {
        (true, ..) => "a whole number",
        (_, _, "omega_rad_s") => NEEDED_OMEGA,
        (_, true, _) => "a non-negative number",
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

/// Checks the rows from which models are to be fitted, given with their row indices, and adds what is wrong to
/// `problems`.
fn check(fitted: &[(usize, &TrialRow)], cells: &Cells, config: &Config, problems: &mut Problems) {
    if fitted.is_empty() && problems.is_empty() {
        problems.push((None, "the table contains no trial that can be fitted".to_owned()));
    }
    // Rows with wrong cells are not checked any further.
    let known_wrong: BTreeSet<usize> = problems.iter().filter_map(|(row, _)| *row).collect();
    let campaigns = config.campaign.keys().map(String::as_str);
    let campaigns: Vec<&str> =
        campaigns.filter(|name| config.chain_notice(name).is_none()).collect();
    let mut unknown: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
    let mut names: BTreeMap<&str, usize> = BTreeMap::new();
    for &(row, trial) in fitted {
        let TrialRow { trial: name, campaign, omega_rad_s, metrics, .. } = trial;
        let mut add = |problem: String| problems.push((Some(row), problem));
        if cells.has_column("campaign") && !campaigns.contains(&campaign.as_str()) {
            unknown.entry(campaign).or_insert((row, 0)).1 += 1;
        }
        if let Some(first) = names.insert(name, row) {
            let other = &cells.row_names[first];
            add(format!(
                "column `trial`: found `{name}`, which is also the name of the trial in {other}"
            ));
        }
        if !is_valid_name(name) {
            let needed = "needed a name that consists of letters, digits, `.`, `_` and `-`";
            add(format!("column `trial`: found `{name}`, {needed}"));
        }
        if known_wrong.contains(&row) {
            continue;
        }
        if cells.has_column("omega_rad_s") && omega_rad_s.is_nan() {
            add("column `omega_rad_s`: the frequency is missing".to_owned());
        }
        let has_metric = metrics.d_m > 0.0 || metrics.v_m_s > 0.0;
        if (cells.has_column("d_m") || cells.has_column("v_m_s")) && !has_metric {
            add("columns `d_m`, `v_m_s`: neither contains a value above 0, but at least one of them must"
                .to_owned());
        }
    }
    for (campaign, (row, count)) in unknown {
        let found = if campaign.is_empty() { "nothing".into() } else { format!("`{campaign}`") };
        let rows = if count > 1 { format!(" in {count} rows") } else { String::new() };
        let meant = did_you_mean(campaign, campaigns.iter().copied());
        let needed = config
            .chain_notice(campaign)
            .unwrap_or_else(|| format!("needed one of {}{meant}", campaigns.join(", ")));
        problems.push((Some(row), format!("column `campaign`: found {found}{rows}, {needed}")));
    }
}
