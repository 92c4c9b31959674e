//! Parts that were made elsewhere, joined into the tables of an undivided stage.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::ErrorKind;
use std::path::{Component::Normal, Path, PathBuf};

use rayon::prelude::*;

use super::ingest::IngestStage;
use super::plan::{RerunOptions, Stage, join};
use super::record::{Made, changed_outputs};
use super::shard::{FORMAT, MANIFEST, Manifest, Part, project};
use super::target::Target;
use super::{RunError, Sequence, Watch, count, interruptible, take_over};
use crate::config::Config;
use crate::files;
use crate::ingest::Ingested;
use crate::interrupt::stop_if_asked;
use crate::store::{Reader, StoreError, write_if_changed};

/// What was found of one part.
#[derive(Debug)]
pub enum PartStatus {
    /// How many trials it has, and how many of them failed.
    Whole {
        trials: usize,
        failed: usize,
    },
    Missing,
    /// A folder in which the work goes on, or was killed.
    Unfinished,
    Refused(String),
}

impl fmt::Display for PartStatus {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Whole { trials, failed: 0 } => write!(f, "{trials} trials"),
            Self::Whole { trials, failed } => write!(f, "{trials} trials, {failed} failed"),
            Self::Missing => write!(f, "missing"),
            Self::Unfinished => {
                write!(f, "unfinished: no {MANIFEST}, which is written last: killed or still busy")
            }
            Self::Refused(problem) => write!(f, "{problem}"),
        }
    }
}

/// What was found of all parts.
#[derive(Debug)]
pub struct ShardsStatus {
    /// By the folders that they have or should have, in the order of their numbers.
    pub parts: Vec<(PathBuf, Part, PartStatus)>,
}

impl ShardsStatus {
    /// Whether all parts are there, each once.
    pub fn is_whole(&self) -> bool {
        self.parts.iter().all(|(.., status)| matches!(status, PartStatus::Whole { .. }))
    }

    /// The numbers of the parts that are to be made again, as an array of jobs has them.
    pub fn array(&self) -> String {
        let is_open =
            |(.., status): &&(_, _, PartStatus)| !matches!(status, PartStatus::Whole { .. });
        let open = self.parts.iter().filter(is_open).map(|(_, part, _)| part.number);
        let open: BTreeSet<usize> = open.collect();
        open.iter().map(usize::to_string).collect::<Vec<_>>().join(",")
    }
}

/// A folder that is a part, and its manifest or why there is none.
type Found = (PathBuf, Part, Result<Manifest, PartStatus>);

/// A part that can be joined.
struct Shard {
    folder: PathBuf,
    manifest: Manifest,
    rows: Ingested,
    reader: Reader,
}

/// Looks at all parts; gives those that can be joined, too, and the stage that they are parts of.
fn look(
    config: &Config,
    shards: &Path,
) -> Result<(IngestStage, Vec<Shard>, ShardsStatus), RunError> {
    let found = find(shards)?;
    let (mut divisions, mut counts) = (BTreeMap::<_, usize>::new(), BTreeMap::<_, usize>::new());
    for (_, part, _) in &found {
        *divisions.entry(part.of).or_default() += 1;
        *counts.entry(*part).or_default() += 1;
    }
    // The division is what most say it is.
    let Some((of, _)) = divisions.into_iter().max_by_key(|(_, parts)| *parts) else {
        return Err(RunError::NoShards { shards: shards.to_owned() });
    };
    let mut config = config.clone();
    if let Some(Ok(manifest)) = found.iter().map(|(.., manifest)| manifest).find(|of| of.is_ok()) {
        // They may have been named on the command line.
        let folders = manifest.folders.iter();
        config.paths.raw = folders.map(|name| config.paths.base.join(name)).collect();
    }
    let stage = IngestStage::new(&config)?;
    let project = project(&stage);
    let check = |(folder, part, manifest): Found| {
        let shard = manifest.and_then(|manifest| {
            let copies = counts[&part];
            let problem = if part.of != of {
                format!("part {part}, where the others are of {of}: remove those of one division")
            } else if copies > 1 {
                format!("part {part} is there {copies} times: remove all but one")
            } else if manifest.state.source != IngestStage::SOURCE {
                format!("made by another program (version {})", manifest.version)
            } else if manifest.project != project {
                "made with another configuration or other lists of trials".to_owned()
            } else {
                return check_files(&stage, folder.clone(), manifest);
            };
            Err(PartStatus::Refused(problem))
        });
        (folder, part, shard)
    };
    let checked: Vec<_> = found.into_par_iter().map(check).collect();
    let (mut whole, mut parts) = (Vec::new(), Vec::new());
    for (folder, part, shard) in checked {
        let status = shard.map(|shard| {
            let counts = count(&shard.rows.trials);
            whole.push(shard);
            PartStatus::Whole { trials: counts.total, failed: counts.failed }
        });
        parts.push((folder, part, status.unwrap_or_else(|problem| problem)));
    }
    let all = (1..=of).map(|number| Part { of, number });
    let missing = all.filter(|part| !counts.contains_key(part));
    parts.extend(missing.map(|part| (shards.join(part.folder()), part, PartStatus::Missing)));
    parts.sort_by(|(a_folder, a, _), (b_folder, b, _)| (a, a_folder).cmp(&(b, b_folder)));
    Ok((stage, whole, ShardsStatus { parts }))
}

