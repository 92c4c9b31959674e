//! Whether the robot goes on from frame to frame: a knocked camera, rows that were deleted and frames that
//! were held break that, also where the frame numbers do not tell.

use super::track::Coordinates;
use crate::ingest::signals::{self, STEP_GAIN};
use crate::vicon::MarkerFile;

/// Smallest displacement of link 0, m, and smallest turn, rad, that are taken for a jump: a pose that rests
/// on fewer markers than the one before is off by less.
const LEAST_JUMP_M: f64 = 2e-3;
const LEAST_JUMP_RAD: f64 = 0.02;
/// The same in standard deviations of what the recording's noise makes of it.
const DEVIATIONS: f64 = 8.0;
/// What a radian counts where a jump is compared with the motion, m: the length of a link.
const M_PER_RAD: f64 = 0.1;
/// Frames on each side that tell the motion.
const NEAR: usize = 4;
/// Part of a jump that may be unlike the motion before and after it if missing frames are to explain it.
const UNLIKE: f64 = 0.3;
/// Movement of a marker from frame to frame that is not noise of one that is at rest, mm.
const LEAST_MOVED_MM: f64 = 0.1;

/// A place where the robot is further from one frame to the next than it moves before and after.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jump {
    /// The first frame after it, from the recording's first one on.
    pub frame: usize,
    /// By how much link 0 jumps, beside its motion.
    pub displacement_m: f64,
    pub turn_rad: f64,
    /// How many frames of the motion before and after it are as far, if the joints jump with the links.
    pub missing_frames: Option<f64>,
}

/// The jumps of a recording, the farthest first. One at whose place frames are missing is not seen.
pub fn jumps(seen: &Coordinates) -> Vec<Jump> {
    let Coordinates { x_m, y_m, theta_rad, .. } = seen;
    let least = [(x_m, LEAST_JUMP_M), (y_m, LEAST_JUMP_M), (theta_rad, LEAST_JUMP_RAD)]
        .map(|(of, least)| (of, least.max(DEVIATIONS * STEP_GAIN.sqrt() * signals::noise(of))));
    // Over what is no jump yet; 0 where nothing was seen.
    let size = |frame: usize| {
        let over = least.iter().map(|(of, least)| signals::step(of, frame).abs() / least);
        over.fold(0.0, f64::max)
    };
    let frames = 2..seen.len().saturating_sub(1);
    // What a jump leaves beside it is half as large.
    let is_peak = |frame: usize, here: f64| {
        let mut before = frames.start.max(frame.saturating_sub(2))..frame;
        let mut after = frame + 1..frames.end.min(frame + 3);
        before.all(|other| size(other) < here) && after.all(|other| size(other) <= here)
    };
    let sized = frames.clone().map(|frame| (frame, size(frame)));
    let mut found: Vec<_> =
        sized.filter(|&(frame, size)| size > 1.0 && is_peak(frame, size)).collect();
    found.sort_by(|(_, a), (_, b)| b.total_cmp(a));
    found.into_iter().map(|(frame, _)| jump(seen, frame)).collect()
}

/// What the robot does beside its motion between a frame and the one before.
fn jump(seen: &Coordinates, frame: usize) -> Jump {
    let [phi1_rad, phi2_rad] = &seen.phi_rad;
    let coordinates = [
        (&seen.x_m, 1.0),
        (&seen.y_m, 1.0),
        (&seen.theta_rad, M_PER_RAD),
        (phi1_rad, M_PER_RAD),
        (phi2_rad, M_PER_RAD),
    ];
    let (first, last) = (frame.saturating_sub(1 + NEAR), seen.len().min(frame + 1 + NEAR) - 1);
    let jump_m = coordinates.map(|(of, unit)| unit * signals::step(of, frame));
    let moved_m = coordinates.map(|(of, unit)| {
        let before = (of[frame - 1] - of[first]) / (frame - 1 - first) as f64;
        let after = (of[last] - of[frame]) / (last - frame) as f64;
        0.5 * unit * (before + after)
    });
    Jump {
        frame,
        displacement_m: jump_m[0].hypot(jump_m[1]),
        turn_rad: jump_m[2] / M_PER_RAD,
        missing_frames: missing_frames(jump_m, moved_m),
    }
}

/// How many frames of the motion make the jump, if they do.
fn missing_frames<const N: usize>(jump: [f64; N], moved: [f64; N]) -> Option<f64> {
    let dot = |a: [f64; N], b: [f64; N]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let frames = dot(jump, moved) / dot(moved, moved);
    let explained = frames * frames * dot(moved, moved);
    let is_motion = dot(jump, jump) - explained <= UNLIKE * UNLIKE * dot(jump, jump);
    (is_motion && frames > 0.5).then_some(frames)
}

