//! Stages divided into shards. Each shard is computed by a machine that shares only a folder with the others; the
//! shards are then merged into the tables that an undivided stage would write.
//!
//! An ingest shard processes some of the trials, and a fit shard computes some of the bootstrap replicates. The
//! manifest of a shard, which is written last, lists its inputs and files, but nothing about the machine.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Component::Normal, Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use trilink_base::cancel::CancelToken;
use trilink_fit::{FitData, Fitted, Replicates};
use trilink_ingest::{Ingested, TABLES};
use trilink_tables::config::{Config, GaitInput};
use trilink_tables::{
    BootstrapRow, Columns as _, Provenance, Reader, StoreError, write_bytes, write_if_changed,
};

use super::fit::FitStage;
use super::ingest::IngestStage;
use super::lock::{hold_places, share, table_folders, take_over};
use super::plan::{RerunOptions, Retained, Stage, TargetSpec, hash_of, join, plan};
use super::record::{Inputs, Record, StageState, changed_outputs, read_json};
use super::shard::{Division, Shard};
use super::steps::Steps;
use super::target::{Kind, Target};
use super::{RunError, Sequence, Watch, count};

/// Name of the manifest in the folder of a shard.
const MANIFEST: &str = "manifest.json";
/// Version of the manifest's format.
const FORMAT: u32 = 2;
/// Number of threads that copy files: many, because they mostly wait for the disk.
const COPY_THREADS: usize = 16;

/// Manifest of a shard, which lists its inputs and files.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    format: u32,
    version: String,
    #[serde(rename = "part")]
    shard: Shard,
    /// Description of the shard's content for the user.
    content: String,
    /// Names of the trial folders that were ingested.
    folders: Vec<String>,
    /// Hash of the settings and inputs that all shards of the stage have in common.
    project: String,
    /// Record of the stage, without modification times.
    state: StageState,
}

/// Returns the name of the table of bootstrap replicates for models with this gait input.
fn replicates_table(driven_by: GaitInput) -> String {
    format!("{driven_by}-bootstrap.parquet")
}

/// Hashes the settings of a stage and the keys of all of its targets.
fn project_hash(stage: &impl Stage, specs: &[TargetSpec]) -> String {
    let keys: Vec<_> = specs.iter().map(|spec| (&spec.target, &spec.key)).collect();
    hash_of(&(stage.stage_settings(), keys))
}

/// Hashes the settings and the lists of trials of an ingest.
fn ingest_project_hash(stage: &IngestStage) -> String {
    project_hash(stage, &stage.expected_specs(&StageState::default()))
}

/// Returns the fit stage, the tables to fit, and a hash of both that does not depend on the number of bootstrap
/// replicates.
///
/// # Errors
/// Returns an error if the tables are missing or cannot be read.
fn load_fit(config: &Config) -> Result<(FitStage, FitData, String), RunError> {
    let mut without_bootstrap = config.clone();
    without_bootstrap.fit.bootstrap = 0;
    let stage = FitStage::new(&without_bootstrap).without_shared();
    let record = Record::default();
    let paths = stage.input_paths(&record.fit)?;
    let inputs = Inputs::check(paths, (&config.paths.derived, &record), &record.fit, false);
    let data = stage.read(inputs)?;
    let project = project_hash(&stage, &stage.specs_with(Some(&data)));
    Ok((FitStage::new(config), data, project))
}

