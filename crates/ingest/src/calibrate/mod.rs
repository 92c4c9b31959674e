//! Calibrates the marker layouts of the links from a trial in which only the marker labels are known.
//!
//! A trial in which both joints move determines:
//!
//! - which markers move rigidly together (`links`) and their relative positions (`shape`);
//! - the joints, each of which is at rest in the frames of both its links (`estimate`). The two joints of the middle
//!   link determine h, the direction of the link and its origin, which is halfway between the joints;
//! - the joint of each side link, but not its axle. The direction from joint to axle is the direction in which the
//!   wheel rolls (`rolling`), corrected for the mean skid that balances the measured skid of the middle wheel. The
//!   motion of a skidding wheel determines the distance of its axle from the joint only poorly, so l is taken from the
//!   robot's configuration, and the measured distance is only reported.
//!
//! Marker heights are means over the trial. Standard errors come from a jackknife over segments of whole cycles,
//! because the mean motion over a fraction of a cycle is not zero. The uncertainty from a wrong ratio of the configured
//! skid coefficients, which enters through the force balance, is added.

mod chain;
mod estimate;
mod links;
mod rolling;
mod shape;
#[cfg(test)]
mod tests;

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use trilink_base::body;
use trilink_mocap::Recording;
use trilink_robot::{Gait, Quantity, Robot};
use trilink_statistics::{Estimate, quantiles_low, wrap};
use trilink_tables::config::{Config, ConfigError, MarkerLayout, nearest};
use trilink_tables::trial::TrialList;

use super::error::{Problem, TrialFailure};
use super::input::{IngestInput, IngestSettings};
use super::markers::layout::{LinkMarker, locate, marker_name};
use super::phase::CommandedGait;
pub use chain::{
    ChainCalibration, Direction, LinkCalibration, LinkPlaces, MAX_JOINT_MISFIT_MM, calibrate_chain,
    wheel_distances_mm,
};
use estimate::LayoutEstimate;
pub use estimate::locate_joint;
pub use links::{JointMisfits, rigid_groups};
pub use shape::Body;

/// Maximum number of trial segments for the jackknife standard errors.
const MAX_PARTS: usize = 10;
/// Minimum number of trial segments for the jackknife standard errors.
const MIN_PARTS: usize = 5;
/// Minimum range of a joint angle, from its 5th to its 95th percentile, degrees.
const MIN_TURN_DEG: f64 = 20.0;
/// Maximum mean bend of the three-link chain (half the difference between the mean joint angles), degrees. If the
/// middle wheel's skid coefficient is the sum of the side wheels', the side wheels skid by half the bend.
const MAX_BENT_DEG: f64 = 3.0;
/// Relative uncertainty of the skid angle of the side wheels that balances the skid of the middle wheel. The angle is
/// proportional to the ratio of the middle wheel's skid coefficient to the sum of those of the side wheels; where the
/// configured ratio is 1, the ratios in the paper's fits are 0.4 to 1.55.
const RATIO_ERROR: f64 = 0.4;
/// Minimum number of frames in which two links are visible together.
const MIN_ROWS: usize = 100;

/// Reason why a trial does not determine the marker layouts.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    #[error(transparent)]
    Trials(#[from] ConfigError),
    #[error("{}: trials.toml has no trial `{id}`{hint}", folder.display())]
    NoTrial { folder: PathBuf, id: String, hint: String },
    #[error(transparent)]
    Trial(#[from] TrialFailure),
}

/// Measured position of a marker in its link frame, mm.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkerPosition {
    /// Label as in the file; the subject is omitted if no other subject has a marker of that name.
    pub label: String,
    /// Measured coordinates x, y, z with standard errors, mm.
    pub position_mm: [Estimate; 3],
    /// Configured position, mm; `None` if this label is not configured on this link.
    pub configured_mm: Option<[f64; 3]>,
}

