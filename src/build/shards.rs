//! A stage in parts, each made on a machine that shares nothing with the others' but a folder, and
//! joined into the tables of an undivided one.
//!
//! A part of an ingest is the stage of some of the trials, one of a fit some replicates of its
//! bootstrap. The manifest of a part, which is written last, says what it was made of and which
//! files it left, and nothing of the machine.

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
use super::part::{Division, Part};
use super::plan::{Kept, RerunOptions, Stage, Wanted, hash_of, join, plan};
use super::record::{Inputs, Made, Record, StageState, changed_outputs, read_json};
use super::steps::Steps;
use super::target::{Kind, Target};
use super::{RunError, Sequence, Watch, count};

/// Name of the manifest inside of a part's folder.
const MANIFEST: &str = "manifest.json";
/// Raise it when the meaning of the manifest changes.
const FORMAT: u32 = 2;
/// Files that are copied at a time: most of that is waiting for the disk.
const COPIES: usize = 16;

/// What a part was made of and what it left.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    format: u32,
    version: String,
    part: Part,
    /// What it has, in words.
    content: String,
    /// Names of the trial folders of an ingest.
    folders: Vec<String>,
    /// Hash of the configuration and of all that all parts are made of.
    project: String,
    /// The stage's record, without times.
    state: StageState,
}

/// Table of replicates of models that are driven so.
fn replicates_table(driven_by: GaitInput) -> String {
    format!("{driven_by}-bootstrap.parquet")
}

/// Hash of all that a stage is made of.
fn project(stage: &impl Stage, wanted: &[Wanted]) -> String {
    let parts: Vec<_> = wanted.iter().map(|wanted| (&wanted.target, &wanted.parts)).collect();
    hash_of(&(stage.whole(), parts))
}

fn project_of_trials(stage: &IngestStage) -> String {
    project(stage, &stage.foreseen(&StageState::default()))
}

/// The models of a fit whatever the number of their replicates, the tables that they are fitted
/// to, and the hash of both.
///
/// # Errors
/// There are no tables, or they cannot be read.
fn fit_of_any_number(config: &Config) -> Result<(FitStage, FitData, String), RunError> {
    let mut any = config.clone();
    any.fit.bootstrap = 0;
    let any = FitStage::new(&any).without_shared();
    let (record, derived) = (Record::default(), &config.paths.derived);
    let paths = any.input_paths(&record.fit)?;
    let data = any.read(Inputs::look(paths, (derived, &record), &record.fit, false))?;
    let project = project(&any, &any.targets(Some(&data)));
    Ok((FitStage::new(config), data, project))
}

/// Makes a part by `work`, which gives what it has in words, too, in a folder of its own inside of
/// `shards`, and its manifest; gives that folder, too.
fn make<S: Stage, T>(
    (part, shards): (Part, &Path),
    (project, folders): (String, Vec<String>),
    (wait, watch): (bool, &dyn Watch),
    work: impl FnOnce(&Path, &str) -> Result<(T, String, StageState), RunError>,
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
    let (output, content, mut state) = work(&home, &part.to_string())?;
    state.inputs.clear();
    let of_targets = state.targets.iter_mut().flat_map(|made| made.outputs.values_mut());
    of_targets.chain(state.outputs.values_mut()).for_each(|stamp| stamp.modified_ns = None);
    let version = env!("CARGO_PKG_VERSION").to_owned();
    let made = Manifest { format: FORMAT, version, part, content, folders, project, state };
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
    let common = (project_of_trials(&whole), whole.folders().cloned().collect());
    make::<IngestStage, _>((part, shards), common, (wait, watch), |home, of| {
        let stage = whole.of_some(|trial| part.has(trial), home);
        let record = Record::default();
        let planned = plan(&stage, home, &record, RerunOptions::FORCE)?;
        let (ingested, _, state) = planned.carry_out(&stage, (watch, of))?;
        let counts = count(&ingested.trials);
        let mut content = format!("{} trials", counts.total);
        if counts.failed > 0 {
            content += &format!(", {} failed", counts.failed);
        }
        Ok((ingested, content, state))
    })
}

/// Replicates by what drives their models.
type Refits = BTreeMap<GaitInput, Vec<BootstrapRow>>;

