//! Queries on tables: selected columns of the rows that satisfy a condition, optionally sorted.

mod cells;
mod columns;
mod condition;
mod find;
#[cfg(test)]
mod tests;

use std::convert::Infallible;
use std::path::Path;

pub use cells::{csv, float, json, text};
pub use columns::{ColumnInfo, FileInfo, describe, describe_all};
use find::tables_of;
pub use find::{Listed, find, list};
pub use trilink_tables::{meaning, unit};

use polars::prelude::{
    AnyValue, Column, DataFrame, DataType, IntoColumn, PolarsResult, SortMultipleOptions,
};
use trilink_base::pattern::matches;
use trilink_tables::config::did_you_mean;
use trilink_tables::{StoreError, Table};

/// Reason why a table cannot be queried.
#[derive(Debug, thiserror::Error)]
pub enum InspectError {
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The table or column does not exist, or the condition is invalid.
    #[error("{0}")]
    Query(String),
}

/// Query on a table. If no columns are named, it shows all columns that can be shown.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct Query {
    /// Columns to show, in this order; * matches any characters, ? matches one.
    #[arg(long, value_delimiter = ',', value_parser = trimmed, value_name = "COLUMN,..")]
    pub columns: Vec<String>,
    /// Show only rows that satisfy an SQL condition: "campaign = 'x' and omega_rad_s > 3".
    #[arg(long = "where", value_name = "CONDITION")]
    pub condition: Option<String>,
    /// Columns to sort by, each with a flag that is true for descending order.
    #[arg(skip)]
    pub sort: Vec<(String, bool)>,
    /// Show only the first N rows.
    #[arg(long, value_name = "N", conflicts_with = "tail")]
    pub head: Option<usize>,
    /// Show only the last N rows.
    #[arg(long, value_name = "N")]
    pub tail: Option<usize>,
}

fn trimmed(text: &str) -> Result<String, Infallible> {
    Ok(text.trim().to_owned())
}

/// Result of a query.
#[derive(Debug, Clone)]
pub struct View {
    pub columns: Vec<ColumnInfo>,
    /// Rows of the result, with at least the shown columns.
    pub frame: DataFrame,
    /// Number of rows of the whole table.
    pub total: usize,
    /// Columns that cannot be shown and were not requested by name.
    pub left_out: Vec<ColumnInfo>,
}

impl View {
    /// Returns a view of a whole table.
    pub fn from_table(table: Table) -> Self {
        let columns = table.frame.columns().iter().map(|column| ColumnInfo {
            name: column.name().to_string(),
            type_name: column.dtype().to_string(),
            dtype: Some(column.dtype().clone()),
        });
        let columns = columns.collect();
        let total = table.frame.height();
        Self { columns, frame: table.frame, total, left_out: Vec::new() }
    }

    /// Converts the cells row by row, in the order of the shown columns.
    pub fn cells<T>(&self, convert: impl Fn(&AnyValue) -> T) -> Vec<Vec<T>> {
        let columns = self.columns.iter().filter_map(|column| self.frame.column(&column.name).ok());
        let mut columns: Vec<_> =
            columns.map(|column| column.as_materialized_series().iter()).collect();
        let rows = (0..self.frame.height()).map(|_| {
            columns.iter_mut().filter_map(Iterator::next).map(|cell| convert(&cell)).collect()
        });
        rows.collect()
    }
}

/// Queries the table of a Parquet file, or all tables of a folder as one table, with the name of each file in the
/// column `trial`. Only the needed columns are read.
///
/// # Errors
/// Returns an error if a file cannot be read, a column does not exist, or the condition is invalid for the columns.
pub fn query(path: &Path, query: &Query) -> Result<View, InspectError> {
    let Query { condition, sort, head, tail, .. } = query;
    let FileInfo { rows: total, columns: known, .. } = describe_all(path)?;
    let (columns, left_out) = select_columns(path, query, &known)?;
    for (column, _) in sort {
        find_column(path, column, &known)?;
    }
    let condition_error = |message: String| {
        let condition = condition.as_deref().unwrap_or_default();
        InspectError::Query(format!("--where \"{condition}\": {message}"))
    };
    let parsed = condition.as_deref().map(condition::parse).transpose().map_err(condition_error)?;

    let words = parsed.iter().flat_map(|(_, words)| words);
    let mut needed: Vec<String> = words
        .filter(|word| find_column(path, word, &known).is_ok())
        .chain(sort.iter().map(|(column, _)| column))
        .chain(columns.iter().map(|column| &column.name))
        .cloned()
        .collect();
    needed.sort();
    needed.dedup();
    // Without sorting, reading stops as soon as enough rows satisfy the condition.
    let max_rows = head.filter(|_| sort.is_empty());
    let slice = max_rows.filter(|_| parsed.is_none());
    let mut frame = DataFrame::empty();
    for (trial, path) in tables_of(path) {
        if max_rows.is_some_and(|max| !frame.columns().is_empty() && frame.height() >= max) {
            break;
        }
        let mut rows = columns::read_columns(&path, &needed, trial.as_deref(), slice)?;
        if let Some((condition, _)) = &parsed {
            rows = condition::mask(condition, &known, &rows)
                .and_then(|mask| rows.filter(&mask))
                .map_err(|error| condition_error(error.to_string()))?;
        }
        if frame.columns().is_empty() {
            frame = rows;
        } else {
            frame = frame.vstack(&rows).map_err(|error| column_error(&path, error.to_string()))?;
        }
    }
    let frame = sorted(frame, sort).map_err(|error| column_error(path, error.to_string()))?;
    let frame = frame.head(Some(head.unwrap_or(total)));
    let frame = frame.tail(Some(tail.unwrap_or(total)));
    Ok(View { columns, frame, total, left_out })
}

