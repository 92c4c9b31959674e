//! Divides the coordinates into cycles by the phase and computes wheel velocities, metrics of every cycle, the
//! selection of steady cycles, trial means and checks.

mod joints;
mod means;
mod measure;
mod noise;
mod outlying;
pub(crate) mod steady;
pub(crate) mod summary;

pub(crate) use measure::{Cycle, CycleData};

use trilink_robot::{Robot, Trig, roll_rows, rotated, skid_rows};
use trilink_tables::{Coordinates, WheelVelocities};

use crate::signals::derivative;

/// Computes the wheel velocities by differentiating the coordinates and applying the kinematics of the links (eq. 1 of
/// the paper) in the frame of link 0. The velocity of a side wheel does not depend on the other side link.
pub(crate) fn wheel_velocities(
    robot: &Robot,
    coordinates: &Coordinates,
    rate_hz: f64,
) -> WheelVelocities {
    let rates = coordinates.map(|series| derivative(series, rate_hz));
    wheel_velocities_from_rates(robot, coordinates, &rates)
}

/// Computes the wheel velocities from the coordinates and their time derivatives, per second.
pub(crate) fn wheel_velocities_from_rates(
    robot: &Robot,
    coordinates: &Coordinates,
    rates: &Coordinates,
) -> WheelVelocities {
    let frames = coordinates.frames();
    let mut roll_m_s = [(); 3].map(|()| vec![f64::NAN; frames]);
    let mut skid_m_s = roll_m_s.clone();
    for i in 0..frames {
        let [u, v] = rotated(-coordinates.theta_rad[i], [rates.x_m[i], rates.y_m[i]]);
        let [w1, w2] = [0, 1].map(|joint| rates.phi_rad[joint][i]);
        let velocity = [u, v, rates.theta_rad[i], w1, w2];
        let trig = Trig::new([0, 1].map(|joint| coordinates.phi_rad[joint][i]));
        let roll = roll_rows(robot, &trig);
        let skid = skid_rows(robot, &trig);
        for wheel in 0..3 {
            roll_m_s[wheel][i] = product(&roll[wheel], &velocity);
            skid_m_s[wheel][i] = product(&skid[wheel], &velocity);
        }
    }
    WheelVelocities { roll_m_s, skid_m_s }
}

/// Returns the dot product of a row with the velocity. Terms with zero weight are skipped, as their velocity may be
/// missing.
fn product(row: &[f64; 5], velocity: &[f64; 5]) -> f64 {
    let needed = row.iter().zip(velocity).filter(|(weight, _)| **weight != 0.0);
    needed.map(|(weight, rate)| weight * rate).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wheel_velocities_of_a_turning_robot_are_those_of_its_wheel_paths() {
        // A straight robot turning about the centre of link 0: the side wheels are h + l away.
        let robot = Robot::kinematic();
        let rate = 120.0;
        let turn = 0.7;
        let frames = 30;
        let coordinates = Coordinates {
            x_m: vec![0.0; frames],
            y_m: vec![0.0; frames],
            theta_rad: (0..frames).map(|i| turn * i as f64 / rate).collect(),
            phi_rad: [vec![0.0; frames], vec![0.0; frames]],
        };
        let wheels = wheel_velocities(&robot, &coordinates, rate);
        let [arm, _] = robot.reach_m();
        for i in 0..frames {
            for (wheel, truth) in [0.0, arm * turn, -arm * turn].into_iter().enumerate() {
                assert!((wheels.skid_m_s[wheel][i] - truth).abs() < 1e-12);
                assert!(wheels.roll_m_s[wheel][i].abs() < 1e-12);
            }
        }
    }

    #[test]
    fn an_occluded_link_leaves_only_its_own_wheel_without_velocity() {
        let frames = 10;
        let coordinates = Coordinates {
            x_m: vec![0.0; frames],
            y_m: vec![0.0; frames],
            theta_rad: vec![0.0; frames],
            phi_rad: [vec![f64::NAN; frames], vec![0.1; frames]],
        };
        let wheels = wheel_velocities(&Robot::kinematic(), &coordinates, 120.0);
        let missing = |series: &[f64]| series.iter().all(|x| x.is_nan());
        assert_eq!([0, 1, 2].map(|i| missing(&wheels.skid_m_s[i])), [false, true, false]);
        assert_eq!([0, 1, 2].map(|i| missing(&wheels.roll_m_s[i])), [false, true, false]);
    }
}
