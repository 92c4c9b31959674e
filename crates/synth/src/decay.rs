//! The trials that give a robot's own parameters: its passive joint let go, and the straight
//! robot pushed.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use trilink_robot::Robot;
use trilink_robot::decay::Coast;

/// How far the passive joint is turned from its rest, rad, and how long it is held, s.
const RELEASED_RAD: std::ops::Range<f64> = 0.45..0.55;
const HELD_S: f64 = 0.5;
/// The robot's speed when it is let go, m/s, and how long it rests and is pushed before, s.
const PUSHED_M_S: std::ops::Range<f64> = 0.7..0.9;
const REST_S: f64 = 0.4;
const PUSH_S: f64 = 0.5;
/// What is left of swing and speed when the recording ends, and how long it lasts at most, s.
const SWING_LEFT: f64 = 0.002;
const SPEED_LEFT: f64 = 0.05;
const LONGEST_S: f64 = 30.0;
/// A joint with more damping hardly swings.
const LARGEST_DAMPING_RATIO: f64 = 0.4;

/// What a trial was made from. What its kind does not depend on is null.
#[derive(Debug, Clone, Default, Serialize)]
pub struct DecayTruth {
    pub robot: String,
    pub stiffness_nm_rad: Option<f64>,
    pub damping_nm_s_rad: Option<f64>,
    pub natural_rad_s: Option<f64>,
    pub damping_ratio: Option<f64>,
    pub roll_kg_s: Option<[f64; 3]>,
    pub roll_sum_kg_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll_dry_sum_n: Option<f64>,
}

/// A motion as `(x, y, theta, phi1, phi2)` of every frame, m and rad, and what it follows from.
pub(super) struct Decay {
    pub coordinates: Vec<[f64; 5]>,
    pub truth: DecayTruth,
}

/// The passive joint (0 or 1) of the lifted robot, whose other links are held, turned from its
/// rest and let go; `None` if it would hardly swing.
pub(super) fn released(
    name: &str,
    robot: &Robot,
    joint: usize,
    rate_hz: f64,
    random: &mut ChaCha8Rng,
) -> Option<Decay> {
    let link = joint + 1;
    let inertia = robot.inertia_kg_m2[link] + robot.mass_kg[link] * robot.b_m.powi(2);
    let (stiffness, damping) = (robot.stiffness_nm_rad, robot.damping_nm_s_rad);
    let natural_rad_s = (stiffness / inertia).sqrt();
    let damping_ratio = damping / (2.0 * inertia * natural_rad_s);
    if !(damping_ratio > 0.0 && damping_ratio < LARGEST_DAMPING_RATIO) {
        return None;
    }
    let decay = damping_ratio * natural_rad_s;
    let damped = natural_rad_s * (1.0 - damping_ratio.powi(2)).sqrt();
    let swing_rad = random.random_range(RELEASED_RAD);
    let duration_s = (HELD_S - SWING_LEFT.ln() / decay).min(LONGEST_S);
    let at = |frame: usize| {
        let t = (frame as f64 / rate_hz - HELD_S).max(0.0);
        let (sin, cos) = (damped * t).sin_cos();
        let swing = swing_rad * (-decay * t).exp() * (cos + decay / damped * sin);
        let mut coordinates = [0.0; 5];
        coordinates[3 + joint] = robot.rest_angle_rad + swing;
        coordinates
    };
    Some(Decay {
        coordinates: (0..(duration_s * rate_hz) as usize).map(at).collect(),
        truth: DecayTruth {
            robot: name.to_owned(),
            stiffness_nm_rad: Some(stiffness),
            damping_nm_s_rad: Some(damping),
            natural_rad_s: Some(natural_rad_s),
            damping_ratio: Some(damping_ratio),
            ..DecayTruth::default()
        },
    })
}

/// The straight robot at rest, pushed, and coasting against viscous and dry resistance; `None` if
/// nothing resists it.
pub(super) fn coasting(
    name: &str,
    robot: &Robot,
    rate_hz: f64,
    random: &mut ChaCha8Rng,
) -> Option<Decay> {
    let roll_sum_kg_s: f64 = robot.roll_kg_s.iter().sum();
    let roll_dry_sum_n: f64 = robot.roll_dry_n.iter().sum();
    let mass_kg: f64 = robot.mass_kg.iter().sum();
    let speed = random.random_range(PUSHED_M_S);
    let coast = Coast::from([0.0, speed, roll_sum_kg_s / mass_kg, roll_dry_sum_n / mass_kg]);
    let stops_s = (-SPEED_LEFT.ln() / coast.viscous_1_s).min(coast.stops_s() + REST_S);
    if !(stops_s > 0.0 && stops_s.is_finite()) {
        return None;
    }
    let begin_s = REST_S + PUSH_S;
    let duration_s = (begin_s + stops_s).min(LONGEST_S);
    let at = |frame: usize| {
        let t = frame as f64 / rate_hz;
        let pushed = (t - REST_S).clamp(0.0, PUSH_S);
        let coasted = (t - begin_s).max(0.0);
        let path_m = 0.5 * speed / PUSH_S * pushed * pushed + coast.path_m(coasted).0;
        [path_m, 0.0, 0.0, 0.0, 0.0]
    };
    Some(Decay {
        coordinates: (0..(duration_s * rate_hz) as usize).map(at).collect(),
        truth: DecayTruth {
            robot: name.to_owned(),
            roll_kg_s: Some(robot.roll_kg_s),
            roll_sum_kg_s: Some(roll_sum_kg_s),
            roll_dry_sum_n: Some(roll_dry_sum_n).filter(|dry| *dry > 0.0),
            ..DecayTruth::default()
        },
    })
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;

    use super::*;

    #[test]
    fn a_robot_with_dry_wheels_coasts_until_it_stops() {
        let of = |roll_kg_s, roll_dry_n| {
            let robot = Robot { roll_kg_s, roll_dry_n, ..Robot::kinematic() };
            coasting("ours", &robot, 120.0, &mut ChaCha8Rng::seed_from_u64(1))
        };
        let decay = of([0.0; 3], [0.4, 0.2, 0.2]).expect("it is resisted");
        let path_m: Vec<f64> = decay.coordinates.iter().map(|state| state[0]).collect();
        // Pushed over 0.5 s to a speed, which friction takes over twice its way.
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