/// Creates a shard in its own subfolder of `shards`: calls `work` with the path of the subfolder and the shard's name,
/// and then writes the manifest. `work` returns an output, a description of the shard's content and the record of the
/// stage. Returns that output and the path of the subfolder.
fn make<S: Stage, T>(
    (shard, shards): (Shard, &Path),
    (project, folders): (String, Vec<String>),
    (wait, watch): (bool, &dyn Watch),
    work: impl FnOnce(&Path, &str) -> Result<(T, String, StageState), RunError>,
) -> Result<(T, PathBuf), RunError> {
    let home = shards.join(shard.folder());
    let manifest = home.join(MANIFEST);
    let (folders_to_write, mut files) = match shard.division {
        Division::Trials { .. } => {
            (table_folders(&home), TABLES.map(|name| home.join(name)).into())
        }
        Division::Replicates => (vec![home.clone()], Vec::new()),
    };
    files.push(manifest.clone());
    let _lock = hold_places(&folders_to_write, &files, wait, watch)?;
    match std::fs::remove_file(&manifest) {
        Err(source) if source.kind() != ErrorKind::NotFound => {
            return Err(StoreError::Remove { path: manifest, source }.into());
        }
        _ => {}
    }
    tracing::info!(stage = S::NAME, %shard, "shard begins");
    let (output, content, mut state) = work(&home, &shard.to_string())?;
    state.inputs.clear();
    let target_stamps = state.targets.iter_mut().flat_map(|made| made.outputs.values_mut());
    target_stamps.chain(state.outputs.values_mut()).for_each(|stamp| stamp.modified_ns = None);
    let version = env!("CARGO_PKG_VERSION").to_owned();
    let made = Manifest { format: FORMAT, version, shard, content, folders, project, state };
    let json = serde_json::to_vec(&made).expect("a manifest with text keys can be serialised");
    write_bytes(&manifest, &json)?;
    tracing::info!(stage = S::NAME, %shard, "shard done");
    Ok((output, home))
}

/// Ingests one shard of the trials into its own subfolder of `shards`, without the checks across trials. Returns the
/// results and the path of the subfolder.
///
/// # Errors
/// Returns an error if a list of trials cannot be read, a file cannot be written, or another process uses the shard.
pub fn ingest_shard(
    config: &Config,
    shard: Shard,
    shards: &Path,
    wait: bool,
    watch: &dyn Watch,
) -> Result<(Ingested, PathBuf), RunError> {
    let whole = IngestStage::new(config)?;
    let common = (ingest_project_hash(&whole), whole.folders().cloned().collect());
    make::<IngestStage, _>((shard, shards), common, (wait, watch), |home, name| {
        let stage = whole.restrict(|trial| shard.has(trial), home);
        let record = Record::default();
        let planned = plan(&stage, home, &record, RerunOptions::FORCE)?;
        let (ingested, _, state) = planned.carry_out(&stage, (watch, name))?;
        let counts = count(&ingested.trials);
        let mut content = format!("{} trials", counts.total);
        if counts.failed > 0 {
            content += &format!(", {} failed", counts.failed);
        }
        Ok((ingested, content, state))
    })
}

/// Bootstrap replicates, indexed by the gait input of the models.
type Refits = BTreeMap<GaitInput, Vec<BootstrapRow>>;

/// Computes the bootstrap replicates of a shard for all models and writes them to the shard's own subfolder of
/// `shards`; fits to several campaigns are left out. Returns the number of replicates summed over the models, and the
/// path of the subfolder. The fits to the measured trials are also computed, but not written.
///
/// # Errors
/// Returns an error if the tables of an ingest are missing, a file cannot be written, a replicate's number exceeds
/// `fit.bootstrap`, or another process uses the shard.
pub fn fit_shard(
    config: &Config,
    shard: Shard,
    shards: &Path,
    wait: bool,
    watch: &dyn Watch,
) -> Result<(usize, PathBuf), RunError> {
    if shard.to > config.fit.bootstrap {
        return Err(RunError::Replicates { shard, bootstrap: config.fit.bootstrap });
    }
    let reading = share(&config.paths.derived).map_err(RunError::from_lock)?;
    let (stage, data, project) = load_fit(config)?;
    let mut stage = stage.without_shared();
    drop(reading);
    stage.replicates = Replicates { numbers: shard.from..shard.to, given: Refits::new() };
    let provenance = Provenance { input: project.clone() };
    make::<FitStage, _>((shard, shards), (project, Vec::new()), (wait, watch), |home, name| {
        let rows = Mutex::new(Refits::new());
        let on_replicate = |driven_by, row: &BootstrapRow| {
            let mut rows = rows.lock().unwrap_or_else(PoisonError::into_inner);
            rows.entry(driven_by).or_default().push(row.clone());
        };
        let steps = Steps::begin::<FitStage>(watch, stage.specs_with(None).len(), name);
        steps.end::<FitStage, _>(stage.fit(&data, BTreeMap::new(), &steps, &on_replicate))?;
        let mut refits = rows.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut state = StageState { source: FitStage::SOURCE.to_owned(), ..Default::default() };
        let mut count = 0;
        for driven_by in GaitInput::ALL {
            let mut rows = refits.remove(&driven_by).unwrap_or_default();
            rows.sort_by_cached_key(|row| (row.campaign.clone(), row.model, row.replicate));
            count += rows.len();
            let file = replicates_table(driven_by);
            let table = BootstrapRow::to_table(&rows);
            let stamp = table.write_if_changed(&home.join(&file), &provenance)?;
            state.outputs.insert(file, stamp);
        }
        Ok((count, name.to_owned(), state))
    })
}

