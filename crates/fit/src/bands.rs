//! 95 % intervals of what a fitted model predicts, in the two parts that those of its coefficients
//! have ([`super::intervals`]).
//!
//! - *Scatter*: the quantiles of the metrics with the coefficients of the replicates. Replicates
//!   are near the fit, where a motion's derivatives tell its metrics; where those of the farthest
//!   one are off by more than [`MISSED`], the motions of all are solved for.
//! - *Systematic*: what the fit without each block of frequencies predicts, the fit with each
//!   parameter of the robot off by its standard deviation, and where the command drives the model
//!   the fit to the measured gait.
//!
//! Where the measured gait drives the model its errors at the frequency are part of the scatter,
//! too. They are intervals of the model's motion: what a single cycle or trial is off by is not
//! in them.

use trilink_mechanics::{FIT_ACCURACY, MotionError, Problem, Solver};
use trilink_robot::metrics::{ByMetric, GaitMetrics, Metric};
use trilink_robot::{Parameter, Robot};
use trilink_statistics::HALF_WIDTH_95;
use trilink_tables::config::GaitInput;
use trilink_tables::{NoInterval, NoIntervalReason};

use super::alternatives::Alternatives;
use super::fitted_point::FittedPoint;
use super::gait_over_frequency::{GaitErrors, GaitOverFrequency};
use super::intervals::{Systematic, Widths};
use super::noise_correction::NoiseCorrection;
use super::objective::Objective;
use super::resampler::Resampler;
use super::starts::Start;
use super::terms::Response;

/// Part of the replicates' largest change of a metric that the derivatives may miss.
const MISSED: f64 = 0.05;
/// Part of a metric that counts as none.
const NOTHING: f64 = 10.0 * FIT_ACCURACY;

/// How much the metrics change with a number, or between two motions.
type Changes = ByMetric<f64>;

/// That a motion has no band, as the fit to a resample has no motion there.
pub(super) fn without_resample(error: &MotionError) -> NoInterval {
    let reason = match error {
        MotionError::GaitUnknown => NoIntervalReason::ResampleGaitUnknown,
        MotionError::Singular { .. } => NoIntervalReason::ResampleSingular,
        _ => NoIntervalReason::ResampleDiverged,
    };
    reason.into()
}

/// How far a motion's metrics may be off.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Band {
    /// To either side, by the coefficients.
    widths: ByMetric<[f64; 2]>,
    /// Per radian of each number of the gait; none where the command drives the model.
    d_gait: Vec<Changes>,
}

impl Band {
    /// Limits of these metrics of the motion, or of one nearby, given the standard errors of the
    /// gait that drives it. Those that are not known are not in the limits.
    pub(crate) fn limits(
        &self,
        metrics: &GaitMetrics,
        gait_errors_rad: &GaitErrors,
    ) -> [GaitMetrics; 2] {
        let errors_rad = gait_errors_rad.as_flattened();
        let mut limits = [GaitMetrics::NONE; 2];
        for metric in Metric::ALL {
            let value = metrics[metric];
            let of_gait = self.d_gait.iter().zip(errors_rad).map(|(of, error)| of[metric] * error);
            let squares: f64 = of_gait.filter(|of| of.is_finite()).map(|of| of * of).sum();
            let [below, above] =
                self.widths[metric].map(|width| width.hypot(HALF_WIDTH_95 * squares.sqrt()));
            let floor = if metric.definition().is_size { 0.0 } else { f64::NEG_INFINITY };
            (limits[0][metric], limits[1][metric]) = ((value - below).max(floor), value + above);
        }
        limits
    }
}

/// How far each prediction of a fit may be off.
pub(super) struct Bands<'f> {
    point: &'f FittedPoint<'f>,
    /// The free parameters.
    free: Vec<Parameter>,
    /// Logarithms of them over the fitted values.
    replicates: Vec<Vec<f64>>,
    systematic: &'f Systematic,
    /// The robot with one of its parameters off, as in `systematic`.
    others: &'f [Robot],
    /// Where the command drives the model.
    measured_gaits: Option<GaitOverFrequency>,
}

impl<'f> Bands<'f> {
    /// Of a fit with its replicates, of which there are some.
    pub(crate) fn new(
        point: &'f FittedPoint<'f>,
        replicates: &[Start],
        resampler: &Resampler,
        systematic: &'f Systematic,
        others: &'f [Robot],
    ) -> Self {
        let correction = NoiseCorrection::of(point, resampler);
        let shift = |refit: &Start| -> Vec<f64> {
            let shifts = point.shift_to(&refit.ended).into_iter();
            shifts.map(|shift| correction.spread * shift).collect()
        };
        // Only where the command drives the model its coefficients are off by the gait.
        let measured_gaits = systematic.gait.as_ref().map(|_| {
            let objective = point.evaluator.objective.clone();
            GaitOverFrequency::new(&Objective { gait_input: GaitInput::Measured, ..objective })
        });
        Self {
            point,
            free: point.evaluator.parameters.iter().map(|free| free.parameter).collect(),
            replicates: replicates.iter().map(shift).collect(),
            systematic,
            others,
            measured_gaits,
        }
    }

