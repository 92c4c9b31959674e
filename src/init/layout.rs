//! Marker layout of the links, estimated from the file that determines it best.

use std::path::PathBuf;

use rayon::prelude::*;
use trilink_ingest::calibrate::calibrate_recording;
use trilink_ingest::{Calibration, MarkerPosition, fit_rigid};
use trilink_mocap::LengthUnit;
use trilink_mocap::read_markers;
use trilink_robot::{Gait, JointCommand, Robot, rotated};
use trilink_statistics::{mean, seen, wrap};
use trilink_tables::config::Markers;

use super::clusters::{Links, by_number};
use super::motion::{Motion, Shape};

/// Maximum number of files from which the layout is tentatively estimated, starting with those whose joints move most.
const MAX_TRIED: usize = 4;
/// Frame rate to which files are thinned for tentative estimates of the layout, Hz.
pub(super) const TRIED_HZ: f64 = 30.0;
/// Maximum standard error of the side links' directions that are estimated from a gait, degrees; if it is exceeded, a
/// coast-down determines the directions.
const MAX_DIRECTION_SE_DEG: f64 = 0.5;
/// Maximum joint angle of a robot that coasts straight ahead, degrees; if it is exceeded, the side links' directions
/// that were estimated from a gait are rejected.
const MAX_BENT_DEG: f64 = 1.5;
/// Maximum angle between the direction of travel and the middle link of a robot that coasts straight ahead, degrees.
pub(super) const MAX_COURSE_DEG: f64 = 3.0;
/// Ratio l/h of the paper's robots, the default if the wheels do not determine l.
const DEFAULT_L_OVER_H: f64 = 0.112 / 0.144;

/// Gait file from which the marker layout may be estimated.
pub(super) struct Candidate<'m> {
    pub path: PathBuf,
    /// Unit of length if the file does not state one.
    pub unit: LengthUnit,
    pub rate_hz: f64,
    pub omega_rad_s: f64,
    pub motion: &'m Motion,
}

/// Marker layout, with its source.
#[derive(Debug)]
pub(super) struct Layout {
    pub calibration: Calibration,
    pub path: PathBuf,
    pub l_m: f64,
    /// Standard error of the side links' directions, degrees; NaN if a coast-down determines them.
    pub direction_se_deg: f64,
}

impl Layout {
    /// Estimates the marker layout of the three `links`. If no file determines the layout, returns the reason for each
    /// file tried.
    pub(super) fn find(
        links: &Links,
        mut candidates: Vec<Candidate>,
        coasts: &[&Motion],
        l_m: Option<f64>,
    ) -> Result<Self, Vec<String>> {
        let score = |found: &Calibration| found.direction_se_deg[0].max(found.direction_se_deg[1]);
        let try_one =
            |candidate: &Candidate| calibrate(links, candidate, l_m.unwrap_or(0.1), Some(TRIED_HZ));
        let (best, tried) = try_all(&mut candidates, try_one, score)?;
        let (best, rough) = &tried[best];
        let wheels_mm = mean(rough.l_mm.map(|l_mm| l_mm.value));
        let l_m = l_m.unwrap_or_else(|| match wheels_mm / rough.h_mm.value {
            ratio if (0.2..5.0).contains(&ratio) => wheels_mm / 1e3,
            _ => DEFAULT_L_OVER_H * rough.h_mm.value / 1e3,
        });
        let calibration = calibrate(links, best, l_m, None).map_err(|reason| vec![reason])?;
        let others: Vec<&Calibration> = tried.iter().map(|(_, found)| found).collect();
        let scatter_deg = [1, 2].map(|link| scatter_deg(&calibration, &others, link));
        let direction_se_deg = score(&calibration).hypot(scatter_deg[0].max(scatter_deg[1]));
        let path = best.path.clone();
        let mut layout = Self { calibration, path, l_m, direction_se_deg };
        layout.straighten(coasts);
        Ok(layout)
    }

