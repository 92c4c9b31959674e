//! What is to be as large, or as small, as possible.

use crate::named::named;

named! {
    /// What an optimal gait is best in.
    pub enum Objective {
        /// The distance covered in a cycle (eq. 17), m.
        Distance = "d",
        /// The mean speed (eq. 17), m/s.
        Speed = "v",
        /// The distance for the actuators' work over a cycle, m/J.
        DistancePerWork = "d-per-work",
        /// The mean speed for the actuators' mean power, m/J: the same number.
        SpeedPerPower = "v-per-power",
        /// The work for each metre, J/m: the inverse, which is to be small.
        WorkPerMetre = "work-per-metre",
    }
}

impl Objective {
    /// Whether the smallest value is the best.
    pub fn is_minimised(self) -> bool {
        self == Self::WorkPerMetre
    }

    /// The unit of its values.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Distance => "m",
            Self::Speed => "m/s",
            Self::DistancePerWork | Self::SpeedPerPower => "m/J",
            Self::WorkPerMetre => "J/m",
        }
    }

    /// Powers of d, omega and the work that it is the product of, but for a constant factor, once it is to be as
    /// large as possible.
    pub(super) fn powers(self) -> [f64; 3] {
        match self {
            Self::Distance => [1.0, 0.0, 0.0],
            Self::Speed => [1.0, 1.0, 0.0],
            Self::DistancePerWork | Self::SpeedPerPower | Self::WorkPerMetre => [1.0, 0.0, -1.0],
        }
    }

    /// Whether work is a part of it.
    pub fn knows_work(self) -> bool {
        self.powers()[2] != 0.0
    }

    /// Part of the best value that another one is short of it.
    pub(super) fn loss(self, value: f64, best: f64) -> f64 {
        if self.is_minimised() { value / best - 1.0 } else { 1.0 - value / best }
    }

    /// Its value for a motion.
    pub fn value(self, d_m: f64, v_m_s: f64, work_j: f64) -> f64 {
        match self {
            Self::Distance => d_m,
            Self::Speed => v_m_s,
            Self::DistancePerWork | Self::SpeedPerPower => d_m / work_j,
            Self::WorkPerMetre => work_j / d_m,
        }
    }
}
