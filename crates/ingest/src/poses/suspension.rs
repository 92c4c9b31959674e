//! Corrects the slow tilting of the links on their suspensions, which displaces the markers sideways.
//!
//! A link that tilts by 0.3 degrees displaces markers at a height of 60 mm sideways by a third of a millimetre. If the
//! tilt varies with about the period of the gait, averaging over cycles does not remove the error, which then appears
//! as skid. The heights of all markers over a second determine the link's roll and pitch to a few hundredths of a
//! degree, so that both can be removed. A large constant tilt is corrected before, by [`Tilt`].
//!
//! [`Tilt`]: super::tilt::Tilt

use nalgebra::Vector3;
use trilink_mocap::Recording;
use trilink_robot::rotated;
use trilink_statistics::{Estimate, NormalEquations, mean, mean_of_oscillation};

use super::shift::PoseShift;
use super::tilt::Turn;
use crate::markers::labels::{LinkFit, Outlier};
use crate::markers::layout::LinkMarker;

/// Duration of the window over which marker heights are used to determine one tilt, s.
const WINDOW_S: f64 = 1.0;
/// Number of parts per window; neighbouring windows overlap by all parts but one.
const PARTS_PER_WINDOW: usize = 8;
/// Maximum standard error of a tilt, rad; windows in which it is larger are skipped.
const MAX_SE_RAD: f64 = 2e-3;
/// Ratio between the variance of the tilt and the variance expected from height noise, above which the tilt is
/// corrected.
const MIN_VARIANCE_RATIO: f64 = 4.0;

/// Markers of one link in a file.
#[derive(Clone, Copy)]
pub(super) struct LinkRecording<'f> {
    pub file: &'f Recording,
    pub markers: &'f [LinkMarker],
    /// Floor tilt that has not been removed from the marker positions.
    pub floor: Turn,
    /// Constant tilt of the link for which the layout has been corrected, if any.
    pub removed: Option<Turn>,
}

/// Corrects a link's poses for the tilt of its suspension if the tilt exceeds what noise explains. Returns the standard
/// errors of its mean about x and y, rad; zero if there is no tilt to correct.
pub(super) fn set_upright(link: LinkRecording<'_>, rate_hz: f64, fits: &mut [LinkFit]) -> [f64; 2] {
    let rows = ((WINDOW_S * rate_hz / PARTS_PER_WINDOW as f64) as usize).max(1);
    let turns = changing_turns(&link.parts(rows, fits), link.removed);
    let Some(Turns { changes_rad, mean_se_rad }) = turns else { return [0.0; 2] };
    for (row, fit) in fits.iter_mut().enumerate() {
        // The tilt with the index of a part is that at the beginning of the part, the centre of the window.
        let position = row as f64 / rows as f64;
        let before = (position as usize).min(changes_rad.len() - 1);
        let after = (before + 1).min(changes_rad.len() - 1);
        let part = position - before as f64;
        let turn_rad =
            [0, 1].map(|i| (1.0 - part) * changes_rad[before][i] + part * changes_rad[after][i]);
        link.set_upright(row, fit, turn_rad);
    }
    mean_se_rad
}

/// Returns the changes in link 0's pose, the same in all frames, if its mean tilt about x and about y, respectively,
/// changes by one standard error (rad). The pose is that in the row in which most markers are visible.
pub(super) fn mean_shifts(
    link: LinkRecording<'_>,
    fits: &[LinkFit],
    [about_x, about_y]: [f64; 2],
) -> [PoseShift; 2] {
    let posed = fits.iter().enumerate().filter_map(|(row, fit)| Some((row, fit, fit.pose()?)));
    let Some((row, fit, before)) =
        posed.max_by(|(.., a), (.., b)| a.moments.markers.total_cmp(&b.moments.markers))
    else {
        return Default::default();
    };
    [[about_x, 0.0], [0.0, about_y]].map(|turn_rad| {
        let mut upright = *fit;
        link.set_upright(row, &mut upright, turn_rad);
        let after = upright.pose().unwrap_or(before);
        let moved_mm = [0, 1].map(|axis| after.origin_mm[axis] - before.origin_mm[axis]);
        let mut shift = PoseShift {
            moved_m: rotated(-before.theta_rad, moved_mm).map(|mm| mm / 1000.0),
            ..PoseShift::default()
        };
        shift.turned_rad[0] = after.theta_rad - before.theta_rad;
        shift
    })
}

/// Rotations of a link about its x and y axes.
struct Turns {
    /// Differences from their means at the beginning of each part, rad.
    changes_rad: Vec<[f64; 2]>,
    /// Standard errors of the means, rad.
    mean_se_rad: [f64; 2],
}

