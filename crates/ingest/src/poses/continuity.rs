//! Whether the robot goes on from frame to frame: a knocked camera, rows that were deleted and frames that
//! were held break that, also where the frame numbers do not tell.

use trilink_mocap::Recording;
use trilink_tables::Coordinates;

use crate::signals;

/// Smallest displacement of link 0, m, and smallest turn, rad, that are taken for a jump in four frames in a
/// row: a pose that rests on fewer markers than the one before is off by less.
const LEAST_JUMP_M: f64 = 2e-3;
const LEAST_JUMP_RAD: f64 = 0.02;
/// The same in standard deviations of what the recording's noise makes of it.
const DEVIATIONS: f64 = 8.0;
/// Frames that tell whether the robot jumps between the third and the fourth of them.
const NEAREST: usize = 6;
/// How large a jump must be without either of the two frames beside it, where it is larger than 1 with both.
const STAYS: f64 = 0.5;
/// Frames that may be hidden at and beside a jump; over more of them the robot may have done anything.
const MOST_HIDDEN: usize = 5;
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
pub(crate) struct Jump {
    /// The last frame before it that shows link 0, and the first after it, from the recording's first one
    /// on.
    pub before: usize,
    pub after: usize,
    /// By how much link 0 jumps, beside its motion.
    pub displacement_m: f64,
    pub turn_rad: f64,
    /// How many frames of the motion before and after it are as far, if the joints jump with the links;
    /// negative where the robot is back where it was.
    pub missing_frames: Option<f64>,
}

/// The jumps of a recording, the farthest first. One beside which more than [`MOST_HIDDEN`] frames are
/// missing is not seen.
pub(super) fn jumps(seen: &Coordinates) -> Vec<Jump> {
    let Coordinates { x_m, y_m, theta_rad, .. } = seen;
    let gain = Step::new([0, 1, 2, 3]).noise_gain();
    let link0 = [(x_m, LEAST_JUMP_M), (y_m, LEAST_JUMP_M), (theta_rad, LEAST_JUMP_RAD)]
        .map(|(of, least)| (of, (least / gain).max(DEVIATIONS * signals::noise(of))));
    // Over what is no jump yet.
    let size = |step: &Step| {
        let over = link0.iter().map(|(of, least)| step.of(of).abs() / least);
        over.fold(0.0, f64::max) / step.noise_gain()
    };
    let frames: Vec<usize> = (0..seen.frames()).filter(|&frame| !x_m[frame].is_nan()).collect();
    let is_near = |near: &[usize]| near[NEAREST - 1] - near[0] <= NEAREST - 1 + MOST_HIDDEN;
    let sized = frames.windows(NEAREST).enumerate().filter(|(_, near)| is_near(near));
    let sized = sized.map(|(nth, near)| (nth, size(&Step::of_nearest(near))));
    let large: Vec<(usize, f64)> = sized.filter(|(_, size)| *size > 1.0).collect();
    // What a jump leaves beside it is smaller.
    let is_beside = |a: usize, b: usize| large[b].0 - large[a].0 <= 2;
    let is_peak = |i: &usize| {
        let mut before = (i.saturating_sub(2)..*i).filter(|&other| is_beside(other, *i));
        let mut after = (i + 1..large.len().min(i + 3)).filter(|&other| is_beside(*i, other));
        before.all(|other| large[other].1 < large[*i].1)
            && after.all(|other| large[other].1 <= large[*i].1)
    };
    let nearest = |i: usize| &frames[large[i].0..large[i].0 + NEAREST];
    let stays = |i: &usize| Step::without_one(nearest(*i)).iter().all(|step| size(step) > STAYS);
    let mut found: Vec<usize> = (0..large.len()).filter(is_peak).filter(stays).collect();
    found.sort_by(|a, b| large[*b].1.total_cmp(&large[*a].1));
    found.into_iter().map(|i| jump(seen, &Step::of_nearest(nearest(i)))).collect()
}

