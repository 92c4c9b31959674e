//! The coefficients that a fit can free.

use crate::config::{Fit, Free};
use crate::motion::{Derivatives, Model, Parameter as Derivative};
use crate::robot::{Gait, Robot};
use crate::store::PARAMETERS;

/// A coefficient that a fit can free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coefficient {
    /// Skid resistance of a wheel, kg/s.
    Skid(usize),
    /// Roll resistance of a wheel, kg/s.
    Roll(usize),
    /// Sum of the wheels' roll resistances, kg/s; their proportions stay.
    RollSum,
    /// Stiffness of the passive joint, N m/rad.
    Stiffness,
    /// Damping of the passive joint, N m s/rad.
    Damping,
}

impl Coefficient {
    /// Every coefficient, in the order of [`PARAMETERS`].
    pub const ALL: [Self; 9] = [
        Self::Skid(0),
        Self::Skid(1),
        Self::Skid(2),
        Self::Roll(0),
        Self::Roll(1),
        Self::Roll(2),
        Self::RollSum,
        Self::Stiffness,
        Self::Damping,
    ];

    /// Its place in [`Coefficient::ALL`].
    pub fn place(self) -> usize {
        match self {
            Self::Skid(wheel) => wheel,
            Self::Roll(wheel) => 3 + wheel,
            Self::RollSum => 6,
            Self::Stiffness => 7,
            Self::Damping => 8,
        }
    }

    /// The coefficient's column in the tables.
    pub fn name(self) -> &'static str {
        PARAMETERS[self.place()]
    }

    /// The coefficient's value in a robot.
    pub fn of(self, robot: &Robot) -> f64 {
        match self {
            Self::Skid(wheel) => robot.skid_kg_s[wheel],
            Self::Roll(wheel) => robot.roll_kg_s[wheel],
            Self::RollSum => robot.roll_kg_s.iter().sum(),
            Self::Stiffness => robot.stiffness_nm_rad,
            Self::Damping => robot.damping_nm_s_rad,
        }
    }

    /// Whether a model's motion can depend on it.
    pub fn is_known_to(self, model: Model, gait: &Gait) -> bool {
        match self {
            Self::Skid(_) => model.skids(),
            Self::Roll(_) | Self::RollSum => model.has_roll_resistance(),
            Self::Stiffness | Self::Damping => gait.passive_joint().is_some(),
        }
    }

    /// Gives the coefficient a value in a robot. Without any roll resistance to keep the
    /// proportions of, the wheels share a sum equally.
    pub fn set(self, robot: &mut Robot, value: f64) {
        match self {
            Self::Skid(wheel) => robot.skid_kg_s[wheel] = value,
            Self::Roll(wheel) => robot.roll_kg_s[wheel] = value,
            Self::RollSum => robot.roll_kg_s = roll_shares(robot).map(|share| share * value),
            Self::Stiffness => robot.stiffness_nm_rad = value,
            Self::Damping => robot.damping_nm_s_rad = value,
        }
    }

    /// The derivatives that [`Coefficient::by_logarithm`] needs.
    pub(super) fn derivatives(self) -> Vec<Derivative> {
        match self {
            Self::Skid(wheel) => vec![Derivative::Skid(wheel)],
            Self::Roll(wheel) => vec![Derivative::Roll(wheel)],
            Self::RollSum => [0, 1, 2].map(Derivative::Roll).into(),
            Self::Stiffness => vec![Derivative::Stiffness],
            Self::Damping => vec![Derivative::Damping],
        }
    }

    /// Derivatives of the metrics by the coefficient's logarithm.
    pub(super) fn by_logarithm(self, robot: &Robot, derivatives: &Derivatives) -> [f64; 7] {
        let by = |parameter: Derivative| derivatives[parameter.place()].to_array();
        let by_value = match self {
            Self::Skid(wheel) => by(Derivative::Skid(wheel)),
            Self::Roll(wheel) => by(Derivative::Roll(wheel)),
            Self::RollSum => {
                let shares = roll_shares(robot);
                let by_wheel = [0, 1, 2].map(|wheel| by(Derivative::Roll(wheel)));
                std::array::from_fn(|metric| {
                    (0..3).map(|wheel| shares[wheel] * by_wheel[wheel][metric]).sum()
                })
            }
            Self::Stiffness => by(Derivative::Stiffness),
            Self::Damping => by(Derivative::Damping),
        };
        by_value.map(|by| by * self.of(robot))
    }

    /// The coefficient's bounds in a fit.
    fn bounds(self, fit: &Fit) -> [f64; 2] {
        match self {
            Self::Skid(_) => fit.skid_bounds_kg_s,
            Self::Roll(_) | Self::RollSum => fit.roll_bounds_kg_s,
            Self::Stiffness => fit.stiffness_bounds_nm_rad,
            Self::Damping => fit.damping_bounds_nm_s_rad,
        }
    }

    /// The coefficients that a name of the configuration frees.
    fn named(free: Free) -> Vec<Self> {
        match free {
            Free::Skid => [0, 1, 2].map(Self::Skid).into(),
            Free::Skid0 => vec![Self::Skid(0)],
            Free::Skid1 => vec![Self::Skid(1)],
            Free::Skid2 => vec![Self::Skid(2)],
            Free::Roll => vec![Self::RollSum],
            Free::Roll0 => vec![Self::Roll(0)],
            Free::Roll1 => vec![Self::Roll(1)],
            Free::Roll2 => vec![Self::Roll(2)],
            Free::Stiffness => vec![Self::Stiffness],
            Free::Damping => vec![Self::Damping],
        }
    }
}

