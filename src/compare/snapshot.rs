//! Snapshot of the compared results of a run, which can be saved to a file as a baseline.

use std::collections::BTreeMap;
use std::io::ErrorKind::{NotADirectory, NotFound};
use std::path::{Path, PathBuf};

use polars::prelude::AnyValue;
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use trilink_base::Named as _;
use trilink_tables::{
    Columns, PrecisionRow, PredictionSource, Reader, ResidualRow, RunStatus, StoreError, Table,
    row_names, write_bytes,
};

use super::{CompareError, noise};

/// Names of the tables in which the rows of two runs are matched by name.
const TABLES: [&str; 3] = ["trials", "fits", "robot_parameters"];
/// Maximum relative difference between the frequency of a prediction and the commanded frequency by which it is named.
const FREQUENCY_TOLERANCE: f64 = 0.05;
const FORMAT: u32 = 1;
/// Name of the scorecard, a table that the report makes.
pub(super) const SCORECARD: &str = "scorecard";

/// Values of a table row, indexed by column: numbers, strings, or null for a missing value.
pub type Record = BTreeMap<String, Json>;
/// Records, indexed by the name of the row, such as a trial.
pub type Records = BTreeMap<String, Record>;

/// Returns the number in a column of a record; `None` if it is missing.
pub(super) fn number(record: &Record, column: &str) -> Option<f64> {
    record.get(column)?.as_f64()
}

/// Returns the text in a column of a record; empty if it is missing.
pub(super) fn text<'r>(record: &'r Record, column: &str) -> &'r str {
    record.get(column).and_then(Json::as_str).unwrap_or_default()
}

/// Acceptance of a run as the new baseline.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Acceptance {
    /// Time of the acceptance (UTC).
    pub time: String,
    pub reason: String,
    /// Number of differences out of tolerance that were accepted.
    pub differences: usize,
}

/// Time and inputs of a run; unknown fields are empty.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RunInputs {
    /// Time at which the run ended.
    pub ended: String,
    /// Hash of the program's source.
    pub program: String,
    /// Hash of the configuration.
    pub configuration: String,
    /// Hash of the trials.
    pub input: String,
}

/// Results of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    pub format: u32,
    pub version: String,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub accepted: Vec<Acceptance>,
    /// Run times by stage, s.
    #[serde(default)]
    pub stages: BTreeMap<String, f64>,
    /// Status of the run, if known.
    #[serde(skip)]
    pub status: Option<RunStatus>,
    #[serde(skip)]
    pub inputs: RunInputs,
    pub tables: BTreeMap<String, Records>,
}

impl Snapshot {
    /// Reads a baseline from a saved file or a folder of tables.
    ///
    /// # Errors
    /// Returns an error if the baseline is missing or cannot be read.
    pub fn load(path: &Path) -> Result<Self, CompareError> {
        if let Some(derived) = tables_folder(path)? {
            let reports = derived.parent().unwrap_or(Path::new("")).join("reports");
            return Self::from_run(&derived, &reports);
        }
        let error = |message: String| CompareError::Baseline { path: path.to_owned(), message };
        match trilink_base::files::read_text(path) {
            Err(source) if source.kind() == NotFound => {
                Err(error("does not exist; `trilink compare --accept WHY` creates it".to_owned()))
            }
            Err(source) => Err(error(format!("cannot be read: {source}"))),
            Ok(text) => Self::parse(text.as_bytes()).map_err(error),
        }
    }

    /// Parses the contents of a baseline file.
    ///
    /// # Errors
    /// Returns a message if the contents are not a baseline of the supported format.
    pub fn parse(json: &[u8]) -> Result<Self, String> {
        match serde_json::from_slice::<Self>(json) {
            Ok(baseline) if baseline.format == FORMAT => Ok(baseline),
            Ok(other) => Err(format!(
                "has format {}, but this version of trilink reads only format {FORMAT}",
                other.format
            )),
            Err(problem) => Err(format!("is not a baseline: {problem}")),
        }
    }