/// Four frames in a row of those that show link 0: what happens between the two in the middle is compared
/// with the motion before and after them.
struct Step {
    frames: [usize; 4],
    /// Of the four positions in their sum.
    weights: [f64; 4],
}

impl Step {
    fn new(frames: [usize; 4]) -> Self {
        let [first, before, after, last] = frames.map(|frame| frame as f64);
        let part = |frames: f64| 0.5 * (after - before) / frames;
        let (of_first, of_last) = (part(before - first), part(last - after));
        Self { frames, weights: [of_first, -1.0 - of_first, 1.0 + of_last, -of_last] }
    }

    /// The four in the middle of the nearest frames.
    fn of_nearest(near: &[usize]) -> Self {
        Self::new([1, 2, 3, 4].map(|i| near[i]))
    }

    /// The same without the first frame after the jump, and without the last before it. Where that one alone is
    /// off the others, as with a marker that was taken for another, nothing is left.
    fn without_one(near: &[usize]) -> [Self; 2] {
        [[1, 2, 4, 5], [0, 1, 3, 4]].map(|of| Self::new(of.map(|i| near[i])))
    }

    /// How far a series goes in the middle, beside its mean motion before and after.
    fn of(&self, series: &[f64]) -> f64 {
        self.frames.iter().zip(self.weights).map(|(&frame, weight)| weight * series[frame]).sum()
    }

    /// How many times the standard deviation of white noise that of the same is.
    fn noise_gain(&self) -> f64 {
        self.weights.iter().map(|weight| weight * weight).sum::<f64>().sqrt()
    }
}

/// What the robot does beside its motion.
fn jump(seen: &Coordinates, step: &Step) -> Jump {
    let Coordinates { x_m, y_m, theta_rad, phi_rad: [phi1_rad, phi2_rad] } = seen;
    let [_, before, after, _] = step.frames;
    let coordinates = [
        (x_m, 1.0),
        (y_m, 1.0),
        (theta_rad, M_PER_RAD),
        (phi1_rad, M_PER_RAD),
        (phi2_rad, M_PER_RAD),
    ];
    let known = coordinates.map(|(of, unit)| {
        jump_and_motion(of, before, after).map(|parts| parts.map(|part| unit * part))
    });
    Jump {
        before,
        after,
        displacement_m: step.of(x_m).hypot(step.of(y_m)),
        turn_rad: step.of(theta_rad),
        missing_frames: missing_frames(known.iter().flatten()),
    }
}

/// How far a coordinate jumps between two frames, and how far it moves in one before and after; `None` of
/// a joint that is hidden there.
fn jump_and_motion(of: &[f64], before: usize, after: usize) -> Option<[f64; 2]> {
    let is_seen = |frame: &usize| !of[*frame].is_nan();
    let first = (before.saturating_sub(NEAR)..before).find(is_seen)?;
    let last = (after + 1..of.len().min(after + 1 + NEAR)).rev().find(is_seen)?;
    let rate = |from: usize, to: usize| (of[to] - of[from]) / (to - from) as f64;
    let moved = 0.5 * (rate(first, before) + rate(after, last));
    let jump = of[after] - of[before] - (after - before) as f64 * moved;
    (!jump.is_nan()).then_some([jump, moved])
}

/// How many frames of the motion, or of its reverse, make the jump, if they do.
fn missing_frames<'c>(coordinates: impl Iterator<Item = &'c [f64; 2]> + Clone) -> Option<f64> {
    let sum = |of: fn(&[f64; 2]) -> f64| coordinates.clone().map(of).sum::<f64>();
    let jumped = sum(|[jump, _]| jump * jump);
    let moved = sum(|[_, moved]| moved * moved);
    let frames = sum(|[jump, moved]| jump * moved) / moved;
    let is_motion = jumped - frames * frames * moved <= UNLIKE * UNLIKE * jumped;
    (is_motion && frames.abs() > 0.5).then_some(frames)
}