/// Estimates a link's rotations from the heights in the `parts`; `None` if noise alone explains the rotations. Where a
/// window gives no rotation, the preceding one is repeated; before the first one, the mean is assumed.
///
/// The means are those of the suspension over long times, not those over the trial: a trial is as short as a few
/// swings, and its own mean would appear as a constant displacement of the markers. If a constant tilt has been
/// removed by correcting the layout, it takes the place of the means.
fn changing_turns(parts: &[NormalEquations<3>], removed: Option<Turn>) -> Option<Turns> {
    let windows: Vec<Option<[Estimate; 2]>> = (0..parts.len())
        .map(|begin| {
            let range = begin.saturating_sub(PARTS_PER_WINDOW / 2)
                ..(begin + PARTS_PER_WINDOW / 2).min(parts.len());
            turn(&NormalEquations::sum(parts[range].iter()))
        })
        .collect();
    let axes = [0, 1].map(|axis| {
        let found: Vec<Estimate> = windows.iter().flatten().map(|turn| turn[axis]).collect();
        let average = mean(found.iter().map(|turn| turn.value));
        let squares: f64 = found.iter().map(|turn| (turn.value - average).powi(2)).sum();
        let noise: f64 = found.iter().map(|turn| turn.se * turn.se).sum();
        [squares, noise]
    });
    let [[squares_x, noise_x], [squares_y, noise_y]] = axes;
    if squares_x + squares_y <= MIN_VARIANCE_RATIO * (noise_x + noise_y) {
        return None;
    }
    let count = windows.iter().flatten().count() as f64;
    let means = [0, 1].map(|axis| match removed {
        Some(Turn { about_rad, se_rad }) => Estimate::new(about_rad[axis], se_rad),
        None => {
            // Only windows that do not overlap have independent noise.
            let apart = windows.iter().skip(PARTS_PER_WINDOW / 2).step_by(PARTS_PER_WINDOW);
            let turns = apart.map(|window| window.map_or(f64::NAN, |turn| turn[axis].value));
            mean_of_oscillation(&turns.collect::<Vec<_>>(), axes[axis][1] / count)
        }
    });
    if means.iter().any(|mean| mean.value.is_nan()) {
        return None;
    }
    let mut last = [0.0; 2];
    let changes = windows.iter().map(|window| {
        last = window.map_or(last, |turn| [0, 1].map(|i| turn[i].value - means[i].value));
        last
    });
    Some(Turns { changes_rad: changes.collect(), mean_se_rad: means.map(|mean| mean.se) })
}

/// Solves for a link's rotations about its x and y axes, rad; `None` if the heights do not determine them well enough.
fn turn(heights: &NormalEquations<3>) -> Option<[Estimate; 2]> {
    let (found, inverse) = heights.solve()?;
    let variance = heights.residual_squares(&found) / (heights.count - 3.0).max(1.0);
    let turns = [1, 2].map(|i| Estimate::new(found[i], (variance * inverse[(i, i)]).sqrt()));
    (turns[0].se.hypot(turns[1].se) < MAX_SE_RAD).then_some(turns)
}

