//! Estimates constant tilts from the marker heights: of the floor relative to the camera frame, and of each link
//! relative to the floor.
//!
//! A tilted floor shortens distances in the top view by the cosine of the tilt. A tilted link displaces its markers by
//! their height times the sine: a millimetre per degree at 60 mm. Both tilts are constant over a trial and are
//! estimated once per trial from all frames, because the heights in a single frame are too noisy. Slow variations, as
//! on a soft suspension, are left to [`super::suspension`].
//!
//! The height of a marker at `(x, y)` in its link frame and `(X, Y)` in the camera frame is that in the layout, plus a
//! constant per link, plus `a y - b x` with the link's rotations `a` about its x axis and `b` about its y axis, plus
//! the corresponding terms for the floor with `(X, Y)`. The least-squares problem has a weak prior on the rotations. If
//! a trial cannot distinguish a tilted floor from links with the same tilt (a straight run), the tilt is
//! attributed to the floor.

use std::borrow::Cow;
use std::ops::Range;

use nalgebra::{Matrix2, Rotation3, RowVector2, SVector, Vector2, Vector3};
use trilink_mocap::Recording;
use trilink_statistics::NormalEquations;

use crate::checks::Check;
use crate::markers::labels::LinkFit;
use crate::markers::layout::Layout;

/// Maximum plausible tilt, degrees. A larger tilt is caused by wrong heights in the layout; it is flagged, not
/// corrected.
const MAX_PLAUSIBLE_DEG: f64 = 3.0;
/// Minimum number of standard errors by which a significant tilt differs from zero.
const MIN_DEVIATIONS: f64 = 3.0;
/// Number of rows, spread over the trial, that are evaluated.
const ROWS: usize = 2000;
/// Duration of half an oscillation of a suspension, over which heights are correlated, frames.
const SWING_FRAMES: f64 = 360.0;
/// Number of blocks into which the trial is divided for the jackknife standard errors.
const BLOCKS: usize = 8;
/// Prior standard deviation of the links' constant heights, mm.
const PRIOR_HEIGHT_MM: f64 = 0.3;
/// Prior standard deviation of the rotations, rad: rotations that the heights do not determine become zero.
const PRIOR_TURN_RAD: f64 = 0.02;
/// Sums over frames of the products of 1, a marker's coordinates X and Y in the camera frame, and its height; only the
/// lower triangle is filled.
type Moments = [[f64; 4]; 4];

/// Tilt of the floor or of a link: rotations about the x and y axes, and the standard error of their magnitude, rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Turn {
    pub about_rad: [f64; 2],
    pub se_rad: f64,
}

impl Turn {
    /// Returns the magnitude of the tilt, degrees.
    pub(crate) fn size_deg(&self) -> f64 {
        self.about_rad[0].hypot(self.about_rad[1]).to_degrees()
    }

    /// Returns the magnitude of the tilt, degrees; zero if it is not significant.
    pub(crate) fn significant_deg(&self) -> f64 {
        let size_deg = self.size_deg();
        if size_deg > MIN_DEVIATIONS * self.se_rad.to_degrees() { size_deg } else { 0.0 }
    }

    /// Returns whether the tilt exceeds the limit of the tilt check.
    pub(crate) fn is_large(&self) -> bool {
        self.significant_deg() > Check::Tilt.limit()
    }

    /// Returns whether the tilt is corrected, that is, whether it is large but plausible.
    pub(crate) fn is_corrected(&self) -> bool {
        self.is_large() && self.size_deg() <= MAX_PLAUSIBLE_DEG
    }

    fn rotation(&self) -> Rotation3<f64> {
        Rotation3::new(Vector3::new(self.about_rad[0], self.about_rad[1], 0.0))
    }
}

/// Tilts of the floor and the links, constant over a trial.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Tilt {
    pub floor: Turn,
    /// Tilts of the links by number.
    pub links: Vec<Turn>,
}

