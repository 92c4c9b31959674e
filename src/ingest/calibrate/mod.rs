//! The links' marker layouts from a trial of which only the labels are known.
//!
//! What a trial in which both joints move shows:
//!
//! - which markers move rigidly together (`links`) and how they lie to each other (`shape`);
//! - the joints, which are points at rest in both their links (`estimate`). Those of the middle
//!   link give its origin, half way between them, its direction and h;
//! - of a side link its joint only. In which direction its axle is from there is where its wheel
//!   rolls to (`rolling`): as good as the wheel does not skid to one side on average. How far
//!   away it is does not show well in a wheel that skids, so l is taken from the robot and
//!   what the wheel gives is only shown.
//!
//! The heights are means. Standard errors are those of a jackknife over parts of the trial, so
//! they account for noise and for what changes from part to part, not for what the wheels do
//! alike in every cycle.

mod estimate;
mod links;
mod rolling;
mod shape;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use super::error::{Problem, TrialFailure};
use super::input::{IngestInput, IngestSettings};
use super::markers::layout::{LinkMarker, locate, marker_name};
use super::phase::CommandedGait;
use crate::config::{Config, ConfigError, Markers, nearest};
use crate::robot::{Gait, Robot};
use crate::stats::{Estimate, quantiles_low, wrap};
use crate::trial::TrialList;
use crate::vicon::{self, MarkerFile};
use estimate::LayoutEstimate;
use shape::Body;

/// Parts of the trial whose differences give the standard errors.
const PARTS: usize = 10;
/// How far a joint must turn, from its 5th to its 95th percentile, degrees.
const LEAST_TURN_DEG: f64 = 20.0;
/// How bent the links may be on average, half the difference of the joints' mean angles, degrees.
/// A robot that drives an arc skids to one side: the directions are off by half of that angle and
/// show the other half of it.
const MOST_BENT_DEG: f64 = 3.0;
/// Error of the directions, over what they show of the arc's angle.
const ARC_ERROR: f64 = 1.2;
/// The same over what the parts of the trial differ by: what they have in common they do not show.
/// Where they differ by 0.1 degrees, directions are off by 0.14 to 0.36.
const COMMON_ERROR: f64 = 2.0;
/// Frames in which two links must be seen.
const LEAST_ROWS: usize = 100;

/// Why a trial gives no layout.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    #[error(transparent)]
    Trials(#[from] ConfigError),
    #[error("{}: found no trial `{id}`, needed one of trials.toml{hint}", folder.display())]
    NoTrial { folder: PathBuf, id: String, hint: String },
    #[error(transparent)]
    Trial(#[from] TrialFailure),
}

/// A marker's position in its link's frame, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerPosition {
    /// As in the file, without the subject if no other marker has that name.
    pub label: String,
    /// x, y, z.
    pub position_mm: [Estimate; 3],
    /// The configured one, if this label is configured on this link.
    pub configured_mm: Option<[f64; 3]>,
}

/// Layout and dimensions of the robot as a trial shows them.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    pub trial: String,
    /// Markers of links 0, 1, 2 in the order of the file.
    pub links: [Vec<MarkerPosition>; 3],
    /// Whether the links' markers were found by how they move, because the file does not have
    /// those that the configuration names; then the front is where the commanded gait has it.
    pub is_grouped: bool,
    /// Labels that move with no link.
    pub left_out: Vec<String>,
    /// Half the distance of the two joints, and as configured, mm.
    pub h_mm: Estimate,
    pub h_configured_mm: f64,
    /// Distance from the joint at which the wheels of links 1 and 2 skid least, and what was
    /// taken instead, mm.
    pub l_mm: [Estimate; 2],
    pub l_configured_mm: f64,
    /// RMS distance of the two positions of each joint, mm.
    pub joint_residual_mm: [f64; 2],
    /// Standard errors of the side links' directions, degrees, with what wheels add that skid to
    /// one side on average.
    pub direction_se_deg: [f64; 2],
    /// Frames that were used.
    pub frames: usize,
}

/// Estimates the layouts from one trial of a folder.
///
/// # Errors
/// The folder has no such trial (the nearest id is named), its entry or file cannot be used,
/// its markers do not form three rigid groups, or a joint hardly turns.
pub fn calibrate(
    config: &Config,
    folder: &Path,
    id: &str,
) -> Result<Calibration, CalibrationError> {
    let list = TrialList::load(folder)?;
    let trial = list.trial.iter().find(|trial| trial.id == id).ok_or_else(|| {
        let ids = list.trial.iter().map(|trial| trial.id.as_str());
        let hint = nearest(id, ids).map_or(String::new(), |id| format!("; did you mean `{id}`?"));
        CalibrationError::NoTrial { folder: folder.to_owned(), id: id.to_owned(), hint }
    })?;
    let input = IngestInput::new(config, trial).map_err(TrialFailure::from)?;
    let settings @ IngestSettings { vicon, markers, .. } = &input.settings;
    let (robot, gait) = (input.robot(), input.command(trial));
    let path = folder.join(&trial.file);
    let file = vicon::read_markers(&path).map_err(TrialFailure::from)?;
    let file = file.without(&vicon.ignore);
    let calibration = settings
        .frame_rate(&file)
        .and_then(|rate_hz| of_file(&file, markers, &robot, gait.as_ref(), rate_hz))
        .map_err(|problem| problem.of(&path))?;
    Ok(Calibration { trial: trial.id.clone(), ..calibration })
}

