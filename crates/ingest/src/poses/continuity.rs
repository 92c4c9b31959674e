//! Detects discontinuities in a recording: cameras that were knocked, deleted rows, and held frames, even if the frame
//! numbers do not reveal them.

use trilink_mocap::Recording;
use trilink_tables::Coordinates;

use crate::signals;

/// Minimum displacement of link 0, determined from four consecutive frames, that counts as a jump, m. A change in the
/// number of visible markers displaces the pose by less.
const MIN_JUMP_M: f64 = 2e-3;
/// Minimum rotation of link 0, determined from four consecutive frames, that counts as a jump, rad.
const MIN_JUMP_RAD: f64 = 0.02;
/// Minimum size of a jump, in standard deviations of the noise in its measured size.
const MIN_DEVIATIONS: f64 = 8.0;
/// Number of consecutive visible frames used to decide whether the robot jumps between the third and the fourth of
/// them.
const NEAREST: usize = 6;
/// Minimum size that a jump must keep, relative to the smallest step that counts as a jump, if the frame just before or
/// the frame just after it is left out. With both frames, this relative size must exceed 1.
const MIN_SIZE_WITHOUT_ONE: f64 = 0.5;
/// Maximum number of occluded frames at and next to a jump; with more, the robot's motion across the jump is unknown.
const MAX_HIDDEN: usize = 5;
/// Length by which angles are multiplied to compare them with displacements, m: the length of a link.
const M_PER_RAD: f64 = 0.1;
/// Number of frames on each side of a jump from which the motion is determined.
const MOTION_FRAMES: usize = 4;
/// Maximum deviation of a jump from the motion before and after it, as a fraction of the jump, for missing frames to
/// explain the jump.
const MAX_DEVIATION: f64 = 0.3;
/// Minimum movement of a marker from frame to frame that exceeds the noise of a marker at rest, mm.
const MIN_MOVED_MM: f64 = 0.1;

/// Jump of the robot between two frames, in excess of its motion before and after.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Jump {
    /// Last frame before the jump in which link 0 is visible, counted from the start of the recording.
    pub before: usize,
    /// First frame after the jump in which link 0 is visible, counted from the start of the recording.
    pub after: usize,
    /// Displacement of link 0 in excess of its motion before and after the jump, m.
    pub displacement_m: f64,
    /// Rotation of link 0 in excess of its motion before and after the jump, rad.
    pub turn_rad: f64,
    /// Number of missing frames that would explain the jump by the robot's motion; `None` if the joints do not jump
    /// accordingly. Negative if the robot returns to an earlier position.
    pub missing_frames: Option<f64>,
}

/// Finds the jumps in a recording, the largest first. Jumps with more than [`MAX_HIDDEN`] occluded frames around them
/// are not detected.
pub(super) fn jumps(seen: &Coordinates) -> Vec<Jump> {
    let Coordinates { x_m, y_m, theta_rad, .. } = seen;
    let gain = Step::new([0, 1, 2, 3]).noise_gain();
    let link0 = [(x_m, MIN_JUMP_M), (y_m, MIN_JUMP_M), (theta_rad, MIN_JUMP_RAD)].map(
        |(series, min_jump)| Channel {
            series,
            threshold: (min_jump / gain).max(MIN_DEVIATIONS * signals::noise(series)),
        },
    );
    let frames: Vec<usize> = (0..seen.frames()).filter(|&frame| !x_m[frame].is_nan()).collect();
    let large: Vec<(usize, f64)> = frames
        .windows(NEAREST)
        .enumerate()
        .filter(|(_, near)| near[NEAREST - 1] - near[0] <= NEAREST - 1 + MAX_HIDDEN)
        .map(|(first, near)| (first, jump_size(&link0, &Step::of_nearest(near))))
        .filter(|(_, size)| *size > 1.0)
        .collect();
    let mut found: Vec<usize> = Vec::new();
    for i in (0..large.len()).filter(|&i| is_peak(&large, i)) {
        let near = &frames[large[i].0..large[i].0 + NEAREST];
        let steps = Step::without_one(near);
        if steps.iter().all(|step| jump_size(&link0, step) > MIN_SIZE_WITHOUT_ONE) {
            found.push(i);
        }
    }
    found.sort_by(|a, b| large[*b].1.total_cmp(&large[*a].1));
    found
        .into_iter()
        .map(|i| jump(seen, &Step::of_nearest(&frames[large[i].0..large[i].0 + NEAREST])))
        .collect()
}

