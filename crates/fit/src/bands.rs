//! 95 % prediction intervals of a fitted model, with the random and systematic components of the coefficients'
//! confidence intervals ([`super::intervals`]).
//!
//! - *Scatter* (random): quantiles of the metrics predicted with the coefficients of the replicates. Near the fit, the
//!   metrics follow from the derivatives of the periodic solution; if their error for the farthest replicate exceeds
//!   [`MAX_LINEARISATION_ERROR`], the periodic solution is computed for every replicate.
//! - *Systematic*: predictions of the fits that each leave out one block of frequencies, of the fits that each increase
//!   one robot parameter by its standard deviation, and, where the command drives the model, of the fit to the measured
//!   gait.
//!
//! Where the measured gait drives the model, the errors of that gait at the given frequency also contribute to the
//! scatter. The intervals are those of the model's prediction: the noise of a single cycle or trial is not included.

use trilink_mechanics::{FIT_ACCURACY, MotionError, Problem, Solver};
use trilink_robot::metrics::{ByMetric, GaitMetrics, Metric};
use trilink_robot::{AnyRobot, Parameter};
use trilink_statistics::HALF_WIDTH_95;
use trilink_tables::config::GaitInput;
use trilink_tables::{NoInterval, NoIntervalReason};

use super::alternatives::Alternatives;
use super::fitted_point::FittedPoint;
use super::gait_over_frequency::{GaitErrors, GaitOverFrequency};
use super::intervals::{Systematic, Widths};
use super::objective::Objective;
use super::robots::Robots;
use super::starts::Start;
use super::terms::Response;
use super::variation::Variation;

/// Maximum error of a linearised change in a metric for one bootstrap replicate, relative to the largest change in that
/// metric among all replicates.
const MAX_LINEARISATION_ERROR: f64 = 0.05;
/// Relative change in a metric below which it is negligible.
const NEGLIGIBLE: f64 = 10.0 * FIT_ACCURACY;

/// Changes in the metrics: per unit of a parameter, or between two periodic solutions.
type Changes = ByMetric<f64>;

/// Returns the reason for a missing prediction interval, given the error of the solver for the coefficients of a
/// replicate.
pub(super) fn without_resample(error: &MotionError) -> NoInterval {
    let reason = match error {
        MotionError::GaitUnknown => NoIntervalReason::ResampleGaitUnknown,
        MotionError::Singular { .. } => NoIntervalReason::ResampleSingular,
        _ => NoIntervalReason::ResampleDiverged,
    };
    reason.into()
}

/// Uncertainty of the predicted metrics of a steady-state motion.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Band {
    /// Half widths of each metric's 95 % interval below and above the prediction, due to the uncertain coefficients.
    widths: ByMetric<[f64; 2]>,
    /// Derivatives of the metrics with respect to each parameter of the measured gait, per rad; empty if the commanded
    /// gait drives the model.
    d_gait: Vec<Changes>,
}

impl Band {
    /// Returns the lower and upper 95 % limits of `metrics`, which must be those of the steady-state motion for which
    /// this band was computed, or of a motion near it. `gait_errors_rad` are the standard errors of the gait that
    /// drives the model; unknown errors count as zero.
    pub(crate) fn limits(
        &self,
        metrics: &GaitMetrics,
        gait_errors_rad: &GaitErrors,
    ) -> [GaitMetrics; 2] {
        let errors_rad = gait_errors_rad.as_flattened();
        let mut limits = [GaitMetrics::NONE; 2];
        for metric in Metric::ALL {
            let value = metrics[metric];
            let by_gait = self.d_gait.iter().zip(errors_rad).map(|(of, error)| of[metric] * error);
            let squares: f64 = by_gait.filter(|of| of.is_finite()).map(|of| of * of).sum();
            let [below, above] =
                self.widths[metric].map(|width| width.hypot(HALF_WIDTH_95 * squares.sqrt()));
            let floor = if metric.definition().is_size { 0.0 } else { f64::NEG_INFINITY };
            let lower = value - below;
            limits[0][metric] = if lower < floor { floor } else { lower };
            limits[1][metric] = value + above;
        }
        limits
    }
}

/// Uncertainty of the predictions of a fit.
pub(super) struct Bands<'f> {
    point: &'f FittedPoint<'f>,
    /// Free parameters of the fit.
    free: Vec<Parameter>,
    /// Shifts of the logarithms of the free parameters in each replicate, widened for the degrees of freedom.
    replicates: Vec<Vec<f64>>,
    systematic: &'f Systematic,
    /// Copies of the robot, each with one uncertain parameter increased by its standard deviation.
    perturbed_robots: &'f [Robots],
    /// Measured gaits, for computing the error that results from driving the model with the commanded gait instead;
    /// `None` if the measured gaits drive this fit, or if there is no refit that they drive.
    measured_gaits: Option<GaitOverFrequency>,
}

