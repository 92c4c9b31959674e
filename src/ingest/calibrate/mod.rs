//! The links' marker layouts from a trial of which only the labels are known.
//!
//! What a trial in which both joints move shows:
//!
//! - which markers move rigidly together (`cluster`) and how they lie to each other
//!   (`shape`);
//! - the joints, which are points at rest in both their links (`joint`). Those of the middle
//!   link give its origin, half way between them, its direction and h;
//! - of a side link its joint only. In which direction its axle is from there is where its wheel
//!   rolls to (`rolling`): as good as the wheel does not skid to one side on average. How far
//!   away it is does not show well in a wheel that skids, so l is taken from the robot and
//!   what the wheel gives is only shown.
//!
//! The heights are means. Standard errors are those of a jackknife over parts of the trial, so
//! they account for noise and for what changes from part to part, not for what the wheels do
//! alike in every cycle.

mod cluster;
mod error;
mod estimate;
mod front;
mod joint;
mod rolling;
mod shape;
#[cfg(test)]
mod tests;

use std::path::Path;

pub use error::{CalibrationError, LayoutProblem};

use super::error::TrialFailure;
use super::input::{IngestInput, IngestSettings};
use super::markers::layout::{LinkMarker, locate, marker_name};
use crate::config::{Config, Markers, nearest};
use crate::robot::{Gait, Robot};
use crate::stats::{Estimate, quantiles_low, wrap};
use crate::trial::TrialList;
use crate::vicon::{self, MarkerFile};
use estimate::LayoutEstimate;
use joint::Joint;
use shape::Body;

/// Parts of the trial whose differences give the standard errors.
const PARTS: usize = 10;
/// How far a joint must turn, from its 5th to its 95th percentile, degrees.
const LEAST_TURN_DEG: f64 = 20.0;
/// Frames in which two links must be seen.
const LEAST_ROWS: usize = 100;

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
    /// Standard errors of the side links' directions, degrees; what wheels add that skid to one
    /// side on average is not in them.
    pub direction_se_deg: [f64; 2],
    /// Whether the commanded joints swing about straight links: else the wheels skid to one side
    /// on average, and the side links' directions may be degrees off.
    pub is_symmetric: bool,
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
    let rate_hz = settings.frame_rate(&file).map_err(|problem| problem.of(&path))?;
    let calibration = of_file(&file, markers, &robot, gait.as_ref(), rate_hz)
        .map_err(|problem| CalibrationError::Layout { path, problem })?;
    Ok(Calibration {
        trial: trial.id.clone(),
        is_symmetric: gait.as_ref().is_some_and(|(gait, _)| {
            gait.joints.iter().flatten().all(|command| command.offset_rad == 0.0)
        }),
        ..calibration
    })
}

/// The links' markers by column.
struct Groups {
    columns: [Vec<usize>; 3],
    is_grouped: bool,
    left_out: Vec<String>,
}

/// [`calibrate`] of markers at hand.
fn of_file(
    file: &MarkerFile,
    markers: &Markers,
    robot: &Robot,
    gait: Option<&(Gait, f64)>,
    rate_hz: f64,
) -> Result<Calibration, LayoutProblem> {
    let groups = groups(file, markers)?;
    let shaped = |columns: &[usize]| {
        Body::of(file, columns).ok_or_else(|| LayoutProblem::Unseen {
            labels: columns.iter().map(|&i| file.labels[i].clone()).collect(),
        })
    };
    let [a, b, c] = &groups.columns;
    let bodies = [shaped(a)?, shaped(b)?, shaped(c)?];
    let bodies = match groups.is_grouped {
        true => in_order(file, bodies, gait, rate_hz)?,
        false => bodies,
    };
    for side in 0..2 {
        check_turn(side, &bodies[0], &bodies[1 + side])?;
    }
    let rows = file.frames.len();
    let estimate = |left_out: usize| {
        let part = |row: usize| row * PARTS / rows;
        LayoutEstimate::of(file, &bodies, robot, rate_hz, &|row| part(row) != left_out)
    };
    let whole = estimate(PARTS).ok_or(LayoutProblem::Indeterminate)?;
    let partial: Vec<LayoutEstimate> =
        (0..PARTS).map(estimate).collect::<Option<_>>().ok_or(LayoutProblem::Indeterminate)?;
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
    let direction = |side: usize| {
        let away =
            |part: &LayoutEstimate| wrap(part.direction_rad[side] - whole.direction_rad[side]);
        measured(&away).se.to_degrees()
    };
    Ok(Calibration {
        trial: String::new(),
        links,
        is_grouped: groups.is_grouped,
        left_out: groups.left_out,
        h_mm: measured(&|part| part.h_mm),
        h_configured_mm: 1e3 * robot.h_m,
        l_mm: [0, 1].map(|side| measured(&|part| part.l_mm[side])),
        l_configured_mm: 1e3 * robot.l_m,
        joint_residual_mm: [0, 1].map(|side| whole.joints[side].residual_mm),
        direction_se_deg: [0, 1].map(direction),
        is_symmetric: false,
        frames: rows,
    })
}

