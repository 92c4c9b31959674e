//! Reconstructs the pose of every link in every frame and, from the poses, the robot's coordinates (eq. 1).

use std::ops::Range;

use trilink_mocap::Recording;
use trilink_robot::rotated;
use trilink_statistics::{unwrap, wrap};
use trilink_tables::config::Poses;
use trilink_tables::{Coordinates, Fill};

use super::continuity::{Jump, jumps, repeated_rows};
use super::multibody::Linkage;
use super::shift::{JointShift, PoseShift};
use super::suspension::{self, LinkRecording};
use super::tilt::{Tilt, Turn};
use crate::error::Problem;
use crate::markers::labels::{LinkFit, Outlier, bit, correct_labels};
use crate::markers::layout::Layout;
use crate::markers::rigid::LinkPose;
use crate::markers::whiteness::{slow_gap_ratio, slow_noise_ratio};
use crate::signals;

/// Maximum number of frames missing from a file, about a quarter of an hour at 120 Hz; a larger number is attributed to
/// a corrupted frame number rather than to a gap in time. In long files the maximum is instead [`MAX_LEFT_OUT_PER_ROW`]
/// times the number of rows, but at most [`MAX_LEFT_OUT_AT_ALL`].
const MAX_LEFT_OUT: i64 = 100_000;
const MAX_LEFT_OUT_PER_ROW: i64 = 10;
const MAX_LEFT_OUT_AT_ALL: i64 = 1_000_000;

/// Number of frames in which the effect of errors in the joint positions is evaluated.
const SHIFT_SAMPLES: usize = 500;
/// Number of rows for which the poses fitted to each link's own markers alone, without requiring adjacent links to meet
/// at their joints, are retained.
const OWN_POSE_SAMPLES: usize = 400;

/// Poses of the links in every row of a file.
#[derive(Debug)]
pub(crate) struct LinkPoses {
    first_frame: i64,
    /// Number of frames, including those missing from the file.
    frames: usize,
    repeated_frames: Vec<usize>,
    slow_noise_ratio: f64,
    fits: Vec<Vec<LinkFit>>,
    /// Numbers of the links from front to rear.
    order: Vec<usize>,
    pub constant: Constant,
    joint_shifts: Vec<JointShift>,
}

/// Quantities that are constant over a trial.
#[derive(Debug)]
pub(crate) struct Constant {
    /// Tilts of floor and links before their correction.
    pub tilt: Tilt,
    /// Changes in link 0's pose for one standard error of its mean tilt about x (first) and about y (second).
    pub tilt_shifts: [PoseShift; 2],
    /// Joint positions estimated from the trial; `None` if no robot is given.
    pub joints: Option<Linkage>,
    /// Poses of the links by number in some rows, spread over the trial, in which all links are visible. Each is fitted
    /// to the link's own markers alone, without requiring adjacent links to meet at their joints.
    pub own_poses: Vec<Vec<LinkPose>>,
}

/// Time series reconstructed from the markers, with one value per frame.
#[derive(Debug)]
pub(crate) struct Tracked {
    pub first_frame: i64,
    pub constant: Constant,
    /// Frames present in the file, in ascending order.
    pub recorded_frames: Vec<usize>,
    /// Frames in which every marker has exactly the same position as in the previous frame, even though the robot is
    /// moving.
    pub repeated_frames: Vec<usize>,
    /// Ratio of the markers' slow noise to that expected for white noise ([`slow_noise_ratio`]).
    pub slow_noise_ratio: f64,
    /// Jumps of the robot between frames, the largest first.
    pub jumps: Vec<Jump>,
    /// Coordinates as recorded, with gaps.
    pub seen: Coordinates,
    /// Coordinates with short gaps filled. The frames within a jump, up to the first frame after it, are left out, so
    /// that nothing is averaged or measured across the jump.
    pub filled: Coordinates,
    /// RMS distance between the markers of each link and the fitted poses, mm; NaN without a pose.
    pub residual_mm: Vec<Vec<f64>>,
    pub fill: Vec<Vec<Fill>>,
    /// Label faults of each link in every frame.
    pub outlier: Vec<Vec<Outlier>>,
    /// Sets of occluded markers on each link in every frame. Each bit stands for the marker with that index in the
    /// link's layout.
    pub unseen: Vec<Vec<u64>>,
    /// Effects of errors in the joint positions on the poses in some frames, spread over the trial; empty if each link
    /// was fitted separately.
    pub joint_shifts: Vec<JointShift>,
    /// Number of markers in the layout.
    markers: usize,
}

