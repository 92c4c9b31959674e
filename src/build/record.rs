//! The record of what is up to date: `derived/up-to-date.json`.
//!
//! It has what every trial, fit, figure and page was made of and which files it left. It is
//! written after these files: whatever is killed before leaves files that the record does not
//! describe, and these are made again.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::target::{Fingerprint, Target};
use crate::store::{Stamp, StoreError, write_bytes};

/// Name of the record inside `derived/`.
pub const RECORD_FILE: &str = "up-to-date.json";

/// Raise it when the meaning of the record changes: then everything is redone once.
const FORMAT: u32 = 2;

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

/// What a stage left.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageState {
    /// Hash of the stage's source.
    pub source: String,
    /// Settings of the stage as a whole.
    pub whole: Value,
    /// Settings of its targets, by their hashes.
    pub settings: BTreeMap<String, Value>,
    /// Files that were read, by their absolute path.
    pub inputs: BTreeMap<String, Stamp>,
    /// In order.
    pub targets: Vec<Made>,
    /// Files of the stage as a whole, by their path in its folder.
    pub outputs: Outputs,
    /// Sentences on what is not in the report.
    pub missing: Vec<String>,
}

/// Files by their path in a stage's folder.
pub type Outputs = BTreeMap<String, Stamp>;

/// A target that was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Made {
    pub target: Target,
    pub parts: Fingerprint,
    /// Campaigns that a figure shows.
    pub campaigns: Vec<String>,
    /// Its own files.
    pub outputs: Outputs,
}

impl Default for Record {
    fn default() -> Self {
        let [ingest, fit, report] = std::array::from_fn(|_| StageState::default());
        Self { format: FORMAT, ingest, fit, report, run: None }
    }
}

impl Record {
    /// The record of a folder; an empty one, with the reason, if there is none that can be used.
    pub fn load(derived: &Path) -> (Self, Option<String>) {
        let path = derived.join(RECORD_FILE);
        let unusable = |problem: String| {
            let message = format!("{}: {problem}; everything is redone", path.display());
            (Self::default(), Some(message))
        };
        #[derive(Deserialize)]
        struct Format {
            format: u32,
        }
        let json = match std::fs::read(&path) {
            Ok(json) => json,
            Err(problem) if problem.kind() == ErrorKind::NotFound => return Default::default(),
            Err(problem) => return unusable(format!("cannot be read: {problem}")),
        };
        match (serde_json::from_slice::<Format>(&json), serde_json::from_slice(&json)) {
            (Ok(Format { format }), _) if format != FORMAT => {
                unusable(format!("found a record of format {format}, needed format {FORMAT}"))
            }
            (_, Ok(record)) => (record, None),
            (_, Err(problem)) => unusable(format!("not a record of trilink: {problem}")),
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

impl StageState {
    /// Whether nothing has changed since that is worth to be recorded.
    pub fn confirms(&self, earlier: &Self) -> bool {
        let mut inputs = earlier.inputs.iter().zip(&self.inputs);
        self.inputs.len() == earlier.inputs.len()
            && inputs.all(|((old_path, old), (path, new))| old_path == path && new.confirms(old))
            && Self { inputs: earlier.inputs.clone(), ..self.clone() } == *earlier
    }

    /// Whether these are the files that the stage read, unchanged.
    pub fn has_read<'p>(&self, mut paths: impl Iterator<Item = &'p Path>, verify: bool) -> bool {
        let mut count = 0;
        let all_current = paths.all(|path| {
            count += 1;
            self.inputs.get(&absolute(path)).is_some_and(|stamp| stamp.is_intact(path, verify))
        });
        all_current && count == self.inputs.len()
    }
}

/// Files that a stage reads, read again only where they may have changed.
#[derive(Debug)]
pub struct Inputs<'k> {
    pub known: &'k StageState,
    pub verify: bool,
    /// Those that were looked at, by their absolute path.
    pub seen: BTreeMap<String, Stamp>,
}

impl Inputs<'_> {
    /// The stamp of a file; of one of its `own` that only who holds the lock writes.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn stamp(&mut self, path: &Path, own: bool) -> io::Result<Stamp> {
        let name = absolute(path);
        let stamp = match own {
            true => Stamp::renew_own(path, self.known.inputs.get(&name), self.verify),
            false => Stamp::renew(path, self.known.inputs.get(&name), self.verify),
        }?;
        self.seen.insert(name, stamp.clone());
        Ok(stamp)
    }

    /// Hash of a file that was looked at.
    pub fn hash(&self, path: &Path) -> Option<String> {
        self.seen.get(&absolute(path)).map(|stamp| stamp.blake3.clone())
    }
}

/// A path that means the same from everywhere.
pub fn absolute(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).to_string_lossy().into_owned()
}

/// What is wrong with files that were written into `folder`.
pub fn changed_outputs(folder: &Path, outputs: &Outputs, verify: bool) -> Vec<String> {
    let changed = outputs.iter().filter_map(|(name, stamp)| {
        let path = folder.join(name);
        match stamp.is_intact(&path, verify) {
            true => None,
            false if !path.exists() => Some(format!("{name} is gone")),
            false => Some(format!("{name} is not as it was written")),
        }
    });
    changed.collect()
}
