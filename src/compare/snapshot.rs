//! The results of a run, as far as they are compared: one file that can be kept.

use std::collections::BTreeMap;
use std::io::ErrorKind::{NotADirectory, NotFound};
use std::path::{Path, PathBuf};

use polars::prelude::AnyValue;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use trilink_base::Named as _;
use trilink_tables::{
    PredictionSource, Reader, RunStatus, StoreError, Table, row_names, write_bytes,
};

use super::CompareError;

/// Tables whose rows are compared by their names.
const TABLES: [&str; 3] = ["trials", "fits", "robot_parameters"];
/// A trial's frequency is the commanded one to this part of it.
const NEAR: f64 = 0.05;
const FORMAT: u32 = 1;
/// A table that the report makes.
pub(super) const SCORECARD: &str = "scorecard";

/// Values by column: numbers, texts, and null for what is missing.
pub type Record = BTreeMap<String, Json>;
/// Records by what names them, such as a trial.
pub type Records = BTreeMap<String, Record>;

/// A record's number; `None` if it has none or it is missing.
pub(super) fn number(record: &Record, column: &str) -> Option<f64> {
    record.get(column)?.as_f64()
}

/// A record's text; empty if it has none.
pub(super) fn text<'r>(record: &'r Record, column: &str) -> &'r str {
    record.get(column).and_then(Json::as_str).unwrap_or_default()
}

/// That somebody took a run for the new baseline.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Acceptance {
    /// UTC.
    pub time: String,
    pub reason: String,
    /// Differences out of tolerance that were accepted.
    pub differences: usize,
}

/// When a run ended and what it was made with: hashes of the program's source, of the settings and
/// of the trials. What is not known is empty.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct MadeOf {
    pub ended: String,
    pub program: String,
    pub configuration: String,
    pub input: String,
}

/// The results of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    pub format: u32,
    pub version: String,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub accepted: Vec<Acceptance>,
    /// Seconds by stage.
    #[serde(default)]
    pub stages: BTreeMap<String, f64>,
    /// How the run ended, if that is known.
    #[serde(skip)]
    pub status: Option<RunStatus>,
    #[serde(skip)]
    pub made_of: MadeOf,
    pub tables: BTreeMap<String, Records>,
}

impl Snapshot {
    /// Reads a baseline: a file that was saved, or a folder of tables.
    ///
    /// # Errors
    /// There is none, or it cannot be read.
    pub fn load(path: &Path) -> Result<Self, CompareError> {
        if let Some(derived) = tables_folder(path)? {
            let reports = derived.parent().unwrap_or(Path::new("")).join("reports");
            return Self::of_run(&derived, &reports);
        }
        let error = |message: String| CompareError::Baseline { path: path.to_owned(), message };
        match trilink_base::files::read_text(path) {
            Err(source) if source.kind() == NotFound => {
                Err(error("is not there; `trilink compare --accept WHY` makes it".to_owned()))
            }
            Err(source) => Err(error(format!("cannot be read: {source}"))),
            Ok(text) => Self::parse(text.as_bytes()).map_err(error),
        }
    }