/// Status of a shard.
#[derive(Debug)]
pub enum ShardStatus {
    /// Complete, with a description of the shard's content.
    Whole(String),
    Missing,
    /// Still in progress or killed: a folder without a manifest.
    Unfinished,
    /// Unusable, with the reason.
    Refused(String),
}

impl fmt::Display for ShardStatus {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Whole(text) | Self::Refused(text) => write!(f, "{text}"),
            Self::Missing => write!(f, "missing"),
            Self::Unfinished => {
                write!(
                    f,
                    "unfinished: {MANIFEST}, which is written last, is missing; the command was \
                     killed or is still running"
                )
            }
        }
    }
}

/// Status of all shards.
#[derive(Debug)]
pub struct ShardsStatus {
    division: Division,
    /// Shards in numerical order, each with its actual or expected folder.
    pub shards: Vec<(PathBuf, Shard, ShardStatus)>,
}

impl ShardsStatus {
    /// Whether every shard is complete and none occurs twice.
    pub fn is_whole(&self) -> bool {
        self.shards.iter().all(|(.., status)| matches!(status, ShardStatus::Whole(_)))
    }

    /// Returns the option that selects the shards to compute again: `--array=..` of a cluster's job array for ingest
    /// shards, `--replicates ..` of `trilink fit` for replicates; empty if there are no such shards.
    pub fn again(&self) -> String {
        let open = self.shards.iter().filter(|(_, shard, status)| {
            shard.division == self.division && !matches!(status, ShardStatus::Whole(_))
        });
        let open: BTreeSet<Shard> = open.map(|(_, shard, _)| *shard).collect();
        let (option, format): (_, fn(&Shard) -> String) = match self.division {
            _ if open.is_empty() => return String::new(),
            Division::Trials { .. } => ("--array=", |shard| shard.from.to_string()),
            Division::Replicates => {
                ("--replicates ", |shard| format!("{}..{}", shard.from, shard.to))
            }
        };
        option.to_owned() + &open.iter().map(format).collect::<Vec<_>>().join(",")
    }
}

/// Returns the status of all shards in a folder. Writes nothing.
///
/// # Errors
/// Returns an error if there is no shard, or if the lists of trials or the tables that the shards were made from cannot
/// be read.
pub fn shards_status(config: &Config, shards: &Path) -> Result<ShardsStatus, RunError> {
    Ok(check_shards(config, shards)?.2)
}

/// Folder of a shard, the shard, and its manifest or the reason why it cannot be merged.
type Found = (PathBuf, Shard, Result<Manifest, ShardStatus>);

/// Folders and manifests of the shards that can be merged.
type Shards = Vec<(PathBuf, Manifest)>;

/// Undivided stage to which a set of shards belongs.
enum Whole {
    Trials(IngestStage),
    /// Fit, with the hash of its settings and inputs.
    Replicates(String),
}