impl Tilt {
    /// Estimates the tilts of the floor and the links from the rows in the range `from`; of each link, only rows
    /// without a label fault are used.
    pub(crate) fn estimate(
        file: &Recording,
        layout: &Layout,
        fits: &[Vec<LinkFit>],
        from: Range<usize>,
    ) -> Self {
        // The unknowns are the floor's two rotations, then each link's constant height and two rotations.
        let estimate = match layout.len() {
            ..=2 => Self::estimate_unknowns::<8>,
            3 => Self::estimate_unknowns::<11>,
            4 => Self::estimate_unknowns::<14>,
            5 => Self::estimate_unknowns::<17>,
            6 => Self::estimate_unknowns::<20>,
            7 => Self::estimate_unknowns::<23>,
            8.. => Self::estimate_unknowns::<26>,
        };
        estimate(file, layout, fits, from).unwrap_or_else(|| Self {
            floor: Turn::default(),
            links: vec![Turn::default(); layout.len()],
        })
    }

    fn estimate_unknowns<const N: usize>(
        file: &Recording,
        layout: &Layout,
        fits: &[Vec<LinkFit>],
        from: Range<usize>,
    ) -> Option<Self> {
        let rows = from.len();
        let stride = (rows / ROWS).max(1);
        let begin = from
            .clone()
            .flat_map(|row| file.row_mm(row))
            .find(|[x, _, _]| !x.is_nan())
            .map_or([0.0; 2], |[x, y, _]| [*x, *y]);
        let mut parts = [NormalEquations::<N>::new(); BLOCKS];
        for (i, part) in parts.iter_mut().enumerate() {
            let rows = from.start + i * rows / BLOCKS..from.start + (i + 1) * rows / BLOCKS;
            for (link, markers) in layout.iter().enumerate() {
                for marker in markers {
                    // X and Y are relative to the robot's starting position.
                    let mut moments = Moments::default();
                    for row in rows.clone().step_by(stride) {
                        let [x, y, z] = file.position_mm(row, marker.column);
                        if fits[link][row].is_sound() && !x.is_nan() {
                            let height = z - marker.height_mm;
                            let each = [1.0, x - begin[0], y - begin[1], height];
                            for i in 0..4 {
                                (0..=i).for_each(|j| moments[i][j] += each[i] * each[j]);
                            }
                        }
                    }
                    add_heights(part, link, marker.local_position_mm, &moments);
                }
            }
        }
        Self::from_parts(&parts, layout, stride)
    }

    /// Estimates the tilts and their standard errors from the equations of each block, for which every `stride`-th row
    /// was evaluated; `None` if the heights do not determine the rotations.
    fn from_parts<const N: usize>(
        parts: &[NormalEquations<N>; BLOCKS],
        layout: &Layout,
        stride: usize,
    ) -> Option<Self> {
        let whole = NormalEquations::sum(parts.iter());
        let (found, inverse) = with_prior(&whole, layout).solve()?;
        // Jackknife over the blocks.
        let mut variance = SVector::<f64, N>::zeros();
        for left_out in 0..BLOCKS {
            let rest = parts.iter().enumerate().filter(|(i, _)| *i != left_out);
            let rest = NormalEquations::sum(rest.map(|(_, part)| part));
            let away = with_prior(&rest, layout).solve()?.0 - found;
            variance += (BLOCKS - 1) as f64 / BLOCKS as f64 * away.component_mul(&away);
        }
        // In a short trial or with a robot at rest, the blocks agree even on rotations that none of them determines:
        // the residuals of the heights therefore count as one sample per half-oscillation of the suspension.
        let left = whole.residual_squares(&found) / whole.count.max(1.0);
        let markers = layout.iter().map(Vec::len).sum::<usize>() as f64 / layout.len() as f64;
        let alike = (SWING_FRAMES / stride as f64).max(1.0) * markers;
        variance += left * alike * inverse.diagonal();
        let turn = |first: usize| Turn {
            about_rad: [found[first], found[first + 1]],
            se_rad: (0.5 * (variance[first] + variance[first + 1])).sqrt(),
        };
        Some(Self {
            floor: turn(0),
            links: (0..layout.len()).map(|link| turn(3 * link + 3)).collect(),
        })
    }

