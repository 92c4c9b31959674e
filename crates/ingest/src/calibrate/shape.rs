//! The shape of a rigid group of markers: generalised Procrustes analysis in the plane (Gower
//! 1975). Each row is fitted to the shape so far, and the shape becomes the mean of the
//! fitted rows.

use trilink_mocap::Recording;
use trilink_robot::rotated;
use trilink_statistics::{mean, median_high};

use crate::markers::labels::{LinkFit, correct_labels};
use crate::markers::layout::LinkMarker;

/// Rounds of medians, which do not mind misplaced markers, and of means, which are more precise.
const MEDIANS: usize = 4;
const MEANS: usize = 4;

/// A group's markers in a frame of its own, with its pose in every row.
#[derive(Debug, Clone)]
pub struct Body {
    pub markers: Vec<LinkMarker>,
    pub fits: Vec<LinkFit>,
}

impl Body {
    /// Of the markers of some columns; `None` if no two of them are ever seen together, or one
    /// is never seen with two others.
    pub fn of(file: &Recording, columns: &[usize]) -> Option<Self> {
        let rows = file.frames.len();
        let seen = |row: usize| {
            columns.iter().filter(|&&column| !file.position_mm(row, column)[0].is_nan()).count()
        };
        let first = (0..rows).max_by_key(|&row| (seen(row), std::cmp::Reverse(row)))?;
        let marker = |&column: &usize| {
            let [x, y, _] = file.position_mm(first, column);
            LinkMarker { column, local_position_mm: [x, y], height_mm: 0.0 }
        };
        let mut markers: Vec<LinkMarker> = columns.iter().map(marker).collect();
        centre(&mut markers);
        for _ in 0..MEDIANS {
            let fits = fits(file, &markers);
            reshape(file, &mut markers, &fits, &|_| true, &median_high);
        }
        let mut fits = fits(file, &markers);
        if markers.iter().any(|marker| marker.local_position_mm[0].is_nan()) {
            return None;
        }
        correct_labels(file, &markers, &mut fits);
        Some(Self { markers, fits }.refined(file, &|_| true))
    }

    /// The shape by the means over some of the rows, and the poses that follow from it. Rows in
    /// which something is wrong keep the pose that they had.
    pub fn refined(&self, file: &Recording, is_used: &dyn Fn(usize) -> bool) -> Self {
        let mut body = self.clone();
        for _ in 0..MEANS {
            reshape(file, &mut body.markers, &body.fits, is_used, &|values| mean(values));
            for (row, fit) in body.fits.iter_mut().enumerate() {
                if fit.is_sound() {
                    *fit = LinkFit::of(file.row_mm(row), &body.markers);
                }
            }
        }
        for marker in &mut body.markers {
            let heights = good_rows(&body.fits, is_used)
                .map(|row| file.position_mm(row, marker.column)[2])
                .filter(|z| !z.is_nan());
            marker.height_mm = mean(heights);
        }
        body
    }

    /// Angle from another body's frame to this one's, rad, in the rows that show both.
    pub fn turns_to<'b>(&'b self, other: &'b Self) -> impl Iterator<Item = (usize, f64)> + 'b {
        self.fits.iter().zip(&other.fits).enumerate().filter_map(|(row, (own, other))| {
            Some((row, own.pose()?.theta_rad - other.pose()?.theta_rad))
        })
    }
}

fn fits(file: &Recording, markers: &[LinkMarker]) -> Vec<LinkFit> {
    // A marker without a position yet is not fitted.
    let known: Vec<LinkMarker> =
        markers.iter().filter(|marker| !marker.local_position_mm[0].is_nan()).copied().collect();
    (0..file.frames.len()).map(|row| LinkFit::of(file.row_mm(row), &known)).collect()
}

/// Rows that are sound.
fn good_rows<'f>(
    fits: &'f [LinkFit],
    is_used: &'f dyn Fn(usize) -> bool,
) -> impl Iterator<Item = usize> + 'f {
    fits.iter().enumerate().filter(|(row, fit)| fit.is_sound() && is_used(*row)).map(|(row, _)| row)
}

/// Moves every marker to the average position that the rows' poses give it.
fn reshape(
    file: &Recording,
    markers: &mut [LinkMarker],
    fits: &[LinkFit],
    is_used: &dyn Fn(usize) -> bool,
    average: &dyn Fn(Vec<f64>) -> f64,
) {
    for marker in markers.iter_mut() {
        let (mut along, mut across) = (Vec::new(), Vec::new());
        for row in good_rows(fits, is_used) {
            let [x, y, _] = file.position_mm(row, marker.column);
            let Some(pose) = fits[row].pose().filter(|_| !x.is_nan()) else { continue };
            let [u, v] = rotated(-pose.theta_rad, [x - pose.origin_mm[0], y - pose.origin_mm[1]]);
            along.push(u);
            across.push(v);
        }
        marker.local_position_mm = [average(along), average(across)];
    }
    centre(markers);
}

/// Puts the origin into the middle of the markers: their pose is known best there.
fn centre(markers: &mut [LinkMarker]) {
    let known = || markers.iter().map(|marker| marker.local_position_mm).filter(|p| !p[0].is_nan());
    let middle = [0, 1].map(|axis| mean(known().map(|position| position[axis])));
    for marker in markers {
        for axis in 0..2 {
            marker.local_position_mm[axis] -= middle[axis];
        }
    }
}
