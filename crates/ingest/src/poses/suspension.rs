//! Slow tilt of the links on their suspensions, which shifts what is above the axle.
//!
//! A link that tilts by 0.3 degrees carries markers at 60 mm a third of a millimetre aside. Where
//! it tilts about as fast as the robot's cycles, no mean over cycles takes that out, and it counts
//! as skid. The heights of all markers over a second give roll and pitch of the link to a few
//! hundredths of a degree, and they are undone. What is constant over the trial is a [`Tilt`].
//!
//! [`Tilt`]: super::tilt::Tilt

use nalgebra::Vector3;
use trilink_mocap::Recording;
use trilink_robot::rotated;
use trilink_statistics::NormalEquations;

use super::tilt::Turn;
use crate::markers::labels::{LinkFit, Outlier};
use crate::markers::layout::LinkMarker;

/// Time whose heights give one tilt, s, and the parts of it that neighbouring tilts share.
const WINDOW_S: f64 = 1.0;
const PARTS: usize = 8;
/// A window whose markers determine the tilt no better than this is passed over, rad.
const LARGEST_SE_RAD: f64 = 2e-3;
/// The tilt changes if its variance is this many times what the heights' noise makes of it.
const TIMES_NOISE: f64 = 4.0;

/// A link's markers in a file.
#[derive(Clone, Copy)]
pub(super) struct LinkRecording<'f> {
    pub file: &'f Recording,
    pub markers: &'f [LinkMarker],
    /// Tilt of the floor that the markers' positions still have.
    pub floor: Turn,
}

/// Undoes what the suspension's tilt does to a link's poses, if it is more than noise.
pub(super) fn set_upright(link: LinkRecording<'_>, rate_hz: f64, fits: &mut [LinkFit]) {
    let rows = ((WINDOW_S * rate_hz / PARTS as f64) as usize).max(1);
    let Some(turns_rad) = changing_turns(&link.parts(rows, fits)) else { return };
    for (row, fit) in fits.iter_mut().enumerate() {
        // A window's tilt is that of its middle, which is where a part begins.
        let position = row as f64 / rows as f64;
        let before = (position as usize).min(turns_rad.len() - 1);
        let after = (before + 1).min(turns_rad.len() - 1);
        let part = position - before as f64;
        let turn_rad =
            [0, 1].map(|i| (1.0 - part) * turns_rad[before][i] + part * turns_rad[after][i]);
        link.set_upright(row, fit, turn_rad);
    }
}

/// The link's turns about its x and y axes at the begin of every part, without their means, rad;
/// `None` if noise makes as much. Where too few markers were seen, the turn is the last one.
fn changing_turns(parts: &[NormalEquations<3>]) -> Option<Vec<[f64; 2]>> {
    let window = |begin: usize| {
        let parts = &parts[begin.saturating_sub(PARTS / 2)..(begin + PARTS / 2).min(parts.len())];
        turn(&NormalEquations::sum(parts.iter()))
    };
    let windows: Vec<_> = (0..parts.len()).map(window).collect();
    let found = || windows.iter().flatten();
    let count = found().count().max(1) as f64;
    let mean = [0, 1].map(|i| found().map(|(turn, _)| turn[i]).sum::<f64>() / count);
    let away = |turn: &[f64; 2]| [turn[0] - mean[0], turn[1] - mean[1]];
    let squares: f64 = found().map(|(turn, _)| away(turn)).map(|[a, b]| a * a + b * b).sum();
    let noise: f64 = found().map(|(_, variance)| variance).sum();
    let mut last = [0.0; 2];
    let turns = windows.iter().map(|window| {
        last = window.map_or(last, |(turn, _)| away(&turn));
        last
    });
    (squares > TIMES_NOISE * noise).then(|| turns.collect())
}

/// The turns about x and y, and the sum of their variances, if that is not too large.
fn turn(heights: &NormalEquations<3>) -> Option<([f64; 2], f64)> {
    let (found, inverse) = heights.solve()?;
    let left = heights.residual_squares(&found) / (heights.count - 3.0).max(1.0);
    let variance = left * (inverse[(1, 1)] + inverse[(2, 2)]);
    (variance < LARGEST_SE_RAD.powi(2)).then_some(([found[1], found[2]], variance))
}

impl LinkRecording<'_> {
    /// Equations of the heights of the markers above where they should be, for a constant and the
    /// turns about x and y, in parts of so many rows each.
    fn parts(&self, rows: usize, fits: &[LinkFit]) -> Vec<NormalEquations<3>> {
        let begin = fits.iter().position(LinkFit::is_posed).unwrap_or(0);
        let [a, b] = self.floor.about_rad;
        let mut parts = vec![NormalEquations::new(); fits.len().div_ceil(rows)];
        for marker in self.markers {
            let [x0, y0, _] = self.file.position_mm(begin, marker.column);
            let [x0, y0] = if x0.is_nan() { [0.0; 2] } else { [x0, y0] };
            let [x, y] = marker.local_position_mm;
            let column = Vector3::new(1.0, y, -x);
            for (part, (i, fits)) in parts.iter_mut().zip(fits.chunks(rows).enumerate()) {
                let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
                for (fit, row) in fits.iter().zip(i * rows..) {
                    let [x, y, z] = self.file.position_mm(row, marker.column);
                    if x.is_nan() || !fit.is_sound() {
                        continue;
                    }
                    let height = z - marker.height_mm - (a * (y - y0) - b * (x - x0));
                    count += 1.0;
                    sum += height;
                    squares += height * height;
                }
                part.add_sums(&column, count, sum, squares);
            }
        }
        parts
    }

    /// The pose that the link would have without a turn about its x and y axes.
    fn set_upright(&self, row: usize, fit: &mut LinkFit, [about_x, about_y]: [f64; 2]) {
        let Some(mut pose) = fit.pose() else { return };
        let centre = pose.moments.centre_mm;
        // The markers of the pose, by their heights: a marker at z is shifted by z times this.
        let shift = [about_y, -about_x];
        let (mut heights, mut turning) = (0.0, 0.0);
        for (i, marker) in self.markers.iter().enumerate() {
            let [x, _, _] = self.file.position_mm(row, marker.column);
            if x.is_nan() || fit.outlier() == Outlier::Jumped(i as u16) {
                continue;
            }
            let from_centre = [0, 1].map(|axis| marker.local_position_mm[axis] - centre[axis]);
            heights += marker.height_mm;
            turning += marker.height_mm * (from_centre[0] * shift[1] - from_centre[1] * shift[0]);
        }
        let mean_mm = heights / pose.moments.markers;
        // The markers' centroid, upright, seen from the axle as it was.
        let upright = [0, 1].map(|axis| centre[axis] - mean_mm * shift[axis]);
        let upright = rotated(pose.theta_rad, upright);
        pose.theta_rad -= turning / pose.moments.turning_mm2;
        let from_axle = rotated(pose.theta_rad, centre);
        for axis in 0..2 {
            pose.origin_mm[axis] += upright[axis] - from_axle[axis];
        }
        fit.set(Some(pose), fit.outlier());
    }
}