    /// A baseline from the bytes of its file.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn parse(json: &[u8]) -> Result<Self, String> {
        match serde_json::from_slice::<Self>(json) {
            Ok(found) if found.format == FORMAT => Ok(found),
            Ok(other) => Err(format!("has format {}, needed {FORMAT}", other.format)),
            Err(problem) => Err(format!("is no baseline: {problem}")),
        }
    }

    /// Reads the tables of a run, and its run time and scorecard from its reports.
    ///
    /// # Errors
    /// `trials.parquet` is not there, or a table cannot be read.
    pub fn of_run(derived: &Path, reports: &Path) -> Result<Self, CompareError> {
        let mut run = Self::of_tables(derived, &Reader::default())?;
        if let Some(scorecard) = read_json(&reports.join("scorecard.json"))? {
            run.tables.insert(SCORECARD.to_owned(), score(&scorecard));
        }
        let record: Json = read_json(&reports.join("run.json"))?.unwrap_or_default();
        run.status = record["status"].as_str().and_then(RunStatus::of_name);
        run.stages = stages(&record);
        let text = |key: &str| record[key].as_str().unwrap_or_default().to_owned();
        run.made_of.ended = text("ended");
        run.made_of.program = text("source");
        run.made_of.configuration = text("configuration");
        Ok(run)
    }

    /// Reads the tables of a run alone.
    ///
    /// # Errors
    /// As [`Snapshot::of_run`].
    pub fn of_tables(derived: &Path, reader: &Reader) -> Result<Self, StoreError> {
        let (mut tables, mut input) = (BTreeMap::new(), String::new());
        for table in TABLES {
            let path = derived.join(format!("{table}.parquet"));
            let names = row_names(&path);
            let (rows, of_table) = match rows(&path, names, reader) {
                Err(error) if error.is_not_there() && table != "trials" => continue,
                rows => rows?,
            };
            let name = |row: &Record| {
                names.iter().map(|column| text(row, column)).collect::<Vec<_>>().join(" ")
            };
            let named = rows.into_iter().map(|row| (name(&row), row));
            tables.insert(table.to_owned(), named.collect());
            if table == "trials" {
                input = of_table;
            }
        }
        tables.get_mut("fits").into_iter().flat_map(Records::values_mut).for_each(add_widths);
        let path = derived.join("predictions.parquet");
        match rows(&path, &["campaign", "model", "source"], reader) {
            Err(error) if error.is_not_there() => {}
            rows => {
                let rows = predictions(rows?.0, &tables["trials"]);
                tables.insert("predictions".to_owned(), rows);
            }
        }
        let version = env!("CARGO_PKG_VERSION").to_owned();
        let (accepted, stages) = (Vec::new(), BTreeMap::new());
        let made_of = MadeOf { input, ..MadeOf::default() };
        Ok(Self { format: FORMAT, version, accepted, stages, status: None, made_of, tables })
    }

    /// Writes it whole or not at all; a record a line, so that versions of it can be compared.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), CompareError> {
        let record =
            |(name, record): (&String, &Record)| format!("\n{}:{}", line(name), line(record));
        let table = |(name, records): (&String, &Records)| {
            let records: Vec<String> = records.iter().map(record).collect();
            format!("\n{}:{{{}}}", line(name), records.join(","))
        };
        let tables: Vec<String> = self.tables.iter().map(table).collect();
        let text = format!(
            "{{\"format\":{},\n\"version\":{},\n\"accepted\":{},\n\"stages\":{},\n\"tables\":{{{}}}}}\n",
            self.format,
            line(&self.version),
            line(&self.accepted),
            line(&self.stages),
            tables.join(",")
        );
        write_bytes(path, text.as_bytes())?;
        Ok(())
    }

    /// Records of a table; none if it is not there.
    pub fn records(&self, table: &str) -> &Records {
        static NONE: Records = Records::new();
        self.tables.get(table).unwrap_or(&NONE)
    }
}

/// The folder of tables that a path means: that in it or itself; none if it is no folder.
///
/// # Errors
/// It cannot be looked at.
pub fn tables_folder(path: &Path) -> Result<Option<PathBuf>, StoreError> {
    for folder in [path.join("derived"), path.to_owned()] {
        match std::fs::metadata(&folder) {
            Ok(metadata) if metadata.is_dir() => return Ok(Some(folder)),
            Err(source) if !matches!(source.kind(), NotFound | NotADirectory) => {
                return Err(StoreError::Read { path: folder, source });
            }
            _ => {}
        }
    }
    Ok(None)
}

