//! Calibrates the marker layouts of the links from a trial in which only the marker labels are known.
//!
//! A trial in which all joints move determines:
//!
//! - which markers move rigidly together, and the order of these links (`links`), and the relative positions of the
//!   markers (`shape`);
//! - the joints, each of which is at rest in the frames of both its links (`links`). A link between two joints points from
//!   one to the other;
//! - the only joint of the first and last link, but not their axles. The direction from joint to axle is the direction in
//!   which the wheel rolls (`rolling`), corrected for the mean skid that balances the measured skid of the wheels between
//!   them (`estimate`). The motion of a skidding wheel determines the distance of its axle from the joint only poorly, so
//!   this is taken from the robot's configuration, and the measured distance is only reported. A link without such a wheel
//!   is taken to have, on average, the mean angle that is configured for its joint.
//!
//! Marker heights are means over the trial. Standard errors come from a jackknife over segments of whole cycles,
//! because the mean motion over a fraction of a cycle is not zero. The uncertainty from a wrong ratio of the configured
//! skid coefficients, which enters through the force balance, is added.

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
use trilink_robot::{AnyGait, AnyRobot, Chain, Link, Wheel};
use trilink_statistics::{Estimate, quantiles_low, wrap};
use trilink_tables::config::{Config, ConfigError, MarkerLayout, nearest};
use trilink_tables::trial::TrialList;

use super::Subject;
use super::error::{Problem, TrialFailure};
use super::geometry::Geometry;
use super::input::{IngestInput, IngestSettings};
use super::markers::layout::{locate, marker_name};
use estimate::LayoutEstimate;
pub use links::{JointMisfits, MAX_JOINT_MISFIT_MM, locate_joint, rigid_groups};
pub use shape::Body;

/// Maximum number of trial segments for the jackknife standard errors.
const MAX_PARTS: usize = 10;
/// Minimum number of trial segments for the jackknife standard errors.
const MIN_PARTS: usize = 5;
/// Minimum range of a joint angle, from its 5th to its 95th percentile, degrees; joints on springs may turn little.
const MIN_TURN_DEG: f64 = 5.0;
/// Maximum mean bend of a link between two joints (half the difference between their mean angles), degrees. If the skid
/// coefficient of the middle one of three wheels is the sum of the others, these skid by half the bend.
const MAX_BENT_DEG: f64 = 3.0;
/// Relative uncertainty of the skid angle of the first and last wheel that balances the skid of the others. Of three
/// wheels, the angle is proportional to the ratio of the middle wheel's skid coefficient to the sum of the others; where
/// the configured ratio is 1, the ratios in the paper's fits are 0.4 to 1.55.
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

/// Places on a link, mm from its origin. Of a link between two joints, the proportion of the two distances is used.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LinkPlaces {
    /// Distance forwards to the joint with the link ahead; 0 for the first link.
    pub front_joint_mm: f64,
    /// Distance backwards to the joint with the link behind; 0 for the last link.
    pub rear_joint_mm: f64,
    /// Place of the wheel, positive ahead; `None` if the link has no wheel that rolls along it.
    pub wheel_mm: Option<f64>,
    /// Skid coefficient of this wheel in proportion to those of the others; 0 if it is not known. If it is not for one of
    /// the wheels, the mean skid of the first and last link is not corrected.
    pub skid_kg_s: f64,
    /// Mean heading relative to the only neighbour, rad, which is used for a link without such a wheel.
    pub turned_rad: f64,
}

/// Property of the motion from which the direction of a link follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// The link points from one joint to the other.
    Joints,
    /// The wheel skids least.
    Wheel,
    /// The mean angle of the joint is the configured one.
    MeanAngle,
}

/// Layout of the robot as measured in a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    pub trial: String,
    pub layout: MeasuredLayout,
    /// Names of the configuration's tables of markers, such as `markers.link1`, one for each link from front to rear.
    pub tables: Vec<String>,
    /// Configured places on the links.
    pub places: Vec<LinkPlaces>,
    /// Whether the configuration gives the places as h and l.
    pub is_three_links: bool,
    /// Whether the markers were assigned to links by their motion because the file lacks the configured markers.
    pub is_grouped: bool,
    /// Labels of markers that move with none of the links.
    pub left_out: Vec<String>,
}

