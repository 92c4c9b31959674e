//! Estimates the direction in which a side link's wheel rolls.
//!
//! The motion of the joint determines the joint's position in a link, but not the wheel's: the joint moves in the same
//! way whatever the direction and distance of the wheel. The wheel's own motion determines both: it rolls along the
//! link and barely skids across it. The direction minimises the sum of squared skid velocities of the axle at a
//! distance l from the joint.

use nalgebra::{Vector1, Vector2};
use trilink_robot::rotated;
use trilink_statistics::least_squares::minimise;
use trilink_statistics::wrap;

use super::shape::Body;

/// Half the time interval over which velocities are measured, s.
const HALF_S: f64 = 0.025;
/// Step size, in standard errors, at which the search for the direction stops.
const SMALL_STEP: f64 = 1e-8;

/// Velocity of a point on a body, mm/s in the body frame, and angular rate of the body, rad/s.
#[derive(Debug, Clone, Copy)]
pub(super) struct Velocity {
    pub row: usize,
    pub along_mm_s: [f64; 2],
    pub turn_rad_s: f64,
}

/// Measures the velocity of a point of a body in every row that has poses shortly before and after it.
pub(super) fn velocities(
    body: &Body,
    point_mm: [f64; 2],
    frames: &[i64],
    rate_hz: f64,
) -> Vec<Velocity> {
    let half = ((HALF_S * rate_hz).round() as usize).max(1);
    let span_s = 2.0 * half as f64 / rate_hz;
    (half..frames.len().saturating_sub(half))
        .filter_map(|row| {
            let before = row - half;
            let after = row + half;
            if frames[after] - frames[before] != 2 * half as i64 {
                return None;
            }
            let [earlier, now, later] = [before, row, after].map(|row| body.fits[row].pose());
            let [earlier, now, later] = [earlier?, now?, later?];
            let [from, to] = [earlier, later].map(|pose| pose.at(point_mm));
            let velocity_mm_s = [0, 1].map(|axis| (to[axis] - from[axis]) / span_s);
            Some(Velocity {
                row,
                along_mm_s: rotated(-now.theta_rad, velocity_mm_s),
                turn_rad_s: wrap(later.theta_rad - earlier.theta_rad) / span_s,
            })
        })
        .collect()
}

/// Fits the direction of the link in the body frame, rad, starting from `guess_rad`, with the axle at `lever_mm` along
/// that direction (negative if the axle is behind the joint). `None` if the velocities do not determine the direction.
pub(super) fn direction(velocities: &[Velocity], lever_mm: f64, guess_rad: f64) -> Option<f64> {
    let guess = Vector1::new(guess_rad);
    let minimum = minimise(velocities, guess, SMALL_STEP, 0.0, |direction_rad, velocity| {
        let (skid, [slope, _]) = skid(velocity, direction_rad.x, lever_mm);
        (skid, Vector1::new(slope))
    })?;
    Some(wrap(minimum.parameters.x))
}

/// Fits the distance from joint to axle at which the axle skids least, mm, together with the direction of the link;
/// `direction_rad` and `lever_mm` are starting values. `None` if the velocities do not determine both.
pub(super) fn lever_mm(velocities: &[Velocity], direction_rad: f64, lever_mm: f64) -> Option<f64> {
    let guess = Vector2::new(direction_rad, lever_mm);
    let minimum = minimise(velocities, guess, SMALL_STEP, 0.0, |at, velocity| {
        let (skid, slopes) = skid(velocity, at.x, at.y);
        (skid, slopes.into())
    })?;
    Some(minimum.parameters.y)
}

/// Returns the skid velocity of the axle, mm/s, and the negatives of its derivatives with respect to the link's
/// direction and to the lever (distance from joint to axle).
fn skid(velocity: &Velocity, direction_rad: f64, lever_mm: f64) -> (f64, [f64; 2]) {
    let Velocity { along_mm_s: [x, y], turn_rad_s, .. } = velocity;
    let (sin, cos) = direction_rad.sin_cos();
    (cos * y - sin * x + lever_mm * turn_rad_s, [cos * x + sin * y, -turn_rad_s])
}