    /// The free parameters, and what their logarithms are shifted by in each replicate.
    pub(crate) fn replicates(&self) -> (&[Parameter], &[Vec<f64>]) {
        (&self.free, &self.replicates)
    }

    /// The robot as it was assumed, but for the free parameters.
    pub(crate) fn robot(&self) -> &Robot {
        &self.point.evaluator.objective.robot
    }

    /// The same with one of its parameters off, and what the logarithms of the free parameters are
    /// shifted by then.
    pub(crate) fn assumed(&self) -> impl Iterator<Item = (&Robot, &[f64])> {
        self.others.iter().zip(self.systematic.assumed.iter().map(Vec::as_slice))
    }

    /// A robot with the coefficients of the refits, of `most` replicates at most.
    pub(crate) fn alternatives(&self, robot: &Robot, most: usize) -> Alternatives {
        let Systematic { blocks, gait, .. } = self.systematic;
        let shifted = |shifts: &Vec<f64>| self.shifted(robot, shifts);
        Alternatives {
            replicates: self.replicates.iter().take(most).map(shifted).collect(),
            blocks: blocks.iter().map(shifted).collect(),
            assumed: self.assumed().map(|(robot, shifts)| self.shifted(robot, shifts)).collect(),
            gait: gait.as_ref().map(shifted),
        }
    }

    /// A robot with the fitted coefficients, their logarithms shifted.
    fn shifted(&self, robot: &Robot, shifts: &[f64]) -> Robot {
        let mut robot = robot.clone();
        for ((parameter, fitted), shift) in self.free.iter().zip(&self.point.values).zip(shifts) {
            parameter.set(&mut robot, fitted * shift.exp());
        }
        robot
    }

    /// Of the motion that was solved for last.
    ///
    /// # Errors
    /// A replicate has no motion.
    pub(crate) fn band(
        &self,
        mut solver: Solver,
        problem: &Problem,
        metrics: GaitMetrics,
    ) -> Result<Band, MotionError> {
        let d_gait = match self.point.evaluator.objective.is_driven_as_measured() {
            true => {
                solver.derivatives()?.gait.as_flattened().iter().map(|of| (*of).into()).collect()
            }
            false => Vec::new(),
        };
        let response = Response::of_last(&mut solver, metrics, &problem.robot, &self.free)?;
        let mut solved = |problem: &Problem, shifts: &[f64]| {
            self.change(&mut solver, &response.metrics, problem, shifts)
        };
        let size = |shifts: &&Vec<f64>| shifts.iter().map(|shift| shift * shift).sum::<f64>();
        let farthest = self.replicates.iter().max_by(|a, b| size(a).total_cmp(&size(b)));
        let of_all = |all: &[Vec<f64>]| all.iter().map(|shifts| response.change(shifts)).collect();
        let [mut replicates, mut blocks]: [Vec<Changes>; 2] =
            [of_all(&self.replicates), of_all(&self.systematic.blocks)];
        if let Some(farthest) = farthest {
            let (told, found) = (response.change(farthest), solved(problem, farthest)?);
            if is_missed(&response.metrics, &replicates, &told, &found) {
                for (changes, shifts) in
                    [(&mut replicates, &self.replicates), (&mut blocks, &self.systematic.blocks)]
                {
                    let all = shifts.iter().map(|shifts| solved(problem, shifts));
                    *changes = all.collect::<Result<_, _>>()?;
                }
            }
        }
        let both = self.others.iter().zip(&self.systematic.assumed);
        let assumed = both.map(|(robot, shifts)| {
            solved(&Problem { robot: robot.clone(), ..problem.clone() }, shifts)
        });
        let assumed: Vec<Changes> = assumed.collect::<Result<_, _>>()?;
        let by_gait = match self.measured_gaits.as_ref().zip(self.systematic.gait.as_ref()) {
            None => Changes::splat(0.0),
            Some((gaits, shifts)) => {
                let command = self.point.evaluator.objective.protocols[0].gait;
                // What servos make of another command is not known.
                let gait = match problem.gait == command {
                    true => gaits.at(problem.omega_rad_s).ok_or(MotionError::GaitUnknown)?.0,
                    false => problem.gait,
                };
                solved(&Problem { gait, ..problem.clone() }, shifts)?
            }
        };
        let widths = ByMetric::from_fn(|metric| {
            let of_all = |all: &Vec<Changes>| -> Vec<f64> {
                all.iter().map(|changes| changes[metric]).collect()
            };
            let [replicates, blocks, assumed] = [&replicates, &blocks, &assumed].map(of_all);
            Widths::of_changes(replicates, &blocks, &assumed, by_gait[metric]).total
        });
        Ok(Band { widths, d_gait })
    }