    /// Reads the tables of a run, and its run times and scorecard from the reports.
    ///
    /// # Errors
    /// Returns an error if `trials.parquet` is missing or a file cannot be read.
    pub fn from_run(derived: &Path, reports: &Path) -> Result<Self, CompareError> {
        let mut run = Self::from_tables(derived, &Reader::default())?;
        if let Some(scorecard) = read_json(&reports.join("scorecard.json"))? {
            run.tables.insert(SCORECARD.to_owned(), scorecard_records(&scorecard));
        }
        let record: Json = read_json(&reports.join("run.json"))?.unwrap_or_default();
        run.status = record["status"].as_str().and_then(RunStatus::of_name);
        run.stages = stages(&record);
        let text = |key: &str| record[key].as_str().unwrap_or_default().to_owned();
        run.inputs.ended = text("ended");
        run.inputs.program = text("source");
        run.inputs.configuration = text("configuration");
        Ok(run)
    }

    /// Reads the tables of a run without its reports.
    ///
    /// # Errors
    /// Returns an error if `trials.parquet` is missing or a table cannot be read.
    pub fn from_tables(derived: &Path, reader: &Reader) -> Result<Self, StoreError> {
        let mut tables = BTreeMap::<String, Records>::new();
        let mut input = String::new();
        for table in TABLES {
            let path = derived.join(format!("{table}.parquet"));
            let names = row_names(&path);
            let (rows, table_input) = match rows(&path, names, reader) {
                Err(error) if error.is_not_there() && table != "trials" => continue,
                rows => rows?,
            };
            let named = rows.into_iter().map(|row| {
                let name: Vec<&str> = names.iter().map(|column| text(&row, column)).collect();
                (name.join(" "), row)
            });
            tables.insert(table.to_owned(), named.collect());
            if table == "trials" {
                input = table_input;
            }
        }
        tables.get_mut("fits").into_iter().flat_map(Records::values_mut).for_each(add_widths);
        let precision: Vec<PrecisionRow> = known_rows(&derived.join("precision.parquet"), reader)?;
        let residuals: Vec<ResidualRow> = known_rows(&derived.join("residuals.parquet"), reader)?;
        let fits = tables.get("fits").cloned().unwrap_or_default();
        if let Some(trials) = tables.get_mut("trials") {
            noise::add_between(trials, &fits, &precision, &residuals);
        }
        let path = derived.join("predictions.parquet");
        match rows(&path, &["campaign", "model", "source"], reader) {
            Err(error) if error.is_not_there() => {}
            rows => {
                let rows = predictions(rows?.0, &tables["trials"]);
                tables.insert("predictions".to_owned(), rows);
            }
        }
        Ok(Self {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            accepted: Vec::new(),
            stages: BTreeMap::new(),
            status: None,
            inputs: RunInputs { input, ..RunInputs::default() },
            tables,
        })
    }

    /// Writes the snapshot atomically, with one record per line, so that versions can be compared line by line.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), CompareError> {
        let tables = self.tables.iter().map(|(name, records)| {
            let records: Vec<String> = records
                .iter()
                .map(|(name, record)| format!("\n{}:{}", line(name), line(record)))
                .collect();
            format!("\n{}:{{{}}}", line(name), records.join(","))
        });
        let tables: Vec<String> = tables.collect();
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

    /// Returns the records of a table; empty if there is no such table.
    pub fn records(&self, table: &str) -> &Records {
        static EMPTY: Records = Records::new();
        self.tables.get(table).unwrap_or(&EMPTY)
    }
}

/// Returns the folder of tables at a path: the subfolder `derived` or the path itself; `None` if it is not a folder.
///
/// # Errors
/// Returns an error if the path cannot be accessed.
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

