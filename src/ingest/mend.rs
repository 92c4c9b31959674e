//! Frames in which a marker of a link is where it cannot be: one that has jumped to something
//! else, or two whose labels are swapped.
//!
//! Three markers of a link or more check each other. If they do not lie as the layout says, an
//! explanation is looked for, in this order: two of the labels are swapped (which explains all
//! the markers), or one marker has jumped (which explains all but it). Two markers that agree
//! on their distance do not check each other: they may be swapped, or one of them may have
//! moved about the other. Such frames are compared with where the link was shortly before or
//! after, and so are those with several explanations. What that does not settle is ambiguous:
//! the frame's pose of the link is thrown out, and a gap left.

use super::layout::LinkMarker;
use super::links::wrap;
use super::rigid::{self, LinkPose};
use crate::vicon::MarkerFile;

/// A residual of this many times the link's median residual is no noise. Of three markers with
/// normal noise, one frame in ten million has such a residual.
const MEDIANS: f64 = 5.0;
/// What counts as noise at least, and at most, whatever the median says, mm: markers that agree
/// better than the first are sound, and labels that are swapped in all frames lie above the
/// second.
const TOLERANCE_MM: (f64, f64) = (0.8, 5.0);
/// A residual below this many medians is how the link always looks: it is the layout that is
/// wrong, not the frame.
const USUAL_MEDIANS: f64 = 2.0;
/// Explanations that put no marker farther apart than this are one, mm.
const SAME_MM: f64 = 2.0;
/// How far a link's markers may be from where its motion takes them, mm: this, and after more
/// than the first frames so much more for each. A link that begins to turn with 30 rad/s^2, a
/// fast gait's, is off by half of that.
const REACH_MM: f64 = 10.0;
const FIRST_FRAMES: i64 = 4;
const MORE_REACH_MM: f64 = 2.5;
/// How far that motion is followed, frames, and over how many it is measured.
const FOLLOWED_FRAMES: i64 = 30;
const SPEED_FRAMES: std::ops::RangeInclusive<i64> = 3..=10;
/// Frames that tell, most against few, what is right where nothing else does; how many of them
/// there must be at least, and how near their headings are, rad.
const BEGINNING_FRAMES: i64 = 12;
const BEGINNING_LEAST: usize = 4;
const LIKE_RAD: f64 = 1.0;

/// What was wrong with the markers of a link in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outlier {
    None,
    /// One marker is left out, by its place in the link's layout.
    Jumped(usize),
    /// Two labels are swapped back, by their places in the link's layout.
    Swapped(usize, usize),
    /// The markers contradict each other or the link's motion, and nothing says which is wrong.
    Ambiguous,
}

impl Outlier {
    /// As `poses/<trial>.parquet` writes it.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Jumped(_) => "jumped",
            Self::Swapped(..) => "swapped",
            Self::Ambiguous => "ambiguous",
        }
    }
}

/// One link in one row of the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct LinkFit {
    /// Missing if the markers that were seen give none.
    pub pose: Option<LinkPose>,
    /// Markers seen.
    pub seen: usize,
    pub outlier: Outlier,
}

impl LinkFit {
    /// The fit of all of the link's markers that were seen in a row.
    pub fn of(positions_mm: &[[f64; 3]], markers: &[LinkMarker]) -> Self {
        let pairs = markers.iter().filter_map(|marker| {
            let [x, y, _] = positions_mm[marker.column];
            (!x.is_nan()).then_some((marker.place_mm, [x, y]))
        });
        Self { seen: pairs.clone().count(), pose: rigid::fit(pairs), outlier: Outlier::None }
    }
}

/// An explanation of what was seen.
#[derive(Debug, Clone, Copy)]
struct Explanation {
    outlier: Outlier,
    pose: LinkPose,
    /// Markers whose place it explains.
    explained: usize,
}

