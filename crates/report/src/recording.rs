//! What was recorded of one trial, frame by frame, from its own tables.

use std::path::Path;

use trilink_mechanics::Pose;
use trilink_tables::{
    Clock, Coordinates, CycleRow, Fill, FrameTexts, Frames as _, LABELS_APART, PoseFrames, Reader,
    StoreError, WheelFrames, poses_path, wheels_path,
};

/// Frames on each side that a velocity is computed from, beside the moving average's.
const DERIVATIVE_REACH: usize = 2;

/// Links, wheels: 0, 1, 2 = middle, front, rear. What is missing is NaN.
#[derive(Debug, Clone, Default)]
pub(crate) struct Recording {
    pub time_s: Vec<f64>,
    pub x_m: Vec<f64>,
    pub y_m: Vec<f64>,
    pub theta_rad: Vec<f64>,
    pub phi_rad: [Vec<f64>; 2],
    pub residual_mm: [Vec<f64>; 3],
    pub fill: [Vec<Fill>; 3],
    /// Labels of the markers that the cameras did not see, and of those that were corrected; empty
    /// where the table does not tell.
    pub unseen: [FrameTexts; 3],
    pub corrected: [FrameTexts; 3],
    /// Without those that are not of whole averages: see [`Recording::read`].
    pub roll_m_s: [Vec<f64>; 3],
    pub skid_m_s: [Vec<f64>; 3],
    /// Empty for trials that are not of kind `gait`.
    pub cycles: Vec<CycleRow>,
    /// Where the tables have other frames than each other.
    pub problem: Option<String>,
}

/// What is known of a marker in a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum MarkerState {
    #[default]
    Seen,
    Missing,
    /// Left out, because it had jumped, or its label was swapped back.
    Corrected,
}

/// Some used cycles in a row.
pub(crate) struct Shown {
    pub start_s: f64,
    pub end_s: f64,
    pub cycles: usize,
    /// Indices of the frames within.
    pub frames: std::ops::Range<usize>,
}

impl Recording {
    /// Reads the tables of a trial and joins them by frame, what one lacks is missing; `None` if
    /// that of poses or of wheels is not there. Velocities at the ends of a recording and beside its gaps,
    /// where the moving average over `smoothing_window` frames shrinks, are mostly noise and left out.
    ///
    /// # Errors
    /// A table cannot be read or lacks a column.
    pub(crate) fn read(
        derived: &Path,
        trial: &str,
        smoothing_window: i64,
        reader: &Reader,
    ) -> Result<Option<Self>, StoreError> {
        let (poses_path, wheels_path) = (poses_path(derived, trial), wheels_path(derived, trial));
        let [poses, wheels] = [&poses_path, &wheels_path].map(|path| reader.table(path));
        let is_absent =
            |table: &Result<_, StoreError>| table.as_ref().is_err_and(StoreError::is_not_there);
        if is_absent(&poses) || is_absent(&wheels) {
            return Ok(None);
        }
        let (poses, wheels) =
            (PoseFrames::from_table(&poses?)?, WheelFrames::from_table(&wheels?)?);
        for (clock, path) in [(&poses.clock, &poses_path), (&wheels.clock, &wheels_path)] {
            if let Some(fall) = fall(clock) {
                let problem = Some(format!("{}: {fall}", path.display()));
                return Ok(Some(Self { problem, ..Self::default() }));
            }
        }
        let PoseFrames { clock: Clock { frame, time_s }, coordinates, residual_mm, .. } = poses;
        let Coordinates { x_m, y_m, theta_rad, phi_rad } = coordinates;
        let of_wheels = wheels.clock.frame;
        let rows: Vec<_> = frame.iter().map(|frame| of_wheels.binary_search(frame).ok()).collect();
        let shared = rows.iter().flatten().count();
        let is_whole = shared == frame.len() && shared == of_wheels.len();
        let by_frame = |values: Vec<f64>| {
            let mut values: Vec<f64> =
                rows.iter().map(|row| row.map_or(f64::NAN, |row| values[row])).collect();
            leave_out_edges(&mut values, smoothing_window);
            values
        };
        Ok(Some(Self {
            time_s,
            x_m,
            y_m,
            theta_rad,
            phi_rad,
            residual_mm,
            fill: poses.fill,
            unseen: poses.unseen,
            corrected: poses.corrected,
            roll_m_s: wheels.velocities.roll_m_s.map(by_frame),
            skid_m_s: wheels.velocities.skid_m_s.map(by_frame),
            cycles: reader.cycles_if_there(derived, trial)?.unwrap_or_default(),
            problem: (!is_whole).then(|| {
                format!(
                    "{}: found {} frames, {shared} of the {} of {}, needed the same ones",
                    wheels_path.display(),
                    of_wheels.len(),
                    frame.len(),
                    poses_path.display()
                )
            }),
        }))
    }

