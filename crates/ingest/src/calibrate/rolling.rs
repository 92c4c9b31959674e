//! The direction in which a side link's wheel rolls.
//!
//! The joint's motion shows where a link's joint is, and nothing about where its wheel is: any
//! direction and any distance from the joint move alike. The wheel does: it rolls along the link
//! and hardly skids across it. The direction is the one in which the skid velocity of the axle,
//! at a distance l from the joint, is smallest in the sense of least squares.

use nalgebra::{Vector1, Vector2};
use trilink_robot::rotated;
use trilink_statistics::least_squares::minimise;
use trilink_statistics::wrap;

use super::shape::Body;

/// Half the time over which velocities are taken, s.
const HALF_S: f64 = 0.025;
/// A step of this part of the standard error ends the search for the direction.
const SMALL_STEP: f64 = 1e-8;

/// Velocity of a point of a body in the body's own frame, mm/s, and its rate of turn, rad/s.
#[derive(Debug, Clone, Copy)]
pub(super) struct Velocity {
    pub row: usize,
    pub along_mm_s: [f64; 2],
    pub turn_rad_s: f64,
}

/// Of every row with poses shortly before and after it.
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
            let (before, after) = (row - half, row + half);
            if frames[after] - frames[before] != 2 * half as i64 {
                return None;
            }
            let [earlier, now, later] = [before, row, after].map(|row| body.fits[row].pose());
            let (earlier, now, later) = (earlier?, now?, later?);
            let (from, to) = (earlier.at(point_mm), later.at(point_mm));
            let velocity_mm_s = [0, 1].map(|axis| (to[axis] - from[axis]) / span_s);
            Some(Velocity {
                row,
                along_mm_s: rotated(-now.theta_rad, velocity_mm_s),
                turn_rad_s: wrap(later.theta_rad - earlier.theta_rad) / span_s,
            })
        })
        .collect()
}

/// The direction of the link in the body's frame, rad, near `guess_rad`, if the axle is at
/// `lever_mm` along it (negative: behind the joint); `None` if the velocities do not determine it.
pub(super) fn direction(velocities: &[Velocity], lever_mm: f64, guess_rad: f64) -> Option<f64> {
    let skid = |direction_rad: &Vector1<f64>, velocity: &Velocity| {
        let (skid, [slope, _]) = skid(velocity, direction_rad.x, lever_mm);
        (skid, Vector1::new(slope))
    };
    let minimum = minimise(velocities, Vector1::new(guess_rad), SMALL_STEP, 0.0, skid)?;
    Some(wrap(minimum.parameters.x))
}

/// The distance of the axle from the joint at which the axle skids least, mm, if its direction is
/// free too; from a direction and a lever that are near.
pub(super) fn lever_mm(velocities: &[Velocity], direction_rad: f64, lever_mm: f64) -> Option<f64> {
    let skid = |at: &Vector2<f64>, velocity: &Velocity| {
        let (skid, slopes) = skid(velocity, at.x, at.y);
        (skid, slopes.into())
    };
    let guess = Vector2::new(direction_rad, lever_mm);
    Some(minimise(velocities, guess, SMALL_STEP, 0.0, skid)?.parameters.y)
}

/// Skid velocity of the axle, and by how much it falls with direction and lever.
fn skid(velocity: &Velocity, direction_rad: f64, lever_mm: f64) -> (f64, [f64; 2]) {
    let Velocity { along_mm_s: [x, y], turn_rad_s, .. } = velocity;
    let (sin, cos) = direction_rad.sin_cos();
    (cos * y - sin * x + lever_mm * turn_rad_s, [cos * x + sin * y, -turn_rad_s])
}
