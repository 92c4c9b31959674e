//! Lookup of tables by name.

use std::path::{Path, PathBuf};

use trilink_tables::config::did_you_mean;
use trilink_tables::tables_in;

use super::{InspectError, sentence_end};

/// Table in `derived/`, or folder of tables of one kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listed {
    /// Name, such as `trials` or `poses/<trial>`.
    pub name: String,
    /// Path of the table, or of the first table of the folder.
    pub path: PathBuf,
    /// Number of tables in the folder; `None` for a single table.
    pub tables: Option<usize>,
}

/// Finds the file of a table by its name in `derived/` or by its path, or a folder of tables in `derived/`, such as
/// `poses`.
///
/// # Errors
/// Returns an error with the existing tables and the nearest name if there is no such table.
pub fn find(derived: &Path, table: &str) -> Result<PathBuf, InspectError> {
    let named = derived.join(format!("{table}.parquet"));
    for path in [named, PathBuf::from(table)] {
        if path.is_file() {
            return Ok(path);
        }
    }
    let folder = derived.join(table.trim_end_matches('/'));
    if !table.is_empty() && tables(&folder).next().is_some() {
        return Ok(folder);
    }
    let known: Vec<String> = list(derived).into_iter().map(|listed| listed.name).collect();
    let mut near = known.clone();
    // For a table of a trial, only tables of the same folder are suggested.
    if let Some((folder, _)) = table.split_once('/') {
        let names = tables(&derived.join(folder)).map(|(stem, _)| format!("{folder}/{stem}"));
        near.retain(|name| !name.starts_with(&format!("{folder}/")));
        near.extend(names);
    }
    let hint = sentence_end(did_you_mean(table, near.iter().map(String::as_str)));
    let there = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
    let derived = derived.display();
    Err(InspectError::Query(format!(
        "`{table}` is neither a table nor a file{hint} {derived} contains {there}"
    )))
}

/// Lists the tables of `derived/`, followed by its folders of tables, both sorted by name.
pub fn list(derived: &Path) -> Vec<Listed> {
    let single = tables(derived).map(|(name, path)| Listed { name, path, tables: None });
    let entries = std::fs::read_dir(derived).into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    folders.sort();
    let folders = folders.into_iter().filter_map(|folder| {
        let (_, path) = tables(&folder).next()?;
        let name = format!("{}/<trial>", folder.file_name()?.to_string_lossy());
        Some(Listed { name, path, tables: Some(tables(&folder).count()) })
    });
    single.chain(folders).collect()
}

/// Returns the tables of a folder with their names, or a single file without a name.
pub(super) fn tables_of(path: &Path) -> Vec<(Option<String>, PathBuf)> {
    if path.is_dir() {
        tables(path).map(|(name, path)| (Some(name), path)).collect()
    } else {
        vec![(None, path.to_owned())]
    }
}

/// Returns names and paths of the tables in a folder; none if the folder cannot be read.
fn tables(folder: &Path) -> impl Iterator<Item = (String, PathBuf)> + use<> {
    let tables = tables_in(folder).unwrap_or_default().into_iter().filter(|path| path.is_file());
    tables.filter_map(|path| Some((path.file_stem()?.to_string_lossy().into_owned(), path)))
}
