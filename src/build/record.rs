//! The record of what is up to date: `derived/up-to-date.json`.
//!
//! It has what every trial, fit, figure and page was made of and which files it left. It is
//! written after these files: whatever is killed before leaves files that the record does not
//! describe, and these are made again.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use trilink_base::files::{self, name_in};
use trilink_tables::{Reader, Stamp, StoreError, write_bytes};

use super::target::{Fingerprint, Target};

/// Name of the record inside `derived/`.
pub(super) const RECORD_FILE: &str = "up-to-date.json";

/// Raise it when the meaning of the record changes: then everything is redone once.
const FORMAT: u32 = 3;

/// The whole record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Record {
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
pub(super) struct StageState {
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
pub(super) type Outputs = BTreeMap<String, Stamp>;

/// A target that was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Made {
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
    pub(super) fn load(derived: &Path) -> (Self, Option<String>) {
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
    pub(super) fn save(&self, derived: &Path) -> Result<(), StoreError> {
        let json = serde_json::to_vec(self).expect("a record is plain data with text keys");
        write_bytes(&derived.join(RECORD_FILE), &json).map(|_| ())
    }
}

impl Record {
    /// The part of a stage, by its name.
    pub(super) fn state_mut(&mut self, stage: &str) -> &mut StageState {
        match stage {
            "ingest" => &mut self.ingest,
            "fit" => &mut self.fit,
            _ => &mut self.report,
        }
    }
}

impl StageState {
    /// Whether nothing is found out about the files that is worth to be recorded.
    pub(super) fn are_confirmed_by(&self, inputs: &BTreeMap<String, Stamp>) -> bool {
        let mut both = self.inputs.iter().zip(inputs);
        self.inputs.len() == inputs.len()
            && both.all(|((old_path, old), (path, new))| old_path == path && new.confirms(old))
    }

    /// Files that the stage wrote, by their path in its folder.
    pub(super) fn written(&self) -> impl Iterator<Item = (&String, &Stamp)> {
        self.targets.iter().flat_map(|made| &made.outputs).chain(&self.outputs)
    }
}

/// Files that a stage reads, read again only where they may have changed.
#[derive(Debug)]
pub(super) struct Inputs<'k> {
    derived: &'k Path,
    known: &'k StageState,
    verify: bool,
    /// The files in `derived/` as they were written.
    written: HashMap<&'k str, &'k Stamp>,
    /// Those that were looked at.
    seen: Mutex<HashMap<PathBuf, Stamp>>,
}

impl<'k> Inputs<'k> {
    /// The inputs of a stage of which the record knows so much.
    pub(super) fn new(
        derived: &'k Path,
        record: &'k Record,
        known: &'k StageState,
        verify: bool,
    ) -> Self {
        let written = record.ingest.written().chain(record.fit.written());
        let written = written.map(|(name, stamp)| (name.as_str(), stamp)).collect();
        Self { derived, known, verify, written, seen: Mutex::default() }
    }

    /// The stamp of a file; of one of its `own` that only who holds the lock writes.
    ///
    /// # Errors
    /// It cannot be read.
    pub(super) fn stamp(&self, path: &Path, own: bool) -> io::Result<Stamp> {
        let name = name_in(self.derived, path);
        let written = self.written.get(name.as_str()).copied();
        let known = written.or_else(|| self.known.inputs.get(&name));
        let stamp = Stamp::renew(path, known, own, self.verify)?;
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        seen.insert(path.to_owned(), stamp.clone());
        Ok(stamp)
    }

    /// [`Self::stamp`] of many.
    ///
    /// # Errors
    /// One of them cannot be read.
    pub(super) fn stamp_all(&self, paths: &[(PathBuf, bool)]) -> Result<(), StoreError> {
        paths.par_iter().try_for_each(|(path, own)| {
            let error = |source| StoreError::Read { path: path.clone(), source };
            self.stamp(path, *own).map(drop).map_err(error)
        })
    }

    /// Reads files that were looked at.
    pub(super) fn reader(&self) -> Reader {
        Reader(self.seen.lock().unwrap_or_else(PoisonError::into_inner).clone())
    }

    /// What was looked at, by its path from `derived/`.
    pub(super) fn named(self) -> BTreeMap<String, Stamp> {
        let named = |(path, stamp): (PathBuf, Stamp)| (name_in(self.derived, &path), stamp);
        let seen = self.seen.into_inner().unwrap_or_else(PoisonError::into_inner);
        seen.into_iter().map(named).collect()
    }

    /// Whether these are the files that the stage read, unchanged.
    pub(super) fn are_read(&self, paths: &[(PathBuf, bool)]) -> bool {
        let is_read = |(path, _): &(PathBuf, bool)| {
            let known = self.known.inputs.get(&name_in(self.derived, path));
            known.is_some_and(|stamp| stamp.is_intact(path, self.verify))
        };
        paths.len() == self.known.inputs.len() && paths.par_iter().all(is_read)
    }
}

/// What is wrong with files that were written into `folder`.
pub(super) fn changed_outputs(folder: &Path, outputs: &Outputs, verify: bool) -> Vec<String> {
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
