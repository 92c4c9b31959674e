//! What `simulate` says of one frequency.

use serde::Serialize;
use serde_json::{Map, Value};

use crate::cli::output::say;
use crate::motion::{MotionError, Problem, REFERENCE_ACCURACY, Settled, Solver, SteadyMotion};

/// A motion that does not exist has no numbers but a reason.
#[derive(Serialize)]
pub(super) struct Answer<'a> {
    pub omega_rad_s: f64,
    pub d_m: Option<f64>,
    v_m_s: Option<f64>,
    sigma: [Option<f64>; 3],
    alpha1_rad: Option<f64>,
    dtheta_rad: Option<f64>,
    /// Work of the actuators over a cycle, J, and per metre of d.
    work_j: Option<f64>,
    work_j_m: Option<f64>,
    status: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<String>,
    floquet: Option<f64>,
    /// What the robot does that starts from rest: it gets into this motion (`reached`), into
    /// another one, or into none (`unsettled`).
    from_rest: Option<&'static str>,
    /// Cycles after which the robot from rest is, and stays, within 1 % of its steady motion.
    pub cycles_to_settle: Option<usize>,
    parameters: &'a Map<String, Value>,
}

impl<'a> Answer<'a> {
    /// Solves a problem; with `from_rest` for the motion in which the robot from rest ends.
    pub fn new(problem: &Problem, from_rest: bool, parameters: &'a Map<String, Value>) -> Self {
        let settled = Solver::default().settle(problem, REFERENCE_ACCURACY);
        let first = problem.solve(REFERENCE_ACCURACY);
        let mut answer = Self {
            omega_rad_s: problem.omega_rad_s,
            d_m: None,
            v_m_s: None,
            sigma: [None; 3],
            alpha1_rad: None,
            dtheta_rad: None,
            work_j: None,
            work_j_m: None,
            status: "",
            reason: None,
            floquet: None,
            from_rest: None,
            cycles_to_settle: settled.as_ref().ok().map(|settled| settled.cycles),
            parameters,
        };
        match (first, settled) {
            (Ok(first), settled) if !from_rest => {
                answer.motion(&first);
                answer.from_rest = Some(Settled::from_rest(&settled));
            }
            (_, Ok(settled)) => {
                answer.motion(&settled.motion);
                answer.from_rest = Some("reached");
            }
            (Err(error), Err(MotionError::Unsettled { .. })) if !from_rest => answer.error(&error),
            (_, Err(error)) => answer.error(&error),
        }
        answer
    }

    fn motion(&mut self, motion: &SteadyMotion) {
        let metrics = &motion.metrics;
        self.d_m = Some(metrics.d_m);
        self.v_m_s = Some(metrics.v_m_s);
        self.sigma = metrics.sigma.map(Some);
        self.alpha1_rad = Some(metrics.alpha1_rad);
        self.dtheta_rad = Some(metrics.dtheta_rad);
        self.work_j = Some(motion.work_j);
        self.work_j_m = (metrics.d_m > 0.0).then(|| motion.work_j / metrics.d_m);
        self.status = motion.status();
        self.floquet = motion.floquet;
    }

    fn error(&mut self, error: &MotionError) {
        self.status = error.status();
        self.reason = Some(error.to_string());
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
        let Some(((d_m, v_m_s), (alpha1, dtheta))) =
            answer.d_m.zip(answer.v_m_s).zip(answer.alpha1_rad.zip(answer.dtheta_rad))
        else {
            let reason = answer.reason.as_deref().unwrap_or_default();
            say!("{:>11} {}: {reason}", answer.omega_rad_s, answer.status);
            continue;
        };
        let [sigma0, sigma1, sigma2] = answer.sigma.map(Option::unwrap_or_default);
        let work = answer.work_j_m.map_or(String::new(), |work| fixed(work, 6));
        say!(
            "{:>11} {:>13.7} {:>13.7} {sigma0:>12.9} {sigma1:>12.9} {sigma2:>12.9} {:>12.8} {:>13} {work:>10}  {}{}",
            answer.omega_rad_s,
            1e3 * d_m,
            1e3 * v_m_s,
            alpha1.to_degrees(),
            fixed(dtheta.to_degrees(), 8),
            answer.status,
            answer.reach_in_words(),
        );
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
        match (self.from_rest, self.cycles_to_settle) {
            (Some("reached"), Some(0)) => String::new(),
            (Some("reached"), Some(1)) => ", from rest after 1 cycle".to_owned(),
            (Some("reached"), Some(cycles)) => format!(", from rest after {cycles} cycles"),
            (Some("another"), _) => {
                ", but from rest the robot gets into another motion (--from-rest)".to_owned()
            }
            (Some("unsettled"), _) => ", but from rest the robot does not settle".to_owned(),
            _ => String::new(),
        }
    }
}
