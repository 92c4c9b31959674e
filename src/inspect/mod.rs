//! A look into a table: some of its columns, the rows that a condition names, in some order.

mod cells;
mod columns;
mod condition;
mod find;
mod meaning;
#[cfg(test)]
mod tests;

use std::convert::Infallible;
use std::path::Path;

pub use cells::{csv, float, json, text};
pub use columns::{ColumnInfo, FileInfo, describe, describe_all};
use find::tables_of;
pub use find::{Listed, find, list};
pub use meaning::{meaning, unit};

use polars::prelude::{
    AnyValue, Column, DataFrame, DataType, IntoColumn, PolarsResult, SortMultipleOptions,
};
use trilink_base::pattern::matches;
use trilink_tables::config::did_you_mean;
use trilink_tables::{StoreError, Table};

/// Why a table cannot be looked into.
#[derive(Debug, thiserror::Error)]
pub enum InspectError {
    #[error(transparent)]
    Store(#[from] StoreError),
    /// No such table, column or condition.
    #[error("{0}")]
    Query(String),
}

/// What to show of a table: all columns that can be shown if none are named.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct Query {
    /// Columns to show, in this order; * is any characters, ? is one.
    #[arg(long, value_delimiter = ',', value_parser = trimmed, value_name = "COLUMN,..")]
    pub columns: Vec<String>,
    /// Rows to show, by a condition as SQL has it: "campaign = 'x' and omega_rad_s > 3".
    #[arg(long = "where", value_name = "CONDITION")]
    pub condition: Option<String>,
    /// Columns to sort by, and whether downwards.
    #[arg(skip)]
    pub sort: Vec<(String, bool)>,
    /// Rows at most, the first ones.
    #[arg(long, value_name = "N", conflicts_with = "tail")]
    pub head: Option<usize>,
    /// Rows at most, the last ones.
    #[arg(long, value_name = "N")]
    pub tail: Option<usize>,
}

fn trimmed(text: &str) -> Result<String, Infallible> {
    Ok(text.trim().to_owned())
}

/// What a query gives.
#[derive(Debug, Clone)]
pub struct View {
    pub columns: Vec<ColumnInfo>,
    /// Its rows, with at least these columns.
    pub frame: DataFrame,
    /// Rows of the table.
    pub total: usize,
    /// Columns that were not asked for by name and cannot be shown.
    pub left_out: Vec<ColumnInfo>,
}

impl View {
    /// All of a table.
    pub fn of(table: Table) -> Self {
        let column = |column: &Column| ColumnInfo {
            name: column.name().to_string(),
            type_name: column.dtype().to_string(),
            dtype: Some(column.dtype().clone()),
        };
        let columns = table.frame.columns().iter().map(column).collect();
        let total = table.frame.height();
        Self { columns, frame: table.frame, total, left_out: Vec::new() }
    }

    /// What is made of each row's cells, in the order of the columns.
    pub fn cells<T>(&self, show: impl Fn(&AnyValue) -> T) -> Vec<Vec<T>> {
        let columns = self.columns.iter().filter_map(|column| self.frame.column(&column.name).ok());
        let mut columns: Vec<_> =
            columns.map(|column| column.as_materialized_series().iter()).collect();
        let row =
            |_| columns.iter_mut().filter_map(Iterator::next).map(|cell| show(&cell)).collect();
        (0..self.frame.height()).map(row).collect()
    }
}