/// [`calibrate`] of markers at hand.
fn of_file(
    file: &MarkerFile,
    markers: &Markers,
    robot: &Robot,
    gait: Option<&(Gait, f64)>,
    rate_hz: f64,
) -> Result<Calibration, Problem> {
    let labels = |columns: &[usize]| {
        columns.iter().map(|&column| file.labels[column].clone()).collect::<Vec<_>>()
    };
    let configured = locate(markers, file).ok();
    let is_grouped = configured.is_none();
    let groups = match configured {
        Some(layout) => layout.map(|link| link.iter().map(|marker| marker.column).collect()),
        None => links::rigid_groups(file).try_into().map_err(|found: Vec<Vec<usize>>| {
            let list: Vec<String> = found.iter().map(|group| labels(group).join(" ")).collect();
            Problem::RigidGroups { found: found.len(), list: list.join("; ") }
        })?,
    };
    let shaped = |columns: &[usize]| {
        Body::of(file, columns)
            .ok_or_else(|| Problem::MarkersApart { labels: labels(columns).join("`, `") })
    };
    let [a, b, c] = &groups;
    let mut bodies = [shaped(a)?, shaped(b)?, shaped(c)?];
    if is_grouped {
        let command = gait.map(|&(ref gait, omega_rad_s)| CommandedGait {
            gait,
            omega_rad_s,
            rate_hz,
            skip_cycles: 0,
        });
        bodies = links::in_order(file, bodies, command)?;
    }
    for side in 0..2 {
        check_turn(side, &bodies[0], &bodies[1 + side])?;
    }
    let rows = file.frames.len();
    let estimate = |left_out: usize| {
        let part = |row: usize| row * PARTS / rows;
        LayoutEstimate::of(file, &bodies, robot, rate_hz, &|row| part(row) != left_out)
    };
    let whole = estimate(PARTS).ok_or(Problem::NoLayout)?;
    let partial: Vec<LayoutEstimate> =
        (0..PARTS).map(estimate).collect::<Option<_>>().ok_or(Problem::NoLayout)?;
    let commanded_rad = gait.map_or(0.0, |(gait, _)| {
        let [first, second] = gait.joints.map(|joint| joint.map_or(0.0, |joint| joint.offset_rad));
        0.5 * (first - second)
    });
    let bent_deg = [commanded_rad, 2.0 * whole.bent_rad].map(|bent| bent.abs().to_degrees());
    if let Some(found_deg) = bent_deg.into_iter().find(|deg| *deg > MOST_BENT_DEG) {
        return Err(Problem::BentGait { found_deg, needed_deg: MOST_BENT_DEG });
    }
    let measured = |value: &dyn Fn(&LayoutEstimate) -> f64| {
        let all = value(&whole);
        let squares: f64 = partial.iter().map(|part| (value(part) - all).powi(2)).sum();
        let se = ((PARTS - 1) as f64 / PARTS as f64 * squares).sqrt();
        Estimate { value: all, se }
    };
    let links = [0, 1, 2].map(|link| {
        let configured = markers.links()[link];
        let position = |(i, marker): (usize, &LinkMarker)| {
            let whole = file.labels[marker.column].as_str();
            let name = marker_name(whole);
            let is_only =
                file.labels.iter().filter(|other| marker_name(other) == name).count() == 1;
            MarkerPosition {
                label: if is_only { name } else { whole }.to_owned(),
                position_mm: [0, 1, 2]
                    .map(|axis| measured(&|part| part.positions_mm[link][i][axis])),
                configured_mm: configured.get(whole).or(configured.get(name)).copied(),
            }
        };
        bodies[link].markers.iter().enumerate().map(position).collect()
    });
    let in_a_group = |column: &usize| groups.iter().flatten().any(|other| other == column);
    let left_out: Vec<usize> = match is_grouped {
        true => (0..file.labels.len()).filter(|column| !in_a_group(column)).collect(),
        false => Vec::new(),
    };
    let direction = |side: usize| {
        let away =
            |part: &LayoutEstimate| wrap(part.direction_rad[side] - whole.direction_rad[side]);
        (COMMON_ERROR * measured(&away).se).hypot(ARC_ERROR * whole.bent_rad).to_degrees()
    };
    Ok(Calibration {
        trial: String::new(),
        links,
        is_grouped,
        left_out: labels(&left_out),
        h_mm: measured(&|part| part.h_mm),
        h_configured_mm: 1e3 * robot.h_m,
        l_mm: [0, 1].map(|side| measured(&|part| part.l_mm[side])),
        l_configured_mm: 1e3 * robot.l_m,
        joint_residual_mm: whole.joint_residual_mm,
        direction_se_deg: [0, 1].map(direction),
        frames: rows,
    })
}

fn check_turn(side: usize, middle: &Body, outer: &Body) -> Result<(), Problem> {
    let mut angles: Vec<f64> = outer.turns_to(middle).map(|(_, turn)| turn).collect();
    if angles.len() < LEAST_ROWS {
        let (found, needed) = (angles.len(), LEAST_ROWS);
        return Err(Problem::LinksApart { link: side + 1, found, needed });
    }
    let first = angles[0];
    angles.iter_mut().for_each(|angle| *angle = wrap(*angle - first));
    let [low, high] = quantiles_low(angles, [0.05, 0.95]);
    let found_deg = (high - low).to_degrees();
    if found_deg < LEAST_TURN_DEG {
        let needed_deg = LEAST_TURN_DEG;
        return Err(Problem::LittleTurn { joint: side + 1, found_deg, needed_deg });
    }
    Ok(())
}
