//! Resolves rows that their markers alone leave undecided, by comparison with the link's motion.

use trilink_statistics::{median_high, wrap};

use super::explain::{Explanation, LinkMarkers};
use super::{LinkFit, Outlier};
use crate::markers::rigid::{LinkPose, MarkerMoments};

/// Maximum distance, mm, of a link's markers from their positions in the extrapolated pose. If a link begins to turn at
/// 30 rad/s^2, as in a fast gait, the distance reaches half of this maximum.
const MAX_DISTANCE_MM: f64 = 10.0;
/// Maximum number of extrapolated frames for which [`MAX_DISTANCE_MM`] applies.
const FIRST_FRAMES: i64 = 4;
/// Increase in the maximum distance for each frame beyond [`FIRST_FRAMES`], mm.
const DISTANCE_PER_FRAME_MM: f64 = 2.5;
/// Maximum number of frames over which the link's motion is extrapolated.
const MAX_EXTRAPOLATED_FRAMES: i64 = 30;
/// Range of the number of frames over which the link's speed is measured.
const SPEED_FRAMES: std::ops::RangeInclusive<i64> = 3..=10;
/// Number of frames, at the start of the recording or after a long gap, whose majority decides which poses are right.
const START_FRAMES: i64 = 12;
/// Minimum number of poses with similar headings that count as a majority at the start of the recording or after a long
/// gap.
const MIN_START_POSES: usize = 4;
/// Maximum difference in heading from the first pose, at the start of the recording or after a long gap, for a pose to
/// count as similar to it, rad.
const MAX_START_TURN_RAD: f64 = 1.0;

/// Pose of a link in one of the rows, at the start of the recording or after a long gap, whose majority decides which
/// poses are right.
struct LinkPoseAt {
    row: usize,
    /// Time since the row that is to be decided, frames.
    time: f64,
    /// Heading relative to that in the row that is to be decided, rad.
    turn_rad: f64,
    pose: LinkPose,
}

