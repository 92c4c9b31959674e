//! What ends a trial.

use std::path::{Path, PathBuf};

use trilink_mocap::ReadError;
use trilink_tables::trial::TrialError;

/// Why one trial gives no numbers. The other trials go on.
#[derive(Debug, thiserror::Error)]
pub enum TrialFailure {
    #[error(transparent)]
    Trial(#[from] TrialError),
    #[error(transparent)]
    Markers(#[from] ReadError),
    #[error("{}: {problem}", path.display())]
    Recording { path: PathBuf, problem: Problem },
}

/// What is wrong with a recording that can be read.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// What the checks say that are beyond what a trial can have.
    #[error("{checks}")]
    BeyondLimits { checks: String },
    #[error("found a frame rate of {} Hz, needed {} Hz as vicon.rate_hz says (or set vicon.rate_from_file = true)", .found_hz, .needed_hz)]
    Rate { found_hz: f64, needed_hz: f64 },
    #[error(
        "found no frame rate, needed one because vicon.rate_from_file = true (or set it to false and say vicon.rate_hz)"
    )]
    NoRate,
    #[error("found no marker `{label}`, needed by markers.link{link} of pipeline.toml; {hint}")]
    MissingMarker { label: String, link: usize, hint: String },
    #[error(
        "found {missing} of the {all} markers of pipeline.toml's [markers] missing, needed all; the file's labels are {labels}: is it a file of this robot?"
    )]
    ForeignFile { missing: usize, all: usize, labels: String },
    #[error("found the marker `{label}` of markers.link{link} as `{}`, needed one of them; the layout must name it `Subject:Marker`", found.join("`, `"))]
    AmbiguousMarker { label: String, link: usize, found: Vec<String> },
    #[error("found the label `{}` more than once, needed by markers.link{} of pipeline.toml once", .label, .link)]
    RepeatedLabel { label: String, link: usize },
    #[error("found the marker `{}` for both `{}` and `{}` of pipeline.toml's [markers], needed one each", .found, .first, .second)]
    SharedMarker { found: String, first: String, second: String },
    #[error("found frames {} to {} in only {} rows, needed frame numbers without such jumps", .first, .last, .rows)]
    FrameJumps { first: i64, last: i64, rows: usize },
    #[error("found no frame in which the markers of link {} give its pose, needed two that are seen together", .link)]
    LinkUnseen { link: usize },
    /// Markers that do not lie as in the layout, and why.
    #[error("{cause}")]
    OtherLayout { cause: String },
    #[error(
        "found joints that swing by at most {most_deg:.2} degrees, needed the commanded gait: is kind right in trials.toml, and is the file this trial's?"
    )]
    NoSwing { most_deg: f64 },
    #[error("found {omega_rad_s:.4} rad/s, commanded {commanded_rad_s} rad/s: {cause}")]
    OtherFrequency { omega_rad_s: f64, commanded_rad_s: f64, cause: String },
    #[error("found {:.1} frames per commanded period, needed at least {:.0}; is omega_rad_s right?", .found, .needed)]
    TooFast { found: f64, needed: f64 },
    #[error("found {found:.2} periods of motion, needed at least {needed:.0}")]
    TooShort { found: f64, needed: f64 },
    #[error("found joint {joint} seen in only {found} frames, needed at least {needed}")]
    JointUnseen { joint: usize, found: usize, needed: usize },
    #[error("found joint {} moving by only {:.2} degrees at {:.3} rad/s, needed about the commanded {:.1} degrees", .joint, .found_deg, .omega_rad_s, .needed_deg)]
    NotDriven { joint: usize, omega_rad_s: f64, found_deg: f64, needed_deg: f64 },
    #[error("found {} usable of {} whole cycles ({} of them transient), needed at least {}", .usable, .whole, .skipped, .needed)]
    TooFewCycles { whole: usize, skipped: usize, usable: usize, needed: usize },
    #[error("found joints that turn by only {:.2} degrees from their rest, needed one that is let go at {:.1} degrees or more", .found_deg, .needed_deg)]
    NotReleased { found_deg: f64, needed_deg: f64 },
    #[error("found {} swings of the joint above the noise that decay, needed at least {}", .found, .needed)]
    FewSwings { found: usize, needed: usize },
    #[error("found a top speed of {:.3} m/s, needed a robot that is pushed to {} m/s or more", .found_m_s, .needed_m_s)]
    NotPushed { found_m_s: f64, needed_m_s: f64 },
    #[error("found a speed that falls to {:.2} of its top, needed a fall to {} or less and a decay", .found, .needed)]
    NoDecay { found: f64, needed: f64 },
    #[error("found {} group{} of markers that move rigidly together{}{list}{}, needed three groups, one for each link; a marker that is none of the robot's can be named in vicon.ignore", .found, if *.found == 1 { "" } else { "s" }, if list.is_empty() { "" } else { " (" }, if list.is_empty() { "" } else { ")" })]
    RigidGroups { found: usize, list: String },
    #[error(
        "found the markers `{labels}` hardly ever together, needed two of a link at least in most frames, and each marker with two others in some"
    )]
    MarkersApart { labels: String },
    #[error("found {found} frames that show both link 0 and link {link}, needed {needed}")]
    LinksApart { link: usize, found: usize, needed: usize },
    #[error(
        "found joint {joint} turning by only {found_deg:.1} degrees, needed {needed_deg} or more to see where it is; take a trial in which both joints move"
    )]
    LittleTurn { joint: usize, found_deg: f64, needed_deg: f64 },
    #[error(
        "found a gait about links that are bent by {found_deg:.1} degrees, needed at most {needed_deg}: with the middle link aslant of the others all wheels skid to one side, which turns the side links; take a trial of a gait about straight links"
    )]
    BentGait { found_deg: f64, needed_deg: f64 },
    #[error(
        "found a motion that does not say where the joints and wheels are, needed a trial in which both joints move and the wheels roll"
    )]
    NoLayout,
}

impl Problem {
    pub(super) fn of(self, path: &Path) -> TrialFailure {
        TrialFailure::Recording { path: path.to_owned(), problem: self }
    }
}
