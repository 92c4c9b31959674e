//! Survey of the marker files, each examined by itself.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use trilink_base::body;
use trilink_base::cancel::Cancelled;
use trilink_mocap::LengthUnit;
use trilink_mocap::read_markers;
use trilink_tables::config::Config;
use trilink_tables::trial::{TRIALS_FILE, Trial, TrialList};

use super::axes::VerticalAxis;
use super::clusters::{self, Links};
use super::frequency::Recorded;
use super::motion::Motion;
use super::{Described, InitError, OnFile, Request};

/// Frame rate at which groups of markers are searched for, Hz.
const RATE_HZ: f64 = 15.0;

/// Folder of marker files.
pub(super) struct Folder {
    pub path: PathBuf,
    pub files: Vec<String>,
    /// Existing list of trials; `None` if there is none.
    pub list: Option<TrialList>,
}

impl Folder {
    /// Returns the path of the list of trials.
    pub(super) fn list_path(&self) -> PathBuf {
        self.path.join(TRIALS_FILE)
    }
}

/// Findings about a single marker file.
pub(super) struct Survey {
    /// Index of the folder that contains the file.
    pub folder: usize,
    pub name: String,
    pub path: PathBuf,
    /// Entry for the file in an existing list of trials, if there is one.
    pub listed: Option<Trial>,
    pub labels: Vec<String>,
    /// Frame rate, Hz; `None` if the file does not state it.
    pub rate_hz: Option<f64>,
    pub frames: i64,
    /// Links that the file shows, or a message about what it shows instead.
    pub links: Result<Links, String>,
    /// Sentences about missing or contradictory metadata in the file.
    pub doubts: Vec<String>,
    /// Reason why the file cannot be read; `None` if it was read.
    pub unread: Option<String>,
}

impl Survey {
    /// Returns the file's name without its extensions.
    pub(super) fn stem(&self) -> String {
        let name = self.name.strip_suffix(".gz").unwrap_or(&self.name);
        let stem = Path::new(name).file_stem().unwrap_or_default();
        stem.to_string_lossy().into_owned()
    }

    /// Returns the number of markers and rigid bodies.
    pub(super) fn markers(&self) -> usize {
        let further = |label: &&String| body::of_point(label).is_some_and(|(_, point)| point > 0);
        self.labels.iter().filter(|label| !further(label)).count()
    }

    /// Returns the subjects in the marker labels (`subject:name`), each once.
    pub(super) fn subjects(&self) -> Vec<String> {
        let subjects = self.labels.iter().filter_map(|label| label.rsplit_once(':'));
        let mut subjects: Vec<String> = subjects.map(|(subject, _)| subject.to_owned()).collect();
        subjects.sort();
        subjects.dedup();
        subjects
    }
}

/// Returns the folders in the order of the command line, with their existing lists of trials.
///
/// # Errors
/// Returns an error if a file would be overwritten, a folder or list cannot be read, or there is no marker file.
pub(super) fn folders(request: &Request) -> Result<Vec<Folder>, InitError> {
    let config = request.out.join("pipeline.toml");
    if !request.force && !request.add && config.symlink_metadata().is_ok() {
        return Err(InitError::Exists(config));
    }
    let mut folders: Vec<Folder> = Vec::new();
    for path in &request.folders {
        let files = trilink_mocap::marker_files(path)
            .map_err(|source| InitError::Folder { path: path.clone(), source })?;
        let is_same = |other: &Folder| path.canonicalize().ok() == other.path.canonicalize().ok();
        if folders.iter().any(is_same) {
            continue;
        }
        let is_there = path.join(TRIALS_FILE).symlink_metadata().is_ok();
        let list = match TrialList::load(path) {
            Err(error) if is_there && !request.force => return Err(error.into()),
            list => list.ok(),
        };
        folders.push(Folder { path: path.clone(), files, list });
    }
    if folders.iter().all(|folder| folder.files.is_empty()) {
        let names: Vec<String> =
            folders.iter().map(|folder| folder.path.display().to_string()).collect();
        return Err(InitError::NoFiles(names.join(", ")));
    }
    Ok(folders)
}