/// Coordinate of link 0, with the smallest change in it that counts as a jump.
struct Channel<'s> {
    series: &'s [f64],
    threshold: f64,
}

/// Returns the size of a step relative to the smallest step that counts as a jump.
fn jump_size(link0: &[Channel; 3], step: &Step) -> f64 {
    let ratios = link0.iter().map(|channel| step.apply(channel.series).abs() / channel.threshold);
    ratios.fold(0.0, f64::max) / step.noise_gain()
}

/// Returns whether step `i` of `large`, which lists positions and sizes of steps, is the largest within two positions
/// of it: a jump also enlarges neighbouring steps.
fn is_peak(large: &[(usize, f64)], i: usize) -> bool {
    let (first, size) = large[i];
    let mut before = large[i.saturating_sub(2)..i].iter().filter(|(other, _)| first - other <= 2);
    let mut after =
        large[i + 1..large.len().min(i + 3)].iter().filter(|(other, _)| other - first <= 2);
    before.all(|(_, other)| *other < size) && after.all(|(_, other)| *other <= size)
}

/// Step between the two central frames of four in which link 0 is visible, in excess of the motion in the frames before
/// and after.
struct Step {
    frames: [usize; 4],
    /// Weights of the positions at the four frames; their weighted sum is the step.
    weights: [f64; 4],
}

impl Step {
    fn new(frames: [usize; 4]) -> Self {
        let [first, before, after, last] = frames.map(|frame| frame as f64);
        let half_span = 0.5 * (after - before);
        let of_first = half_span / (before - first);
        let of_last = half_span / (last - after);
        Self { frames, weights: [of_first, -1.0 - of_first, 1.0 + of_last, -of_last] }
    }

    /// Creates a step from the four central frames of six.
    fn of_nearest(near: &[usize]) -> Self {
        Self::new([1, 2, 3, 4].map(|i| near[i]))
    }

    /// Creates a step that leaves out the first frame after the jump, and one that leaves out the last frame before it.
    /// If the omitted frame alone deviates from the others, as with a mislabelled marker, the step vanishes.
    fn without_one(near: &[usize]) -> [Self; 2] {
        [[1, 2, 4, 5], [0, 1, 3, 4]].map(|indices| Self::new(indices.map(|i| near[i])))
    }

    /// Returns the change in a series between the two central frames, in excess of its mean motion before and after.
    fn apply(&self, series: &[f64]) -> f64 {
        self.frames.iter().zip(self.weights).map(|(&frame, weight)| weight * series[frame]).sum()
    }

    /// Returns the standard deviation of the step if the series is white noise of unit variance.
    fn noise_gain(&self) -> f64 {
        self.weights.iter().map(|weight| weight * weight).sum::<f64>().sqrt()
    }
}

/// Describes a jump by the changes in the robot's coordinates in excess of its motion.
fn jump(seen: &Coordinates, step: &Step) -> Jump {
    let Coordinates { x_m, y_m, theta_rad, phi_rad } = seen;
    let [_, before, after, _] = step.frames;
    let link0 = [(x_m, 1.0), (y_m, 1.0), (theta_rad, M_PER_RAD)];
    let coordinates = link0.into_iter().chain(phi_rad.iter().map(|phi_rad| (phi_rad, M_PER_RAD)));
    let known = coordinates.map(|(series, unit)| {
        jump_and_motion(series, before, after).map(|values| values.map(|value| unit * value))
    });
    let known: Vec<Option<[f64; 2]>> = known.collect();
    Jump {
        before,
        after,
        displacement_m: step.apply(x_m).hypot(step.apply(y_m)),
        turn_rad: step.apply(theta_rad),
        missing_frames: missing_frames(known.iter().flatten()),
    }
}

/// Returns the jump of a coordinate between two frames, and its mean motion per frame before and after the jump; `None`
/// if the coordinate is occluded at the jump, or throughout the neighbouring frames on either side.
fn jump_and_motion(series: &[f64], before: usize, after: usize) -> Option<[f64; 2]> {
    let is_seen = |frame: &usize| !series[*frame].is_nan();
    let first = (before.saturating_sub(MOTION_FRAMES)..before).find(is_seen)?;
    let last = (after + 1..series.len().min(after + 1 + MOTION_FRAMES)).rev().find(is_seen)?;
    let rate_before = (series[before] - series[first]) / (before - first) as f64;
    let rate_after = (series[last] - series[after]) / (last - after) as f64;
    let moved = 0.5 * (rate_before + rate_after);
    let jump = series[after] - series[before] - (after - before) as f64 * moved;
    (!jump.is_nan()).then_some([jump, moved])
}