/// Fits some replicates of all models, without what campaigns share, into a folder of their own
/// inside of `shards`; gives how many there are of all models, and that folder. The fits themselves
/// are made, too, and not kept.
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
    let mut stage = stage.without_shared();
    drop(reading);
    stage.replicates = Replicates { numbers: part.from..part.to, given: Refits::new() };
    let provenance = Provenance { input: project.clone() };
    make::<FitStage, _>((part, shards), (project, Vec::new()), (wait, watch), |home, of| {
        let rows = Mutex::new(Refits::new());
        let on_replicate = |driven_by, row: &BootstrapRow| {
            let mut rows = rows.lock().unwrap_or_else(PoisonError::into_inner);
            rows.entry(driven_by).or_default().push(row.clone());
        };
        let steps = Steps::begin::<FitStage>(watch, stage.targets(None).len(), of);
        steps.end::<FitStage, _>(stage.fit(&data, BTreeMap::new(), &steps, &on_replicate))?;
        let mut refits = rows.into_inner().unwrap_or_else(PoisonError::into_inner);
        let mut state = StageState { source: FitStage::SOURCE.to_owned(), ..Default::default() };
        let mut count = 0;
        for driven_by in GaitInput::ALL {
            let mut rows = refits.remove(&driven_by).unwrap_or_default();
            rows.sort_by_cached_key(|row| (row.campaign.clone(), row.model, row.replicate));
            count += rows.len();
            let (name, table) = (replicates_table(driven_by), BootstrapRow::to_table(&rows));
            let stamp = table.write_if_changed(&home.join(&name), &provenance)?;
            state.outputs.insert(name, stamp);
        }
        Ok((count, of.to_owned(), state))
    })
}

/// What was found of one part.
#[derive(Debug)]
pub enum PartStatus {
    /// What it has.
    Whole(String),
    Missing,
    /// A folder in which the work goes on, or was killed.
    Unfinished,
    Refused(String),
}

impl fmt::Display for PartStatus {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Whole(text) | Self::Refused(text) => write!(f, "{text}"),
            Self::Missing => write!(f, "missing"),
            Self::Unfinished => {
                write!(f, "unfinished: no {MANIFEST}, which is written last: killed or still busy")
            }
        }
    }
}

/// What was found of all parts.
#[derive(Debug)]
pub struct ShardsStatus {
    division: Division,
    /// By the folders that they have or should have, in the order of their numbers.
    pub parts: Vec<(PathBuf, Part, PartStatus)>,
}

impl ShardsStatus {
    /// Whether all parts are there, each once.
    pub fn is_whole(&self) -> bool {
        self.parts.iter().all(|(.., status)| matches!(status, PartStatus::Whole(_)))
    }

    /// The parts that are to be made again, as an option of who makes them; empty without any.
    pub fn again(&self) -> String {
        let is_open = |(_, part, status): &&(_, Part, PartStatus)| {
            part.division == self.division && !matches!(status, PartStatus::Whole(_))
        };
        let open: BTreeSet<Part> =
            self.parts.iter().filter(is_open).map(|(_, part, _)| *part).collect();
        let (option, in_words): (_, fn(&Part) -> String) = match self.division {
            _ if open.is_empty() => return String::new(),
            Division::Trials { .. } => ("--array=", |part| part.from.to_string()),
            Division::Replicates => ("--replicates ", |part| format!("{}..{}", part.from, part.to)),
        };
        option.to_owned() + &open.iter().map(in_words).collect::<Vec<_>>().join(",")
    }
}

/// What there is of all parts. Writes nothing.
///
/// # Errors
/// There is no part, or the lists of trials or the tables that they are of cannot be read.
pub fn shards_status(config: &Config, shards: &Path) -> Result<ShardsStatus, RunError> {
    Ok(look(config, shards)?.2)
}

/// A folder that is a part, and its manifest or why it cannot be joined.
type Found = (PathBuf, Part, Result<Manifest, PartStatus>);

/// Parts that can be joined.
type Shards = Vec<(PathBuf, Manifest)>;

/// The whole that the parts are of.
enum Whole {
    Trials(IngestStage),
    /// With the hash of what they were made of.
    Replicates(String),
}

