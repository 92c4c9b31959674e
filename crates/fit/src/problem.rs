//! Minimisation problem of a fit, for optimisers and samplers outside this program.

use rayon::prelude::*;
use trilink_mechanics::{MotionError, REFERENCE_ACCURACY, Solver};
use trilink_robot::Parameter;
use trilink_robot::metrics::{GaitMetrics, Metric};

use super::input::FreeParameter;
use super::job::Job;
use super::objective::Objective;
use super::resampler::Resampler;
use super::starts::starting_values;
use super::{FitData, FitInput, Replicates};

/// Objective J (eq. 22 of the paper) of one model of one campaign as a function of the free parameters. Each trial is
/// solved at its own frequency and gait, and the value at a point does not depend on earlier evaluations.
#[derive(Debug, Clone)]
pub struct FitProblem {
    objective: Objective,
    pub parameters: Vec<FreeParameter>,
    /// First start of the search.
    pub start: Vec<f64>,
    pub terms: Vec<Term>,
    /// Solver for each trial, which starts from the motion at [`FitProblem::start`].
    solvers: Vec<Solver>,
}

/// Term of the objective: one metric of one trial.
#[derive(Debug, Clone)]
pub struct Term {
    /// Index of the trial's measurement.
    index: usize,
    pub trial: String,
    pub metric: Metric,
    pub measured: f64,
    /// Standard error of the trial mean; NaN if unknown.
    pub se: f64,
    /// Weight of the relative deviation in J.
    pub weight: f64,
}

/// Terms of the objective at a point, in the order of [`FitProblem::terms`]; NaN for a trial for which the model has no
/// steady-state motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Residuals {
    /// Weighted relative deviations of the simulated from the measured metrics; J is the sum of their magnitudes.
    pub values: Vec<f64>,
    /// Derivatives of each residual with respect to the free parameters, per unit of the parameter; empty if not
    /// requested.
    pub jacobian: Vec<Vec<f64>>,
}

impl FitProblem {
    /// Sets up the problem that the fit of `input` to `data` solves.
    pub fn new(input: &FitInput, data: &FitData) -> Self {
        let resampler = Resampler::new(input.fit.seed, input.measurements(data), &data.cycles);
        let replicates = Replicates::default();
        let Job { objective, free, .. } = Job::new(input, data, &resampler, &replicates);
        let start = starting_values(&objective, &free, 0);
        let count = objective.measurements.len() as f64;
        let terms = objective.measurements.iter().enumerate().flat_map(|(index, measurement)| {
            objective.terms(measurement).map(move |(metric, weight, measured)| Term {
                index,
                trial: measurement.trial.clone(),
                metric,
                measured,
                se: measurement.errors[metric],
                weight: weight / count,
            })
        });
        let terms = terms.collect();
        let solvers = vec![Solver::default(); objective.measurements.len()];
        let mut problem = Self { objective, parameters: free, start, terms, solvers };
        problem.solvers = (0..problem.solvers.len())
            .into_par_iter()
            .map(|index| {
                let mut solver = Solver::default();
                // Without a motion at the start, the solver begins every evaluation from nothing.
                let _ = problem.solve(index, &mut solver, &problem.start);
                solver
            })
            .collect();
        problem
    }

    /// Evaluates the residuals and, if `with_jacobian`, their derivatives.
    pub fn residuals(&self, values: &[f64], with_jacobian: bool) -> Residuals {
        let wanted: Vec<Parameter> = self.parameters.iter().map(|free| free.parameter).collect();
        let trials = (0..self.solvers.len()).into_par_iter().with_max_len(1).map(|index| {
            let mut solver = self.solvers[index].successor();
            let metrics = self.solve(index, &mut solver, values).ok()?;
            let derivatives = match with_jacobian && !wanted.is_empty() {
                true => solver.derivatives_of(&wanted).ok(),
                false => None,
            };
            Some((metrics, derivatives))
        });
        let trials: Vec<_> = trials.collect();
        let mut residuals = Residuals { values: Vec::new(), jacobian: Vec::new() };
        for Term { index, metric, measured, weight, .. } in &self.terms {
            let trial = &trials[*index];
            let value = trial.as_ref().map_or(f64::NAN, |(metrics, _)| metrics[*metric]);
            residuals.values.push(weight * (value - measured) / measured);
            if with_jacobian {
                let derivatives = trial.as_ref().and_then(|(_, derivatives)| derivatives.as_ref());
                let row = (0..wanted.len()).map(|i| {
                    derivatives.map_or(f64::NAN, |all| weight * all[i][*metric] / measured)
                });
                residuals.jacobian.push(row.collect());
            }
        }
        residuals
    }

