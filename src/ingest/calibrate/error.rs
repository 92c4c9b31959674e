//! Why a trial gives no layout.

use std::path::PathBuf;

use crate::config::ConfigError;
use crate::ingest::error::TrialFailure;

/// Why a trial gives no layout.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    #[error(transparent)]
    Trials(#[from] ConfigError),
    #[error("{}: found no trial `{id}`, needed one of trials.toml{hint}", folder.display())]
    NoTrial { folder: PathBuf, id: String, hint: String },
    #[error(transparent)]
    Trial(#[from] TrialFailure),
    #[error("{}: found {} that move rigidly together{}, needed three groups, one for each link; a marker that is none of the robot's can be named in vicon.ignore", path.display(), groups(found.len()), list(found))]
    Groups { path: PathBuf, found: Vec<Vec<String>> },
    #[error("{}: found the markers `{}` hardly ever together, needed two of a link at least in most frames, and each marker with two others in some", path.display(), labels.join("`, `"))]
    Unseen { path: PathBuf, labels: Vec<String> },
    #[error("{}: found {found} frames that show both link 0 and link {}, needed {needed}", path.display(), side + 1)]
    FewFrames { path: PathBuf, side: usize, found: usize, needed: usize },
    #[error("{}: found joint {} turning by only {found_deg:.1} degrees, needed {needed_deg} or more to see where it is; take a trial in which both joints move", path.display(), side + 1)]
    LittleTurn { path: PathBuf, side: usize, found_deg: f64, needed_deg: f64 },
    #[error("{}: found a motion that does not say where the joints and wheels are, needed a trial in which both joints move and the wheels roll", path.display())]
    Indeterminate { path: PathBuf },
}

fn groups(count: usize) -> String {
    match count {
        1 => "1 group of markers".to_owned(),
        several => format!("{several} groups of markers"),
    }
}

fn list(groups: &[Vec<String>]) -> String {
    let each: Vec<String> = groups.iter().map(|group| group.join(" ")).collect();
    if each.is_empty() { String::new() } else { format!(" ({})", each.join("; ")) }
}