/// Finds the rows in which a marker of the link is wrong, and mends them: `fits` are those of
/// all its markers in every row of the file.
pub(super) fn mend(file: &MarkerFile, markers: &[LinkMarker], fits: &mut [LinkFit]) {
    let Some(median_mm) = median_residual(fits) else { return };
    let tolerance_mm = (MEDIANS * median_mm).clamp(TOLERANCE_MM.0, TOLERANCE_MM.1);
    let link = Link { file, markers, tolerance_mm, usual_mm: USUAL_MEDIANS * median_mm };
    let mut unsure = Vec::new();
    for (row, fit) in fits.iter_mut().enumerate() {
        let Some(pose) = fit.pose else { continue };
        if pose.residual_mm <= tolerance_mm {
            if fit.seen < 3 {
                unsure.push(row);
            }
        } else if !link.explain(row, fit) {
            unsure.push(row);
        }
    }
    if !unsure.is_empty() {
        link.follow(fits, &unsure);
    }
}

fn median_residual(fits: &[LinkFit]) -> Option<f64> {
    let mut residuals: Vec<f64> =
        fits.iter().filter_map(|fit| fit.pose).map(|pose| pose.residual_mm).collect();
    if residuals.is_empty() {
        return None;
    }
    let middle = residuals.len() / 2;
    Some(*residuals.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// On which side of a row its link is followed from, and from how many frames away at most.
#[derive(Clone, Copy)]
struct Side {
    backwards: bool,
    farthest: i64,
}

/// A link's markers and what is noise to them.
struct Link<'a> {
    file: &'a MarkerFile,
    markers: &'a [LinkMarker],
    tolerance_mm: f64,
    usual_mm: f64,
}

impl Link<'_> {
    /// Explains a row by its markers alone; whether three markers or more agree on it.
    fn explain(&self, row: usize, fit: &mut LinkFit) -> bool {
        let found = self.explanations(row);
        let most = found.iter().map(|found| found.explained).max().unwrap_or(0);
        let mut best = found.iter().filter(|found| found.explained == most);
        let single = best.next().filter(|first| {
            best.all(|other| self.distance_mm(&first.pose, &other.pose) <= SAME_MM)
        });
        if let Some(single) = single {
            (fit.pose, fit.outlier) = (Some(single.pose), single.outlier);
            return most >= 3;
        }
        // A layout that fits no frame is the residual check's; only what is unusual is thrown
        // out.
        let is_usual = fit.pose.is_some_and(|pose| pose.residual_mm <= self.usual_mm);
        if !is_usual {
            (fit.pose, fit.outlier) = (None, Outlier::Ambiguous);
        }
        is_usual
    }

    /// All explanations of a row within the tolerance, those of the same kind by increasing
    /// residual.
    fn explanations(&self, row: usize) -> Vec<Explanation> {
        let positions = self.file.row_mm(row);
        let seen: Vec<(usize, [f64; 2], [f64; 2])> = self
            .markers
            .iter()
            .enumerate()
            .filter(|(_, marker)| !positions[marker.column][0].is_nan())
            .map(|(i, marker)| {
                let [x, y, _] = positions[marker.column];
                (i, marker.place_mm, [x, y])
            })
            .collect();
        let n = seen.len();
        let mut found = Vec::new();
        let mut offer = |outlier, explained, pose: Option<LinkPose>| {
            let pose = pose.filter(|pose| pose.residual_mm <= self.tolerance_mm);
            found.extend(pose.map(|pose| Explanation { outlier, pose, explained }));
        };
        let all = seen.iter().map(|(_, place, at)| (*place, *at));
        offer(Outlier::None, n, rigid::fit(all.clone()));
        for a in 0..n {
            for b in a + 1..n {
                let swapped = seen.iter().enumerate().map(|(i, (_, place, _))| {
                    let from = if i == a {
                        b
                    } else if i == b {
                        a
                    } else {
                        i
                    };
                    (*place, seen[from].2)
                });
                offer(Outlier::Swapped(seen[a].0, seen[b].0), n, rigid::fit(swapped));
            }
        }
        if n >= 3 {
            for (left_out, (marker, _, _)) in seen.iter().enumerate() {
                let rest = all.clone().enumerate().filter(|(i, _)| *i != left_out);
                let pose = rigid::fit(rest.map(|(_, pair)| pair));
                offer(Outlier::Jumped(*marker), n - 1, pose);
            }
        }
        found.sort_by(|a, b| {
            b.explained.cmp(&a.explained).then(a.pose.residual_mm.total_cmp(&b.pose.residual_mm))
        });
        found
    }

    /// How far two poses put one of the link's markers apart at most, mm.
    fn distance_mm(&self, one: &LinkPose, other: &LinkPose) -> f64 {
        let apart = |marker: &LinkMarker| {
            let [a, b] = [one, other].map(|pose| pose.at(marker.place_mm));
            (a[0] - b[0]).hypot(a[1] - b[1])
        };
        self.markers.iter().map(apart).fold(0.0, f64::max)
    }

    /// Settles rows, forwards and backwards, by where the link was in the frames next to them
    /// that are settled already; first by near ones, which tell more. Rows without such
    /// neighbours stay as they are.
    fn follow(&self, fits: &mut [LinkFit], unsure: &[usize]) {
        let mut is_sure: Vec<bool> = fits.iter().map(|fit| fit.pose.is_some()).collect();
        unsure.iter().for_each(|&row| is_sure[row] = false);
        let mut is_contradicted = vec![false; unsure.len()];
        for farthest in [FIRST_FRAMES, FOLLOWED_FRAMES] {
            for i in 0..unsure.len() {
                match self.settle(
                    fits,
                    &mut is_sure,
                    unsure[i],
                    Side { backwards: false, farthest },
                ) {
                    Some(is_settled) => is_contradicted[i] = !is_settled,
                    None if farthest == FOLLOWED_FRAMES => {
                        self.begin_anew(fits, &mut is_sure, unsure[i]);
                    }
                    None => {}
                }
            }
            for i in (0..unsure.len()).rev() {
                let side = Side { backwards: true, farthest };
                if let Some(is_settled) = self.settle(fits, &mut is_sure, unsure[i], side) {
                    is_contradicted[i] = !is_settled;
                }
            }
        }
        for (&row, _) in unsure.iter().zip(is_contradicted).filter(|(_, wrong)| *wrong) {
            (fits[row].pose, fits[row].outlier) = (None, Outlier::Ambiguous);
        }
    }

    /// Takes the explanation of a row that is nearest to where the link should be; `false` if
    /// that is too far away, `None` if nothing says where it should be.
    fn settle(
        &self,
        fits: &mut [LinkFit],
        is_sure: &mut [bool],
        row: usize,
        side: Side,
    ) -> Option<bool> {
        if is_sure[row] {
            return Some(true);
        }
        let (predicted, ahead) = self.predict(fits, is_sure, row, side)?;
        let reach_mm = REACH_MM + MORE_REACH_MM * (ahead - FIRST_FRAMES).max(0) as f64;
        let distance = |found: &Explanation| self.distance_mm(&found.pose, &predicted);
        let nearest = self
            .explanations(row)
            .into_iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .filter(|nearest| distance(nearest) <= reach_mm);
        if let Some(Explanation { outlier, pose, .. }) = nearest {
            (fits[row].pose, fits[row].outlier) = (Some(pose), outlier);
            is_sure[row] = true;
        }
        Some(is_sure[row])
    }

    /// After a long time without the link, or at its first frames: if most of the next frames
    /// have a heading like the row's, they are sure. Swapped labels turn it round.
    fn begin_anew(&self, fits: &[LinkFit], is_sure: &mut [bool], row: usize) {
        let Some(first) = fits[row].pose else { return };
        let frames = &self.file.frames;
        let next: Vec<(usize, bool)> = (row..frames.len())
            .take_while(|&other| frames[other] - frames[row] <= BEGINNING_FRAMES)
            .filter_map(|other| {
                let away = wrap(fits[other].pose?.theta_rad - first.theta_rad);
                Some((other, away.abs() < LIKE_RAD))
            })
            .collect();
        let like = next.iter().filter(|(_, is_like)| *is_like).count();
        if like >= BEGINNING_LEAST && 2 * like > next.len() {
            next.iter().for_each(|(other, is_like)| is_sure[*other] |= is_like);
        }
    }

    /// Where the motion of the frames before a row, or of those after it, takes the link, and
    /// over how many frames it was followed.
    fn predict(
        &self,
        fits: &[LinkFit],
        is_sure: &[bool],
        row: usize,
        side: Side,
    ) -> Option<(LinkPose, i64)> {
        let frames = &self.file.frames;
        let neighbour = |from: usize, k: usize| {
            if side.backwards {
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
        let (last, ahead) = sure(row, side.farthest).next()?;
        let (earlier, apart) =
            sure(last, *SPEED_FRAMES.end()).find(|(_, apart)| SPEED_FRAMES.contains(apart))?;
        let (last, earlier) = (fits[last].pose?, fits[earlier].pose?);
        let steps = ahead as f64 / apart as f64;
        let on = |a: f64, b: f64| a + steps * (a - b);
        let predicted = LinkPose {
            origin_mm: [0, 1].map(|axis| on(last.origin_mm[axis], earlier.origin_mm[axis])),
            theta_rad: last.theta_rad + steps * wrap(last.theta_rad - earlier.theta_rad),
            residual_mm: 0.0,
        };
        Some((predicted, ahead))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    const FRAMES: usize = 60;

    /// Link 1's three markers over time; the link moves and turns.
    fn film(change: impl Fn(usize, &mut [[f64; 3]; 3])) -> (MarkerFile, Vec<LinkMarker>) {
        let layout = Config::default().markers.link1;
        let markers: Vec<LinkMarker> = layout
            .values()
            .enumerate()
            .map(|(column, place)| LinkMarker { column, place_mm: [place[0], place[1]] })
            .collect();
        let mut positions_mm = Vec::new();
        for frame in 0..FRAMES {
            let pose = truth(frame);
            let mut row = [0, 1, 2].map(|i: usize| {
                let [x, y] = pose.at(markers[i].place_mm);
                // A little of what noise does, the same at every run.
                let noise = 0.1 * ((7 * frame + 3 * i) as f64).sin();
                [x + noise, y - noise, 55.0]
            });
            change(frame, &mut row);
            positions_mm.extend(row);
        }
        let file = MarkerFile {
            rate_hz: Some(120.0),
            labels: ["F1", "F2", "F3"].map(str::to_owned).into(),
            frames: (100..).take(FRAMES).collect(),
            positions_mm,
            rows_without_frame: 0,
        };
        (file, markers)
    }

    fn truth(frame: usize) -> LinkPose {
        let t = frame as f64 / 120.0;
        LinkPose {
            origin_mm: [300.0 * t, 40.0 * (6.0 * t).sin()],
            theta_rad: 3.0 + 0.8 * (6.0 * t).sin(),
            residual_mm: 0.0,
        }
    }

    fn mended(change: impl Fn(usize, &mut [[f64; 3]; 3])) -> Vec<LinkFit> {
        let (file, markers) = film(change);
        let mut fits: Vec<LinkFit> =
            (0..FRAMES).map(|row| LinkFit::of(file.row_mm(row), &markers)).collect();
        mend(&file, &markers, &mut fits);
        for (frame, fit) in fits.iter().enumerate() {
            let Some(pose) = fit.pose else { continue };
            let truth = truth(frame);
            let away = wrap(pose.theta_rad - truth.theta_rad).abs();
            assert!(away < 0.01, "{frame}: {away} {:?}", fit.outlier);
            assert!((pose.origin_mm[0] - truth.origin_mm[0]).abs() < 0.5, "{frame}");
        }
        fits
    }

    fn outliers(fits: &[LinkFit]) -> Vec<(usize, Outlier)> {
        let found = fits.iter().enumerate().map(|(row, fit)| (row, fit.outlier));
        found.filter(|(_, outlier)| *outlier != Outlier::None).collect()
    }

    #[test]
    fn sound_frames_stay_as_they_are() {
        let (file, markers) = film(|_, _| ());
        let mut fits: Vec<LinkFit> =
            (0..FRAMES).map(|row| LinkFit::of(file.row_mm(row), &markers)).collect();
        let before = format!("{fits:?}");
        mend(&file, &markers, &mut fits);
        assert_eq!(format!("{fits:?}"), before);
    }

    #[test]
    fn a_marker_that_jumps_in_any_direction_is_left_out() {
        for marker in 0..3 {
            let fits = mended(|frame, row| {
                if frame % 3 == 1 {
                    let (sin, cos) = (frame as f64 * 0.37).sin_cos();
                    row[marker][0] += 20.0 * cos;
                    row[marker][1] += 20.0 * sin;
                }
            });
            let found = outliers(&fits);
            let expected: Vec<_> =
                (1..FRAMES).step_by(3).map(|row| (row, Outlier::Jumped(marker))).collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn any_two_labels_that_are_swapped_are_swapped_back_also_in_every_frame() {
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            for every in [1, 4] {
                let fits = mended(|frame, row| {
                    if frame % every == 0 {
                        row.swap(a, b);
                    }
                });
                let expected: Vec<_> =
                    (0..FRAMES).step_by(every).map(|row| (row, Outlier::Swapped(a, b))).collect();
                assert_eq!(outliers(&fits), expected);
            }
        }
    }

    #[test]
    fn two_markers_are_checked_by_the_frames_about_them() {
        // Only markers 0 and 1 are seen for a while: too long to follow from one side.
        let unseen = |frame: usize| (20..32).contains(&frame);
        let fits = mended(|frame, row| {
            if unseen(frame) {
                row[2] = [f64::NAN; 3];
            }
            if frame == 24 {
                row.swap(0, 1);
            }
            if frame == 27 {
                // About the other marker, so that their distance stays.
                let (sin, cos) = 0.3_f64.sin_cos();
                let [dx, dy] = [row[1][0] - row[0][0], row[1][1] - row[0][1]];
                row[1][0] = row[0][0] + cos * dx - sin * dy;
                row[1][1] = row[0][1] + sin * dx + cos * dy;
            }
        });
        let expected = [(24, Outlier::Swapped(0, 1)), (27, Outlier::Ambiguous)];
        assert_eq!(outliers(&fits), expected);
        assert!(fits[27].pose.is_none() && fits[28].pose.is_some());
    }

    #[test]
    fn a_link_of_two_markers_is_checked_by_its_motion_alone() {
        let fits = mended(|frame, row| {
            row[2] = [f64::NAN; 3];
            if frame == 30 {
                let apart = [row[1][0] - row[0][0], row[1][1] - row[0][1]];
                row[0][0] -= 0.3 * apart[0];
                row[0][1] -= 0.3 * apart[1];
            }
            if frame == 40 {
                row.swap(0, 1);
            }
        });
        let expected = [(30, Outlier::Ambiguous), (40, Outlier::Swapped(0, 1))];
        assert_eq!(outliers(&fits), expected);
    }

    #[test]
    fn a_layout_that_is_wrong_in_every_frame_throws_no_pose_out() {
        // Two markers of a link whose layout has them 6 mm too near: no frame is worse.
        let (mut file, markers) = film(|_, row| row[2] = [f64::NAN; 3]);
        for row in 0..FRAMES {
            let [a, b] = [0, 1].map(|i| file.positions_mm[3 * row + i]);
            for axis in 0..2 {
                file.positions_mm[3 * row + 1][axis] += 0.2 * (b[axis] - a[axis]);
            }
        }
        let mut fits: Vec<LinkFit> =
            (0..FRAMES).map(|row| LinkFit::of(file.row_mm(row), &markers)).collect();
        mend(&file, &markers, &mut fits);
        assert!(fits.iter().all(|fit| fit.pose.is_some() && fit.outlier == Outlier::None));
    }
}
