//! Motions of joint releases and coast-downs.

use std::f64::consts::PI;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use trilink_mechanics::Posture;
use trilink_robot::decay::Coast;
use trilink_robot::{AnyRobot, GRAVITY_M_S2, MAX_JOINTS, Pose, Quantity};

/// Range of the passive joint's initial deflection from its rest angle, rad.
const RELEASED_RAD: std::ops::Range<f64> = 0.45..0.55;
/// Duration for which the joint is held before its release, s.
const HELD_S: f64 = 0.5;
/// Range of the initial speed of a coast-down, m/s.
const PUSHED_M_S: std::ops::Range<f64> = 0.7..0.9;
/// Duration for which the robot is at rest before it is pushed, and after friction has stopped it, s.
const REST_S: f64 = 0.4;
/// Duration of the push, s.
const PUSH_S: f64 = 0.5;
/// Amplitude of the swing at the end of the recording, relative to the initial amplitude.
const SWING_LEFT: f64 = 0.002;
/// Speed at the end of the recording, relative to the initial speed, if friction does not stop the robot.
const SPEED_LEFT: f64 = 0.05;
/// Maximum duration of a recording, s.
const MAX_DURATION_S: f64 = 30.0;
/// Damping ratio from which on the release of a joint is not simulated, because the joint would barely swing.
const MAX_DAMPING_RATIO: f64 = 0.4;

/// True robot parameters of a joint release or a coast-down; null for parameters that do not affect this kind of trial.
#[derive(Debug, Clone, Default, Serialize)]
pub struct DecayTruth {
    pub robot: String,
    /// Released joint of a chain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joint: Option<usize>,
    pub stiffness_nm_rad: Option<f64>,
    pub damping_nm_s_rad: Option<f64>,
    pub natural_rad_s: Option<f64>,
    pub damping_ratio: Option<f64>,
    /// By link; NaN, which is written as null, for a link without a wheel.
    pub roll_kg_s: Option<Vec<f64>>,
    pub roll_sum_kg_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll_dry_sum_n: Option<f64>,
    /// Direction in which the robot coasts on a sloping floor, rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heading_rad: Option<f64>,
}

/// Slope of the floor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Slope {
    /// Angle at which the floor rises where it is steepest, degrees.
    pub slope_deg: f64,
    /// Direction in which the floor rises, degrees from the x axis of the laboratory.
    pub direction_deg: f64,
}

impl Slope {
    /// Directions of the coast-downs on a sloping floor, rad.
    pub(super) const HEADINGS_RAD: [f64; 4] = [0.0, PI, 0.5 * PI, -0.5 * PI];

    /// Returns the deceleration by gravity of a robot that travels in a direction, m/s^2.
    fn deceleration_m_s2(self, heading_rad: f64) -> f64 {
        let steepest = self.slope_deg.to_radians();
        let rise = steepest.tan() * (heading_rad - self.direction_deg.to_radians()).cos();
        GRAVITY_M_S2 * rise.atan().sin()
    }
}

/// Simulated motion of a robot in a joint release or a coast-down, and the true parameters with which it was computed.
pub(super) struct Decay {
    pub robot: AnyRobot,
    pub frames: Vec<Posture>,
    pub truth: DecayTruth,
}

/// Returns the motion of a free joint, given its index, when it is deflected from its rest angle and released while the
/// robot is lifted and clamped; `None` if the joint would barely swing, or has no damping to measure. The other joints of a chain are held at the
/// angles at which their springs are relaxed.
pub(super) fn released(
    name: &str,
    robot: &AnyRobot,
    joint: usize,
    rate_hz: f64,
    random: &mut ChaCha8Rng,
) -> Option<Decay> {
    let is_chain = robot.three_links().is_none();
    let held_rad = |joint: usize| if is_chain { robot.rest_angle_rad(joint) } else { 0.0 };
    let mut held = [0.0; MAX_JOINTS];
    held.iter_mut().take(robot.joints()).enumerate().for_each(|(i, angle)| *angle = held_rad(i));
    let inertia = robot.inertia_about_joint_kg_m2(joint, &held);
    let [stiffness, damping] = [Quantity::Stiffness, Quantity::Damping]
        .map(|quantity| robot.value(robot.of_free_joint(quantity, joint)));
    let natural_rad_s = (stiffness / inertia).sqrt();
    let damping_ratio = damping / (2.0 * inertia * natural_rad_s);
    if !(damping_ratio > 0.0 && damping_ratio < MAX_DAMPING_RATIO) {
        return None;
    }
    let decay = damping_ratio * natural_rad_s;
    let damped = natural_rad_s * (1.0 - damping_ratio.powi(2)).sqrt();
    let swing_rad = random.random_range(RELEASED_RAD);
    let duration_s = (HELD_S - SWING_LEFT.ln() / decay).min(MAX_DURATION_S);
    let at = |frame: usize| {
        let t = (frame as f64 / rate_hz - HELD_S).max(0.0);
        let (sin, cos) = (damped * t).sin_cos();
        let swing = swing_rad * (-decay * t).exp() * (cos + decay / damped * sin);
        let mut phi_rad = held;
        phi_rad[joint] = robot.rest_angle_rad(joint) + swing;
        (Pose::default(), phi_rad)
    };
    Some(Decay {
        robot: robot.clone(),
        frames: (0..(duration_s * rate_hz) as usize).map(at).collect(),
        truth: DecayTruth {
            robot: name.to_owned(),
            joint: is_chain.then_some(joint + 1),
            stiffness_nm_rad: Some(stiffness),
            damping_nm_s_rad: Some(damping),
            natural_rad_s: Some(natural_rad_s),
            damping_ratio: Some(damping_ratio),
            ..DecayTruth::default()
        },
    })
}