impl<'f> Bands<'f> {
    /// Prepares the prediction bands for a fit that has replicates.
    pub(crate) fn new(
        point: &'f FittedPoint<'f>,
        replicates: &[Start],
        variation: &Variation,
        systematic: &'f Systematic,
        perturbed_robots: &'f [Robots],
    ) -> Self {
        let widenings = variation.widenings(point);
        let replicates = replicates.iter().map(|refit| {
            let shifts = point.shift_to(&refit.ended).into_iter();
            shifts.zip(&widenings).map(|(shift, widening)| widening * shift).collect()
        });
        // The gait biases the coefficients only where the command drives the model.
        let measured_gaits = systematic.gait.as_ref().map(|_| {
            let objective = point.evaluator.objective.clone();
            GaitOverFrequency::new(&Objective { gait_input: GaitInput::Measured, ..objective })
        });
        Self {
            point,
            free: point.evaluator.parameters.iter().map(|free| free.parameter).collect(),
            replicates: replicates.collect(),
            systematic,
            perturbed_robots,
            measured_gaits,
        }
    }

    /// Returns the free parameters, and the shifts of their logarithms in each replicate.
    pub(crate) fn replicates(&self) -> (&[Parameter], &[Vec<f64>]) {
        (&self.free, &self.replicates)
    }

    /// Returns the robot on which the fit is based; its free parameters have their values from before the fit.
    pub(crate) fn robot(&self) -> &AnyRobot {
        self.point.evaluator.objective.robots.first()
    }

    /// Returns, for each uncertain robot parameter, the robot with that parameter increased by its standard deviation,
    /// and the shifts of the logarithms of the free parameters from the original fit to the refit with this robot.
    pub(crate) fn assumed(&self) -> impl Iterator<Item = (&AnyRobot, &[f64])> {
        self.perturbed_robots
            .iter()
            .map(Robots::first)
            .zip(self.systematic.assumed.iter().map(Vec::as_slice))
    }

    /// Returns robots with the coefficients of refits: of the first `most` bootstrap replicates, and of all refits that
    /// are not replicates. They are copies of `robot`, except that a refit with a changed robot parameter keeps its own
    /// robot.
    pub(crate) fn alternatives(&self, robot: &AnyRobot, most: usize) -> Alternatives {
        let Systematic { blocks, gait, .. } = self.systematic;
        let shifted = |shifts: &Vec<f64>| self.shifted(robot, shifts);
        Alternatives {
            replicates: self.replicates.iter().take(most).map(shifted).collect(),
            blocks: blocks.iter().map(shifted).collect(),
            assumed: self.assumed().map(|(robot, shifts)| self.shifted(robot, shifts)).collect(),
            gait: gait.as_ref().map(shifted),
        }
    }

    /// Returns a copy of a robot with the fitted coefficients, their logarithms shifted by `shifts`.
    fn shifted(&self, robot: &AnyRobot, shifts: &[f64]) -> AnyRobot {
        let mut robot = robot.clone();
        for ((parameter, fitted), shift) in self.free.iter().zip(&self.point.values).zip(shifts) {
            robot.set(*parameter, fitted * shift.exp());
        }
        robot
    }

    /// Returns the uncertainty of `metrics`, which must be those of the periodic solution of `problem`; `solver` must
    /// have found this solution last.
    ///
    /// # Errors
    /// Returns an error if the solution has no derivatives, or if the model has no periodic solution with the
    /// coefficients of a replicate or of another refit.
    pub(crate) fn band(
        &self,
        mut solver: Solver,
        problem: &Problem,
        metrics: GaitMetrics,
    ) -> Result<Band, MotionError> {
        let d_gait = if self.point.evaluator.objective.is_driven_as_measured() {
            solver.input_derivatives()?.gait.as_flattened().iter().map(|of| (*of).into()).collect()
        } else {
            Vec::new()
        };
        let response =
            Response::from_last_motion(&mut solver, metrics, &problem.robot, &self.free)?;
        let [replicates, blocks] = self.changes(&mut solver, problem, &response)?;
        let mut assumed: Vec<Changes> = Vec::new();
        for (robot, shifts) in self.assumed() {
            let perturbed = Problem { robot: robot.clone(), ..problem.clone() };
            assumed.push(self.change(&mut solver, &metrics, &perturbed, shifts)?);
        }
        let by_gait = self.change_by_gait(&mut solver, &metrics, problem)?;
        let widths = ByMetric::from_fn(|metric| {
            let [replicates, blocks, assumed] = [&replicates, &blocks, &assumed]
                .map(|all| all.iter().map(|changes| changes[metric]).collect::<Vec<f64>>());
            Widths::from_changes(replicates, &blocks, &assumed, by_gait[metric]).total
        });
        Ok(Band { widths, d_gait })
    }

