//! Simulated motions that figures show but no table contains.

use rayon::prelude::*;
use trilink_mechanics::{
    FIT_ACCURACY, FORCES_ACCURACY, Model, MotionError, Pose, Problem, REFERENCE_ACCURACY, Sample,
    SteadyMotion,
};
use trilink_robot::metrics::GaitMetrics;
use trilink_statistics::extremes;
use trilink_tables::config::GaitInput;
use trilink_tables::{FitRow, PredictionSource, TrialRow};

use crate::ReportInput;
use crate::tables::Tables;

/// Range of frequencies (rad/s) for which figures show simulated motions.
pub(crate) const OMEGAS_RAD_S: std::ops::RangeInclusive<f64> = 0.01..=100.0;
/// Number of samples per simulated cycle.
pub(crate) const SAMPLES: usize = 240;

/// Returns the motion problem for a model with the configured robot and gait of a campaign; `None` if the campaign or
/// the model is not configured.
pub(crate) fn configured(
    input: &ReportInput,
    campaign: &str,
    model: Model,
    omega_rad_s: f64,
) -> Option<Problem> {
    let (robot, gait) = input.setup(campaign)?;
    let laws = input.models().get(&model)?.laws();
    Some(Problem { robot, gait, laws, omega_rad_s })
}

/// Returns the motion problem for a fitted model under the commanded gait; `None` if the fit failed or its campaign is
/// not configured.
pub(crate) fn fitted(input: &ReportInput, fit: &FitRow, omega_rad_s: f64) -> Option<Problem> {
    let mut problem = configured(input, &fit.campaign, fit.model, omega_rad_s)?;
    for (parameter, value) in fit.parameters.iter().filter(|(_, value)| value.is_finite()) {
        // The coefficients of the individual wheels are known whenever their sum is known.
        if !parameter.is_sum() {
            problem.robot.set(parameter, *value);
        }
    }
    fit.status.is_ok().then_some(problem)
}

/// Returns the motion problem for a model of a campaign under the commanded gait, with the coefficients of the
/// campaign's fit or, if there is none, the configured ones, and whether the fit was used; `None` if the campaign or the
/// model is not configured.
pub(crate) fn best_known(
    (tables, input): (&Tables, &ReportInput),
    campaign: &str,
    model: Model,
    omega_rad_s: f64,
) -> Option<(Problem, bool)> {
    let mut fits = tables.fits.iter();
    let fit = fits.find(|fit| fit.campaign == campaign && fit.model == model);
    match fit.and_then(|fit| fitted(input, fit, omega_rad_s)) {
        Some(problem) => Some((problem, true)),
        None => Some((configured(input, campaign, model, omega_rad_s)?, false)),
    }
}

/// Returns the motion problem for a fitted model at a trial's frequency, under the gait input of the fit.
pub(crate) fn fitted_to(input: &ReportInput, fit: &FitRow, trial: &TrialRow) -> Option<Problem> {
    let problem = fitted(input, fit, trial.omega_rad_s)?;
    let is_measured = fit.gait_input == GaitInput::Measured;
    Some(if is_measured { under_gait_of(trial, problem) } else { problem })
}

/// Replaces the mean and the first harmonic of each joint command in a motion problem with those measured in a trial;
/// joints that are not driven stay so.
pub(crate) fn under_gait_of(trial: &TrialRow, mut problem: Problem) -> Problem {
    for (command, measured) in problem.gait.joints.iter_mut().zip(trial.joints()) {
        *command = command.map(|command| command.measured(measured.command()));
    }
    problem
}

