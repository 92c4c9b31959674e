//! The paper's motions and tables, whatever the user's configuration says.

use std::collections::BTreeMap;

use serde::Deserialize;

use crate::config::Config;
use crate::motion::{Model, Problem};
use crate::robot::Robot;

/// Fitted values of Tables I and II; what is missing is not fitted.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fitted {
    pub skid_kg_s: [f64; 3],
    pub stiffness_nm_rad: Option<f64>,
    pub damping_nm_s_rad: Option<f64>,
}

/// A motion of the paper, at any frequency.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionSpec {
    pub campaign: String,
    pub model: Model,
    /// With the tables' "fitted values"; else with those "used in the numerical simulations".
    #[serde(default)]
    pub fitted: bool,
    /// Amplitude of joint 2, if it is not the command's.
    pub amplitude2_deg: Option<f64>,
    /// What the skid coefficients are multiplied by.
    pub skid_factor: Option<f64>,
    /// Damping of the passive joint, if it is not the table's.
    pub damping_nm_s_rad: Option<f64>,
}

/// The paper's parameters and motions.
#[derive(Debug)]
pub struct Paper {
    /// The default, which is that of the paper's simulations.
    pub config: Config,
    pub fitted: BTreeMap<String, Fitted>,
    pub motion: BTreeMap<String, MotionSpec>,
}

impl Paper {
    pub fn new(fitted: BTreeMap<String, Fitted>, motion: BTreeMap<String, MotionSpec>) -> Self {
        Self { config: Config::default(), fitted, motion }
    }

    /// A motion at a frequency; `None` if there is no motion of this name.
    pub fn problem(&self, motion: &str, omega_rad_s: f64) -> Option<Problem> {
        let spec = self.motion.get(motion)?;
        let (mut robot, mut gait) = self.config.campaign_setup(&spec.campaign)?;
        if spec.fitted {
            let fitted = self.fitted.get(&spec.campaign)?;
            robot.skid_kg_s = fitted.skid_kg_s;
            robot.stiffness_nm_rad = fitted.stiffness_nm_rad.unwrap_or(robot.stiffness_nm_rad);
            robot.damping_nm_s_rad = fitted.damping_nm_s_rad.unwrap_or(robot.damping_nm_s_rad);
        }
        robot.damping_nm_s_rad = spec.damping_nm_s_rad.unwrap_or(robot.damping_nm_s_rad);
        let factor = spec.skid_factor.unwrap_or(1.0);
        robot.skid_kg_s = robot.skid_kg_s.map(|skid| factor * skid);
        if let (Some(amplitude_deg), [_, Some(joint2)]) = (spec.amplitude2_deg, &mut gait.joints) {
            joint2.amplitude_rad = amplitude_deg.to_radians();
        }
        Some(Problem { robot, gait, model: spec.model, omega_rad_s })
    }
}

/// A number that follows from Tables I and II by arithmetic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TableNumber {
    /// Of the passive joint about its rest, with the fitted spring.
    DampingRatio,
    /// `m_1` of Table II over Table I.
    MassIncrease,
    /// Largest relative difference of the side links of Table II.
    SideLinksDiffer,
    /// Moment of inertia of a bar with the middle link's mass and length, kg m^2.
    UniformMiddle,
    /// The same of a side link.
    UniformSide,
}

impl TableNumber {
    /// `None` if the fitted values are not there.
    pub fn value(self, paper: &Paper) -> Option<f64> {
        let (kinematic, passive) = (Robot::kinematic(), Robot::semi_passive());
        let apart = |[_, a, b]: [f64; 3]| (a - b).abs() / a;
        let bar = |mass_kg: f64, length_m: f64| mass_kg * length_m * length_m / 12.0;
        Some(match self {
            Self::DampingRatio => {
                // Of the link about its joint, as when it is let go.
                let inertia = passive.inertia_kg_m2[1] + passive.mass_kg[1] * passive.b_m.powi(2);
                let fitted = paper.fitted.get("semi-passive-symmetric")?;
                fitted.damping_nm_s_rad? / (2.0 * (fitted.stiffness_nm_rad? * inertia).sqrt())
            }
            Self::MassIncrease => passive.mass_kg[1] / kinematic.mass_kg[1],
            Self::SideLinksDiffer => apart(passive.mass_kg).max(apart(passive.inertia_kg_m2)),
            Self::UniformMiddle => bar(kinematic.mass_kg[0], 2.0 * kinematic.h_m),
            Self::UniformSide => bar(kinematic.mass_kg[1], 2.0 * kinematic.b_m),
        })
    }
}