impl Tracked {
    /// Returns the number of frames, including those missing from the file.
    pub(crate) fn frames(&self) -> usize {
        self.seen.frames()
    }

    /// Extends a range of frames up to the nearest jumps at which frames may be missing, so that one time base holds
    /// throughout.
    pub(crate) fn on_one_clock(&self, frames: &Range<usize>) -> Range<usize> {
        let jumps = self.jumps.iter().filter(|jump| jump.missing_frames.is_some());
        let earlier = jumps.clone().map(|jump| jump.after).filter(|after| *after <= frames.start);
        let later = jumps.map(|jump| jump.after).filter(|after| *after >= frames.end);
        earlier.max().unwrap_or(0)..later.min().unwrap_or(self.frames())
    }

    /// Returns the fraction of marker positions that the cameras recorded in a range of frames.
    pub(crate) fn coverage(&self, frames: &Range<usize>) -> f64 {
        let all = self.markers * frames.len();
        let masks = self.unseen.iter().flat_map(|masks| &masks[frames.clone()]);
        let unseen = masks.map(|mask| mask.count_ones() as usize).sum::<usize>();
        (all - unseen) as f64 / all as f64
    }
}

/// Fits the link poses in every row: if `poses` is [`Poses::Chain`] and `linkage` is given, such that adjacent links
/// meet at their joints, otherwise each link separately. Tilt and joint positions, which are constant over the trial,
/// are estimated from the `steady` rows. Without a `linkage`, link 0 is taken to be the second link from the front.
///
/// # Errors
/// Returns an error if the frame numbers jump implausibly.
pub(crate) fn solve(
    file: &Recording,
    layout: &Layout,
    linkage: Option<Linkage>,
    poses: Poses,
    rate_hz: f64,
    steady: Range<usize>,
) -> Result<LinkPoses, Problem> {
    let (first_frame, frames) = frame_grid(&file.frames)?;
    let (mut fits, tilt, tilt_shifts) = upright_fits(file, layout, rate_hz, steady.clone());
    let refined = linkage.map(|linkage| linkage.refined(&fits, steady.clone()));
    let rows = file.frames.len();
    let stride = (steady.len() / OWN_POSE_SAMPLES).max(1);
    let mut sample = Vec::new();
    for row in steady.step_by(stride) {
        sample.extend(fits.iter().map(|fits| fits[row].pose()).collect::<Option<Vec<_>>>());
    }
    let frame_of = |row: usize| (file.frames[row] - first_frame) as usize;
    let grid = [first_frame, frames as i64];
    let mut slow_noise_ratio = slow_noise_ratio(file, layout, rate_hz, grid);
    if slow_noise_ratio.is_nan()
        && !file.bodies().is_empty()
        && let Some((joints, _)) = refined
    {
        slow_noise_ratio = slow_gap_ratio(joints.gaps(&fits, &file.frames, grid), rate_hz);
    }
    let mut joint_shifts = Vec::new();
    if let (Poses::Chain, Some((joints, without))) = (poses, refined) {
        let stride = (rows / SHIFT_SAMPLES).max(1);
        let mut poses = vec![None; fits.len()];
        for row in 0..rows {
            for (pose, fits) in poses.iter_mut().zip(&fits) {
                *pose = fits[row].pose();
            }
            if row % stride == 0
                && let Some(middle) = poses[0].or_else(|| closed_reference(&joints, &poses))
                && let Some(shifts) = joints.shifts(&poses, &without)
            {
                let without = shifts.map(|shift| PoseShift {
                    moved_m: rotated(-middle.theta_rad, shift.origin_mm.into())
                        .map(|mm| mm / 1000.0),
                    turned_rad: shift.turn_rad,
                });
                joint_shifts.push(JointShift { frame: frame_of(row), without });
            }
            joints.close(&mut poses);
            for (fits, pose) in fits.iter_mut().zip(&poses) {
                let fit = &mut fits[row];
                fit.set(*pose, fit.outlier());
            }
        }
    }
    let order = match &linkage {
        Some(linkage) => linkage.order().to_vec(),
        None => [1, 0].into_iter().chain(2..fits.len()).collect(),
    };
    Ok(LinkPoses {
        first_frame,
        frames,
        repeated_frames: repeated_rows(file).into_iter().map(frame_of).collect(),
        slow_noise_ratio,
        fits,
        order,
        constant: Constant {
            tilt,
            tilt_shifts,
            joints: refined.map(|(found, _)| found),
            own_poses: sample,
        },
        joint_shifts,
    })
}

