//! A look into a table: some of its columns, the rows that a condition names, in some order.

mod columns;
mod condition;
mod evaluate;
mod export;
mod meaning;
mod places;
#[cfg(test)]
mod tests;
mod value;

use std::path::{Path, PathBuf};

pub use columns::{ColumnInfo, FileInfo, describe};
pub use export::{csv, json};
pub use meaning::{meaning, unit};
pub use places::{Listed, find, list};
pub use value::{Kind, Value};

use condition::Condition;

use crate::store::StoreError;

/// Why a table cannot be looked into.
#[derive(Debug, thiserror::Error)]
pub enum InspectError {
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("{}: {message}", path.display())]
    Column { path: PathBuf, message: String },
    #[error("--where \"{condition}\": {message}")]
    Condition { condition: String, message: String },
    #[error("{message}")]
    NoTable { message: String },
}

/// What to show of a table.
#[derive(Debug, Clone, Default)]
pub struct Query {
    /// All that can be shown if empty.
    pub columns: Vec<String>,
    pub condition: Option<String>,
    pub sort: Vec<SortKey>,
    /// Rows at most, after all else.
    pub head: Option<usize>,
}

/// A column to sort by.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SortKey {
    pub column: String,
    pub descending: bool,
}

/// What a query gives.
#[derive(Debug, Clone)]
pub struct View {
    pub columns: Vec<ColumnInfo>,
    /// A cell for every column.
    pub rows: Vec<Vec<Value>>,
    /// Rows of the table.
    pub total: usize,
    /// Columns that were not asked for by name and cannot be shown.
    pub left_out: Vec<ColumnInfo>,
}

/// Looks into the table of a Parquet file. Only the columns that are needed are read.
///
/// # Errors
/// The file cannot be read, has no such column, or the condition is none for its columns.
pub fn query(path: &Path, query: &Query) -> Result<View, InspectError> {
    let FileInfo { rows: total, columns: known, .. } = describe(path)?;
    let (columns, left_out) = chosen(path, query, &known)?;
    let condition = query.condition.as_deref().map(|text| {
        Condition::parse(text, &known)
            .map_err(|message| InspectError::Condition { condition: text.to_owned(), message })
    });
    let condition = condition.transpose()?;
    for key in &query.sort {
        shown(path, &key.column, &known)?;
    }

    // Which columns are read, and where among them the others stand.
    let mut names: Vec<String> = Vec::new();
    let mut place = |name: &str| {
        names.iter().position(|known| known == name).unwrap_or_else(|| {
            names.push(name.to_owned());
            names.len() - 1
        })
    };
    let shown: Vec<usize> = columns.iter().map(|column| place(&column.name)).collect();
    let sorted: Vec<usize> = query.sort.iter().map(|key| place(&key.column)).collect();
    let of_condition = condition.iter().flat_map(|condition| &condition.columns);
    let looked_at: Vec<usize> = of_condition.map(|name| place(name)).collect();
    let is_plain = condition.is_none() && sorted.is_empty();
    let cells = columns::read_columns(path, &names, query.head.filter(|_| is_plain))?;

    let mut rows: Vec<usize> = (0..cells.first().map_or(0, Vec::len)).collect();
    if let Some(condition) = &condition {
        rows.retain(|&row| condition.holds(&|column| &cells[looked_at[column]][row]));
    }
    rows.sort_by(|&one, &other| {
        let keys = sorted.iter().zip(&query.sort);
        keys.map(|(&column, key)| cells[column][one].order(&cells[column][other], key.descending))
            .find(|order| order.is_ne())
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    rows.truncate(query.head.unwrap_or(usize::MAX));
    let row = |row: usize| shown.iter().map(|&column| cells[column][row].clone()).collect();
    Ok(View { columns, rows: rows.into_iter().map(row).collect(), total, left_out })
}

/// The columns that a query asks for, and those that it would show if it could.
fn chosen(
    path: &Path,
    query: &Query,
    known: &[ColumnInfo],
) -> Result<(Vec<ColumnInfo>, Vec<ColumnInfo>), InspectError> {
    if !query.columns.is_empty() {
        let columns = query.columns.iter().map(|name| shown(path, name, known).cloned());
        return Ok((columns.collect::<Result<_, _>>()?, Vec::new()));
    }
    let (columns, left_out): (Vec<_>, Vec<_>) =
        known.iter().cloned().partition(|column| column.kind.is_some());
    if columns.is_empty() {
        let message = "has no column that can be shown".to_owned();
        return Err(InspectError::Column { path: path.to_owned(), message });
    }
    Ok((columns, left_out))
}

/// The column of a name, which must be one that can be shown.
fn shown<'t>(
    path: &Path,
    name: &str,
    known: &'t [ColumnInfo],
) -> Result<&'t ColumnInfo, InspectError> {
    let error = |message| InspectError::Column { path: path.to_owned(), message };
    let column = known.iter().find(|column| column.name == name);
    let column = column.ok_or_else(|| error(condition::no_column(name, known)))?;
    match column.kind {
        Some(_) => Ok(column),
        None => {
            Err(error(format!("column `{name}`: values of {} are not shown", column.type_name)))
        }
    }
}
