//! What was wrong with a link's markers in a frame, and the pose that the others give.

use crate::ingest::markers::layout::LinkMarker;
use crate::ingest::markers::rigid::{self, LinkPose};

/// What was wrong with the markers of a link in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outlier {
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
pub struct LinkFit {
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
