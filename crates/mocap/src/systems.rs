//! Camera systems whose text exports are read, recognised by how a file begins.

use super::cells::begins_with;
use super::table;

/// Program that exported a text file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum System {
    /// Vicon Nexus, Workstation or Tracker: several sections, each with a title.
    Vicon,
    Motive,
    /// Cortex, OpenSim and others.
    Trc,
    Qualisys,
    /// Any program: a table whose columns are named as `table` describes.
    Table,
}

impl System {
    pub(super) fn detect(text: &[u8]) -> Self {
        const BEGINNINGS: [(&[u8], System); 4] = [
            (b"format version", System::Motive),
            (b"pathfiletype", System::Trc),
            (b"no_of_frames", System::Qualisys),
            (b"file_version", System::Qualisys),
        ];
        let known = BEGINNINGS.iter().find(|(start, _)| begins_with(text, start));
        match known {
            Some((_, system)) => *system,
            None if table::is_table(text) => Self::Table,
            None => Self::Vicon,
        }
    }

    /// Returns the name of the format for messages.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Vicon => "Vicon CSV",
            Self::Motive => "OptiTrack Motive CSV",
            Self::Trc => "TRC",
            Self::Qualisys => "Qualisys TSV",
            Self::Table => "table",
        }
    }

    /// Returns the index of the axis that points up by default; `None` if it is always z.
    pub(super) fn usual_up_axis(self) -> Option<usize> {
        match self {
            Self::Vicon | Self::Table => None,
            Self::Motive => Some(1),
            Self::Trc | Self::Qualisys => Some(2),
        }
    }
}

#[cfg(test)]
mod tests;
