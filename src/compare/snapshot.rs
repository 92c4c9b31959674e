//! What a run came to, as far as it is compared: one file that can be kept.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use super::CompareError;
use crate::robot::Parameter;
use crate::store::{Column, StoreError, Table, write_bytes};

/// Tables whose rows are compared, and the columns that name a row.
const TABLES: [(&str, &[&str]); 3] =
    [("trials", &["trial"]), ("fits", &["campaign", "model"]), ("robot_parameters", &["trial"])];
const PREDICTIONS: &str = "predictions";
/// A trial's frequency is the commanded one to this part of it.
const NEAR: f64 = 0.05;
const FORMAT: u32 = 1;

/// A cell that is compared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell {
    Number(f64),
    Text(String),
    Missing(()),
}

impl Cell {
    /// As a number, if it is one.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Number(number) => Some(*number),
            _ => None,
        }
    }
}

/// Cells by column.
pub type Record = BTreeMap<String, Cell>;
/// Records by what names them, such as a trial.
pub type Records = BTreeMap<String, Record>;

/// That somebody took a run for the new baseline.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Acceptance {
    /// UTC.
    pub time: String,
    pub reason: String,
    /// Differences out of tolerance that were accepted.
    pub differences: usize,
}

/// What a run came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    pub format: u32,
    pub version: String,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub accepted: Vec<Acceptance>,
    /// Seconds by stage.
    #[serde(default)]
    pub stages: BTreeMap<String, f64>,
    pub tables: BTreeMap<String, Records>,
}

impl Snapshot {
    /// Reads a baseline: a file that was saved, or a folder of tables.
    ///
    /// # Errors
    /// There is none, or it cannot be read.
    pub fn load(path: &Path) -> Result<Self, CompareError> {
        if path.is_dir() {
            let inner = path.join("derived");
            let derived = if inner.is_dir() { inner } else { path.to_owned() };
            let reports = derived.parent().unwrap_or(Path::new("")).join("reports");
            return Self::of_run(&derived, &reports);
        }
        let error = |message: String| CompareError::Baseline { path: path.to_owned(), message };
        let text = std::fs::read_to_string(path).map_err(|source| match source.kind() {
            std::io::ErrorKind::NotFound => {
                error("is not there; `trilink compare --save FILE` makes one".to_owned())
            }
            _ => error(format!("cannot be read: {source}")),
        })?;
        let found: Self = serde_json::from_str(&text)
            .map_err(|problem| error(format!("is no baseline: {problem}")))?;
        match found.format {
            FORMAT => Ok(found),
            other => Err(error(format!("has format {other}, needed {FORMAT}"))),
        }
    }

    /// Reads the tables of a run, and what its reports say of its time and score.
    ///
    /// # Errors
    /// `trials.parquet` is not there, or a table cannot be read.
    pub fn of_run(derived: &Path, reports: &Path) -> Result<Self, CompareError> {
        let mut tables = BTreeMap::new();
        for (name, key) in TABLES {
            let path = derived.join(format!("{name}.parquet"));
            if name == "trials" || path.exists() {
                let found = records(&Table::read(&path)?, key)?;
                let found = if name == "fits" { with_intervals(found) } else { found };
                tables.insert(name.to_owned(), found);
            }
        }
        let path = derived.join(format!("{PREDICTIONS}.parquet"));
        if path.exists() {
            let trials = tables.get("trials");
            let found = predictions(&Table::read(&path)?, trials.unwrap_or(&Records::new()))?;
            tables.insert(PREDICTIONS.to_owned(), found);
        }
        if let Some(scorecard) = json(&reports.join("scorecard.json"))? {
            tables.insert("scorecard".to_owned(), score(&scorecard));
        }
        let stages = json(&reports.join("run.json"))?.map_or(BTreeMap::new(), |run| stages(&run));
        let version = env!("CARGO_PKG_VERSION").to_owned();
        Ok(Self { format: FORMAT, version, accepted: Vec::new(), stages, tables })
    }

    /// Writes it whole or not at all; a record a line, so that versions of it can be told apart.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), CompareError> {
        let line = |value: &dyn erased::Line| value.line();
        let mut text = format!(
            "{{\"format\":{},\n\"version\":{},\n\"accepted\":{},\n\"stages\":{},\n\"tables\":{{",
            self.format,
            line(&self.version),
            line(&self.accepted),
            line(&self.stages)
        );
        for (i, (name, records)) in self.tables.iter().enumerate() {
            text += if i == 0 { "\n" } else { ",\n" };
            text += &format!("{}:{{", line(name));
            for (i, (key, record)) in records.iter().enumerate() {
                text += if i == 0 { "\n" } else { ",\n" };
                text += &format!("{}:{}", line(key), line(record));
            }
            text += "}";
        }
        text += "}}\n";
        write_bytes(path, text.as_bytes())?;
        Ok(())
    }

    /// Records of a table; none if it is not there.
    pub fn records(&self, table: &str) -> &Records {
        static NONE: Records = Records::new();
        self.tables.get(table).unwrap_or(&NONE)
    }
}

