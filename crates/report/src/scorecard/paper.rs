//! The paper's motions, whatever the user's configuration says.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use minijinja::Error;
use minijinja::value::{Object, Value};
use serde::Deserialize;
use trilink_base::Named as _;
use trilink_mechanics::{Model, Problem, Solver};
use trilink_robot::Parameter;
use trilink_tables::config::Config;

use super::curve::{Curve, Point};
use super::cycle;
use super::missing::{NO_MOTION, missing, unknown};

/// First and last frequency and the step between, rad/s: the paper's range in half of the steps
/// of its trials.
const FROM_RAD_S: f64 = 0.5;
const STEP_RAD_S: f64 = 0.25;
const COUNT: usize = 23;

/// Values of parameters, by column.
pub(super) type Values = BTreeMap<String, f64>;

/// A motion of the paper, at any frequency.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MotionSpec {
    pub campaign: String,
    pub model: Model,
    /// With the tables' "fitted values"; else with those "used in the numerical simulations".
    #[serde(default)]
    pub fitted: bool,
    /// Values that are others than the tables'.
    #[serde(default)]
    pub set: Values,
    /// Amplitude of joint 2, if it is not the command's.
    pub amplitude2_deg: Option<f64>,
}

/// The paper's parameters and motions.
#[derive(Debug)]
pub(super) struct Paper {
    /// That of the paper's simulations.
    pub config: Config,
    /// Fitted values of Tables I and II by campaign.
    pub fitted: BTreeMap<String, Values>,
    pub motion: BTreeMap<String, MotionSpec>,
    /// Of each motion over the frequencies, solved when asked for.
    sweeps: BTreeMap<String, OnceLock<Vec<Point>>>,
}

impl Object for Paper {}

impl Paper {
    pub(super) fn new(
        fitted: BTreeMap<String, Values>,
        motion: BTreeMap<String, MotionSpec>,
    ) -> Self {
        let sweeps = motion.keys().map(|name| (name.clone(), OnceLock::new())).collect();
        Self { config: Config::of_simulations(), fitted, motion, sweeps }
    }

    /// A motion at a frequency; `None` if there is no motion of this name, or it has an unknown column.
    pub(super) fn problem(&self, motion: &str, omega_rad_s: f64) -> Option<Problem> {
        let spec = self.motion.get(motion)?;
        let (mut robot, mut gait) = self.config.campaign_setup(&spec.campaign)?;
        let fitted = if spec.fitted { self.fitted.get(&spec.campaign)? } else { &Values::new() };
        for (column, value) in fitted.iter().chain(&spec.set) {
            Parameter::of_name(column)?.set(&mut robot, *value);
        }
        if let (Some(amplitude_deg), [_, Some(joint2)]) = (spec.amplitude2_deg, &mut gait.joints) {
            joint2.amplitude_rad = amplitude_deg.to_radians();
        }
        Some(Problem { robot, gait, laws: self.config.model.get(&spec.model)?.laws(), omega_rad_s })
    }

    fn known(&self, motion: &str, omega_rad_s: f64) -> Result<Problem, Error> {
        self.problem(motion, omega_rad_s).ok_or_else(|| unknown(motion))
    }

    /// A quantity of a motion at a frequency.
    pub(super) fn at(&self, motion: &str, omega_rad_s: f64, quantity: &str) -> Result<f64, Error> {
        let point = Point::solve(&mut Solver::default(), &self.known(motion, omega_rad_s)?);
        point.ok_or_else(|| missing(NO_MOTION))?.get(quantity)
    }

    /// 1 where there is a steady motion, else 0.
    pub(super) fn exists(&self, motion: &str, omega_rad_s: f64) -> Result<u8, Error> {
        let problem = self.known(motion, omega_rad_s)?;
        Ok(Point::solve(&mut Solver::default(), &problem).is_some().into())
    }

    /// What is read off a cycle of a motion.
    pub(super) fn cycle(
        &self,
        motion: &str,
        omega_rad_s: f64,
        quantity: &str,
    ) -> Result<f64, Error> {
        cycle::find(&self.known(motion, omega_rad_s)?, quantity)
    }

    /// A quantity of a motion over the frequencies.
    pub(super) fn curve(&self, motion: &str, quantity: &str) -> Result<Value, Error> {
        let sweep = self.sweeps.get(motion).ok_or_else(|| unknown(motion))?;
        Curve::of(sweep.get_or_init(|| self.sweep(motion)), quantity, false)
    }

    /// Solves for a motion at all frequencies, in their order.
    fn sweep(&self, motion: &str) -> Vec<Point> {
        let mut solver = Solver::default();
        let omegas = (0..COUNT).map(|i| FROM_RAD_S + STEP_RAD_S * i as f64);
        let problems = omegas.filter_map(|omega_rad_s| self.problem(motion, omega_rad_s));
        problems.filter_map(|problem| Point::solve(&mut solver, &problem)).collect()
    }
}
