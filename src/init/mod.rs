//! A first `pipeline.toml` and `trials.toml` from marker files alone.
//!
//! Each file by itself shows groups of markers that move rigidly together (`clusters`); what most files
//! show are the robot's links. Their motion (`motion`) says what was recorded at which frequency
//! (`frequency`), the file that shows it best where the markers sit (`layout`), all gaits together which
//! of them are one campaign (`campaigns`). What is not known is written as such (`write`).

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
use trilink_base::cancel::Cancelled;
use trilink_mocap::LengthUnit;
use trilink_tables::StoreError;
use trilink_tables::config::ConfigError;
use trilink_tables::trial::TrialKind;

use campaigns::Performed;
use clusters::Links;
use frequency::{Recorded, Swing};
use layout::{Candidate, Layout};
use motion::Motion;
use survey::Survey;

/// Lengths that may be a robot's, m.
const LENGTHS_M: RangeInclusive<f64> = 1e-3..=100.0;

/// What to look at, and where to write.
#[derive(Debug, Clone, clap::Args)]
pub struct Request {
    /// Folders of marker files.
    #[arg(value_name = "FOLDER", required = true)]
    pub folders: Vec<PathBuf>,
    /// Folder of pipeline.toml; lists of trials are beside their files.
    #[arg(long, value_name = "DIR", default_value = ".", value_parser = parse_folder)]
    pub out: PathBuf,
    /// Length from joint to wheel of the side links, m, by which their markers are placed [default: as
    /// far as the wheels show it].
    #[arg(long, value_name = "M", value_parser = parse_length)]
    pub l_m: Option<f64>,
    /// A marker of the front link [default: by their names, or where the robot moves].
    #[arg(long, value_name = "LABEL")]
    pub front: Option<String>,
    /// Unit of files that do not say theirs: mm, cm, m or in.
    #[arg(long, value_name = "UNIT", default_value = "mm", value_parser = parse_unit)]
    pub unit: LengthUnit,
    /// Replace files that are there.
    #[arg(long)]
    pub force: bool,
}

/// A folder; the one where the command is given has no name.
fn parse_folder(text: &str) -> Result<PathBuf, Infallible> {
    Ok(if text == "." { PathBuf::new() } else { text.into() })
}

fn parse_length(text: &str) -> Result<f64, String> {
    let needed = || format!("found `{text}`, needed a number from 0.001 to 100 m");
    text.parse().ok().filter(|length| LENGTHS_M.contains(length)).ok_or_else(needed)
}

fn parse_unit(text: &str) -> Result<LengthUnit, String> {
    let needed = || format!("found `{text}`, needed mm, cm, m or in");
    LengthUnit::of_name(text).ok_or_else(needed)
}

/// Why nothing is written.
#[derive(Debug, thiserror::Error)]
pub enum InitError {
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    #[error("{}: found a file, needed a new one, or --force to replace it", .0.display())]
    Exists(PathBuf),
    #[error("{}: cannot be read: {source}", path.display())]
    Folder { path: PathBuf, source: std::io::Error },
    #[error("{0}: found no marker file, needed .csv, .csv.gz or .c3d files")]
    NoFiles(String),
    #[error(
        "found no file that shows three links in a chain, needed one in which both joints move:\n{0}"
    )]
    NoChain(String),
    #[error(
        "found no gait that shows where the markers sit, needed a file in which both joints turn by 20 degrees or more:\n{0}"
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

/// What is known of a file.
#[derive(Debug, Clone, Serialize)]
pub struct FoundFile {
    /// As it was named, and the file in it.
    pub folder: PathBuf,
    pub file: String,
    pub subjects: Vec<String>,
    pub labels: usize,
    /// Hz, if the file says one.
    pub rate_hz: Option<f64>,
    pub frames: i64,
    /// Part of the robot's markers and frames that was seen.
    pub kind: Option<TrialKind>,
    /// Measured, of a gait.
    pub omega_rad_s: Option<f64>,
    /// phi1 and phi2 of a gait.
    pub joints: Option<[JointSwing; 2]>,
    pub campaign: Option<String>,
    /// Why it is left out.
    pub problem: Option<String>,
}

