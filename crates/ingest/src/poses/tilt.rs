//! Tilt out of the plane, from the markers' heights: of the floor against the cameras' plane, and
//! of a link against the floor.
//!
//! A tilted floor shortens what is seen from above by the cosine. A tilted link shifts its
//! markers by their height times the sine: a millimetre for a degree at 60 mm. Both are
//! constant over a trial, so they are estimated once per trial from all frames: the heights
//! themselves are too noisy to correct a frame by its own. What changes slowly, as on a soft
//! suspension, is left to [`super::suspension`].
//!
//! The height of a marker at `(x, y)` in its link's frame and `(X, Y)` in the cameras' is that of
//! the layout, plus one constant per link, plus `a y - b x` with the link's turns `a` about its x
//! axis and `b` about its y axis, plus the same of the floor with `(X, Y)`. The least squares
//! have a weak prior on the turns: where a trial cannot distinguish the floor from three links that
//! are tilted alike (a straight run), it is the floor.

use std::borrow::Cow;
use std::ops::Range;

use nalgebra::{Matrix2, Rotation3, RowVector2, SVector, Vector2, Vector3};
use trilink_mocap::Recording;
use trilink_statistics::NormalEquations;

use crate::checks::Check;
use crate::markers::labels::LinkFit;
use crate::markers::layout::Layout;

/// A tilt above this is no tilt but a layout whose heights are wrong: flagged, not corrected.
const PLAUSIBLE_DEG: f64 = 3.0;
/// Standard errors by which a tilt must differ from none.
const DEVIATIONS: f64 = 3.0;
/// Rows that are looked at, spread over the trial.
const ROWS: usize = 2000;
/// How long a suspension may swing to one side: heights are alike so long, frames.
const SWING_FRAMES: f64 = 360.0;
/// Parts of the trial whose difference gives the standard errors.
const BLOCKS: usize = 8;
/// Standard deviations of the heights (mm) and of the turns (rad) that the prior takes: turns
/// that the heights do not determine are none.
const HEIGHT_MM: f64 = 0.3;
const TURN_RAD: f64 = 0.02;
/// Unknowns: the floor's two turns, then of each link a constant height and two turns.
const UNKNOWNS: usize = 11;

type Equations = NormalEquations<UNKNOWNS>;
/// Sums of the products of 1, X, Y and a marker's height, in the lower triangle.
type Moments = [[f64; 4]; 4];

/// Turns about x and y with the standard error of their size, rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Turn {
    pub about_rad: [f64; 2],
    pub se_rad: f64,
}

impl Turn {
    /// Its size, degrees.
    pub(crate) fn size_deg(&self) -> f64 {
        self.about_rad[0].hypot(self.about_rad[1]).to_degrees()
    }

    /// Its size, degrees; none if it is not certain.
    pub(crate) fn certain_deg(&self) -> f64 {
        let size_deg = self.size_deg();
        if size_deg > DEVIATIONS * self.se_rad.to_degrees() { size_deg } else { 0.0 }
    }

    /// Whether it is more than what is left alone.
    pub(crate) fn is_large(&self) -> bool {
        self.certain_deg() > Check::Tilt.limit()
    }

    /// Whether it is undone.
    pub(crate) fn is_corrected(&self) -> bool {
        self.is_large() && self.size_deg() <= PLAUSIBLE_DEG
    }

    fn rotation(&self) -> Rotation3<f64> {
        Rotation3::new(Vector3::new(self.about_rad[0], self.about_rad[1], 0.0))
    }
}

/// What is tilted in a trial.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Tilt {
    pub floor: Turn,
    pub links: [Turn; 3],
}

