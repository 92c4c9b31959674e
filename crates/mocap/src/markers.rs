//! Markers over time.

use trilink_base::pattern::matches_label;

/// Largest coordinate that is believed: no camera sees a kilometre.
pub(super) const LARGEST_MM: f64 = 1e6;

/// Where a marker is that was not seen.
pub(super) const MISSING: [f64; 3] = [f64::NAN; 3];

/// The markers of one file, mm in the cameras' frame, in the order of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Frame rate that the file states, Hz; a file that somebody trimmed may have none.
    pub rate_hz: Option<f64>,
    /// Frame number of each row, increasing; the first is often not 1, and numbers can jump.
    pub frames: Vec<i64>,
    /// Labels as they stand in the file, often `Subject:Marker`.
    pub labels: Vec<String>,
    /// Rows with data but without a frame number, which are left out.
    pub rows_without_frame: usize,
    /// Rows with more cells than the header has columns; what is beyond is not read.
    pub rows_too_long: usize,
    /// Numbers of the file about itself that are missing or contradict each other, and what was
    /// taken.
    pub doubts: Vec<String>,
    /// Row by row, marker by marker, X, Y, Z; three NaN where the cameras did not see it.
    pub positions_mm: Vec<[f64; 3]>,
}

impl Recording {
    /// Markers that no file has yet: `positions_mm` frame by frame, marker by marker, three NaN where
    /// one was not seen.
    ///
    /// # Panics
    /// There are not as many positions as frames times labels.
    pub fn new(
        rate_hz: Option<f64>,
        frames: Vec<i64>,
        labels: Vec<String>,
        positions_mm: Vec<[f64; 3]>,
    ) -> Self {
        assert_eq!(positions_mm.len(), frames.len() * labels.len(), "positions of the recording");
        let (rows_without_frame, rows_too_long, doubts) = (0, 0, Vec::new());
        Self { rate_hz, frames, labels, rows_without_frame, rows_too_long, doubts, positions_mm }
    }

    /// Whether a marker is one that any of the patterns names: `*` stands for any characters,
    /// `?` for one, and the subject may be left out.
    pub fn is_named(&self, marker: usize, patterns: &[String]) -> bool {
        patterns.iter().any(|pattern| matches_label(pattern, &self.labels[marker]))
    }

    /// The file without the markers that any of the patterns names.
    pub fn without(self, patterns: &[String]) -> Self {
        let kept: Vec<usize> =
            (0..self.labels.len()).filter(|&marker| !self.is_named(marker, patterns)).collect();
        if kept.len() == self.labels.len() {
            return self;
        }
        let rows = 0..self.frames.len();
        let kept_of = |row| kept.iter().map(move |&marker| (row, marker));
        Self {
            labels: kept.iter().map(|&marker| self.labels[marker].clone()).collect(),
            positions_mm: rows
                .flat_map(kept_of)
                .map(|(row, marker)| self.position_mm(row, marker))
                .collect(),
            ..self
        }
    }

    /// Every so manieth frame, numbered anew, at so much less a rate.
    pub fn thinned(&self, stride: usize) -> Self {
        let stride = stride.max(1) as i64;
        let kept: Vec<usize> =
            (0..self.frames.len()).filter(|&row| self.frames[row] % stride == 0).collect();
        Self {
            rate_hz: self.rate_hz.map(|rate_hz| rate_hz / stride as f64),
            frames: kept.iter().map(|&row| self.frames[row] / stride).collect(),
            labels: self.labels.clone(),
            doubts: self.doubts.clone(),
            positions_mm: kept.iter().flat_map(|&row| self.row_mm(row)).copied().collect(),
            ..*self
        }
    }

    /// Turns a file's axes so that its first (0) or second (1) points up: it becomes the third.
    pub fn turn_up(&mut self, axis: usize) {
        for position in &mut self.positions_mm {
            position.rotate_left(axis + 1);
        }
    }

    /// Where a marker was in a row of the file, mm; three NaN where the cameras did not see it.
    ///
    /// # Panics
    /// There is no such row or marker.
    #[inline]
    pub fn position_mm(&self, row: usize, marker: usize) -> [f64; 3] {
        self.row_mm(row)[marker]
    }

    /// Leaves labels and frame numbers alone.
    pub fn forget_positions(&mut self) {
        self.positions_mm = Vec::new();
    }

    /// All markers of a row, mm, in the order of [`Recording::labels`].
    ///
    /// # Panics
    /// There is no such row.
    #[inline]
    pub fn row_mm(&self, row: usize) -> &[[f64; 3]] {
        let markers = self.labels.len();
        &self.positions_mm[row * markers..(row + 1) * markers]
    }
}
