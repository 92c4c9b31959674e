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
    #[error("{}: {problem}", path.display())]
    Layout { path: PathBuf, problem: LayoutProblem },
}

/// Why a recording gives no layout.
#[derive(Debug, thiserror::Error)]
pub enum LayoutProblem {
    #[error("found {} that move rigidly together{}, needed three groups, one for each link; a marker that is none of the robot's can be named in vicon.ignore", groups(found.len()), list(found))]
    Groups { found: Vec<Vec<String>> },
    #[error("found the markers `{}` hardly ever together, needed two of a link at least in most frames, and each marker with two others in some", labels.join("`, `"))]
    Unseen { labels: Vec<String> },
    #[error("found {found} frames that show both link 0 and link {}, needed {needed}", side + 1)]
    FewFrames { side: usize, found: usize, needed: usize },
    #[error("found joint {} turning by only {found_deg:.1} degrees, needed {needed_deg} or more to see where it is; take a trial in which both joints move", side + 1)]
    LittleTurn { side: usize, found_deg: f64, needed_deg: f64 },
    #[error(
        "found a motion that does not say where the joints and wheels are, needed a trial in which both joints move and the wheels roll"
    )]
    Indeterminate,
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