impl LinkMarkers<'_> {
    /// Decides the rows `unsure` by the link's motion in neighbouring rows that are already decided. Near neighbours
    /// are tried before distant ones, because extrapolation over fewer frames is more accurate. Rows without such
    /// neighbours keep their poses; rows that contradict the motion lose them.
    pub(super) fn settle_by_motion(&self, fits: &mut [LinkFit], unsure: &[usize]) {
        let mut is_decided: Vec<bool> = fits.iter().map(LinkFit::is_posed).collect();
        unsure.iter().for_each(|&row| is_decided[row] = false);
        let mut is_contradicted = vec![false; unsure.len()];
        for (max_frames, backwards) in [
            (FIRST_FRAMES, false),
            (FIRST_FRAMES, true),
            (MAX_EXTRAPOLATED_FRAMES, false),
            (MAX_EXTRAPOLATED_FRAMES, true),
        ] {
            for k in 0..unsure.len() {
                let i = if backwards { unsure.len() - 1 - k } else { k };
                // If nearby frames contradict a row, distant ones, which are less certain, do not overrule them.
                let farthest = if is_contradicted[i] { FIRST_FRAMES } else { max_frames };
                match self.settle(fits, &mut is_decided, unsure[i], backwards, farthest) {
                    Some(is_settled) => is_contradicted[i] = !is_settled,
                    None if !backwards && farthest == MAX_EXTRAPOLATED_FRAMES => {
                        self.accept_majority(fits, &mut is_decided, unsure[i]);
                    }
                    None => {}
                }
            }
        }
        for (&row, _) in unsure.iter().zip(is_contradicted).filter(|(_, wrong)| *wrong) {
            fits[row].set(None, Outlier::Ambiguous);
        }
    }

    /// Sets the fit of a row to the explanation that is nearest to the pose extrapolated from decided rows before it
    /// or, if `backwards`, after it, at most `farthest` frames away. Returns whether the row is now decided, that is,
    /// whether the nearest explanation is close enough to that pose; `None` if too few such rows exist.
    fn settle(
        &self,
        fits: &mut [LinkFit],
        is_decided: &mut [bool],
        row: usize,
        backwards: bool,
        farthest: i64,
    ) -> Option<bool> {
        if is_decided[row] {
            return Some(true);
        }
        let (predicted, ahead) = self.predict(fits, is_decided, row, backwards, farthest)?;
        let max_distance_mm =
            MAX_DISTANCE_MM + DISTANCE_PER_FRAME_MM * (ahead - FIRST_FRAMES).max(0) as f64;
        let nearest = self
            .explanations(row)
            .into_iter()
            .map(|explanation| (self.distance_mm(&explanation.pose, &predicted), explanation))
            .min_by(|(a, _), (b, _)| a.total_cmp(b))
            .filter(|(distance_mm, _)| *distance_mm <= max_distance_mm);
        if let Some((_, Explanation { outlier, pose, .. })) = nearest {
            fits[row].set(Some(pose), outlier);
            is_decided[row] = true;
        }
        Some(is_decided[row])
    }

    /// Decides rows at the start of the recording or after a long gap, beginning with `row`. If most of the following
    /// poses have headings similar to that in `row`, those among them that fit a uniform motion are accepted: swapped
    /// labels would reverse the heading, and a marker that jumps departs from uniform motion.
    fn accept_majority(&self, fits: &[LinkFit], is_decided: &mut [bool], row: usize) {
        let Some(first) = fits[row].pose() else { return };
        let frames = &self.file.frames;
        let next: Vec<(usize, LinkPose)> = (row..frames.len())
            .take_while(|&other| frames[other] - frames[row] <= START_FRAMES)
            .filter_map(|other| Some((other, fits[other].pose()?)))
            .collect();
        let alike: Vec<LinkPoseAt> = next
            .iter()
            .map(|&(other, pose)| LinkPoseAt {
                row: other,
                time: (frames[other] - frames[row]) as f64,
                turn_rad: wrap(pose.theta_rad - first.theta_rad),
                pose,
            })
            .filter(|at| at.turn_rad.abs() < MAX_START_TURN_RAD)
            .collect();
        if alike.len() < MIN_START_POSES || 2 * alike.len() <= next.len() {
            return;
        }
        let [x, y] = [0, 1].map(|axis| {
            theil_sen(alike.iter().map(|at| (at.time, at.pose.origin_mm[axis])).collect())
        });
        let heading = theil_sen(alike.iter().map(|at| (at.time, at.turn_rad)).collect());
        for LinkPoseAt { row, time, pose, .. } in &alike {
            let uniform = LinkPose {
                origin_mm: [x, y].map(|(start, speed)| start + speed * time),
                theta_rad: first.theta_rad + heading.0 + heading.1 * time,
                ..first
            };
            is_decided[*row] |= self.distance_mm(pose, &uniform) <= MAX_DISTANCE_MM;
        }
    }

    /// Extrapolates the link's pose in a row from the motion in decided rows before it or, if `backwards`, after it, at
    /// most `farthest` frames away. Also returns the number of frames over which the pose is extrapolated; `None` if
    /// too few such rows exist.
    fn predict(
        &self,
        fits: &[LinkFit],
        is_decided: &[bool],
        row: usize,
        backwards: bool,
        farthest: i64,
    ) -> Option<(LinkPose, i64)> {
        let frames = &self.file.frames;
        let neighbour = |from: usize, k: usize| {
            if backwards {
                Some(from + k).filter(|&row| row < frames.len())
            } else {
                from.checked_sub(k)
            }
        };
        // Decided rows on one side of a row, with their distances in frames.
        let decided = |from: usize, farthest: i64| {
            (1..)
                .map_while(move |k| neighbour(from, k))
                .map(move |other| (other, (frames[from] - frames[other]).abs()))
                .take_while(move |(_, away)| *away <= farthest)
                .filter(|(other, _)| is_decided[*other])
        };
        let (last, ahead) = decided(row, farthest).next()?;
        let (earlier, apart) =
            decided(last, *SPEED_FRAMES.end()).find(|(_, apart)| SPEED_FRAMES.contains(apart))?;
        let last = fits[last].pose()?;
        let earlier = fits[earlier].pose()?;
        let steps = ahead as f64 / apart as f64;
        let predicted = LinkPose {
            origin_mm: [0, 1].map(|axis| {
                last.origin_mm[axis] + steps * (last.origin_mm[axis] - earlier.origin_mm[axis])
            }),
            theta_rad: last.theta_rad + steps * wrap(last.theta_rad - earlier.theta_rad),
            residual_mm: 0.0,
            moments: MarkerMoments::default(),
        };
        Some((predicted, ahead))
    }
}

/// Fits a straight line to points at different times and returns its value at time zero and its slope. Up to about 29 %
/// of the points may be outliers (Theil-Sen estimator).
fn theil_sen(points: Vec<(f64, f64)>) -> (f64, f64) {
    let slopes = points.iter().enumerate().flat_map(|(i, (t, y))| {
        points[..i].iter().map(move |(before, value)| (y - value) / (t - before))
    });
    let slope = median_high(slopes.collect());
    (median_high(points.iter().map(|(t, y)| y - slope * t).collect()), slope)
}
