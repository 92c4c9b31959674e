//! From coordinates and phase to cycles: the wheels' velocities, the metrics of every cycle, which
//! cycles are steady, and the trial's means and checks.

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

/// Differentiates smoothed coordinates and applies eq. 1 in link 0's frame. A wheel's velocity
/// is known without the other side link.
pub(crate) fn wheel_velocities(
    robot: &Robot,
    coordinates: &Coordinates,
    rate_hz: f64,
) -> WheelVelocities {
    let frames = coordinates.frames();
    let rates = coordinates.map(|series| derivative(series, rate_hz));
    let missing = || [(); 3].map(|()| vec![f64::NAN; frames]);
    let (mut roll_m_s, mut skid_m_s) = (missing(), missing());
    for i in 0..frames {
        let [u, v] = rotated(-coordinates.theta_rad[i], [rates.x_m[i], rates.y_m[i]]);
        let [w1, w2] = [0, 1].map(|joint| rates.phi_rad[joint][i]);
        let velocity = [u, v, rates.theta_rad[i], w1, w2];
        let apply = |row: &[f64; 5]| -> f64 {
            let needed = row.iter().zip(velocity).filter(|(weight, _)| **weight != 0.0);
            needed.map(|(weight, rate)| weight * rate).sum()
        };
        let trig = Trig::new([0, 1].map(|joint| coordinates.phi_rad[joint][i]));
        let (roll, skid) = (roll_rows(robot, &trig), skid_rows(robot, &trig));
        for wheel in 0..3 {
            roll_m_s[wheel][i] = apply(&roll[wheel]);
            skid_m_s[wheel][i] = apply(&skid[wheel]);
        }
    }
    WheelVelocities { roll_m_s, skid_m_s }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turning_robot_has_the_velocities_of_its_wheels_paths() {
        // Straight robot turning about the middle of link 0: the side wheels are h + l away.
        let (robot, rate, turn) = (Robot::kinematic(), 120.0, 0.7);
        let frames = 30;
        let coordinates = Coordinates {
            x_m: vec![0.0; frames],
            y_m: vec![0.0; frames],
            theta_rad: (0..frames).map(|i| turn * i as f64 / rate).collect(),
            phi_rad: [vec![0.0; frames], vec![0.0; frames]],
        };
        let wheels = wheel_velocities(&robot, &coordinates, rate);
        let arm = robot.h_m + robot.l_m;
        for i in 0..frames {
            for (wheel, truth) in [0.0, arm * turn, -arm * turn].into_iter().enumerate() {
                assert!((wheels.skid_m_s[wheel][i] - truth).abs() < 1e-12);
                assert!(wheels.roll_m_s[wheel][i].abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_link_out_of_sight_hides_only_its_own_wheel() {
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