    /// What the metrics of a problem's motion with other coefficients have more than those of the
    /// fit.
    fn change(
        &self,
        solver: &mut Solver,
        fitted: &GaitMetrics,
        problem: &Problem,
        shifts: &[f64],
    ) -> Result<Changes, MotionError> {
        let problem = Problem { robot: self.shifted(&problem.robot, shifts), ..problem.clone() };
        let found = solver.solve(&problem, FIT_ACCURACY)?;
        Ok(Changes::from_fn(|metric| found[metric] - fitted[metric]))
    }
}

/// Whether what was told of a replicate is too far from what was found.
fn is_missed(fitted: &GaitMetrics, all: &[Changes], told: &Changes, found: &Changes) -> bool {
    Metric::ALL.into_iter().any(|metric| {
        let largest = all.iter().map(|changes| changes[metric].abs()).fold(0.0, f64::max);
        let floor = NOTHING * fitted[metric].abs().max(NOTHING);
        (told[metric] - found[metric]).abs() > (MISSED * largest).max(floor)
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use trilink_mechanics::{Laws, Model, REFERENCE_ACCURACY};
    use trilink_statistics::{SIDES_95, quantiles};
    use trilink_tables::config::{Config, SigmaKind};
    use trilink_tables::{Columns as _, Stopped, TrialRow};

    use super::*;
    use crate::{FitInput, Measurement};

    const SKID_KG_S: [f64; 3] = [104.0, 34.0, 45.0];

    fn objective(campaign: &str) -> Objective {
        let config = Config::default();
        let (robot, gait) = config.campaign_setup(campaign).expect("the paper's");
        let (weights, laws) = (config.campaign[campaign].weights, Laws::SKID_ROLL);
        let measured = |omega_rad_s: f64| {
            let robot = Robot { skid_kg_s: SKID_KG_S, ..robot.clone() };
            let problem = Problem { robot, gait, laws, omega_rad_s };
            let metrics = problem.solve(REFERENCE_ACCURACY).expect("a motion").metrics;
            let row = TrialRow { omega_rad_s, metrics, ..TrialRow::blank() };
            Measurement::new(&row, SigmaKind::Raw).expect("a measurement")
        };
        let measurements = [1.0, 2.5, 4.0, 5.5].map(measured).into();
        Objective::new(laws, robot, gait, weights, GaitInput::Commanded, measurements)
    }

    /// Of replicates of which the logarithms have this standard deviation: largest error of a
    /// limit as a part of its distance from the prediction, and in how many of two motions the
    /// derivatives alone do.
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
        let bands = Bands::new(&point, &replicates, &resampler, &systematic, &[]);
        let (mut worst, mut by_derivatives) = (0.0_f64, 0);
        for omega_rad_s in [2.5, 5.5] {
            let robot = objective.robot_with(&point.evaluator.parameters, &point.values);
            let problem = objective.problem(&robot, objective.protocols[0].gait, omega_rad_s);
            let mut solver = Solver::default();
            let metrics = solver.solve(&problem, REFERENCE_ACCURACY).expect("a motion");
            let band = bands.band(solver.clone(), &problem, metrics).expect("a band");
            let limits = band.limits(&metrics, &[[0.01; 3]; 2]);
            let all: Vec<Changes> = (bands.replicates.iter())
                .map(|shifts| bands.change(&mut solver, &metrics, &problem, shifts).expect("one"))
                .collect();
            let mut is_exact = true;
            for metric in Metric::ALL {
                let value = metrics[metric];
                let of_metric = all.iter().map(|changes| changes[metric]).collect();
                let found = quantiles(of_metric, SIDES_95);
                for (found, limit) in found.into_iter().zip(limits) {
                    let told = limit[metric] - value;
                    if found.abs() > 1e-3 * deviation * value {
                        worst = worst.max((told / found - 1.0).abs());
                    }
                    is_exact &= (told - found).abs() <= 1e-9;
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
        let [lower, upper] = band.limits(&metrics, &[[0.01; 3]; 2]);
        let by_gait: f64 = 1.96 * 0.05;
        assert!((4.0 - lower.d_m - by_gait.hypot(0.03)).abs() < 1e-12);
        assert!((upper.d_m - 4.0 - by_gait.hypot(0.06)).abs() < 1e-12);
        assert!((upper.v_m_s - 1.06).abs() < 1e-12);
        let [unknown, _] = band.limits(&metrics, &[[f64::NAN; 3]; 2]);
        assert!((unknown.d_m - 3.97).abs() < 1e-12);
    }

    #[test]
    fn limits_are_those_of_motions_that_are_solved_for() {
        for campaign in ["kinematic-symmetric", "semi-passive-symmetric"] {
            // 0.0057, 0.023 and 0 were found.
            let [small, larger, wide] =
                [0.005, 0.02, 0.4].map(|deviation| error(campaign, deviation));
            assert!(small.0 < 0.01 && larger.0 < 0.03 && wide.0 < 1e-9, "{small:?} {larger:?}");
            // Replicates that are near the fit need no motions of their own.
            assert!(small.1 == 2 && wide.1 == 0, "{campaign}: {small:?} {wide:?}");
        }
    }
}
