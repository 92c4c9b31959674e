//! Marker positions over time.

use trilink_base::body;
use trilink_base::pattern::matches_label;

/// Maximum plausible coordinate, mm: no camera system covers a kilometre.
pub(super) const MAX_MM: f64 = 1e6;

/// Position of an occluded marker: three NaN.
pub(super) const MISSING: [f64; 3] = [f64::NAN; 3];

/// Recorded markers in one file, mm in the camera frame, in the order of the file. A rigid body, of which the file has
/// the poses, is four markers: the points of [`body`], which are labelled `NAME@1` to `NAME@4`.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Frame rate stated by the file, Hz; `None` if the file states none, as a trimmed file may.
    pub rate_hz: Option<f64>,
    /// Frame number of each row, ascending; the first is often not 1, and frame numbers may be missing.
    pub frames: Vec<i64>,
    /// Labels as in the file, often `Subject:Marker`.
    pub labels: Vec<String>,
    /// Number of rows that have data but no frame number; these rows are left out.
    pub rows_without_frame: usize,
    /// Number of rows with more cells than the header has columns; the excess cells are ignored.
    pub rows_too_long: usize,
    /// Number of frames, by marker, in which a text file has only a part of the marker's coordinates, or of the pose of a
    /// rigid body (counted at its first point); such a marker or body counts as occluded.
    pub incomplete: Vec<usize>,
    /// Notes on missing or contradictory metadata in the file and on the values used instead.
    pub doubts: Vec<String>,
    /// Positions by row, then marker: X, Y, Z, or three NaN where the marker is occluded.
    pub positions_mm: Vec<[f64; 3]>,
}

impl Recording {
    /// Creates a recording from positions by frame, then marker, with three NaN where a marker is occluded.
    ///
    /// # Panics
    /// Panics if the number of positions is not the number of frames times the number of labels.
    pub fn new(
        rate_hz: Option<f64>,
        frames: Vec<i64>,
        labels: Vec<String>,
        positions_mm: Vec<[f64; 3]>,
    ) -> Self {
        assert_eq!(positions_mm.len(), frames.len() * labels.len(), "positions of the recording");
        Self {
            rate_hz,
            frames,
            rows_without_frame: 0,
            rows_too_long: 0,
            incomplete: vec![0; labels.len()],
            labels,
            doubts: Vec::new(),
            positions_mm,
        }
    }

    /// Returns whether any of the patterns matches a marker's label. `*` stands for any characters, `?` for a single
    /// one, and the subject may be omitted.
    pub fn is_named(&self, marker: usize, patterns: &[String]) -> bool {
        patterns.iter().any(|pattern| matches_label(pattern, &self.labels[marker]))
    }

    /// Returns the recording without the markers whose labels match any of the patterns.
    pub fn without(self, patterns: &[String]) -> Self {
        let kept: Vec<usize> =
            (0..self.labels.len()).filter(|&marker| !self.is_named(marker, patterns)).collect();
        if kept.len() == self.labels.len() {
            return self;
        }
        let rows = 0..self.frames.len();
        Self {
            labels: kept.iter().map(|&marker| self.labels[marker].clone()).collect(),
            incomplete: kept.iter().map(|&marker| self.incomplete[marker]).collect(),
            positions_mm: rows
                .flat_map(|row| kept.iter().map(move |&marker| (row, marker)))
                .map(|(row, marker)| self.position_mm(row, marker))
                .collect(),
            ..self
        }
    }

    /// Returns the recording with one more marker, which is occluded in all frames.
    pub fn with_occluded(self, label: String) -> Self {
        let mut positions_mm = Vec::with_capacity(self.positions_mm.len() + self.frames.len());
        for row in 0..self.frames.len() {
            positions_mm.extend_from_slice(self.row_mm(row));
            positions_mm.push(MISSING);
        }
        let labels = self.labels.into_iter().chain([label]).collect();
        let incomplete = self.incomplete.into_iter().chain([0]).collect();
        Self { labels, incomplete, positions_mm, ..self }
    }

    /// Returns the recording reduced to frames whose numbers are multiples of `stride`, renumbered and with the frame
    /// rate reduced accordingly.
    pub fn thinned(&self, stride: usize) -> Self {
        let stride = stride.max(1) as i64;
        let kept: Vec<usize> =
            (0..self.frames.len()).filter(|&row| self.frames[row] % stride == 0).collect();
        Self {
            rate_hz: self.rate_hz.map(|rate_hz| rate_hz / stride as f64),
            frames: kept.iter().map(|&row| self.frames[row] / stride).collect(),
            labels: self.labels.clone(),
            incomplete: self.incomplete.clone(),
            doubts: self.doubts.clone(),
            positions_mm: kept.iter().flat_map(|&row| self.row_mm(row)).copied().collect(),
            ..*self
        }
    }

    /// Permutes the axes cyclically so that the upward axis, whose index is `axis` (0 or 1), becomes the third; those of
    /// the frames of rigid bodies are permuted likewise, so that a frame aligned with the camera frame stays aligned.
    pub fn turn_up(&mut self, axis: usize) {
        for position in &mut self.positions_mm {
            position.rotate_left(axis + 1);
        }
        let markers = self.labels.len().max(1);
        for first in self.bodies() {
            for row in self.positions_mm.chunks_exact_mut(markers) {
                // Each of these points belongs to an axis of the body's frame.
                row[first + 1..first + body::POINTS].rotate_left(axis + 1);
            }
        }
    }

    /// Returns, for each rigid body, the index of the first of its four points among the labels.
    pub fn bodies(&self) -> Vec<usize> {
        let is_body = |labels: &[String]| {
            let Some((name, 0)) = body::of_point(&labels[0]) else { return false };
            let points = labels.iter().map(|label| body::of_point(label));
            points.enumerate().all(|(point, found)| found == Some((name, point)))
        };
        let all = self.labels.windows(body::POINTS).enumerate();
        all.filter(|(_, labels)| is_body(labels)).map(|(first, _)| first).collect()
    }

    /// Returns the pose of a rigid body in a row, given the index of its first point: the position of its origin, mm, and
    /// the axes of its frame; NaN where the body was not tracked.
    ///
    /// # Panics
    /// Panics if there is no such row or body.
    pub fn pose(&self, row: usize, first: usize) -> ([f64; 3], body::Axes) {
        body::pose(&std::array::from_fn(|point| self.position_mm(row, first + point)))
    }

    /// Returns the position of a marker in a row, mm; three NaN where the marker is occluded.
    ///
    /// # Panics
    /// Panics if there is no such row or marker.
    #[inline]
    pub fn position_mm(&self, row: usize, marker: usize) -> [f64; 3] {
        self.row_mm(row)[marker]
    }

    /// Frees the memory of the positions; labels and frame numbers remain.
    pub fn forget_positions(&mut self) {
        self.positions_mm = Vec::new();
    }

    /// Returns the positions of all markers in a row, mm, in the order of [`Recording::labels`].
    ///
    /// # Panics
    /// Panics if there is no such row.
    #[inline]
    pub fn row_mm(&self, row: usize) -> &[[f64; 3]] {
        let markers = self.labels.len();
        &self.positions_mm[row * markers..(row + 1) * markers]
    }
}
