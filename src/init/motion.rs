//! How the links move in a file: the joints' angles and the robot's way.

use trilink_ingest::calibrate::{Body, between};
use trilink_ingest::frame_grid;
use trilink_mocap::Recording;
use trilink_robot::rotated;
use trilink_statistics::{quantiles_low, unwrap};

use super::clusters::{Links, columns};

/// Rates above twice this one are thinned, Hz: no joint of a robot swings faster than a twentieth.
const RATE_HZ: f64 = 60.0;

/// Markers of a link by name, in a frame of the file's own, mm.
pub(super) type Shape = Vec<(String, [f64; 2])>;

/// What links do. Headings are those of frames that the markers of this file give, so that angles
/// between links have constants of their own.
#[derive(Debug)]
pub(super) struct Motion {
    /// Of the angles, Hz.
    pub rate_hz: f64,
    /// From the middle link's frame to those of links 1 and 2 in every frame, rad; NaN where not seen.
    pub turns_rad: [Vec<f64>; 2],
    /// Of links 0, 1, 2.
    pub shapes: [Shape; 3],
    /// Way from the first to the last frame, m, and its direction in the world, rad.
    pub way_m: f64,
    pub course_rad: f64,
    /// Mean heading of the middle link's frame, rad.
    pub heading_rad: f64,
    /// Way along the middle link, to where link 1 is, m; 0 where that is not seen.
    pub ahead_m: f64,
}

impl Motion {
    /// Of the links in a file with this rate, or why it is not seen.
    pub(super) fn of(file: &Recording, links: &Links, rate_hz: f64) -> Result<Self, String> {
        let columns = columns(links, &file.labels)?;
        let stride = ((rate_hz / RATE_HZ) as usize).max(1);
        let file = file.thinned(stride);
        if file.frames.is_empty() {
            return Err("has no frames".to_owned());
        }
        let shaped = |link: usize| {
            let body = Body::of(&file, &columns[link]);
            body.ok_or_else(|| format!("hardly ever shows {} together", links[link].join(", ")))
        };
        let bodies = [shaped(0)?, shaped(1)?, shaped(2)?];
        let (first, frames) = frame_grid(&file.frames).map_err(|problem| problem.to_string())?;
        let turns = |side: usize| {
            let mut turns_rad = vec![f64::NAN; frames];
            for (row, turn) in bodies[side].turns_to(&bodies[0]) {
                turns_rad[(file.frames[row] - first) as usize] = turn;
            }
            unwrap(&mut turns_rad);
            turns_rad
        };
        let turns_rad = [turns(1), turns(2)];
        if turns_rad.iter().flatten().all(|turn| turn.is_nan()) {
            return Err("shows no two links together".to_owned());
        }
        let shape = |link: usize| -> Shape {
            let place = |(marker, name): (&trilink_ingest::LinkMarker, &String)| {
                (name.clone(), marker.local_position_mm)
            };
            bodies[link].markers.iter().zip(&links[link]).map(place).collect()
        };
        let poses: Vec<_> = bodies[0].fits.iter().filter_map(|fit| fit.pose()).collect();
        let (sin, cos) = poses.iter().fold((0.0, 0.0), |(sin, cos), pose| {
            (sin + pose.theta_rad.sin(), cos + pose.theta_rad.cos())
        });
        let way_mm = match (poses.first(), poses.last()) {
            (Some(from), Some(to)) => [0, 1].map(|i| to.origin_mm[i] - from.origin_mm[i]),
            _ => [0.0; 2],
        };
        let joint = |side: usize| between(&bodies[0], &bodies[side], &|_| true);
        let ahead_mm = match (joint(1), joint(2)) {
            (Some((first, _)), Some((second, _))) => {
                let [dx, dy] = [0, 1].map(|i| first.in_middle[i] - second.in_middle[i]);
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
            shapes: [0, 1, 2].map(shape),
            way_m: way_mm[0].hypot(way_mm[1]) / 1e3,
            course_rad: way_mm[1].atan2(way_mm[0]),
            heading_rad: sin.atan2(cos),
            ahead_m: ahead_mm / 1e3,
        })
    }

    /// How far links 1 and 2 turn, all but the rarest angles, degrees.
    pub(super) fn ranges_deg(&self) -> [f64; 2] {
        self.turns_rad.each_ref().map(|turns_rad| {
            let seen = trilink_statistics::seen(turns_rad).collect();
            let [low, high] = quantiles_low(seen, [0.02, 0.98]);
            (high - low).to_degrees()
        })
    }

    /// Calls link 2 link 1 and the other way round.
    pub(super) fn exchange(&mut self) {
        self.turns_rad.swap(0, 1);
        self.shapes.swap(1, 2);
        self.ahead_m = -self.ahead_m;
    }
}
