//! Reconstructs the pose of every link in every frame and, from the poses, the robot's coordinates (eq. 1).

use std::ops::Range;

use trilink_mocap::Recording;
use trilink_robot::rotated;
use trilink_statistics::{unwrap, wrap};
use trilink_tables::config::Poses;
use trilink_tables::{Coordinates, Fill};

use super::continuity::{Jump, jumps, repeated_rows};
use super::multibody::{Linkage, PARTS};
use super::suspension::{self, LinkRecording};
use super::tilt::Tilt;
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

/// Changes in a frame's poses if one part of the trial is left out when the joint positions are estimated, for each
/// part: displacement of link 0 along and across its direction, m, and rotations of links 0, 1, 2, rad.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JointShift {
    pub frame: usize,
    pub without: [[f64; 5]; PARTS],
}

/// Poses of the links in every row of a file.
#[derive(Debug)]
pub(crate) struct LinkPoses {
    first_frame: i64,
    /// Number of frames, including those missing from the file.
    frames: usize,
    repeated_frames: Vec<usize>,
    slow_noise_ratio: f64,
    fits: [Vec<LinkFit>; 3],
    pub constant: Constant,
    joint_shifts: Vec<JointShift>,
}

/// Quantities that are constant over a trial.
#[derive(Debug)]
pub(crate) struct Constant {
    /// Tilts of floor and links before their correction.
    pub tilt: Tilt,
    /// Joint positions estimated from the trial; `None` if no robot is given.
    pub joints: Option<Linkage>,
    /// Poses of links 0, 1, 2 in some rows, spread over the trial, in which all links are visible. Each is fitted to
    /// the link's own markers alone, without requiring adjacent links to meet at their joints.
    pub own_poses: Vec<[LinkPose; 3]>,
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
    /// RMS distance between the markers of links 0, 1, 2 and the fitted poses, mm; NaN without a pose.
    pub residual_mm: [Vec<f64>; 3],
    pub fill: [Vec<Fill>; 3],
    /// Label faults of links 0, 1, 2 in every frame.
    pub outlier: [Vec<Outlier>; 3],
    /// Sets of occluded markers on links 0, 1, 2 in every frame. Each bit stands for the marker with that index in the
    /// link's layout.
    pub unseen: [Vec<u64>; 3],
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
/// are estimated from the `steady` rows.
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
    let (mut fits, tilt) = upright_fits(file, layout, rate_hz, steady.clone());
    let refined = linkage.map(|linkage| linkage.refined(&fits, steady.clone()));
    let rows = file.frames.len();
    let stride = (steady.len() / OWN_POSE_SAMPLES).max(1);
    let mut sample = Vec::new();
    for row in steady.step_by(stride) {
        if let [Some(middle), Some(front), Some(rear)] = own_poses(&fits, row) {
            sample.push([middle, front, rear]);
        }
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
        for row in 0..rows {
            let own = own_poses(&fits, row);
            if row % stride == 0
                && let [Some(middle), Some(_), Some(_)] = own
                && let Some(shifts) = joints.shifts(&own, &without)
            {
                // Displacement of link 0 along and across its direction.
                let without = shifts.map(|shift| {
                    let [along_mm, across_mm] = rotated(-middle.theta_rad, [shift[0], shift[1]]);
                    [along_mm / 1000.0, across_mm / 1000.0, shift[2], shift[3], shift[4]]
                });
                joint_shifts.push(JointShift { frame: frame_of(row), without });
            }
            for (fits, pose) in fits.iter_mut().zip(joints.close(own)) {
                let fit = &mut fits[row];
                fit.set(pose, fit.outlier());
            }
        }
    }
    Ok(LinkPoses {
        first_frame,
        frames,
        repeated_frames: repeated_rows(file).into_iter().map(frame_of).collect(),
        slow_noise_ratio,
        fits,
        constant: Constant { tilt, joints: refined.map(|(found, _)| found), own_poses: sample },
        joint_shifts,
    })
}

fn own_poses(fits: &[Vec<LinkFit>; 3], row: usize) -> [Option<LinkPose>; 3] {
    fits.each_ref().map(|fits| fits[row].pose())
}

