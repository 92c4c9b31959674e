//! The links' marker layouts from a trial of which only the labels are known.
//!
//! What a trial in which both joints move shows:
//!
//! - which markers move rigidly together (`links`) and how they lie to each other (`shape`);
//! - the joints, which are points at rest in both their links (`estimate`). Those of the middle
//!   link give its origin, half way between them, its direction and h;
//! - of a side link its joint only. In which direction its axle is from there is where its wheel
//!   rolls to (`rolling`), but for what it skids to one side on average: as much as balances the
//!   middle wheel, of which it is seen. How far away it is does not show well in a wheel that skids,
//!   so l is taken from the robot and what the wheel gives is only shown.
//!
//! The heights are means. Standard errors are those of a jackknife over parts of whole cycles: what
//! joints do in a part of a cycle only is no mean. What a wrong ratio of the configured skid
//! coefficients would do to the balance is added.

mod estimate;
mod links;
mod rolling;
mod shape;
#[cfg(test)]
mod tests;

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use trilink_mocap::Recording;
use trilink_robot::{Gait, Robot};
use trilink_statistics::{Estimate, quantiles_low, wrap};
use trilink_tables::config::{Config, ConfigError, Markers, nearest};
use trilink_tables::trial::TrialList;

use super::error::{Problem, TrialFailure};
use super::input::{IngestInput, IngestSettings};
use super::markers::layout::{LinkMarker, locate, marker_name};
use super::phase::CommandedGait;
use estimate::LayoutEstimate;
pub use estimate::between;
pub use links::{in_order, rigid_groups};
pub use shape::Body;

/// Parts of the trial whose differences give the standard errors, at most and at least.
const PARTS: usize = 10;
const LEAST_PARTS: usize = 5;
/// How far a joint must turn, from its 5th to its 95th percentile, degrees.
const LEAST_TURN_DEG: f64 = 20.0;
/// How far the middle link may be aslant of the others on average, half the difference of the joints'
/// mean angles, degrees: half of that the side wheels skid.
const MOST_BENT_DEG: f64 = 3.0;
/// Relative error of that half: where the configured skid coefficients say 1, the paper's fits have
/// ratios of the middle one to both others of 0.4 to 1.55.
const RATIO_ERROR: f64 = 0.4;
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
    /// Standard errors of the side links' directions, degrees.
    pub direction_se_deg: [f64; 2],
    /// By how much their wheels skid to one side, by the configured skid coefficients, degrees; the
    /// directions are without it.
    pub skid_deg: f64,
    /// How far the links are bent on average, half the difference of the joints' mean angles, degrees.
    pub bent_deg: f64,
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
    let file = trilink_mocap::read_markers(&path, vicon.unit).map_err(TrialFailure::from)?;
    let file = file.without(&vicon.ignore);
    let calibration = settings
        .frame_rate(&file)
        .and_then(|rate_hz| of_file(&file, markers, &robot, gait.as_ref(), rate_hz))
        .and_then(Calibration::about_straight_links)
        .map_err(|problem| problem.of(&path))?;
    Ok(Calibration { trial: trial.id.clone(), ..calibration })
}

/// Equal parts of a trial, of whole cycles if it has a gait and enough of them.
struct Parts {
    count: usize,
    frames: f64,
}

impl Parts {
    fn of(file: &Recording, cycle_frames: Option<f64>) -> Self {
        let all = file.frames.last().map_or(0, |last| last - file.frames[0] + 1) as f64;
        let cycles = cycle_frames.map_or(0, |frames| (all / frames) as usize);
        match cycle_frames.filter(|_| cycles >= LEAST_PARTS) {
            Some(frames) => {
                let cycles_a_part = cycles.div_ceil(PARTS);
                Self { count: cycles / cycles_a_part, frames: frames * cycles_a_part as f64 }
            }
            None => Self { count: PARTS, frames: all / PARTS as f64 },
        }
    }

    /// `None` after the last whole part.
    fn of_row(&self, file: &Recording, row: usize) -> Option<usize> {
        let part = ((file.frames[row] - file.frames[0]) as f64 / self.frames) as usize;
        (part < self.count).then_some(part)
    }
}

impl Calibration {
    /// Refuses a gait about bent links.
    fn about_straight_links(self) -> Result<Self, Problem> {
        let (found_deg, needed_deg) = (self.bent_deg, MOST_BENT_DEG);
        match found_deg > needed_deg {
            true => Err(Problem::BentGait { found_deg, needed_deg }),
            false => Ok(self),
        }
    }
}

/// [`calibrate`] of markers at hand, whatever the gait is about; without the trial's id.
///
/// # Errors
/// The markers do not form three rigid groups, or a joint hardly turns.
pub fn of_file(
    file: &Recording,
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
    let parts = Parts::of(file, gait.map(|(_, omega_rad_s)| TAU / omega_rad_s * rate_hz));
    let estimate = |left_out: usize| {
        let is_used = |row: usize| parts.of_row(file, row).is_some_and(|part| part != left_out);
        LayoutEstimate::of(file, &bodies, robot, rate_hz, &is_used)
    };
    let whole = estimate(parts.count).ok_or(Problem::NoLayout)?;
    let partial: Vec<LayoutEstimate> =
        (0..parts.count).map(estimate).collect::<Option<_>>().ok_or(Problem::NoLayout)?;
    let commanded_rad = gait.map_or(0.0, |(gait, _)| {
        let [first, second] = gait.joints.map(|joint| joint.map_or(0.0, |joint| joint.offset_rad));
        0.5 * (first - second)
    });
    let bent_rad = whole.aslant_rad + whole.skid_rad;
    let bent_deg = commanded_rad.abs().max(bent_rad.abs()).to_degrees();
    let measured = |value: &dyn Fn(&LayoutEstimate) -> f64| {
        let all = value(&whole);
        let squares: f64 = partial.iter().map(|part| (value(part) - all).powi(2)).sum();
        let count = parts.count as f64;
        let se = ((count - 1.0) / count * squares).sqrt();
        Estimate { value: all, se }
    };
    let turned_rad = RATIO_ERROR * whole.skid_rad.abs();
    let links = [0, 1, 2].map(|link| {
        let configured = markers.links()[link];
        let position = |(i, marker): (usize, &LinkMarker)| {
            let label = file.labels[marker.column].as_str();
            let name = marker_name(label);
            let is_only =
                file.labels.iter().filter(|other| marker_name(other) == name).count() == 1;
            MarkerPosition {
                label: if is_only { name } else { label }.to_owned(),
                position_mm: [0, 1, 2].map(|axis| {
                    let found = measured(&|part| part.positions_mm[link][i][axis]);
                    let [x, y, _] = whole.positions_mm[link][i];
                    let joint_mm = [0.0, -1e3 * robot.l_m, 1e3 * robot.l_m][link];
                    let across_mm = if link == 0 { [0.0; 3] } else { [y, x - joint_mm, 0.0] };
                    Estimate { se: found.se.hypot(turned_rad * across_mm[axis]), ..found }
                }),
                configured_mm: configured.get(label).or(configured.get(name)).copied(),
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
        measured(&away).se.hypot(turned_rad).to_degrees()
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
        skid_deg: whole.skid_rad.to_degrees(),
        bent_deg,
        frames: (0..file.frames.len()).filter(|row| parts.of_row(file, *row).is_some()).count(),
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
