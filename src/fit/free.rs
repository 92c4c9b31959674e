//! The parameters that a fit leaves free.

use crate::config::{Fit, Free};
use crate::motion::Model;
use crate::robot::{Family, Gait, Parameter};

/// Relative distance from a bound that counts as at it.
const AT_BOUND: f64 = 1e-3;

/// A parameter that a fit leaves free, and its bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeParameter {
    pub parameter: Parameter,
    pub bounds: [f64; 2],
}

impl FreeParameter {
    /// The parameters that a fit of `model` frees: those of its list, else the paper's. What the
    /// model does not have is left out.
    pub fn free_in(model: Model, gait: &Gait, fit: &Fit, list: Option<&Free>) -> Vec<Self> {
        let by_default: &[Parameter] = match model {
            Model::Skid | Model::SkidRoll => &Parameter::SKID,
            Model::NoSkidDamped => &[Parameter::Damping],
            _ => &[],
        };
        let listed = list.map_or(by_default, |Free(parameters)| parameters);
        let known = listed.iter().filter(|parameter| model.knows(**parameter, gait));
        known.map(|&parameter| Self { parameter, bounds: bounds(parameter, fit) }).collect()
    }

    /// At which of its bounds a value is: lower, upper.
    pub(super) fn is_at_bound(&self, value: f64) -> [bool; 2] {
        let [low, high] = self.bounds;
        [value < low * (1.0 + AT_BOUND), value > high * (1.0 - AT_BOUND)]
    }
}

fn bounds(parameter: Parameter, fit: &Fit) -> [f64; 2] {
    match (parameter.family(), parameter) {
        (Family::Skid, _) => fit.skid_bounds_kg_s,
        (Family::Roll, _) => fit.roll_bounds_kg_s,
        (Family::Joint, Parameter::Stiffness) => fit.stiffness_bounds_nm_rad,
        (Family::Joint, _) => fit.damping_bounds_nm_s_rad,
    }
}
