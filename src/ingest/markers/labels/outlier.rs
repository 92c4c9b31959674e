//! What was wrong with a link's markers in a frame, and the pose that the others give.

use crate::ingest::markers::layout::LinkMarker;
use crate::ingest::markers::rigid::{self, LinkPose};

/// What was wrong with the markers of a link in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outlier {
    None,
    /// One marker is left out, by its index in the link's layout.
    Jumped(usize),
    /// Two labels are swapped back, by their indices in the link's layout.
    Swapped(usize, usize),
    /// The markers contradict each other or the link's motion, and it is not clear which is wrong.
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
pub struct LinkFit {
    /// Missing if the markers that were seen give none.
    pub pose: Option<LinkPose>,
    /// Markers seen.
    pub seen: usize,
    pub outlier: Outlier,
}

impl LinkFit {
    /// Whether there is a pose and nothing was wrong.
    pub fn is_sound(&self) -> bool {
        self.pose.is_some() && self.outlier == Outlier::None
    }

    /// The fit of all of the link's markers that were seen in a row.
    pub fn of(positions_mm: &[[f64; 3]], markers: &[LinkMarker]) -> Self {
        let seen = seen(positions_mm, markers);
        let pose = rigid::fit(seen.clone().map(|(_, pair)| pair));
        Self { seen: seen.count(), pose, outlier: Outlier::None }
    }
}

/// Index of every marker of a link that was seen in a row, with its positions in the link's own
/// frame and in the cameras'.
pub(super) fn seen(
    positions_mm: &[[f64; 3]],
    markers: &[LinkMarker],
) -> impl Iterator<Item = (usize, ([f64; 2], [f64; 2]))> + Clone {
    markers.iter().enumerate().filter_map(|(i, marker)| {
        let [x, y, _] = positions_mm[marker.column];
        (!x.is_nan()).then_some((i, (marker.local_position_mm, [x, y])))
    })
}
