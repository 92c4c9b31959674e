//! A part of the trials, on a machine that shares nothing with the others' but a folder.
//!
//! A part is the stage of some of the trials with its tables elsewhere. Its manifest, which is
//! written last, says what it was made of and which files it left, and nothing of the machine.

use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::ingest::IngestStage;
use super::plan::{RerunOptions, Stage, hash_of, plan};
use super::record::{Record, StageState};
use super::{RunError, Watch, hold_places, interruptible, table_folders};
use crate::config::Config;
use crate::ingest::{Ingested, TABLES};
use crate::store::{StoreError, write_bytes};

/// Name of the manifest inside of a part's folder.
pub const MANIFEST: &str = "manifest.json";
/// Raise it when the meaning of the manifest changes.
pub const FORMAT: u32 = 1;
/// Most parts: an array of jobs has no more.
const MOST_PARTS: usize = 100_000;

/// One of several parts of all trials: `3/8` is the third of eight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Part {
    pub of: usize,
    /// From 1 on.
    pub number: usize,
}

impl Part {
    /// Name of its folder.
    pub fn folder(self) -> String {
        format!("{}-of-{}", self.number, self.of)
    }

    /// The part whose folder has this name.
    pub fn of_folder(name: &str) -> Option<Self> {
        let part: Self = name.replacen("-of-", "/", 1).parse().ok()?;
        (part.folder() == name).then_some(part)
    }

    /// Whether a trial falls on it.
    pub fn has(self, trial: &str) -> bool {
        let hash = blake3::hash(trial.as_bytes());
        let first = hash.as_bytes().first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
        first % self.of as u64 == self.number as u64 - 1
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.of)
    }
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('/').map(|(number, of)| (number.parse(), of.parse()));
        match numbers {
            Some((Ok(number), Ok(of))) if (1..=MOST_PARTS).contains(&of) => {
                let is_one = (1..=of).contains(&number);
                let needed = || format!("found `{text}`, needed a part from 1/{of} to {of}/{of}");
                is_one.then_some(Self { of, number }).ok_or_else(needed)
            }
            _ => Err(format!(
                "found `{text}`, needed a part such as 3/8, the third of eight, of {MOST_PARTS} at \
                 most"
            )),
        }
    }
}

impl TryFrom<String> for Part {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Part> for String {
    fn from(part: Part) -> Self {
        part.to_string()
    }
}

/// What a part was made of and what it left.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    pub format: u32,
    pub version: String,
    pub part: Part,
    /// Names of the trial folders.
    pub folders: Vec<String>,
    /// Hash of the configuration and of the lists of all trials.
    pub project: String,
    /// The stage's record, without times.
    pub state: StageState,
}

/// What all parts of a stage have in common.
pub fn project(stage: &IngestStage) -> String {
    let wanted = stage.wanted(&());
    let parts: Vec<_> = wanted.iter().map(|wanted| (&wanted.target, &wanted.parts)).collect();
    hash_of(&(stage.whole(), parts))
}

/// Says with every step of which part it is.
struct OfPart<'w>(Part, &'w dyn Watch);

impl Watch for OfPart<'_> {
    fn begin(&self, stage: &'static str, total: usize) {
        self.1.begin(stage, total);
    }

    fn step(&self, what: &str) {
        self.1.step(&format!("{what}, part {}", self.0));
    }

    fn note(&self, message: &str) {
        self.1.note(message);
    }
}

/// Ingests one part of the trials into a folder of its own inside of `shards`; gives that folder,
/// too. What trials show only together is not looked for.
///
/// # Errors
/// A list of trials cannot be read, a file not be written, or another process is busy with this
/// part.
pub fn ingest_shard(
    config: &Config,
    part: Part,
    shards: &Path,
    wait: bool,
    watch: &dyn Watch,
) -> Result<(Ingested, PathBuf), RunError> {
    let (whole, home) = (IngestStage::new(config)?, shards.join(part.folder()));
    let (project, folders) = (project(&whole), whole.folders().cloned().collect());
    let manifest = home.join(MANIFEST);
    let mut files = vec![manifest.clone()];
    files.extend(TABLES.map(|name| home.join(name)));
    let _lock = hold_places(&table_folders(&home), &files, wait, watch)?;
    match std::fs::remove_file(&manifest) {
        Err(source) if source.kind() != ErrorKind::NotFound => {
            return Err(StoreError::Remove { path: manifest, source }.into());
        }
        _ => {}
    }
    let stage = whole.of_some(|trial| part.has(trial), &home);
    tracing::info!(stage = IngestStage::NAME, %part, trials = stage.trials().count(), "part begins");
    let record = Record::default();
    let (ingested, _, mut state) = interruptible(IngestStage::NAME, || {
        let planned = plan(&stage, &home, &record, RerunOptions::FORCE)?;
        planned.carry_out(&stage, &OfPart(part, watch))
    })?;
    state.inputs.clear();
    let of_targets = state.targets.iter_mut().flat_map(|made| made.outputs.values_mut());
    of_targets.chain(state.outputs.values_mut()).for_each(|stamp| stamp.modified_ns = None);
    let version = env!("CARGO_PKG_VERSION").to_owned();
    let made = Manifest { format: FORMAT, version, part, folders, project, state };
    let json = serde_json::to_vec(&made).expect("a manifest is plain data with text keys");
    write_bytes(&manifest, &json)?;
    tracing::info!(stage = IngestStage::NAME, %part, "part done");
    Ok((ingested, home))
}