    /// Frames in a second: frames that are left out make steps longer.
    pub(crate) fn rate_hz(&self) -> Option<f64> {
        let steps = self.time_s.windows(2).map(|pair| pair[1] - pair[0]);
        steps.min_by(f64::total_cmp).map(|step_s| 1.0 / step_s)
    }

    /// The first of the longest runs of used cycles, at most so many of them: when it starts
    /// (s) and how many they are.
    fn used_cycles(&self, most: usize) -> Option<(f64, usize)> {
        let follows = |a: &CycleRow, b: &CycleRow| {
            a.used && b.used && a.cycle.checked_add(1) == Some(b.cycle)
        };
        let runs = self.cycles.chunk_by(follows).filter(|run| run[0].used);
        // The last of several is taken, which in reverse is the first.
        let longest = runs.rev().max_by_key(|run| run.len().min(most))?;
        Some((longest[0].start_s, longest.len().min(most)))
    }

    /// The cycles that a figure shows, at most so many of them.
    pub(crate) fn shown(&self, omega_rad_s: f64, most: usize) -> Option<Shown> {
        let (start_s, cycles) = self.used_cycles(most)?;
        let end_s = start_s + cycles as f64 * std::f64::consts::TAU / omega_rad_s;
        Some(Shown { start_s, end_s, cycles, frames: self.between(start_s, end_s) })
    }

    /// Indices of the frames from `from_s` to `to_s`.
    pub(crate) fn between(&self, from_s: f64, to_s: f64) -> std::ops::Range<usize> {
        let first = self.time_s.partition_point(|time_s| *time_s < from_s);
        let last = self.time_s.partition_point(|time_s| *time_s <= to_s);
        first..last.max(first)
    }

    /// The pose of link 0 and the joint angles in a frame, if they are known.
    pub(crate) fn pose(&self, i: usize) -> Option<(Pose, [f64; 2])> {
        let pose = Pose { x_m: self.x_m[i], y_m: self.y_m[i], theta_rad: self.theta_rad[i] };
        let phi_rad = self.phi_rad.each_ref().map(|phi_rad| phi_rad[i]);
        let sum = pose.x_m + pose.y_m + pose.theta_rad + phi_rad[0] + phi_rad[1];
        sum.is_finite().then_some((pose, phi_rad))
    }

    /// What is known of a link's marker in a frame; of a table that does not tell the markers, those
    /// of a link without a pose of its own are missing.
    pub(crate) fn marker(&self, link: usize, label: &str, i: usize) -> MarkerState {
        let names = |all: &[FrameTexts; 3]| {
            let labels = all[link].get(i).filter(|labels| !labels.is_empty());
            labels.is_some_and(|labels| labels.split(LABELS_APART).any(|name| name == label))
        };
        let is_missing = match self.unseen[link].is_empty() {
            true => matches!(self.fill[link].get(i), Some(Fill::Interpolated | Fill::Missing)),
            false => names(&self.unseen),
        };
        match (names(&self.corrected), is_missing) {
            (true, _) => MarkerState::Corrected,
            (false, true) => MarkerState::Missing,
            (false, false) => MarkerState::Seen,
        }
    }

    /// The pose of link 0 at a time, between the frames around it; `None` where there is none.
    pub(crate) fn pose_at(&self, time_s: f64) -> Option<Pose> {
        let after = self.time_s.partition_point(|frame_s| *frame_s < time_s);
        let before = after.saturating_sub(1);
        let (from_s, to_s) = (*self.time_s.get(before)?, *self.time_s.get(after)?);
        let part = if to_s > from_s { (time_s - from_s) / (to_s - from_s) } else { 0.0 };
        let at = |values: &[f64]| values[before] + part * (values[after] - values[before]);
        let pose = Pose { x_m: at(&self.x_m), y_m: at(&self.y_m), theta_rad: at(&self.theta_rad) };
        (pose.x_m + pose.y_m + pose.theta_rad).is_finite().then_some(pose)
    }
}

