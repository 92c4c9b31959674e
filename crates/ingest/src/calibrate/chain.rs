//! Calibrates the marker layouts of the links of a chain from a trial in which all joints move.
//!
//! The joints are located as for three links. A link between two joints points from one to the other. Of the first and
//! last link only one joint is known: their direction is that in which the wheel skids least, at a given distance from
//! the joint, corrected for the mean skid that balances the measured skid of the wheels between them. A link without such
//! a wheel is taken to have, on average, the mean angle that is configured for its joint.

use trilink_mocap::Recording;
use trilink_robot::{Chain, Link, Wheel, rotated};
use trilink_statistics::{Estimate, unwrap, wrap};
use trilink_tables::config::MarkerLayout;

use super::estimate::locate_joint;
use super::links::{JointMisfits, command_misfit, rigid_groups};
use super::shape::Body;
use super::{
    Jackknife, MIN_ROWS, MarkerPosition, Parts, RATIO_ERROR, check_turn, fit_body, labels, rolling,
    short_label,
};
use crate::error::Problem;
use crate::geometry::Geometry;
use crate::markers::layout::locate;
use crate::phase::CommandedGait;
use crate::poses::frame_grid;
use crate::{Command, Subject};

/// Minimum range of a joint angle, degrees; joints on springs may turn little.
const MIN_TURN_DEG: f64 = 5.0;
/// Maximum RMS distance between the two estimates of a joint's position, one from each of the links that it connects,
/// mm.
pub const MAX_JOINT_MISFIT_MM: f64 = 5.0;

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

/// Layout of a chain as measured in a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainCalibration {
    pub trial: String,
    pub robot: String,
    /// Names of the links from front to rear.
    pub names: Vec<String>,
    /// Layouts of the links from front to rear.
    pub links: Vec<LinkCalibration>,
    /// Configured places on the links.
    pub places: Vec<LinkPlaces>,
    /// Whether the markers were assigned to links by their motion because the file lacks the configured markers.
    pub is_grouped: bool,
    /// Labels of markers that move with none of the links.
    pub left_out: Vec<String>,
}

/// Marker layout and places of the joints of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkCalibration {
    pub markers: Vec<MarkerPosition>,
    /// Distances from the origin forwards to the joint ahead and backwards to the joint behind, mm, with standard
    /// errors; as given, without a standard error, on the first and last link, and `None` where there is no joint.
    pub joints_mm: [Option<Estimate>; 2],
    pub direction: Direction,
    /// Mean skid angle of the wheel of the first or last link that follows from the skid coefficients, degrees. It has
    /// been removed from the direction of the link; 0 for other links.
    pub skid_deg: f64,
    /// Standard error of the direction of the link, degrees.
    pub direction_se_deg: f64,
}

/// Layout of a chain estimated from a subset of a trial's rows, by link from front to rear.
struct ChainEstimate {
    positions_mm: Vec<Vec<[f64; 3]>>,
    joints_mm: Vec<[Option<f64>; 2]>,
    direction_rad: Vec<f64>,
    /// Mean skid angles that have been removed from the directions.
    skid_rad: Vec<f64>,
}

/// Rigid bodies of the links from front to rear with the positions of the joints in their frames.
struct Jointed<'b> {
    bodies: &'b [Body],
    /// Positions of the joints ahead and behind on each link, mm; `None` where there is no joint.
    joints: Vec<[Option<[f64; 2]>; 2]>,
}

impl<'b> Jointed<'b> {
    fn new(bodies: &'b [Body], is_used: &dyn Fn(usize) -> bool) -> Option<Self> {
        let mut joints = vec![[None; 2]; bodies.len()];
        for (link, pair) in bodies.windows(2).enumerate() {
            let (joint, _) = locate_joint(&pair[0], &pair[1], is_used)?;
            joints[link][1] = Some(joint.in_inner);
            joints[link + 1][0] = Some(joint.in_outer);
        }
        Some(Self { bodies, joints })
    }

    /// Returns the direction from the joint behind to the joint ahead, rad; `None` for the first and last link.
    fn axis_rad(&self, link: usize) -> Option<f64> {
        let [Some(ahead), Some(behind)] = self.joints[link] else { return None };
        Some((ahead[1] - behind[1]).atan2(ahead[0] - behind[0]))
    }

    /// Returns the direction of the first or last link if it is on average aligned with its neighbour or, with two
    /// links, if its markers surround its axis.
    fn aligned_rad(&self, link: usize) -> f64 {
        let inner = if link == 0 { 1 } else { link - 1 };
        let Some(axis_rad) = self.axis_rad(inner) else {
            // The origin of the body's frame is the centroid of its markers.
            let [x, y] = match self.joints[link] {
                [None, Some([x, y])] => [-x, -y],
                [joint, _] => joint.unwrap_or([1.0, 0.0]),
            };
            return y.atan2(x);
        };
        let turns = self.bodies[inner].turns_to(&self.bodies[link]);
        let (sin, cos) =
            turns.fold((0.0, 0.0), |(sin, cos), (_, turn)| (sin + turn.sin(), cos + turn.cos()));
        axis_rad + f64::atan2(sin, cos)
    }

