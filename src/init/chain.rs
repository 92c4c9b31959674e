//! Marker layout of a chain, estimated from the file that determines it best.

use std::f64::consts::PI;
use std::path::PathBuf;

use trilink_ingest::calibrate::{LinkCalibration, LinkPlaces, calibrate_chain, wheel_distances_mm};
use trilink_mocap::read_markers;
use trilink_robot::rotated;
use trilink_statistics::wrap;

use super::clusters::{Links, columns};
use super::layout::{
    Candidate, MAX_COURSE_DEG, TRIED_HZ, headings_rad, mean_angles_rad, positions, try_all,
};
use super::motion::{Motion, Shape};

/// Distance from the joint to the wheel of an end link whose motion does not determine it, mm.
const DEFAULT_LEVER_MM: f64 = 100.0;

/// Marker layout of a chain, with its source.
pub(super) struct ChainLayout {
    /// Links from front to rear.
    pub links: Vec<LinkCalibration>,
    pub path: PathBuf,
    /// Distances from the joints to the wheels of the first and last link, mm.
    pub levers_mm: [f64; 2],
    /// Whether these distances are given or determined by the motion.
    pub is_rolling: [bool; 2],
    /// Whether a coast-down determines the directions of the first and last link.
    pub is_straightened: bool,
}

impl ChainLayout {
    /// Estimates the marker layout of `links`. `l_m` is the distance from the joint to the wheel of the first and last
    /// link. If no file determines the layout, returns the reason for each file tried.
    pub(super) fn find(
        links: &Links,
        mut candidates: Vec<Candidate>,
        coasts: &[&Motion],
        l_m: Option<f64>,
    ) -> Result<Self, Vec<String>> {
        let score = |found: &Self| {
            let errors = found.links.iter().map(|link| link.direction_se_deg);
            errors.fold(0.0, f64::max)
        };
        let try_one = |candidate: &Candidate| calibrate(links, candidate, l_m, Some(TRIED_HZ));
        let (best, tried) = try_all(&mut candidates, try_one, score)?;
        let mut layout =
            calibrate(links, tried[best].0, l_m, None).map_err(|reason| vec![reason])?;
        layout.straighten(coasts);
        Ok(layout)
    }

    /// Returns the planar marker positions on the links, mm.
    pub(super) fn positions(&self) -> Vec<Shape> {
        self.links.iter().map(|link| positions(&link.markers)).collect()
    }

    /// Turns the first and last link about their joints so that they are aligned with the others while the robot coasts
    /// straight ahead. Of two links, both are aligned with the direction of travel.
    fn straighten(&mut self, coasts: &[&Motion]) {
        let last = self.links.len() - 1;
        let bent = coasts.iter().filter_map(|motion| {
            let positions = self.positions();
            let headings_rad = headings_rad(motion, &positions)?;
            let phi_rad = mean_angles_rad(motion, &positions)?;
            let course_rad =
                wrap(motion.course_rad - motion.heading_rad - headings_rad[motion.middle]);
            // A robot that is pushed backwards travels against its heading.
            let course_rad =
                if course_rad.abs() > 0.5 * PI { wrap(course_rad + PI) } else { course_rad };
            let turns_rad = match last {
                1 if motion.middle == 0 => [-course_rad, phi_rad[0] - course_rad],
                1 => [-phi_rad[0] - course_rad, -course_rad],
                _ if course_rad.abs().to_degrees() > MAX_COURSE_DEG => return None,
                _ => [-phi_rad[0], phi_rad[last - 1]],
            };
            Some(turns_rad)
        });
        let size = |turns: &[f64; 2]| turns[0].abs().max(turns[1].abs());
        let Some(turns_rad) = bent.min_by(|a, b| size(a).total_cmp(&size(b))) else { return };
        // The origins of these links are at their wheels.
        let joints_mm = self.levers_mm;
        for (link, turn_rad, joint_mm) in
            [(0, turns_rad[0], -joints_mm[0]), (last, turns_rad[1], joints_mm[1])]
        {
            for marker in &mut self.links[link].markers {
                let [x, y, _] = marker.position_mm.map(|estimate| estimate.value);
                let [x, y] = rotated(turn_rad, [x - joint_mm, y]);
                marker.position_mm[0].value = x + joint_mm;
                marker.position_mm[1].value = y;
            }
        }
        self.is_straightened = true;
    }
}

/// Estimates the layout from a file, thinned to the frame rate `thin_hz` if given.
fn calibrate(
    links: &Links,
    candidate: &Candidate,
    l_m: Option<f64>,
    thin_hz: Option<f64>,
) -> Result<ChainLayout, String> {
    let Candidate { path, unit, rate_hz, omega_rad_s, .. } = candidate;
    let file = read_markers(path, *unit).map_err(|error| error.to_string())?;
    let stride = thin_hz.map_or(1, |thin_hz| ((rate_hz / thin_hz) as usize).max(1));
    let file = file.thinned(stride);
    let rate_hz = rate_hz / stride as f64;
    let groups = columns(links, &file.labels)?;
    let failed = |problem| format!("{}: {problem}", path.display());
    let found_mm = match l_m {
        Some(l_m) => [Some(1e3 * l_m); 2],
        None => wheel_distances_mm(&file, &groups, rate_hz).map_err(failed)?,
    };
    let [front_mm, rear_mm] = found_mm.map(|found_mm| found_mm.unwrap_or(DEFAULT_LEVER_MM));
    // Of an inner link only the proportion of the two distances is used: its origin is halfway between the joints. All
    // wheels are taken to have the same skid coefficient.
    let inner = LinkPlaces {
        front_joint_mm: 1.0,
        rear_joint_mm: 1.0,
        wheel_mm: Some(0.0),
        skid_kg_s: 1.0,
        turned_rad: 0.0,
    };
    let mut places = vec![inner; links.len()];
    places[0] = LinkPlaces { front_joint_mm: 0.0, rear_joint_mm: front_mm, ..inner };
    places[links.len() - 1] = LinkPlaces { front_joint_mm: rear_mm, rear_joint_mm: 0.0, ..inner };
    let cycle_frames = std::f64::consts::TAU / omega_rad_s * rate_hz;
    let found = calibrate_chain(&file, &groups, &places, rate_hz, Some(cycle_frames));
    Ok(ChainLayout {
        links: found.map_err(failed)?,
        path: path.clone(),
        levers_mm: [front_mm, rear_mm],
        is_rolling: found_mm.map(|found_mm| found_mm.is_some()),
        is_straightened: false,
    })
}