#[cfg(test)]
mod tests {
    use trilink_tables::config::Config;

    use super::*;
    use crate::markers::rigid;

    const ROWS: usize = 2400;
    const RATE_HZ: f64 = 120.0;
    const TRUE: ([f64; 2], f64) = ([300.0, -200.0], 0.7);

    fn markers() -> Vec<LinkMarker> {
        let layout = Config::default().markers.link0;
        let marker = |(column, [x, y, z]): (usize, &[f64; 3])| LinkMarker {
            column,
            local_position_mm: [*x, *y],
            height_mm: *z,
        };
        layout.values().enumerate().map(|(i, place)| marker((i, place))).collect()
    }

    /// A link that stays where it is but for its tilt, with some noise of the cameras.
    fn film(tilt_rad: f64, noise_mm: f64) -> Recording {
        let (origin, theta) = TRUE;
        let (sin, cos) = theta.sin_cos();
        let mut k = 0.0_f64;
        let mut noise = || {
            k += 1.0;
            noise_mm * (12.9898 * k + 0.3 * (7.233 * k).sin()).sin() * 1.4
        };
        let mut positions_mm = Vec::new();
        for row in 0..ROWS {
            let time_s = row as f64 / RATE_HZ;
            let [a, b] = [(0.9 * time_s).sin(), (0.6 * time_s).cos()].map(|x| tilt_rad * x);
            for LinkMarker { local_position_mm: [x, y], height_mm: z, .. } in markers() {
                let [x, y, z] = [x + b * z, y - a * z, z - b * x + a * y];
                let world = [origin[0] + cos * x - sin * y, origin[1] + sin * x + cos * y, z];
                positions_mm.push(world.map(|x| x + noise()));
            }
        }
        // Now and then a marker is lost, and once two of the four for two seconds.
        for i in (0..positions_mm.len()).step_by(37) {
            positions_mm[i] = [f64::NAN; 3];
        }
        for i in (4 * 1000..4 * 1240).filter(|i| i % 4 < 2) {
            positions_mm[i] = [f64::NAN; 3];
        }
        Recording {
            rate_hz: Some(RATE_HZ),
            frames: (0..ROWS as i64).collect(),
            labels: (0..markers().len()).map(|i| i.to_string()).collect(),
            rows_without_frame: 0,
            rows_too_long: 0,
            doubts: Vec::new(),
            positions_mm,
        }
    }

    /// RMS distance of the link's axle and heading from the truth, mm and rad, before and after.
    fn errors(file: &Recording) -> [[f64; 2]; 2] {
        let markers = markers();
        let mut fits: Vec<LinkFit> =
            (0..ROWS).map(|row| LinkFit::of(file.row_mm(row), &markers)).collect();
        let rms = |fits: &[LinkFit]| {
            let poses = || fits.iter().filter_map(LinkFit::pose);
            let away = |pose: &rigid::LinkPose| {
                let (origin, _) = TRUE;
                (pose.origin_mm[0] - origin[0]).powi(2) + (pose.origin_mm[1] - origin[1]).powi(2)
            };
            let place: f64 = poses().map(|pose| away(&pose)).sum();
            let heading: f64 = poses().map(|pose| (pose.theta_rad - TRUE.1).powi(2)).sum();
            [place, heading].map(|sum| (sum / ROWS as f64).sqrt())
        };
        let before = rms(&fits);
        let link = LinkRecording { file, markers: &markers, floor: Turn::default() };
        set_upright(link, RATE_HZ, &mut fits);
        [before, rms(&fits)]
    }

    #[test]
    fn a_link_that_tilts_on_its_suspension_is_set_upright() {
        let [before, after] = errors(&film(0.005, 0.0));
        assert!(before[0] > 0.2 && after[0] < 0.4 * before[0], "{before:?} {after:?}");
        assert!(before[1] > 1e-4 && after[1] < 0.6 * before[1], "{before:?} {after:?}");
        let [before, after] = errors(&film(0.005, 0.2));
        assert!(after[0] < 0.5 * before[0], "{before:?} {after:?}");
    }

    #[test]
    fn a_link_that_does_not_tilt_stays_as_it_is_seen() {
        let [before, after] = errors(&film(0.0, 0.2));
        assert_eq!(before, after);
    }
}
