//! Marker layout of the links, estimated from the file that determines it best.

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;

use rayon::prelude::*;
use trilink_ingest::calibrate::{LinkPlaces, MeasuredLayout, calibrate_links};
use trilink_ingest::{MarkerPosition, fit_rigid};
use trilink_mocap::LengthUnit;
use trilink_mocap::read_markers;
use trilink_robot::rotated;
use trilink_statistics::{mean, seen, wrap};

use super::clusters::{Links, columns};
use super::motion::{Motion, Shape};

/// Maximum number of files from which the layout is tentatively estimated, starting with those whose joints move most.
const MAX_TRIED: usize = 4;
/// Frame rate to which files are thinned for tentative estimates of the layout, Hz.
const TRIED_HZ: f64 = 30.0;
/// Maximum standard error of the directions of the first and last link that are estimated from a gait, degrees; if it is
/// exceeded, a coast-down determines the directions.
pub(super) const MAX_DIRECTION_SE_DEG: f64 = 0.5;
/// Maximum joint angle of a robot that coasts straight ahead, degrees; if it is exceeded, the directions of the
/// first and last link that were estimated from a gait are rejected.
const MAX_BENT_DEG: f64 = 1.5;
/// Maximum angle between the direction of travel and the middle link of a robot that coasts straight ahead, degrees.
const MAX_COURSE_DEG: f64 = 3.0;
/// Distance from the joint to the wheel of the first and last link from which estimates start, mm.
const DEFAULT_LEVER_MM: f64 = 100.0;
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
pub(super) struct Layout {
    pub measured: MeasuredLayout,
    pub path: PathBuf,
    /// Distances from the joints to the wheels of the first and last link, mm.
    pub levers_mm: [f64; 2],
    /// Whether these distances are given or determined by the motion.
    pub is_rolling: [bool; 2],
    /// Standard error of the directions of the first and last link, degrees; NaN if a coast-down determines them.
    pub direction_se_deg: f64,
}

impl Layout {
    /// Estimates the marker layout of `links`. `l_m` is the distance from the joint to the wheel of the first and last
    /// link. If no file determines the layout, returns the reason for each file tried.
    pub(super) fn find(
        links: &Links,
        mut candidates: Vec<Candidate>,
        coasts: &[&Motion],
        l_m: Option<f64>,
    ) -> Result<Self, Vec<String>> {
        let score = |found: &MeasuredLayout| {
            let errors = found.links.iter().map(|link| link.direction_se_deg);
            errors.fold(0.0, f64::max)
        };
        let last = links.len() - 1;
        let given_mm = l_m.map(|l_m| 1e3 * l_m);
        let try_one = |candidate: &Candidate| {
            calibrate(links, candidate, [given_mm.unwrap_or(DEFAULT_LEVER_MM); 2], Some(TRIED_HZ))
        };
        let (best, tried) = try_all(&mut candidates, try_one, score)?;
        let (candidate, rough) = &tried[best];
        let of_motion = || [0, last].map(|end| Some(rough.links[end].least_skid_mm?.value));
        let mut found_mm = given_mm.map_or_else(of_motion, |given_mm| [Some(given_mm); 2]);
        if last == 2 {
            // Both side links have the same l.
            let both = found_mm.iter().flatten().copied();
            found_mm = [Some(mean(both)).filter(|l_mm| l_mm.is_finite()); 2];
        }
        let default_mm =
            rough.h_mm().map_or(DEFAULT_LEVER_MM, |h_mm| DEFAULT_L_OVER_H * h_mm.value);
        let levers_mm = found_mm.map(|found_mm| found_mm.unwrap_or(default_mm));
        let measured =
            calibrate(links, candidate, levers_mm, None).map_err(|reason| vec![reason])?;
        let scatter = [0, last].map(|link| scatter_deg(&measured, &tried, link));
        let mut layout = Self {
            direction_se_deg: score(&measured).hypot(scatter[0].max(scatter[1])),
            measured,
            path: candidate.path.clone(),
            levers_mm,
            is_rolling: found_mm.map(|found_mm| found_mm.is_some()),
        };
        layout.straighten(coasts);
        Ok(layout)
    }

