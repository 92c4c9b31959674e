//! Motions that no table holds, for the figures that show them.

use rayon::prelude::*;
use trilink_mechanics::{
    FIT_ACCURACY, FORCES_ACCURACY, Model, MotionError, Pose, Problem, REFERENCE_ACCURACY, Sample,
    Solver,
};
use trilink_robot::metrics::GaitMetrics;
use trilink_statistics::extremes;
use trilink_tables::config::GaitInput;
use trilink_tables::{FitRow, PredictionSource, TrialRow};

use crate::ReportInput;
use crate::tables::Tables;

/// Frequencies at which figures show simulated motions.
pub(crate) const OMEGAS_RAD_S: std::ops::RangeInclusive<f64> = 0.01..=100.0;
/// Samples of a cycle that a figure shows.
pub(crate) const SAMPLES: usize = 240;

/// The motion of a model of a campaign's robot as configured; `None` if one of them is not.
pub(crate) fn configured(
    input: &ReportInput,
    campaign: &str,
    model: Model,
    omega_rad_s: f64,
) -> Option<Problem> {
    let (robot, gait) = input.campaign_setup(campaign)?;
    let laws = input.models().get(&model)?.laws();
    Some(Problem { robot, gait, laws, omega_rad_s })
}

/// The motion of a fitted model under the commanded gait; `None` where there is no fit, or its
/// campaign is not known.
pub(crate) fn fitted(input: &ReportInput, fit: &FitRow, omega_rad_s: f64) -> Option<Problem> {
    let mut problem = configured(input, &fit.campaign, fit.model, omega_rad_s)?;
    for (parameter, value) in fit.parameters.iter().filter(|(_, value)| value.is_finite()) {
        // The single coefficients are known wherever their sum is.
        if !parameter.is_sum() {
            parameter.set(&mut problem.robot, *value);
        }
    }
    fit.status.is_ok().then_some(problem)
}

/// The motion of a fitted model at a trial's frequency, under the gait that drove the fit.
pub(crate) fn fitted_to(input: &ReportInput, fit: &FitRow, trial: &TrialRow) -> Option<Problem> {
    let problem = fitted(input, fit, trial.omega_rad_s)?;
    let is_measured = fit.gait_input == GaitInput::Measured;
    Some(if is_measured { under_gait_of(trial, problem) } else { problem })
}

/// The same under the ellipse that is nearest to a trial's gait; a passive joint stays so.
pub(crate) fn under_gait_of(trial: &TrialRow, mut problem: Problem) -> Problem {
    for (command, measured) in problem.gait.joints.iter_mut().zip(&trial.gait) {
        *command = command.map(|command| command.measured(measured.command()));
    }
    problem
}

/// A quantity of a fitted model over the frequencies of its curve, of which every so many are enough;
/// broken where there is no stable motion that has it.
pub(crate) fn curve(
    tables: &Tables,
    input: &ReportInput,
    fit: &FitRow,
    of: impl Fn(&mut Solver, &Problem) -> Option<f64> + Sync,
) -> Vec<(f64, f64)> {
    /// Every so many of the curves' frequencies, and of very many so many.
    const STRIDE: usize = 2;
    const MOST: usize = 100;
    let curve = tables.source(input).predicted(&fit.campaign, fit.model, PredictionSource::Curve);
    let omegas = curve.map(|row| row.omega_rad_s);
    let mut omegas: Vec<f64> = omegas.filter(|omega| OMEGAS_RAD_S.contains(omega)).collect();
    omegas.sort_by(f64::total_cmp);
    let point = |omega_rad_s: f64| {
        let problem = fitted(input, fit, omega_rad_s);
        let value = problem.and_then(|problem| of(&mut Solver::default(), &problem));
        (omega_rad_s, value.unwrap_or(f64::NAN))
    };
    let stride = STRIDE.max(omegas.len().div_ceil(MOST));
    omegas.into_par_iter().step_by(stride).map(point).collect()
}

/// A steady motion.
pub(crate) struct Steady {
    pub metrics: GaitMetrics,
    pub cycle: Vec<Sample>,
    /// Cycles after which the robot from rest is within 1 % of it, if it gets there.
    pub cycles_to_settle: Option<usize>,
}

