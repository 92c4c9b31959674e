//! Smoothing of the coordinates, and the wheel velocities that follow from the smoothed coordinates.

mod kalman;
mod motion;

use trilink_robot::rotated;
use trilink_statistics::{mean, seen};
use trilink_tables::{Coordinates, Numbered, WheelVelocities, WheelVelocityErrors};

use crate::cycles::{wheel_velocities, wheel_velocities_from_rates};
use crate::geometry::{Geometry, MAX_VELOCITIES, Row, Velocity, WheelRows};
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
        geometry: &Geometry,
        tracked: &Tracked,
        driven: Option<&GaitPhase>,
        window: Option<usize>,
        rate_hz: f64,
    ) -> Self {
        if let Some(window) = window {
            let coordinates = tracked.filled.map(|series| signals::moving_average(series, window));
            let wheels = wheel_velocities(geometry, &coordinates, rate_hz);
            return Self { coordinates, wheels, errors: None };
        }
        let smooth = smooth_coordinates(tracked, driven, rate_hz);
        let moving = driven.map_or(0..tracked.frames(), |driven| driven.moving.clone());
        let pose_variances = [0, 1].map(|i: usize| {
            let moving = &smooth.errors[i][moving.clone()];
            let values: Vec<f64> = moving.iter().map(|error| error.value).collect();
            mean(seen(&values).map(|error| error * error))
        });
        let errors = MotionErrors { wheels: wheel_errors(geometry, &smooth), pose_variances };
        let wheels = wheel_velocities_from_rates(geometry, &smooth.values, &smooth.rates);
        Self { coordinates: smooth.values, wheels, errors: Some(errors) }
    }
}

/// Returns the standard errors of the wheel velocities, propagated from those of the coordinates and their derivatives.
/// The errors of different coordinates are correlated as their noise is.
fn wheel_errors(geometry: &Geometry, smooth: &SmoothCoordinates) -> WheelVelocityErrors {
    let SmoothCoordinates { values, rates, errors, correlations } = smooth;
    let frames = values.frames();
    let links = geometry.links.len();
    let count = 3 + geometry.joints();
    let mut roll_m_s = vec![vec![f64::NAN; frames]; links];
    let mut skid_m_s = roll_m_s.clone();
    let mut rows = WheelRows::new(geometry);
    for i in 0..frames {
        let [u, v] = rotated(-values.theta_rad[i], [rates.x_m[i], rates.y_m[i]]);
        let mut velocity = Row::default();
        velocity[..3].copy_from_slice(&[u, v, rates.theta_rad[i]]);
        for (velocity, rate) in velocity[3..].iter_mut().zip(rates.phi_rad.iter()) {
            *velocity = rate[i];
        }
        let velocity = &velocity[..count];
        rows.set_shape(|joint| values.phi_rad[joint][i]);
        let error = |row: &Row, of_joints: [Option<&Row>; MAX_VELOCITIES - 3]| {
            // Derivatives of the wheel velocity with respect to the coordinates; `row` has those with respect to their
            // derivatives.
            let mut slopes = Row::default();
            slopes[2] = row[0] * v - row[1] * u;
            for (slope, drow) in slopes[3..].iter_mut().zip(of_joints) {
                if let Some(drow) = drow {
                    *slope = drow.iter().zip(velocity).fold(0.0, |sum, (a, b)| sum + a * b);
                }
            }
            let parts: [[f64; 2]; MAX_VELOCITIES] = std::array::from_fn(|k| {
                // The other joints may be missing.
                if k >= count || row[k] == 0.0 && slopes[k] == 0.0 {
                    return [0.0; 2];
                }
                // x and y have the same error.
                let error = errors[k.saturating_sub(1)][i];
                [slopes[k] * error.value + row[k] * error.rate_along, row[k] * error.rate_rest]
            });
            let mut square = 0.0;
            for (j, [a1, a2]) in parts[..count].iter().enumerate() {
                for (k, [b1, b2]) in parts[..count].iter().enumerate() {
                    square += correlations[j][k] * (a1 * b1 + a2 * b2);
                }
            }
            // Missing values stay missing.
            if square < 0.0 { 0.0 } else { square.sqrt() }
        };
        for link in 0..links {
            let Some(Velocity { along, across, dphi }) = rows.wheel(link) else { continue };
            let [mut dalong, mut dacross] = [[None; MAX_VELOCITIES - 3]; 2];
            for (_, inner) in geometry.path(link) {
                let [along, across] = &dphi[inner.joint];
                (dalong[inner.joint], dacross[inner.joint]) = (Some(along), Some(across));
            }
            roll_m_s[link][i] = error(&along, dalong);
            skid_m_s[link][i] = error(&across, dacross);
        }
    }
    WheelVelocityErrors { roll_m_s: Numbered(roll_m_s), skid_m_s: Numbered(skid_m_s) }
}