    /// Returns the mean skid angles of the wheels of the first and last link, rad; 0 for all other links. Over a cycle,
    /// the lateral forces on the robot and, if both angles are unknown, their moments balance, given the angles from the
    /// directions of the other links to those in which their wheels move. `None` if the rows do not determine the
    /// latter. `velocities` returns the velocities of a point on a link.
    fn end_skid_rad(
        &self,
        places: &[LinkPlaces],
        joints_mm: &[[Option<f64>; 2]],
        direction_rad: &[f64],
        velocities: impl Fn(usize, [f64; 2]) -> Vec<rolling::Velocity>,
    ) -> Option<Vec<f64>> {
        let mut skid_rad = vec![0.0; places.len()];
        let mut unknown = Vec::new();
        let (mut force, mut moment) = (0.0, 0.0);
        let mut origin_mm = 0.0;
        for (link, places) in places.iter().enumerate() {
            origin_mm -= joints_mm[link][0].unwrap_or(0.0);
            let wheel = places.wheel_mm.filter(|_| places.skid_kg_s > 0.0);
            if let Some(wheel_mm) = wheel {
                let place_mm = origin_mm + wheel_mm;
                match (self.joints[link], joints_mm[link]) {
                    ([Some(ahead), Some(_)], [Some(front_mm), _]) => {
                        let (sin, cos) = direction_rad[link].sin_cos();
                        let back_mm = front_mm - wheel_mm;
                        let wheel = [ahead[0] - back_mm * cos, ahead[1] - back_mm * sin];
                        let moves_rad =
                            rolling::direction(&velocities(link, wheel), 0.0, direction_rad[link])?;
                        let lateral = places.skid_kg_s * wrap(moves_rad - direction_rad[link]);
                        force += lateral;
                        moment += lateral * place_mm;
                    }
                    _ => unknown.push((link, places.skid_kg_s, place_mm)),
                }
            }
            origin_mm -= joints_mm[link][1].unwrap_or(0.0);
        }
        match unknown[..] {
            [(link, skid_kg_s, _)] => skid_rad[link] = -force / skid_kg_s,
            [(first, of_first, first_mm), (last, of_last, last_mm)] if first_mm != last_mm => {
                let apart_mm = first_mm - last_mm;
                skid_rad[first] = (force * last_mm - moment) / (of_first * apart_mm);
                skid_rad[last] = (moment - force * first_mm) / (of_last * apart_mm);
            }
            _ => {}
        }
        Some(skid_rad)
    }

    /// Returns the velocities of the only joint of the first or last link.
    fn end_velocities(
        &self,
        link: usize,
        file: &Recording,
        rate_hz: f64,
        is_used: &dyn Fn(usize) -> bool,
    ) -> Option<Vec<rolling::Velocity>> {
        let [ahead, behind] = self.joints[link];
        let mut found =
            rolling::velocities(&self.bodies[link], ahead.or(behind)?, &file.frames, rate_hz);
        found.retain(|velocity| is_used(velocity.row));
        Some(found)
    }
}

