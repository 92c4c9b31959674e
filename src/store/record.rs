//! The record of what is up to date: `derived/up-to-date.json`.
//!
//! It says of every trial, fit and figure what it was made of and which files it left. It is
//! written after these files: whatever is killed before leaves files that the record does not
//! describe, and these are made again.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{Stamp, StoreError, write_bytes};

/// Name of the record inside `derived/`.
pub const RECORD_FILE: &str = "up-to-date.json";

/// Raise it when the meaning of the record changes: then everything is redone once.
const FORMAT: u32 = 1;

/// What a trial, fit or figure was made of: a short text, mostly a hash, by what it is of.
pub type Parts = BTreeMap<String, String>;

/// The whole record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Record {
    format: u32,
    pub ingest: StageState,
    pub fit: StageState,
    pub report: StageState,
    /// Of `run.json`.
    pub run: Option<Stamp>,
}

impl Default for Record {
    fn default() -> Self {
        let [ingest, fit, report] = std::array::from_fn(|_| StageState::default());
        Self { format: FORMAT, ingest, fit, report, run: None }
    }
}

/// What a stage left.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageState {
    /// Of all that the stage's own tables were made of.
    pub input: String,
    /// The configuration, to say what has changed in it.
    pub settings: BTreeMap<String, String>,
    /// Files that were read, by their absolute path.
    pub inputs: BTreeMap<String, Stamp>,
    /// Trials, fits or figures by name.
    pub things: BTreeMap<String, Thing>,
    /// Their names in order.
    pub order: Vec<String>,
    /// Files of the stage as a whole, by their path in its folder.
    pub outputs: BTreeMap<String, Stamp>,
    /// Sentences on what is not in the report.
    pub missing: Vec<String>,
}

/// A trial, fit or figure.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Thing {
    pub parts: Parts,
    /// Its own files, by their path in the stage's folder.
    pub outputs: BTreeMap<String, Stamp>,
}

impl Record {
    /// The record of a folder; an empty one, with the reason, if there is none that can be used.
    pub fn load(derived: &Path) -> (Self, Option<String>) {
        let path = derived.join(RECORD_FILE);
        let unusable = |problem: String| {
            let message = format!("{}: {problem}; everything is redone", path.display());
            (Self::default(), Some(message))
        };
        match std::fs::read(&path) {
            Ok(json) => match serde_json::from_slice::<Self>(&json) {
                Ok(record) if record.format == FORMAT => (record, None),
                Ok(record) => unusable(format!(
                    "found a record of format {}, needed format {FORMAT}",
                    record.format
                )),
                Err(problem) => unusable(format!("not a record of trilink: {problem}")),
            },
            Err(problem) if problem.kind() == ErrorKind::NotFound => (Self::default(), None),
            Err(problem) => unusable(format!("cannot be read: {problem}")),
        }
    }

    /// Writes the record.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn save(&self, derived: &Path) -> Result<(), StoreError> {
        let json = serde_json::to_vec(self).expect("a record is plain data with text keys");
        write_bytes(&derived.join(RECORD_FILE), &json).map(|_| ())
    }
}

impl Record {
    /// Whether nothing has changed since that is worth to be recorded.
    pub fn confirms(&self, earlier: &Self) -> bool {
        self.ingest.confirms(&earlier.ingest)
            && self.fit.confirms(&earlier.fit)
            && self.report.confirms(&earlier.report)
            && self.run == earlier.run
    }
}

impl StageState {
    /// Hash of the file at `path`, which is read only if it may have changed.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn renew(&self, path: &Path, verify: bool) -> std::io::Result<Stamp> {
        Stamp::renew(path, self.inputs.get(&absolute(path)), verify)
    }

    /// [`StageState::renew`] of a file that the program itself writes.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn renew_own(&self, path: &Path, verify: bool) -> std::io::Result<Stamp> {
        Stamp::renew_own(path, self.inputs.get(&absolute(path)), verify)
    }

    /// Whether nothing has changed since that is worth to be recorded.
    pub fn confirms(&self, earlier: &Self) -> bool {
        let inputs = earlier.inputs.iter().zip(&self.inputs);
        self.inputs.len() == earlier.inputs.len()
            && inputs
                .into_iter()
                .all(|((old_path, old), (path, new))| old_path == path && new.confirms(old))
            && Self { inputs: earlier.inputs.clone(), ..self.clone() } == *earlier
    }

    /// Whether these are the files that the stage read, unchanged.
    pub fn has_read<'p>(&self, paths: impl Iterator<Item = &'p Path>, verify: bool) -> bool {
        let mut count = 0;
        let all_current = paths.into_iter().all(|path| {
            count += 1;
            self.inputs.get(&absolute(path)).is_some_and(|stamp| stamp.is_intact(path, verify))
        });
        all_current && count == self.inputs.len()
    }
}

/// A path that means the same from everywhere.
pub fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).to_string_lossy().into_owned()
}

/// What is wrong with files that were written into `folder`.
pub fn changed_outputs<'o>(
    folder: &Path,
    outputs: impl IntoIterator<Item = (&'o String, &'o Stamp)>,
    verify: bool,
) -> Vec<String> {
    let changed = outputs.into_iter().filter_map(|(name, stamp)| {
        let path = folder.join(name);
        match stamp.is_intact(&path, verify) {
            true => None,
            false if !path.exists() => Some(format!("{name} is gone")),
            false => Some(format!("{name} is not as it was written")),
        }
    });
    changed.collect()
}
