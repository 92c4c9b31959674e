//! What ends an ingest and what ends only one trial.

use std::path::PathBuf;

use crate::config::ConfigError;
use crate::store::StoreError;
use crate::trial::TrialError;
use crate::vicon::ViconError;

/// Why a folder cannot be ingested at all.
#[derive(Debug, thiserror::Error)]
pub enum IngestError {
    #[error(transparent)]
    Trials(#[from] ConfigError),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error("{}: an outdated table cannot be removed: {source}", path.display())]
    Outdated { path: PathBuf, source: std::io::Error },
}

/// Why one trial gives no numbers. The other trials go on.
#[derive(Debug, thiserror::Error)]
pub enum TrialFailure {
    #[error(transparent)]
    Trial(#[from] TrialError),
    #[error(transparent)]
    Vicon(#[from] ViconError),
    #[error("{}: found a frame rate of {found_hz} Hz, needed {needed_hz} Hz as vicon.rate_hz says (or set vicon.rate_from_file = true)", path.display())]
    Rate { path: PathBuf, found_hz: f64, needed_hz: f64 },
    #[error("{}: found no frame rate, needed one because vicon.rate_from_file = true (or set it to false and say vicon.rate_hz)", path.display())]
    NoRate { path: PathBuf },
    #[error("{}: found no marker `{label}`, needed by markers.link{link} of pipeline.toml; {hint}", path.display())]
    MissingMarker { path: PathBuf, label: String, link: usize, hint: String },
    #[error("{}: found the marker `{label}` of markers.link{link} as `{}`, needed one of them; the layout must name it `Subject:Marker`", path.display(), found.join("`, `"))]
    AmbiguousMarker { path: PathBuf, label: String, link: usize, found: Vec<String> },
    #[error("{}: found the label `{label}` more than once, needed by markers.link{link} of pipeline.toml once", path.display())]
    RepeatedLabel { path: PathBuf, label: String, link: usize },
    #[error("{}: found the marker `{found}` for both `{first}` and `{second}` of pipeline.toml's [markers], needed one each", path.display())]
    SharedMarker { path: PathBuf, found: String, first: String, second: String },
    #[error("{}: found frames {first} to {last} in only {rows} rows, needed frame numbers without such jumps", path.display())]
    FrameJumps { path: PathBuf, first: i64, last: i64, rows: usize },
    #[error("{}: found no frame in which the markers of link {link} give its pose, needed two that are seen together", path.display())]
    LinkUnseen { path: PathBuf, link: usize },
    #[error("{}: found {found:.1} frames per commanded period, needed at least {needed:.0}; is omega_rad_s right?", path.display())]
    TooFast { path: PathBuf, found: f64, needed: f64 },
    #[error("{}: found {found:.2} periods of motion, needed at least {needed:.0}", path.display())]
    TooShort { path: PathBuf, found: f64, needed: f64 },
    #[error("{}: found joint {joint} seen in only {found} frames, needed at least {needed}", path.display())]
    JointUnseen { path: PathBuf, joint: usize, found: usize, needed: usize },
    #[error("{}: found joint {joint} moving by only {found_deg:.2} degrees at {omega_rad_s:.3} rad/s, needed about the commanded {needed_deg:.1} degrees", path.display())]
    NotDriven { path: PathBuf, joint: usize, omega_rad_s: f64, found_deg: f64, needed_deg: f64 },
    #[error("{}: found {usable} usable of {whole} whole cycles ({skipped} of them transient), needed at least {needed}", path.display())]
    TooFewCycles { path: PathBuf, whole: usize, skipped: usize, usable: usize, needed: usize },
    #[error("{}: found joints that turn by only {found_deg:.2} degrees from their rest, needed one that is let go at {needed_deg:.1} degrees or more", path.display())]
    NotReleased { path: PathBuf, found_deg: f64, needed_deg: f64 },
    #[error("{}: found {found} swings of the joint above the noise that decay, needed at least {needed}", path.display())]
    FewSwings { path: PathBuf, found: usize, needed: usize },
    #[error("{}: found a top speed of {found_m_s:.3} m/s, needed a robot that is pushed to {needed_m_s} m/s or more", path.display())]
    NotPushed { path: PathBuf, found_m_s: f64, needed_m_s: f64 },
    #[error("{}: found a speed that falls to {found:.2} of its top, needed a fall to {needed} or less and a decay", path.display())]
    NoDecay { path: PathBuf, found: f64, needed: f64 },
}