impl ChainEstimate {
    /// Estimates the layout; `None` if the rows do not determine the joints or the rolling directions.
    fn new(
        file: &Recording,
        bodies: &[Body],
        places: &[LinkPlaces],
        rate_hz: f64,
        is_used: &dyn Fn(usize) -> bool,
    ) -> Option<Self> {
        let bodies: Vec<Body> = bodies.iter().map(|body| body.refined(file, is_used)).collect();
        let jointed = Jointed::new(&bodies, is_used)?;
        let mut joints_mm = Vec::new();
        let mut direction_rad = Vec::new();
        for (link, places) in places.iter().enumerate() {
            let LinkPlaces { front_joint_mm, rear_joint_mm, .. } = *places;
            let (direction, joints) = match jointed.joints[link] {
                [Some(ahead), Some(behind)] => {
                    let length_mm = (ahead[0] - behind[0]).hypot(ahead[1] - behind[1]);
                    let front_mm = length_mm * front_joint_mm / (front_joint_mm + rear_joint_mm);
                    (jointed.axis_rad(link)?, [Some(front_mm), Some(length_mm - front_mm)])
                }
                [ahead, behind] => {
                    let aligned_rad = jointed.aligned_rad(link) + places.turned_rad;
                    let direction_rad = match places.wheel_mm {
                        Some(wheel_mm) => {
                            let velocities =
                                jointed.end_velocities(link, file, rate_hz, is_used)?;
                            let from_joint_mm =
                                if ahead.is_some() { -front_joint_mm } else { rear_joint_mm };
                            let lever_mm = wheel_mm + from_joint_mm;
                            rolling::direction(&velocities, lever_mm, aligned_rad)?
                        }
                        None => aligned_rad,
                    };
                    let joints_mm = [ahead.map(|_| front_joint_mm), behind.map(|_| rear_joint_mm)];
                    (direction_rad, joints_mm)
                }
            };
            direction_rad.push(direction);
            joints_mm.push(joints);
        }
        let velocities = |link: usize, point_mm: [f64; 2]| {
            let mut found = rolling::velocities(&bodies[link], point_mm, &file.frames, rate_hz);
            found.retain(|velocity| is_used(velocity.row));
            found
        };
        let skid_rad = jointed.end_skid_rad(places, &joints_mm, &direction_rad, velocities)?;
        for (direction, skid_rad) in direction_rad.iter_mut().zip(&skid_rad) {
            *direction = wrap(*direction - skid_rad);
        }
        let mut positions_mm = Vec::new();
        for (link, body) in bodies.iter().enumerate() {
            let (joint, joint_mm) = match (jointed.joints[link], joints_mm[link]) {
                ([Some(ahead), _], [Some(front_mm), _]) => (ahead, front_mm),
                ([_, Some(behind)], [_, Some(rear_mm)]) => (behind, -rear_mm),
                _ => return None,
            };
            let markers = body.markers.iter().map(|marker| {
                let from_joint = [0, 1].map(|axis| marker.local_position_mm[axis] - joint[axis]);
                let [x, y] = rotated(-direction_rad[link], from_joint);
                [x + joint_mm, y, marker.height_mm]
            });
            positions_mm.push(markers.collect());
        }
        Some(Self { positions_mm, joints_mm, direction_rad, skid_rad })
    }
}

/// Fits the rigid bodies of the links, given the columns of their markers from front to rear, and checks that the joints
/// turn.
fn bodies(file: &Recording, groups: &[Vec<usize>]) -> Result<Vec<Body>, Problem> {
    let bodies: Vec<Body> =
        groups.iter().map(|group| fit_body(file, group)).collect::<Result<_, _>>()?;
    for (joint, pair) in bodies.windows(2).enumerate() {
        let found = pair[1].turns_to(&pair[0]).count();
        if found < MIN_ROWS {
            return Err(Problem::JointUnseen { joint: joint + 1, found, needed: MIN_ROWS });
        }
        check_turn(joint, &pair[0], &pair[1], MIN_TURN_DEG)?;
    }
    Ok(bodies)
}

/// Returns the distances from their joint at which the wheels of the first and last link skid least, mm. `None` where
/// the motion does not determine a plausible distance. `groups` are the columns of the links' markers from front to
/// rear.
///
/// # Errors
/// Returns an error if a joint turns too little or the markers of a link are not visible together.
pub fn wheel_distances_mm(
    file: &Recording,
    groups: &[Vec<usize>],
    rate_hz: f64,
) -> Result<[Option<f64>; 2], Problem> {
    let bodies = bodies(file, groups)?;
    let jointed = Jointed::new(&bodies, &|_| true).ok_or(Problem::NoLayout)?;
    Ok([0, bodies.len() - 1].map(|link| {
        let [x, y] = jointed.joints[link].into_iter().flatten().next()?;
        let to_markers_mm = x.hypot(y);
        let sign = if link == 0 { 1.0 } else { -1.0 };
        let velocities = jointed.end_velocities(link, file, rate_hz, &|_| true)?;
        let guess_rad = jointed.aligned_rad(link);
        let found_mm = sign * rolling::lever_mm(&velocities, guess_rad, sign * to_markers_mm)?;
        (0.2..5.0).contains(&(found_mm / to_markers_mm)).then_some(found_mm)
    }))
}

