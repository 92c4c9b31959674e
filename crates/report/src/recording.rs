//! Measured motion of a trial, frame by frame, read from the trial's tables.

use std::path::Path;

use trilink_mechanics::Pose;
use trilink_robot::MAX_JOINTS;
use trilink_robot::metrics::padded;
use trilink_tables::{
    Clock, CycleRow, Fill, FrameTexts, Frames as _, LABELS_APART, PoseFrames, Reader, StoreError,
    WheelFrames, WheelVelocities, WheelVelocityErrors, poses_path, wheels_path,
};

/// Number of frames that numerical differentiation needs on each side of a frame, beyond those of the moving average.
const DERIVATIVE_REACH: usize = 2;

/// Pose of link 0 and the joint angles from front to rear, rad; NaN for joints that the robot lacks.
pub(crate) type Coordinates = (Pose, [f64; MAX_JOINTS]);

/// Measured motion of a trial. Quantities of links and wheels are listed by the number of the link, those of joints from
/// front to rear; missing values are NaN.
#[derive(Debug, Clone, Default)]
pub(crate) struct Recording {
    pub time_s: Vec<f64>,
    pub x_m: Vec<f64>,
    pub y_m: Vec<f64>,
    pub theta_rad: Vec<f64>,
    pub phi_rad: Vec<Vec<f64>>,
    pub residual_mm: Vec<Vec<f64>>,
    pub fill: Vec<Vec<Fill>>,
    /// For each link, the labels of the occluded markers in every frame; empty if the pose table does not contain them.
    pub unseen: Vec<FrameTexts>,
    /// For each link, the labels of the corrected markers in every frame; empty if the pose table does not contain
    /// them.
    pub corrected: Vec<FrameTexts>,
    /// Roll velocities of the wheels; NaN where the moving average is incomplete (see [`Recording::read`]).
    pub roll_m_s: Vec<Vec<f64>>,
    /// Skid velocities of the wheels; NaN where the moving average is incomplete.
    pub skid_m_s: Vec<Vec<f64>>,
    /// Standard errors of both; `None` if the smoothing gives none.
    pub velocity_errors: Option<WheelVelocityErrors>,
    /// Gait cycles; empty for trials that are not of kind `gait`.
    pub cycles: Vec<CycleRow>,
    /// Description of the problem if the tables do not match each other or their frames are out of order.
    pub problem: Option<String>,
}

/// State of a marker in a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum MarkerState {
    #[default]
    Seen,
    Missing,
    /// The marker was rejected as an outlier or corrected for a label swap.
    Corrected,
}

/// Consecutive used cycles shown in a figure.
pub(crate) struct Shown {
    pub start_s: f64,
    pub end_s: f64,
    pub cycles: usize,
    /// Indices of the frames in the cycles shown.
    pub frames: std::ops::Range<usize>,
}

impl Recording {
    /// Reads the tables of a trial and joins them by frame; returns `None` if the pose table or the wheel table does
    /// not exist.
    ///
    /// Values are missing in frames that a table lacks. Velocities are also missing at the ends of the recording and
    /// next to its gaps, where the moving average over `smoothing_window` frames is incomplete and leaves mostly noise.
    ///
    /// # Errors
    /// Returns an error if a table cannot be read or lacks a column.
    pub(crate) fn read(
        derived: &Path,
        trial: &str,
        smoothing_window: i64,
        reader: &Reader,
    ) -> Result<Option<Self>, StoreError> {
        let poses_path = poses_path(derived, trial);
        let wheels_path = wheels_path(derived, trial);
        let [poses, wheels] = [&poses_path, &wheels_path].map(|path| reader.table(path));
        let is_absent =
            |table: &Result<_, StoreError>| table.as_ref().is_err_and(StoreError::is_not_there);
        if is_absent(&poses) || is_absent(&wheels) {
            return Ok(None);
        }
        let poses = PoseFrames::from_table(&poses?)?;
        let wheels = WheelFrames::from_table(&wheels?)?;
        for (clock, path) in [(&poses.clock, &poses_path), (&wheels.clock, &wheels_path)] {
            if let Some(disorder) = disorder(clock) {
                let problem = Some(format!("{}: {disorder}", path.display()));
                return Ok(Some(Self { problem, ..Self::default() }));
            }
        }
        let PoseFrames { clock: Clock { frame, time_s }, coordinates, residual_mm, .. } = poses;
        let trilink_tables::Coordinates { x_m, y_m, theta_rad, phi_rad } = coordinates;
        let of_wheels = wheels.clock.frame;
        let rows: Vec<_> = frame.iter().map(|frame| of_wheels.binary_search(frame).ok()).collect();
        let common = rows.iter().flatten().count();
        let has_same_frames = common == frame.len() && common == of_wheels.len();
        let WheelVelocities { roll_m_s, skid_m_s } = wheels.velocities;
        let of_frames = |values: Vec<f64>| {
            let mut values: Vec<f64> =
                rows.iter().map(|row| row.map_or(f64::NAN, |row| values[row])).collect();
            remove_edges(&mut values, smoothing_window);
            values
        };
        Ok(Some(Self {
            time_s,
            x_m,
            y_m,
            theta_rad,
            phi_rad: phi_rad.0,
            residual_mm: residual_mm.0,
            fill: poses.fill.0,
            unseen: poses.unseen.0,
            corrected: poses.corrected.0,
            roll_m_s: roll_m_s.into_iter().map(of_frames).collect(),
            skid_m_s: skid_m_s.into_iter().map(of_frames).collect(),
            velocity_errors: wheels.errors.map(|errors| WheelVelocityErrors {
                roll_m_s: errors.roll_m_s.into_iter().map(of_frames).collect(),
                skid_m_s: errors.skid_m_s.into_iter().map(of_frames).collect(),
            }),
            cycles: reader.cycles_if_there(derived, trial)?.unwrap_or_default(),
            problem: (!has_same_frames).then(|| {
                format!(
                    "{} and {} must contain the same frames, but they contain {} and {} frames, of which {common} are \
                     in both files",
                    wheels_path.display(),
                    poses_path.display(),
                    of_wheels.len(),
                    frame.len()
                )
            }),
        }))
    }

