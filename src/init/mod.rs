//! Generation of a first `pipeline.toml` and `trials.toml` from marker files alone.
//!
//! Each file shows groups of markers that move rigidly together (`clusters`); the groups that most files show are the
//! robot's links. The motion of the links (`motion`) determines the kind and the frequency of each recording
//! (`frequency`), the best file the marker layout (`layout`), and all gaits together the campaigns
//! (`campaigns`). Everything unknown is marked in the files written (`write`).

mod add;
mod axes;
mod campaigns;
mod clusters;
mod frequency;
mod layout;
mod motion;
mod survey;
mod write;

use std::convert::Infallible;
use std::ops::RangeInclusive;
use std::path::PathBuf;

use serde::Serialize;

pub use campaigns::JointSwing;
use trilink_base::Named as _;
use trilink_base::body;
use trilink_base::cancel::Cancelled;
use trilink_mocap::LengthUnit;
use trilink_tables::StoreError;
use trilink_tables::config::ConfigError;
use trilink_tables::trial::TrialKind;

use campaigns::MeasuredGait;
use clusters::Links;
use frequency::{Recorded, Swing};
use layout::{Candidate, Layout, headings_rad, offsets_rad};
use motion::Motion;
use survey::Survey;

/// Plausible lengths of a robot, m.
const LENGTHS_M: RangeInclusive<f64> = 1e-3..=100.0;

/// Arguments of `trilink init`.
#[derive(Debug, Clone, clap::Args)]
pub struct Request {
    /// Folders of marker files.
    #[arg(value_name = "FOLDER", required = true)]
    pub folders: Vec<PathBuf>,
    /// Folder for pipeline.toml; each list of trials is written next to its marker files.
    #[arg(long, value_name = "DIR", default_value = ".", value_parser = parse_folder)]
    pub out: PathBuf,
    /// Distance from joint to wheel of the side links (of the end links of a chain), m, on which the marker layouts of
    /// these links depend [default: estimated from the wheels' motion].
    #[arg(long, value_name = "M", value_parser = parse_length)]
    pub l_m: Option<f64>,
    /// Label of a marker on the front link [default: the front link is found from the markers' names or from the
    /// direction of motion].
    #[arg(long, value_name = "LABEL")]
    pub front: Option<String>,
    /// Unit of length in files that do not state one: mm, cm, m or in.
    #[arg(long, value_name = "UNIT", default_value = "mm", value_parser = parse_unit)]
    pub unit: LengthUnit,
    /// Replace existing files.
    #[arg(long)]
    pub force: bool,
    /// Add the robot of these folders, with its gaits, campaigns and marker layout, to an existing pipeline.toml.
    #[arg(long, conflicts_with = "force")]
    pub add: bool,
}

/// Parses a folder; the current one becomes an empty path.
fn parse_folder(text: &str) -> Result<PathBuf, Infallible> {
    Ok(if text == "." { PathBuf::new() } else { text.into() })
}

/// Parses a plausible length, m.
fn parse_length(text: &str) -> Result<f64, String> {
    let needed = || format!("found `{text}`, needed a number from 0.001 to 100 m");
    text.parse().ok().filter(|length| LENGTHS_M.contains(length)).ok_or_else(needed)
}

/// Parses a unit of length.
fn parse_unit(text: &str) -> Result<LengthUnit, String> {
    let needed = || format!("found `{text}`, needed mm, cm, m or in");
    LengthUnit::of_name(text).ok_or_else(needed)
}

