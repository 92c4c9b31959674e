//! What Tables I and II say of themselves.

use serde::Deserialize;

use super::paper::Paper;
use crate::robot::Robot;

/// A number that follows from the tables by arithmetic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tables {
    /// Of the passive joint about its rest, with the fitted spring.
    DampingRatio,
    /// The same, rad/s.
    NaturalFrequency,
    /// `m_1` of Table II over Table I.
    MassIncrease,
    /// Largest relative difference of the side links of Table II.
    SideLinksDiffer,
    /// Moment of inertia of a bar with the middle link's mass and length, kg m^2.
    UniformMiddle,
    /// The same of a side link.
    UniformSide,
}

impl Tables {
    /// `None` if the fitted values are not there.
    pub fn value(self, paper: &Paper<'_>) -> Option<f64> {
        let (kinematic, passive) = (Robot::kinematic(), Robot::semi_passive());
        let apart = |[_, a, b]: [f64; 3]| (a - b).abs() / a;
        let bar = |mass_kg: f64, length_m: f64| mass_kg * length_m * length_m / 12.0;
        // Of the link about its joint, as when it is let go.
        let inertia = passive.inertia_kg_m2[1] + passive.mass_kg[1] * passive.b_m.powi(2);
        let fitted = paper.fitted.get("semi-passive-symmetric")?;
        let (stiffness, damping) = (fitted.stiffness_nm_rad?, fitted.damping_nm_s_rad?);
        Some(match self {
            Self::DampingRatio => damping / (2.0 * (stiffness * inertia).sqrt()),
            Self::NaturalFrequency => (stiffness / inertia).sqrt(),
            Self::MassIncrease => passive.mass_kg[1] / kinematic.mass_kg[1],
            Self::SideLinksDiffer => apart(passive.mass_kg).max(apart(passive.inertia_kg_m2)),
            Self::UniformMiddle => bar(kinematic.mass_kg[0], 2.0 * kinematic.h_m),
            Self::UniformSide => bar(kinematic.mass_kg[1], 2.0 * kinematic.b_m),
        })
    }
}
