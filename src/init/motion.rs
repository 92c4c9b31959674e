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
    /// Angles of the joints from front to rear, from the frame of the link ahead to that of the link behind, for every
    /// video frame, rad; NaN in gaps.
    pub phi_rad: Vec<Vec<f64>>,
    /// Marker positions on the links from front to rear.
    pub shapes: Vec<Shape>,
    /// Distance between the robot's first and last position, m.
    pub distance_m: f64,
    /// Direction from the robot's first to its last position in the camera system's frame, rad.
    pub course_rad: f64,
    /// Index of the middle link from the front.
    pub middle: usize,
    /// Mean heading of the middle link's frame, rad.
    pub heading_rad: f64,
    /// Distance travelled along the middle link, positive towards the front, m; 0 if its joints cannot be located.
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
        let joints = bodies.windows(2).map(|pair| {
            let mut phi_rad = vec![f64::NAN; frames];
            for (row, turn) in pair[1].turns_to(&pair[0]) {
                phi_rad[(file.frames[row] - first) as usize] = turn;
            }
            unwrap(&mut phi_rad);
            phi_rad
        });
        let phi_rad: Vec<Vec<f64>> = joints.collect();
        if phi_rad.iter().flatten().all(|phi| phi.is_nan()) {
            return Err("the file never shows two links together".to_owned());
        }
        let shapes = bodies.iter().zip(links).map(|(body, names)| {
            let markers = body.markers.iter().zip(names);
            markers.map(|(marker, name)| (name.clone(), marker.local_position_mm)).collect()
        });
        let middle = (bodies.len() - 1) / 2;
        let poses: Vec<_> = bodies[middle].fits.iter().filter_map(|fit| fit.pose()).collect();
        let (sin, cos) = poses.iter().fold((0.0, 0.0), |(sin, cos), pose| {
            (sin + pose.theta_rad.sin(), cos + pose.theta_rad.cos())
        });
        let displacement_mm = match (poses.first(), poses.last()) {
            (Some(from), Some(to)) => [0, 1].map(|i| to.origin_mm[i] - from.origin_mm[i]),
            _ => [0.0; 2],
        };
        let joint_mm = |other: usize| {
            let (joint, _) = locate_joint(&bodies[middle], bodies.get(other)?, &|_| true)?;
            Some(joint.in_inner)
        };
        // The front link of two has a joint behind its markers, whose centroid is the origin of its frame.
        let before_mm = if middle == 0 { Some([0.0; 2]) } else { joint_mm(middle - 1) };
        let ahead_mm = match (before_mm, joint_mm(middle + 1)) {
            (Some(before), Some(behind)) => {
                let [dx, dy] = [0, 1].map(|i| before[i] - behind[i]);
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
            phi_rad,
            shapes: shapes.collect(),
            distance_m: displacement_mm[0].hypot(displacement_mm[1]) / 1e3,
            course_rad: displacement_mm[1].atan2(displacement_mm[0]),
            middle,
            heading_rad: sin.atan2(cos),
            ahead_m: ahead_mm / 1e3,
        })
    }

    /// Returns the ranges (2 % to 98 % quantile) of the joint angles, degrees.
    pub(super) fn ranges_deg(&self) -> Vec<f64> {
        let ranges = self.phi_rad.iter().map(|phi_rad| {
            let seen = trilink_statistics::seen(phi_rad).collect();
            let [low, high] = quantiles_low(seen, [0.02, 0.98]);
            (high - low).to_degrees()
        });
        ranges.collect()
    }

    /// Reverses the order of the links, as if the robot faced the other way.
    pub(super) fn exchange(&mut self) {
        self.phi_rad.reverse();
        self.phi_rad.iter_mut().flatten().for_each(|phi| *phi = -*phi);
        self.shapes.reverse();
        self.middle = self.shapes.len() - 1 - self.middle;
        self.ahead_m = -self.ahead_m;
    }
}