/// Layout and dimensions of the robot as measured in a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    pub trial: String,
    /// Markers of links 0, 1, 2 in the order of the file.
    pub links: [Vec<MarkerPosition>; 3],
    /// Whether the markers were assigned to links by their motion because the file lacks the configured markers. If so,
    /// the commanded gait determines which link is the front one.
    pub is_grouped: bool,
    /// Labels of markers that move with none of the links.
    pub left_out: Vec<String>,
    /// Measured half distance between the two joints, mm.
    pub h_mm: Estimate,
    /// Configured half distance between the two joints, mm.
    pub h_configured_mm: f64,
    /// Measured distances from the joint at which the wheels of links 1 and 2 skid least, mm; reported but not used.
    pub l_mm: [Estimate; 2],
    /// Configured distances from joint to axle of links 1 and 2, which the calibration uses, mm.
    pub l_configured_mm: [f64; 2],
    /// RMS distance between each joint's positions according to its two links, mm.
    pub joint_residual_mm: [f64; 2],
    /// Standard errors of the side links' directions, degrees.
    pub direction_se_deg: [f64; 2],
    /// Mean skid angle of the side wheels that follows from the configured skid coefficients, degrees. It has been
    /// removed from the side links' directions.
    pub skid_deg: f64,
    /// Mean bend of the three-link chain (half the difference between the mean joint angles), degrees.
    pub bent_deg: f64,
    /// Number of frames used for the calibration.
    pub frames: usize,
}

/// Calibration of a robot of three links or of a chain.
#[derive(Debug, Clone, PartialEq)]
pub enum Calibrated {
    ThreeLinks(Calibration),
    Chain(ChainCalibration),
}

/// Estimates the marker layouts from one trial of a folder.
///
/// # Errors
/// Returns an error if the folder has no such trial (the message suggests the most similar id), if the trial's entry or
/// file cannot be used, if the markers do not form the rigid groups of the links, or if a joint turns too little.
pub fn calibrate(config: &Config, folder: &Path, id: &str) -> Result<Calibrated, CalibrationError> {
    let list = TrialList::load(folder)?;
    let trial = list.trial.iter().find(|trial| trial.id == id).ok_or_else(|| {
        let ids = list.trial.iter().map(|trial| trial.id.as_str());
        let hint = nearest(id, ids).map_or(String::new(), |id| format!("; did you mean `{id}`?"));
        CalibrationError::NoTrial { folder: folder.to_owned(), id: id.to_owned(), hint }
    })?;
    let input = IngestInput::new(config, trial).map_err(TrialFailure::from)?;
    let settings @ IngestSettings { vicon, markers, .. } = &input.settings;
    let path = folder.join(&trial.file);
    let file = trilink_mocap::read_markers(&path, vicon.unit).map_err(TrialFailure::from)?;
    let file = input.with_layout_labels(file);
    let calibrated = settings.frame_rate(&file).and_then(|rate_hz| {
        match (input.three_links(trial), input.subject(trial)) {
            (Some((robot, gait)), _) => {
                let found = calibrate_recording(&file, markers, &robot, gait.as_ref(), rate_hz)?;
                let found = found.require_straight_links()?;
                Ok(Calibrated::ThreeLinks(Calibration { trial: trial.id.clone(), ..found }))
            }
            (None, subject) => {
                let found = chain::calibrate(&file, markers, subject, rate_hz)?;
                let robot = trial.robot_name(config).unwrap_or_default().to_owned();
                let trial = trial.id.clone();
                Ok(Calibrated::Chain(ChainCalibration { trial, robot, ..found }))
            }
        }
    });
    Ok(calibrated.map_err(|problem| problem.in_file(&path))?)
}

/// Returns the measured layout of a link as it is written in the configuration: label and x, y, z of each marker, mm, or
/// the name and the pose of each rigid body (x, y, z, mm; roll, pitch, yaw, degrees).
pub fn layout_entries(link: &[MarkerPosition]) -> Vec<(String, Vec<f64>)> {
    let value = |marker: &MarkerPosition| marker.position_mm.map(|estimate| estimate.value);
    let mut entries: Vec<(String, Vec<f64>)> = Vec::new();
    for marker in link {
        let Some((name, _)) = body::of_point(&marker.label) else {
            entries.push((marker.label.clone(), value(marker).to_vec()));
            continue;
        };
        let point = |i: usize| link.iter().find(|one| one.label == body::point_label(name, i));
        let points: Option<Vec<_>> = (0..body::POINTS).map(|i| point(i).map(value)).collect();
        let points: Option<[[f64; 3]; body::POINTS]> = points.and_then(|all| all.try_into().ok());
        if let Some(points) = points.filter(|_| entries.iter().all(|(known, _)| known != name)) {
            let (origin_mm, axes) = body::pose(&points);
            let angles_deg = body::roll_pitch_yaw(&axes).map(f64::to_degrees);
            entries.push((name.to_owned(), [origin_mm, angles_deg].concat()));
        }
    }
    entries
}

/// Division of a trial into segments of equal length, each of which consists of whole cycles if the trial has a gait
/// and enough cycles.
struct Parts {
    count: usize,
    /// Length of a segment, frames.
    frames: f64,
}

