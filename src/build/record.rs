//! Record of the results that are up to date: `derived/up-to-date.json`.
//!
//! The record lists for every trial, fit, figure and report page the key of its inputs and the files written. It is
//! saved after these files, so a killed run leaves files that the record does not describe, which are then recomputed.

use std::collections::{BTreeMap, HashMap};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use trilink_base::files::{self, name_in};
use trilink_tables::{Reader, Stamp, StoreError, write_bytes};

use super::target::{Key, Target};

/// Name of the file in `derived/` that records what each result was made from.
pub(super) const RECORD_FILE: &str = "up-to-date.json";

/// Version of the format of `up-to-date.json`; a new version makes all results stale.
const FORMAT: u32 = 4;

/// Content of `up-to-date.json`: what the results of each stage were made from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Record {
    format: u32,
    pub ingest: StageState,
    pub fit: StageState,
    pub report: StageState,
    /// Stamp of `run.json`, if a run has been recorded.
    pub run: Option<Stamp>,
}

/// Record of a stage: its settings, the files that it read and wrote, and the targets that it made.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StageState {
    /// Hash of the stage's source code.
    pub source: String,
    /// Settings that affect the stage as a whole, not a single target.
    pub whole: Value,
    /// Settings of the targets, indexed by the hash of the settings.
    pub settings: BTreeMap<String, Value>,
    /// Files read, indexed by their path relative to `derived/`.
    pub inputs: Files,
    /// Records of the targets, in the order in which the stage lists its targets.
    pub targets: Vec<TargetRecord>,
    /// Files that belong to no single target, indexed by their path in the folder that the stage writes to.
    pub outputs: Files,
    /// Sentences about what is missing from the report.
    pub missing: Vec<String>,
    /// Sentences about damaged or inconsistent tables of trials, for the report.
    pub damaged: Vec<String>,
}

/// Stamps of files, indexed by their path relative to a folder.
pub(super) type Files = BTreeMap<String, Stamp>;

/// Record of a target that was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TargetRecord {
    pub target: Target,
    #[serde(rename = "parts")]
    pub key: Key,
    /// Trials, campaigns and robots on which the target depends, as in [`super::plan::TargetSpec`].
    #[serde(rename = "of")]
    pub subjects: Vec<String>,
    /// Files of the target, indexed by their path in the stage's folder.
    pub outputs: Files,
}

impl Record {
    /// Reads the record in the folder `derived`. Returns an empty record if the file is missing or unusable; if it is
    /// unusable, also returns the reason.
    pub(super) fn load(derived: &Path) -> (Self, Option<String>) {
        let path = derived.join(RECORD_FILE);
        match read_json(&path, FORMAT, "not a record written by trilink") {
            Ok(found) => (found.unwrap_or_default(), None),
            Err(why) => (
                Self::default(),
                Some(format!("{}: {why}; everything is recomputed", path.display())),
            ),
        }
    }

    /// Writes the record into the folder `derived`.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written.
    pub(super) fn save(&self, derived: &Path) -> Result<(), StoreError> {
        let json = serde_json::to_vec(self).expect("a record with text keys can be serialised");
        write_bytes(&derived.join(RECORD_FILE), &json).map(|_| ())
    }

    /// Returns the record of the stage with this name.
    pub(super) fn state_mut(&mut self, stage: &str) -> &mut StageState {
        match stage {
            "ingest" => &mut self.ingest,
            "fit" => &mut self.fit,
            _ => &mut self.report,
        }
    }
}

impl Default for Record {
    fn default() -> Self {
        let [ingest, fit, report] = std::array::from_fn(|_| StageState::default());
        Self { format: FORMAT, ingest, fit, report, run: None }
    }
}