impl Tilt {
    /// Of a trial, from those of some rows in which nothing is wrong with a link's markers.
    pub(crate) fn of(
        file: &Recording,
        layout: &Layout,
        fits: &[Vec<LinkFit>; 3],
        from: Range<usize>,
    ) -> Self {
        let rows = from.len();
        let stride = (rows / ROWS).max(1);
        let begin = from
            .clone()
            .flat_map(|row| file.row_mm(row))
            .find(|[x, _, _]| !x.is_nan())
            .map_or([0.0; 2], |[x, y, _]| [*x, *y]);
        let mut parts = [Equations::new(); BLOCKS];
        for (i, part) in parts.iter_mut().enumerate() {
            let rows = from.start + i * rows / BLOCKS..from.start + (i + 1) * rows / BLOCKS;
            for (link, markers) in layout.iter().enumerate() {
                for marker in markers {
                    // X and Y count from where the robot starts.
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
        Self::of_parts(&parts, layout, stride).unwrap_or_default()
    }

    /// `None` if the heights do not determine the turns.
    fn of_parts(parts: &[Equations; BLOCKS], layout: &Layout, stride: usize) -> Option<Self> {
        let all_but = |left_out: usize| {
            Equations::sum((0..BLOCKS).filter(|&i| i != left_out).map(|i| &parts[i]))
        };
        let whole = all_but(BLOCKS);
        let (found, inverse) = with_prior(&whole).solve()?;
        // Jackknife: how the estimates without one part each differ from the one with all.
        let mut variance = SVector::<f64, UNKNOWNS>::zeros();
        for left_out in 0..BLOCKS {
            let away = with_prior(&all_but(left_out)).solve()?.0 - found;
            variance += (BLOCKS - 1) as f64 / BLOCKS as f64 * away.component_mul(&away);
        }
        // What a short trial or a robot at rest leaves open, no part of it differs in: what is
        // left of the heights counts as one sample for each swing of the suspension.
        let left = whole.residual_squares(&found) / whole.count.max(1.0);
        let markers = layout.iter().map(Vec::len).sum::<usize>() as f64 / 3.0;
        let alike = (SWING_FRAMES / stride as f64).max(1.0) * markers;
        variance += left * alike * inverse.diagonal();
        let turn = |first: usize| Turn {
            about_rad: [found[first], found[first + 1]],
            se_rad: (0.5 * (variance[first] + variance[first + 1])).sqrt(),
        };
        Some(Self { floor: turn(0), links: [turn(3), turn(6), turn(9)] })
    }

    /// What is left of the floor's tilt after the correction, if it is certain.
    pub(crate) fn floor_left(&self) -> Turn {
        let is_left = self.floor.certain_deg() > 0.0 && !self.floor.is_corrected();
        if is_left { self.floor } else { Turn::default() }
    }

    /// Whether any of it is undone.
    pub(crate) fn is_corrected(&self) -> bool {
        self.floor.is_corrected() || self.links.iter().any(Turn::is_corrected)
    }

    /// Markers and layout as they would be without the tilt that is to be corrected.
    pub(crate) fn corrected<'f>(
        &self,
        file: &'f Recording,
        layout: &'f Layout,
    ) -> (Cow<'f, Recording>, Cow<'f, Layout>) {
        let (mut file, mut layout) = (Cow::Borrowed(file), Cow::Borrowed(layout));
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

/// Adds the heights of a marker of a link, given their moments: to the lower triangle.
fn add_heights(equations: &mut Equations, link: usize, [x, y]: [f64; 2], moments: &Moments) {
    let Equations { matrix, right, count, squares } = equations;
    let [[one, ..], [sum_x, x_x, ..], [sum_y, y_x, y_y, _], [sum_z, z_x, z_y, z_z]] = *moments;
    // The link's columns are constant, those of the floor's turns are (Y, -X).
    let (own, columns) = (2 + 3 * link, Vector3::new(1.0, y, -x));
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

fn with_prior(equations: &Equations) -> Equations {
    let mut with_prior = *equations;
    for turn in [0, 1, 3, 4, 6, 7, 9, 10] {
        with_prior.matrix[(turn, turn)] += (HEIGHT_MM / TURN_RAD).powi(2);
    }
    with_prior
}
