//! Estimates the shape of a rigid group of markers by generalised Procrustes analysis in the plane (Gower 1975): the
//! markers of each row are fitted to the current shape, and the mean of the fitted rows becomes the new shape.

use trilink_mocap::Recording;
use trilink_robot::rotated;
use trilink_statistics::{mean, median_high};

use crate::markers::labels::{LinkFit, correct_labels};
use crate::markers::layout::LinkMarker;

/// Number of iterations with medians, which are robust to mislabelled markers.
const MEDIAN_ITERATIONS: usize = 4;
/// Number of subsequent iterations with means, which are more precise than medians.
const MEAN_ITERATIONS: usize = 4;

/// Rigid group of markers: positions in the body frame, and the pose of the body in every row.
#[derive(Debug, Clone)]
pub struct Body {
    pub markers: Vec<LinkMarker>,
    pub fits: Vec<LinkFit>,
}

impl Body {
    /// Fits the body formed by the markers in the given columns. `None` if no two of these markers are ever visible
    /// together, or if one of them is never visible together with two others.
    pub fn fit(file: &Recording, columns: &[usize]) -> Option<Self> {
        let rows = file.frames.len();
        let first = (0..rows)
            .max_by_key(|&row| (count_visible(file, columns, row), std::cmp::Reverse(row)))?;
        let mut markers: Vec<LinkMarker> = columns
            .iter()
            .map(|&column| {
                let [x, y, _] = file.position_mm(first, column);
                LinkMarker { column, local_position_mm: [x, y], height_mm: 0.0 }
            })
            .collect();
        centre(&mut markers);
        for _ in 0..MEDIAN_ITERATIONS {
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

    /// Returns the body with a refined shape, the mean marker positions over the rows that satisfy `is_used`, and with
    /// poses fitted to this shape. Rows with a mislabelled marker keep their poses.
    pub fn refined(&self, file: &Recording, is_used: &dyn Fn(usize) -> bool) -> Self {
        let mut body = self.clone();
        for _ in 0..MEAN_ITERATIONS {
            reshape(file, &mut body.markers, &body.fits, is_used, &|values| mean(values));
            for (row, fit) in body.fits.iter_mut().enumerate() {
                if fit.is_sound() {
                    *fit = LinkFit::from_row(file.row_mm(row), &body.markers);
                }
            }
        }
        for marker in &mut body.markers {
            let heights = sound_rows(&body.fits, is_used)
                .map(|row| file.position_mm(row, marker.column)[2])
                .filter(|z| !z.is_nan());
            marker.height_mm = mean(heights);
        }
        body
    }

    /// Iterates over the rows that show both bodies, with the angle from the other body's frame to this body's, rad.
    pub fn turns_to<'b>(&'b self, other: &'b Self) -> impl Iterator<Item = (usize, f64)> + 'b {
        self.fits.iter().zip(&other.fits).enumerate().filter_map(|(row, (own, other))| {
            Some((row, own.pose()?.theta_rad - other.pose()?.theta_rad))
        })
    }
}

fn count_visible(file: &Recording, columns: &[usize], row: usize) -> usize {
    columns.iter().filter(|&&column| !file.position_mm(row, column)[0].is_nan()).count()
}

/// Fits the pose of the body in every row.
fn fits(file: &Recording, markers: &[LinkMarker]) -> Vec<LinkFit> {
    // Markers without a position so far are not fitted.
    let known: Vec<LinkMarker> =
        markers.iter().filter(|marker| !marker.local_position_mm[0].is_nan()).copied().collect();
    (0..file.frames.len()).map(|row| LinkFit::from_row(file.row_mm(row), &known)).collect()
}

/// Iterates over the used rows in which no marker is mislabelled.
fn sound_rows<'f>(
    fits: &'f [LinkFit],
    is_used: &'f dyn Fn(usize) -> bool,
) -> impl Iterator<Item = usize> + 'f {
    fits.iter().enumerate().filter(|(row, fit)| fit.is_sound() && is_used(*row)).map(|(row, _)| row)
}

/// Moves every marker to its average position in the body frame, given the poses of the rows.
fn reshape(
    file: &Recording,
    markers: &mut [LinkMarker],
    fits: &[LinkFit],
    is_used: &dyn Fn(usize) -> bool,
    average: &dyn Fn(Vec<f64>) -> f64,
) {
    for marker in markers.iter_mut() {
        let mut along = Vec::new();
        let mut across = Vec::new();
        for row in sound_rows(fits, is_used) {
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

/// Moves the origin of the body frame to the centroid of the markers, where their pose is best determined.
fn centre(markers: &mut [LinkMarker]) {
    let known: Vec<[f64; 2]> = markers
        .iter()
        .map(|marker| marker.local_position_mm)
        .filter(|position| !position[0].is_nan())
        .collect();
    let middle = [0, 1].map(|axis| mean(known.iter().map(|position| position[axis])));
    for marker in markers {
        for axis in 0..2 {
            marker.local_position_mm[axis] -= middle[axis];
        }
    }
}
