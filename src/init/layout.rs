//! Where the markers sit, by the file that shows it best.

use std::path::PathBuf;

use rayon::prelude::*;
use trilink_ingest::calibrate::of_file;
use trilink_ingest::{Calibration, fit_rigid};
use trilink_mocap::LengthUnit;
use trilink_mocap::read_markers;
use trilink_robot::{Gait, JointCommand, Robot, rotated};
use trilink_statistics::{mean, seen, wrap};
use trilink_tables::config::Markers;

use super::clusters::Links;
use super::motion::{Motion, Shape};

/// Files that are tried, those whose joints turn most.
const MOST_TRIED: usize = 4;
/// Rate at which they are tried, Hz.
const TRIED_HZ: f64 = 30.0;
/// Side links' directions that are known less well than this by a gait are taken from a coast-down,
/// degrees.
const WELL_DEG: f64 = 0.5;
/// Nor do gaits show them by which a robot that coasts straight on is bent by more than this, degrees.
const MOST_BENT_DEG: f64 = 1.5;
/// A robot that coasts further off its middle link's direction than this is not straight, degrees.
const STRAIGHT_DEG: f64 = 3.0;
/// l as a part of h where the wheels do not show it: as of the paper's robots.
const L_OF_H: f64 = 0.112 / 0.144;

/// A gait's file.
pub(super) struct Candidate<'m> {
    pub path: PathBuf,
    /// Of a file that does not say its own.
    pub unit: LengthUnit,
    pub rate_hz: f64,
    pub omega_rad_s: f64,
    pub motion: &'m Motion,
}

/// The layout with where it is from.
#[derive(Debug)]
pub(super) struct Layout {
    pub calibration: Calibration,
    pub path: PathBuf,
    pub l_m: f64,
    /// How well the side links' directions are known, degrees; NaN where a coast-down says them.
    pub direction_se_deg: f64,
}

impl Layout {
    /// Of links with the front one second. `None` says that no file shows it, with the reasons.
    pub(super) fn find(
        links: &Links,
        mut candidates: Vec<Candidate>,
        coasts: &[&Motion],
        l_m: Option<f64>,
    ) -> Result<Self, Vec<String>> {
        let least_turn = |of: &Candidate| of.motion.ranges_deg().into_iter().fold(90.0, f64::min);
        candidates.sort_by(|a, b| least_turn(b).total_cmp(&least_turn(a)));
        candidates.truncate(MOST_TRIED);
        let tried: Vec<_> = candidates
            .par_iter()
            .map(|of| measured(links, of, l_m.unwrap_or(0.1), Some(TRIED_HZ)))
            .collect();
        let score = |found: &Calibration| found.direction_se_deg[0].max(found.direction_se_deg[1]);
        let good = tried
            .iter()
            .zip(&candidates)
            .filter_map(|(found, of)| Some((found.as_ref().ok()?, of)));
        let Some((rough, best)) = good.min_by(|a, b| score(a.0).total_cmp(&score(b.0))) else {
            return Err(tried.into_iter().filter_map(Result::err).collect());
        };
        let shown_mm = mean(rough.l_mm.map(|l_mm| l_mm.value));
        let by_wheels = || match shown_mm / rough.h_mm.value {
            part if (0.2..5.0).contains(&part) => shown_mm / 1e3,
            _ => L_OF_H * rough.h_mm.value / 1e3,
        };
        let l_m = l_m.unwrap_or_else(by_wheels);
        let calibration = measured(links, best, l_m, None).map_err(|reason| vec![reason])?;
        let others: Vec<&Calibration> = tried.iter().flatten().collect();
        let differ_deg = [1, 2].map(|link| differ_deg(&calibration, &others, link));
        let direction_se_deg = score(&calibration).hypot(differ_deg[0].max(differ_deg[1]));
        let path = best.path.clone();
        let mut layout = Self { calibration, path, l_m, direction_se_deg };
        layout.straighten(coasts);
        Ok(layout)
    }