/// The configured groups if the file has all their labels, else those that move rigidly.
fn groups(file: &MarkerFile, markers: &Markers) -> Result<Groups, LayoutProblem> {
    if let Ok(layout) = locate(markers, file) {
        let columns = layout.map(|markers| markers.iter().map(|marker| marker.column).collect());
        return Ok(Groups { columns, is_grouped: false, left_out: Vec::new() });
    }
    let labels = |columns: &[usize]| columns.iter().map(|&i| file.labels[i].clone()).collect();
    let found = cluster::rigid_groups(file);
    let all = 0..file.labels.len();
    let in_none: Vec<usize> =
        all.filter(|i| !found.iter().any(|group| group.contains(i))).collect();
    let columns = found.try_into().map_err(|found: Vec<Vec<usize>>| LayoutProblem::Groups {
        found: found.iter().map(|group| labels(group)).collect(),
    })?;
    Ok(Groups { columns, is_grouped: true, left_out: labels(&in_none) })
}

/// The bodies with the middle link first, which the two pairs with a joint share, and then the
/// one in front, as far as there is a commanded gait.
fn in_order(
    file: &MarkerFile,
    bodies: [Body; 3],
    gait: Option<&(Gait, f64)>,
    rate_hz: f64,
) -> Result<[Body; 3], LayoutProblem> {
    let misfit = |a: usize, b: usize| {
        let joint = Joint::between(&bodies[a], &bodies[b], &|_| true);
        joint.map(|joint| joint.residual_mm).ok_or(LayoutProblem::Indeterminate)
    };
    let apart = [(misfit(1, 2)?, 0), (misfit(0, 2)?, 1), (misfit(0, 1)?, 2)];
    let middle = apart.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |(_, i)| i);
    let mut bodies = bodies;
    bodies.swap(0, middle);
    if let Some((gait, omega_rad_s)) = gait
        && front::is_last_in_front(&bodies, &file.frames, gait, omega_rad_s / rate_hz)
    {
        bodies.swap(1, 2);
    }
    Ok(bodies)
}

fn check_turn(side: usize, middle: &Body, outer: &Body) -> Result<(), LayoutProblem> {
    let mut angles: Vec<f64> = middle
        .fits
        .iter()
        .zip(&outer.fits)
        .filter_map(|(a, b)| Some(b.pose?.theta_rad - a.pose?.theta_rad))
        .collect();
    if angles.len() < LEAST_ROWS {
        let (found, needed) = (angles.len(), LEAST_ROWS);
        return Err(LayoutProblem::FewFrames { side, found, needed });
    }
    let first = angles[0];
    angles.iter_mut().for_each(|angle| *angle = wrap(*angle - first));
    let [low, high] = quantiles_low(angles, [0.05, 0.95]);
    let found_deg = (high - low).to_degrees();
    if found_deg < LEAST_TURN_DEG {
        let needed_deg = LEAST_TURN_DEG;
        return Err(LayoutProblem::LittleTurn { side, found_deg, needed_deg });
    }
    Ok(())
}