/// Each wheel's part of the sum of the roll resistances.
fn roll_shares(robot: &Robot) -> [f64; 3] {
    let sum: f64 = robot.roll_kg_s.iter().sum();
    if sum > 0.0 { robot.roll_kg_s.map(|roll| roll / sum) } else { [1.0 / 3.0; 3] }
}

/// A free coefficient and its bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    pub coefficient: Coefficient,
    pub bounds: [f64; 2],
}

impl Parameter {
    /// The parameters that a fit of `model` frees: those of its list, else the paper's. What the
    /// model does not have is left out.
    pub fn free_in(model: Model, gait: &Gait, fit: &Fit, list: Option<&[Free]>) -> Vec<Self> {
        let by_default: &[Free] = match model {
            Model::Skid | Model::SkidRoll => &[Free::Skid],
            Model::NoSkidDamped => &[Free::Damping],
            _ => &[],
        };
        let named = list.unwrap_or(by_default).iter().flat_map(|free| Coefficient::named(*free));
        named
            .filter(|coefficient| coefficient.is_known_to(model, gait))
            .map(|coefficient| Self { coefficient, bounds: coefficient.bounds(fit) })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_stand_in_the_order_of_the_tables() {
        for (place, coefficient) in Coefficient::ALL.into_iter().enumerate() {
            assert_eq!(coefficient.place(), place);
        }
        assert_eq!(Coefficient::Roll(2).name(), "roll2_kg_s");
        assert_eq!(Coefficient::RollSum.name(), "roll_sum_kg_s");
        assert_eq!(Coefficient::Damping.name(), "damping_nm_s_rad");
    }

    #[test]
    fn a_sum_of_roll_resistances_keeps_their_proportions() {
        let mut robot = Robot::kinematic();
        Coefficient::RollSum.set(&mut robot, 2.4);
        assert_eq!(robot.roll_kg_s, [1.2, 0.6, 0.6]);
        robot.roll_kg_s = [0.0; 3];
        Coefficient::RollSum.set(&mut robot, 2.4);
        assert_eq!(robot.roll_kg_s.map(|roll| (roll * 10.0).round()), [8.0; 3]);
    }
}
