//! The answer at one frequency.

use serde::Serialize;
use serde_json::{Map, Value};

use super::Setup;
use crate::metrics::GaitMetrics;
use crate::motion::{
    Attractor, FromRest, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, SharpLimit, Solver,
};
use crate::robot::Model;
use crate::store::rows;

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
    parameters: &'a Map<String, Value>,
    /// What the joints are commanded to do.
    gait: &'a Map<String, Value>,
}

rows! {
    /// An answer as a line: what `simulate --csv` prints.
    pub struct SimulationRow {
        pub model: Model,
        pub omega_rad_s: f64,
        pub metrics: GaitMetrics,
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
            parameters: &setup.parameters,
            gait: &setup.commands,
        }
    }

    /// The same as a line of a table.
    pub fn row(&self) -> SimulationRow {
        let limit = self.sharp_limit.as_ref();
        SimulationRow {
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