/// Returns the pose of link 0 if it has no markers and follows from its neighbours.
fn closed_reference(joints: &Linkage, own: &[Option<LinkPose>]) -> Option<LinkPose> {
    let mut poses = own.to_vec();
    joints.close(&mut poses);
    poses[0]
}

impl LinkPoses {
    /// Arranges the poses in time, given the frame number of each row, and fills gaps of at most `max_gap` frames.
    ///
    /// # Errors
    /// Returns an error if a link with markers has no pose in any frame.
    pub(crate) fn over_time(
        self,
        numbers: &[i64],
        layout: &Layout,
        max_gap: usize,
    ) -> Result<Tracked, Problem> {
        let Self { first_frame, frames, fits, order, .. } = self;
        let links = fits.len();
        let mut x_m = vec![f64::NAN; frames];
        let mut y_m = vec![f64::NAN; frames];
        let mut theta = vec![vec![f64::NAN; frames]; links];
        let mut residual_mm = theta.clone();
        let mut fill = vec![vec![Fill::Missing; frames]; links];
        let mut outlier = vec![vec![Outlier::None; frames]; links];
        let all = layout.iter().map(|markers| (0..markers.len() as u16).map(bit).sum::<u64>());
        let all: Vec<u64> = all.collect();
        let mut unseen: Vec<Vec<u64>> = all.iter().map(|markers| vec![*markers; frames]).collect();
        // Consume the fits link by link: those of a long recording take up several hundred megabytes per link.
        for (link, fits) in fits.into_iter().enumerate() {
            for (fit, frame) in fits.iter().zip(numbers) {
                let i = (frame - first_frame) as usize;
                unseen[link][i] = all[link] & !fit.seen;
                outlier[link][i] = fit.outlier();
                let Some(pose) = fit.pose() else { continue };
                theta[link][i] = pose.theta_rad;
                residual_mm[link][i] = pose.residual_mm;
                // The pose of a link without markers follows from its neighbours.
                let is_whole = fit.seen == all[link]
                    && fit.seen != 0
                    && !matches!(fit.outlier(), Outlier::Jumped(_));
                fill[link][i] = if is_whole { Fill::Measured } else { Fill::Rigid };
                if link == 0 {
                    [x_m[i], y_m[i]] = pose.origin_mm.map(|mm| mm / 1000.0);
                }
            }
        }
        let is_unseen = |link: &usize| theta[*link].iter().all(|x| x.is_nan());
        // The pose of a link without markers follows from its neighbours, which are checked.
        if let Some(link) = (0..links).filter(|link| !layout[*link].is_empty()).find(is_unseen) {
            return Err(Problem::LinkUnseen { link });
        }
        theta.iter_mut().for_each(|theta| unwrap(theta));
        // Headings are filled link by link, so that a joint angle is available in all frames in which both headings are
        // visible or filled.
        let filled_theta: Vec<Vec<f64>> =
            theta.iter().map(|theta| signals::fill(theta, max_gap)).collect();
        for (fill, theta) in fill.iter_mut().flatten().zip(filled_theta.iter().flatten()) {
            if *fill == Fill::Missing && !theta.is_nan() {
                *fill = Fill::Interpolated;
            }
        }
        let [filled_x_m, filled_y_m] = [&x_m, &y_m].map(|series| signals::fill(series, max_gap));
        let mut filled = coordinates(filled_x_m, filled_y_m, filled_theta, &order);
        let seen = coordinates(x_m, y_m, theta, &order);
        let jumps = jumps(&seen);
        for &Jump { before, after, .. } in &jumps {
            filled.leave_out(before + 1..=after);
            fill.iter_mut().for_each(|fill| fill[before + 1..=after].fill(Fill::Missing));
        }
        Ok(Tracked {
            first_frame,
            constant: self.constant,
            recorded_frames: numbers.iter().map(|number| (number - first_frame) as usize).collect(),
            repeated_frames: self.repeated_frames,
            slow_noise_ratio: self.slow_noise_ratio,
            jumps,
            seen,
            filled,
            residual_mm,
            fill,
            outlier,
            unseen,
            joint_shifts: self.joint_shifts,
            markers: layout.iter().map(Vec::len).sum(),
        })
    }
}