/// Error that prevents all output of `trilink init`.
#[derive(Debug, thiserror::Error)]
pub enum InitError {
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{}: file already exists; --add adds the robot of these folders to it", .0.display())]
    Exists(PathBuf),
    #[error("{}: {why}", path.display())]
    Add { path: PathBuf, why: String },
    #[error("{}: cannot be read: {source}", path.display())]
    Folder { path: PathBuf, source: std::io::Error },
    #[error(
        "{0}: found no marker file, needed .csv, .c3d, .trc, .tsv or .parquet files, which may be gzip-compressed (.gz)"
    )]
    NoFiles(String),
    #[error(
        "no file shows links in a chain; at least one file must show a motion of all joints:\n{0}"
    )]
    NoChain(String),
    #[error(
        "the marker layout is not identifiable from any gait; in at least one file, all joints must turn by at \
         least 5 degrees:\n{0}"
    )]
    NoLayout(String),
    #[error("--front: found `{found}`, needed a marker of a side link: {known}")]
    Front { found: String, known: String },
    #[error(transparent)]
    List(#[from] ConfigError),
    #[error(transparent)]
    Write(#[from] StoreError),
    #[error("the configuration cannot be written: {0}")]
    Template(#[from] minijinja::Error),
}

/// Findings about a file.
#[derive(Debug, Clone, Serialize)]
pub struct FoundFile {
    /// Folder as named on the command line.
    pub folder: PathBuf,
    /// Name of the file in the folder.
    pub file: String,
    pub subjects: Vec<String>,
    /// Number of marker labels.
    pub labels: usize,
    /// Frame rate, Hz, if the file states it.
    pub rate_hz: Option<f64>,
    pub frames: i64,
    pub kind: Option<TrialKind>,
    /// Measured frequency, rad/s, if the file shows a gait.
    pub omega_rad_s: Option<f64>,
    /// Motions of the joints, if the file shows a gait.
    pub joints: Option<Vec<JointSwing>>,
    pub campaign: Option<String>,
    /// If the file is not used, the reason.
    pub problem: Option<String>,
}

/// Campaign found: a gait that several files have in common.
#[derive(Debug, Clone, Serialize)]
pub struct FoundCampaign {
    pub name: String,
    pub files: usize,
    pub joints: Vec<JointSwing>,
    /// Number of the first passive joint, if one is passive.
    pub passive_joint: Option<usize>,
    /// Numbers of all passive joints of a chain.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub passive_joints: Vec<usize>,
}

/// Line of a written file that the user has to review.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mark {
    pub file: PathBuf,
    /// Line number, counted from 1.
    pub line: usize,
    /// Key that the line sets, or file that it lists; empty if the line is only a comment.
    pub of: String,
    /// What the user has to review: the text after `# CHECK: ` in the line.
    pub text: String,
}

/// Everything that was found, and the files that were written.
#[derive(Debug, Clone, Serialize)]
pub struct Findings {
    pub files: Vec<FoundFile>,
    /// Folders in which no usable trial was found.
    pub empty: Vec<PathBuf>,
    /// Name of the robot in `pipeline.toml`.
    pub robot: String,
    /// Names of the markers on the links: of three links on the middle, front and rear one, of others from front to rear.
    pub links: Vec<Vec<String>>,
    /// Labels of markers that are on none of the links.
    pub elsewhere: Vec<String>,
    pub campaigns: Vec<FoundCampaign>,
    pub written: Vec<PathBuf>,
    /// Existing lists of trials, which were not changed.
    pub kept: Vec<PathBuf>,
    pub marks: Vec<Mark>,
}

impl Findings {
    /// Returns whether at least one file was left out or at least one folder yields no trial.
    pub fn is_lacking(&self) -> bool {
        !self.empty.is_empty() || self.files.iter().any(|file| file.problem.is_some())
    }
}

/// Motion in a file, and the kind of recording.
struct Described {
    motion: Motion,
    recorded: Recorded,
}

/// Returns the names of the links: of three links in the order of their numbers, of others from front to rear.
pub fn link_names(links: usize) -> Vec<String> {
    match links {
        2 => ["front", "rear"].map(str::to_owned).into(),
        3 => ["middle", "front", "rear"].map(str::to_owned).into(),
        _ => (1..=links).map(|link| format!("link {link}")).collect(),
    }
}

/// Callback that receives the name of each file once it has been read; an error cancels the reading of further files.
pub type OnFile<'f> = &'f (dyn Fn(&str) -> Result<(), Cancelled> + Sync);

/// Reads folders of marker files and writes `pipeline.toml` and the lists of trials. `on_file` is called with the name
/// of each file that was read, from any thread.
///
/// # Errors
/// Returns an error if a file would be overwritten, a folder cannot be read, no file shows the robot's links, or
/// nothing can be written. Files that cannot be used are findings, not errors.
pub fn init(request: &Request, on_file: OnFile) -> Result<Findings, InitError> {
    let folders = survey::folders(request)?;
    let surveys = survey::read_all(&folders, request.unit, on_file)?;
    let links =
        clusters::most_common(surveys.iter().filter_map(|survey| survey.links.as_ref().ok()));
    let links = links.ok_or_else(|| InitError::NoChain(survey::reasons(&surveys)))?;
    let rate_hz = survey::usual_rate_hz(&surveys);
    let mut described = survey::describe_all(&surveys, &links, request.unit, rate_hz);
    let (links, front_doubt) = put_front_first(links, &mut described, request.front.as_deref())?;
    let layout = find_layout(&links, &surveys, &described, rate_hz, request)?;

    let gaits: Vec<(usize, MeasuredGait)> = described
        .iter()
        .enumerate()
        .filter_map(|(i, found)| {
            Some((i, measured_gait(&surveys[i], found.as_ref().ok()?, &layout)?))
        })
        .collect();
    let measured: Vec<MeasuredGait> = gaits.iter().map(|(_, gait)| gait.clone()).collect();
    let mut groups = campaigns::groups(&measured);
    for group in &mut groups {
        group.files.iter_mut().for_each(|file| *file = gaits[*file].0);
    }
    write::write(write::Written {
        request,
        folders,
        surveys,
        described,
        gaits,
        groups,
        links,
        layout,
        front_doubt,
        rate_hz,
    })
}

/// Reverses the links, if necessary, so that they are in the order from front to rear. The user's label of a marker on
/// the front link decides, or else the markers' names, or else the direction of motion. Also returns the reason for
/// doubt about the order; `None` if the user decided.
fn put_front_first(
    mut links: Links,
    described: &mut [Result<Described, String>],
    front: Option<&str>,
) -> Result<(Links, Option<String>), InitError> {
    let gaits = described.iter().flatten().filter(|found| found.recorded.kind() == TrialKind::Gait);
    let ahead_m: Vec<f64> = gaits.map(|found| found.motion.ahead_m).collect();
    let ends = [&links[0], &links[links.len() - 1]];
    let [first, last] = ends;
    let named = [(first, last), (last, first)]
        .iter()
        .position(|(front, rear)| clusters::are_named(front, rear));
    let is_exchanged = match (front, named) {
        (Some(label), _) => {
            let [is_first, is_last] =
                ends.map(|link| link.iter().any(|name| name == label || body::name(name) == label));
            if !is_first && !is_last {
                let [first, last] = ends.map(|link| clusters::without_points(link).join(", "));
                let known = format!("{first} or {last}");
                return Err(InitError::Front { found: label.to_owned(), known });
            }
            is_last
        }
        (None, Some(order)) => order == 1,
        (None, None) => ahead_m.iter().sum::<f64>() < 0.0,
    };
    if is_exchanged {
        links.reverse();
        described.iter_mut().flatten().for_each(Described::exchange);
    }
    let sign = if is_exchanged { -1.0 } else { 1.0 };
    let forwards = ahead_m.iter().filter(|ahead_m| sign * **ahead_m > 0.0).count();
    let doubt = match (front, named) {
        (Some(_), _) => None,
        (None, Some(_)) => {
            Some("The names of its markers suggest that it is the front link".to_owned())
        }
        (None, None) => Some(format!(
            "This link leads in {forwards} of {} gaits, but some gaits drive the robot backwards",
            ahead_m.len()
        )),
    };
    Ok((links, doubt))
}

impl Described {
    /// Reverses the order of the links: the new phi1 is minus the old angle of the last joint, and so on.
    fn exchange(&mut self) {
        self.motion.exchange();
        match &mut self.recorded {
            Recorded::Gait { swings, .. } => {
                swings.reverse();
                swings.iter_mut().for_each(|swing| *swing = swing.reversed());
            }
            Recorded::Release { joint } => *joint = self.motion.phi_rad.len() - 1 - *joint,
            Recorded::CoastDown => {}
        }
    }
}

/// Estimates the marker layout from the gaits and coast-downs.
fn find_layout(
    links: &Links,
    surveys: &[Survey],
    described: &[Result<Described, String>],
    rate_hz: f64,
    request: &Request,
) -> Result<Layout, InitError> {
    let mut candidates = Vec::new();
    let mut coasts = Vec::new();
    for (survey, found) in surveys.iter().zip(described) {
        let Ok(Described { motion, recorded }) = found else { continue };
        match recorded {
            Recorded::Gait { omega_rad_s, .. } => candidates.push(Candidate {
                path: survey.path.clone(),
                unit: request.unit,
                rate_hz: survey.rate_hz.unwrap_or(rate_hz),
                omega_rad_s: *omega_rad_s,
                motion,
            }),
            Recorded::CoastDown => coasts.push(motion),
            Recorded::Release { .. } => {}
        }
    }
    if candidates.is_empty() {
        return Err(InitError::NoLayout("no file shows a gait".to_owned()));
    }
    Layout::find(links, candidates, &coasts, request.l_m)
        .map_err(|reasons| InitError::NoLayout(reasons.join("\n")))
}

/// Returns the gait in a file, with joint offsets corrected by the marker layout; `None` if the file shows no gait or
/// lacks markers of the layout.
fn measured_gait(survey: &Survey, found: &Described, layout: &Layout) -> Option<MeasuredGait> {
    let Recorded::Gait { omega_rad_s, swings } = &found.recorded else { return None };
    let offsets_rad = offsets_rad(&headings_rad(&found.motion, &layout.positions())?);
    let first_rad = swings[0].phase_rad;
    let joints = swings.iter().zip(offsets_rad).map(|(swing, joint_rad)| {
        let Swing { offset_rad, amplitude_rad, phase_rad } = *swing;
        let [offset, phase] =
            [offset_rad + joint_rad, phase_rad - first_rad].map(trilink_statistics::wrap);
        JointSwing {
            offset_deg: offset.to_degrees(),
            amplitude_deg: amplitude_rad.to_degrees(),
            phase_deg: phase.to_degrees(),
        }
    });
    let listed = survey.listed.as_ref().and_then(|trial| trial.campaign.clone());
    Some(MeasuredGait {
        omega_rad_s: *omega_rad_s,
        joints: joints.collect(),
        is_listed: listed.is_some(),
        name: listed.unwrap_or_else(|| campaigns::words(&survey.stem())),
    })
}
