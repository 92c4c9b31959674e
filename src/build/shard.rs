//! A part of a stage, on a machine that shares nothing with the others' but a folder.
//!
//! A part of an ingest is the stage of some of the trials, one of a fit some replicates of its
//! bootstrap. The manifest of a part, which is written last, says what it was made of and which
//! files it left, and nothing of the machine.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};
use trilink_base::cancel::CancelToken;
use trilink_fit::{FitData, Replicates};
use trilink_ingest::{Ingested, TABLES};
use trilink_tables::config::{Config, GaitInput};
use trilink_tables::{BootstrapRow, Columns as _, Provenance, StoreError, write_bytes};

use super::fit::FitStage;
use super::ingest::IngestStage;
use super::lock::share;
use super::part::{Division, Part};
use super::plan::{RerunOptions, Stage, hash_of, plan};
use super::record::{Inputs, Record, StageState};
use super::{RunError, Watch, hold_places, interruptible, table_folders};

/// Name of the manifest inside of a part's folder.
pub(super) const MANIFEST: &str = "manifest.json";
/// Raise it when the meaning of the manifest changes.
pub(super) const FORMAT: u32 = 1;

/// What a part was made of and what it left.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    pub format: u32,
    pub version: String,
    pub part: Part,
    /// Names of the trial folders of an ingest.
    pub folders: Vec<String>,
    /// Hash of the configuration and of all that all parts are made of.
    pub project: String,
    /// The stage's record, without times.
    pub state: StageState,
}

/// Table of replicates of models that are driven so.
pub(super) fn replicates_table(driven_by: GaitInput) -> String {
    format!("{driven_by}-bootstrap.parquet")
}

/// Hash of all that a stage is made of.
pub(super) fn project<S: Stage>(stage: &S, sources: &S::Sources) -> String {
    let wanted = stage.wanted(sources);
    let parts: Vec<_> = wanted.iter().map(|wanted| (&wanted.target, &wanted.parts)).collect();
    hash_of(&(stage.whole(), parts))
}

/// The models of a fit whatever the number of their replicates, the tables that they are fitted
/// to, and the hash of both.
///
/// # Errors
/// There are no tables, or they cannot be read.
pub(super) fn fit_of_any_number(config: &Config) -> Result<(FitStage, FitData, String), RunError> {
    let mut any = config.clone();
    any.fit.bootstrap = 0;
    let any = FitStage::new(&any).without_shared();
    let (record, derived) = (Record::default(), &config.paths.derived);
    let data = any.read(&Inputs::new(derived, &record, &record.fit, false))?;
    let project = project(&any, &data);
    Ok((FitStage::new(config), data, project))
}

/// Says with every step of which part it is.
struct OfPart<'w>(Part, &'w dyn Watch);

impl Watch for OfPart<'_> {
    fn begin(&self, stage: &'static str, total: usize) {
        self.1.begin(stage, total);
    }

    fn step(&self, what: &str) {
        self.1.step(&format!("{what}, {}", self.0));
    }

    fn part(&self, what: &str, done: usize, total: usize) {
        self.1.part(&format!("{what} of {}", self.0), done, total);
    }

    fn cancel_token(&self) -> CancelToken {
        self.1.cancel_token()
    }

    fn note(&self, message: &str) {
        self.1.note(message);
    }
}

