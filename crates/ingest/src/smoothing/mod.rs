//! Smoothing of the coordinates, and the wheel velocities that follow from the smoothed coordinates.

mod kalman;
mod motion;

use trilink_robot::{
    Robot, Trig, dot, droll_rows_dphi, dskid_rows_dphi, roll_rows, rotated, skid_rows,
};
use trilink_statistics::{mean, seen};
use trilink_tables::{Coordinates, WheelVelocities, WheelVelocityErrors};

use crate::cycles::{wheel_velocities, wheel_velocities_from_rates};
use crate::phase::GaitPhase;
use crate::poses::Tracked;
use crate::signals;
use motion::{SmoothCoordinates, smooth_coordinates};

/// Smoothed coordinates and the wheel velocities derived from them.
pub(crate) struct SmoothedMotion {
    pub coordinates: Coordinates,
    pub wheels: WheelVelocities,
    /// Errors, which only the Kalman smoother gives.
    pub errors: Option<MotionErrors>,
}

/// Errors of smoothed coordinates and wheel velocities.
pub(crate) struct MotionErrors {
    pub wheels: WheelVelocityErrors,
    /// Mean variances of a coordinate of the position, m^2, and of the heading, rad^2, while the robot is driven.
    pub pose_variances: [f64; 2],
}

impl SmoothedMotion {
    /// Smooths the coordinates: by a moving average over `window` samples, or by the Kalman smoother if there is no
    /// window.
    pub(crate) fn new(
        robot: &Robot,
        tracked: &Tracked,
        driven: Option<&GaitPhase>,
        window: Option<usize>,
        rate_hz: f64,
    ) -> Self {
        if let Some(window) = window {
            let coordinates = tracked.filled.map(|series| signals::moving_average(series, window));
            let wheels = wheel_velocities(robot, &coordinates, rate_hz);
            return Self { coordinates, wheels, errors: None };
        }
        let smooth = smooth_coordinates(tracked, driven, rate_hz);
        let moving = driven.map_or(0..tracked.frames(), |driven| driven.moving.clone());
        let pose_variances = [0, 1].map(|i: usize| {
            let moving = &smooth.errors[i][moving.clone()];
            let values: Vec<f64> = moving.iter().map(|error| error.value).collect();
            mean(seen(&values).map(|error| error * error))
        });
        let errors = MotionErrors { wheels: wheel_errors(robot, &smooth), pose_variances };
        let wheels = wheel_velocities_from_rates(robot, &smooth.values, &smooth.rates);
        Self { coordinates: smooth.values, wheels, errors: Some(errors) }
    }
}

/// Returns the standard errors of the wheel velocities, propagated from those of the coordinates and their derivatives.
/// The errors of different coordinates are correlated as their noise is.
fn wheel_errors(robot: &Robot, smooth: &SmoothCoordinates) -> WheelVelocityErrors {
    let SmoothCoordinates { values, rates, errors, correlations } = smooth;
    let frames = values.frames();
    let mut roll_m_s = [(); 3].map(|()| vec![f64::NAN; frames]);
    let mut skid_m_s = roll_m_s.clone();
    for i in 0..frames {
        let [u, v] = rotated(-values.theta_rad[i], [rates.x_m[i], rates.y_m[i]]);
        let velocity = [u, v, rates.theta_rad[i], rates.phi_rad[0][i], rates.phi_rad[1][i]];
        let trig = Trig::new([0, 1].map(|joint| values.phi_rad[joint][i]));
        let errors = [0, 0, 1, 2, 3].map(|coordinate: usize| errors[coordinate][i]);
        let error = |row: &[f64; 5], own_joint: Option<(usize, [f64; 5])>| {
            // Derivatives of the wheel velocity with respect to the coordinates; `row` has those with respect to their
            // derivatives.
            let mut slopes = [0.0, 0.0, row[0] * v - row[1] * u, 0.0, 0.0];
            if let Some((joint, drow)) = own_joint {
                slopes[3 + joint] = dot(&drow, &velocity);
            }
            let parts: [[f64; 2]; 5] = std::array::from_fn(|k| {
                // The other joint may be missing.
                if row[k] == 0.0 && slopes[k] == 0.0 {
                    return [0.0; 2];
                }
                let error = errors[k];
                [slopes[k] * error.value + row[k] * error.rate_along, row[k] * error.rate_rest]
            });
            let mut square = 0.0;
            for (j, [a1, a2]) in parts.iter().enumerate() {
                for (k, [b1, b2]) in parts.iter().enumerate() {
                    square += correlations[(j, k)] * (a1 * b1 + a2 * b2);
                }
            }
            // Missing values stay missing.
            if square < 0.0 { 0.0 } else { square.sqrt() }
        };
        let (roll, skid) = (roll_rows(robot, &trig), skid_rows(robot, &trig));
        let (droll, dskid) = (droll_rows_dphi(robot, &trig), dskid_rows_dphi(robot, &trig));
        for wheel in 0..3_usize {
            let joint = wheel.checked_sub(1);
            roll_m_s[wheel][i] = error(&roll[wheel], joint.map(|joint| (joint, droll[joint])));
            skid_m_s[wheel][i] = error(&skid[wheel], joint.map(|joint| (joint, dskid[joint])));
        }
    }
    WheelVelocityErrors { roll_m_s, skid_m_s }
}