/// A gait that files have in common.
#[derive(Debug, Clone, Serialize)]
pub struct FoundCampaign {
    pub name: String,
    pub files: usize,
    pub joints: [JointSwing; 2],
    /// The passive joint, 1 or 2.
    pub passive_joint: Option<usize>,
}

/// A line that a person has to look at.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Mark {
    pub file: PathBuf,
    /// From 1.
    pub line: usize,
    /// What stands before and after the mark.
    pub of: String,
    pub text: String,
}

/// All that was found and written.
#[derive(Debug, Clone, Serialize)]
pub struct Findings {
    pub files: Vec<FoundFile>,
    /// Folders without a trial.
    pub empty: Vec<PathBuf>,
    /// As `pipeline.toml` calls it.
    pub robot: String,
    /// Markers of the middle, front and rear link.
    pub links: [Vec<String>; 3],
    /// Labels of markers on none of them.
    pub elsewhere: Vec<String>,
    pub campaigns: Vec<FoundCampaign>,
    pub written: Vec<PathBuf>,
    /// Lists of trials that were there, and stay.
    pub kept: Vec<PathBuf>,
    pub marks: Vec<Mark>,
}

impl Findings {
    /// Whether a file or folder gives no trial.
    pub fn is_lacking(&self) -> bool {
        !self.empty.is_empty() || self.files.iter().any(|file| file.problem.is_some())
    }
}

/// What a file turned out to be.
struct Described {
    motion: Motion,
    recorded: Recorded,
}

/// Called after each file that was read; an error cancels the rest.
pub type OnFile<'f> = &'f (dyn Fn(&str) -> Result<(), Cancelled> + Sync);

