//! Conversion of the gait optimisation's objectives to cost functions.

use std::f64::consts::TAU;

use crate::Objective;

impl Objective {
    /// Returns the exponents a, b, c for which the objective is proportional to `d^a omega^b work^c`, where d
    /// is the displacement per cycle and omega the frequency; for an objective that is minimised, the
    /// exponents for its inverse.
    pub fn powers(self) -> [f64; 3] {
        match self {
            Self::Distance => [1.0, 0.0, 0.0],
            Self::Speed => [1.0, 1.0, 0.0],
            Self::DistancePerWork | Self::SpeedPerPower | Self::WorkPerMetre => [1.0, 0.0, -1.0],
        }
    }

    /// Returns whether both objectives have the same optima.
    pub fn has_same_optima_as(self, other: Self) -> bool {
        self.powers() == other.powers()
    }

    /// Returns the cost to minimise, up to an additive constant: the negative logarithm of an objective that
    /// is maximised, or the logarithm of an objective that is minimised. `values` are the displacement per
    /// cycle (m), the frequency (rad/s) and the work per cycle (J).
    pub fn cost(self, values: [f64; 3]) -> f64 {
        let terms = values.into_iter().zip(self.powers());
        -terms
            .map(|(value, power)| if power == 0.0 { 0.0 } else { power * value.ln() })
            .sum::<f64>()
    }

    /// Returns the cost as [`Objective::cost`] does, but computed from a value of the objective.
    pub fn cost_of_value(self, value: f64) -> f64 {
        match self {
            // v = d omega / 2 pi.
            Self::Speed => -(TAU * value).ln(),
            Self::WorkPerMetre => value.ln(),
            _ => -value.ln(),
        }
    }

    /// Returns whether the objective depends on the actuators' work.
    pub fn depends_on_work(self) -> bool {
        self.powers()[2] != 0.0
    }

    /// Returns the relative loss: the fraction of `best`, the best value of the objective, by which `value` is worse.
    pub fn loss(self, value: f64, best: f64) -> f64 {
        if self.is_minimised() { value / best - 1.0 } else { 1.0 - value / best }
    }
}
