//! Every link's pose in every frame, and from them the robot's coordinates (eq. 1).

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
use crate::markers::whiteness::slow_noise_ratio;
use crate::signals;

/// Frames that a file may leave out: a quarter of an hour at 120 Hz and, in long files, some
/// times the rows. A wider jump is not a gap in time but a damaged number.
const MOST_LEFT_OUT: i64 = 100_000;
const MOST_LEFT_OUT_PER_ROW: i64 = 10;
const MOST_LEFT_OUT_AT_ALL: i64 = 1_000_000;

/// Frames in which it is looked what other positions of the joints would do.
const SHIFTS: usize = 500;
/// Rows of which the links' own poses are kept.
const OWN_POSES: usize = 400;

/// By how much the links of a frame would be elsewhere if the joints' positions were those that
/// follow without one part of the trial: link 0 along and across itself, m, and the turns of links
/// 0, 1, 2, rad.
#[derive(Debug, Clone, Copy)]
pub(crate) struct JointShift {
    pub frame: usize,
    pub without: [[f64; 5]; PARTS],
}

/// The links' poses in every row of a file.
#[derive(Debug)]
pub(crate) struct LinkPoses {
    first_frame: i64,
    /// With those that the file leaves out.
    frames: usize,
    repeated_frames: Vec<usize>,
    slow_noise_ratio: f64,
    fits: [Vec<LinkFit>; 3],
    pub constant: Constant,
    joint_shifts: Vec<JointShift>,
}

/// What is constant over a trial.
#[derive(Debug)]
pub(crate) struct Constant {
    /// Tilt of floor and links, before it was corrected.
    pub tilt: Tilt,
    /// Where the trial has its joints; unknown without a robot.
    pub joints: Option<Linkage>,
    /// What the links' own markers give in some rows that show all links, spread over the trial:
    /// their joints are not closed.
    pub own_poses: Vec<[LinkPose; 3]>,
}

/// What is known from the markers, frame by frame without jumps in time.
#[derive(Debug)]
pub(crate) struct Tracked {
    pub first_frame: i64,
    pub constant: Constant,
    /// Frames that the file has, rising.
    pub recorded_frames: Vec<usize>,
    /// Those in which every marker is exactly where it was in the row before, although the robot moves.
    pub repeated_frames: Vec<usize>,
    /// What the markers' slow noise is over what white noise would be ([`slow_noise_ratio`]).
    pub slow_noise_ratio: f64,
    /// Where the robot jumps from one frame to the next, the farthest jump first.
    pub jumps: Vec<Jump>,
    /// As seen, and with short gaps filled and the frames to the first one after a jump left out, so that
    /// nothing is averaged or measured across it.
    pub seen: Coordinates,
    pub filled: Coordinates,
    /// RMS misfit of links 0, 1, 2, mm; NaN where there is no fit.
    pub residual_mm: [Vec<f64>; 3],
    pub fill: [Vec<Fill>; 3],
    /// What was wrong with the markers of links 0, 1, 2.
    pub outlier: [Vec<Outlier>; 3],
    /// Which markers of links 0, 1, 2 were not seen: a bit for each by its index in the link's
    /// layout.
    pub unseen: [Vec<u64>; 3],
    /// In some frames, spread over the trial; none without closed joints.
    pub joint_shifts: Vec<JointShift>,
    /// Markers of the layout.
    markers: usize,
}

impl Tracked {
    /// Number of frames, with those that the file leaves out.
    pub(crate) fn frames(&self) -> usize {
        self.seen.frames()
    }

    /// The frames around some of them between which and these no frame numbers may be missing.
    pub(crate) fn on_one_clock(&self, frames: &Range<usize>) -> Range<usize> {
        let jumps = self.jumps.iter().filter(|jump| jump.missing_frames.is_some());
        let earlier = jumps.clone().map(|jump| jump.after).filter(|after| *after <= frames.start);
        let later = jumps.map(|jump| jump.after).filter(|after| *after >= frames.end);
        earlier.max().unwrap_or(0)..later.min().unwrap_or(self.frames())
    }

    /// Part of all markers' frames that the cameras saw.
    pub(crate) fn coverage(&self, frames: &Range<usize>) -> f64 {
        let unseen = |of_link: &Vec<u64>| -> usize {
            of_link[frames.clone()].iter().map(|markers| markers.count_ones() as usize).sum()
        };
        let (all, unseen) =
            (self.markers * frames.len(), self.unseen.iter().map(unseen).sum::<usize>());
        (all - unseen) as f64 / all as f64
    }
}

/// Fits the links in every row, each by itself or all with their joints closed by `linkage`. What is
/// constant over the trial, tilt and the joints' positions, is estimated from the `steady` rows.
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
    let all = |row: usize| match own_poses(&fits, row) {
        [Some(middle), Some(front), Some(rear)] => Some([middle, front, rear]),
        _ => None,
    };
    let stride = (steady.len() / OWN_POSES).max(1);
    let sample = steady.step_by(stride).filter_map(all).collect();
    let frame_of = |row: usize| (file.frames[row] - first_frame) as usize;
    let mut joint_shifts = Vec::new();
    if let (Poses::Chain, Some((joints, without))) = (poses, refined) {
        let stride = (rows / SHIFTS).max(1);
        for row in 0..rows {
            let own = own_poses(&fits, row);
            if row % stride == 0
                && let [Some(middle), Some(_), Some(_)] = own
                && let Some(shifts) = joints.shifts(&own, &without)
            {
                // Link 0 along and across itself.
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
        slow_noise_ratio: slow_noise_ratio(file, layout, rate_hz, [first_frame, frames as i64]),
        fits,
        constant: Constant { tilt, joints: refined.map(|(found, _)| found), own_poses: sample },
        joint_shifts,
    })
}