impl LinkRecording<'_> {
    /// Sets up the equations for the markers' heights relative to the layout, with a constant and the rotations about x
    /// and y as unknowns, for parts of `rows` rows each.
    fn parts(&self, rows: usize, fits: &[LinkFit]) -> Vec<NormalEquations<3>> {
        let begin = fits.iter().position(LinkFit::is_posed).unwrap_or(0);
        let [a, b] = self.floor.about_rad;
        let start = fits.get(begin).and_then(LinkFit::pose);
        let [x0, y0] = start.map_or([0.0; 2], |pose| pose.origin_mm);
        let mut parts = vec![NormalEquations::new(); fits.len().div_ceil(rows)];
        for marker in self.markers {
            let [x, y] = marker.local_position_mm;
            let column = Vector3::new(1.0, y, -x);
            for (part, (i, fits)) in parts.iter_mut().zip(fits.chunks(rows).enumerate()) {
                let mut count = 0.0;
                let mut sum = 0.0;
                let mut squares = 0.0;
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

    /// Replaces the pose in a row by that of the link with its rotations about the x and y axes removed.
    fn set_upright(&self, row: usize, fit: &mut LinkFit, [about_x, about_y]: [f64; 2]) {
        let Some(mut pose) = fit.pose() else { return };
        let centre = pose.moments.centre_mm;
        // A marker at height z is displaced by z times this vector.
        let shift = [about_y, -about_x];
        let mut heights = 0.0;
        let mut turning = 0.0;
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
        // Centroid of the markers of the upright link, relative to the uncorrected axle.
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
        let markers = layout.values().enumerate();
        markers
            .map(|(column, &[x, y, z])| LinkMarker {
                column,
                local_position_mm: [x, y],
                height_mm: z,
            })
            .collect()
    }

    /// Creates a recording, with camera noise, of a link that does not move except for its tilt.
    fn record(tilt_rad: f64, noise_mm: f64) -> Recording {
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
        // Some markers are occasionally occluded, and once two of the four are for two seconds.
        for i in (0..positions_mm.len()).step_by(37) {
            positions_mm[i] = [f64::NAN; 3];
        }
        for i in (4 * 1000..4 * 1240).filter(|i| i % 4 < 2) {
            positions_mm[i] = [f64::NAN; 3];
        }
        let labels = (0..markers().len()).map(|i| i.to_string()).collect();
        Recording::new(Some(RATE_HZ), (0..ROWS as i64).collect(), labels, positions_mm)
    }

    /// Fits the poses in the first rows of a recording.
    fn fit(file: &Recording, rows: usize) -> Vec<LinkFit> {
        (0..rows).map(|row| LinkFit::from_row(file.row_mm(row), &markers())).collect()
    }

    fn correct(file: &Recording, fits: &mut [LinkFit], removed: Option<Turn>) -> [PoseShift; 2] {
        let markers = markers();
        let link = LinkRecording { file, markers: &markers, floor: Turn::default(), removed };
        let mean_se_rad = set_upright(link, RATE_HZ, fits);
        mean_shifts(link, fits, mean_se_rad)
    }

    /// Returns the RMS errors in the link's axle position, mm, and heading, rad, before and after the correction.
    fn errors(file: &Recording) -> [[f64; 2]; 2] {
        let mut fits = fit(file, ROWS);
        let rms = |fits: &[LinkFit]| {
            let poses: Vec<rigid::LinkPose> = fits.iter().filter_map(LinkFit::pose).collect();
            let (origin, theta) = TRUE;
            let squares = poses.iter().map(|pose| {
                (pose.origin_mm[0] - origin[0]).powi(2) + (pose.origin_mm[1] - origin[1]).powi(2)
            });
            let position: f64 = squares.sum();
            let heading: f64 = poses.iter().map(|pose| (pose.theta_rad - theta).powi(2)).sum();
            [position, heading].map(|sum| (sum / ROWS as f64).sqrt())
        };
        let before = rms(&fits);
        correct(file, &mut fits, None);
        [before, rms(&fits)]
    }

    #[test]
    fn a_link_that_tilts_on_its_suspension_is_corrected() {
        let [before, after] = errors(&record(0.005, 0.0));
        assert!(before[0] > 0.2 && after[0] < 0.4 * before[0], "{before:?} {after:?}");
        assert!(before[1] > 1e-4 && after[1] < 0.65 * before[1], "{before:?} {after:?}");
        let [before, after] = errors(&record(0.005, 0.2));
        assert!(after[0] < 0.5 * before[0], "{before:?} {after:?}");
    }

    #[test]
    fn a_link_that_does_not_tilt_is_not_changed() {
        let [before, after] = errors(&record(0.0, 0.2));
        assert_eq!(before, after);
    }

    /// After the correction, no constant displacement remains beyond its standard error, although the tilt about x and y
    /// has a mean of its own over the one or two swings of the recording.
    #[test]
    fn the_mean_tilt_over_a_few_swings_does_not_displace_the_link() {
        let file = record(0.005, 0.2);
        let mut fits = fit(&file, 1548);
        let mean_m = |fits: &[LinkFit]| {
            let (origin, theta) = TRUE;
            let errors_m = fits.iter().filter_map(LinkFit::pose).map(|pose| {
                rotated(-theta, [0, 1].map(|axis| (pose.origin_mm[axis] - origin[axis]) / 1000.0))
            });
            let errors_m: Vec<[f64; 2]> = errors_m.collect();
            [0, 1].map(|axis| mean(errors_m.iter().map(|error_m| error_m[axis])))
        };
        let before_m = mean_m(&fits);
        let se_m =
            correct(&file, &mut fits, None).map(|PoseShift { moved_m: [x, y], .. }| x.hypot(y));
        let after_m = mean_m(&fits);
        // A rotation about y displaces along x.
        assert!(before_m[0].abs() > 3e-5 && after_m[0].abs() < 0.5 * before_m[0].abs());
        assert!(after_m[0].abs() < 2.0 * se_m[1] && after_m[1].abs() < 2.0 * se_m[0]);
        assert!(se_m.iter().all(|se_m| (1e-6..3e-5).contains(se_m)), "{se_m:?}");
        // If the layout has been corrected for a constant tilt, here of 0, all that is left is removed.
        let mut fits = fit(&file, 1548);
        correct(&file, &mut fits, Some(Turn::default()));
        let after_m = mean_m(&fits);
        assert!(after_m.iter().all(|after_m| after_m.abs() < 1.5e-5), "{after_m:?}");
    }
}