/// Marker layouts and joints measured in a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredLayout {
    /// Layouts of the links from front to rear.
    pub links: Vec<LinkCalibration>,
    /// RMS distances between the positions of each joint according to its two links, mm.
    pub joint_residuals_mm: Vec<f64>,
    /// Mean angles of the joints, rad.
    pub mean_angles_rad: Vec<f64>,
    /// Number of frames used.
    pub frames: usize,
}

impl MeasuredLayout {
    /// Returns half the distance between the joints of the second link, mm: h of three links.
    pub fn h_mm(&self) -> Option<Estimate> {
        let [front, rear] = self.links[1].joints_mm;
        let (front, rear) = (front?, rear?);
        Some(Estimate::new(0.5 * (front.value + rear.value), 0.5 * (front.se + rear.se)))
    }
}

/// Marker layout and places of the joints of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkCalibration {
    pub markers: Vec<MarkerPosition>,
    /// Distances from the origin forwards to the joint ahead and backwards to the joint behind, mm, with standard
    /// errors; as given, without a standard error, on the first and last link, and `None` where there is no joint.
    pub joints_mm: [Option<Estimate>; 2],
    pub direction: Direction,
    /// Distance from its joint at which the wheel of the first or last link skids least, mm; reported but not used.
    /// `None` if the motion does not determine a plausible distance.
    pub least_skid_mm: Option<Estimate>,
    /// Mean skid angle of the wheel of the first or last link that follows from the skid coefficients, degrees. It has
    /// been removed from the direction of the link; 0 for other links.
    pub skid_deg: f64,
    /// Standard error of the direction of the link, degrees.
    pub direction_se_deg: f64,
}

/// Estimates the marker layouts from one trial of a folder.
///
/// # Errors
/// Returns an error if the folder has no such trial (the message suggests the most similar id), if the trial's entry or
/// file cannot be used, if the markers do not form the rigid groups of the links, or if a joint turns too little.
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
    let path = folder.join(&trial.file);
    let file = trilink_mocap::read_markers(&path, vicon.unit).map_err(TrialFailure::from)?;
    let file = input.with_layout_labels(file);
    let calibrated = settings
        .frame_rate(&file)
        .and_then(|rate_hz| calibrate_recording(&file, markers, input.subject(trial), rate_hz));
    let calibrated = calibrated.map(|found| Calibration { trial: trial.id.clone(), ..found });
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

/// Estimates the marker layouts from a recording; the trial's id in the result is empty.
///
/// # Errors
/// Returns an error if the markers do not form the rigid groups of the links, if a joint turns too little, if no motion
/// shows the direction of a link, if a link has no markers, or if the links are on average not aligned.
fn calibrate_recording(
    file: &Recording,
    markers: &MarkerLayout,
    Subject { robot, command, .. }: Subject,
    rate_hz: f64,
) -> Result<Calibration, Problem> {
    let is_three_links = matches!(robot, AnyRobot::ThreeLinks(_));
    let mut gait = AnyGait::NONE;
    if let Some(command) = &command {
        gait.joints[..command.joints.len()].copy_from_slice(&command.joints);
    }
    let chain = robot.to_chain(&gait);
    let places = configured_places(&chain)?;
    let order = Geometry::new(&chain).order;
    let located = locate(markers, file).ok();
    let is_grouped = located.is_none();
    let groups: Vec<Vec<usize>> = match located {
        Some(layout) => {
            let columns = |link: &usize| layout[*link].iter().map(|marker| marker.column).collect();
            order.iter().map(columns).collect()
        }
        None => links::found_groups(file, order.len(), command.as_ref(), rate_hz)?,
    };
    if let Some(link) = groups.iter().position(Vec::is_empty) {
        return Err(Problem::BareLink { name: chain.links[link].name.clone() });
    }
    let cycle_frames = command.map(|of| TAU / of.omega_rad_s * rate_hz);
    let mut layout = calibrate_links(file, &groups, &places, rate_hz, cycle_frames)?;
    let configured_rad: Vec<f64> =
        (0..chain.joints.len()).map(|joint| chain.mean_angle_rad(joint)).collect();
    let bends_rad = [&configured_rad, &layout.mean_angles_rad].map(|angles_rad| {
        let bends = angles_rad.windows(2).map(|pair| 0.5 * (pair[0] - pair[1]).abs());
        bends.fold(0.0, f64::max)
    });
    let found_deg = bends_rad[0].max(bends_rad[1]).to_degrees();
    let is_biased = layout.links.iter().any(|link| link.direction == Direction::Wheel);
    if is_biased && found_deg > MAX_BENT_DEG {
        return Err(Problem::BentGait { found_deg, needed_deg: MAX_BENT_DEG });
    }
    let configured = markers.links();
    for (link, number) in layout.links.iter_mut().zip(&order) {
        for marker in &mut link.markers {
            let name = marker_name(&marker.label);
            let of_link = configured[*number];
            marker.configured_mm = of_link.get(&marker.label).or(of_link.get(name)).copied();
        }
    }
    let all = 0..file.labels.len();
    let is_left_out = |column: &usize| !groups.iter().flatten().any(|other| other == column);
    let left_out: Vec<usize> = all.filter(|column| is_grouped && is_left_out(column)).collect();
    let left_out = labels(file, &left_out);
    let tables = order.iter().map(|number| markers.table_of(*number)).collect();
    let trial = String::new();
    Ok(Calibration { trial, layout, tables, places, is_three_links, is_grouped, left_out })
}