    /// Returns the frame rate (Hz), computed from the shortest time step because missing frames make steps longer;
    /// `None` if there are fewer than two frames.
    pub(crate) fn rate_hz(&self) -> Option<f64> {
        let steps = self.time_s.windows(2).map(|pair| pair[1] - pair[0]);
        steps.min_by(f64::total_cmp).map(|step_s| 1.0 / step_s)
    }

    /// Returns the start (s) and the number of cycles, at most `max_cycles`, of the longest run of consecutive cycles
    /// in use, or of the first of several equally long runs; `None` if no cycle is in use.
    fn used_cycles(&self, max_cycles: usize) -> Option<(f64, usize)> {
        let runs = self
            .cycles
            .chunk_by(|a, b| a.used && b.used && a.cycle.checked_add(1) == Some(b.cycle))
            .filter(|run| run[0].used);
        // `max_by_key` returns the last of several equal maxima, which is the first run because the order is reversed.
        let longest = runs.rev().max_by_key(|run| run.len().min(max_cycles))?;
        Some((longest[0].start_s, longest.len().min(max_cycles)))
    }

    /// Returns the used cycles that a figure shows, at most `max_cycles`; `None` if no cycle is used.
    pub(crate) fn shown(&self, omega_rad_s: f64, max_cycles: usize) -> Option<Shown> {
        let (start_s, cycles) = self.used_cycles(max_cycles)?;
        let end_s = start_s + cycles as f64 * std::f64::consts::TAU / omega_rad_s;
        Some(Shown { start_s, end_s, cycles, frames: self.between(start_s, end_s) })
    }

    /// Returns the indices of the frames recorded from time `from_s` to time `to_s`.
    pub(crate) fn between(&self, from_s: f64, to_s: f64) -> std::ops::Range<usize> {
        let first = self.time_s.partition_point(|time_s| *time_s < from_s);
        let last = self.time_s.partition_point(|time_s| *time_s <= to_s);
        first..last.max(first)
    }

    /// Returns the pose of link 0 and the joint angles in frame `i`, or `None` if any of them is unknown.
    pub(crate) fn pose(&self, i: usize) -> Option<Coordinates> {
        let pose = Pose { x_m: self.x_m[i], y_m: self.y_m[i], theta_rad: self.theta_rad[i] };
        let phi_rad: Vec<f64> = self.phi_rad.iter().map(|phi_rad| phi_rad[i]).collect();
        let sum = pose.x_m + pose.y_m + pose.theta_rad + phi_rad.iter().sum::<f64>();
        sum.is_finite().then_some((pose, padded(&phi_rad)))
    }

    /// Returns the state of a marker in frame `i`. If the pose table does not contain marker states, all markers of a
    /// link count as missing where the link's pose is interpolated or missing.
    pub(crate) fn marker(&self, link: usize, label: &str, i: usize) -> MarkerState {
        let contains = |all: &[FrameTexts]| {
            let labels = all.get(link).and_then(|labels| labels.get(i));
            let labels = labels.filter(|labels| !labels.is_empty());
            labels.is_some_and(|labels| labels.split(LABELS_APART).any(|name| name == label))
        };
        let is_missing = if self.unseen.get(link).is_none_or(FrameTexts::is_empty) {
            let fill = self.fill.get(link).and_then(|fill| fill.get(i));
            matches!(fill, Some(Fill::Interpolated | Fill::Missing))
        } else {
            contains(&self.unseen)
        };
        if contains(&self.corrected) {
            MarkerState::Corrected
        } else if is_missing {
            MarkerState::Missing
        } else {
            MarkerState::Seen
        }
    }