/// Looks at folders of marker files and writes what they show. `on_file` hears of each file that was
/// read, from any thread.
///
/// # Errors
/// A file would be overwritten, a folder cannot be read, no file shows the robot's three links, or
/// nothing can be written. Files that cannot be used are findings.
pub fn init(request: &Request, on_file: OnFile) -> Result<Findings, InitError> {
    let folders = survey::folders(request)?;
    let surveys = survey::read_all(&folders, request.unit, on_file)?;
    let links = clusters::shown_by_most(surveys.iter().filter_map(|of| of.links.as_ref().ok()));
    let links = links.ok_or_else(|| InitError::NoChain(survey::reasons(&surveys)))?;
    let rate_hz = survey::usual_rate_hz(&surveys);
    let mut described = survey::describe_all(&surveys, &links, request.unit, rate_hz);
    let (links, front_doubt) = put_front_first(links, &mut described, request.front.as_deref())?;
    let layout = find_layout(&links, &surveys, &described, rate_hz, request)?;

    let gaits: Vec<(usize, Performed)> = described
        .iter()
        .enumerate()
        .filter_map(|(i, of)| Some((i, performed(&surveys[i], of.as_ref().ok()?, &layout)?)))
        .collect();
    let performed: Vec<Performed> = gaits.iter().map(|(_, gait)| gait.clone()).collect();
    let mut groups = campaigns::groups(&performed);
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

/// Puts the front link before the rear one: as a person says, as the markers are called, or to where
/// the robot moves. Gives what leaves that in doubt, too.
fn put_front_first(
    mut links: Links,
    described: &mut [Result<Described, String>],
    front: Option<&str>,
) -> Result<(Links, Option<String>), InitError> {
    let ahead = |of: &Result<Described, String>| {
        let of = of.as_ref().ok().filter(|of| of.recorded.kind() == TrialKind::Gait)?;
        Some(of.motion.ahead_m)
    };
    let ways_m: Vec<f64> = described.iter().filter_map(ahead).collect();
    let named =
        [1, 2].into_iter().find(|&link| clusters::are_named(&links[link], &links[3 - link]));
    let is_exchanged = match (front, named) {
        (Some(label), _) => {
            let is_of = |names: &[String]| names.iter().any(|name| name == label);
            if !is_of(&links[1]) && !is_of(&links[2]) {
                let known = format!("{} or {}", links[1].join(", "), links[2].join(", "));
                return Err(InitError::Front { found: label.to_owned(), known });
            }
            is_of(&links[2])
        }
        (None, Some(link)) => link == 2,
        (None, None) => ways_m.iter().sum::<f64>() < 0.0,
    };
    if is_exchanged {
        links.swap(1, 2);
        described.iter_mut().filter_map(|of| of.as_mut().ok()).for_each(Described::exchange);
    }
    let sign = if is_exchanged { -1.0 } else { 1.0 };
    let (there, all) = (ways_m.iter().filter(|way_m| sign * **way_m > 0.0).count(), ways_m.len());
    let doubt = match (front, named) {
        (Some(_), _) => None,
        (None, Some(_)) => Some("Its markers are called so".to_owned()),
        (None, None) => Some(format!(
            "The robot moves that way in {there} of {all} gaits, but some gaits drive it backwards"
        )),
    };
    Ok((links, doubt))
}

impl Described {
    /// Calls the rear link the front link: then phi1 is minus what phi2 was, and the other way round.
    fn exchange(&mut self) {
        self.motion.exchange();
        match &mut self.recorded {
            Recorded::Gait { swings, .. } => {
                swings.swap(0, 1);
                *swings = swings.map(Swing::reversed);
            }
            Recorded::Release { joint } => *joint = 1 - *joint,
            Recorded::CoastDown => {}
        }
    }
}

fn find_layout(
    links: &Links,
    surveys: &[Survey],
    described: &[Result<Described, String>],
    rate_hz: f64,
    request: &Request,
) -> Result<Layout, InitError> {
    let known =
        || surveys.iter().zip(described).filter_map(|(of, found)| Some((of, found.as_ref().ok()?)));
    let candidates =
        known().filter_map(|(survey, Described { motion, recorded })| match recorded {
            Recorded::Gait { omega_rad_s, .. } => Some(Candidate {
                path: survey.path.clone(),
                unit: request.unit,
                rate_hz: survey.rate_hz.unwrap_or(rate_hz),
                omega_rad_s: *omega_rad_s,
                motion,
            }),
            _ => None,
        });
    let coasts: Vec<&Motion> = known()
        .filter(|(_, of)| of.recorded == Recorded::CoastDown)
        .map(|(_, of)| &of.motion)
        .collect();
    Layout::find(links, candidates.collect(), &coasts, request.l_m)
        .map_err(|reasons| InitError::NoLayout(reasons.join("\n")))
}

/// What the joints do in a gait's file.
fn performed(survey: &Survey, of: &Described, layout: &Layout) -> Option<Performed> {
    let Recorded::Gait { omega_rad_s, swings } = of.recorded else { return None };
    let offsets_rad = layout.offsets_rad(&of.motion)?;
    let first_rad = swings[0].phase_rad;
    let joint = |i: usize| {
        let Swing { offset_rad, amplitude_rad, phase_rad } = swings[i];
        let [offset, phase] =
            [offset_rad + offsets_rad[i], phase_rad - first_rad].map(trilink_statistics::wrap);
        JointSwing {
            offset_deg: offset.to_degrees(),
            amplitude_deg: amplitude_rad.to_degrees(),
            phase_deg: phase.to_degrees(),
        }
    };
    let listed = survey.listed.as_ref().and_then(|trial| trial.campaign.clone());
    Some(Performed {
        omega_rad_s,
        joints: [joint(0), joint(1)],
        is_listed: listed.is_some(),
        name: listed.unwrap_or_else(|| campaigns::words(&survey.stem())),
    })
}