/// Returns the frequencies (rad/s) and values of a quantity of a fitted model, at a subset of the frequencies of the
/// model's prediction curve; the value is NaN where no stable motion exists.
pub(crate) fn curve(
    tables: &Tables,
    input: &ReportInput,
    fit: &FitRow,
    quantity: impl Fn(&Problem) -> Option<f64> + Sync,
) -> Vec<(f64, f64)> {
    /// Minimum stride with which the frequencies of the prediction curve are subsampled.
    const STRIDE: usize = 2;
    /// Maximum number of frequencies at which the quantity is computed.
    const MAX_FREQUENCIES: usize = 100;
    let curve = tables.source(input).predicted(&fit.campaign, fit.model, PredictionSource::Curve);
    let omegas = curve.map(|row| row.omega_rad_s);
    let mut omegas: Vec<f64> = omegas.filter(|omega| OMEGAS_RAD_S.contains(omega)).collect();
    omegas.sort_by(f64::total_cmp);
    let stride = STRIDE.max(omegas.len().div_ceil(MAX_FREQUENCIES));
    omegas
        .into_par_iter()
        .step_by(stride)
        .map(|omega_rad_s| {
            let value = fitted(input, fit, omega_rad_s).and_then(|problem| quantity(&problem));
            (omega_rad_s, value.unwrap_or(f64::NAN))
        })
        .collect()
}

/// Steady-state motion of a robot with a given model and gait.
pub(crate) struct Steady {
    pub metrics: GaitMetrics,
    pub cycle: Vec<Sample>,
    /// Number of cycles after which the motion from rest is within 1 % of the steady-state motion; `None` if the motion
    /// from rest does not reach it.
    pub cycles_to_settle: Option<usize>,
}

/// Returns the attractor reached from rest or, if none is reached, the steady-state motion found by the solver.
///
/// # Errors
/// Returns an error if there is no steady-state motion.
pub(crate) fn steady(problem: &Problem) -> Result<Steady, MotionError> {
    if let Ok((settled, cycle)) = problem.settled_cycle(FORCES_ACCURACY, SAMPLES) {
        let cycles_to_settle = Some(settled.cycles);
        return Ok(Steady { metrics: settled.motion.metrics, cycle, cycles_to_settle });
    }
    // The least smooth motions cannot be solved to the accuracy required for their forces.
    let metrics = problem.solve(REFERENCE_ACCURACY)?.metrics;
    let cycle = problem.cycle(REFERENCE_ACCURACY, SAMPLES)?;
    Ok(Steady { metrics, cycle, cycles_to_settle: None })
}

/// Returns one cycle of the steady-state motion or, if that motion is unstable, of the attractor reached from rest.
///
/// # Errors
/// Returns an error if there is no steady-state motion.
pub(crate) fn stable_cycle(problem: &Problem) -> Result<Vec<Sample>, MotionError> {
    let cycle = stable(problem).and_then(|_| problem.cycle(FIT_ACCURACY, SAMPLES).ok());
    cycle.map_or_else(|| steady(problem).map(|steady| steady.cycle), Ok)
}

/// Returns the work of the actuators per metre of displacement (J/m); `None` if there is no stable motion or its
/// displacement is not positive.
pub(crate) fn work_j_m(problem: &Problem) -> Option<f64> {
    let SteadyMotion { metrics, work_j, .. } = stable(problem)?;
    (metrics.d_m > 0.0).then(|| work_j / metrics.d_m)
}

/// Returns half the peak-to-peak range of a joint angle (rad); `None` if there is no stable motion.
pub(crate) fn amplitude_rad(problem: &Problem, joint: usize) -> Option<f64> {
    stable(problem)?;
    let cycle = problem.cycle(FIT_ACCURACY, SAMPLES).ok()?;
    let [low, high] = extremes(cycle.iter().map(|sample| sample.phi_rad[joint]));
    Some(0.5 * (high - low))
}

/// Returns the steady-state motion, or `None` if it does not exist or is not stable.
fn stable(problem: &Problem) -> Option<SteadyMotion> {
    problem.solve(FIT_ACCURACY).ok().filter(|motion| motion.status().is_stable())
}

/// Returns the times (s) and poses of a motion that starts at the pose `start` and repeats a cycle. The poses in
/// `cycle` are relative to the start of the cycle.
pub(crate) fn repeat(cycle: &[Sample], cycles: usize, start: Pose) -> Vec<(f64, Pose)> {
    let [first, .., last] = cycle else { return Vec::new() };
    let mut poses = vec![(0.0, start)];
    let mut from = start;
    let mut time_s = 0.0;
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
    fn each_cycle_of_a_repeated_motion_starts_where_the_previous_one_ends() {
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
