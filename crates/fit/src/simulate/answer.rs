//! Result of a simulation at one frequency.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Map, Value};
use trilink_mechanics::{
    Attractor, FromRest, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, SharpLimit,
    Solver, SteadyMotion,
};
use trilink_robot::metrics::GaitMetrics;
use trilink_robot::{Chain, GRAVITY_M_S2, Model};
use trilink_tables::{Columns as _, Extrapolation, NoInterval, rows};

use super::{FitSummary, Setup};

/// Steady-state motion of a [`Setup`] at one frequency. If the model has no periodic solution, all values are NaN or `None`
/// (null in JSON) and a reason is given.
#[derive(Debug, Serialize)]
pub struct Answer<'a> {
    #[serde(skip)]
    pub setup: &'a Setup,
    pub model: Model,
    pub omega_rad_s: f64,
    #[serde(flatten)]
    pub metrics: GaitMetrics,
    /// Work done by the actuators over a cycle, J.
    pub work_j: f64,
    /// Work done by the actuators per metre of displacement, J/m.
    pub work_j_m: f64,
    /// Work done by the actuators over a cycle, divided by weight and displacement; dimensionless.
    pub cost_of_transport: f64,
    /// Stability of the motion, or why there is none.
    pub status: MotionStatus,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Modulus of the largest Floquet multiplier; `None` if the motion has no dynamic states.
    pub floquet: Option<f64>,
    /// Whether this motion is reached from rest; `None` if there is none.
    pub from_rest: Option<FromRest>,
    /// Number of cycles after which the robot, started from rest, stays within 1 % of its steady-state motion; `None`
    /// if unknown.
    pub cycles_to_settle: Option<usize>,
    /// Metrics extrapolated to zero transition speed (the speed below which dry friction is smoothed); `None` if the
    /// motion does not depend on dry friction, if the extrapolation fails, or if this motion is reached from rest but not
    /// the one that Newton's method finds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sharp_limit: Option<SharpLimit>,
    /// Confidence limits of the metrics, if requested.
    #[serde(flatten)]
    pub interval: Option<Interval>,
    /// Summary of the fit that provides the coefficients; `None` for configured coefficients.
    #[serde(skip_serializing_if = "Option::is_none")]
    fit: Option<&'a FitSummary>,
    /// Whether the simulation lies outside the range of the fitted trials; `None` for configured coefficients.
    #[serde(flatten)]
    pub extrapolation: Option<Extrapolation>,
    /// Names of the links of a chain in the order in which metrics number them.
    #[serde(skip_serializing_if = "Option::is_none")]
    links: Option<Vec<String>>,
    parameters: &'a Map<String, Value>,
    /// Fitted coefficients of a chain, whose `parameters` are those of the configuration.
    #[serde(skip_serializing_if = "Option::is_none")]
    coefficients: Option<BTreeMap<&'static str, f64>>,
    /// Keys and values of the gait in the configuration.
    gait: &'a Map<String, Value>,
}

/// 95 % confidence limits of the metrics due to the uncertainty of the coefficients, from the refits of the bootstrap. If
/// there are none, they are NaN
/// and `no_interval` gives the reason.
#[derive(Debug, Clone, Serialize)]
pub struct Interval {
    pub lower: GaitMetrics,
    pub upper: GaitMetrics,
    pub no_interval: Option<NoInterval>,
}

impl Interval {
    /// Returns confidence limits that are all missing (NaN), with the reason.
    pub(super) fn unknown(reason: NoInterval) -> Self {
        Self { lower: GaitMetrics::MISSING, upper: GaitMetrics::MISSING, no_interval: Some(reason) }
    }
}

/// Solves for the steady-state motion or, if `from_rest` or if none is found, for the attractor reached from rest. The
/// returned solver holds this solution as its latest one.
pub(super) fn solve_motion(
    problem: &Problem,
    from_rest: bool,
) -> Result<(Solver, SteadyMotion), MotionError> {
    let mut solver = Solver::default();
    let motion = match solver.solve(problem, REFERENCE_ACCURACY) {
        Ok(metrics) if !from_rest => solver.steady_motion(metrics)?,
        first => solver.attractor(problem, first, REFERENCE_ACCURACY)?.motion,
    };
    Ok((solver, motion))
}

rows! {
    /// Table row for an [`Answer`], as printed by `simulate --csv`.
    pub struct SimulationRow {
        pub model: Model,
        pub omega_rad_s: f64,
        pub metrics: GaitMetrics,
        /// Lower 95 % confidence limits of the metrics, if requested.
        pub lower: GaitMetrics as "{}_lo" after "{}",
        /// Upper 95 % confidence limits of the metrics, if requested.
        pub upper: GaitMetrics as "{}_hi" after "{}_lo",
        /// Reason for missing confidence limits.
        pub no_interval: Option<NoInterval>,
        /// Whether the model is adequate for the fitted trials.
        pub adequate: Option<bool>,
        /// Whether the simulation lies outside the range of the fitted trials; blank for configured coefficients.
        pub extrapolation: Extrapolation as "{}",
        pub work_j: f64,
        pub work_j_m: f64,
        pub cost_of_transport: f64,
        pub status: MotionStatus,
        pub reason: String,
        pub floquet: f64,
        pub from_rest: Option<FromRest>,
        pub cycles_to_settle: Option<i64>,
        /// Metrics extrapolated to zero transition speed (the speed below which dry friction is smoothed); NaN if the
        /// motion does not depend on dry friction, or if there is no such limit of this motion.
        pub sharp_limit: GaitMetrics as "sharp_limit_{}",
        /// Uncertainty of the extrapolation to zero transition speed.
        pub uncertainty: GaitMetrics as "sharp_limit_{}_uncertainty" after "sharp_limit_{}",
    }
}