impl Parts {
    fn new(file: &Recording, cycle_frames: Option<f64>) -> Self {
        let all = file.frames.last().map_or(0, |last| last - file.frames[0] + 1) as f64;
        let cycles = cycle_frames.map_or(0, |frames| (all / frames) as usize);
        match cycle_frames.filter(|_| cycles >= MIN_PARTS) {
            Some(frames) => {
                let cycles_a_part = cycles.div_ceil(MAX_PARTS);
                Self { count: cycles / cycles_a_part, frames: frames * cycles_a_part as f64 }
            }
            None => Self { count: MAX_PARTS, frames: all / MAX_PARTS as f64 },
        }
    }

    /// Returns the index of the segment to which a row belongs; `None` after the last whole segment.
    fn part_of(&self, file: &Recording, row: usize) -> Option<usize> {
        let part = ((file.frames[row] - file.frames[0]) as f64 / self.frames) as usize;
        (part < self.count).then_some(part)
    }
}

impl Calibration {
    /// Returns the calibration unchanged, or an error if the three links are on average not aligned with each other.
    fn require_straight_links(self) -> Result<Self, Problem> {
        if self.bent_deg > MAX_BENT_DEG {
            return Err(Problem::BentGait { found_deg: self.bent_deg, needed_deg: MAX_BENT_DEG });
        }
        Ok(self)
    }
}

/// Estimates the marker layouts from recorded markers as [`calibrate`] does, but also accepts a trial in which the
/// three links are on average not aligned with each other. The trial's id in the result is empty.
///
/// # Errors
/// Returns an error if the markers do not form three rigid groups or if a joint turns too little.
pub fn calibrate_recording(
    file: &Recording,
    markers: &MarkerLayout,
    robot: &Robot,
    gait: Option<&(Gait, f64)>,
    rate_hz: f64,
) -> Result<Calibration, Problem> {
    let configured = locate(markers, file).ok();
    let is_grouped = configured.is_none();
    let groups = match configured {
        Some(layout) => {
            let of_link =
                |link: &Vec<LinkMarker>| link.iter().map(|marker| marker.column).collect();
            layout.iter().map(of_link).collect()
        }
        None => links::rigid_groups(file),
    };
    let groups: [Vec<usize>; 3] = groups.try_into().map_err(|found: Vec<Vec<usize>>| {
        let list: Vec<String> = found.iter().map(|group| labels(file, group).join(" ")).collect();
        Problem::RigidGroups { found: found.len(), list: list.join("; "), needed: 3 }
    })?;
    let [a, b, c] = &groups;
    let mut bodies = [fit_body(file, a)?, fit_body(file, b)?, fit_body(file, c)?];
    if is_grouped {
        let command = gait.map(|&(ref gait, omega_rad_s)| CommandedGait {
            joints: &gait.joints,
            omega_rad_s,
            rate_hz,
            skip_cycles: 0,
        });
        bodies = links::order_links(file, bodies, command)?;
    }
    for side in 0..2 {
        check_turn(side, &bodies[0], &bodies[1 + side], MIN_TURN_DEG)?;
    }
    let parts = Parts::new(file, gait.map(|(_, omega_rad_s)| TAU / omega_rad_s * rate_hz));
    let estimate = |left_out: usize| {
        let is_used = |row: usize| parts.part_of(file, row).is_some_and(|part| part != left_out);
        LayoutEstimate::new(file, &bodies, robot, rate_hz, &is_used)
    };
    let whole = estimate(parts.count).ok_or(Problem::NoLayout)?;
    let partial: Vec<LayoutEstimate> =
        (0..parts.count).map(estimate).collect::<Option<_>>().ok_or(Problem::NoLayout)?;
    let commanded_rad = gait.map_or(0.0, |(gait, _)| {
        let [first, second] = gait.joints.map(|joint| joint.map_or(0.0, |joint| joint.offset_rad));
        0.5 * (first - second)
    });
    let bent_rad = whole.oblique_rad + whole.skid_rad;
    let bent_deg = commanded_rad.abs().max(bent_rad.abs()).to_degrees();
    let jackknife = Jackknife { whole, partial };
    let turned_rad = RATIO_ERROR * jackknife.whole.skid_rad.abs();
    let links = [0, 1, 2].map(|link| {
        let configured = markers.links()[link];
        let markers = bodies[link].markers.iter().enumerate();
        markers
            .map(|(i, marker)| {
                let label = file.labels[marker.column].as_str();
                let name = marker_name(label);
                MarkerPosition {
                    label: short_label(file, marker.column).to_owned(),
                    position_mm: jackknife.position_mm(link, i, robot, turned_rad),
                    configured_mm: configured.get(label).or(configured.get(name)).copied(),
                }
            })
            .collect()
    });
    let mut left_out: Vec<usize> = Vec::new();
    if is_grouped {
        left_out.extend(
            (0..file.labels.len()).filter(|column| !groups.iter().flatten().any(|c| c == column)),
        );
    }
    let direction_se_deg = [0, 1].map(|side| {
        let direction_rad = jackknife.whole.direction_rad[side];
        let error = jackknife.estimate(|part| wrap(part.direction_rad[side] - direction_rad));
        error.se.hypot(turned_rad).to_degrees()
    });
    Ok(Calibration {
        trial: String::new(),
        links,
        is_grouped,
        left_out: labels(file, &left_out),
        h_mm: jackknife.estimate(|part| part.h_mm),
        h_configured_mm: 1e3 * Quantity::H.of_both().value_in(robot),
        l_mm: [0, 1].map(|side| jackknife.estimate(|part| part.l_mm[side])),
        l_configured_mm: robot.l_m.map(|l_m| 1e3 * l_m),
        joint_residual_mm: jackknife.whole.joint_residual_mm,
        direction_se_deg,
        skid_deg: jackknife.whole.skid_rad.to_degrees(),
        bent_deg,
        frames: (0..file.frames.len()).filter(|row| parts.part_of(file, *row).is_some()).count(),
    })
}

