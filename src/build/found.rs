//! Which parts of a stage are there, and which of them can be joined.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Component::Normal, Path, PathBuf};

use rayon::prelude::*;
use serde::Deserialize;
use trilink_base::files;
use trilink_ingest::Ingested;
use trilink_tables::config::{Config, GaitInput};
use trilink_tables::{BootstrapRow, Reader, StoreError};

use super::fit::FitStage;
use super::ingest::IngestStage;
use super::part::{Division, Part};
use super::plan::Stage;
use super::record::changed_outputs;
use super::shard::{FORMAT, MANIFEST, Manifest, fit_of_any_number, project, replicates_table};
use super::{RunError, count};

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

/// A folder that is a part, and its manifest or why there is none.
type Found = (PathBuf, Part, Result<Manifest, PartStatus>);

/// A part that can be joined.
pub(super) struct Shard<R> {
    pub folder: PathBuf,
    pub manifest: Manifest,
    pub rows: R,
    pub reader: Reader,
}

/// Replicates by what drives their models.
pub(super) type Refits = BTreeMap<GaitInput, Vec<BootstrapRow>>;

/// The parts that can be joined.
pub(super) enum Shards {
    Trials(IngestStage, Vec<Shard<Ingested>>),
    /// With the hash of what they were made of.
    Replicates(String, Vec<Shard<Refits>>),
}

/// Looks at all parts; gives those that can be joined, too.
///
/// # Errors
/// There is no part, or the lists of trials or the tables that they are of cannot be read.
pub(super) fn look(config: &Config, shards: &Path) -> Result<(Shards, ShardsStatus), RunError> {
    let mut found = find(shards)?;
    found.sort_by(|(a_folder, a, _), (b_folder, b, _)| (a, a_folder).cmp(&(b, b_folder)));
    // The division is what most say it is.
    let mut divisions = BTreeMap::<_, usize>::new();
    found.iter().for_each(|(_, part, _)| *divisions.entry(part.division).or_default() += 1);
    let Some((division, _)) = divisions.into_iter().max_by_key(|(_, parts)| *parts) else {
        return Err(RunError::NoShards { shards: shards.to_owned() });
    };
    match division {
        Division::Trials { of } => {
            let mut config = config.clone();
            let mut manifests = found.iter().filter_map(|(.., manifest)| manifest.as_ref().ok());
            if let Some(manifest) = manifests.find(|manifest| manifest.part.division == division) {
                // They may have been named on the command line.
                let folders = manifest.folders.iter();
                config.paths.raw = folders.map(|name| config.paths.base.join(name)).collect();
            }
            let stage = IngestStage::new(&config)?;
            let made_of = (IngestStage::SOURCE, project(&stage, &()));
            let read = |folder: &Path, manifest: &Manifest, reader: &Reader| {
                let Manifest { part, state, .. } = manifest;
                let mine = stage.trials().filter(|trial| part.has(trial)).map(str::to_owned);
                if !mine.eq(state.targets.iter().map(|made| made.target.name())) {
                    return Err(format!("has other trials than {part} of the lists"));
                }
                let rows = Ingested::read(folder, reader);
                let rows = rows.map_err(|problem| format!("damaged: {problem}"))?;
                let counts = count(&rows.trials);
                let failed = match counts.failed {
                    0 => String::new(),
                    failed => format!(", {failed} failed"),
                };
                Ok((rows, format!("{} trials{failed}", counts.total)))
            };
            let (whole, status) = check(shards, found, division, 1..of + 1, &made_of, &read);
            Ok((Shards::Trials(stage, whole), status))
        }
        Division::Replicates => {
            let (_, _, project) = fit_of_any_number(config)?;
            let made_of = (FitStage::SOURCE, project);
            let read = |folder: &Path, manifest: &Manifest, reader: &Reader| {
                let rows = GaitInput::ALL.map(|driven_by| {
                    let rows = reader.rows(&folder.join(replicates_table(driven_by)));
                    Ok((driven_by, rows.map_err(|problem| format!("damaged: {problem}"))?))
                });
                let rows = rows.into_iter().collect::<Result<Refits, String>>()?;
                Ok((rows, manifest.part.to_string()))
            };
            let all = 0..config.fit.bootstrap;
            let (whole, status) = check(shards, found, division, all, &made_of, &read);
            Ok((Shards::Replicates(made_of.1, whole), status))
        }
    }
}