fn own_poses(fits: &[Vec<LinkFit>; 3], row: usize) -> [Option<LinkPose>; 3] {
    fits.each_ref().map(|fits| fits[row].pose())
}

impl LinkPoses {
    /// The poses in time, given the frame number of each row. Gaps of at most `max_gap` frames are
    /// filled.
    pub(crate) fn over_time(
        self,
        numbers: &[i64],
        layout: &Layout,
        max_gap: usize,
    ) -> Result<Tracked, Problem> {
        let Self { first_frame, frames, fits, .. } = self;
        let missing = || vec![f64::NAN; frames];
        let (mut x_m, mut y_m) = (missing(), missing());
        let (mut theta, mut residual_mm) = ([0; 3].map(|_| missing()), [0; 3].map(|_| missing()));
        let mut fill = [0; 3].map(|_| vec![Fill::Missing; frames]);
        let mut outlier = [0; 3].map(|_| vec![Outlier::None; frames]);
        let all = layout.each_ref().map(|of| (0..of.len() as u16).map(bit).sum::<u64>());
        let mut unseen = all.map(|markers| vec![markers; frames]);
        // Of a long recording each link's are some hundred megabytes.
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
        // Headings are filled link by link, so that a joint angle uses whichever link was seen.
        let fill_gaps = |series: &[f64]| signals::fill(series, max_gap);
        let filled_theta = theta.each_ref().map(|theta| fill_gaps(theta));
        for (fill, theta) in fill.iter_mut().flatten().zip(filled_theta.iter().flatten()) {
            if *fill == Fill::Missing && !theta.is_nan() {
                *fill = Fill::Interpolated;
            }
        }
        let mut filled = coordinates(fill_gaps(&x_m), fill_gaps(&y_m), filled_theta);
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

/// Poses of links 0, 1, 2 in every row of the file, as on a level floor with upright links, and
/// the tilt that was found in the `steady` ones.
fn upright_fits(
    file: &Recording,
    layout: &Layout,
    rate_hz: f64,
    steady: Range<usize>,
) -> ([Vec<LinkFit>; 3], Tilt) {
    let mut fits = fit_links(file, layout);
    let tilt = Tilt::of(file, layout, &fits, steady);
    let (file, layout) = tilt.corrected(file, layout);
    if tilt.is_corrected() {
        fits = fit_links(&file, &layout);
    }
    for (fits, markers) in fits.iter_mut().zip(&*layout) {
        let link = LinkRecording { file: &file, markers, floor: tilt.floor_left() };
        suspension::set_upright(link, rate_hz, fits);
    }
    (fits, tilt)
}

/// Poses of links 0, 1, 2 in every row of the file, without the markers that are wrong.
fn fit_links(file: &Recording, layout: &Layout) -> [Vec<LinkFit>; 3] {
    layout.each_ref().map(|markers| {
        let rows = 0..file.frames.len();
        let mut fits = rows.map(|row| LinkFit::of(file.row_mm(row), markers)).collect::<Vec<_>>();
        correct_labels(file, markers, &mut fits);
        fits
    })
}

/// First frame and number of frames with those that the file leaves out.
pub fn frame_grid(numbers: &[i64]) -> Result<(i64, usize), Problem> {
    let (first, last) = (numbers[0], numbers[numbers.len() - 1]);
    let (frames, rows) = (last - first + 1, numbers.len());
    let most = (MOST_LEFT_OUT_PER_ROW * rows as i64).clamp(MOST_LEFT_OUT, MOST_LEFT_OUT_AT_ALL);
    if frames - rows as i64 > most {
        return Err(Problem::FrameJumps { first, last, rows });
    }
    Ok((first, frames as usize))
}

/// Link 1 points along theta - phi1, link 2 along theta + phi2.
fn coordinates(x_m: Vec<f64>, y_m: Vec<f64>, theta: [Vec<f64>; 3]) -> Coordinates {
    let [theta0, theta1, theta2] = theta;
    let difference = |minuend: &[f64], subtrahend: &[f64]| {
        let mut phi: Vec<f64> = minuend.iter().zip(subtrahend).map(|(a, b)| a - b).collect();
        if let Some(first) = phi.iter().copied().find(|phi| !phi.is_nan()) {
            let turns = first - wrap(first);
            phi.iter_mut().for_each(|phi| *phi -= turns);
        }
        unwrap(&mut phi);
        phi
    };
    let phi_rad = [difference(&theta0, &theta1), difference(&theta2, &theta0)];
    Coordinates { x_m, y_m, theta_rad: theta0, phi_rad }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn frames_that_are_left_out_are_counted_and_absurd_jumps_refused() {
        assert_eq!(frame_grid(&[500, 501, 510]).unwrap(), (500, 11));
        assert_eq!(frame_grid(&[19288, 19289, 63268]).unwrap(), (19288, 43981));
        let error = frame_grid(&[500, 501, 632680]).unwrap_err().of(Path::new("a.csv")).to_string();
        assert_eq!(
            error,
            "a.csv: found frames 500 to 632680 in only 3 rows, \
             needed frame numbers without such jumps"
        );
    }
}