/// Returns the number of frames of the robot's motion that explain a jump, negative if the motion is backwards; `None`
/// if no number does. `coordinates` has, for each coordinate, the jump and the motion per frame.
fn missing_frames<'c>(coordinates: impl Iterator<Item = &'c [f64; 2]> + Clone) -> Option<f64> {
    let jumped = coordinates.clone().map(|[jump, _]| jump * jump).sum::<f64>();
    let moved = coordinates.clone().map(|[_, moved]| moved * moved).sum::<f64>();
    let frames = coordinates.map(|[jump, moved]| jump * moved).sum::<f64>() / moved;
    let is_motion = jumped - frames * frames * moved <= MAX_DEVIATION * MAX_DEVIATION * jumped;
    (is_motion && frames.abs() > 0.5).then_some(frames)
}

/// Returns the rows in which every marker has exactly the same position as in the previous frame, even though the robot
/// is moving just before or just after the repeated frames.
pub(super) fn repeated_rows(file: &Recording) -> Vec<usize> {
    let rows = file.frames.len();
    let mut repeated = Vec::new();
    let mut first = 0;
    for next in 1..=rows {
        let last = next - 1;
        if next < rows && is_same(file, last, next) {
            continue;
        }
        if last > first {
            let before = if first > 0 { moved_mm(file, first - 1, first) } else { 0.0 };
            let after = if next < rows { moved_mm(file, last, next) } else { 0.0 };
            if before.max(after) > MIN_MOVED_MM {
                repeated.extend(first + 1..=last);
            }
        }
        first = next;
    }
    repeated
}

/// Returns whether two rows belong to consecutive frames and have identical positions.
fn is_same(file: &Recording, a: usize, b: usize) -> bool {
    let [bits_a, bits_b] =
        [a, b].map(|row| file.row_mm(row).iter().flatten().map(|mm| mm.to_bits()));
    file.frames[b] == file.frames[a] + 1 && bits_a.eq(bits_b)
}