/// Checks all shards in a folder. Returns the stage to which they belong, the shards that can be merged, and the status
/// of every shard.
///
/// # Errors
/// Returns an error if there is no shard, or if the lists of trials or the tables that the shards were made from cannot
/// be read.
fn check_shards(config: &Config, shards: &Path) -> Result<(Whole, Shards, ShardsStatus), RunError> {
    let mut found = find(shards)?;
    found.sort_by(|(a_folder, a, _), (b_folder, b, _)| (a, a_folder).cmp(&(b, b_folder)));
    // The division is the one that most shards have.
    let mut divisions = BTreeMap::<_, usize>::new();
    found.iter().for_each(|(_, shard, _)| *divisions.entry(shard.division).or_default() += 1);
    let Some((division, _)) = divisions.into_iter().max_by_key(|(_, count)| *count) else {
        return Err(RunError::NoShards { shards: shards.to_owned() });
    };
    let (whole, source, project, all) = match division {
        Division::Trials { of } => {
            let mut config = config.clone();
            let mut manifests = found.iter().filter_map(|(.., manifest)| manifest.as_ref().ok());
            if let Some(manifest) = manifests.find(|manifest| manifest.shard.division == division) {
                // The trial folders may have been named on the command line of the ingest.
                let folders = manifest.folders.iter();
                let folders = folders.map(|name| config.paths.base.join(name)).collect();
                config.paths.replace_raw(folders);
            }
            let stage = IngestStage::new(&config)?;
            let project = ingest_project_hash(&stage);
            (Whole::Trials(stage), IngestStage::SOURCE, project, 1..of + 1)
        }
        Division::Replicates => {
            let (.., project) = load_fit(config)?;
            let all = 0..config.fit.bootstrap;
            (Whole::Replicates(project.clone()), FitStage::SOURCE, project, all)
        }
    };
    let listed: Vec<Shard> = found.iter().map(|(_, shard, _)| *shard).collect();
    let check = |(index, (folder, shard, manifest)): (usize, Found)| {
        let mut neighbours = [index.wrapping_sub(1), index + 1].into_iter();
        let is_twice = neighbours.any(|i| listed.get(i).is_some_and(|other| shard.overlaps(other)));
        let checked = manifest.and_then(|manifest| {
            let state = &manifest.state;
            let problem = if shard.division != division {
                format!(
                    "{shard} comes from a different division into shards than most of the other shards; remove the \
                     shards of one of the divisions"
                )
            } else if shard.from < all.start || shard.to > all.end {
                format!(
                    "found {shard}, needed replicates within {}..{}, the range given by `fit.bootstrap`",
                    all.start, all.end
                )
            } else if is_twice {
                format!("{shard} overlaps another shard; remove one of them")
            } else if state.source != source {
                format!("made by a different build of trilink (version {})", manifest.version)
            } else if manifest.project != project {
                "made with a different configuration or from different trials".to_owned()
            } else if !has_its_trials(&whole, shard, state) {
                format!("its trials are not those that belong to {shard} according to the lists of trials")
            } else if let Some(damage) = damage(&folder, state) {
                format!("damaged: {damage}")
            } else {
                return Ok(manifest);
            };
            Err(ShardStatus::Refused(problem))
        });
        (folder, shard, checked)
    };
    let checked: Vec<Found> = found.into_par_iter().enumerate().map(check).collect();
    let mut usable = Shards::new();
    let mut statuses = missing(shards, division, &all, &listed);
    for (folder, shard, manifest) in checked {
        let status = manifest.map(|manifest| {
            let content = manifest.content.clone();
            usable.push((folder.clone(), manifest));
            ShardStatus::Whole(content)
        });
        statuses.push((folder, shard, status.unwrap_or_else(|problem| problem)));
    }
    statuses.sort_by(|(a_folder, a, _), (b_folder, b, _)| (a, a_folder).cmp(&(b, b_folder)));
    Ok((whole, usable, ShardsStatus { division, shards: statuses }))
}

/// Whether an ingest shard has exactly the trials that belong to it; always true for a fit shard.
fn has_its_trials(whole: &Whole, shard: Shard, state: &StageState) -> bool {
    let Whole::Trials(stage) = whole else { return true };
    let expected = stage.trials().filter(|trial| shard.has(trial));
    expected.eq(state.targets.iter().map(|made| made.target.name.as_str()))
}

