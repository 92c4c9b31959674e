//! The answer of `simulate` at one frequency.

use serde::Serialize;
use serde_json::{Map, Value};

use crate::cli::output::say;
use crate::metrics::GaitMetrics;
use crate::motion::{
    Attractor, FromRest, MotionError, MotionStatus, Problem, REFERENCE_ACCURACY, SharpLimit, Solver,
};

/// A motion that does not exist has a reason and no numbers: NaN, null in JSON.
#[derive(Serialize)]
pub(super) struct Answer<'a> {
    pub omega_rad_s: f64,
    #[serde(flatten)]
    pub metrics: GaitMetrics,
    /// Work of the actuators over a cycle, J, and per metre of d.
    work_j: f64,
    work_j_m: f64,
    status: MotionStatus,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    floquet: Option<f64>,
    from_rest: Option<FromRest>,
    /// Cycles after which the robot from rest is, and stays, within 1 % of its steady motion.
    pub cycles_to_settle: Option<usize>,
    /// The metrics where the transition speed of dry friction is zero.
    #[serde(skip_serializing_if = "Option::is_none")]
    sharp_limit: Option<SharpLimit>,
    parameters: &'a Map<String, Value>,
}

impl<'a> Answer<'a> {
    /// Solves a problem; with `from_rest` for the motion in which the robot from rest ends.
    pub fn new(problem: &Problem, from_rest: bool, parameters: &'a Map<String, Value>) -> Self {
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
            parameters,
        }
    }
}

pub(super) fn print_table(answers: &[Answer]) {
    say!(
        "{:>11} {:>13} {:>13} {:>12} {:>12} {:>12} {:>12} {:>13} {:>10}  status",
        "omega rad/s",
        "d mm",
        "v mm/s",
        "sigma0",
        "sigma1",
        "sigma2",
        "alpha1 deg",
        "dtheta deg",
        "work J/m"
    );
    for answer in answers {
        if let Some(reason) = &answer.reason {
            say!("{:>11} {}: {reason}", answer.omega_rad_s, answer.status);
            continue;
        }
        let GaitMetrics { d_m, v_m_s, sigma, alpha1_rad, dtheta_rad } = answer.metrics;
        let sigma = sigma.map(|sigma| format!("{sigma:>12.9}")).join(" ");
        let work = match answer.work_j_m.is_nan() {
            true => String::new(),
            false => fixed(answer.work_j_m, 6),
        };
        say!(
            "{:>11} {:>13.7} {:>13.7} {sigma} {:>12.8} {:>13} {work:>10}  {}{}",
            answer.omega_rad_s,
            1e3 * d_m,
            1e3 * v_m_s,
            alpha1_rad.to_degrees(),
            fixed(dtheta_rad.to_degrees(), 8),
            answer.status,
            answer.reach_in_words(),
        );
        if let Some(SharpLimit { metrics, uncertainty }) = &answer.sharp_limit {
            let percent = |value: f64| 100.0 * value / d_m;
            say!(
                "{:>11} d is {:+.2} % (\u{b1}{:.2}) where transition_m_s goes to zero",
                "",
                percent(metrics.d_m - d_m),
                percent(uncertainty.d_m),
            );
        }
    }
}

/// A number with `digits` after the point, without a minus before nothing.
fn fixed(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let is_nothing = text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
    if is_nothing { text.trim_start_matches('-').to_owned() } else { text }
}

impl Answer<'_> {
    fn reach_in_words(&self) -> String {
        let of_two = match self.status {
            MotionStatus::SymmetryBroken => ": one of two that are each other's mirror image",
            _ => "",
        };
        let reach = match (self.from_rest, self.cycles_to_settle) {
            (Some(FromRest::Reached), Some(0)) => String::new(),
            (Some(FromRest::Reached), Some(1)) => ", from rest after 1 cycle".to_owned(),
            (Some(FromRest::Reached), Some(cycles)) => format!(", from rest after {cycles} cycles"),
            (Some(FromRest::Another), _) => {
                ", but from rest the robot gets into another motion (--from-rest)".to_owned()
            }
            (Some(FromRest::Unsettled), _) => {
                ", but from rest the robot does not settle".to_owned()
            }
            _ => String::new(),
        };
        of_two.to_owned() + &reach
    }
}