    /// Turns the first and last link about their joints so that they are aligned with the others while the robot coasts
    /// straight ahead, if the gaits do not determine their directions well or contradict the coast-down. Of two links,
    /// both are aligned with the direction of travel. Wheels with a mean skid to one side, as under dry friction, bias
    /// directions that are estimated from gaits.
    fn straighten(&mut self, coasts: &[&Motion]) {
        let last = self.measured.links.len() - 1;
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
        let is_bent = size(&turns_rad).to_degrees() > MAX_BENT_DEG;
        let is_determined =
            self.direction_se_deg <= MAX_DIRECTION_SE_DEG && self.is_rolling == [true; 2];
        if is_determined && !is_bent {
            return;
        }
        // The origins of these links are at their wheels.
        let joints_mm = self.levers_mm;
        for (link, turn_rad, joint_mm) in
            [(0, turns_rad[0], -joints_mm[0]), (last, turns_rad[1], joints_mm[1])]
        {
            for marker in &mut self.measured.links[link].markers {
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
        self.measured.links.iter().map(|link| positions(&link.markers)).collect()
    }
}

/// Candidates from which a layout was found, each with that layout.
type Tried<'c, 'm, T> = Vec<(&'c Candidate<'m>, T)>;

/// Tries the candidates whose joints all move most. Returns those from which `try_one` finds a layout, each with that
/// layout, and the index of the one with the lowest score; if there is none, the reason for each file tried.
fn try_all<'c, 'm, T: Send>(
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
fn mean_angles_rad(motion: &Motion, positions: &[Shape]) -> Option<Vec<f64>> {
    let offsets = offsets_rad(&headings_rad(motion, positions)?);
    let joints = motion.phi_rad.iter().zip(offsets);
    Some(joints.map(|(phi_rad, offset)| wrap(offset + mean(seen(phi_rad)))).collect())
}

/// Estimates the standard deviation of the direction of a link among the layouts `tried`, which include a rough one from
/// the file of `layout`, degrees; 0 for a single layout.
fn scatter_deg(layout: &MeasuredLayout, tried: &Tried<MeasuredLayout>, link: usize) -> f64 {
    let own = positions(&layout.links[link].markers);
    let squares = tried.iter().filter_map(|(_, other)| {
        Some(heading_rad(&own, &positions(&other.links[link].markers))?.powi(2))
    });
    // The variance of a difference is the sum of the variances of two directions.
    let count = 2 * tried.len().saturating_sub(1).max(1);
    (squares.sum::<f64>() / count as f64).sqrt().to_degrees()
}

/// Returns the planar marker positions on a link, indexed by marker name, mm.
fn positions(link: &[MarkerPosition]) -> Shape {
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
    [front_mm, rear_mm]: [f64; 2],
    thin_hz: Option<f64>,
) -> Result<MeasuredLayout, String> {
    let Candidate { path, unit, rate_hz, omega_rad_s, .. } = candidate;
    let file = read_markers(path, *unit).map_err(|error| error.to_string())?;
    let stride = thin_hz.map_or(1, |thin_hz| ((rate_hz / thin_hz) as usize).max(1));
    let file = file.thinned(stride);
    let rate_hz = rate_hz / stride as f64;
    let groups = columns(links, &file.labels)?;
    // Of an inner link only the proportion of the two distances is used: its origin is halfway between the joints. Wheels
    // have the skid coefficients that are written as starting values.
    let inner = LinkPlaces {
        front_joint_mm: 1.0,
        rear_joint_mm: 1.0,
        wheel_mm: Some(0.0),
        skid_kg_s: if links.len() == 3 { 100.0 } else { 50.0 },
        turned_rad: 0.0,
    };
    let end = LinkPlaces { front_joint_mm: 0.0, rear_joint_mm: 0.0, skid_kg_s: 50.0, ..inner };
    let mut places = vec![inner; links.len()];
    places[0] = LinkPlaces { rear_joint_mm: front_mm, ..end };
    places[links.len() - 1] = LinkPlaces { front_joint_mm: rear_mm, ..end };
    let cycle_frames = TAU / omega_rad_s * rate_hz;
    calibrate_links(&file, &groups, &places, rate_hz, Some(cycle_frames))
        .map_err(|problem| format!("{}: {problem}", path.display()))
}
