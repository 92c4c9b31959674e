//! Values as the places in a C3D file state them.

use std::fmt;

/// Maximum 16-bit count, which files state in place of a count that does not fit into 16 bits.
pub(super) const MAX_U16: usize = 65_535;

/// Values that a file states for one quantity, each with the place that states it, the most reliable place first.
#[derive(Default)]
pub(super) struct Stated<T>(pub Vec<(T, &'static str)>);

impl<T: Copy + PartialEq> Stated<T> {
    pub(super) fn new<const N: usize>(places: [(Option<T>, &'static str); N]) -> Self {
        let stated = places.into_iter().filter_map(|(value, place)| Some((value?, place)));
        Self(stated.collect())
    }

    /// Returns the distinct values.
    pub(super) fn values(&self) -> Vec<T> {
        let mut values = Vec::new();
        for (value, _) in &self.0 {
            if !values.contains(value) {
                values.push(*value);
            }
        }
        values
    }

    pub(super) fn is_contradictory(&self) -> bool {
        self.values().len() > 1
    }
}

impl<T: fmt::Display> fmt::Display for Stated<T> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let texts: Vec<String> =
            self.0.iter().map(|(value, place)| format!("{value} ({place})")).collect();
        f.write_str(&if texts.is_empty() { "none".to_owned() } else { texts.join(" and ") })
    }
}

/// Number of frames as a place in the file states it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FrameCount {
    Exact(usize),
    /// 16-bit count, of which a longer recording states the remainder modulo 65536.
    Short(usize),
    /// Number of frames up to the largest 16-bit frame number, which stands for itself and all larger ones.
    AtLeast(usize),
}

impl FrameCount {
    /// Returns the count that a 16-bit parameter states; `None` if it is 0.
    pub(super) fn of_parameter(count: usize) -> Option<Self> {
        match count {
            0 => None,
            MAX_U16 => Some(Self::AtLeast(MAX_U16)),
            count if count < MAX_U16 => Some(Self::Short(count)),
            count => Some(Self::Exact(count)),
        }
    }

    /// Returns the count that the numbers of the first and the last frame in the header state; `None` if the last is 0.
    pub(super) fn of_header(first: usize, last: usize) -> Option<Self> {
        match last {
            0 => None,
            MAX_U16 => Some(Self::AtLeast(MAX_U16 + 1 - first)),
            // Modulo 65536, because the number of the last frame may have wrapped around.
            last => Some(Self::Short((last + MAX_U16 + 1 - first) % (MAX_U16 + 1) + 1)),
        }
    }

    /// Returns the stated count; `None` if it is only a lower limit.
    pub(super) fn stated(self) -> Option<usize> {
        match self {
            Self::Exact(count) | Self::Short(count) => Some(count),
            Self::AtLeast(_) => None,
        }
    }

    /// Returns whether a recording of this many frames would be stated in this way.
    pub(super) fn admits(self, frames: usize) -> bool {
        match self {
            Self::Exact(count) => frames == count,
            Self::Short(count) => frames >= count && (frames - count).is_multiple_of(MAX_U16 + 1),
            Self::AtLeast(count) => frames >= count,
        }
    }
}

impl fmt::Display for FrameCount {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Exact(count) | Self::Short(count) => write!(f, "{count}"),
            Self::AtLeast(count) => write!(f, "{count} or more"),
        }
    }
}