/// The rows that have every marker exactly where the row before has it, although the robot moves before
/// or after.
pub(super) fn repeated_rows(file: &Recording) -> Vec<usize> {
    let rows = file.frames.len();
    let bits = |row: usize| file.row_mm(row).iter().flatten().map(|mm| mm.to_bits());
    let is_same = |a: usize, b: usize| file.frames[b] == file.frames[a] + 1 && bits(a).eq(bits(b));
    let moved_mm = |a: usize, b: usize| {
        let positions = file.row_mm(a).iter().zip(file.row_mm(b));
        let moved = positions.map(|(a, b)| (b[0] - a[0]).hypot(b[1] - a[1]).hypot(b[2] - a[2]));
        moved.fold(0.0, f64::max)
    };
    let (mut repeated, mut first) = (Vec::new(), 0);
    for next in 1..=rows {
        let last = next - 1;
        if next < rows && is_same(last, next) {
            continue;
        }
        if last > first {
            let before = if first > 0 { moved_mm(first - 1, first) } else { 0.0 };
            let after = if next < rows { moved_mm(last, next) } else { 0.0 };
            if before.max(after) > LEAST_MOVED_MM {
                repeated.extend(first + 1..=last);
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
        for gap in [100..120, 140..141, 150..155, 157..159, 160..161] {
            hide(&mut seen, gap);
        }
        assert_eq!(jumps(&seen), []);
        assert_eq!(jumps(&recorded(0..3)), []);
        assert_eq!(jumps(&recorded(0..0)), []);
    }

    #[test]
    fn one_frame_that_is_off_the_others_is_no_jump() {
        for off_m in [3e-3, -0.02, 0.3] {
            let mut seen = recorded(0..FRAMES);
            seen.x_m[300] += off_m;
            seen.theta_rad[300] += off_m;
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
    fn a_jump_is_seen_beside_hidden_frames_and_across_some() {
        let whole = recorded((0..300).chain(307..FRAMES));
        let mut joints = whole.clone();
        joints.phi_rad[0][296..300].fill(f64::NAN);
        joints.phi_rad[1][290..310].fill(f64::NAN);
        let (mut beside, mut across, mut wide) = (whole.clone(), whole.clone(), whole);
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

    /// One marker that moves by so much in each row.
    fn markers(moves_mm: &[f64]) -> Recording {
        let mut at = 0.0;
        let position = |moved: &f64| {
            at += moved;
            [at, 0.0, 30.0]
        };
        Recording {
            rate_hz: Some(120.0),
            frames: (1..=moves_mm.len() as i64).collect(),
            labels: vec!["M1".to_owned()],
            rows_without_frame: 0,
            rows_too_long: 0,
            doubts: Vec::new(),
            positions_mm: moves_mm.iter().map(position).collect(),
        }
    }

    #[test]
    fn rows_that_repeat_are_counted_where_the_robot_moves() {
        assert!(repeated_rows(&markers(&[0.0, 1.0, 1.0, 1.0])).is_empty());
        assert_eq!(repeated_rows(&markers(&[0.0, 0.0, 1.0, 0.0, 1.0, 0.0])), [1, 3, 5]);
        // Until the end of the file.
        assert_eq!(repeated_rows(&markers(&[0.0, 1.0, 0.0, 0.0])), [2, 3]);
        // At rest.
        assert!(repeated_rows(&markers(&[0.0, 0.0, 0.05, 0.0])).is_empty());
        // Unseen, and the same place some frames later.
        let mut unseen = markers(&[0.0, 1.0, 0.0, 1.0, 1.0]);
        unseen.positions_mm[1..3].fill([f64::NAN; 3]);
        assert!(repeated_rows(&unseen).is_empty());
        let mut later = markers(&[0.0, 1.0, 0.0, 1.0]);
        later.frames = vec![1, 2, 4, 5];
        assert!(repeated_rows(&later).is_empty());
    }
}