/// Returns the largest displacement of any marker between two rows, mm.
fn moved_mm(file: &Recording, a: usize, b: usize) -> f64 {
    let positions = file.row_mm(a).iter().zip(file.row_mm(b));
    let moved = positions.map(|(a, b)| (b[0] - a[0]).hypot(b[1] - a[1]).hypot(b[2] - a[2]));
    moved.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: usize = 600;

    /// Returns the coordinates of a moving robot in the given frames, with noise.
    fn recorded(frames: impl Iterator<Item = usize>) -> Coordinates {
        let frames: Vec<f64> = frames.map(|frame| frame as f64).collect();
        let series = |value: &dyn Fn(f64) -> f64, noise: f64| {
            let times = frames.iter().enumerate();
            times
                .map(|(i, t)| value(*t) + noise * (17.3 * (i * i) as f64).sin())
                .collect::<Vec<f64>>()
        };
        let phase = |t: f64| 4.0 * t / 120.0;
        Coordinates {
            x_m: series(&|t| 2e-3 * t, 1e-4),
            y_m: series(&|t| 0.01 * phase(t).sin(), 1e-4),
            theta_rad: series(&|t| 0.1 * phase(t).cos(), 1e-3),
            phi_rad: [
                series(&|t| 0.5 * phase(t).cos(), 1e-3),
                series(&|t| 0.5 * phase(t).sin(), 1e-3),
            ]
            .into(),
        }
    }

    #[test]
    fn a_continuous_recording_has_no_jump_even_with_gaps() {
        let mut seen = recorded(0..FRAMES);
        assert_eq!(jumps(&seen), []);
        for gap in [100..120, 140..141, 150..155, 157..159, 160..161] {
            hide(&mut seen, gap);
        }
        assert_eq!(jumps(&seen), []);
        assert_eq!(jumps(&recorded(0..3)), []);
        assert_eq!(jumps(&recorded(0..0)), []);
    }

    #[test]
    fn a_single_outlying_frame_is_no_jump() {
        for offset_m in [3e-3, -0.02, 0.3] {
            let mut seen = recorded(0..FRAMES);
            seen.x_m[300] += offset_m;
            seen.theta_rad[300] += offset_m;
            assert_eq!(jumps(&seen), []);
            hide(&mut seen, 299..300);
            assert_eq!(jumps(&seen), []);
        }
    }

    #[test]
    fn a_camera_that_was_knocked_is_a_jump_of_the_links_alone() {
        let mut seen = recorded(0..FRAMES);
        seen.x_m[321..].iter_mut().for_each(|x| *x += 3e-3);
        seen.y_m[321..].iter_mut().for_each(|y| *y -= 4e-3);
        seen.theta_rad[500..].iter_mut().for_each(|theta| *theta -= 0.05);
        let found = jumps(&seen);
        assert_eq!(found.iter().map(|jump| jump.after).collect::<Vec<_>>(), [500, 321]);
        assert!((found[0].turn_rad + 0.05).abs() < 0.01, "{found:?}");
        assert!((found[1].displacement_m - 5e-3).abs() < 5e-4, "{found:?}");
        assert!(found.iter().all(|jump| jump.missing_frames.is_none()), "{found:?}");
    }

    #[test]
    fn rows_that_were_deleted_or_doubled_are_counted_by_the_motion() {
        for (next, missing) in [(302, 2.0), (306, 6.0), (293, -7.0)] {
            let seen = recorded((0..300).chain(next..FRAMES));
            let found = jumps(&seen);
            assert_eq!(found.len(), 1, "{found:?}");
            assert_eq!((found[0].before, found[0].after), (299, 300));
            let frames = found[0].missing_frames.unwrap();
            assert!((frames - missing).abs() < 0.5, "{frames} of {missing}");
        }
    }

    #[test]
    fn a_jump_is_found_next_to_and_across_occluded_frames() {
        let whole = recorded((0..300).chain(307..FRAMES));
        let mut joints = whole.clone();
        joints.phi_rad[0][296..300].fill(f64::NAN);
        joints.phi_rad[1][290..310].fill(f64::NAN);
        let mut beside = whole.clone();
        let mut across = whole.clone();
        let mut wide = whole;
        hide(&mut beside, 298..299);
        hide(&mut beside, 301..303);
        hide(&mut across, 299..302);
        hide(&mut wide, 297..303);
        for (seen, frames) in [(joints, (299, 300)), (beside, (299, 300)), (across, (298, 302))] {
            let found = jumps(&seen);
            assert_eq!(found.len(), 1, "{found:?}");
            assert_eq!((found[0].before, found[0].after), frames);
            let missing = found[0].missing_frames.unwrap();
            assert!((missing - 7.0).abs() < 0.5, "{missing}");
        }
        assert_eq!(jumps(&wide), []);
    }

    fn hide(seen: &mut Coordinates, frames: std::ops::Range<usize>) {
        for series in [&mut seen.x_m, &mut seen.y_m, &mut seen.theta_rad] {
            series[frames.clone()].fill(f64::NAN);
        }
    }

    /// Returns a recording of one marker that moves by the given distance in each row.
    fn markers(moves_mm: &[f64]) -> Recording {
        let mut at = 0.0;
        let position = |moved: &f64| {
            at += moved;
            [at, 0.0, 30.0]
        };
        let positions_mm = moves_mm.iter().map(position).collect();
        let frames = (1..=moves_mm.len() as i64).collect();
        Recording::new(Some(120.0), frames, vec!["M1".to_owned()], positions_mm)
    }

    #[test]
    fn rows_that_repeat_are_counted_where_the_robot_moves() {
        assert!(repeated_rows(&markers(&[0.0, 1.0, 1.0, 1.0])).is_empty());
        assert_eq!(repeated_rows(&markers(&[0.0, 0.0, 1.0, 0.0, 1.0, 0.0])), [1, 3, 5]);
        // Repeated until the end of the file.
        assert_eq!(repeated_rows(&markers(&[0.0, 1.0, 0.0, 0.0])), [2, 3]);
        // The marker is at rest.
        assert!(repeated_rows(&markers(&[0.0, 0.0, 0.05, 0.0])).is_empty());
        // The marker is occluded and reappears at the same position some frames later.
        let mut unseen = markers(&[0.0, 1.0, 0.0, 1.0, 1.0]);
        unseen.positions_mm[1..3].fill([f64::NAN; 3]);
        assert!(repeated_rows(&unseen).is_empty());
        let mut later = markers(&[0.0, 1.0, 0.0, 1.0]);
        later.frames = vec![1, 2, 4, 5];
        assert!(repeated_rows(&later).is_empty());
    }
}