/// Sorts rows. NaN comes after all numbers, and missing values last, in ascending and in descending order.
fn sorted(frame: DataFrame, sort: &[(String, bool)]) -> PolarsResult<DataFrame> {
    let mut keys: Vec<Column> = Vec::new();
    let mut options = SortMultipleOptions { maintain_order: true, ..Default::default() };
    options.descending.clear();
    for (column, descending) in sort {
        let key = cells::comparable(frame.column(column)?.as_materialized_series())?;
        if *key.dtype() == DataType::Float64 {
            keys.push(key.is_nan()?.into_column());
            options.descending.push(false);
        }
        keys.push(key.into());
        options.descending.push(*descending);
    }
    let Some((first, others)) = keys.split_first() else { return Ok(frame) };
    options.nulls_last = vec![true; keys.len()];
    frame.take(&first.arg_sort_multiple(others, &options)?)
}

/// Returns the columns that a query selects, and those that it leaves out because they cannot be shown.
fn select_columns(
    path: &Path,
    query: &Query,
    known: &[ColumnInfo],
) -> Result<(Vec<ColumnInfo>, Vec<ColumnInfo>), InspectError> {
    if !query.columns.is_empty() {
        let mut columns: Vec<ColumnInfo> = Vec::new();
        for name in &query.columns {
            if !name.contains(['*', '?']) {
                columns.push(find_column(path, name, known)?.clone());
                continue;
            }
            let mut matching = known.to_vec();
            matching
                .retain(|column| column.dtype.is_some() && matches(name, &column.name, ['*', '?']));
            if matching.is_empty() {
                let existing = names(known).join(", ");
                let message = format!("no column matches `{name}`. The columns are {existing}");
                return Err(column_error(path, message));
            }
            matching.retain(|column| !columns.contains(column));
            columns.extend(matching);
        }
        return Ok((columns, Vec::new()));
    }
    let (columns, left_out): (Vec<_>, Vec<_>) =
        known.iter().cloned().partition(|column| column.dtype.is_some());
    if columns.is_empty() {
        return Err(column_error(path, "has no column that can be shown".to_owned()));
    }
    Ok((columns, left_out))
}

/// Finds a column by name.
///
/// # Errors
/// Returns an error if the column does not exist or cannot be shown.
fn find_column<'t>(
    path: &Path,
    name: &str,
    known: &'t [ColumnInfo],
) -> Result<&'t ColumnInfo, InspectError> {
    let message = match known.iter().find(|column| column.name == name) {
        Some(column) if column.dtype.is_some() => return Ok(column),
        Some(column) => {
            format!("column `{name}`: values of {} are not shown", column.type_name)
        }
        None => no_column(name, known),
    };
    Err(column_error(path, message))
}

/// Returns the end of a sentence: a hint, which has its own punctuation, or a full stop if the hint is empty.
fn sentence_end(hint: String) -> String {
    if hint.is_empty() { ".".to_owned() } else { hint }
}

fn column_error(path: &Path, message: String) -> InspectError {
    InspectError::Query(format!("{}: {message}", path.display()))
}

/// Returns the message for an unknown column, with the most similar name and all existing names.
fn no_column(name: &str, known: &[ColumnInfo]) -> String {
    let known = names(known);
    let hint = sentence_end(did_you_mean(name, known.iter().copied()));
    format!("no column `{name}`{hint} The columns are {}", known.join(", "))
}

fn names(known: &[ColumnInfo]) -> Vec<&str> {
    known.iter().map(|column| column.name.as_str()).collect()
}