/// How many rows have every marker exactly where the row before has it, although the robot moves before
/// or after.
pub fn repeated_rows(file: &MarkerFile) -> usize {
    let rows = file.frames.len();
    let bits = |row: usize| file.row_mm(row).iter().flatten().map(|mm| mm.to_bits());
    let is_same = |a: usize, b: usize| file.frames[b] == file.frames[a] + 1 && bits(a).eq(bits(b));
    let moved_mm = |a: usize, b: usize| {
        let positions = file.row_mm(a).iter().zip(file.row_mm(b));
        let moved = positions.map(|(a, b)| (b[0] - a[0]).hypot(b[1] - a[1]).hypot(b[2] - a[2]));
        moved.fold(0.0, f64::max)
    };
    let (mut repeated, mut first) = (0, 0);
    for next in 1..=rows {
        let last = next - 1;
        if next < rows && is_same(last, next) {
            continue;
        }
        if last > first {
            let before = if first > 0 { moved_mm(first - 1, first) } else { 0.0 };
            let after = if next < rows { moved_mm(last, next) } else { 0.0 };
            if before.max(after) > LEAST_MOVED_MM {
                repeated += last - first;
            }
        }
        first = next;
    }
    repeated
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: usize = 600;

    /// A robot on its way, seen in the frames that are given, with noise.
    fn recorded(frames: impl Iterator<Item = usize>) -> Coordinates {
        let frames: Vec<f64> = frames.map(|frame| frame as f64).collect();
        let series = |of: &dyn Fn(f64) -> f64, noise: f64| {
            let noisy = |(i, t): (usize, &f64)| of(*t) + noise * (17.3 * (i * i) as f64).sin();
            frames.iter().enumerate().map(noisy).collect::<Vec<f64>>()
        };
        let phase = |t: f64| 4.0 * t / 120.0;
        Coordinates {
            x_m: series(&|t| 2e-3 * t, 1e-4),
            y_m: series(&|t| 0.01 * phase(t).sin(), 1e-4),
            theta_rad: series(&|t| 0.1 * phase(t).cos(), 1e-3),
            phi_rad: [
                series(&|t| 0.5 * phase(t).cos(), 1e-3),
                series(&|t| 0.5 * phase(t).sin(), 1e-3),
            ],
        }
    }

    #[test]
    fn a_recording_that_goes_on_has_no_jump_also_with_gaps() {
        let mut seen = recorded(0..FRAMES);
        assert_eq!(jumps(&seen), []);
        seen.x_m[100..120].fill(f64::NAN);
        seen.y_m[100..120].fill(f64::NAN);
        assert_eq!(jumps(&seen), []);
        assert_eq!(jumps(&recorded(0..3)), []);
        assert_eq!(jumps(&recorded(0..0)), []);
    }

    #[test]
    fn a_camera_that_was_knocked_is_a_jump_of_the_links_alone() {
        let mut seen = recorded(0..FRAMES);
        seen.x_m[321..].iter_mut().for_each(|x| *x += 3e-3);
        seen.y_m[321..].iter_mut().for_each(|y| *y -= 4e-3);
        seen.theta_rad[500..].iter_mut().for_each(|theta| *theta -= 0.05);
        let found = jumps(&seen);
        assert_eq!(found.iter().map(|jump| jump.frame).collect::<Vec<_>>(), [500, 321]);
        assert!((found[0].turn_rad + 0.05).abs() < 0.01, "{found:?}");
        assert!((found[1].displacement_m - 5e-3).abs() < 5e-4, "{found:?}");
        assert!(found.iter().all(|jump| jump.missing_frames.is_none()), "{found:?}");
    }

    #[test]
    fn rows_that_were_deleted_are_counted_by_the_motion() {
        for missing in [2, 6] {
            let seen = recorded((0..300).chain(300 + missing..FRAMES));
            let found = jumps(&seen);
            assert_eq!(found.len(), 1, "{found:?}");
            assert_eq!(found[0].frame, 300);
            let frames = found[0].missing_frames.unwrap();
            assert!((frames - missing as f64).abs() < 0.5, "{frames} of {missing}");
        }
    }

    /// One marker that moves by so much in each row.
    fn markers(moves_mm: &[f64]) -> MarkerFile {
        let mut at = 0.0;
        let position = |moved: &f64| {
            at += moved;
            [at, 0.0, 30.0]
        };
        MarkerFile {
            rate_hz: Some(120.0),
            frames: (1..=moves_mm.len() as i64).collect(),
            labels: vec!["M1".to_owned()],
            rows_without_frame: 0,
            rows_too_long: 0,
            positions_mm: moves_mm.iter().map(position).collect(),
        }
    }

    #[test]
    fn rows_that_repeat_are_counted_where_the_robot_moves() {
        assert_eq!(repeated_rows(&markers(&[0.0, 1.0, 1.0, 1.0])), 0);
        assert_eq!(repeated_rows(&markers(&[0.0, 0.0, 1.0, 0.0, 1.0, 0.0])), 3);
        // Until the end of the file.
        assert_eq!(repeated_rows(&markers(&[0.0, 1.0, 0.0, 0.0])), 2);
        // At rest.
        assert_eq!(repeated_rows(&markers(&[0.0, 0.0, 0.05, 0.0])), 0);
        // Unseen, and the same place some frames later.
        let mut unseen = markers(&[0.0, 1.0, 0.0, 1.0, 1.0]);
        unseen.positions_mm[1..3].fill([f64::NAN; 3]);
        assert_eq!(repeated_rows(&unseen), 0);
        let mut later = markers(&[0.0, 1.0, 0.0, 1.0]);
        later.frames = vec![1, 2, 4, 5];
        assert_eq!(repeated_rows(&later), 0);
    }
}