/// Folders that are parts by their manifest or, without one, by their name.
fn find(shards: &Path) -> Result<Vec<Found>, StoreError> {
    let unreadable = |source| StoreError::Read { path: shards.to_owned(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(shards).map_err(unreadable)? {
        let folder = entry.map_err(unreadable)?.path();
        let manifest = read_manifest(&folder);
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        let part = manifest.as_ref().map_or(Part::of_folder(&name), |manifest| Some(manifest.part));
        if let Some(part) = part.filter(|_| folder.is_dir()) {
            found.push((folder, part, manifest));
        }
    }
    Ok(found)
}

fn read_manifest(folder: &Path) -> Result<Manifest, PartStatus> {
    let refused = |problem: String| PartStatus::Refused(format!("{MANIFEST}: {problem}"));
    let json = match files::read(&folder.join(MANIFEST), files::TEXT_BYTES) {
        Ok((json, _)) => json,
        Err(problem) if problem.kind() == ErrorKind::NotFound => {
            return Err(PartStatus::Unfinished);
        }
        Err(problem) => return Err(refused(format!("cannot be read: {problem}"))),
    };
    match serde_json::from_slice::<Manifest>(&json) {
        Ok(Manifest { format, .. }) if format != FORMAT => {
            Err(refused(format!("found format {format}, needed {FORMAT}")))
        }
        manifest => manifest.map_err(|problem| refused(format!("damaged: {problem}"))),
    }
}

/// Checks that a part has its trials and that all of its files are as they were written.
fn check_files(
    stage: &IngestStage,
    folder: PathBuf,
    manifest: Manifest,
) -> Result<Shard, PartStatus> {
    let Manifest { part, state, .. } = &manifest;
    let mine = stage.trials().filter(|trial| part.has(trial)).map(str::to_owned);
    if !mine.eq(state.targets.iter().map(|made| made.target.name())) {
        return Err(PartStatus::Refused(format!("has other trials than part {part} of the lists")));
    }
    let damaged = |problem: String| PartStatus::Refused(format!("damaged: {problem}"));
    let is_inside = |name: &str| Path::new(name).components().all(|c| matches!(c, Normal(_)));
    if let Some((name, _)) = state.written().find(|(name, _)| !is_inside(name)) {
        return Err(damaged(format!("{MANIFEST}: found file {name}, needed one in the folder")));
    }
    let outputs = state.targets.iter().map(|made| &made.outputs).chain([&state.outputs]);
    let changed = outputs.flat_map(|outputs| changed_outputs(&folder, outputs, true)).next();
    if let Some(changed) = changed {
        return Err(damaged(changed));
    }
    let stamps = state.written().map(|(name, stamp)| (folder.join(name), stamp.clone()));
    let reader = Reader(stamps.collect());
    let rows = Ingested::read(&folder, &reader).map_err(|problem| damaged(problem.to_string()))?;
    Ok(Shard { folder, manifest, rows, reader })
}

/// What there is of all parts. Writes nothing.
///
/// # Errors
/// There is no part, or the lists of trials cannot be read.
pub fn shards_status(config: &Config, shards: &Path) -> Result<ShardsStatus, RunError> {
    Ok(look(config, shards)?.2)
}

/// Joins all parts into the tables that an undivided ingest leaves. If parts may be missing, the
/// tables are of the others' trials.
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
) -> Result<(Ingested, ShardsStatus), RunError> {
    let (mut stage, found, status) = look(config, shards)?;
    let is_refused = |status: &PartStatus| match status {
        PartStatus::Whole { .. } => false,
        PartStatus::Missing | PartStatus::Unfinished => !allow_missing || found.is_empty(),
        PartStatus::Refused(_) => true,
    };
    let refused = status.parts.iter().filter(|(.., status)| is_refused(status));
    let problems = refused.map(|(folder, _, status)| format!("\n  {}: {status}", folder.display()));
    let problems: String = problems.collect();
    if !problems.is_empty() {
        return Err(RunError::Shards { problems, array: status.array() });
    }
    let derived = &config.paths.derived;
    let of: Vec<String> = stage.folders().cloned().collect();
    let is_other = |folder: &String| !of.contains(folder);
    let known = Sequence::new(config, RerunOptions::FORCE, watch).0.known_folders();
    if let Some(folder) = known.into_iter().find(is_other) {
        return Err(RunError::OtherFolder { derived: derived.clone(), folder, of });
    }
    let _lock = take_over(config, wait, watch)?;
    let mut record = Sequence::new(config, RerunOptions::FORCE, watch).0.record;
    let (ingested, _, state) = interruptible(IngestStage::NAME, || {
        watch.begin("merge", found.len());
        let mut kept = BTreeMap::new();
        for shard in found {
            let part = shard.manifest.part;
            kept.extend(copy(&stage, shard, derived)?);
            watch.step(&format!("part {part}"));
            tracing::info!(%part, "merged");
        }
        stage.retain(|trial| kept.contains_key(&Target::Trial(trial.to_owned())));
        join(&stage, &record, kept).carry_out(&stage, watch)
    })?;
    (record.ingest, record.run) = (state, None);
    record.save(derived)?;
    Ok((ingested, status))
}

/// A trial that was made, with its rows.
type Kept = (Target, (Made, Ingested));

/// Copies the tables of a part's trials; gives the trials as made here.
fn copy(stage: &IngestStage, shard: Shard, derived: &Path) -> Result<Vec<Kept>, StoreError> {
    let Shard { folder, manifest: Manifest { mut state, .. }, rows, reader } = shard;
    let targets = std::mem::take(&mut state.targets);
    let mut rows = stage.kept(&state, rows);
    let trials: Vec<_> =
        targets.into_iter().filter_map(|made| Some((rows.remove(&made.target)?, made))).collect();
    let copied = trials.into_par_iter().map(|(rows, mut made)| {
        stop_if_asked(String::new);
        for (name, stamp) in &mut made.outputs {
            let bytes = reader.bytes(&folder.join(name))?;
            *stamp = write_if_changed(&derived.join(name), &bytes)?;
        }
        Ok((made.target.clone(), (made, rows)))
    });
    copied.collect()
}
