//! Units of length in marker files.

use crate::named;

named! {
    /// Unit of length in a marker file.
    pub enum LengthUnit {
        Mm = "mm",
        Cm = "cm",
        M = "m",
        In = "in",
    }
}

impl LengthUnit {
    /// Returns the length of the unit in mm.
    pub fn mm(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
            Self::In => 25.4,
        }
    }
}