/// Looks into the table of a Parquet file, or of all those in a folder, of which each row has its
/// file's name as `trial`. Only the columns that are needed are read.
///
/// # Errors
/// A file cannot be read, has no such column, or the condition is none for its columns.
pub fn query(path: &Path, query: &Query) -> Result<View, InspectError> {
    let Query { condition, sort, head, tail, .. } = query;
    let FileInfo { rows: total, columns: known, .. } = describe_all(path)?;
    let (columns, left_out) = chosen(path, query, &known)?;
    for (column, _) in sort {
        shown(path, column, &known)?;
    }
    let in_condition = |message: String| {
        let condition = condition.as_deref().unwrap_or_default();
        InspectError::Query(format!("--where \"{condition}\": {message}"))
    };
    let parsed = condition.as_deref().map(condition::parse).transpose().map_err(in_condition)?;

    let words = parsed.iter().flat_map(|(_, words)| words);
    let mut needed: Vec<String> = words
        .filter(|word| shown(path, word, &known).is_ok())
        .chain(sort.iter().map(|(column, _)| column))
        .chain(columns.iter().map(|column| &column.name))
        .cloned()
        .collect();
    needed.sort();
    needed.dedup();
    // Without an order no file is read beyond so many rows that fulfil the condition.
    let most = head.filter(|_| sort.is_empty());
    let slice = most.filter(|_| parsed.is_none());
    let filtered = |frame: DataFrame| match &parsed {
        Some((condition, _)) => condition::mask(condition, &known, &frame)
            .and_then(|mask| frame.filter(&mask))
            .map_err(|error| in_condition(error.to_string())),
        None => Ok(frame),
    };
    let mut frame = DataFrame::empty();
    for (trial, path) in tables_of(path) {
        if most.is_some_and(|most| !frame.columns().is_empty() && frame.height() >= most) {
            break;
        }
        let rows = filtered(columns::read_columns(&path, &needed, trial.as_deref(), slice)?)?;
        let joined = match frame.columns().is_empty() {
            true => Ok(rows),
            false => frame.vstack(&rows),
        };
        frame = joined.map_err(|error| column_error(&path, error.to_string()))?;
    }
    let frame = sorted(frame, sort).map_err(|error| column_error(path, error.to_string()))?;
    let frame = frame.head(Some(head.unwrap_or(total)));
    let frame = frame.tail(Some(tail.unwrap_or(total)));
    Ok(View { columns, frame, total, left_out })
}

/// Rows in order; NaN and then what is missing come last upwards and downwards.
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

/// The columns that a query asks for, and those that it would show if it could.
fn chosen(
    path: &Path,
    query: &Query,
    known: &[ColumnInfo],
) -> Result<(Vec<ColumnInfo>, Vec<ColumnInfo>), InspectError> {
    if !query.columns.is_empty() {
        let mut columns: Vec<ColumnInfo> = Vec::new();
        for name in &query.columns {
            if !name.contains(['*', '?']) {
                columns.push(shown(path, name, known)?.clone());
                continue;
            }
            let is_meant = |column: &&ColumnInfo| {
                column.dtype.is_some() && matches(name, &column.name, ['*', '?'])
            };
            let mut meant = known.iter().filter(is_meant).peekable();
            if meant.peek().is_none() {
                let there = names(known).join(", ");
                let message = format!("no column is like `{name}`. There are {there}");
                return Err(column_error(path, message));
            }
            let others: Vec<_> = meant.filter(|column| !columns.contains(column)).collect();
            columns.extend(others.into_iter().cloned());
        }
        return Ok((columns, Vec::new()));
    }
    let (columns, left_out): (Vec<_>, Vec<_>) =
        known.iter().cloned().partition(|column| column.dtype.is_some());
    match columns.is_empty() {
        true => Err(column_error(path, "has no column that can be shown".to_owned())),
        false => Ok((columns, left_out)),
    }
}

/// The column of a name, which must be one that can be shown.
fn shown<'t>(
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

/// A question ends its sentence; without one there is a full stop.
fn sentence_end(hint: String) -> String {
    if hint.is_empty() { ".".to_owned() } else { hint }
}

fn column_error(path: &Path, message: String) -> InspectError {
    InspectError::Query(format!("{}: {message}", path.display()))
}

/// That there is no such column, the nearest name and all of them.
fn no_column(name: &str, known: &[ColumnInfo]) -> String {
    let known = names(known);
    let hint = sentence_end(did_you_mean(name, known.iter().copied()));
    format!("no column `{name}`{hint} There are {}", known.join(", "))
}

fn names(known: &[ColumnInfo]) -> Vec<&str> {
    known.iter().map(|column| column.name.as_str()).collect()
}
