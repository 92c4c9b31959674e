//! Motion of the links in a file: joint angles, and displacement of the robot.

use trilink_ingest::calibrate::{Body, locate_joint};
use trilink_ingest::frame_grid;
use trilink_mocap::Recording;
use trilink_robot::rotated;
use trilink_statistics::{quantiles_low, unwrap};

use super::clusters::{Links, columns};

/// Target frame rate, Hz: files with at least twice this rate are thinned. Joints are assumed to oscillate no faster
/// than at a twentieth of this rate.
const RATE_HZ: f64 = 60.0;

/// Marker positions of a link by marker name, in a coordinate frame that the markers of a file define, mm.
pub(super) type Shape = Vec<(String, [f64; 2])>;

/// Motion of the links. Headings are those of link frames that the file's markers define, so that the angles between
/// links have unknown constant offsets.
#[derive(Debug)]
pub(super) struct Motion {
    /// Sampling rate of the angles, Hz.
    pub rate_hz: f64,
    /// Angles from the frame of the middle link to the frames of links 1 and 2, for every video frame, rad; NaN in
    /// gaps.
    pub turns_rad: [Vec<f64>; 2],
    /// Marker positions on links 0, 1 and 2.
    pub shapes: [Shape; 3],
    /// Distance between the robot's first and last position, m.
    pub distance_m: f64,
    /// Direction from the robot's first to its last position in the camera system's frame, rad.
    pub course_rad: f64,
    /// Mean heading of the middle link's frame, rad.
    pub heading_rad: f64,
    /// Distance travelled along the middle link, positive towards link 1, m; 0 if the joints cannot be located.
    pub ahead_m: f64,
}

impl Motion {
    /// Estimates the motion of the links in a file with this frame rate; returns a message if that is impossible.
    pub(super) fn estimate(file: &Recording, links: &Links, rate_hz: f64) -> Result<Self, String> {
        let columns = columns(links, &file.labels)?;
        let stride = ((rate_hz / RATE_HZ) as usize).max(1);
        let file = file.thinned(stride);
        if file.frames.is_empty() {
            return Err("the file has no frames".to_owned());
        }
        let bodies = columns.iter().zip(links).map(|(columns, names)| {
            let body = Body::fit(&file, columns);
            body.ok_or_else(|| format!("the file hardly ever shows {} together", names.join(", ")))
        });
        let bodies = bodies.collect::<Result<Vec<Body>, String>>()?;
        let (first, frames) = frame_grid(&file.frames).map_err(|problem| problem.to_string())?;
        let turns_rad = [1, 2].map(|side| {
            let mut turns_rad = vec![f64::NAN; frames];
            for (row, turn) in bodies[side].turns_to(&bodies[0]) {
                turns_rad[(file.frames[row] - first) as usize] = turn;
            }
            unwrap(&mut turns_rad);
            turns_rad
        });
        if turns_rad.iter().flatten().all(|turn| turn.is_nan()) {
            return Err("the file never shows two links together".to_owned());
        }
        let shapes = [0, 1, 2].map(|link| {
            let markers = bodies[link].markers.iter().zip(&links[link]);
            markers.map(|(marker, name)| (name.clone(), marker.local_position_mm)).collect()
        });
        let poses: Vec<_> = bodies[0].fits.iter().filter_map(|fit| fit.pose()).collect();
        let (sin, cos) = poses.iter().fold((0.0, 0.0), |(sin, cos), pose| {
            (sin + pose.theta_rad.sin(), cos + pose.theta_rad.cos())
        });
        let displacement_mm = match (poses.first(), poses.last()) {
            (Some(from), Some(to)) => [0, 1].map(|i| to.origin_mm[i] - from.origin_mm[i]),
            _ => [0.0; 2],
        };
        let [joint1, joint2] =
            [1, 2].map(|side| locate_joint(&bodies[0], &bodies[side], &|_| true));
        let ahead_mm = match (joint1, joint2) {
            (Some((first, _)), Some((second, _))) => {
                let [dx, dy] = [0, 1].map(|i| first.in_inner[i] - second.in_inner[i]);
                let steps = poses.windows(2).map(|pair| {
                    let step = [0, 1].map(|i| pair[1].origin_mm[i] - pair[0].origin_mm[i]);
                    let [along, across] = rotated(-pair[0].theta_rad, step);
                    along * dx + across * dy
                });
                steps.sum::<f64>() / dx.hypot(dy).max(f64::MIN_POSITIVE)
            }
            _ => 0.0,
        };
        Ok(Self {
            rate_hz: rate_hz / stride as f64,
            turns_rad,
            shapes,
            distance_m: displacement_mm[0].hypot(displacement_mm[1]) / 1e3,
            course_rad: displacement_mm[1].atan2(displacement_mm[0]),
            heading_rad: sin.atan2(cos),
            ahead_m: ahead_mm / 1e3,
        })
    }

    /// Returns the ranges (2 % to 98 % quantile) of the angles from the middle link to links 1 and 2, degrees.
    pub(super) fn ranges_deg(&self) -> [f64; 2] {
        self.turns_rad.each_ref().map(|turns_rad| {
            let seen = trilink_statistics::seen(turns_rad).collect();
            let [low, high] = quantiles_low(seen, [0.02, 0.98]);
            (high - low).to_degrees()
        })
    }

    /// Swaps links 1 and 2, as if the robot faced the other way.
    pub(super) fn exchange(&mut self) {
        self.turns_rad.swap(0, 1);
        self.shapes.swap(1, 2);
        self.ahead_m = -self.ahead_m;
    }
}