    /// Returns the pose of link 0 at a given time, interpolated between frames; `None` if the pose is unknown at this
    /// time.
    pub(crate) fn pose_at(&self, time_s: f64) -> Option<Pose> {
        let after = self.time_s.partition_point(|frame_s| *frame_s < time_s);
        let before = after.saturating_sub(1);
        let from_s = *self.time_s.get(before)?;
        let to_s = *self.time_s.get(after)?;
        let fraction = if to_s > from_s { (time_s - from_s) / (to_s - from_s) } else { 0.0 };
        let at = |values: &[f64]| values[before] + fraction * (values[after] - values[before]);
        let pose = Pose { x_m: at(&self.x_m), y_m: at(&self.y_m), theta_rad: at(&self.theta_rad) };
        (pose.x_m + pose.y_m + pose.theta_rad).is_finite().then_some(pose)
    }
}

/// Sets velocities to NaN where the moving average over `smoothing_window` frames is incomplete: at both ends of every
/// run of frames without gaps. Does nothing if `smoothing_window` is not positive (unknown).
fn remove_edges(velocities: &mut [f64], smoothing_window: i64) {
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

/// Describes the first frame whose number or time is not greater than that of the previous frame; returns `None` if the
/// frames are in order.
fn disorder(Clock { frame, time_s }: &Clock) -> Option<String> {
    let mut frames = 1..frame.len();
    let first = frames.find(|&i| !(frame[i - 1] < frame[i] && time_s[i - 1] < time_s[i]))?;
    let [before, after] = [first - 1, first].map(|i| format!("{} at {} s", frame[i], time_s[i]));
    Some(format!("`frame` and `time_s` must increase, but {after} follows {before}"))
}

#[cfg(test)]
mod tests {
    use trilink_tables::Columns as _;

    use super::*;

    fn recording(used: &[bool]) -> Recording {
        Recording {
            cycles: used
                .iter()
                .enumerate()
                .map(|(i, used)| CycleRow {
                    cycle: i as i64,
                    start_s: 2.0 * i as f64,
                    used: *used,
                    ..CycleRow::blank()
                })
                .collect(),
            ..Recording::default()
        }
    }

    #[test]
    fn the_first_of_equally_long_runs_of_used_cycles_is_shown() {
        let used = [false, true, false, true, true, false, true, true];
        assert_eq!(recording(&used).used_cycles(5), Some((6.0, 2)));
        assert_eq!(recording(&used).used_cycles(1), Some((2.0, 1)));
        assert_eq!(recording(&[false; 3]).used_cycles(5), None);
    }

    #[test]
    fn velocities_with_an_incomplete_moving_average_are_removed() {
        let known = |window: i64, missing: &[usize]| -> Vec<usize> {
            let mut all: Vec<f64> = (0..40).map(f64::from).collect();
            missing.iter().for_each(|&i| all[i] = f64::NAN);
            remove_edges(&mut all, window);
            (0..40).filter(|&i| !all[i].is_nan()).collect()
        };
        let frames = |one: std::ops::Range<usize>, other| one.chain(other).collect::<Vec<_>>();
        assert_eq!(known(5, &[]), frames(4..36, 0..0));
        assert_eq!(known(10, &[]), frames(7..33, 0..0));
        assert_eq!(known(5, &[15, 16]), frames(4..11, 21..36));
        // No velocity remains in a run shorter than the window.
        assert_eq!(known(5, &[15, 24]), frames(4..11, 29..36));
        assert!(known(200, &[]).is_empty());
        for unknown in [0, -3, i64::MIN] {
            assert_eq!(known(unknown, &[20]).len(), 39);
        }
    }

    #[test]
    fn poses_are_interpolated_between_two_frames() {
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
    fn marker_states_come_from_the_table_or_else_from_the_pose_of_the_link() {
        let texts = |all: [&str; 3]| FrameTexts::new(all.into_iter(), str::to_owned);
        let none = FrameTexts::default;
        let fill = vec![Fill::Measured, Fill::Interpolated, Fill::Rigid];
        let without_labels =
            Recording { fill: vec![fill.clone(), fill, Vec::new()], ..Recording::default() };
        let with_labels = Recording {
            unseen: vec![texts(["", "R1, R2", ""]), none(), none()],
            corrected: vec![texts(["", "", "R10"]), none(), none()],
            ..without_labels.clone()
        };
        use MarkerState::{Corrected, Missing, Seen};
        let states = |of: &Recording, label| [0, 1, 2].map(|i| of.marker(0, label, i));
        assert_eq!(states(&with_labels, "R2"), [Seen, Missing, Seen]);
        assert_eq!(states(&with_labels, "R3"), [Seen; 3]);
        assert_eq!(states(&with_labels, "R10"), [Seen, Seen, Corrected]);
        assert_eq!(states(&without_labels, "R3"), [Seen, Missing, Seen]);
    }
}