/// Reads the rows of a part's tables and says what it has; or why it cannot be joined.
type Read<'r, R> = &'r (dyn Fn(&Path, &Manifest, &Reader) -> Result<(R, String), String> + Sync);

/// Checks parts, in order, of which there should be `all`, made by a source and of a project.
fn check<R: Send>(
    shards: &Path,
    found: Vec<Found>,
    division: Division,
    all: Range<usize>,
    (source, project): &(&str, String),
    read: Read<R>,
) -> (Vec<Shard<R>>, ShardsStatus) {
    let listed: Vec<Part> = found.iter().map(|(_, part, _)| *part).collect();
    let check_one = |(index, (folder, part, manifest)): (usize, Found)| {
        let manifest = match manifest {
            Ok(manifest) => manifest,
            Err(status) => return (folder, part, Err(status)),
        };
        let mut neighbours = [index.wrapping_sub(1), index + 1].into_iter();
        let is_twice = neighbours.any(|i| listed.get(i).is_some_and(|other| part.meets(other)));
        let checked = if part.division != division {
            Err(format!("{part} of another division than most parts: remove those of one"))
        } else if part.from < all.start || part.to > all.end {
            Err(format!("{part}, needed those of {} to {}", all.start, all.end))
        } else if is_twice {
            Err(format!("{part} is there twice: remove one"))
        } else if manifest.state.source != *source {
            Err(format!("made by another program (version {})", manifest.version))
        } else if manifest.project != *project {
            Err("made with another configuration, or of other trials".to_owned())
        } else {
            check_files(&folder, manifest, read)
        };
        (folder, part, checked.map_err(PartStatus::Refused))
    };
    let checked: Vec<_> = found.into_par_iter().enumerate().map(check_one).collect();
    let (mut whole, mut parts) = (Vec::new(), Vec::new());
    for (folder, part, checked) in checked {
        let status = checked.map(|(shard, text)| {
            whole.push(shard);
            PartStatus::Whole(text)
        });
        parts.push((folder, part, status.unwrap_or_else(|problem| problem)));
    }
    let mut next = all.start;
    let ours = listed.into_iter().filter(|part| part.division == division);
    for (from, to) in ours.map(|part| (part.from, part.to)).chain([(all.end, all.end)]) {
        let missing = division.parts(next..from.min(all.end));
        parts.extend(missing.map(|part| (shards.join(part.folder()), part, PartStatus::Missing)));
        next = next.max(to);
    }
    parts.sort_by(|(a_folder, a, _), (b_folder, b, _)| (a, a_folder).cmp(&(b, b_folder)));
    (whole, ShardsStatus { division, parts })
}

/// Checks that all files of a part are as they were written.
fn check_files<R>(
    folder: &Path,
    manifest: Manifest,
    read: Read<R>,
) -> Result<(Shard<R>, String), String> {
    let state = &manifest.state;
    let is_inside = |name: &str| Path::new(name).components().all(|c| matches!(c, Normal(_)));
    if let Some((name, _)) = state.written().find(|(name, _)| !is_inside(name)) {
        let found = format!("found file {name}, needed one in the folder");
        return Err(format!("damaged: {MANIFEST}: {found}"));
    }
    let outputs = state.targets.iter().map(|made| &made.outputs).chain([&state.outputs]);
    let changed = outputs.flat_map(|outputs| changed_outputs(folder, outputs, true)).next();
    if let Some(changed) = changed {
        return Err(format!("damaged: {changed}"));
    }
    let reader = Reader::of(folder, state.written());
    let (rows, text) = read(folder, &manifest, &reader)?;
    Ok((Shard { folder: folder.to_owned(), manifest, rows, reader }, text))
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
    #[derive(Deserialize)]
    struct Format {
        format: u32,
    }
    match serde_json::from_slice(&json) {
        Ok(Format { format }) if format != FORMAT => {
            Err(refused(format!("found format {format}, needed {FORMAT}")))
        }
        _ => serde_json::from_slice(&json).map_err(|e| refused(format!("damaged: {e}"))),
    }
}

/// What there is of all parts. Writes nothing.
///
/// # Errors
/// There is no part, or the lists of trials or the tables that they are of cannot be read.
pub fn shards_status(config: &Config, shards: &Path) -> Result<ShardsStatus, RunError> {
    Ok(look(config, shards)?.1)
}
