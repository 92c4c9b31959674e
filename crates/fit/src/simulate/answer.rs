//! The answer at one frequency.

use serde::Serialize;
use serde_json::{Map, Value};
use trilink_mechanics::{
    Attractor, FromRest, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, SharpLimit,
    Solver, SteadyMotion,
};
use trilink_robot::Model;
use trilink_robot::metrics::GaitMetrics;
use trilink_tables::{Columns as _, Extrapolation, NoInterval, rows};

use super::{FitSummary, Setup};

/// What the motion of a [`Setup`](super::Setup) is at one frequency. One that does not exist has a reason
/// and no numbers: NaN, null in JSON.
#[derive(Debug, Serialize)]
pub struct Answer<'a> {
    pub model: Model,
    pub omega_rad_s: f64,
    #[serde(flatten)]
    pub metrics: GaitMetrics,
    /// Work of the actuators over a cycle, J, and per metre of d.
    pub work_j: f64,
    pub work_j_m: f64,
    pub status: MotionStatus,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    pub floquet: Option<f64>,
    pub from_rest: Option<FromRest>,
    /// Cycles after which the robot from rest is, and stays, within 1 % of its steady motion.
    pub cycles_to_settle: Option<usize>,
    /// The metrics where the transition speed of dry friction is zero.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sharp_limit: Option<SharpLimit>,
    /// How far the metrics may be off, where that was asked for.
    #[serde(flatten)]
    pub interval: Option<Interval>,
    /// What the coefficients were fitted to.
    #[serde(skip_serializing_if = "Option::is_none")]
    fit: Option<&'a FitSummary>,
    /// Whether the motion is beyond the trials of that fit.
    #[serde(flatten)]
    pub extrapolation: Option<Extrapolation>,
    parameters: &'a Map<String, Value>,
    /// What the joints are commanded to do.
    gait: &'a Map<String, Value>,
}

/// 95 % limits of the metrics by what the coefficients may be off by; missing for the reason in
/// `no_interval`.
#[derive(Debug, Clone, Serialize)]
pub struct Interval {
    pub lower: GaitMetrics,
    pub upper: GaitMetrics,
    pub no_interval: Option<NoInterval>,
}

impl Interval {
    pub(super) fn unknown(why: NoInterval) -> Self {
        let [lower, upper] = [GaitMetrics::MISSING; 2];
        Self { lower, upper, no_interval: Some(why) }
    }
}

/// The motion of a problem that an answer is of, which the solver has solved for last.
pub(super) fn solved(
    problem: &Problem,
    from_rest: bool,
) -> Result<(Solver, SteadyMotion), MotionError> {
    let mut solver = Solver::default();
    let metrics = solver.solve(problem, REFERENCE_ACCURACY);
    let motion = match from_rest {
        true => solver.attractor(problem, metrics, REFERENCE_ACCURACY)?.motion,
        false => solver.steady_motion(metrics?)?,
    };
    Ok((solver, motion))
}

rows! {
    /// An answer as a line: what `simulate --csv` prints.
    pub struct SimulationRow {
        pub model: Model,
        pub omega_rad_s: f64,
        pub metrics: GaitMetrics,
        /// 95 % limits, where they were asked for, and why there are none.
        pub lower: GaitMetrics as "{}_lo" after "{}",
        pub upper: GaitMetrics as "{}_hi" after "{}_lo",
        pub no_interval: Option<NoInterval>,
        /// Whether the model fits the trials that its coefficients are from.
        pub adequate: Option<bool>,
        /// Whether the motion is beyond the trials of the fit.
        pub extrapolation: Extrapolation as "{}",
        pub work_j: f64,
        pub work_j_m: f64,
        pub status: MotionStatus,
        pub reason: String,
        pub floquet: f64,
        pub from_rest: Option<FromRest>,
        pub cycles_to_settle: Option<i64>,
        /// The metrics where the transition speed of dry friction is zero, and by how much they may miss.
        pub sharp_limit: GaitMetrics as "sharp_limit_{}",
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
        let sharp_limit =
            motion.and_then(|_| problem.sharp_limit(REFERENCE_ACCURACY).ok().flatten());
        let metrics = motion.map_or(GaitMetrics::MISSING, |motion| motion.metrics);
        let work_j = motion.map_or(f64::NAN, |motion| motion.work_j);
        Self {
            model: setup.model,
            omega_rad_s: problem.omega_rad_s,
            metrics,
            work_j,
            work_j_m: if metrics.d_m > 0.0 { work_j / metrics.d_m } else { f64::NAN },
            status,
            reason,
            floquet: motion.and_then(|motion| motion.floquet),
            from_rest: reach,
            cycles_to_settle,
            sharp_limit,
            interval: None,
            fit: setup.fit(),
            extrapolation: setup.fit().map(|_| setup.extrapolation(problem)),
            parameters: &setup.parameters,
            gait: &setup.commands,
        }
    }

    /// Whether the motion is beyond the trials that the coefficients were fitted to.
    pub fn is_extrapolated(&self) -> bool {
        self.extrapolation.as_ref().is_some_and(|of| of.extrapolated == Some(true))
    }

    /// The same as a line of a table.
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
