//! The marker files of the folders, one by one.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use trilink_base::cancel::Cancelled;
use trilink_mocap::LengthUnit;
use trilink_mocap::read_markers;
use trilink_tables::config::Config;
use trilink_tables::trial::{TRIALS_FILE, Trial, TrialList};

use super::axes::Upwards;
use super::clusters::{self, Links};
use super::frequency::Recorded;
use super::motion::Motion;
use super::{Described, InitError, OnFile, Request};

/// Rate at which groups of markers are looked for, Hz.
const RATE_HZ: f64 = 15.0;

/// A folder with its marker files.
pub(super) struct Folder {
    pub path: PathBuf,
    pub files: Vec<String>,
    /// The list that is there.
    pub list: Option<TrialList>,
}

impl Folder {
    pub(super) fn list_path(&self) -> PathBuf {
        self.path.join(TRIALS_FILE)
    }
}

/// A marker file.
pub(super) struct Survey {
    /// Index of its folder.
    pub folder: usize,
    pub name: String,
    pub path: PathBuf,
    /// What a list says of it that is there.
    pub listed: Option<Trial>,
    pub labels: Vec<String>,
    /// As the file says.
    pub rate_hz: Option<f64>,
    pub frames: i64,
    pub links: Result<Links, String>,
    /// What the file states of itself that is missing or contradicts itself.
    pub doubts: Vec<String>,
    /// Why it cannot be read.
    pub unread: Option<String>,
}

impl Survey {
    /// The file's name without what says its format.
    pub(super) fn stem(&self) -> String {
        let name = self.name.strip_suffix(".gz").unwrap_or(&self.name);
        let stem = Path::new(name).file_stem().unwrap_or_default();
        stem.to_string_lossy().into_owned()
    }

    /// Subjects of the labels, each once.
    pub(super) fn subjects(&self) -> Vec<String> {
        let of = |label: &String| Some(label.rsplit_once(':')?.0.to_owned());
        let mut subjects: Vec<String> = self.labels.iter().filter_map(of).collect();
        subjects.sort();
        subjects.dedup();
        subjects
    }
}

/// The folders in the order of the command, with what is there and may not be overwritten.
pub(super) fn folders(request: &Request) -> Result<Vec<Folder>, InitError> {
    let config = request.out.join("pipeline.toml");
    if !request.force && config.symlink_metadata().is_ok() {
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

/// Every file of the folders, in their order; `unit` is that of files that do not say theirs.
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

fn read(index: usize, folder: &Folder, name: &str, unit: LengthUnit) -> Survey {
    let listed = folder.list.iter().flat_map(|list| &list.trial).find(|of| of.file == name);
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
            if survey.links.is_err()
                && let Some(Upwards { shows_links, sentence }) = Upwards::of(&thinned)
            {
                match shows_links {
                    true => survey.unread = Some(sentence),
                    false => survey.links = Err(sentence),
                }
            }
            (survey.labels, survey.doubts) = (file.labels, file.doubts);
        }
    }
    survey
}

/// The rate of most files that say one, the higher of two; else the default.
pub(super) fn usual_rate_hz(surveys: &[Survey]) -> f64 {
    let said: Vec<f64> = surveys.iter().filter_map(|of| of.rate_hz).collect();
    let count = |rate: f64| said.iter().filter(|other| **other == rate).count();
    let usual = said.iter().copied().max_by(|&a, &b| count(a).cmp(&count(b)).then(a.total_cmp(&b)));
    usual.unwrap_or(Config::default().vicon.rate_hz)
}

/// What the files are recordings of.
pub(super) fn describe_all(
    surveys: &[Survey],
    links: &Links,
    unit: LengthUnit,
    usual_hz: f64,
) -> Vec<Result<Described, String>> {
    let describe = |survey: &Survey| {
        if let Some(reason) = &survey.unread {
            return Err(reason.clone());
        }
        let file = read_markers(&survey.path, unit).map_err(|error| error.problem.to_string())?;
        let rate_hz = survey.rate_hz.unwrap_or(usual_hz);
        let motion = Motion::of(&file, links, rate_hz)?;
        let recorded = Recorded::of(&motion)?;
        Ok(Described { motion, recorded })
    };
    surveys.par_iter().map(describe).collect()
}

/// Why no file shows a chain, a line a file.
pub(super) fn reasons(surveys: &[Survey]) -> String {
    let reason = |of: &Survey| {
        let reason = of.unread.as_ref().or(of.links.as_ref().err())?;
        let separator = if reason.starts_with([',', ':']) { "" } else { ": " };
        Some(format!("{}{separator}{reason}", of.path.display()))
    };
    surveys.iter().filter_map(reason).collect::<Vec<_>>().join("\n")
}