/// Serializes plain data to one line of JSON.
fn line(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

/// Reads the rows of a table, which must have the columns `needed`, and the hash of the table's inputs.
fn rows(
    path: &Path,
    needed: &[&str],
    reader: &Reader,
) -> Result<(Vec<Record>, String), StoreError> {
    let Table { frame, input, .. } = reader.bounded_table(path)?;
    if let Some(missing) = needed.iter().find(|name| frame.column(name).is_err()) {
        return Err(StoreError::Column {
            path: path.to_owned(),
            column: (*missing).to_owned(),
            found: "no such column".to_owned(),
            needed: "text",
        });
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

/// Reads the rows of a table; returns no rows if the table is missing or is one of another version of the program.
fn known_rows<R: Columns>(path: &Path, reader: &Reader) -> Result<Vec<R>, StoreError> {
    match reader.bounded_table(path).and_then(|table| R::from_table(&table)) {
        Err(error) if error.is_not_there() || error.is_schema_mismatch() => Ok(Vec::new()),
        rows => rows,
    }
}

/// Prefix of the column with the width of a quantity's 95 % confidence interval.
pub(super) const INTERVAL: &str = "interval_";

/// Adds to a record the widths of its 95 % confidence intervals.
fn add_widths(record: &mut Record) {
    let widths = record.keys().filter_map(|column| {
        let quantity = column.strip_suffix("_lo")?;
        let low = number(record, column)?;
        let high = number(record, &format!("{quantity}_hi"))?;
        Some((format!("{INTERVAL}{quantity}"), (high - low).into()))
    });
    let widths: Vec<(String, Json)> = widths.collect();
    record.extend(widths);
}

/// Returns the predictions at the trials' frequencies. Rows are named by the commanded frequencies, because measured
/// frequencies differ from run to run. Confidence limits are replaced by the widths of their intervals; the reasons for
/// missing limits are dropped, because the fits have them, too.
fn predictions(rows: Vec<Record>, trials: &Records) -> Records {
    let mut commanded: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for trial in trials.values() {
        let frequencies = commanded.entry(text(trial, "campaign")).or_default();
        frequencies.extend(number(trial, "omega_commanded_rad_s"));
    }
    for frequencies in commanded.values_mut() {
        frequencies.sort_by(f64::total_cmp);
        frequencies.dedup();
    }
    let mut predictions = Records::new();
    let mut counts = BTreeMap::<String, usize>::new();
    for mut row in rows {
        if text(&row, "source") != PredictionSource::Trial.name() {
            continue;
        }
        add_widths(&mut row);
        row.retain(|column, _| {
            let is_limit = column.ends_with("_lo") || column.ends_with("_hi");
            !is_limit && column != "no_interval" && column != "trial"
        });
        let campaign = text(&row, "campaign");
        let model = text(&row, "model");
        let omega = number(&row, "omega_rad_s").unwrap_or(f64::NAN);
        let nearest = commanded
            .get(campaign)
            .into_iter()
            .flatten()
            .min_by(|a, b| (*a - omega).abs().total_cmp(&(*b - omega).abs()))
            .filter(|near| (*near - omega).abs() <= FREQUENCY_TOLERANCE * omega);
        let name = format!("{campaign} {model} {:.2} rad/s", nearest.unwrap_or(&omega));
        // Repeated trials may have a row each.
        let count = counts.entry(name.clone()).or_default();
        *count += 1;
        predictions.insert(if *count > 1 { format!("{name} ({count})") } else { name }, row);
    }
    predictions
}

/// Reads a JSON file; returns `None` if it is missing.
fn read_json(path: &Path) -> Result<Option<Json>, CompareError> {
    let error = |message| CompareError::Baseline { path: path.to_owned(), message };
    match trilink_base::files::read_text(path) {
        Err(source) if source.kind() == NotFound => Ok(None),
        Err(source) => Err(error(format!("cannot be read: {source}"))),
        Ok(text) => serde_json::from_str(&text)
            .map(Some)
            .map_err(|problem| error(format!("is not JSON: {problem}"))),
    }
}

/// Returns the computed values in a scorecard, with their verdicts. Measured values are left out, because they are
/// derived from the trials and fits, which are compared themselves.
fn scorecard_records(scorecard: &Json) -> Records {
    let entries = scorecard.as_array().into_iter().flatten();
    let records = entries.filter_map(|entry| {
        let fields = entry.as_object()?;
        let is_judged = fields.get("judged_by").is_some_and(|by| by == "computed");
        let values = fields.iter().filter(|(name, value)| {
            *name == "computed" && value.is_number()
                || *name == "verdict" && value.is_string() && is_judged
        });
        let values = values.map(|(name, value)| (name.clone(), value.clone()));
        Some((fields.get("id")?.as_str()?.to_owned(), values.collect()))
    });
    records.collect()
}

/// Returns the run times by stage from the content of `run.json`, s.
fn stages(run: &Json) -> BTreeMap<String, f64> {
    let stages = run.get("stages").and_then(Json::as_array).into_iter().flatten();
    let times = stages.filter_map(|stage| {
        Some((stage.get("stage")?.as_str()?.to_owned(), stage.get("seconds")?.as_f64()?))
    });
    times.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_replace_the_limits_of_predictions() {
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