/// Describes the first damaged or missing file of a shard; `None` if all files are intact.
fn damage(folder: &Path, state: &StageState) -> Option<String> {
    let outside = state
        .written()
        .find(|(name, _)| !Path::new(name).components().all(|c| matches!(c, Normal(_))));
    if let Some((name, _)) = outside {
        return Some(format!(
            "{MANIFEST}: found file {name}, needed a file in the shard's own folder"
        ));
    }
    let outputs = state.targets.iter().map(|made| &made.outputs).chain([&state.outputs]);
    outputs.flat_map(|outputs| changed_outputs(folder, outputs, true)).next()
}

/// Returns, in order, the shards whose numbers lie in the range `all` but in none of the shards `listed`, each with its
/// expected folder and the status `Missing`. `listed` must be sorted.
fn missing(
    shards: &Path,
    division: Division,
    all: &Range<usize>,
    listed: &[Shard],
) -> Vec<(PathBuf, Shard, ShardStatus)> {
    let mut statuses = Vec::new();
    let mut next = all.start;
    let present = listed.iter().filter(|shard| shard.division == division);
    for (from, to) in present.map(|shard| (shard.from, shard.to)).chain([(all.end, all.end)]) {
        let missing = division.shards(next..from.min(all.end));
        statuses.extend(
            missing.map(|shard| (shards.join(shard.folder()), shard, ShardStatus::Missing)),
        );
        next = next.max(to);
    }
    statuses
}