/// Returns the configured places on the links from front to rear.
///
/// # Errors
/// Returns an error if the motion does not show the direction of the first or last link.
fn configured_places(chain: &Chain) -> Result<Vec<LinkPlaces>, Problem> {
    let last = chain.links.len() - 1;
    let links = chain.links.iter().enumerate();
    let places = links.map(|(i, Link { name, front_joint_m, rear_joint_m, wheel, .. })| {
        let wheel_mm = match wheel {
            Some(Wheel { place_m, steer_rad: 0.0, .. }) => Some(1e3 * place_m),
            _ => None,
        };
        if wheel_mm.is_none() && last == 1 {
            return Err(Problem::NoDirection { name: name.clone() });
        }
        let turned_rad = match i {
            0 => -chain.mean_angle_rad(0),
            _ if i == last => chain.mean_angle_rad(last - 1),
            _ => 0.0,
        };
        Ok(LinkPlaces {
            front_joint_mm: if i == 0 { 0.0 } else { 1e3 * front_joint_m },
            rear_joint_mm: if i == last { 0.0 } else { 1e3 * rear_joint_m },
            wheel_mm,
            skid_kg_s: wheel.map_or(0.0, |wheel| wheel.friction.skid_kg_s),
            turned_rad,
        })
    });
    let mut places: Vec<LinkPlaces> = places.collect::<Result<_, _>>()?;
    // A balance of forces requires the coefficients and directions of all wheels.
    if places.iter().any(|of| of.wheel_mm.is_some() != (of.skid_kg_s > 0.0)) {
        places.iter_mut().for_each(|of| of.skid_kg_s = 0.0);
    }
    Ok(places)
}

/// Estimates the marker layouts of the links. `groups` are the columns of the links' markers and `places` the places on the
/// links, from front to rear; `cycle_frames` is the length of a cycle of the gait.
///
/// # Errors
/// Returns an error if a joint turns too little, if the markers of a link are not visible together, or if the motion does
/// not determine the joints.
pub fn calibrate_links(
    file: &Recording,
    groups: &[Vec<usize>],
    places: &[LinkPlaces],
    rate_hz: f64,
    cycle_frames: Option<f64>,
) -> Result<MeasuredLayout, Problem> {
    let bodies = bodies(file, groups)?;
    let parts = Parts::new(file, cycle_frames);
    let estimate = |left_out: usize| {
        let is_used = |row: usize| parts.part_of(file, row).is_some_and(|part| part != left_out);
        LayoutEstimate::new(file, &bodies, places, rate_hz, &is_used).ok_or(Problem::NoLayout)
    };
    let whole = estimate(parts.count)?;
    let partial = (0..parts.count).map(estimate).collect::<Result<_, _>>()?;
    let jackknife = Jackknife { whole, partial };
    let links = bodies.iter().enumerate().map(|(link, body)| {
        let markers = body.markers.iter().enumerate().map(|(i, marker)| MarkerPosition {
            label: short_label(file, marker.column).to_owned(),
            position_mm: jackknife.position_mm(link, i),
            configured_mm: None,
        });
        let is_inner = jackknife.whole.joints_mm[link].iter().all(Option::is_some);
        let joints_mm = [0, 1].map(|side| {
            let given = jackknife.whole.joints_mm[link][side]?;
            let measured =
                || jackknife.estimate(|part| part.joints_mm[link][side].unwrap_or(f64::NAN));
            Some(if is_inner { measured() } else { Estimate::new(given, f64::NAN) })
        });
        let direction_rad = jackknife.whole.direction_rad[link];
        let direction = jackknife.estimate(|part| wrap(part.direction_rad[link] - direction_rad));
        let skid_rad = jackknife.whole.skid_rad[link];
        let least_skid_mm = jackknife.whole.least_skid_mm[link]
            .map(|_| jackknife.estimate(|part| part.least_skid_mm[link].unwrap_or(f64::NAN)));
        LinkCalibration {
            markers: markers.collect(),
            least_skid_mm,
            joints_mm,
            direction: match places[link].wheel_mm {
                _ if is_inner => Direction::Joints,
                Some(_) => Direction::Wheel,
                None => Direction::MeanAngle,
            },
            skid_deg: skid_rad.to_degrees(),
            direction_se_deg: direction.se.hypot(RATIO_ERROR * skid_rad).to_degrees(),
        }
    });
    Ok(MeasuredLayout {
        links: links.collect(),
        joint_residuals_mm: jackknife.whole.residuals_mm.clone(),
        mean_angles_rad: jackknife.whole.mean_angles_rad.clone(),
        frames: (0..file.frames.len()).filter(|row| parts.part_of(file, *row).is_some()).count(),
    })
}

