//! The paper's motions, whatever the user's configuration says.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::claims::Claims;
use crate::config::Config;
use crate::motion::{Model, Problem};

/// Fitted values of Tables I and II; what is missing is not fitted.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fitted {
    pub skid_kg_s: [f64; 3],
    pub stiffness_nm_rad: Option<f64>,
    pub damping_nm_s_rad: Option<f64>,
}

/// Which values of the tables a motion has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Values {
    /// "Values used in the numerical simulations".
    Simulation,
    /// "Fitted values".
    Fitted,
}

/// A motion of the paper, at any frequency.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotionSpec {
    pub campaign: String,
    pub model: Model,
    pub values: Values,
    /// Amplitude of joint 2, if it is not the command's.
    pub amplitude2_deg: Option<f64>,
    /// What the skid coefficients are multiplied by.
    pub skid_factor: Option<f64>,
    /// Damping of the passive joint, if it is not the table's.
    pub damping_nm_s_rad: Option<f64>,
}

/// The paper's parameters and motions.
#[derive(Debug)]
pub struct Paper<'c> {
    pub config: Config,
    pub fitted: &'c BTreeMap<String, Fitted>,
    motion: &'c BTreeMap<String, MotionSpec>,
}

impl<'c> Paper<'c> {
    /// The default configuration is the paper's simulations.
    pub fn new(claims: &'c Claims) -> Self {
        Self { config: Config::default(), fitted: &claims.fitted, motion: &claims.motion }
    }

    /// A motion at a frequency; `None` if there is no motion of this name.
    pub fn problem(&self, motion: &str, omega_rad_s: f64) -> Option<Problem> {
        let spec = self.motion.get(motion)?;
        let (mut robot, mut gait) = self.config.campaign_setup(&spec.campaign)?;
        if spec.values == Values::Fitted {
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
