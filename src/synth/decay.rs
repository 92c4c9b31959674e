//! The trials that give a robot's own parameters: its passive joint let go, and the straight
//! robot pushed.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use crate::robot::Robot;

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

/// The straight robot at rest, pushed, and coasting; `None` if nothing resists it.
pub(super) fn coasting(
    name: &str,
    robot: &Robot,
    rate_hz: f64,
    random: &mut ChaCha8Rng,
) -> Option<Decay> {
    let roll_sum_kg_s: f64 = robot.roll_kg_s.iter().sum();
    let decay = roll_sum_kg_s / robot.mass_kg.iter().sum::<f64>();
    if decay <= 0.0 {
        return None;
    }
    let speed = random.random_range(PUSHED_M_S);
    let begin_s = REST_S + PUSH_S;
    let duration_s = (begin_s - SPEED_LEFT.ln() / decay).min(LONGEST_S);
    let at = |frame: usize| {
        let t = frame as f64 / rate_hz;
        let pushed = (t - REST_S).clamp(0.0, PUSH_S);
        let coasted = (t - begin_s).max(0.0);
        let path_m = 0.5 * speed / PUSH_S * pushed * pushed
            + speed / decay * (1.0 - (-decay * coasted).exp());
        [path_m, 0.0, 0.0, 0.0, 0.0]
    };
    Some(Decay {
        coordinates: (0..(duration_s * rate_hz) as usize).map(at).collect(),
        truth: DecayTruth {
            robot: name.to_owned(),
            roll_kg_s: Some(robot.roll_kg_s),
            roll_sum_kg_s: Some(roll_sum_kg_s),
            ..DecayTruth::default()
        },
    })
}