/// Looks at all parts; gives those that can be joined, too, and what they are of.
///
/// # Errors
/// There is no part, or the lists of trials or the tables that they are of cannot be read.
fn look(config: &Config, shards: &Path) -> Result<(Whole, Shards, ShardsStatus), RunError> {
    let mut found = find(shards)?;
    found.sort_by(|(a_folder, a, _), (b_folder, b, _)| (a, a_folder).cmp(&(b, b_folder)));
    // The division is what most say it is.
    let mut divisions = BTreeMap::<_, usize>::new();
    found.iter().for_each(|(_, part, _)| *divisions.entry(part.division).or_default() += 1);
    let Some((division, _)) = divisions.into_iter().max_by_key(|(_, parts)| *parts) else {
        return Err(RunError::NoShards { shards: shards.to_owned() });
    };
    let (whole, source, project, all) = match division {
        Division::Trials { of } => {
            let mut config = config.clone();
            let mut manifests = found.iter().filter_map(|(.., manifest)| manifest.as_ref().ok());
            if let Some(manifest) = manifests.find(|manifest| manifest.part.division == division) {
                // They may have been named on the command line.
                let folders = manifest.folders.iter();
                config.paths.raw = folders.map(|name| config.paths.base.join(name)).collect();
            }
            let stage = IngestStage::new(&config)?;
            let project = project_of_trials(&stage);
            (Whole::Trials(stage), IngestStage::SOURCE, project, 1..of + 1)
        }
        Division::Replicates => {
            let (.., project) = fit_of_any_number(config)?;
            let all = 0..config.fit.bootstrap;
            (Whole::Replicates(project.clone()), FitStage::SOURCE, project, all)
        }
    };
    let listed: Vec<Part> = found.iter().map(|(_, part, _)| *part).collect();
    let check = |(index, (folder, part, manifest)): (usize, Found)| {
        let mut neighbours = [index.wrapping_sub(1), index + 1].into_iter();
        let is_twice = neighbours.any(|i| listed.get(i).is_some_and(|other| part.meets(other)));
        let checked = manifest.and_then(|manifest| {
            let state = &manifest.state;
            let problem = if part.division != division {
                format!("{part} of another division than most parts: remove those of one")
            } else if part.from < all.start || part.to > all.end {
                format!("{part}, needed those of {} to {}", all.start, all.end)
            } else if is_twice {
                format!("{part} is there twice: remove one")
            } else if state.source != source {
                format!("made by another program (version {})", manifest.version)
            } else if manifest.project != project {
                "made with another configuration, or of other trials".to_owned()
            } else if !has_its_trials(&whole, part, state) {
                format!("has other trials than {part} of the lists")
            } else if let Some(damage) = damage(&folder, state) {
                format!("damaged: {damage}")
            } else {
                return Ok(manifest);
            };
            Err(PartStatus::Refused(problem))
        });
        (folder, part, checked)
    };
    let checked: Vec<Found> = found.into_par_iter().enumerate().map(check).collect();
    let (mut sound, mut parts) = (Shards::new(), missing(shards, division, &all, &listed));
    for (folder, part, manifest) in checked {
        let status = manifest.map(|manifest| {
            let content = manifest.content.clone();
            sound.push((folder.clone(), manifest));
            PartStatus::Whole(content)
        });
        parts.push((folder, part, status.unwrap_or_else(|problem| problem)));
    }
    parts.sort_by(|(a_folder, a, _), (b_folder, b, _)| (a, a_folder).cmp(&(b, b_folder)));
    Ok((whole, sound, ShardsStatus { division, parts }))
}

/// Whether a part of the trials has those that fall on it.
fn has_its_trials(whole: &Whole, part: Part, state: &StageState) -> bool {
    let Whole::Trials(stage) = whole else { return true };
    let mine = stage.trials().filter(|trial| part.has(trial));
    mine.eq(state.targets.iter().map(|made| made.target.name.as_str()))
}

/// What is wrong with the files of a part.
fn damage(folder: &Path, state: &StageState) -> Option<String> {
    let is_inside = |name: &str| Path::new(name).components().all(|c| matches!(c, Normal(_)));
    if let Some((name, _)) = state.written().find(|(name, _)| !is_inside(name)) {
        return Some(format!("{MANIFEST}: found file {name}, needed one in the folder"));
    }
    let outputs = state.targets.iter().map(|made| &made.outputs).chain([&state.outputs]);
    outputs.flat_map(|outputs| changed_outputs(folder, outputs, true)).next()
}

/// The parts between those that are `listed`, in order.
fn missing(
    shards: &Path,
    division: Division,
    all: &Range<usize>,
    listed: &[Part],
) -> Vec<(PathBuf, Part, PartStatus)> {
    let (mut parts, mut next) = (Vec::new(), all.start);
    let ours = listed.iter().filter(|part| part.division == division);
    for (from, to) in ours.map(|part| (part.from, part.to)).chain([(all.end, all.end)]) {
        let missing = division.parts(next..from.min(all.end));
        parts.extend(missing.map(|part| (shards.join(part.folder()), part, PartStatus::Missing)));
        next = next.max(to);
    }
    parts
}