impl<'a> Answer<'a> {
    pub(super) fn new(setup: &'a Setup, problem: &Problem, from_rest: bool) -> Self {
        let mut solver = Solver::default();
        let metrics = solver.solve(problem, REFERENCE_ACCURACY);
        let first = metrics.clone().and_then(|metrics| solver.steady_motion(metrics));
        let attractor = solver.attractor(problem, metrics, REFERENCE_ACCURACY);
        let cycles_to_settle = attractor.as_ref().ok().map(|attractor| attractor.cycles);
        let is_found_by_solve = match &attractor {
            Ok(attractor) if from_rest => attractor.is_found_by_solve,
            _ => first.is_ok(),
        };
        let (motion, reach) = match (first, attractor) {
            (Ok(first), attractor) if !from_rest => {
                (Ok(first), Some(Attractor::from_rest(&attractor)))
            }
            (_, Ok(attractor)) => (Ok(attractor.motion), Some(FromRest::Reached)),
            (Err(error), Err(MotionError::Unsettled { .. })) if !from_rest => (Err(error), None),
            (_, Err(error)) => (Err(error), None),
        };
        let (status, reason) = match &motion {
            Ok(motion) => (motion.status(), None),
            Err(error) => (error.status(), Some(error.to_string())),
        };
        let motion = motion.ok();
        let sharp_limit = motion
            .filter(|_| is_found_by_solve)
            .and_then(|_| problem.sharp_limit(REFERENCE_ACCURACY).ok().flatten());
        let metrics = motion.map_or(GaitMetrics::MISSING, |motion| motion.metrics);
        let work_j = motion.map_or(f64::NAN, |motion| motion.work_j);
        let work_j_m = if metrics.d_m > 0.0 { work_j / metrics.d_m } else { f64::NAN };
        let chain = setup.robot.as_chain();
        let fitted = setup.fitted.as_ref().filter(|_| chain.is_some());
        Self {
            setup,
            model: setup.model,
            omega_rad_s: problem.omega_rad_s,
            metrics,
            work_j,
            work_j_m,
            cost_of_transport: work_j_m / (GRAVITY_M_S2 * problem.robot.mass_kg()),
            status,
            reason,
            floquet: motion.and_then(|motion| motion.floquet),
            from_rest: reach,
            cycles_to_settle,
            sharp_limit,
            interval: None,
            fit: setup.fit(),
            extrapolation: setup.fit().map(|_| setup.extrapolation(problem)),
            links: chain.map(Chain::names_by_number),
            parameters: &setup.parameters,
            coefficients: fitted.map(|fitted| {
                fitted.coefficients().map(|(of, value)| (of.name(), value)).collect()
            }),
            gait: &setup.commands,
        }
    }

    /// Returns whether the simulation is known to lie outside the range of the fitted trials.
    pub fn is_extrapolated(&self) -> bool {
        self.extrapolation.as_ref().is_some_and(|of| of.extrapolated == Some(true))
    }

    /// Returns the table row for this simulation.
    pub fn row(&self) -> SimulationRow {
        let limit = self.sharp_limit.as_ref();
        let interval = self.interval.as_ref();
        SimulationRow {
            lower: interval.map_or(GaitMetrics::MISSING, |interval| interval.lower),
            upper: interval.map_or(GaitMetrics::MISSING, |interval| interval.upper),
            no_interval: interval.and_then(|interval| interval.no_interval.clone()),
            adequate: self.fit.and_then(|fit| fit.adequate),
            extrapolation: self.extrapolation.clone().unwrap_or_else(Extrapolation::blank),
            model: self.model,
            omega_rad_s: self.omega_rad_s,
            metrics: self.metrics,
            work_j: self.work_j,
            work_j_m: self.work_j_m,
            cost_of_transport: self.cost_of_transport,
            status: self.status,
            reason: self.reason.clone().unwrap_or_default(),
            floquet: self.floquet.unwrap_or(f64::NAN),
            from_rest: self.from_rest,
            cycles_to_settle: self.cycles_to_settle.map(|cycles| cycles as i64),
            sharp_limit: limit.map_or(GaitMetrics::MISSING, |limit| limit.metrics),
            uncertainty: limit.map_or(GaitMetrics::MISSING, |limit| limit.uncertainty),
        }
    }
}
