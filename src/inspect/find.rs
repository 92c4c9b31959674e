//! Tables by name.

use std::path::{Path, PathBuf};

use trilink_tables::config::did_you_mean;
use trilink_tables::tables_in;

use super::{InspectError, sentence_end};

/// A table of `derived`, or a folder of tables that are of a kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listed {
    /// Its name, such as `trials` or `poses/<trial>`.
    pub name: String,
    /// One of them.
    pub path: PathBuf,
    /// How many there are; `None` of a single table.
    pub tables: Option<usize>,
}

/// The file of a table: one of `derived` by its name, or any by its path; or a folder of tables of
/// `derived`, such as `poses`.
///
/// # Errors
/// There is none; the message names those that there are and the nearest one.
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
    // Of a trial's tables only those are likely that begin as the one that is meant.
    if let Some((folder, _)) = table.split_once('/') {
        let names = tables(&derived.join(folder)).map(|(stem, _)| format!("{folder}/{stem}"));
        near.retain(|name| !name.starts_with(&format!("{folder}/")));
        near.extend(names);
    }
    let hint = sentence_end(did_you_mean(table, near.iter().map(String::as_str)));
    let there = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
    let derived = derived.display();
    Err(InspectError::Query(format!(
        "no table and no file `{table}`{hint} {derived} holds {there}"
    )))
}

/// The tables of `derived`, then its folders of tables, by name.
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

/// The tables of a folder with their names, or the one file without.
pub(super) fn tables_of(path: &Path) -> Vec<(Option<String>, PathBuf)> {
    match path.is_dir() {
        true => tables(path).map(|(name, path)| (Some(name), path)).collect(),
        false => vec![(None, path.to_owned())],
    }
}

/// Names and files of a folder's tables; none if it cannot be read.
fn tables(folder: &Path) -> impl Iterator<Item = (String, PathBuf)> + use<> {
    let tables = tables_in(folder).unwrap_or_default().into_iter().filter(|path| path.is_file());
    tables.filter_map(|path| Some((path.file_stem()?.to_string_lossy().into_owned(), path)))
}
