//! The record of what is up to date: `derived/up-to-date.json`.
//!
//! It has what every trial, fit, figure and page was made of and which files it left. It is
//! written after these files: whatever is killed before leaves files that the record does not
//! describe, and these are made again.

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

/// Name of the record inside `derived/`.
pub(super) const RECORD_FILE: &str = "up-to-date.json";

/// Raise it when the meaning of the record changes: then everything is redone once.
const FORMAT: u32 = 4;

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
    pub inputs: Files,
    /// In order.
    pub targets: Vec<Made>,
    /// Files of the stage as a whole.
    pub outputs: Files,
    /// Sentences on what is not in the report.
    pub missing: Vec<String>,
    /// What the report says of tables that do not belong together.
    pub damaged: Vec<String>,
}

/// Files that a stage wrote, by their path in its folder.
pub(super) type Files = BTreeMap<String, Stamp>;

/// A target that was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Made {
    pub target: Target,
    pub parts: Key,
    /// What it is of, as [`super::plan::Wanted`] has it.
    pub of: Vec<String>,
    /// Its own files.
    pub outputs: Files,
}

impl Record {
    /// The record of a folder; an empty one, with the reason, if there is none that can be used.
    pub(super) fn load(derived: &Path) -> (Self, Option<String>) {
        let path = derived.join(RECORD_FILE);
        match read_json(&path, FORMAT, "not a record of trilink") {
            Ok(found) => (found.unwrap_or_default(), None),
            Err(why) => {
                (Self::default(), Some(format!("{}: {why}; everything is redone", path.display())))
            }
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

    /// The part of a stage, by its name.
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

/// What a JSON file of a `format` has; `None` if it is not there.
///
/// # Errors
/// It cannot be read, is of another format, or is not what it should be, which `unlike` says.
pub(super) fn read_json<T: DeserializeOwned>(
    path: &Path,
    format: u32,
    unlike: &str,
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
        _ => serde_json::from_slice(&json).map_err(|problem| format!("{unlike}: {problem}")),
    }
}

impl StageState {
    /// Files that the stage wrote, by their path in its folder.
    pub(super) fn written(&self) -> impl Iterator<Item = (&String, &Stamp)> {
        self.targets.iter().flat_map(|made| &made.outputs).chain(&self.outputs)
    }
}

/// Files that a stage reads, as they are now.
pub(super) struct Inputs(BTreeMap<PathBuf, io::Result<Stamp>>);

impl Inputs {
    /// Looks at files, of which the program's own are marked; reads those that may have changed
    /// since a stage of the record read or wrote them, or all to `verify` them.
    pub(super) fn look(
        paths: Vec<(PathBuf, bool)>,
        (derived, record): (&Path, &Record),
        known: &StageState,
        verify: bool,
    ) -> Self {
        let written: HashMap<&String, &Stamp> =
            record.ingest.written().chain(record.fit.written()).collect();
        let look = |(path, own): (PathBuf, bool)| {
            let name = name_in(derived, &path);
            let known = written.get(&name).copied().or_else(|| known.inputs.get(&name));
            let stamp = Stamp::renew(&path, known, own, verify);
            (path, stamp)
        };
        Self(paths.into_par_iter().map(look).collect())
    }

    /// A file, if it was looked at; or why it cannot be read.
    pub(super) fn get(&self, path: &Path) -> Option<Result<Stamp, ErrorKind>> {
        Some(match self.0.get(path)? {
            Ok(stamp) => Ok(stamp.clone()),
            Err(problem) => Err(problem.kind()),
        })
    }

    /// Whether all can be read.
    pub(super) fn are_whole(&self) -> bool {
        self.0.values().all(Result::is_ok)
    }

    /// Those that can be read, by their path from `derived/`.
    pub(super) fn stamps(&self, derived: &Path) -> Files {
        let named = |(path, found): (&PathBuf, &io::Result<Stamp>)| {
            Some((name_in(derived, path), found.as_ref().ok()?.clone()))
        };
        self.0.iter().filter_map(named).collect()
    }

    /// Reads these files as they are.
    ///
    /// # Errors
    /// One of them cannot be read.
    pub(super) fn into_reader(self) -> Result<Reader, StoreError> {
        let files = self.0.into_iter().map(|(path, found)| match found {
            Ok(stamp) => Ok((path, stamp)),
            Err(source) => Err(StoreError::Read { path, source }),
        });
        Ok(Reader(files.collect::<Result<_, _>>()?))
    }
}

/// What is wrong with files that were written into `folder`.
pub(super) fn changed_outputs(folder: &Path, outputs: &Files, verify: bool) -> Vec<String> {
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