/// Layout estimates from the whole trial and from the trial without each of its segments.
struct Jackknife {
    whole: LayoutEstimate,
    partial: Vec<LayoutEstimate>,
}

impl Jackknife {
    /// Returns a quantity of the layout with its jackknife standard error.
    fn estimate(&self, value: impl Fn(&LayoutEstimate) -> f64) -> Estimate {
        let all = value(&self.whole);
        let squares: f64 = self.partial.iter().map(|part| (value(part) - all).powi(2)).sum();
        let count = self.partial.len() as f64;
        Estimate { value: all, se: ((count - 1.0) / count * squares).sqrt() }
    }

    /// Returns the position of a marker, mm, with standard errors. For the first and last link, these include the effect
    /// of the uncertainty of the skid coefficients, which the jackknife does not show.
    fn position_mm(&self, link: usize, marker: usize) -> [Estimate; 3] {
        let [x, y, _] = self.whole.positions_mm[link][marker];
        let joint_mm = match self.whole.joints_mm[link] {
            [Some(front_mm), _] => front_mm,
            [_, rear_mm] => -rear_mm.unwrap_or(0.0),
        };
        let turned_rad = RATIO_ERROR * self.whole.skid_rad[link];
        let across_mm = [y, x - joint_mm, 0.0];
        [0, 1, 2].map(|axis| {
            let found = self.estimate(|part| part.positions_mm[link][marker][axis]);
            Estimate { se: found.se.hypot(turned_rad * across_mm[axis]), ..found }
        })
    }
}

/// Fits the rigid bodies of the links, given the columns of their markers from front to rear, and checks that the joints
/// turn.
fn bodies(file: &Recording, groups: &[Vec<usize>]) -> Result<Vec<Body>, Problem> {
    let bodies: Vec<Body> =
        groups.iter().map(|group| fit_body(file, group)).collect::<Result<_, _>>()?;
    for (joint, pair) in bodies.windows(2).enumerate() {
        check_turn(joint + 1, &pair[0], &pair[1])?;
    }
    Ok(bodies)
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
fn check_turn(joint: usize, ahead: &Body, behind: &Body) -> Result<(), Problem> {
    let mut angles: Vec<f64> = behind.turns_to(ahead).map(|(_, turn)| turn).collect();
    if angles.len() < MIN_ROWS {
        return Err(Problem::JointUnseen { joint, found: angles.len(), needed: MIN_ROWS });
    }
    let first = angles[0];
    angles.iter_mut().for_each(|angle| *angle = wrap(*angle - first));
    let [low, high] = quantiles_low(angles, [0.05, 0.95]);
    let found_deg = (high - low).to_degrees();
    if found_deg < MIN_TURN_DEG {
        return Err(Problem::LittleTurn { joint, found_deg, needed_deg: MIN_TURN_DEG });
    }
    Ok(())
}