/// Makes a part by `work` in a folder of its own inside of `shards`, and its manifest; gives that
/// folder, too.
fn make<S: Stage, T>(
    (part, shards): (Part, &Path),
    (project, folders): (String, Vec<String>),
    (wait, watch): (bool, &dyn Watch),
    work: impl FnOnce(&Path, &dyn Watch) -> Result<(T, StageState), RunError>,
) -> Result<(T, PathBuf), RunError> {
    let home = shards.join(part.folder());
    let manifest = home.join(MANIFEST);
    let (places, mut files) = match part.division {
        Division::Trials { .. } => {
            (table_folders(&home), TABLES.map(|name| home.join(name)).into())
        }
        Division::Replicates => (vec![home.clone()], Vec::new()),
    };
    files.push(manifest.clone());
    let _lock = hold_places(&places, &files, wait, watch)?;
    match std::fs::remove_file(&manifest) {
        Err(source) if source.kind() != ErrorKind::NotFound => {
            return Err(StoreError::Remove { path: manifest, source }.into());
        }
        _ => {}
    }
    tracing::info!(stage = S::NAME, %part, "part begins");
    let (output, mut state) = interruptible(S::NAME, || work(&home, &OfPart(part, watch)))?;
    state.inputs.clear();
    let of_targets = state.targets.iter_mut().flat_map(|made| made.outputs.values_mut());
    of_targets.chain(state.outputs.values_mut()).for_each(|stamp| stamp.modified_ns = None);
    let version = env!("CARGO_PKG_VERSION").to_owned();
    let made = Manifest { format: FORMAT, version, part, folders, project, state };
    let json = serde_json::to_vec(&made).expect("a manifest is plain data with text keys");
    write_bytes(&manifest, &json)?;
    tracing::info!(stage = S::NAME, %part, "part done");
    Ok((output, home))
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
    let whole = IngestStage::new(config)?;
    let common = (project(&whole, &()), whole.folders().cloned().collect());
    make::<IngestStage, _>((part, shards), common, (wait, watch), |home, watch| {
        let stage = whole.of_some(|trial| part.has(trial), home);
        let record = Record::default();
        let planned = plan(&stage, home, &record, RerunOptions::FORCE)?;
        let (ingested, _, state) = planned.carry_out(&stage, watch)?;
        Ok((ingested, state))
    })
}

/// Fits some replicates of all models, without what campaigns share, into a folder of their own inside of `shards`; gives how many
/// there are of all models, and that folder. The fits themselves are made, too, and not kept.
///
/// # Errors
/// The tables of an ingest are not there, a file cannot be written, more replicates are asked for
/// than `fit.bootstrap` has, or another process is busy with this part.
pub fn fit_shard(
    config: &Config,
    part: Part,
    shards: &Path,
    wait: bool,
    watch: &dyn Watch,
) -> Result<(usize, PathBuf), RunError> {
    if part.to > config.fit.bootstrap {
        return Err(RunError::Replicates { part, bootstrap: config.fit.bootstrap });
    }
    let reading = share(&config.paths.derived).map_err(RunError::of_lock)?;
    let (stage, data, project) = fit_of_any_number(config)?;
    let stage = stage.without_shared();
    drop(reading);
    let provenance = Provenance { input: project.clone() };
    make::<FitStage, _>((part, shards), (project, Vec::new()), (wait, watch), |home, watch| {
        let rows = Mutex::new(BTreeMap::<GaitInput, Vec<BootstrapRow>>::new());
        let on_replicate = |driven_by, row: &BootstrapRow| {
            let mut rows = rows.lock().unwrap_or_else(PoisonError::into_inner);
            rows.entry(driven_by).or_default().push(row.clone());
        };
        let replicates = Replicates { numbers: part.from..part.to, given: BTreeMap::new() };
        watch.begin(FitStage::NAME, stage.wanted(&data).len());
        stage.fit(&data, BTreeMap::new(), &replicates, watch, &on_replicate)?;
        let mut rows = rows.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut state = StageState { source: FitStage::SOURCE.to_owned(), ..StageState::default() };
        let mut count = 0;
        for driven_by in GaitInput::ALL {
            let (name, mut rows) =
                (replicates_table(driven_by), rows.remove(&driven_by).unwrap_or_default());
            rows.sort_by(|a, b| {
                let key = |row: &BootstrapRow| (row.campaign.clone(), row.model, row.replicate);
                key(a).cmp(&key(b))
            });
            count += rows.len();
            let stamp =
                BootstrapRow::to_table(&rows).write_if_changed(&home.join(&name), &provenance)?;
            state.outputs.insert(name, stamp);
        }
        Ok((count, state))
    })
}