/// Folders that are parts by their manifest or, without one, by their name.
fn find(shards: &Path) -> Result<Vec<Found>, StoreError> {
    let unreadable = |source| StoreError::Read { path: shards.to_owned(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(shards).map_err(unreadable)? {
        let folder = entry.map_err(unreadable)?.path();
        let manifest = match read_json::<Manifest>(&folder.join(MANIFEST), FORMAT, "damaged") {
            Ok(manifest) => manifest.ok_or(PartStatus::Unfinished),
            Err(problem) => Err(PartStatus::Refused(format!("{MANIFEST}: {problem}"))),
        };
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        let part = manifest.as_ref().map_or(Part::of_folder(&name), |manifest| Some(manifest.part));
        if let Some(part) = part.filter(|_| folder.is_dir()) {
            found.push((folder, part, manifest));
        }
    }
    Ok(found)
}

/// What parts were joined into.
#[derive(Debug)]
pub enum Merged {
    Trials(Ingested),
    Fits(Fitted),
}

/// Joins all parts into the tables that an undivided stage leaves. If parts of the trials may be
/// missing, the tables are of the other trials.
///
/// # Errors
/// A part is missing or cannot be joined, then nothing is written; or a file cannot be written, or
/// another process is busy.
pub fn merge(
    config: &Config,
    shards: &Path,
    allow_missing: bool,
    wait: bool,
    watch: &dyn Watch,
) -> Result<(Merged, ShardsStatus), RunError> {
    let (whole, sound, status) = look(config, shards)?;
    // Fewer replicates are no bootstrap of this number.
    let may_miss = allow_missing && matches!(whole, Whole::Trials(_)) && !sound.is_empty();
    let is_refused = |status: &PartStatus| match status {
        PartStatus::Whole(_) => false,
        PartStatus::Missing | PartStatus::Unfinished => !may_miss,
        PartStatus::Refused(_) => true,
    };
    let refused = status.parts.iter().filter(|(.., status)| is_refused(status));
    let problems = refused.map(|(folder, _, status)| format!("\n  {}: {status}", folder.display()));
    let problems: String = problems.collect();
    if !problems.is_empty() {
        return Err(RunError::Shards { problems, again: status.again() });
    }
    let merged = match whole {
        Whole::Trials(stage) => Merged::Trials(merge_trials(config, stage, sound, wait, watch)?),
        Whole::Replicates(project) => {
            Merged::Fits(merge_replicates(config, &project, sound, wait, watch)?)
        }
    };
    Ok((merged, status))
}

fn merge_trials(
    config: &Config,
    mut stage: IngestStage,
    shards: Shards,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Ingested, RunError> {
    let derived = &config.paths.derived;
    let of: Vec<String> = stage.folders().cloned().collect();
    let is_other = |folder: &String| !of.contains(folder);
    let known = Sequence::new(config, RerunOptions::FORCE, watch).known_folders();
    if let Some(folder) = known.into_iter().find(is_other) {
        return Err(RunError::OtherFolder { derived: derived.clone(), folder, of });
    }
    let _lock = take_over(config, wait, watch)?;
    let mut record = Sequence::new(config, RerunOptions::FORCE, watch).record;
    watch.begin("merge", shards.len());
    let cancel = watch.cancel_token();
    let join_all = || {
        shards
            .into_iter()
            .map(|(folder, manifest)| {
                let part = manifest.part;
                let copied = copy(&folder, manifest.state, derived, &cancel)?;
                watch.step(&part.to_string());
                tracing::info!(%part, "merged");
                Ok(copied)
            })
            .collect::<Result<Vec<_>, RunError>>()
    };
    let kept = match rayon::ThreadPoolBuilder::new().num_threads(COPIES).build() {
        Ok(pool) => pool.install(join_all),
        Err(_) => join_all(),
    };
    let kept = kept.map_err(|error| error.interrupted(IngestStage::NAME, String::new()))?;
    let kept: Kept<IngestStage> = kept.into_iter().flatten().collect();
    stage.retain(|trial| kept.contains_key(&Target::new(Kind::Trial, trial)));
    let (ingested, _, state) =
        join(&stage, Vec::new(), &record, kept).carry_out(&stage, (watch, ""))?;
    (record.ingest, record.run) = (state, None);
    record.save(derived)?;
    Ok(ingested)
}

/// Copies the tables of a part's trials; gives the trials as made here, with their rows.
fn copy(
    folder: &Path,
    state: StageState,
    derived: &Path,
    cancel: &CancelToken,
) -> Result<Kept<IngestStage>, RunError> {
    let reader = Reader::of(folder, state.written());
    let mut rows = Ingested::read(folder, &reader)?.by_target();
    let with_rows = |made: Made| {
        let rows = rows.remove(&made.target.name)?;
        Some((made, rows))
    };
    let trials: Vec<_> = state.targets.into_iter().filter_map(with_rows).collect();
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

/// Fits all models with the replicates of the parts.
fn merge_replicates(
    config: &Config,
    project: &str,
    shards: Shards,
    wait: bool,
    watch: &dyn Watch,
) -> Result<Fitted, RunError> {
    let _lock = take_over(config, wait, watch)?;
    let (mut stage, _, now) = fit_of_any_number(config)?;
    if now != project {
        return Err(StoreError::Changed { path: config.paths.derived.clone() }.into());
    }
    let mut given = Refits::new();
    for (folder, manifest) in shards {
        let reader = Reader::of(&folder, manifest.state.written());
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