/// Fits the poses of all links in every row of the file, corrected for the tilt of floor, links and suspensions.
/// Also returns the tilt found in the `steady` rows and [`Constant::tilt_shifts`].
fn upright_fits(
    file: &Recording,
    layout: &Layout,
    rate_hz: f64,
    steady: Range<usize>,
) -> (Vec<Vec<LinkFit>>, Tilt, [PoseShift; 2]) {
    let mut fits = fit_links(file, layout);
    let tilt = Tilt::estimate(file, layout, &fits, steady);
    let (file, layout) = tilt.corrected(file, layout);
    if tilt.is_corrected() {
        fits = fit_links(&file, &layout);
    }
    let mut tilt_shifts = <[PoseShift; 2]>::default();
    for (number, (fits, markers)) in fits.iter_mut().zip(layout.iter()).enumerate() {
        let floor = tilt.uncorrected_floor();
        let removed = Some(tilt.links[number]).filter(Turn::is_corrected);
        let link = LinkRecording { file: &file, markers, floor, removed };
        let mean_se_rad = suspension::set_upright(link, rate_hz, fits);
        if number == 0 {
            tilt_shifts = suspension::mean_shifts(link, fits, mean_se_rad);
        }
    }
    (fits, tilt, tilt_shifts)
}

/// Fits the poses of all links in every row of the file, after label correction.
fn fit_links(file: &Recording, layout: &Layout) -> Vec<Vec<LinkFit>> {
    let links = layout.iter().map(|markers| {
        let rows = 0..file.frames.len();
        let mut fits =
            rows.map(|row| LinkFit::from_row(file.row_mm(row), markers)).collect::<Vec<_>>();
        correct_labels(file, markers, &mut fits);
        fits
    });
    links.collect()
}

/// Returns the first frame number and the number of frames, including those missing from the file.
///
/// # Errors
/// Returns an error if the frame numbers jump implausibly.
pub fn frame_grid(numbers: &[i64]) -> Result<(i64, usize), Problem> {
    let first = numbers[0];
    let last = numbers[numbers.len() - 1];
    let rows = numbers.len();
    let frames = last - first + 1;
    let max_left_out =
        (MAX_LEFT_OUT_PER_ROW * rows as i64).clamp(MAX_LEFT_OUT, MAX_LEFT_OUT_AT_ALL);
    if frames - rows as i64 > max_left_out {
        return Err(Problem::FrameJumps { first, last, rows });
    }
    Ok((first, frames as usize))
}

/// Computes the robot's coordinates from the position of link 0, the headings of the links by number, and the numbers of
/// the links from front to rear. The angle of a joint is the heading of the link behind it minus that of the link ahead
/// (eq. 1 of the paper).
fn coordinates(
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    mut theta: Vec<Vec<f64>>,
    order: &[usize],
) -> Coordinates {
    let joints = order.windows(2);
    let phi_rad = joints.map(|links| angle_between(&theta[links[1]], &theta[links[0]])).collect();
    Coordinates { x_m, y_m, theta_rad: theta.swap_remove(0), phi_rad }
}

/// Returns the unwrapped difference between two headings, rad, whose first value lies in (-pi, pi].
fn angle_between(minuend: &[f64], subtrahend: &[f64]) -> Vec<f64> {
    let mut phi: Vec<f64> = minuend.iter().zip(subtrahend).map(|(a, b)| a - b).collect();
    if let Some(first) = phi.iter().copied().find(|phi| !phi.is_nan()) {
        let turns = first - wrap(first);
        phi.iter_mut().for_each(|phi| *phi -= turns);
    }
    unwrap(&mut phi);
    phi
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn frames_that_are_left_out_are_counted_and_absurd_jumps_refused() {
        assert_eq!(frame_grid(&[500, 501, 510]).unwrap(), (500, 11));
        assert_eq!(frame_grid(&[19288, 19289, 63268]).unwrap(), (19288, 43981));
        let error =
            frame_grid(&[500, 501, 632680]).unwrap_err().in_file(Path::new("a.csv")).to_string();
        assert_eq!(
            error,
            "a.csv: found frames 500 to 632680 in only 3 rows: \
             the frame numbers jump implausibly"
        );
    }
}