/// Plain data as a line of JSON.
fn line(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

/// The rows of a table that has some columns, and the fingerprint of what it was made of.
fn rows(
    path: &Path,
    needed: &[&str],
    reader: &Reader,
) -> Result<(Vec<Record>, String), StoreError> {
    let Table { frame, input, .. } = reader.bearable_table(path)?;
    if let Some(missing) = needed.iter().find(|name| frame.column(name).is_err()) {
        let (path, column) = (path.to_owned(), (*missing).to_owned());
        let found = "no such column".to_owned();
        return Err(StoreError::Column { path, column, found, needed: "text" });
    }
    let mut rows = vec![Record::new(); frame.height()];
    for column in frame.columns() {
        let is_text = column.dtype().is_string();
        for (row, cell) in rows.iter_mut().zip(column.as_materialized_series().iter()) {
            let value = match cell {
                AnyValue::Null if !is_text => Json::Null,
                cell if cell.is_primitive_numeric() => cell.extract::<f64>().into(),
                cell => crate::inspect::text(&cell).into(),
            };
            row.insert(column.name().to_string(), value);
        }
    }
    Ok((rows, input.unwrap_or_default()))
}

/// Adds the widths of a record's 95 % intervals.
fn add_widths(record: &mut Record) {
    let lower = record.keys().filter_map(|column| column.strip_suffix("_lo"));
    let width = |of: &str| {
        let [low, high] = ["lo", "hi"].map(|end| number(record, &format!("{of}_{end}")));
        Some((format!("interval_{of}"), (high? - low?).into()))
    };
    let widths: Vec<(String, Json)> = lower.filter_map(width).collect();
    record.extend(widths);
}

/// Predictions at the trials' frequencies, named by the commanded ones: measured ones differ from
/// run to run. Of their limits the widths are kept, and not why there are none: the fits have it.
fn predictions(rows: Vec<Record>, trials: &Records) -> Records {
    let mut commanded: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for trial in trials.values() {
        let of_campaign = commanded.entry(text(trial, "campaign")).or_default();
        of_campaign.extend(number(trial, "omega_commanded_rad_s"));
    }
    for of_campaign in commanded.values_mut() {
        of_campaign.sort_by(f64::total_cmp);
        of_campaign.dedup();
    }
    let (mut found, mut counts) = (Records::new(), BTreeMap::<String, usize>::new());
    let is_of_limits = |column: &str| {
        column.ends_with("_lo") || column.ends_with("_hi") || column == "no_interval"
    };
    let at_trials = |row: &Record| text(row, "source") == PredictionSource::Trial.name();
    for mut row in rows.into_iter().filter(at_trials) {
        add_widths(&mut row);
        row.retain(|column, _| !is_of_limits(column) && column != "trial");
        let (campaign, model) = (text(&row, "campaign"), text(&row, "model"));
        let omega = number(&row, "omega_rad_s").unwrap_or(f64::NAN);
        let nearest = commanded
            .get(campaign)
            .into_iter()
            .flatten()
            .min_by(|a, b| (*a - omega).abs().total_cmp(&(*b - omega).abs()))
            .filter(|near| (*near - omega).abs() <= NEAR * omega);
        let name = format!("{campaign} {model} {:.2} rad/s", nearest.unwrap_or(&omega));
        // Repeated trials may have a row each.
        let count = counts.entry(name.clone()).or_default();
        *count += 1;
        found.insert(if *count > 1 { format!("{name} ({count})") } else { name }, row);
    }
    found
}

/// Reads a file of JSON; `None` if there is none.
fn read_json(path: &Path) -> Result<Option<Json>, CompareError> {
    let error = |message| CompareError::Baseline { path: path.to_owned(), message };
    match trilink_base::files::read_text(path) {
        Err(source) if source.kind() == NotFound => Ok(None),
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
        let values = fields.iter().filter(|(name, value)| {
            *name == "computed" && value.is_number()
                || *name == "verdict" && value.is_string() && is_judged
        });
        let values = values.map(|(name, value)| (name.clone(), value.clone()));
        Some((fields.get("id")?.as_str()?.to_owned(), values.collect()))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_the_limits_of_predictions_their_widths_are_compared() {
        let row = |d_m_hi: Json| -> Record {
            let texts = [("campaign", "ours"), ("model", "skid"), ("source", "trial")];
            let numbers = [("omega_rad_s", 2.0), ("d_m", 0.4), ("d_m_lo", 0.39)];
            let texts = texts.map(|(column, value)| (column.to_owned(), value.into()));
            let numbers = numbers.map(|(column, value)| (column.to_owned(), value.into()));
            let others = [("d_m_hi", d_m_hi), ("no_interval", "".into())];
            let others = others.map(|(column, value)| (column.to_owned(), value));
            texts.into_iter().chain(numbers).chain(others).collect()
        };
        let found = predictions(vec![row(0.42.into()), row(Json::Null)], &Records::new());
        let [known, unknown] = ["ours skid 2.00 rad/s", "ours skid 2.00 rad/s (2)"]
            .map(|name| found[name].keys().map(String::as_str).collect::<Vec<_>>());
        assert_eq!(known, ["campaign", "d_m", "interval_d_m", "model", "omega_rad_s", "source"]);
        assert_eq!(unknown, ["campaign", "d_m", "model", "omega_rad_s", "source"]);
        let width = number(&found["ours skid 2.00 rad/s"], "interval_d_m").expect("a width");
        assert!((width - 0.03).abs() < 1e-12);
    }
}
