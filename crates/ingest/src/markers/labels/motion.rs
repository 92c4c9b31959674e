//! Rows that their markers alone do not settle, settled by the link's motion.

use trilink_statistics::{median_high, wrap};

use super::explain::{Explanation, LinkMarkers};
use super::{LinkFit, Outlier};
use crate::markers::rigid::{LinkPose, MarkerMoments};

/// How far a link's markers may be from where its motion takes them, mm: this, and after more
/// than the first frames so much more for each. A link that begins to turn with 30 rad/s^2, a
/// fast gait's, is off by half of that.
const REACH_MM: f64 = 10.0;
const FIRST_FRAMES: i64 = 4;
const MORE_REACH_MM: f64 = 2.5;
/// How far that motion is followed, frames, and over how many it is measured.
const FOLLOWED_FRAMES: i64 = 30;
const SPEED_FRAMES: std::ops::RangeInclusive<i64> = 3..=10;
/// Frames whose majority decides what is right where nothing else does; how many of them there
/// must be at least, and how near their headings are, rad.
const BEGINNING_FRAMES: i64 = 12;
const BEGINNING_LEAST: usize = 4;
const LIKE_RAD: f64 = 1.0;

impl LinkMarkers<'_> {
    /// Settles rows, forwards and backwards, by where the link was in the frames next to them
    /// that are settled already; first by near ones, which are better known. Rows without such
    /// neighbours stay as they are.
    pub(super) fn settle_by_motion(&self, fits: &mut [LinkFit], unsure: &[usize]) {
        let mut is_sure: Vec<bool> = fits.iter().map(LinkFit::is_posed).collect();
        unsure.iter().for_each(|&row| is_sure[row] = false);
        let mut is_contradicted = vec![false; unsure.len()];
        for (longest, backwards) in [
            (FIRST_FRAMES, false),
            (FIRST_FRAMES, true),
            (FOLLOWED_FRAMES, false),
            (FOLLOWED_FRAMES, true),
        ] {
            for k in 0..unsure.len() {
                let i = if backwards { unsure.len() - 1 - k } else { k };
                // What near frames contradict, far ones, which are less certain, do not excuse.
                let farthest = if is_contradicted[i] { FIRST_FRAMES } else { longest };
                match self.settle(fits, &mut is_sure, unsure[i], backwards, farthest) {
                    Some(is_settled) => is_contradicted[i] = !is_settled,
                    None if !backwards && farthest == FOLLOWED_FRAMES => {
                        self.begin_anew(fits, &mut is_sure, unsure[i]);
                    }
                    None => {}
                }
            }
        }
        for (&row, _) in unsure.iter().zip(is_contradicted).filter(|(_, wrong)| *wrong) {
            fits[row].set(None, Outlier::Ambiguous);
        }
    }

    /// Takes the explanation of a row that is nearest to where the link should be by the sure
    /// frames on one side, `farthest` frames away at most; `false` if that is too far away, `None`
    /// if there are no such frames.
    fn settle(
        &self,
        fits: &mut [LinkFit],
        is_sure: &mut [bool],
        row: usize,
        backwards: bool,
        farthest: i64,
    ) -> Option<bool> {
        if is_sure[row] {
            return Some(true);
        }
        let (predicted, ahead) = self.predict(fits, is_sure, row, backwards, farthest)?;
        let reach_mm = REACH_MM + MORE_REACH_MM * (ahead - FIRST_FRAMES).max(0) as f64;
        let distance = |found: &Explanation| self.distance_mm(&found.pose, &predicted);
        let nearest = self
            .explanations(row)
            .into_iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .filter(|nearest| distance(nearest) <= reach_mm);
        if let Some(Explanation { outlier, pose, .. }) = nearest {
            fits[row].set(Some(pose), outlier);
            is_sure[row] = true;
        }
        Some(is_sure[row])
    }

    /// After a long time without the link, or at its first frames: if most of the next frames
    /// have a heading like the row's, those of them are sure that move on evenly. Swapped labels
    /// turn a link round, and a jump moves it out of line.
    fn begin_anew(&self, fits: &[LinkFit], is_sure: &mut [bool], row: usize) {
        let Some(first) = fits[row].pose() else { return };
        let frames = &self.file.frames;
        let next: Vec<(usize, LinkPose)> = (row..frames.len())
            .take_while(|&other| frames[other] - frames[row] <= BEGINNING_FRAMES)
            .filter_map(|other| Some((other, fits[other].pose()?)))
            .collect();
        let turn = |pose: &LinkPose| wrap(pose.theta_rad - first.theta_rad);
        let alike: Vec<(usize, LinkPose)> =
            next.iter().filter(|(_, pose)| turn(pose).abs() < LIKE_RAD).copied().collect();
        if alike.len() < BEGINNING_LEAST || 2 * alike.len() <= next.len() {
            return;
        }
        let time = |other: usize| (frames[other] - frames[row]) as f64;
        let line = |value: &dyn Fn(&LinkPose) -> f64| {
            line(alike.iter().map(|(other, pose)| (time(*other), value(pose))).collect())
        };
        let [x, y] = [0, 1].map(|axis| line(&|pose| pose.origin_mm[axis]));
        let heading = line(&turn);
        for (other, pose) in &alike {
            let even = LinkPose {
                origin_mm: [x, y].map(|(start, speed)| start + speed * time(*other)),
                theta_rad: first.theta_rad + heading.0 + heading.1 * time(*other),
                ..first
            };
            is_sure[*other] |= self.distance_mm(pose, &even) <= REACH_MM;
        }
    }

    /// Where the motion of the frames before a row, or of those after it, takes the link, and
    /// over how many frames it was followed.
    fn predict(
        &self,
        fits: &[LinkFit],
        is_sure: &[bool],
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
        // The sure rows from one on, with how many frames they are away.
        let sure = |from: usize, farthest: i64| {
            (1..)
                .map_while(move |k| neighbour(from, k))
                .map(move |other| (other, (frames[from] - frames[other]).abs()))
                .take_while(move |(_, away)| *away <= farthest)
                .filter(|(other, _)| is_sure[*other])
        };
        let (last, ahead) = sure(row, farthest).next()?;
        let (earlier, apart) =
            sure(last, *SPEED_FRAMES.end()).find(|(_, apart)| SPEED_FRAMES.contains(apart))?;
        let (last, earlier) = (fits[last].pose()?, fits[earlier].pose()?);
        let steps = ahead as f64 / apart as f64;
        let on = |a: f64, b: f64| a + steps * (a - b);
        let predicted = LinkPose {
            origin_mm: [0, 1].map(|axis| on(last.origin_mm[axis], earlier.origin_mm[axis])),
            theta_rad: last.theta_rad + steps * wrap(last.theta_rad - earlier.theta_rad),
            residual_mm: 0.0,
            moments: MarkerMoments::default(),
        };
        Some((predicted, ahead))
    }
}

/// Start and slope of a straight line through points of different times, half of which may be
/// anywhere (Theil and Sen).
fn line(points: Vec<(f64, f64)>) -> (f64, f64) {
    let slopes = points.iter().enumerate().flat_map(|(i, (t, y))| {
        points[..i].iter().map(move |(before, value)| (y - value) / (t - before))
    });
    let slope = median_high(slopes.collect());
    (median_high(points.iter().map(|(t, y)| y - slope * t).collect()), slope)
}