/// Finds the folders of shards, recognised by their manifest or, without a manifest, by their name.
fn find(shards: &Path) -> Result<Vec<Found>, StoreError> {
    let unreadable = |source| StoreError::Read { path: shards.to_owned(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(shards).map_err(unreadable)? {
        let folder = entry.map_err(unreadable)?.path();
        let manifest = match read_json::<Manifest>(&folder.join(MANIFEST), FORMAT, "damaged") {
            Ok(manifest) => manifest.ok_or(ShardStatus::Unfinished),
            Err(problem) => Err(ShardStatus::Refused(format!("{MANIFEST}: {problem}"))),
        };
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        let shard =
            manifest.as_ref().map_or(Shard::from_folder(&name), |manifest| Some(manifest.shard));
        if let Some(shard) = shard.filter(|_| folder.is_dir()) {
            found.push((folder, shard, manifest));
        }
    }
    Ok(found)
}

/// Result of a merge.
#[derive(Debug)]
pub enum Merged {
    Trials(Ingested),
    Fits(Fitted),
}

/// Merges all shards into the tables that an undivided stage writes. With `allow_missing`, shards of an ingest may be
/// missing or unfinished; the tables then contain only the trials of the other shards.
///
/// # Errors
/// Returns an error, and writes nothing, if a shard cannot be merged, or if a required shard is missing or unfinished.
/// Also returns an error if a file cannot be written or another process uses the folder.
pub fn merge(
    config: &Config,
    shards: &Path,
    allow_missing: bool,
    wait: bool,
    watch: &dyn Watch,
) -> Result<(Merged, ShardsStatus), RunError> {
    let (whole, usable, status) = check_shards(config, shards)?;
    // Replicates may not be missing, because `fit.bootstrap` states their number.
    let may_miss = allow_missing && matches!(whole, Whole::Trials(_)) && !usable.is_empty();
    let refused = status.shards.iter().filter(|(.., status)| match status {
        ShardStatus::Whole(_) => false,
        ShardStatus::Missing | ShardStatus::Unfinished => !may_miss,
        ShardStatus::Refused(_) => true,
    });
    let problems = refused.map(|(folder, _, status)| format!("\n  {}: {status}", folder.display()));
    let problems: String = problems.collect();
    if !problems.is_empty() {
        return Err(RunError::Shards { problems, again: status.again() });
    }
    let merged = match whole {
        Whole::Trials(stage) => Merged::Trials(merge_trials(config, stage, usable, wait, watch)?),
        Whole::Replicates(project) => {
            Merged::Fits(merge_replicates(config, &project, usable, wait, watch)?)
        }
    };
    Ok((merged, status))
}

/// Copies the trial tables of all shards and writes the tables of the whole ingest.
fn merge_trials(
    config: &Config,
    mut stage: IngestStage,
    shards: Shards,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Ingested, RunError> {
    let derived = &config.paths.derived;
    let shard_folders: Vec<String> = stage.folders().cloned().collect();
    let known = Sequence::new(config, RerunOptions::FORCE, watch).known_folders();
    if let Some(folder) = known.into_iter().find(|folder| !shard_folders.contains(folder)) {
        return Err(RunError::OtherFolder { derived: derived.clone(), folder, shard_folders });
    }
    let _lock = take_over(config, wait, watch)?;
    let mut record = Sequence::new(config, RerunOptions::FORCE, watch).record;
    watch.begin("merge", shards.len());
    let cancel = watch.cancel_token();
    let copy_all = || {
        let copied = shards.into_iter().map(|(folder, manifest)| {
            let shard = manifest.shard;
            let copied = copy(&folder, manifest.state, derived, &cancel)?;
            watch.step(&shard.to_string());
            tracing::info!(%shard, "merged");
            Ok(copied)
        });
        copied.collect::<Result<Vec<_>, RunError>>()
    };
    let copied = match rayon::ThreadPoolBuilder::new().num_threads(COPY_THREADS).build() {
        Ok(pool) => pool.install(copy_all),
        Err(_) => copy_all(),
    };
    let copied = copied.map_err(|error| error.interrupted(IngestStage::NAME, String::new()))?;
    let retained: Retained<IngestStage> = copied.into_iter().flatten().collect();
    stage.retain(|trial| retained.contains_key(&Target::new(Kind::Trial, trial)));
    let (ingested, _, state) =
        join(&stage, Vec::new(), &record, retained).carry_out(&stage, (watch, ""))?;
    record.ingest = state;
    record.run = None;
    record.save(derived)?;
    Ok(ingested)
}

/// Copies the tables of a shard's trials into the folder `derived`, and returns the records and rows of these trials.
fn copy(
    folder: &Path,
    state: StageState,
    derived: &Path,
    cancel: &CancelToken,
) -> Result<Retained<IngestStage>, RunError> {
    let reader = Reader::new(folder, state.written());
    let mut rows = Ingested::read(folder, &reader)?.by_target();
    let trials = state.targets.into_iter().filter_map(|made| {
        let rows = rows.remove(&made.target.name)?;
        Some((made, rows))
    });
    let trials: Vec<_> = trials.collect();
    let copied = trials.into_par_iter().map(|(mut made, rows)| {
        cancel.check()?;
        for (name, stamp) in &mut made.outputs {
            let bytes = reader.bytes(&folder.join(name))?;
            *stamp = write_if_changed(&derived.join(name), &bytes)?;
        }
        Ok((made.target.clone(), (made, rows)))
    });
    copied.collect()
}

/// Fits all models with the bootstrap replicates of the shards; returns an error if the settings and inputs no longer
/// have the hash `project`.
fn merge_replicates(
    config: &Config,
    project: &str,
    shards: Shards,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Fitted, RunError> {
    let _lock = take_over(config, wait, watch)?;
    let (mut stage, _, now) = load_fit(config)?;
    if now != project {
        return Err(StoreError::Changed { path: config.paths.derived.clone() }.into());
    }
    let mut given = Refits::new();
    for (folder, manifest) in shards {
        let reader = Reader::new(&folder, manifest.state.written());
        for driven_by in GaitInput::ALL {
            let rows: Vec<BootstrapRow> = reader.rows(&folder.join(replicates_table(driven_by)))?;
            given.entry(driven_by).or_default().extend(rows);
        }
    }
    stage.replicates = Replicates { numbers: 0..0, given };
    let mut sequence = Sequence::new(config, RerunOptions::FORCE, watch);
    sequence.record.run = None;
    sequence.advance(&stage)
}