/// Layout estimates from the whole trial and from the trial without each of its segments.
struct Jackknife<E> {
    whole: E,
    partial: Vec<E>,
}

impl<E> Jackknife<E> {
    /// Returns a quantity of the layout with its jackknife standard error.
    fn estimate(&self, value: impl Fn(&E) -> f64) -> Estimate {
        let all = value(&self.whole);
        let squares: f64 = self.partial.iter().map(|part| (value(part) - all).powi(2)).sum();
        let count = self.partial.len() as f64;
        Estimate { value: all, se: ((count - 1.0) / count * squares).sqrt() }
    }
}

impl Jackknife<LayoutEstimate> {
    /// Returns the position of a marker, mm, with standard errors. For side links, these include the effect of
    /// `turned_rad`, the uncertainty of the link's direction that the jackknife does not show.
    fn position_mm(
        &self,
        link: usize,
        marker: usize,
        robot: &Robot,
        turned_rad: f64,
    ) -> [Estimate; 3] {
        let [x, y, _] = self.whole.positions_mm[link][marker];
        let joint_mm = [0.0, -1e3 * robot.l_m[0], 1e3 * robot.l_m[1]][link];
        let across_mm = if link == 0 { [0.0; 3] } else { [y, x - joint_mm, 0.0] };
        [0, 1, 2].map(|axis| {
            let found = self.estimate(|part| part.positions_mm[link][marker][axis]);
            Estimate { se: found.se.hypot(turned_rad * across_mm[axis]), ..found }
        })
    }
}

/// Returns the label of a marker, without the subject if no other subject has a marker of that name.
fn short_label(file: &Recording, column: usize) -> &str {
    let label = file.labels[column].as_str();
    let name = marker_name(label);
    let same_name = file.labels.iter().filter(|other| marker_name(other) == name);
    if same_name.count() == 1 { name } else { label }
}

fn labels(file: &Recording, columns: &[usize]) -> Vec<String> {
    columns.iter().map(|&column| file.labels[column].clone()).collect()
}

/// Fits the shape of a group of markers, given by their column indices.
fn fit_body(file: &Recording, columns: &[usize]) -> Result<Body, Problem> {
    Body::fit(file, columns)
        .ok_or_else(|| Problem::MarkersApart { labels: labels(file, columns).join("`, `") })
}

/// Checks that a joint turns far enough to be located.
fn check_turn(side: usize, middle: &Body, outer: &Body, needed_deg: f64) -> Result<(), Problem> {
    let mut angles: Vec<f64> = outer.turns_to(middle).map(|(_, turn)| turn).collect();
    if angles.len() < MIN_ROWS {
        let found = angles.len();
        let needed = MIN_ROWS;
        return Err(Problem::LinksApart { link: side + 1, found, needed });
    }
    let first = angles[0];
    angles.iter_mut().for_each(|angle| *angle = wrap(*angle - first));
    let [low, high] = quantiles_low(angles, [0.05, 0.95]);
    let found_deg = (high - low).to_degrees();
    if found_deg < needed_deg {
        return Err(Problem::LittleTurn { joint: side + 1, found_deg, needed_deg });
    }
    Ok(())
}
