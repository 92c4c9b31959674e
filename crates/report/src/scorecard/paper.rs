//! Simulated motions from the paper, with the paper's own parameters instead of the user's configuration.

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

/// First frequency of the sweeps, which is the lowest frequency of the paper's trials.
const FROM_RAD_S: f64 = 0.5;
/// Frequency step of the sweeps, which is half the step between the paper's trials.
const STEP_RAD_S: f64 = 0.25;
/// Number of frequencies in a sweep.
const COUNT: usize = 23;

/// Parameter values, keyed by column name.
pub(super) type Values = BTreeMap<String, f64>;

/// Definition of a simulated motion from the paper, for any frequency.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MotionSpec {
    pub campaign: String,
    pub model: Model,
    /// Whether to use the paper's "fitted values" instead of the values "used in the numerical simulations".
    #[serde(default)]
    pub fitted: bool,
    /// Parameter values that replace those in the paper's tables.
    #[serde(default)]
    pub set: Values,
    /// Amplitude of joint 2 (degrees), if it differs from the commanded amplitude.
    pub amplitude2_deg: Option<f64>,
}

/// Parameters and simulated motions from the paper.
#[derive(Debug)]
pub(super) struct Paper {
    /// Configuration of the paper's simulations.
    pub config: Config,
    /// Fitted values in Tables I and II of the paper, keyed by campaign.
    pub fitted: BTreeMap<String, Values>,
    pub motion: BTreeMap<String, MotionSpec>,
    /// Frequency sweep of each motion, solved on first use.
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

    /// Returns the motion problem for a named motion at a given frequency; `None` if the motion, or a name in its
    /// definition, is unknown.
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
        let laws = self.config.model.get(&spec.model)?.laws();
        Some(Problem::new(robot, gait, laws, omega_rad_s))
    }

    fn known(&self, motion: &str, omega_rad_s: f64) -> Result<Problem, Error> {
        self.problem(motion, omega_rad_s).ok_or_else(|| unknown(motion))
    }

    /// Returns the value of a quantity of a named motion at a given frequency.
    pub(super) fn at(&self, motion: &str, omega_rad_s: f64, quantity: &str) -> Result<f64, Error> {
        let point = Point::solve(&mut Solver::default(), &self.known(motion, omega_rad_s)?);
        point.ok_or_else(|| missing(NO_MOTION))?.get(quantity)
    }

    /// Returns 1 if a named motion has a steady state at a given frequency, otherwise 0.
    pub(super) fn exists(&self, motion: &str, omega_rad_s: f64) -> Result<u8, Error> {
        let problem = self.known(motion, omega_rad_s)?;
        Ok(Point::solve(&mut Solver::default(), &problem).is_some().into())
    }

    /// Returns the value of a quantity that depends on a whole cycle of a named motion at a given frequency.
    pub(super) fn cycle(
        &self,
        motion: &str,
        omega_rad_s: f64,
        quantity: &str,
    ) -> Result<f64, Error> {
        cycle::find(&self.known(motion, omega_rad_s)?, quantity)
    }

    /// Returns the displacement (mm) in the cycle number `cycle`, counted from 1, of the transient of a named motion
    /// that starts from rest at phase 0.
    pub(super) fn transient_mm(
        &self,
        motion: &str,
        omega_rad_s: f64,
        cycle: usize,
    ) -> Result<f64, Error> {
        let transient = self.known(motion, omega_rad_s)?.cycles_from_rest(cycle, 1);
        let samples = transient.map_err(|_| missing(NO_MOTION))?;
        let [.., from, to] = &samples[..] else {
            return Err(missing(NO_MOTION));
        };
        Ok(1e3 * (to.pose.x_m - from.pose.x_m).hypot(to.pose.y_m - from.pose.y_m))
    }

    /// Returns a quantity of a named motion as a function of frequency.
    pub(super) fn curve(&self, motion: &str, quantity: &str) -> Result<Value, Error> {
        let sweep = self.sweeps.get(motion).ok_or_else(|| unknown(motion))?;
        Curve::from_points(sweep.get_or_init(|| self.sweep(motion)), quantity, false)
    }

    /// Solves for a named motion at all frequencies of the sweep, in increasing order.
    fn sweep(&self, motion: &str) -> Vec<Point> {
        let mut solver = Solver::default();
        let omegas = (0..COUNT).map(|i| FROM_RAD_S + STEP_RAD_S * i as f64);
        let problems = omegas.filter_map(|omega_rad_s| self.problem(motion, omega_rad_s));
        problems.filter_map(|problem| Point::solve(&mut solver, &problem)).collect()
    }
}
