//! Weighs the position of a rigid body against its rotation by their noise.
//!
//! A pose from the camera system is processed as the positions of four points of the body ([`trilink_base::body`]), so
//! that everything that holds for markers holds for poses. The points represent the pose exactly, whatever their
//! distance from the origin of the body's frame; the distance only determines the weight of the rotation relative to the
//! position where the links are fitted together. The fit is efficient if the noise of the points is the same in all
//! directions and independent, as that of markers is. Its size, and thus all standard errors, follows from the
//! differences between frames of the fitted poses, as for markers.
//!
//! The noise of a pose is seen in the fourth differences of successive frames, in which the motion of the robot
//! vanishes. A regression of the position's noise on the rotation's gives the point of the body about which the noise
//! turns it: the centroid of the markers that the camera system sees. About this point, position and rotation are
//! independent, and the ratio of their standard deviations is the radius of gyration of equivalent markers.

use trilink_base::body::{self, POINTS};
use trilink_mocap::Recording;
use trilink_robot::rotated;
use trilink_statistics::{median, wrap};

use super::labels::LinkFit;
use super::layout::{Layout, LinkMarker};

/// Weights of a fourth difference. The gain (70) is common to all variances and cancels in their ratios.
const FOURTH: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
/// Squares of differences of the position (x^2 + y^2) and of the rotation, as multiples of their medians, above which a
/// difference is an outlier: 16 variances of normally distributed noise. The medians are 1.386 and 0.4549 variances
/// (chi-squared with two and one degrees of freedom).
const OUTLYING_MEDIANS: [f64; 2] = [16.0 / 1.386, 16.0 / 0.4549];
/// Minimum number of differences from which the noise is estimated.
const MIN_DIFFERENCES: usize = 50;
/// Range of the factor by which the distances of the points from the centre of the noise are multiplied.
const FACTORS: (f64, f64) = (0.1, 20.0);
/// Maximum distance of the centre of the noise from the origin of the body's frame, mm.
const MAX_OFFSET_MM: f64 = 500.0;

/// Moves the points of every rigid body, in the recording and in the layout alike, so that the noise of the poses
/// corresponds to independent noise of the points, the same in all directions. Bodies whose noise cannot be estimated
/// keep their points.
pub(crate) fn balance(file: &mut Recording, layout: &mut Layout) {
    for link in layout {
        for first in 0..link.len().saturating_sub(POINTS - 1) {
            let Some((points, _)) = link[first..].split_first_chunk_mut::<POINTS>() else { break };
            let names = points.each_ref().map(|point| body::of_point(&file.labels[point.column]));
            let is_body = names.iter().enumerate().all(|(i, name)| {
                name.is_some_and(|(body, point)| point == i && Some(body) == names[0].map(|n| n.0))
            });
            if is_body && let Some(noise) = Noise::estimate(file, points) {
                noise.balance(file, points);
            }
        }
    }
}

/// Noise of a rigid body's pose.
struct Noise {
    /// Position, in the frame of the link, of the origin of the body's frame relative to the point about which the
    /// noise turns the body, mm.
    offset_mm: [f64; 2],
    /// Factor by which the points are moved away from that point.
    factor: f64,
}

impl Noise {
    /// Estimates the noise from successive frames; `None` if there are too few or if there is no noise.
    fn estimate(file: &Recording, points: &[LinkMarker; POINTS]) -> Option<Self> {
        let poses: Vec<Option<[f64; 3]>> = (0..file.frames.len())
            .map(|row| {
                let pose = LinkFit::from_row(file.row_mm(row), points).pose()?;
                let [x, y] = pose.at(pose.moments.centre_mm);
                Some([x, y, pose.theta_rad])
            })
            .collect();
        let differences =
            file.frames.windows(5).zip(poses.windows(5)).filter_map(|(frames, poses)| {
                let [.., middle, _, _] = *poses else { return None };
                let [_, _, theta_rad] = middle?;
                let mut difference = [0.0; 3];
                for (pose, weight) in poses.iter().zip(FOURTH) {
                    let [x, y, turned_rad] = (*pose)?;
                    let turn_rad = wrap(turned_rad - theta_rad);
                    for (sum, value) in difference.iter_mut().zip([x, y, turn_rad]) {
                        *sum += weight * value;
                    }
                }
                let [x, y] = rotated(-theta_rad, [difference[0], difference[1]]);
                (frames[4] - frames[0] == 4).then_some([x, y, difference[2]])
            });
        let mut differences: Vec<[f64; 3]> = differences.collect();
        let squares = |[x, y, turn]: &[f64; 3]| [x * x + y * y, turn * turn];
        let limits = [0, 1].map(|i| {
            OUTLYING_MEDIANS[i] * median(differences.iter().map(|d| squares(d)[i]).collect())
        });
        differences.retain(|d| (0..2).all(|i| squares(d)[i] <= limits[i]));
        if differences.len() < MIN_DIFFERENCES {
            return None;
        }
        let sum = |value: &dyn Fn(&[f64; 3]) -> f64| differences.iter().map(value).sum::<f64>();
        let rotation_squares = sum(&|d| d[2] * d[2]);
        let [along, across] = [0, 1].map(|axis| sum(&|d| d[axis] * d[2]) / rotation_squares);
        let position_squares = sum(&|d| d[0] * d[0] + d[1] * d[1])
            - rotation_squares * (along * along + across * across);
        // A rotation moves a point at (x, y) by (-y, x) times the angle.
        let offset_mm = [across, -along];
        // The sum of the squared distances of the points from the vertical axis through their centre is 8 OFFSET_MM^2;
        // the noise requires 4 r^2, with r^2 = position_squares / (2 rotation_squares).
        let factor = (position_squares / (4.0 * rotation_squares)).sqrt() / body::OFFSET_MM;
        let is_plausible =
            factor.is_finite() && factor > 0.0 && offset_mm[0].hypot(offset_mm[1]) <= MAX_OFFSET_MM;
        is_plausible.then(|| Self { offset_mm, factor: factor.clamp(FACTORS.0, FACTORS.1) })
    }