/// The steady motion that the robot reaches from rest, or where it reaches none the one that
/// there is.
///
/// # Errors
/// There is no steady motion.
pub(crate) fn steady(problem: &Problem) -> Result<Steady, MotionError> {
    let mut solver = Solver::default();
    let (metrics, cycles_to_settle) = match solver.settle(problem, FORCES_ACCURACY) {
        Ok(settled) => (settled.motion.metrics, Some(settled.cycles)),
        // The roughest motions cannot be had to the accuracy that their forces would need.
        Err(_) => {
            solver.forget();
            (solver.solve(problem, REFERENCE_ACCURACY)?, None)
        }
    };
    Ok(Steady { metrics, cycle: solver.cycle(SAMPLES)?, cycles_to_settle })
}

/// A cycle of a stable steady motion, of the one reached from rest where another is not stable.
///
/// # Errors
/// There is no steady motion.
pub(crate) fn stable_cycle(problem: &Problem) -> Result<Vec<Sample>, MotionError> {
    let mut solver = Solver::default();
    let cycle = stable(&mut solver, problem).and_then(|_| solver.cycle(SAMPLES).ok());
    cycle.map_or_else(|| steady(problem).map(|steady| steady.cycle), Ok)
}

/// Work of the actuators per metre of d, J/m; `None` where there is no stable motion that goes
/// anywhere.
pub(crate) fn work_j_m(solver: &mut Solver, problem: &Problem) -> Option<f64> {
    let metrics = stable(solver, problem)?;
    let [work_j, _] = solver.work_and_loss_j().ok()?;
    (metrics.d_m > 0.0).then(|| work_j / metrics.d_m)
}

/// Half of what a joint moves from peak to peak, rad; `None` where there is no stable motion.
pub(crate) fn amplitude_rad(solver: &mut Solver, problem: &Problem, joint: usize) -> Option<f64> {
    stable(solver, problem)?;
    let cycle = solver.cycle(SAMPLES).ok()?;
    let [low, high] = extremes(cycle.iter().map(|sample| sample.phi_rad[joint]));
    Some(0.5 * (high - low))
}

fn stable(solver: &mut Solver, problem: &Problem) -> Option<GaitMetrics> {
    let metrics = solver.solve(problem, FIT_ACCURACY).ok()?;
    let is_stable = solver.floquet().ok()?.is_none_or(|modulus| modulus < 1.0);
    is_stable.then_some(metrics)
}

/// Time (s) and pose of a motion that repeats a cycle, which starts at the origin, so often from
/// `start` on.
pub(crate) fn repeat(cycle: &[Sample], cycles: usize, start: Pose) -> Vec<(f64, Pose)> {
    let [first, .., last] = cycle else { return Vec::new() };
    let mut poses = vec![(0.0, start)];
    let (mut from, mut time_s) = (start, 0.0);
    for _ in 0..cycles {
        poses.extend(
            cycle[1..]
                .iter()
                .map(|sample| (time_s + sample.time_s - first.time_s, from * sample.pose)),
        );
        from = from * last.pose;
        time_s += last.time_s - first.time_s;
    }
    poses
}

#[cfg(test)]
mod tests {
    use trilink_tables::config::Config;

    use super::*;

    #[test]
    fn a_motion_goes_on_where_its_last_cycle_ended() {
        let config = ReportInput::new(&Config::default(), Default::default());
        let problem = configured(&config, "kinematic-skewed", Model::SKID_ROLL, 3.9);
        let problem = problem.expect("a campaign of the paper");
        let start = Pose { x_m: 1.0, y_m: -2.0, theta_rad: 0.7 };
        let Steady { metrics, cycle, .. } = steady(&problem).expect("there is a motion");
        let path = repeat(&cycle, 3, start);
        assert_eq!(path.len(), 3 * SAMPLES + 1);
        let mut ends = path.iter().step_by(SAMPLES).map(|(_, pose)| pose);
        let mut before = ends.next().expect("the start");
        for end in ends {
            let d_m = (end.x_m - before.x_m).hypot(end.y_m - before.y_m);
            assert!((d_m - metrics.d_m).abs() < 1e-9);
            let turned = end.theta_rad - before.theta_rad;
            assert!((turned - metrics.dtheta_rad).abs() < 1e-9);
            before = end;
        }
    }
}