/// Estimates the marker layouts of a chain from a recording; the trial's id and the robot's name in the result are empty.
///
/// # Errors
/// Returns an error if the markers do not form the rigid groups of the links, if a joint turns too little, if no motion
/// shows the direction of a link, or if a link has no markers.
pub(super) fn calibrate(
    file: &Recording,
    markers: &MarkerLayout,
    Subject { robot, command, .. }: Subject,
    rate_hz: f64,
) -> Result<ChainCalibration, Problem> {
    let chain = robot.chain().ok_or(Problem::NoLayout)?;
    let names = chain.links.iter().map(|link| link.name.clone()).collect();
    let places = configured_places(&chain)?;
    let order = Geometry::new(&chain).order;
    let located = locate(markers, file).ok();
    let is_grouped = located.is_none();
    let groups: Vec<Vec<usize>> = match located {
        Some(layout) => {
            let columns = |link: &usize| layout[*link].iter().map(|marker| marker.column).collect();
            order.iter().map(columns).collect()
        }
        None => found_groups(file, order.len(), command.as_ref(), rate_hz)?,
    };
    if let Some(link) = groups.iter().position(Vec::is_empty) {
        return Err(Problem::BareLink { name: chain.links[link].name.clone() });
    }
    let cycle_frames = command.map(|of| std::f64::consts::TAU / of.omega_rad_s * rate_hz);
    let mut links = calibrate_chain(file, &groups, &places, rate_hz, cycle_frames)?;
    let configured = markers.links();
    for (link, number) in links.iter_mut().zip(&order) {
        for marker in &mut link.markers {
            marker.configured_mm = configured[*number].get(&marker.label).copied();
        }
    }
    let all = 0..file.labels.len();
    let is_left_out = |column: &usize| !groups.iter().flatten().any(|other| other == column);
    let left_out: Vec<usize> = all.filter(|column| is_grouped && is_left_out(column)).collect();
    let left_out = labels(file, &left_out);
    let [trial, robot] = [(); 2].map(|()| String::new());
    Ok(ChainCalibration { trial, robot, names, links, places, is_grouped, left_out })
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

impl Jackknife<ChainEstimate> {
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

/// Finds the columns of the markers of the links from front to rear by their motion; the driven joints of the command
/// determine which end is the front, unless they look the same from both ends.
fn found_groups(
    file: &Recording,
    links: usize,
    command: Option<&Command>,
    rate_hz: f64,
) -> Result<Vec<Vec<usize>>, Problem> {
    /// Ratio of the misfits of both orders below which one is that of the command.
    const MAX_MISFIT_RATIO: f64 = 0.5;
    let groups = rigid_groups(file);
    if groups.len() < links {
        let list: Vec<String> = groups.iter().map(|group| labels(file, group).join(" ")).collect();
        let (found, list) = (groups.len(), list.join("; "));
        return Err(Problem::RigidGroups { found, list, needed: links });
    }
    let bodies: Vec<Body> =
        groups.iter().map(|group| fit_body(file, group)).collect::<Result<_, _>>()?;
    let mut chain = JointMisfits::new(&bodies).chain(MAX_JOINT_MISFIT_MM);
    if chain.len() != links {
        return Err(Problem::ShortChain { found: chain.len(), needed: links });
    }
    let driven = command.filter(|command| command.joints.iter().any(Option::is_some));
    let Some(Command { joints, omega_rad_s }) = driven else { return Err(Problem::NoFront) };
    let command = CommandedGait { joints, omega_rad_s: *omega_rad_s, rate_hz, skip_cycles: 0 };
    let (first, frames) = frame_grid(&file.frames)?;
    let misfit = |chain: &[usize]| {
        let joints = chain.windows(2).map(|pair| {
            let mut phi_rad = vec![f64::NAN; frames];
            for (row, turn) in bodies[pair[1]].turns_to(&bodies[pair[0]]) {
                phi_rad[(file.frames[row] - first) as usize] = turn;
            }
            unwrap(&mut phi_rad);
            phi_rad
        });
        command_misfit(&command, &joints.collect::<Vec<_>>())
    };
    let reversed: Vec<usize> = chain.iter().rev().copied().collect();
    let [own, of_reversed] = [&chain, &reversed].map(|chain| misfit(chain));
    if own.min(of_reversed) >= MAX_MISFIT_RATIO * own.max(of_reversed) {
        return Err(Problem::NoFront);
    }
    if of_reversed < own {
        chain = reversed;
    }
    Ok(chain.into_iter().map(|body| groups[body].clone()).collect())
}

/// Estimates the marker layouts of a chain. `groups` are the columns of the links' markers and `places` the places on the
/// links, from front to rear; `cycle_frames` is the length of a cycle of the gait.
///
/// # Errors
/// Returns an error if a joint turns too little, if the markers of a link are not visible together, or if the motion does
/// not determine the joints.
pub fn calibrate_chain(
    file: &Recording,
    groups: &[Vec<usize>],
    places: &[LinkPlaces],
    rate_hz: f64,
    cycle_frames: Option<f64>,
) -> Result<Vec<LinkCalibration>, Problem> {
    let bodies = bodies(file, groups)?;
    let parts = Parts::new(file, cycle_frames);
    let estimate = |left_out: usize| {
        let is_used = |row: usize| parts.part_of(file, row).is_some_and(|part| part != left_out);
        ChainEstimate::new(file, &bodies, places, rate_hz, &is_used).ok_or(Problem::NoLayout)
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
        LinkCalibration {
            markers: markers.collect(),
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
    Ok(links.collect())
}