    fn balance(&self, file: &mut Recording, points: &mut [LinkMarker; POINTS]) {
        let [x, y] = self.offset_mm;
        let placed = points.each_ref().map(|point| {
            let [x, y] = point.local_position_mm;
            [x, y, point.height_mm]
        });
        let (_, axes) = body::pose(&placed);
        let offset_in_body = axes.map(|axis| axis[0] * x + axis[1] * y);
        for (point, [x, y, z]) in points.iter_mut().zip(self.moved(&placed, offset_in_body)) {
            point.local_position_mm = [x, y];
            point.height_mm = z;
        }
        let columns = points.each_ref().map(|point| point.column);
        let markers = file.labels.len();
        for row in file.positions_mm.chunks_exact_mut(markers) {
            let moved = self.moved(&columns.map(|column| row[column]), offset_in_body);
            for (column, position_mm) in columns.into_iter().zip(moved) {
                row[column] = position_mm;
            }
        }
    }

    /// Moves the points of a body. `offset` is that of the centre of the noise in the frame of the body.
    fn moved(&self, points: &[[f64; 3]; POINTS], offset: [f64; 3]) -> [[f64; 3]; POINTS] {
        let (origin_mm, axes) = body::pose(points);
        points.map(|point| {
            [0, 1, 2].map(|i| {
                let along = (0..3).map(|k| offset[k] * axes[k][i]).sum::<f64>();
                origin_mm[i] - along + self.factor * (point[i] - origin_mm[i])
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::markers::rigid::LinkPose;

    /// Returns the pose of the link in a row before and after the points of a body are moved, whose frame is turned by
    /// `turn` (roll, pitch and yaw, rad) against the frame of the link.
    fn before_and_after([roll, pitch, turn]: [f64; 3]) -> [LinkPose; 2] {
        const ROWS: usize = 4000;
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut noise = || -> f64 { StandardNormal.sample(&mut random) };
        // Noise of 0.1 mm about a point at (20, -10) from the origin, and of 2 mrad; the equivalent markers are at 50 mm.
        let (place_mm, turn_rad, centre) = (0.1, 2e-3, [20.0, -10.0]);
        let axes = |yaw: f64| body::turned([(2, yaw + turn), (1, pitch), (0, roll)]);
        let pose = |row: usize, noise: [f64; 3]| {
            let yaw = 0.4 * (0.05 * row as f64).sin() + turn_rad * noise[2];
            let back = rotated(yaw, centre);
            let [x, y] = [300.0 * (0.02 * row as f64).cos(), row as f64];
            let fixed = rotated(yaw - turn_rad * noise[2], centre);
            let at = [
                x + fixed[0] - back[0] + place_mm * noise[0],
                y + fixed[1] - back[1] + place_mm * noise[1],
            ];
            body::points([at[0], at[1], 60.0], &axes(yaw))
        };
        let positions_mm =
            (0..ROWS).flat_map(|row| pose(row, [noise(), noise(), noise()])).collect();
        let labels = (0..POINTS).map(|i| body::point_label("body", i)).collect();
        let mut file =
            Recording::new(Some(120.0), (0..ROWS as i64).collect(), labels, positions_mm);
        let placed = body::points([5.0, 6.0, 60.0], &axes(0.0));
        let markers = placed.iter().enumerate().map(|(column, [x, y, z])| LinkMarker {
            column,
            local_position_mm: [*x, *y],
            height_mm: *z,
        });
        let mut layout: Layout = vec![markers.collect(), Vec::new(), Vec::new()];
        let pose = |file: &Recording, layout: &Layout| {
            LinkFit::from_row(file.row_mm(77), &layout[0]).pose().unwrap()
        };
        let before = pose(&file, &layout);
        balance(&mut file, &mut layout);
        [before, pose(&file, &layout)]
    }

    #[test]
    fn points_are_moved_to_where_the_noise_of_the_pose_is_that_of_markers() {
        let [aligned, _] = before_and_after([0.0; 3]);
        let yaw = 30.0_f64.to_radians();
        for turn in [[0.0; 3], [0.0, 0.0, yaw], [0.3, -0.5, yaw]] {
            let poses = before_and_after(turn);
            for pose in poses {
                assert!((pose.theta_rad - aligned.theta_rad).abs() < 1e-12, "{turn:?}");
                let difference_mm = [0, 1].map(|i| pose.origin_mm[i] - aligned.origin_mm[i]);
                assert!(difference_mm.iter().all(|x| x.abs() < 1e-9), "{turn:?} {difference_mm:?}");
            }
            let moments = poses[1].moments;
            let radius_mm = (moments.turning_mm2 / 4.0).sqrt();
            assert!((radius_mm / 50.0 - 1.0).abs() < 0.05, "{turn:?} {radius_mm}");
            let [x, y] = moments.centre_mm;
            assert!((x - 25.0).abs() < 2.0 && (y + 4.0).abs() < 2.0, "{turn:?} {x} {y}");
        }
    }
}