/// Reads a JSON file whose key `format` must have the value of the argument `format`; returns `None` if the file does
/// not exist.
///
/// # Errors
/// Returns a message if the file cannot be read, has another format version, or has unexpected content. In the last
/// case the message begins with the text that the argument `invalid` holds.
pub(super) fn read_json<T: DeserializeOwned>(
    path: &Path,
    format: u32,
    invalid: &str,
) -> Result<Option<T>, String> {
    #[derive(Deserialize)]
    struct Format {
        format: u32,
    }
    let json = match files::read(path, files::TEXT_BYTES) {
        Ok((json, _)) => json,
        Err(problem) if problem.kind() == ErrorKind::NotFound => return Ok(None),
        Err(problem) => return Err(format!("cannot be read: {problem}")),
    };
    match serde_json::from_slice(&json) {
        Ok(Format { format: found }) if found != format => {
            Err(format!("found format {found}, needed {format}"))
        }
        _ => serde_json::from_slice(&json).map_err(|problem| format!("{invalid}: {problem}")),
    }
}

impl StageState {
    /// Returns all files that the stage wrote, with their path in the stage's folder.
    pub(super) fn written(&self) -> impl Iterator<Item = (&String, &Stamp)> {
        self.targets.iter().flat_map(|made| &made.outputs).chain(&self.outputs)
    }
}

/// Current state of the files that a stage reads.
pub(super) struct Inputs(BTreeMap<PathBuf, io::Result<Stamp>>);

impl Inputs {
    /// Stamps the files at `paths`, each given with a flag that is true if this program wrote the file. A file is read
    /// only if it may have changed since a stage in the record read or wrote it, or if `verify` is set.
    pub(super) fn check(
        paths: Vec<(PathBuf, bool)>,
        (derived, record): (&Path, &Record),
        known: &StageState,
        verify: bool,
    ) -> Self {
        let written: HashMap<&String, &Stamp> =
            record.ingest.written().chain(record.fit.written()).collect();
        let stamps = paths.into_par_iter().map(|(path, is_own)| {
            let name = name_in(derived, &path);
            let known = written.get(&name).copied().or_else(|| known.inputs.get(&name));
            let stamp = Stamp::renew(&path, known, is_own, verify);
            (path, stamp)
        });
        Self(stamps.collect())
    }

    /// Returns the stamp of a file, or the reason why it cannot be read; `None` if the file was not checked.
    pub(super) fn get(&self, path: &Path) -> Option<Result<Stamp, ErrorKind>> {
        Some(match self.0.get(path)? {
            Ok(stamp) => Ok(stamp.clone()),
            Err(problem) => Err(problem.kind()),
        })
    }

    /// Whether all files can be read.
    pub(super) fn are_readable(&self) -> bool {
        self.0.values().all(Result::is_ok)
    }

    /// Returns the stamps of the readable files, indexed by their path relative to `derived/`.
    pub(super) fn stamps(&self, derived: &Path) -> Files {
        let readable = self.0.iter().filter_map(|(path, found)| Some((path, found.as_ref().ok()?)));
        readable.map(|(path, stamp)| (name_in(derived, path), stamp.clone())).collect()
    }

    /// Returns a reader that rejects files whose content does not match their stamps.
    ///
    /// # Errors
    /// Returns an error if one of the files cannot be read.
    pub(super) fn into_reader(self) -> Result<Reader, StoreError> {
        let files = self.0.into_iter().map(|(path, found)| match found {
            Ok(stamp) => Ok((path, stamp)),
            Err(source) => Err(StoreError::Read { path, source }),
        });
        Ok(Reader(files.collect::<Result<_, _>>()?))
    }
}

/// Returns a sentence for each file in `folder` that is missing or has changed since it was written.
pub(super) fn changed_outputs(folder: &Path, outputs: &Files, verify: bool) -> Vec<String> {
    let changed = outputs.iter().filter_map(|(name, stamp)| {
        let path = folder.join(name);
        if stamp.is_intact(&path, verify) {
            None
        } else if path.exists() {
            Some(format!("{name} has changed since it was written"))
        } else {
            Some(format!("{name} no longer exists"))
        }
    });
    changed.collect()
}