/// Reads every file of the folders in order; `unit` applies to files that do not state one.
pub(super) fn read_all(
    folders: &[Folder],
    unit: LengthUnit,
    on_file: OnFile,
) -> Result<Vec<Survey>, Cancelled> {
    let files: Vec<(usize, &Folder, &String)> = folders
        .iter()
        .enumerate()
        .flat_map(|(i, folder)| folder.files.iter().map(move |file| (i, folder, file)))
        .collect();
    files
        .into_par_iter()
        .map(|(i, folder, file)| {
            let survey = read(i, folder, file, unit);
            on_file(file)?;
            Ok(survey)
        })
        .collect()
}

/// Reads a file of a folder and searches for the links in it.
fn read(index: usize, folder: &Folder, name: &str, unit: LengthUnit) -> Survey {
    let listed = folder.list.iter().flat_map(|list| &list.trial).find(|trial| trial.file == name);
    let path = folder.path.join(name);
    let mut survey = Survey {
        folder: index,
        name: name.to_owned(),
        path: path.clone(),
        listed: listed.cloned(),
        labels: Vec::new(),
        rate_hz: None,
        frames: 0,
        links: Err(String::new()),
        doubts: Vec::new(),
        unread: None,
    };
    match read_markers(&path, unit) {
        Err(error) => survey.unread = Some(error.problem.to_string()),
        Ok(file) => {
            let ends = file.frames.first().zip(file.frames.last());
            survey.frames = ends.map_or(0, |(first, last)| last - first + 1);
            survey.rate_hz = file.rate_hz;
            let rate_hz = file.rate_hz.unwrap_or(RATE_HZ);
            let thinned = file.thinned((rate_hz / RATE_HZ) as usize);
            survey.links = clusters::links(&thinned);
            if survey.links.as_ref().map_or(0, Vec::len) < 3
                && let Some(VerticalAxis { shows_links, sentence }) = VerticalAxis::detect(&thinned)
            {
                if shows_links {
                    survey.unread = Some(sentence);
                } else {
                    survey.links = Err(sentence);
                }
            }
            survey.labels = file.labels;
            survey.doubts = file.doubts;
        }
    }
    survey
}

/// Returns the most frequent frame rate that files state (the highest in a tie), or else the default, Hz.
pub(super) fn usual_rate_hz(surveys: &[Survey]) -> f64 {
    let rates: Vec<f64> = surveys.iter().filter_map(|survey| survey.rate_hz).collect();
    let count = |rate: f64| rates.iter().filter(|other| **other == rate).count();
    let usual =
        rates.iter().copied().max_by(|&a, &b| count(a).cmp(&count(b)).then(a.total_cmp(&b)));
    usual.unwrap_or(Config::default().vicon.rate_hz)
}

/// Estimates the motion in each file and classifies each recording.
pub(super) fn describe_all(
    surveys: &[Survey],
    links: &Links,
    unit: LengthUnit,
    usual_hz: f64,
) -> Vec<Result<Described, String>> {
    let described = surveys.par_iter().map(|survey| {
        if let Some(reason) = &survey.unread {
            return Err(reason.clone());
        }
        let file = read_markers(&survey.path, unit).map_err(|error| error.problem.to_string())?;
        let rate_hz = survey.rate_hz.unwrap_or(usual_hz);
        let motion = Motion::estimate(&file, links, rate_hz)?;
        let recorded = Recorded::classify(&motion)?;
        Ok(Described { motion, recorded })
    });
    described.collect()
}

/// Lists the reasons why no file shows a chain of links, one file per line.
pub(super) fn reasons(surveys: &[Survey]) -> String {
    let reasons = surveys.iter().filter_map(|survey| {
        let reason = survey.unread.as_ref().or(survey.links.as_ref().err())?;
        let separator = if reason.starts_with([',', ':']) { "" } else { ": " };
        Some(format!("{}{separator}{reason}", survey.path.display()))
    });
    reasons.collect::<Vec<_>>().join("\n")
}