/// Returns the motion of the straight robot when it rests, is pushed, and coasts against viscous and dry resistance, in
/// the direction `heading_rad` on a sloping floor if there is one; `None` if its speed neither decays nor reaches zero. The recording ends
/// before a robot that gravity has stopped rolls back.
pub(super) fn coasting(
    name: &str,
    robot: &AnyRobot,
    rate_hz: f64,
    floor: Option<(Slope, f64)>,
    random: &mut ChaCha8Rng,
) -> Option<Decay> {
    let roll_sum_kg_s = robot.value(Quantity::Roll.sum());
    let roll_dry_sum_n = robot.value(Quantity::RollDry.sum());
    let mass_kg = robot.mass_kg();
    let speed = random.random_range(PUSHED_M_S);
    let gravity_m_s2 = floor.map_or(0.0, |(slope, heading)| slope.deceleration_m_s2(heading));
    let dry_m_s2 = roll_dry_sum_n / mass_kg;
    let coast = Coast::from([0.0, speed, roll_sum_kg_s / mass_kg, dry_m_s2 + gravity_m_s2]);
    let rest_s = if gravity_m_s2 > dry_m_s2 { 0.0 } else { REST_S };
    let stops_s = (-SPEED_LEFT.ln() / coast.viscous_1_s).min(coast.stops_s() + rest_s);
    if !(stops_s > 0.0 && stops_s.is_finite()) {
        return None;
    }
    let begin_s = REST_S + PUSH_S;
    let duration_s = (begin_s + stops_s).min(MAX_DURATION_S);
    let at = |frame: usize| {
        let t = frame as f64 / rate_hz;
        let pushed = (t - REST_S).clamp(0.0, PUSH_S);
        let coasted = (t - begin_s).max(0.0);
        let path_m = 0.5 * speed / PUSH_S * pushed * pushed + coast.path_m(coasted).0;
        (Pose { x_m: path_m, ..Pose::default() }, [0.0; MAX_JOINTS])
    };
    Some(Decay {
        robot: robot.clone(),
        frames: (0..(duration_s * rate_hz) as usize).map(at).collect(),
        truth: DecayTruth {
            robot: name.to_owned(),
            roll_kg_s: Some(robot.roll_kg_s()),
            roll_sum_kg_s: Some(roll_sum_kg_s),
            roll_dry_sum_n: Some(roll_dry_sum_n).filter(|dry| *dry > 0.0),
            heading_rad: floor.map(|(_, heading_rad)| heading_rad),
            ..DecayTruth::default()
        },
    })
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use trilink_robot::Robot;

    use super::*;

    #[test]
    fn a_robot_with_dry_wheels_coasts_until_it_stops() {
        let of = |roll_kg_s, roll_dry_n| {
            let robot = Robot { roll_kg_s, roll_dry_n, ..Robot::kinematic() };
            coasting("ours", &robot.into(), 120.0, None, &mut ChaCha8Rng::seed_from_u64(1))
        };
        let decay = of([0.0; 3], [0.4, 0.2, 0.2]).expect("it is resisted");
        let path_m: Vec<f64> = decay.frames.iter().map(|(pose, _)| pose.x_m).collect();
        // The robot is pushed to a speed v over 0.5 s; friction F then stops it over m v^2 / (2 F).
        let pushed_m = path_m[108];
        let speed_m_s = 2.0 * pushed_m / PUSH_S;
        let way_m = 0.5 * speed_m_s.powi(2) * 1.44 / 0.8;
        let [.., before, last] = path_m[..] else { panic!("it has frames") };
        assert_eq!(before, last);
        assert!((last - pushed_m - way_m).abs() < 1e-9, "{last} {pushed_m} {way_m}");
        assert_eq!(decay.truth.roll_dry_sum_n, Some(0.8));
        assert!(of([0.0; 3], [0.0; 3]).is_none());
    }
}