impl LinkPoses {
    /// Arranges the poses in time, given the frame number of each row, and fills gaps of at most `max_gap` frames.
    ///
    /// # Errors
    /// Returns an error if a link has no pose in any frame.
    pub(crate) fn over_time(
        self,
        numbers: &[i64],
        layout: &Layout,
        max_gap: usize,
    ) -> Result<Tracked, Problem> {
        let Self { first_frame, frames, fits, .. } = self;
        let mut x_m = vec![f64::NAN; frames];
        let mut y_m = vec![f64::NAN; frames];
        let mut theta = [0; 3].map(|_| vec![f64::NAN; frames]);
        let mut residual_mm = [0; 3].map(|_| vec![f64::NAN; frames]);
        let mut fill = [0; 3].map(|_| vec![Fill::Missing; frames]);
        let mut outlier = [0; 3].map(|_| vec![Outlier::None; frames]);
        let all = layout.each_ref().map(|markers| (0..markers.len() as u16).map(bit).sum::<u64>());
        let mut unseen = all.map(|markers| vec![markers; frames]);
        // Consume the fits link by link: those of a long recording take up several hundred megabytes per link.
        for (link, fits) in fits.into_iter().enumerate() {
            for (fit, frame) in fits.iter().zip(numbers) {
                let i = (frame - first_frame) as usize;
                unseen[link][i] = all[link] & !fit.seen;
                outlier[link][i] = fit.outlier();
                let Some(pose) = fit.pose() else { continue };
                theta[link][i] = pose.theta_rad;
                residual_mm[link][i] = pose.residual_mm;
                let is_whole =
                    fit.seen == all[link] && !matches!(fit.outlier(), Outlier::Jumped(_));
                fill[link][i] = if is_whole { Fill::Measured } else { Fill::Rigid };
                if link == 0 {
                    [x_m[i], y_m[i]] = pose.origin_mm.map(|mm| mm / 1000.0);
                }
            }
        }
        if let Some(link) = (0..3).find(|&link| theta[link].iter().all(|x| x.is_nan())) {
            return Err(Problem::LinkUnseen { link });
        }
        theta.iter_mut().for_each(|theta| unwrap(theta));
        // Headings are filled link by link, so that a joint angle is available in all frames in which both headings are
        // visible or filled.
        let filled_theta = theta.each_ref().map(|theta| signals::fill(theta, max_gap));
        for (fill, theta) in fill.iter_mut().flatten().zip(filled_theta.iter().flatten()) {
            if *fill == Fill::Missing && !theta.is_nan() {
                *fill = Fill::Interpolated;
            }
        }
        let mut filled =
            coordinates(signals::fill(&x_m, max_gap), signals::fill(&y_m, max_gap), filled_theta);
        let seen = coordinates(x_m, y_m, theta);
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

/// Fits the poses of links 0, 1, 2 in every row of the file, corrected for the tilt of floor, links and suspensions.
/// Also returns the tilt found in the `steady` rows.
fn upright_fits(
    file: &Recording,
    layout: &Layout,
    rate_hz: f64,
    steady: Range<usize>,
) -> ([Vec<LinkFit>; 3], Tilt) {
    let mut fits = fit_links(file, layout);
    let tilt = Tilt::estimate(file, layout, &fits, steady);
    let (file, layout) = tilt.corrected(file, layout);
    if tilt.is_corrected() {
        fits = fit_links(&file, &layout);
    }
    for (fits, markers) in fits.iter_mut().zip(&*layout) {
        let link = LinkRecording { file: &file, markers, floor: tilt.uncorrected_floor() };
        suspension::set_upright(link, rate_hz, fits);
    }
    (fits, tilt)
}

/// Fits the poses of links 0, 1, 2 in every row of the file, after label correction.
fn fit_links(file: &Recording, layout: &Layout) -> [Vec<LinkFit>; 3] {
    layout.each_ref().map(|markers| {
        let rows = 0..file.frames.len();
        let mut fits =
            rows.map(|row| LinkFit::from_row(file.row_mm(row), markers)).collect::<Vec<_>>();
        correct_labels(file, markers, &mut fits);
        fits
    })
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

/// Computes the robot's coordinates, with the joint angles phi1 and phi2, from the position of link 0 and the headings
/// of links 0, 1, 2: link 1 points along theta - phi1, link 2 along theta + phi2 (eq. 1 of the paper).
fn coordinates(x_m: Vec<f64>, y_m: Vec<f64>, theta: [Vec<f64>; 3]) -> Coordinates {
    let [theta0, theta1, theta2] = theta;
    let phi_rad = [angle_between(&theta0, &theta1), angle_between(&theta2, &theta0)];
    Coordinates { x_m, y_m, theta_rad: theta0, phi_rad }
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