    /// Turns the side links so that a robot that coasts straight on has straight links, where the gaits
    /// do not show it or contradict it: wheels that skid to one side, as on a dry floor, deceive.
    fn straighten(&mut self, coasts: &[&Motion]) {
        let bent = coasts.iter().filter_map(|motion| {
            let [middle, ..] = self.constants_rad(motion)?;
            let off = wrap(motion.course_rad - motion.heading_rad - middle);
            let off_deg = off.abs().min((wrap(off + std::f64::consts::PI)).abs()).to_degrees();
            (off_deg < STRAIGHT_DEG).then(|| self.phi_rad(motion))?
        });
        let Some([front, rear]) = bent.min_by(|a, b| {
            let most = |bent: &[f64; 2]| bent[0].abs().max(bent[1].abs());
            most(a).total_cmp(&most(b))
        }) else {
            return;
        };
        let bent_deg = front.abs().max(rear.abs()).to_degrees();
        if self.direction_se_deg <= WELL_DEG && bent_deg <= MOST_BENT_DEG {
            return;
        }
        // Link 1 is turned by theta - phi1, link 2 by theta + phi2, about their joints.
        for (link, by_rad, joint_mm) in [(1, -front, -1e3 * self.l_m), (2, rear, 1e3 * self.l_m)] {
            for marker in &mut self.calibration.links[link] {
                let [x, y, _] = marker.position_mm.map(|of| of.value);
                let [x, y] = rotated(by_rad, [x - joint_mm, y]);
                marker.position_mm[0].value = x + joint_mm;
                marker.position_mm[1].value = y;
            }
        }
        self.direction_se_deg = f64::NAN;
    }

    /// From the headings of a motion's frames to those of the links, rad.
    fn constants_rad(&self, motion: &Motion) -> Option<[f64; 3]> {
        let constant =
            |link: usize| turned(&motion.shapes[link], &positions(&self.calibration, link));
        Some([constant(0)?, constant(1)?, constant(2)?])
    }

    /// What has to be added to a motion's phi1 and phi2, rad.
    pub(super) fn offsets_rad(&self, motion: &Motion) -> Option<[f64; 2]> {
        let [middle, front, rear] = self.constants_rad(motion)?;
        Some([wrap(middle - front), wrap(rear - middle)])
    }

    /// Mean phi1 and phi2 of a motion, rad.
    fn phi_rad(&self, motion: &Motion) -> Option<[f64; 2]> {
        let offsets = self.offsets_rad(motion)?;
        let [front, rear] = motion.turns_rad.each_ref().map(|turns| mean(seen(turns)));
        Some([wrap(offsets[0] - front), wrap(offsets[1] + rear)])
    }
}

/// By how much layouts, of which it is one, scatter in a side link's direction, degrees; 0 of one alone.
fn differ_deg(of: &Calibration, all: &[&Calibration], link: usize) -> f64 {
    let own = positions(of, link);
    let squares =
        all.iter().filter_map(|other| Some(turned(&own, &positions(other, link))?.powi(2)));
    // Each difference has the errors of two.
    let count = 2 * all.len().saturating_sub(1).max(1);
    (squares.sum::<f64>() / count as f64).sqrt().to_degrees()
}

/// Markers of a link by name, mm.
fn positions(of: &Calibration, link: usize) -> Shape {
    let place = |marker: &trilink_ingest::MarkerPosition| {
        let [x, y, _] = marker.position_mm.map(|of| of.value);
        (marker.label.clone(), [x, y])
    };
    of.links[link].iter().map(place).collect()
}

/// Heading of a link in the frame that a file's markers give it, from `positions` in the link's own.
fn turned(shape: &Shape, positions: &Shape) -> Option<f64> {
    let pairs = shape.iter().filter_map(|(name, seen)| {
        let (_, local) = positions.iter().find(|(of, _)| of == name)?;
        Some((*local, *seen))
    });
    Some(fit_rigid(pairs)?.theta_rad)
}

/// What a file shows of the layout, at a lower rate if one is given.
fn measured(
    links: &Links,
    of: &Candidate,
    l_m: f64,
    thin_hz: Option<f64>,
) -> Result<Calibration, String> {
    let in_file = |reason: &dyn std::fmt::Display| format!("{}: {reason}", of.path.display());
    let file = read_markers(&of.path, of.unit).map_err(|error| error.to_string())?;
    let stride = thin_hz.map_or(1, |thin_hz| ((of.rate_hz / thin_hz) as usize).max(1));
    let file = file.thinned(stride);
    let known = |link: usize| links[link].iter().map(|name| (name.clone(), [0.0; 3])).collect();
    let markers = Markers { link0: known(0), link1: known(1), link2: known(2) };
    // Of the robot only l counts, and in which proportion the wheels skid.
    let robot = Robot { l_m, ..Robot::kinematic() };
    let any = JointCommand::new(0.0, 1.0, 0.0);
    let gait = (Gait { joints: [Some(any); 2] }, of.omega_rad_s);
    of_file(&file, &markers, &robot, Some(&gait), of.rate_hz / stride as f64)
        .map_err(|problem| in_file(&problem))
}