    /// Rotates the side links so that the joint angles of a robot that coasts straight ahead are 0, if the gaits do not
    /// determine the directions well or contradict the coast-down. Wheels with a mean skid to one side, as under dry
    /// friction, bias directions that are estimated from gaits.
    fn straighten(&mut self, coasts: &[&Motion]) {
        let bent = coasts.iter().filter_map(|motion| {
            let middle = *headings_rad(motion, &self.positions())?.get(1)?;
            let course = wrap(motion.course_rad - motion.heading_rad - middle);
            let course_deg =
                course.abs().min((wrap(course + std::f64::consts::PI)).abs()).to_degrees();
            let phi_rad = mean_angles_rad(motion, &self.positions())?;
            (course_deg < MAX_COURSE_DEG).then_some([phi_rad[0], phi_rad[1]])
        });
        let size = |phi: &[f64; 2]| phi[0].abs().max(phi[1].abs());
        let Some([front, rear]) = bent.min_by(|a, b| size(a).total_cmp(&size(b))) else {
            return;
        };
        let bent_deg = front.abs().max(rear.abs()).to_degrees();
        if self.direction_se_deg <= MAX_DIRECTION_SE_DEG && bent_deg <= MAX_BENT_DEG {
            return;
        }
        // The heading of link 1 is theta - phi1, that of link 2 theta + phi2; each link is turned about its joint.
        for (link, turn_rad, joint_mm) in [(1, -front, -1e3 * self.l_m), (2, rear, 1e3 * self.l_m)]
        {
            for marker in &mut self.calibration.links[link] {
                let [x, y, _] = marker.position_mm.map(|estimate| estimate.value);
                let [x, y] = rotated(turn_rad, [x - joint_mm, y]);
                marker.position_mm[0].value = x + joint_mm;
                marker.position_mm[1].value = y;
            }
        }
        self.direction_se_deg = f64::NAN;
    }

    /// Returns the planar marker positions on the links from front to rear, mm.
    pub(super) fn positions(&self) -> Vec<Shape> {
        [1, 0, 2].map(|link| positions(&self.calibration.links[link])).into()
    }
}

/// Candidates from which a layout was found, each with that layout.
type Tried<'c, 'm, T> = Vec<(&'c Candidate<'m>, T)>;

/// Tries the candidates whose joints all move most. Returns those from which `try_one` finds a layout, each with that
/// layout, and the index of the one with the lowest score; if there is none, the reason for each file tried.
pub(super) fn try_all<'c, 'm, T: Send>(
    candidates: &'c mut Vec<Candidate<'m>>,
    try_one: impl Fn(&Candidate) -> Result<T, String> + Send + Sync,
    score: impl Fn(&T) -> f64,
) -> Result<(usize, Tried<'c, 'm, T>), Vec<String>> {
    choose(candidates);
    let tried: Vec<Result<T, String>> = candidates.par_iter().map(try_one).collect();
    let (mut found, mut reasons) = (Vec::new(), Vec::new());
    for (candidate, tried) in candidates.iter().zip(tried) {
        match tried {
            Ok(layout) => found.push((candidate, layout)),
            Err(reason) => reasons.push(reason),
        }
    }
    let scores = found.iter().map(|(_, layout)| score(layout)).enumerate();
    let best = scores.min_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|(best, _)| (best, found)).ok_or(reasons)
}

/// Keeps the candidates whose joints all move most, the best first.
fn choose(candidates: &mut Vec<Candidate>) {
    let min_range =
        |candidate: &Candidate| candidate.motion.ranges_deg().into_iter().fold(90.0, f64::min);
    candidates.sort_by(|a, b| min_range(b).total_cmp(&min_range(a)));
    candidates.truncate(MAX_TRIED);
}

