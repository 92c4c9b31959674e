//! Units of length as files write them.

use crate::named;

named! {
    /// Units of length of marker files.
    pub enum LengthUnit {
        Mm = "mm",
        Cm = "cm",
        M = "m",
        In = "in",
    }
}

impl LengthUnit {
    /// Its length, mm.
    pub fn mm(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
            Self::In => 25.4,
        }
    }
}