    /// Returns the changes in the metrics for the replicates, and for the refits that each leave out one block of
    /// frequencies. The changes are linearised, or computed from periodic solutions if the linearisation is not
    /// accurate enough for the replicate that is farthest from the fit.
    fn changes(
        &self,
        solver: &mut Solver,
        problem: &Problem,
        response: &Response,
    ) -> Result<[Vec<Changes>; 2], MotionError> {
        let shifts = [&self.replicates, &self.systematic.blocks];
        let linear: [Vec<Changes>; 2] =
            shifts.map(|all| all.iter().map(|shifts| response.change(shifts)).collect());
        let size = |shifts: &&Vec<f64>| shifts.iter().map(|shift| shift * shift).sum::<f64>();
        let farthest = self.replicates.iter().max_by(|a, b| size(a).total_cmp(&size(b)));
        let Some(farthest) = farthest else { return Ok(linear) };
        let solved = self.change(solver, &response.metrics, problem, farthest)?;
        if !is_nonlinear(&response.metrics, &linear[0], &response.change(farthest), &solved) {
            return Ok(linear);
        }
        let mut solve_all = |all: &[Vec<f64>]| -> Result<Vec<Changes>, MotionError> {
            all.iter()
                .map(|shifts| self.change(solver, &response.metrics, problem, shifts))
                .collect()
        };
        Ok([solve_all(shifts[0])?, solve_all(shifts[1])?])
    }

    /// Returns the change in the metrics with the coefficients from the fit in which the measured gait drives the
    /// model; that gait also replaces the campaign's own command. Zero if there is no such fit besides the original
    /// one.
    fn change_by_gait(
        &self,
        solver: &mut Solver,
        metrics: &GaitMetrics,
        problem: &Problem,
    ) -> Result<Changes, MotionError> {
        let Some((gaits, shifts)) = self.measured_gaits.as_ref().zip(self.systematic.gait.as_ref())
        else {
            return Ok(Changes::splat(0.0));
        };
        // It is unknown how the servos would follow any other command.
        let gait = if problem.gait == self.point.evaluator.objective.protocols[0].gait {
            gaits.at(problem.omega_rad_s).ok_or(MotionError::GaitUnknown)?.0
        } else {
            problem.gait
        };
        self.change(solver, metrics, &Problem { gait, ..problem.clone() }, shifts)
    }

    /// Solves the model with shifted coefficients and returns the change in the metrics from those of the fit.
    fn change(
        &self,
        solver: &mut Solver,
        fitted: &GaitMetrics,
        problem: &Problem,
        shifts: &[f64],
    ) -> Result<Changes, MotionError> {
        let problem = Problem { robot: self.shifted(&problem.robot, shifts), ..problem.clone() };
        let metrics = solver.solve(&problem, FIT_ACCURACY)?;
        Ok(Changes::from_fn(|metric| metrics[metric] - fitted[metric]))
    }
}