/// Returns the headings of the links from front to rear relative to the link frames that the motion's file defines, rad,
/// given the marker positions on the links; `None` if these and the file have too few markers in common.
pub(super) fn headings_rad(motion: &Motion, positions: &[Shape]) -> Option<Vec<f64>> {
    motion.shapes.iter().zip(positions).map(|(shape, own)| heading_rad(shape, own)).collect()
}

/// Returns the offsets of the joint angles, rad, that follow from [`headings_rad`].
pub(super) fn offsets_rad(headings_rad: &[f64]) -> Vec<f64> {
    headings_rad.windows(2).map(|pair| wrap(pair[1] - pair[0])).collect()
}

/// Returns the mean joint angles of a motion, rad, given the marker positions on the links; `None` if these and the file
/// have too few markers in common.
pub(super) fn mean_angles_rad(motion: &Motion, positions: &[Shape]) -> Option<Vec<f64>> {
    let offsets = offsets_rad(&headings_rad(motion, positions)?);
    let joints = motion.phi_rad.iter().zip(offsets);
    Some(joints.map(|(phi_rad, offset)| wrap(offset + mean(seen(phi_rad)))).collect())
}

/// Estimates the standard deviation of a side link's direction among the layouts `all`, which include `layout`,
/// degrees; 0 for a single layout.
fn scatter_deg(layout: &Calibration, all: &[&Calibration], link: usize) -> f64 {
    let own = positions(&layout.links[link]);
    let squares = all
        .iter()
        .filter_map(|other| Some(heading_rad(&own, &positions(&other.links[link]))?.powi(2)));
    // The variance of a difference is the sum of the variances of two directions.
    let count = 2 * all.len().saturating_sub(1).max(1);
    (squares.sum::<f64>() / count as f64).sqrt().to_degrees()
}

/// Returns the planar marker positions on a link, indexed by marker name, mm.
pub(super) fn positions(link: &[MarkerPosition]) -> Shape {
    let markers = link.iter().map(|marker| {
        let [x, y, _] = marker.position_mm.map(|estimate| estimate.value);
        (marker.label.clone(), [x, y])
    });
    markers.collect()
}

/// Returns the heading of a link in the frame of `shape`, given the marker `positions` in the link's own frame, rad;
/// `None` if they have too few markers in common.
fn heading_rad(shape: &Shape, positions: &Shape) -> Option<f64> {
    let pairs = shape.iter().filter_map(|(name, seen)| {
        let (_, local) = positions.iter().find(|(known, _)| known == name)?;
        Some((*local, *seen))
    });
    Some(fit_rigid(pairs)?.theta_rad)
}

/// Estimates the layout from a file, thinned to the frame rate `thin_hz` if given.
fn calibrate(
    links: &Links,
    candidate: &Candidate,
    l_m: f64,
    thin_hz: Option<f64>,
) -> Result<Calibration, String> {
    let Candidate { path, unit, rate_hz, omega_rad_s, .. } = candidate;
    let file = read_markers(path, *unit).map_err(|error| error.to_string())?;
    let stride = thin_hz.map_or(1, |thin_hz| ((rate_hz / thin_hz) as usize).max(1));
    let file = file.thinned(stride);
    let numbered: Vec<&Vec<String>> = by_number(links).collect();
    let [link0, link1, link2] =
        [0, 1, 2].map(|link| numbered[link].iter().map(|name| (name.clone(), [0.0; 3])).collect());
    let markers = Markers { link0, link1, link2 };
    // Only l and the ratios of the skid coefficients of this robot are used.
    let robot = Robot { l_m: [l_m; 2], ..Robot::kinematic() };
    let placeholder = JointCommand::new(0.0, 1.0, 0.0);
    let gait = (Gait { joints: [Some(placeholder); 2] }, *omega_rad_s);
    calibrate_recording(&file, &(&markers).into(), &robot, Some(&gait), rate_hz / stride as f64)
        .map_err(|problem| format!("{}: {problem}", path.display()))
}
