//! Addition of a robot to an existing `pipeline.toml`, of which nothing else than the list of folders changes.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};

use toml::de::{DeTable, DeValue};
use trilink_base::pattern::matches;

use super::InitError;

/// Frame rate that a configuration without `vicon.rate_hz` requires, Hz.
const DEFAULT_RATE_HZ: f64 = 120.0;

/// Existing configuration file, which can have values that are still to be entered.
pub(super) struct Existing {
    path: PathBuf,
    text: String,
    table: toml::Table,
    /// Position of the value of `paths.raw` in the text.
    raw: Option<Range<usize>>,
}

impl Existing {
    /// Reads the file.
    ///
    /// # Errors
    /// Returns an error if it cannot be read or is not TOML.
    pub(super) fn read(path: &Path) -> Result<Self, InitError> {
        let error = |why: String| InitError::Add { path: path.to_owned(), why };
        let text = trilink_base::files::read_text(path)
            .map_err(|source| error(format!("cannot be read: {source}")))?;
        let table = text.parse().map_err(|problem| error(format!("is not TOML: {problem}")))?;
        let spanned = DeTable::parse(&text).ok();
        let raw = spanned.and_then(|spanned| match spanned.get_ref().get("paths")?.get_ref() {
            DeValue::Table(paths) => Some(paths.get("raw")?.span()),
            _ => None,
        });
        Ok(Self { path: path.to_owned(), text, table, raw })
    }

    /// Returns `name`, with a number if an entry of the table `family` has this name.
    pub(super) fn free_name(&self, family: &str, name: &str) -> String {
        let is_free =
            |name: &String| self.table.get(family).and_then(|entries| entries.get(name)).is_none();
        let others = (2..).map(|number| format!("{name}-{number}"));
        std::iter::once(name.to_owned()).chain(others).find(is_free).unwrap_or_default()
    }

    /// Returns whether files with these frame rates (bits of the numbers, Hz) need `vicon.rate_from_file`.
    pub(super) fn has_other_rate(&self, rates: &BTreeSet<u64>) -> bool {
        let vicon = self.table.get("vicon");
        let value = |key| vicon.and_then(|vicon| vicon.get(key));
        let from_file = value("rate_from_file").and_then(toml::Value::as_bool).unwrap_or(false);
        let rate_hz = value("rate_hz")
            .and_then(|rate| rate.as_float().or_else(|| rate.as_integer().map(|rate| rate as f64)));
        let rate_hz = rate_hz.unwrap_or(DEFAULT_RATE_HZ);
        !from_file && rates.iter().any(|rate| f64::from_bits(*rate) != rate_hz)
    }

    /// Returns the text of the file with the folders added to `paths.raw` and `addition` at its end.
    ///
    /// # Errors
    /// Returns an error if the text would not be TOML, for example because `[layout]` is an inline table.
    pub(super) fn extended(&self, folders: &[String], addition: &str) -> Result<String, InitError> {
        let Self { path, text, table, raw } = self;
        let error = |why: String| InitError::Add { path: path.clone(), why };
        let Some(raw) = raw else {
            let needed = "found no key `raw` in [paths], needed the present trial folders";
            return Err(error(needed.to_owned()));
        };
        let mut all: Vec<String> = match &table["paths"]["raw"] {
            toml::Value::String(folder) => vec![folder.clone()],
            toml::Value::Array(folders) => {
                folders.iter().filter_map(|folder| folder.as_str().map(str::to_owned)).collect()
            }
            _ => Vec::new(),
        };
        for folder in folders {
            if !all.iter().any(|known| known == folder || is_matched(known, folder)) {
                all.push(folder.clone());
            }
        }
        let all = toml::Value::from(all).to_string();
        let (before, after) = (&text[..raw.start], text[raw.end..].trim_end());
        let extended = format!("{before}{all}{after}\n\n{addition}");
        extended
            .parse::<toml::Table>()
            .map_err(|problem| error(format!("nothing can be added: {problem}")))?;
        Ok(extended)
    }
}

/// Returns whether a pattern of `paths.raw` matches a folder; `*` matches no separator.
fn is_matched(pattern: &str, folder: &str) -> bool {
    let depth = |path: &str| path.matches('/').count();
    depth(pattern) == depth(folder) && matches(pattern, folder, ['*', '?'])
}