    /// Returns the floor's tilt if it is significant but not corrected, and zero otherwise.
    pub(crate) fn uncorrected_floor(&self) -> Turn {
        if self.floor.significant_deg() > 0.0 && !self.floor.is_corrected() {
            self.floor
        } else {
            Turn::default()
        }
    }

    /// Returns whether any tilt is corrected.
    pub(crate) fn is_corrected(&self) -> bool {
        self.floor.is_corrected() || self.links.iter().any(Turn::is_corrected)
    }

    /// Returns the recording, corrected for the floor's tilt, and the layout, corrected for the links' tilts. Tilts for
    /// which [`Turn::is_corrected`] is false, because they are too small or implausibly large, are not corrected.
    pub(crate) fn corrected<'f>(
        &self,
        file: &'f Recording,
        layout: &'f Layout,
    ) -> (Cow<'f, Recording>, Cow<'f, Layout>) {
        let mut file = Cow::Borrowed(file);
        let mut layout = Cow::Borrowed(layout);
        if self.floor.is_corrected() {
            let back = self.floor.rotation().inverse();
            for position in &mut file.to_mut().positions_mm {
                *position = (back * Vector3::from(*position)).into();
            }
        }
        for (link, turn) in self.links.iter().enumerate().filter(|(_, turn)| turn.is_corrected()) {
            for marker in &mut layout.to_mut()[link] {
                let [x, y] = marker.local_position_mm;
                let turned = turn.rotation() * Vector3::new(x, y, marker.height_mm);
                marker.local_position_mm = [turned.x, turned.y];
            }
        }
        (file, layout)
    }
}

/// Adds the heights of one marker on a link, given their moments, to the lower triangle of the equations.
fn add_heights<const N: usize>(
    equations: &mut NormalEquations<N>,
    link: usize,
    [x, y]: [f64; 2],
    moments: &Moments,
) {
    let NormalEquations { matrix, right, count, squares } = equations;
    let [[one, ..], [sum_x, x_x, ..], [sum_y, y_x, y_y, _], [sum_z, z_x, z_y, z_z]] = *moments;
    // The link's columns are constant; those of the floor's rotations are (Y, -X).
    let own = 2 + 3 * link;
    let columns = Vector3::new(1.0, y, -x);
    let mut of_link = matrix.fixed_view_mut::<3, 3>(own, own);
    of_link += one * columns * columns.transpose();
    let mut coupling = matrix.fixed_view_mut::<3, 2>(own, 0);
    coupling += columns * RowVector2::new(sum_y, -sum_x);
    let mut of_floor = matrix.fixed_view_mut::<2, 2>(0, 0);
    of_floor += Matrix2::new(y_y, 0.0, -y_x, x_x);
    let mut heights = right.fixed_rows_mut::<3>(own);
    heights += columns * sum_z;
    let mut heights = right.fixed_rows_mut::<2>(0);
    heights += Vector2::new(z_y, -z_x);
    *count += one;
    *squares += z_z;
}

fn with_prior<const N: usize>(
    equations: &NormalEquations<N>,
    layout: &Layout,
) -> NormalEquations<N> {
    let mut with_prior = *equations;
    for turn in (0..N).filter(|unknown| unknown % 3 < 2) {
        with_prior.matrix[(turn, turn)] += (PRIOR_HEIGHT_MM / PRIOR_TURN_RAD).powi(2);
    }
    // Nothing determines the height of a link without markers.
    for (link, _) in layout.iter().enumerate().filter(|(_, markers)| markers.is_empty()) {
        with_prior.matrix[(2 + 3 * link, 2 + 3 * link)] += 1.0;
    }
    with_prior
}
