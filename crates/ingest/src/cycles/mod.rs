//! Divides the coordinates into cycles by the phase and computes wheel velocities, metrics of every cycle, the
//! selection of steady cycles, trial means and checks.

mod common;
mod means;
mod measure;
mod noise;
mod outlying;
pub(crate) mod steady;
pub(crate) mod summary;

pub(crate) use measure::{Cycle, CycleData};

use trilink_robot::rotated;
use trilink_tables::{Coordinates, Numbered, WheelVelocities};

use crate::geometry::{Geometry, Row, Velocity, WheelRows};
use crate::signals::derivative;

/// Computes the wheel velocities by differentiating the coordinates and applying the kinematics of the links (eq. 1 of
/// the paper) in the frame of link 0. The velocity of a wheel depends only on the joints between its link and link 0.
pub(crate) fn wheel_velocities(
    geometry: &Geometry,
    coordinates: &Coordinates,
    rate_hz: f64,
) -> WheelVelocities {
    let rates = coordinates.map(|series| derivative(series, rate_hz));
    wheel_velocities_from_rates(geometry, coordinates, &rates)
}

/// Computes the wheel velocities from the coordinates and their time derivatives, per second.
pub(crate) fn wheel_velocities_from_rates(
    geometry: &Geometry,
    coordinates: &Coordinates,
    rates: &Coordinates,
) -> WheelVelocities {
    let frames = coordinates.frames();
    let links = geometry.links.len();
    let mut roll_m_s = vec![vec![f64::NAN; frames]; links];
    let mut skid_m_s = roll_m_s.clone();
    let mut rows = WheelRows::new(geometry);
    for i in 0..frames {
        let [u, v] = rotated(-coordinates.theta_rad[i], [rates.x_m[i], rates.y_m[i]]);
        let mut velocity = Row::default();
        velocity[..3].copy_from_slice(&[u, v, rates.theta_rad[i]]);
        for (velocity, rate) in velocity[3..].iter_mut().zip(rates.phi_rad.iter()) {
            *velocity = rate[i];
        }
        rows.set_shape(|joint| coordinates.phi_rad[joint][i]);
        for link in 0..links {
            let Some(Velocity { along, across, .. }) = rows.wheel(link) else { continue };
            roll_m_s[link][i] = product(&along, &velocity);
            skid_m_s[link][i] = product(&across, &velocity);
        }
    }
    WheelVelocities { roll_m_s: Numbered(roll_m_s), skid_m_s: Numbered(skid_m_s) }
}

/// Returns the dot product of a row with the velocity. Terms with zero weight are skipped, as their velocity may be
/// missing.
fn product(row: &Row, velocity: &Row) -> f64 {
    let needed = row.iter().zip(velocity).filter(|(weight, _)| **weight != 0.0);
    needed.map(|(weight, rate)| weight * rate).sum()
}

#[cfg(test)]
mod tests {
    use trilink_robot::Robot;

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
            phi_rad: [vec![0.0; frames], vec![0.0; frames]].into(),
        };
        let wheels = wheel_velocities(&Geometry::of_robot(&robot), &coordinates, rate);
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
            phi_rad: [vec![f64::NAN; frames], vec![0.1; frames]].into(),
        };
        let wheels =
            wheel_velocities(&Geometry::of_robot(&Robot::kinematic()), &coordinates, 120.0);
        let missing = |series: &[f64]| series.iter().all(|x| x.is_nan());
        assert_eq!([0, 1, 2].map(|i| missing(&wheels.skid_m_s[i])), [false, true, false]);
        assert_eq!([0, 1, 2].map(|i| missing(&wheels.roll_m_s[i])), [false, true, false]);
    }
}