/// Makes the velocities missing that a moving average over so many frames, which shrinks at the ends of
/// every run without gaps, has a part in; nothing where the width is not known.
fn leave_out_edges(velocities: &mut [f64], smoothing_window: i64) {
    let Some(window) = usize::try_from(smoothing_window).ok().filter(|of| *of > 0) else {
        return;
    };
    let edge = window / 2 + DERIVATIVE_REACH;
    for run in velocities.chunk_by_mut(|a, b| a.is_nan() == b.is_nan()) {
        let frames = run.len();
        run[..edge.min(frames)].fill(f64::NAN);
        run[frames.saturating_sub(edge)..].fill(f64::NAN);
    }
}

/// Where the frames of a table or their times do not rise.
fn fall(Clock { frame, time_s }: &Clock) -> Option<String> {
    let rises = |i: &usize| frame[i - 1] < frame[*i] && time_s[i - 1] < time_s[*i];
    let fall = (1..frame.len()).find(|i| !rises(i))?;
    let [before, after] = [fall - 1, fall].map(|i| format!("{} at {} s", frame[i], time_s[i]));
    Some(format!("found `frame` {after} after {before}, needed frames that rise"))
}

#[cfg(test)]
mod tests {
    use trilink_tables::Columns as _;

    use super::*;

    fn recording(used: &[bool]) -> Recording {
        let cycle = |(i, used): (usize, &bool)| CycleRow {
            cycle: i as i64,
            start_s: 2.0 * i as f64,
            used: *used,
            ..CycleRow::blank()
        };
        Recording { cycles: used.iter().enumerate().map(cycle).collect(), ..Recording::default() }
    }

    #[test]
    fn the_longest_run_of_used_cycles_is_shown_and_of_several_the_first() {
        let used = [false, true, false, true, true, false, true, true];
        assert_eq!(recording(&used).used_cycles(5), Some((6.0, 2)));
        assert_eq!(recording(&used).used_cycles(1), Some((2.0, 1)));
        assert_eq!(recording(&[false; 3]).used_cycles(5), None);
    }

    #[test]
    fn velocities_of_shrunken_averages_are_left_out_at_ends_and_at_gaps() {
        let known = |window: i64, missing: &[usize]| -> Vec<usize> {
            let mut all: Vec<f64> = (0..40).map(f64::from).collect();
            missing.iter().for_each(|&i| all[i] = f64::NAN);
            leave_out_edges(&mut all, window);
            (0..40).filter(|&i| !all[i].is_nan()).collect()
        };
        let frames = |one: std::ops::Range<usize>, other| one.chain(other).collect::<Vec<_>>();
        assert_eq!(known(5, &[]), frames(4..36, 0..0));
        assert_eq!(known(10, &[]), frames(7..33, 0..0));
        assert_eq!(known(5, &[15, 16]), frames(4..11, 21..36));
        // Nothing is left of a short run.
        assert_eq!(known(5, &[15, 24]), frames(4..11, 29..36));
        assert!(known(200, &[]).is_empty());
        for unknown in [0, -3, i64::MIN] {
            assert_eq!(known(unknown, &[20]).len(), 39);
        }
    }

    #[test]
    fn a_pose_between_two_frames_is_between_theirs() {
        let values = vec![0.0, 1.0, 2.0];
        let recording = Recording {
            time_s: values.clone(),
            x_m: values.clone(),
            y_m: vec![0.0, -2.0, f64::NAN],
            theta_rad: values,
            ..Recording::default()
        };
        let pose = recording.pose_at(0.25).expect("between two frames");
        assert_eq!((pose.x_m, pose.y_m), (0.25, -0.5));
        assert!(recording.pose_at(1.5).is_none() && recording.pose_at(7.0).is_none());
    }

    #[test]
    fn a_marker_is_what_the_table_says_and_without_that_as_its_link() {
        let texts = |all: [&str; 3]| FrameTexts::of(all.into_iter(), str::to_owned);
        let none = FrameTexts::default;
        let fill = vec![Fill::Measured, Fill::Interpolated, Fill::Rigid];
        let untold = Recording { fill: [fill.clone(), fill, Vec::new()], ..Recording::default() };
        let told = Recording {
            unseen: [texts(["", "R1, R2", ""]), none(), none()],
            corrected: [texts(["", "", "R10"]), none(), none()],
            ..untold.clone()
        };
        use MarkerState::{Corrected, Missing, Seen};
        let states = |of: &Recording, label| [0, 1, 2].map(|i| of.marker(0, label, i));
        assert_eq!(states(&told, "R2"), [Seen, Missing, Seen]);
        assert_eq!(states(&told, "R3"), [Seen; 3]);
        assert_eq!(states(&told, "R10"), [Seen, Seen, Corrected]);
        assert_eq!(states(&untold, "R3"), [Seen, Missing, Seen]);
    }
}