/// Whether the linearised changes for a replicate differ too much from the solved ones; `all` are the linearised
/// changes for all replicates.
fn is_nonlinear(
    fitted: &GaitMetrics,
    all: &[Changes],
    linearised: &Changes,
    solved: &Changes,
) -> bool {
    Metric::ALL.into_iter().any(|metric| {
        let largest = all.iter().map(|changes| changes[metric].abs()).fold(0.0, f64::max);
        let floor = NEGLIGIBLE * fitted[metric].abs().max(NEGLIGIBLE);
        let error = (linearised[metric] - solved[metric]).abs();
        error > (MAX_LINEARISATION_ERROR * largest).max(floor)
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use trilink_mechanics::{Laws, Model, Problem, REFERENCE_ACCURACY};
    use trilink_robot::{MAX_JOINTS, Robot};
    use trilink_statistics::{SIDES_95, quantiles};
    use trilink_tables::config::{Config, SigmaKind};
    use trilink_tables::{Columns as _, Stopped, TrialRow};

    use super::*;
    use crate::gait_over_frequency::UNKNOWN;
    use crate::resampler::Resampler;
    use crate::{FitInput, Measurement};

    const SKID_KG_S: [f64; 3] = [104.0, 34.0, 45.0];

    fn objective(campaign: &str) -> Objective {
        let config = Config::default();
        let (robot, gait) = config.campaign_setup(campaign).expect("the paper's");
        let (weights, laws) = (config.campaign[campaign].weights, Laws::SKID_ROLL);
        let measured = |omega_rad_s: f64| {
            let robot = Robot { skid_kg_s: SKID_KG_S, ..robot.clone() };
            let problem = Problem::new(robot, gait, laws, omega_rad_s);
            let metrics = problem.solve(REFERENCE_ACCURACY).expect("a motion").metrics;
            let row = TrialRow { omega_rad_s, metrics, ..TrialRow::blank() };
            Measurement::new(&row, SigmaKind::Raw).expect("a measurement")
        };
        let measurements = [1.0, 2.5, 4.0, 5.5].map(measured).into();
        Objective::new(laws, robot, gait, weights, GaitInput::Commanded, measurements)
    }

    /// Compares prediction limits with those from solving the model for every simulated replicate. The coefficients'
    /// logarithms scatter with the given standard deviation. Returns the largest relative error in the distance of a
    /// limit from the prediction, and the number of motions, of two, whose limits were linearised.
    fn error(campaign: &str, deviation: f64) -> (f64, usize) {
        let objective = objective(campaign);
        let input = FitInput::new(&Config::default(), campaign, Model::SKID_ROLL);
        let parameters = input.expect("the paper's").free();
        let point = FittedPoint::new(objective.evaluator(parameters), SKID_KG_S.into());
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut replicate = |_| {
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            let ended = SKID_KG_S.map(|value| value * (deviation * normal()).exp()).into();
            let began = Vec::new();
            Start { began, ended, cost: 0.0, solves: 0, stopped: Stopped::Converged }
        };
        let replicates: Vec<Start> = (0..200).map(&mut replicate).collect();
        let measurements = objective.measurements.clone();
        let resampler = Resampler::new(1, measurements, &BTreeMap::new());
        let systematic = Systematic::default();
        let variation = Variation::new(&point, &resampler, 0.0);
        let bands = Bands::new(&point, &replicates, &variation, &systematic, &[]);
        let mut worst = 0.0_f64;
        let mut by_derivatives = 0;
        for omega_rad_s in [2.5, 5.5] {
            let robots = objective.robots.with_values(&point.evaluator.parameters, &point.values);
            let problem =
                objective.problem(robots.first(), objective.protocols[0].gait, omega_rad_s);
            let mut solver = Solver::default();
            let metrics = solver.solve(&problem, REFERENCE_ACCURACY).expect("a motion");
            let band = bands.band(solver.clone(), &problem, metrics).expect("a band");
            let limits = band.limits(&metrics, &[[0.01; 3]; MAX_JOINTS]);
            let all: Vec<Changes> = (bands.replicates.iter())
                .map(|shifts| bands.change(&mut solver, &metrics, &problem, shifts).expect("one"))
                .collect();
            let mut is_exact = true;
            for metric in Metric::OF_THREE_LINKS {
                let value = metrics[metric];
                let of_metric = all.iter().map(|changes| changes[metric]).collect();
                let expected = quantiles(of_metric, SIDES_95);
                for (expected, limit) in expected.into_iter().zip(limits) {
                    let width = limit[metric] - value;
                    if expected.abs() > 1e-3 * deviation * value {
                        worst = worst.max((width / expected - 1.0).abs());
                    }
                    is_exact &= (width - expected).abs() <= 1e-9;
                }
            }
            by_derivatives += usize::from(!is_exact);
        }
        (worst, by_derivatives)
    }

    #[test]
    fn the_errors_of_the_measured_gait_are_in_the_limits() {
        let metrics = GaitMetrics::from_array([4.0, 1.0, 0.1, 0.2, 0.3, 0.5, -0.1]);
        let widths = ByMetric::splat([0.03, 0.06]);
        let mut d_gait = vec![Changes::splat(0.0); 6];
        d_gait[1][Metric::D] = 3.0;
        d_gait[4][Metric::D] = 4.0;
        d_gait[2] = Changes::splat(f64::NAN);
        let band = Band { widths, d_gait };
        let [lower, upper] = band.limits(&metrics, &[[0.01; 3]; MAX_JOINTS]);
        let by_gait: f64 = 1.96 * 0.05;
        assert!((4.0 - lower.d_m - by_gait.hypot(0.03)).abs() < 1e-12);
        assert!((upper.d_m - 4.0 - by_gait.hypot(0.06)).abs() < 1e-12);
        assert!((upper.v_m_s - 1.06).abs() < 1e-12);
        let [unknown, _] = band.limits(&metrics, &UNKNOWN);
        assert!((unknown.d_m - 3.97).abs() < 1e-12);
    }

    #[test]
    fn the_limits_are_those_of_solved_motions() {
        for campaign in ["kinematic-symmetric", "semi-passive-symmetric"] {
            // The errors were 0.0057, 0.023 and 0.
            let [small, larger, wide] =
                [0.005, 0.02, 0.4].map(|deviation| error(campaign, deviation));
            assert!(small.0 < 0.01 && larger.0 < 0.03 && wide.0 < 1e-9, "{small:?} {larger:?}");
            // Linearisation suffices for replicates near the fit.
            assert!(small.1 == 2 && wide.1 == 0, "{campaign}: {small:?} {wide:?}");
        }
    }
}
