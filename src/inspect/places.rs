//! Tables by name.

use std::path::{Path, PathBuf};

use super::InspectError;
use crate::config::nearest;

const EXTENSION: &str = "parquet";

/// A table of `derived`, or a folder of tables that are of a kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listed {
    /// Its name, such as `trials` or `poses/<trial>`.
    pub name: String,
    /// One of them.
    pub path: PathBuf,
    /// How many there are.
    pub tables: usize,
}

/// The file of a table: one of `derived` by its name, or any by its path.
///
/// # Errors
/// There is none; says which there are and which is nearest.
pub fn find(derived: &Path, table: &str) -> Result<PathBuf, InspectError> {
    let named = derived.join(format!("{table}.{EXTENSION}"));
    if named.is_file() {
        return Ok(named);
    }
    let path = PathBuf::from(table);
    if path.is_file() {
        return Ok(path);
    }
    let mut names = Vec::new();
    for Listed { name, path, .. } in list(derived) {
        match name.split_once('/') {
            // Of a trial's tables only those are likely that begin as the one that is meant.
            Some((folder, _)) if table.starts_with(&format!("{folder}/")) => {
                names.extend(
                    stems(path.parent().unwrap_or(derived)).map(|stem| format!("{folder}/{stem}")),
                );
            }
            _ => names.push(name),
        }
    }
    let hint = nearest(table, names.iter().map(String::as_str))
        .map_or(String::new(), |name| format!("; did you mean `{name}`?"));
    let known: Vec<String> = list(derived).into_iter().map(|listed| listed.name).collect();
    let there = match known.is_empty() {
        true => format!("{} holds none", derived.display()),
        false => format!("{} holds {}", derived.display(), known.join(", ")),
    };
    let message = format!("no table and no file `{table}`{hint} {there}");
    Err(InspectError::NoTable { message })
}

/// The tables of `derived`, then its folders of tables, by name.
pub fn list(derived: &Path) -> Vec<Listed> {
    let plain = stems(derived).map(|stem| {
        let path = derived.join(format!("{stem}.{EXTENSION}"));
        Listed { name: stem, path, tables: 1 }
    });
    let folders = entries(derived).filter(|path| path.is_dir());
    let folders = folders.filter_map(|folder| {
        let stems: Vec<String> = stems(&folder).collect();
        let path = folder.join(format!("{}.{EXTENSION}", stems.first()?));
        let name = format!("{}/<trial>", folder.file_name()?.to_string_lossy());
        Some(Listed { name, path, tables: stems.len() })
    });
    plain.chain(folders).collect()
}

/// Names of a folder's tables.
fn stems(folder: &Path) -> impl Iterator<Item = String> {
    let tables = entries(folder).filter(|path| {
        path.is_file() && path.extension().is_some_and(|extension| extension == EXTENSION)
    });
    tables.filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned()))
}

/// What a folder holds, sorted; nothing if it cannot be read.
fn entries(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths.into_iter()
}
