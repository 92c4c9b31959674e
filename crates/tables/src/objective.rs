//! What is to be as large, or as small, as possible.

use std::f64::consts::TAU;

use crate::Objective;

impl Objective {
    /// Powers of d, omega and the work that it is the product of, but for a constant factor, once it is to be as
    /// large as possible.
    pub fn powers(self) -> [f64; 3] {
        match self {
            Self::Distance => [1.0, 0.0, 0.0],
            Self::Speed => [1.0, 1.0, 0.0],
            Self::DistancePerWork | Self::SpeedPerPower | Self::WorkPerMetre => [1.0, 0.0, -1.0],
        }
    }

    /// Whether it has the same optima as another one.
    pub fn is_like(self, other: Self) -> bool {
        self.powers() == other.powers()
    }

    /// What is to be small: the negative logarithm of its value, or where that is to be small the logarithm, but for
    /// a constant. `values` are d, omega and the work.
    pub fn cost(self, values: [f64; 3]) -> f64 {
        let logarithm =
            |(value, power): (f64, f64)| if power == 0.0 { 0.0 } else { power * value.ln() };
        -values.into_iter().zip(self.powers()).map(logarithm).sum::<f64>()
    }

    /// The same of a value of it.
    pub fn cost_of_value(self, value: f64) -> f64 {
        match self {
            // v = d omega / 2 pi.
            Self::Speed => -(TAU * value).ln(),
            Self::WorkPerMetre => value.ln(),
            _ => -value.ln(),
        }
    }

    /// Whether work is a part of it.
    pub fn knows_work(self) -> bool {
        self.powers()[2] != 0.0
    }

    /// Part of the best value that another one is short of it.
    pub fn loss(self, value: f64, best: f64) -> f64 {
        if self.is_minimised() { value / best - 1.0 } else { 1.0 - value / best }
    }
}
