//! Whether a fitted law with dry friction is told from another one at all.
//!
//! Below the transition speed v_t dry friction `F tanh(v / v_t)` is viscous, with `F / v_t`; where
//! no wheel ever skids faster, a campaign tells neither F nor v_t. Where a wheel's F is so large
//! that a factor e of it moves no metric by a trial's noise, the wheels are as good as constrained.

use trilink_mechanics::{FIT_ACCURACY, MotionError, Solver};
use trilink_tables::{LINEAR_PART, LawKind, LawLike};

use super::fitted_point::FittedPoint;
use super::resampler::Resampler;

/// Samples of a cycle.
const SAMPLES: usize = 64;

/// What a fit's law, which has dry friction, is like at all of its motions, if any.
pub(super) fn law_is_like(point: &FittedPoint, resampler: &Resampler) -> Option<LawLike> {
    let objective = point.evaluator.objective;
    let robot = objective.robot_with(&point.evaluator.parameters, &point.values);
    let (skid, transition_m_s) = (objective.laws.skid, robot.transition_m_s);
    let fastest_m_s = || -> Result<f64, MotionError> {
        let (mut solver, mut fastest_m_s) = (Solver::default(), 0.0_f64);
        for condition in &objective.conditions.all {
            let problem = objective.problem_of(&robot, condition)?;
            solver.forget();
            solver.solve(&problem, FIT_ACCURACY)?;
            let cycle = solver.cycle(SAMPLES)?;
            let all = cycle.iter().flat_map(|sample| sample.skid_m_s);
            fastest_m_s = all.fold(fastest_m_s, |fastest, of| fastest.max(of.abs()));
        }
        Ok(fastest_m_s)
    };
    let is_slow = fastest_m_s().is_ok_and(|fastest| fastest <= LINEAR_PART * transition_m_s);
    is_slow.then(|| {
        let dry_n = if skid.has_static() { robot.skid_static_n } else { robot.skid_dry_n };
        let is_idle = is_idle(point, resampler);
        let kind = if is_idle { LawKind::Constrained } else { LawKind::Viscous };
        LawLike { kind, viscous_kg_s: dry_n.map(|dry_n| dry_n / transition_m_s) }
    })
}

/// Whether a factor e of any free parameter moves no metric by a trial's noise.
fn is_idle(point: &FittedPoint, resampler: &Resampler) -> bool {
    let objective = point.evaluator.objective;
    let trials = objective.measurements.iter().zip(resampler.noises()).enumerate();
    let mut all = trials.flat_map(|(trial, (measurement, noises))| {
        let response = &point.responses[objective.conditions.of_trials[trial].0];
        let terms = objective.terms(measurement);
        terms.map(move |(metric, ..)| (response, metric, noises[metric]))
    });
    all.all(|(response, metric, noise)| {
        let slopes = response.iter().flat_map(|of| &of.d_metrics_d_logarithm);
        slopes.map(|slopes| slopes[metric].abs()).fold(0.0, f64::max) < noise
    })
}