/// Anything as a line of JSON.
mod erased {
    pub(super) trait Line {
        fn line(&self) -> String;
    }

    impl<T: serde::Serialize> Line for T {
        fn line(&self) -> String {
            serde_json::to_string(self).expect("a snapshot is plain data")
        }
    }
}

/// The cells of one row.
fn record(table: &Table, row: usize) -> Record {
    let columns = table.columns().iter().filter_map(|(name, column)| {
        let cell = match column {
            Column::F64(values) if values[row].is_nan() => Cell::Missing(()),
            Column::F64(values) => Cell::Number(values[row]),
            Column::I64(values) => Cell::Number(values[row] as f64),
            Column::Bool(values) => Cell::Text(values[row].to_string()),
            Column::Str(values) => Cell::Text(values[row].clone()),
            Column::StrList(values) => Cell::Text(values[row].join(", ")),
            Column::Names(..) => return None,
        };
        Some((name.clone(), cell))
    });
    columns.collect()
}

fn records(table: &Table, key: &[&str]) -> Result<Records, StoreError> {
    let keys = key.iter().map(|name| table.str(name)).collect::<Result<Vec<_>, _>>()?;
    let row = |row: usize| {
        let key: Vec<&str> = keys.iter().map(|column| column[row].as_str()).collect();
        (key.join(" "), record(table, row))
    };
    Ok((0..table.len()).map(row).collect())
}

/// Adds the widths of the fitted parameters' intervals.
fn with_intervals(mut fits: Records) -> Records {
    for fit in fits.values_mut() {
        for parameter in Parameter::ALL.map(Parameter::column) {
            let limit = |end: &str| fit.get(&format!("{parameter}_{end}"))?.number();
            if let Some((low, high)) = limit("lo").zip(limit("hi")) {
                fit.insert(format!("interval_{parameter}"), Cell::Number(high - low));
            }
        }
    }
    fits
}

/// Predictions at the trials' frequencies, named by the commanded ones: measured ones differ from
/// run to run.
fn predictions(table: &Table, trials: &Records) -> Result<Records, StoreError> {
    let [campaign, model, source] =
        [table.str("campaign")?, table.str("model")?, table.str("source")?];
    let omega = table.f64("omega_rad_s")?;
    let mut found = Records::new();
    for row in (0..table.len()).filter(|&row| source[row] == "trial") {
        let of_campaign = trials
            .values()
            .filter(|trial| trial.get("campaign") == Some(&Cell::Text(campaign[row].clone())));
        let commanded = of_campaign
            .filter_map(|trial| trial.get("omega_commanded_rad_s")?.number())
            .min_by(|a, b| (a - omega[row]).abs().total_cmp(&(b - omega[row]).abs()))
            .filter(|near| (near - omega[row]).abs() <= NEAR * omega[row]);
        let rad_s = commanded.unwrap_or(omega[row]);
        let name = format!("{} {} {rad_s:.2} rad/s", campaign[row], model[row]);
        // Repeated trials may have a row each.
        let numbered = (2..).map(|i| format!("{name} ({i})"));
        let mut names = std::iter::once(name.clone()).chain(numbered);
        if let Some(free) = names.find(|name| !found.contains_key(name)) {
            found.insert(free, record(table, row));
        }
    }
    Ok(found)
}

fn json(path: &PathBuf) -> Result<Option<Json>, CompareError> {
    let error = |message| CompareError::Baseline { path: path.clone(), message };
    match std::fs::read_to_string(path) {
        Err(source) if source.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(source) => Err(error(format!("cannot be read: {source}"))),
        Ok(text) => serde_json::from_str(&text)
            .map(Some)
            .map_err(|problem| error(format!("is no JSON: {problem}"))),
    }
}

/// What a scorecard computes from the paper, and the verdicts on that. What it measures is of the
/// trials and fits, which are compared themselves.
fn score(scorecard: &Json) -> Records {
    let entries = scorecard.as_array().into_iter().flatten();
    let entry = |entry: &Json| {
        let fields = entry.as_object()?;
        let is_judged = fields.get("judged_by").is_some_and(|by| by == "computed");
        let cells = fields.iter().filter_map(|(name, value)| match value {
            Json::Number(number) if name == "computed" => {
                Some((name.clone(), Cell::Number(number.as_f64()?)))
            }
            Json::String(text) if name == "verdict" && is_judged => {
                Some((name.clone(), Cell::Text(text.clone())))
            }
            _ => None,
        });
        Some((fields.get("id")?.as_str()?.to_owned(), cells.collect()))
    };
    entries.filter_map(entry).collect()
}

fn stages(run: &Json) -> BTreeMap<String, f64> {
    let stages = run.get("stages").and_then(Json::as_array).into_iter().flatten();
    let stage = |stage: &Json| {
        Some((stage.get("stage")?.as_str()?.to_owned(), stage.get("seconds")?.as_f64()?))
    };
    stages.filter_map(stage).collect()
}
