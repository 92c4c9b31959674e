//! The record of what is up to date: `derived/up-to-date.json`.
//!
//! It has what every trial, fit, figure and page was made of and which files it left. It is
//! written after these files: whatever is killed before leaves files that the record does not
//! describe, and these are made again.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::target::{Fingerprint, Target};
use crate::files::{self, name_in};
use crate::store::{Reader, Stamp, StoreError, write_bytes};

/// Name of the record inside `derived/`.
pub const RECORD_FILE: &str = "up-to-date.json";

/// Raise it when the meaning of the record changes: then everything is redone once.
const FORMAT: u32 = 3;

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
    /// Files that were read, by their path from `derived/`.
    pub inputs: BTreeMap<String, Stamp>,
    /// In order.
    pub targets: Vec<Made>,
    /// Files of the stage as a whole, by their path in its folder.
    pub outputs: Outputs,
    /// Sentences on what is not in the report.
    pub missing: Vec<String>,
    /// What the report says of tables that do not belong together.
    #[serde(default)]
    pub damaged: Vec<String>,
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
        let json = match files::read(&path, files::TEXT_BYTES) {
            Ok((json, _)) => json,
            Err(problem) if problem.kind() == ErrorKind::NotFound => return Default::default(),
            Err(problem) => return unusable(format!("cannot be read: {problem}")),
        };
        let found = serde_json::from_slice::<Self>(&json);
        let format = match &found {
            Ok(record) => Some(record.format),
            Err(_) => serde_json::from_slice(&json).ok().map(|Format { format }| format),
        };
        match (found, format) {
            (_, Some(format)) if format != FORMAT => {
                unusable(format!("found a record of format {format}, needed format {FORMAT}"))
            }
            (Ok(record), _) => (record, None),
            (Err(problem), _) => unusable(format!("not a record of trilink: {problem}")),
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
    /// The part of a stage, by its name.
    pub fn state_mut(&mut self, stage: &str) -> &mut StageState {
        match stage {
            "ingest" => &mut self.ingest,
            "fit" => &mut self.fit,
            _ => &mut self.report,
        }
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

    /// Files that the stage wrote, by their path in its folder.
    pub fn written(&self) -> impl Iterator<Item = (&String, &Stamp)> {
        self.targets.iter().flat_map(|made| &made.outputs).chain(&self.outputs)
    }
}

/// Files that a stage reads, read again only where they may have changed.
#[derive(Debug)]
pub struct Inputs<'k> {
    derived: &'k Path,
    known: &'k StageState,
    verify: bool,
    /// The files in `derived/` as they were written.
    written: Reader,
    /// Those that were looked at.
    pub seen: HashMap<PathBuf, Stamp>,
}

impl<'k> Inputs<'k> {
    /// The inputs of a stage of which the record knows so much.
    pub fn new(derived: &'k Path, record: &'k Record, known: &'k StageState, verify: bool) -> Self {
        let written = record.ingest.written().chain(record.fit.written());
        let written = written.map(|(name, stamp)| (derived.join(name), stamp.clone()));
        let written = Reader(written.collect());
        Self { derived, known, verify, written, seen: HashMap::new() }
    }

    /// Reads tables that must be as they were written.
    pub fn of_written(&self) -> &Reader {
        &self.written
    }

    /// The stamp of a file; of one of its `own` that only who holds the lock writes.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn stamp(&mut self, path: &Path, own: bool) -> io::Result<Stamp> {
        let written = self.written.0.get(path);
        let known = written.or_else(|| self.known.inputs.get(&name_in(self.derived, path)));
        let stamp = Stamp::renew(path, known, own, self.verify)?;
        self.seen.insert(path.to_owned(), stamp.clone());
        Ok(stamp)
    }

    /// Reads files that were looked at.
    pub fn reader(&self) -> Reader {
        Reader(self.seen.clone())
    }

    /// What was looked at, by its path from `derived/`.
    pub fn named(self) -> BTreeMap<String, Stamp> {
        let named = |(path, stamp): (PathBuf, Stamp)| (name_in(self.derived, &path), stamp);
        self.seen.into_iter().map(named).collect()
    }

    /// Whether these are the files that the stage read, unchanged.
    pub fn are_read<'p>(&self, mut paths: impl Iterator<Item = &'p Path>) -> bool {
        let mut count = 0;
        let all_current = paths.all(|path| {
            count += 1;
            let known = self.known.inputs.get(&name_in(self.derived, path));
            known.is_some_and(|stamp| stamp.is_intact(path, self.verify))
        });
        all_current && count == self.known.inputs.len()
    }
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
