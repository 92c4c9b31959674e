//! Estimates the marker layout from a subset of a trial's rows.

use trilink_mocap::Recording;
use trilink_robot::rotated;
use trilink_statistics::wrap;

use super::LinkPlaces;
use super::links::locate_joint;
use super::rolling;
use super::shape::Body;

/// Layout of the links, from front to rear, estimated from a subset of a trial's rows.
pub(super) struct LayoutEstimate {
    pub positions_mm: Vec<Vec<[f64; 3]>>,
    pub joints_mm: Vec<[Option<f64>; 2]>,
    /// RMS distances, over the rows, between the positions of each joint according to its two links, mm.
    pub residuals_mm: Vec<f64>,
    pub direction_rad: Vec<f64>,
    /// Mean skid angles that have been removed from the directions.
    pub skid_rad: Vec<f64>,
    /// Mean angles of the joints, rad.
    pub mean_angles_rad: Vec<f64>,
    /// Distances from their joints at which the wheels of the first and last link skid least, mm; `None` for other links
    /// and where the motion does not determine a plausible distance.
    pub least_skid_mm: Vec<Option<f64>>,
}

/// Rigid bodies of the links, from front to rear, and the joints that connect them.
struct Jointed<'b> {
    bodies: &'b [Body],
    /// In the frame of each link, the positions of the joint ahead and of the joint behind, mm; `None` where there is none.
    joints: Vec<[Option<[f64; 2]>; 2]>,
    residuals_mm: Vec<f64>,
}

impl<'b> Jointed<'b> {
    fn new(bodies: &'b [Body], is_used: &dyn Fn(usize) -> bool) -> Option<Self> {
        let mut joints = vec![[None; 2]; bodies.len()];
        let mut residuals_mm = Vec::new();
        for (link, pair) in bodies.windows(2).enumerate() {
            let (joint, residual_mm) = locate_joint(&pair[0], &pair[1], is_used)?;
            residuals_mm.push(residual_mm);
            joints[link][1] = Some(joint.in_inner);
            joints[link + 1][0] = Some(joint.in_outer);
        }
        Some(Self { bodies, joints, residuals_mm })
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
        axis_rad + mean_turn_rad(&self.bodies[inner], &self.bodies[link])
    }

    /// Returns the mean skid angles of the wheels of the first and last link, rad; 0 for all other links. They follow from
    /// the measured skid angles of the wheels between them: over a cycle, the lateral forces on the robot balance and, if
    /// both angles are unknown, so do the moments of these forces. `None` if the rows do not determine a measured angle.
    /// `velocities` returns the velocities of a point (mm, in the link's frame) of a link.
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
}

/// Returns the mean angle from the frame of one body to that of the other, rad.
fn mean_turn_rad(to: &Body, from: &Body) -> f64 {
    let turns = to.turns_to(from);
    let (sin, cos) =
        turns.fold((0.0, 0.0), |(sin, cos), (_, turn)| (sin + turn.sin(), cos + turn.cos()));
    f64::atan2(sin, cos)
}

impl LayoutEstimate {
    /// Estimates the layout; `None` if the rows do not determine the joints or the rolling directions.
    pub(super) fn new(
        file: &Recording,
        bodies: &[Body],
        places: &[LinkPlaces],
        rate_hz: f64,
        is_used: &dyn Fn(usize) -> bool,
    ) -> Option<Self> {
        let bodies: Vec<Body> = bodies.iter().map(|body| body.refined(file, is_used)).collect();
        let jointed = Jointed::new(&bodies, is_used)?;
        let velocities = |link: usize, point_mm: [f64; 2]| {
            let mut found = rolling::velocities(&bodies[link], point_mm, &file.frames, rate_hz);
            found.retain(|velocity| is_used(velocity.row));
            found
        };
        let mut joints_mm = Vec::new();
        let mut direction_rad = Vec::new();
        let mut least_skid_mm = vec![None; places.len()];
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
                            let joint = ahead.or(behind)?;
                            let velocities = velocities(link, joint);
                            let from_joint_mm =
                                if ahead.is_some() { -front_joint_mm } else { rear_joint_mm };
                            let lever_mm = wheel_mm + from_joint_mm;
                            let rolls_rad = rolling::direction(&velocities, lever_mm, aligned_rad)?;
                            let to_markers_mm = joint[0].hypot(joint[1]);
                            let is_plausible =
                                |least_mm: &f64| (0.2..5.0).contains(&(least_mm / to_markers_mm));
                            let least_mm = rolling::lever_mm(&velocities, rolls_rad, lever_mm);
                            least_skid_mm[link] = least_mm
                                .map(|least_mm| lever_mm.signum() * least_mm)
                                .filter(is_plausible);
                            rolls_rad
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
        let mean_angles_rad = bodies.windows(2).zip(direction_rad.windows(2)).map(|(pair, of)| {
            let turn_rad = mean_turn_rad(&pair[1], &pair[0]);
            wrap(turn_rad + of[1] - of[0])
        });
        Some(Self {
            positions_mm,
            joints_mm,
            residuals_mm: jointed.residuals_mm.clone(),
            mean_angles_rad: mean_angles_rad.collect(),
            direction_rad,
            skid_rad,
            least_skid_mm,
        })
    }
}
