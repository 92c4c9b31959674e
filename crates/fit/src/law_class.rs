//! Whether a fitted law with dry friction can be distinguished from a simpler law.
//!
//! At skid velocities below the transition speed v_t, dry friction `F tanh(v / v_t)` is viscous with the coefficient
//! `F / v_t`; if no wheel ever skids faster, a campaign determines neither F nor v_t. If F is so large that a change by
//! the factor e changes every metric by less than a trial's noise, the wheels are effectively constrained.

use trilink_mechanics::{FIT_ACCURACY, MotionError, Solver};
use trilink_robot::{MAX_LINKS, Quantity, Robot};
use trilink_tables::{LINEAR_PART, LawKind, LawLike, Numbered};

use super::fitted_point::FittedPoint;
use super::objective::Objective;
use super::robots::Robots;
use super::variation::Variation;

/// Number of samples per cycle at which the skid velocities of the wheels are evaluated.
const SAMPLES: usize = 64;

/// Returns the simpler friction law to which a fitted law that includes dry friction is equivalent in all of the
/// model's solutions; `None` if the two laws can be distinguished.
pub(super) fn law_is_like(point: &FittedPoint, variation: &Variation) -> Option<LawLike> {
    let objective = point.evaluator.objective;
    let robots = objective.robots.with_values(&point.evaluator.parameters, &point.values);
    let transition_m_s = robots.value(Quantity::Transition.one());
    let max_skid_m_s = max_skid_velocity_m_s(objective, &robots);
    let is_slow = max_skid_m_s.is_ok_and(|max_m_s| max_m_s <= LINEAR_PART * transition_m_s);
    is_slow.then(|| {
        let has_static = objective.laws.skid.has_static();
        let dry = if has_static { Quantity::SkidStatic } else { Quantity::SkidDry };
        let is_insensitive = is_insensitive(point, variation);
        let kind = if is_insensitive { LawKind::Constrained } else { LawKind::Viscous };
        let value = |wheel| robots.value(dry.parameter(wheel)) / transition_m_s;
        let is_there = |wheel: &usize| value(*wheel).is_finite();
        let last = (0..MAX_LINKS).rfind(is_there).unwrap_or(0).max(robots.first().joints());
        LawLike {
            kind,
            viscous_kg_s: [0, 1, 2].map(value),
            more_viscous_kg_s: Numbered((Robot::LINKS..=last).map(value).collect()),
        }
    })
}

/// Returns the maximum skid velocity of the wheels in the model's solutions for all conditions, m/s.
fn max_skid_velocity_m_s(objective: &Objective, robots: &Robots) -> Result<f64, MotionError> {
    let mut solver = Solver::default();
    let mut max_m_s = 0.0_f64;
    for condition in &objective.conditions.all {
        let problem = objective.problem_of(robots, condition)?;
        solver.forget();
        solver.solve(&problem, FIT_ACCURACY)?;
        // The skid velocity of a link without a wheel is NaN, which the maximum ignores.
        for skid_m_s in solver.cycle(SAMPLES)?.into_iter().flat_map(|sample| sample.skid_m_s) {
            max_m_s = max_m_s.max(skid_m_s.abs());
        }
    }
    Ok(max_m_s)
}

/// Whether changing any free parameter by the factor e changes every metric by less than a trial's noise.
fn is_insensitive(point: &FittedPoint, variation: &Variation) -> bool {
    let objective = point.evaluator.objective;
    let trials = objective.measurements.iter().zip(variation.noises()).enumerate();
    let mut terms = trials.flat_map(|(trial, (measurement, noises))| {
        let response = &point.responses[objective.conditions.by_trial[trial].0];
        let terms = objective.terms(measurement);
        terms.map(move |(metric, ..)| (response, metric, noises[metric]))
    });
    terms.all(|(response, metric, noise)| {
        let slopes = response.iter().flat_map(|of| &of.d_metrics_d_logarithm);
        slopes.map(|slopes| slopes[metric].abs()).fold(0.0, f64::max) < noise
    })
}