    /// Solves the model for a trial at the given values of the free parameters.
    fn solve(
        &self,
        index: usize,
        solver: &mut Solver,
        values: &[f64],
    ) -> Result<GaitMetrics, MotionError> {
        let measurement = &self.objective.measurements[index];
        let gait = self.objective.gait_of(measurement).ok_or(MotionError::GaitUnknown)?;
        let robots = self.objective.robots.with_values(&self.parameters, values);
        let problem = self.objective.problem(robots.first(), gait, measurement.omega_rad_s);
        solver.solve(&problem, REFERENCE_ACCURACY)
    }
}

impl Residuals {
    /// Returns the objective J; infinite if the model has no steady-state motion for one of the trials.
    pub fn cost(&self) -> f64 {
        let cost: f64 = self.values.iter().map(|residual| residual.abs()).sum();
        if cost.is_nan() { f64::INFINITY } else { cost }
    }
}

#[cfg(test)]
mod tests {
    use trilink_mechanics::Problem;
    use trilink_robot::{Laws, Model};
    use trilink_tables::config::{Config, GaitInput, SigmaKind};
    use trilink_tables::{Columns as _, TrialRow};

    use super::*;

    #[test]
    fn the_objective_vanishes_at_the_truth_and_its_derivatives_agree_with_differences() {
        let campaign = "kinematic-symmetric";
        let mut config = Config::default();
        (config.fit.sigma, config.fit.gait_input) = (SigmaKind::Raw, GaitInput::Commanded);
        let (mut robot, gait) = config.campaign_setup(campaign).expect("the paper's");
        robot.skid_kg_s = [104.0, 34.0, 45.0];
        let trials = [1.0, 2.0, 4.0].map(|omega_rad_s| {
            let problem = Problem::new(robot.clone(), gait, Laws::SKID_ROLL, omega_rad_s);
            let metrics = problem.solve(REFERENCE_ACCURACY).expect("a motion").metrics;
            let (trial, campaign) = (omega_rad_s.to_string(), campaign.to_owned());
            TrialRow { trial, campaign, omega_rad_s, metrics, ..TrialRow::blank() }
        });
        let input = FitInput::new(&config, campaign, Model::SKID_ROLL).expect("the paper's");
        let problem = FitProblem::new(&input, &FitData::from(Vec::from(trials)));
        let at = |values: &[f64]| problem.residuals(values, true);
        assert!(at(&[104.0, 34.0, 45.0]).cost() < 1e-9);
        let values = [90.0, 40.0, 50.0];
        let exact = at(&values);
        assert_eq!(exact, at(&values), "an evaluation depends on an earlier one");
        for (column, step) in values.iter().map(|value| 1e-5 * value).enumerate() {
            let moved = |by: f64| {
                let mut moved = values;
                moved[column] += by;
                at(&moved).values
            };
            for ((row, above), below) in exact.jacobian.iter().zip(moved(step)).zip(moved(-step)) {
                let difference = (above - below) / (2.0 * step);
                assert!((row[column] - difference).abs() < 1e-9, "{} {difference}", row[column]);
            }
        }
        let none = at(&[f64::NAN, 34.0, 45.0]);
        assert!(none.cost().is_infinite() && none.values.iter().all(|value| value.is_nan()));
    }
}
