//! Errors that make a trial fail.

use std::path::{Path, PathBuf};

use trilink_mocap::ReadError;
use trilink_tables::trial::TrialError;

/// Reason why a trial cannot be processed. A failed trial does not affect the other trials.
#[derive(Debug, thiserror::Error)]
pub enum TrialFailure {
    #[error(transparent)]
    Trial(#[from] TrialError),
    #[error(transparent)]
    Markers(#[from] ReadError),
    #[error("{}: {problem}", path.display())]
    Recording { path: PathBuf, problem: Problem },
}

/// Problem with a recording whose file could be read.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// Some checks failed with the severity `error`; `checks` has the messages of these checks.
    #[error("{checks}")]
    BeyondLimits { checks: String },
    #[error(
        "the file's frame rate is {} Hz, but vicon.rate_hz is {} Hz; correct vicon.rate_hz, or set \
         vicon.rate_from_file = true",
        .found_hz, .needed_hz
    )]
    Rate { found_hz: f64, needed_hz: f64 },
    #[error(
        "the file states no frame rate, but vicon.rate_from_file = true requires one: set vicon.rate_from_file = \
         false and vicon.rate_hz to the frame rate"
    )]
    NoRate,
    #[error("the file has no marker `{label}`, which {table} of pipeline.toml requires; {hint}")]
    MissingMarker { label: String, link: usize, table: String, hint: String },
    #[error(
        "{missing} of the {all} markers of pipeline.toml's {table} are not in the file, whose labels are {labels}: \
         does the file belong to this robot?"
    )]
    ForeignFile { missing: usize, all: usize, table: String, labels: String },
    #[error(
        "the marker `{label}` of {table} matches the labels `{}`; replace the label in that table by one \
         of these, in the form `Subject:Marker`",
        found.join("`, `")
    )]
    AmbiguousMarker { label: String, table: String, found: Vec<String> },
    #[error(
        "the file has the label `{}` more than once, but {} of pipeline.toml needs it to be unique",
        .label, .table
    )]
    RepeatedLabel { label: String, table: String },
    #[error(
        "the marker `{}` matches both `{}` and `{}` of pipeline.toml's {}, but each of these entries needs a marker of \
         its own",
        .found, .first, .second, .table
    )]
    SharedMarker { found: String, first: String, second: String, table: String },
    #[error("found frames {} to {} in only {} rows: the frame numbers jump implausibly", .first, .last, .rows)]
    FrameJumps { first: i64, last: i64, rows: usize },
    #[error("no frame shows two markers of link {} together, but its pose requires two", .link)]
    LinkUnseen { link: usize },
    /// The marker layout contradicts the recording; `cause` is the likely reason.
    #[error("{cause}")]
    OtherLayout { cause: String },
    #[error(
        "the joints swing by at most {max_deg:.2} degrees, so they do not follow the commanded gait: is `kind` \
         correct in trials.toml, and does the file belong to this trial?"
    )]
    NoSwing { max_deg: f64 },
    #[error("measured {omega_rad_s:.4} rad/s, commanded {commanded_rad_s} rad/s: {cause}")]
    OtherFrequency { omega_rad_s: f64, commanded_rad_s: f64, cause: String },
    #[error(
        "found {:.1} frames per commanded period, but at least {:.0} are needed; is omega_rad_s correct?",
        .found, .needed
    )]
    TooFast { found: f64, needed: f64 },
    #[error("found {found:.2} periods of motion, but at least {needed:.0} are needed")]
    TooShort { found: f64, needed: f64 },
    #[error("joint {joint} is visible in only {found} frames, but at least {needed} are needed")]
    JointUnseen { joint: usize, found: usize, needed: usize },
    #[error(
        "joint {joint} is visible in only {found} of the {frames} frames from which the gait's frequency and phase are \
         measured: these are too few, or all in the same part of the cycle"
    )]
    JointOccluded { joint: usize, found: usize, frames: usize },
    #[error(
        "joint {} moves by only {:.2} degrees at {:.3} rad/s, but {:.1} degrees were commanded",
        .joint, .found_deg, .omega_rad_s, .needed_deg
    )]
    NotDriven { joint: usize, omega_rad_s: f64, found_deg: f64, needed_deg: f64 },
    #[error(
        "only {usable} of {all} cycles can be used, but at least {needed} are needed: the first {skipped} were still \
         settling, {gapped} have gaps or jumps, in {off_gait} the joints do not follow the gait"
    )]
    TooFewCycles {
        all: usize,
        usable: usize,
        needed: usize,
        skipped: usize,
        gapped: usize,
        off_gait: usize,
    },
    #[error(
        "the joints deviate from their rest angles by only {:.2} degrees: release one joint at an angle of {:.1} \
         degrees or more",
        .found_deg, .needed_deg
    )]
    NotReleased { found_deg: f64, needed_deg: f64 },
    #[error(
        "joint {joint} moves farthest, but it is driven: release a joint of the kind `spring`, `elastic` or `torque`, and \
         hold the others"
    )]
    ReleasedDriven { joint: usize },
    #[error("found {} decaying swings of the joint above the noise, but at least {} are needed", .found, .needed)]
    FewSwings { found: usize, needed: usize },
    #[error("the robot reaches only {:.3} m/s: push it to {} m/s or more", .found_m_s, .needed_m_s)]
    NotPushed { found_m_s: f64, needed_m_s: f64 },
    #[error(
        "the speed falls only to {:.2} times its maximum, but it must fall to {} times the maximum or less",
        .found, .needed
    )]
    NoDecay { found: f64, needed: f64 },
    #[error(
        "found {} group{} of markers that move rigidly together{}{list}{}, but {} groups are needed, one for each \
         link; markers that are not on the robot can be listed in vicon.ignore",
        .found,
        if *.found == 1 { "" } else { "s" },
        if list.is_empty() { "" } else { " (" },
        if list.is_empty() { "" } else { ")" },
        LINK_COUNTS.get(*.needed).unwrap_or(&"as many")
    )]
    RigidGroups { found: usize, list: String, needed: usize },
    #[error(
        "found a chain of {found} links, but the robot has {needed}: use a trial in which all joints move; markers that \
         are not on the robot can be listed in vicon.ignore"
    )]
    ShortChain { found: usize, needed: usize },
    #[error("link `{name}` has no markers, so that the joints beside it cannot be located")]
    BareLink { name: String },
    #[error(
        "link `{name}` has no wheel that rolls along it and no neighbour with two joints, so that its direction cannot be \
         estimated"
    )]
    NoDirection { name: String },
    #[error(
        "the motion does not show which end of the robot is the front, because no joint is driven or because the \
         commands of the driven joints look the same from both ends: use a file with the configured labels"
    )]
    NoFront,
    #[error(
        "the markers `{labels}` are hardly ever visible together: at least two markers of a link must be visible in \
         most frames, and each marker together with two others of its link in some frames"
    )]
    MarkersApart { labels: String },
    #[error(
        "joint {joint} turns by only {found_deg:.1} degrees, but {needed_deg} or more are needed to locate it; use a \
         trial in which all joints move"
    )]
    LittleTurn { joint: usize, found_deg: f64, needed_deg: f64 },
    #[error(
        "the gait's mean joint angle is {found_deg:.1} degrees, but at most {needed_deg} is allowed: if a \
         link is oblique to its neighbours, all wheels skid to one side, which turns the first and last link; use a trial \
         whose gait oscillates about the straight configuration"
    )]
    BentGait { found_deg: f64, needed_deg: f64 },
    #[error(
        "the motion does not determine where the joints and wheels are; use a trial in which all joints move and \
         the wheels roll"
    )]
    NoLayout,
}

/// Numbers of links in words, by number.
const LINK_COUNTS: [&str; 9] =
    ["no", "one", "two", "three", "four", "five", "six", "seven", "eight"];

impl Problem {
    pub(super) fn in_file(self, path: &Path) -> TrialFailure {
        TrialFailure::Recording { path: path.to_owned(), problem: self }
    }
}
