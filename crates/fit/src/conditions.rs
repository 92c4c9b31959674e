//! Conditions: groups of trials whose metrics are predicted from one periodic solution.
//!
//! The trials of one campaign and commanded frequency form a condition. The model is solved at the median of the
//! trials' frequencies and, where measured gaits drive it, at the medians of these gaits; a second-order expansion
//! gives the metrics of each trial. Trials for which the relative error of the expansion exceeds
//! [`MAX_EXPANSION_ERROR`] form further conditions with the trials close to them.

use trilink_mechanics::{InputDerivatives, MotionError, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::metrics::{ByFitted, ByMetric, GaitMetrics, Metric};
use trilink_robot::{AnyGait, JointCommand, MAX_JOINTS};
use trilink_statistics::{median, wrap};

use super::gait_over_frequency::{EXACT, GaitErrors};
use super::measurement::Measurement;

/// Number of parameters of a measured gait: offset, amplitude and phase of each joint.
pub(super) const GAIT_NUMBERS: usize = 3 * MAX_JOINTS;
/// Number of inputs that may differ between trials that share one periodic solution: omega, rad/s, and offset,
/// amplitude and phase of each joint, rad.
pub(super) const INPUTS: usize = 1 + GAIT_NUMBERS;
/// Differences of a trial's inputs (frequency, rad/s, and gait parameters, rad) from those of its condition, the group
/// of trials that share one periodic solution.
pub(super) type Differences = [f64; INPUTS];
/// Maximum relative error of a trial's metrics when computed by expansion about the periodic solution that a group of
/// trials shares; a trial with a larger error belongs to another group.
const MAX_EXPANSION_ERROR: f64 = 1e-6;
/// Relative size of the second-order term of an expansion above which the expansion counts as too inaccurate, without
/// computation of its error.
const MAX_SECOND_ORDER: f64 = 1e-4;
/// Maximum ratio of a trial's metric to that at the periodic solution that its group of trials shares; ratios are
/// clamped to at most this value and at least its reciprocal.
const MAX_RATIO: f64 = 10.0;
/// Steps of the central differences for second derivatives: relative for omega, in rad for angles.
const STEP: f64 = 1e-3;

/// Group of trials that share one periodic solution.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Condition {
    /// Index of the trials' campaign.
    pub campaign: usize,
    pub omega_rad_s: f64,
    /// Gait that drives the model; `None` if the measured gait should drive the model but is missing.
    pub gait: Option<AnyGait>,
    pub trials: Vec<usize>,
}

/// Conditions of a set of measurements: groups of trials that share one periodic solution.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Conditions {
    pub all: Vec<Condition>,
    /// For each trial, the index of its condition and the differences of the trial's inputs from those of the
    /// condition.
    pub by_trial: Vec<(usize, Differences)>,
    /// Expansion of each condition's metrics, for the robot with its free parameters at their values from before the
    /// fit; `None` where no trial differs from the condition or the model has no periodic solution.
    pub expansions: Vec<Option<Expansion>>,
}

/// Second-order expansion of the metrics of a condition in terms of its trials' inputs (frequency and gait parameters).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Expansion {
    metrics: GaitMetrics,
    /// First derivatives of the metrics with respect to each input.
    first: Vec<ByMetric<f64>>,
    /// Inputs in which trials differ from the condition.
    inputs: Vec<usize>,
    /// Second derivatives of the metrics with respect to each pair of these inputs; empty if they were not computed.
    second: Vec<Vec<ByMetric<f64>>>,
}

impl Conditions {
    /// Groups measurements, which must be sorted by [`Measurement::order`], by frequency and by the gait that `gait_of`
    /// returns; `problem` returns the problem to solve for a campaign, a gait and a frequency.
    pub(crate) fn new(
        measurements: &[Measurement],
        gait_of: impl Fn(&Measurement) -> Option<AnyGait>,
        problem: impl Fn(usize, AnyGait, f64) -> Problem,
    ) -> Self {
        let gaits: Vec<Option<AnyGait>> = measurements.iter().map(gait_of).collect();
        let by_trial = vec![(0, [0.0; INPUTS]); measurements.len()];
        let mut conditions = Self { by_trial, ..Self::default() };
        for trials in Measurement::frequencies(measurements) {
            let (known, unknown): (Vec<usize>, Vec<usize>) =
                trials.into_iter().partition(|&trial| gaits[trial].is_some());
            for trials in [known, unknown].into_iter().filter(|trials| !trials.is_empty()) {
                conditions.group(trials, measurements, &gaits, &problem);
            }
        }
        conditions
    }

    /// Makes every trial a condition of its own.
    #[cfg(test)]
    pub(crate) fn separate(
        measurements: &[Measurement],
        gait_of: impl Fn(&Measurement) -> Option<AnyGait>,
    ) -> Self {
        let mut conditions = Self::default();
        for (trial, measurement) in measurements.iter().enumerate() {
            let gait = gait_of(measurement);
            let omega_rad_s = measurement.omega_rad_s;
            conditions.by_trial.push((trial, [0.0; INPUTS]));
            let campaign = measurement.campaign;
            conditions.all.push(Condition { campaign, omega_rad_s, gait, trials: vec![trial] });
            conditions.expansions.push(None);
        }
        conditions
    }

    /// Adds a condition, that is, a group that shares one periodic solution, for the given trials. Trials for which the
    /// expansion about this solution is too inaccurate form further conditions, each around the farthest of the trials
    /// that remain.
    fn group(
        &mut self,
        trials: Vec<usize>,
        measurements: &[Measurement],
        gaits: &[Option<AnyGait>],
        problem: &impl Fn(usize, AnyGait, f64) -> Problem,
    ) {
        let from = |condition: &Condition, trial: usize| {
            condition.differences(measurements[trial].omega_rad_s, gaits[trial].as_ref())
        };
        let mut add = |condition: Condition, expansion| {
            for &trial in &condition.trials {
                self.by_trial[trial] = (self.all.len(), from(&condition, trial));
            }
            if !condition.trials.is_empty() {
                self.all.push(condition);
                self.expansions.push(expansion);
            }
        };
        let mut first = Condition::at_medians(trials, measurements, gaits);
        let (far, expansion) = first.expand(measurements, gaits, problem).unzip();
        let mut far = far.unwrap_or_default();
        first.trials.retain(|trial| !far.contains(trial));
        add(first, expansion.clone());
        while let (Some(&farthest), Some(expansion)) = (far.first(), &expansion) {
            let mut around = Condition::at_medians(vec![farthest], measurements, gaits);
            let near = far
                .iter()
                .copied()
                .filter(|&trial| expansion.second_order(&from(&around, trial)) < MAX_SECOND_ORDER);
            around.trials = near.collect();
            let (too_far, own) = around.expand(measurements, gaits, problem).unzip();
            let too_far = too_far.unwrap_or_default();
            around.trials.retain(|trial| !too_far.contains(trial));
            far.retain(|trial| !around.trials.contains(trial));
            add(around, own);
        }
    }
}

impl Condition {
    /// Creates a condition at the medians of the trials' frequencies and gaits.
    fn at_medians(
        trials: Vec<usize>,
        measurements: &[Measurement],
        gaits: &[Option<AnyGait>],
    ) -> Self {
        let median_of =
            |number: &dyn Fn(usize) -> f64| median(trials.iter().map(|&k| number(k)).collect());
        let first = trials.first().and_then(|&trial| gaits[trial]);
        let gait = first.map(|first| AnyGait {
            joints: std::array::from_fn(|i| {
                first.joints[i].map(|first| {
                    let joint =
                        |k: usize| gaits[k].and_then(|gait| gait.joints[i]).unwrap_or(first);
                    let turn_rad = median_of(&|k| wrap(joint(k).phase_rad - first.phase_rad));
                    JointCommand {
                        offset_rad: median_of(&|k| joint(k).offset_rad),
                        amplitude_rad: median_of(&|k| joint(k).amplitude_rad),
                        phase_rad: first.phase_rad + turn_rad,
                        second: first.second,
                    }
                })
            }),
        });
        let campaign = trials.first().map_or(0, |trial| measurements[*trial].campaign);
        let omega_rad_s = median_of(&|k| measurements[k].omega_rad_s);
        Self { campaign, omega_rad_s, gait, trials }
    }

    /// Returns the trials for which the error of the condition's expansion is too large, the farthest first, and the
    /// expansion; `None` if no trial differs from the condition, or if the model has no periodic solution for it.
    fn expand(
        &self,
        measurements: &[Measurement],
        gaits: &[Option<AnyGait>],
        problem: &impl Fn(usize, AnyGait, f64) -> Problem,
    ) -> Option<(Vec<usize>, Expansion)> {
        let mut others: Vec<(usize, Differences)> = self
            .trials
            .iter()
            .map(|&trial| {
                let omega_rad_s = measurements[trial].omega_rad_s;
                (trial, self.differences(omega_rad_s, gaits[trial].as_ref()))
            })
            .collect();
        others.retain(|(_, differences)| differences.iter().any(|of| *of != 0.0));
        let all: Vec<Differences> = others.iter().map(|(_, differences)| *differences).collect();
        if all.is_empty() {
            return None;
        }
        let mut solver = Solver::default();
        let own = problem(self.campaign, self.gait?, self.omega_rad_s);
        let expansion = Expansion::solve(&mut solver, &own, &all).ok()?;
        // Starting with the trial that has the largest second-order term.
        let size = |of: &(usize, Differences)| expansion.second_order(&of.1);
        others.sort_by(|a, b| size(b).total_cmp(&size(a)).then(a.0.cmp(&b.0)));
        let too_far = others.iter().take_while(|(trial, differences)| {
            let omega_rad_s = measurements[*trial].omega_rad_s;
            let own = gaits[*trial].map(|gait| problem(self.campaign, gait, omega_rad_s));
            let solved = own.and_then(|own| solver.solve(&own, REFERENCE_ACCURACY).ok());
            solved
                .is_none_or(|metrics| expansion.error(differences, &metrics) > MAX_EXPANSION_ERROR)
        });
        Some((too_far.map(|(trial, _)| *trial).collect(), expansion))
    }

    /// Returns the differences of a frequency and a gait from those of the condition.
    fn differences(&self, omega_rad_s: f64, gait: Option<&AnyGait>) -> Differences {
        let (Some(own), Some(other)) = (self.gait, gait) else { return [0.0; INPUTS] };
        let mut steps_rad = EXACT;
        for (steps, joints) in steps_rad.iter_mut().zip(own.joints.iter().zip(other.joints)) {
            if let (Some(own), Some(other)) = joints {
                *steps = [
                    other.offset_rad - own.offset_rad,
                    other.amplitude_rad - own.amplitude_rad,
                    wrap(other.phase_rad - own.phase_rad),
                ];
            }
        }
        let mut differences = self.gait_differences(&steps_rad);
        differences[0] = omega_rad_s - self.omega_rad_s;
        differences
    }

    /// Converts changes in the gait's parameters (offset, amplitude and phase of each joint) to differences of inputs;
    /// changes for a passive joint are set to zero.
    pub(crate) fn gait_differences(&self, steps_rad: &GaitErrors) -> Differences {
        let mut differences = [0.0; INPUTS];
        let joints = self.gait.map_or([None; MAX_JOINTS], |gait| gait.joints);
        let both = differences[1..].as_chunks_mut::<3>().0.iter_mut().zip(steps_rad);
        for ((own, steps_rad), joint) in both.zip(joints) {
            if joint.is_some() {
                *own = *steps_rad;
            }
        }
        differences
    }
}

impl Expansion {
    /// Creates a first-order expansion from a solution's metrics and derivatives.
    pub(crate) fn new(metrics: &GaitMetrics, derivatives: &InputDerivatives) -> Self {
        let inputs = std::iter::once(&derivatives.omega).chain(derivatives.gait.as_flattened());
        let first = inputs.map(|slopes| {
            let finite = |slope: f64| if slope.is_finite() { slope } else { 0.0 };
            ByMetric::from(*slopes).map(finite)
        });
        let (inputs, second) = (Vec::new(), Vec::new());
        Self { metrics: *metrics, first: first.collect(), inputs, second }
    }

    /// Creates a second-order expansion about the solution of a problem. The second derivatives are central differences
    /// with respect to those inputs that differ in any of the trials' `differences`.
    pub(crate) fn solve(
        solver: &mut Solver,
        problem: &Problem,
        differences: &[Differences],
    ) -> Result<Self, MotionError> {
        let metrics = solver.solve(problem, REFERENCE_ACCURACY)?;
        let mut expansion = Self::new(&metrics, &solver.input_derivatives()?);
        expansion.add_second_order(solver, problem, differences)?;
        Ok(expansion)
    }

    /// Adds second derivatives by central differences; afterwards, the solver's latest solution is one near that of
    /// `problem`.
    fn add_second_order(
        &mut self,
        solver: &mut Solver,
        problem: &Problem,
        differences: &[Differences],
    ) -> Result<(), MotionError> {
        self.inputs =
            (0..INPUTS).filter(|input| differences.iter().any(|of| of[*input] != 0.0)).collect();
        let count = self.inputs.len();
        self.second = vec![vec![ByMetric::splat(0.0); count]; count];
        for (i, &input) in self.inputs.iter().enumerate() {
            let step = if input == 0 { STEP * problem.omega_rad_s } else { STEP };
            let mut slopes = |step: f64| -> Result<Self, MotionError> {
                let mut other = problem.clone();
                match input {
                    0 => other.omega_rad_s += step,
                    _ => {
                        let joint = other.gait.joints[(input - 1) / 3].as_mut();
                        let command = joint.ok_or(MotionError::GaitUnknown)?;
                        *command.numbers_mut()[(input - 1) % 3] += step;
                    }
                }
                let metrics = solver.solve(&other, REFERENCE_ACCURACY)?;
                Ok(Self::new(&metrics, &solver.input_derivatives()?))
            };
            let above = slopes(step)?;
            let below = slopes(-step)?;
            for (j, &other) in self.inputs.iter().enumerate() {
                for metric in Metric::ALL {
                    let change = above.first[other][metric] - below.first[other][metric];
                    // Mixed derivatives are the mean of both orders of differentiation.
                    let half = 0.5 * change / (2.0 * step);
                    self.second[i][j][metric] += half;
                    self.second[j][i][metric] += half;
                }
            }
        }
        Ok(())
    }

    /// Adopts the second derivatives of another expansion, multiplied by the ratio of this expansion's metrics to the
    /// other's.
    pub(crate) fn keep_second_order(&mut self, other: Self) {
        (self.inputs, self.second) = (other.inputs, other.second);
        for second in self.second.iter_mut().flatten() {
            for (metric, entry) in second.iter_mut() {
                let ratio = self.metrics[metric] / other.metrics[metric];
                if ratio.is_finite() {
                    *entry *= ratio;
                }
            }
        }
    }

    /// Returns the first- and second-order changes in a metric for a trial with the given input differences.
    fn changes(&self, metric: Metric, differences: &Differences) -> [f64; 2] {
        let along = |slopes: &[ByMetric<f64>], inputs: &[usize]| -> f64 {
            let pairs = slopes.iter().zip(inputs);
            pairs.map(|(slope, input)| slope[metric] * differences[*input]).sum()
        };
        let first = self.first.iter().zip(differences).map(|(slope, by)| slope[metric] * by).sum();
        let rows = self.second.iter().zip(&self.inputs);
        let second: f64 =
            rows.map(|(row, input)| along(row, &self.inputs) * differences[*input]).sum();
        [first, 0.5 * second]
    }

    /// Returns the metrics of a trial with the given input differences, given the `metrics` of its condition.
    pub(crate) fn metrics_at(
        &self,
        metrics: &GaitMetrics,
        differences: &Differences,
    ) -> GaitMetrics {
        let mut metrics = *metrics;
        if *differences != [0.0; INPUTS] {
            for metric in Metric::ALL {
                metrics[metric] += self.changes(metric, differences).iter().sum::<f64>();
            }
        }
        metrics
    }

    /// Returns the ratios of a trial's metrics to those of its condition, for the metrics in the objective.
    pub(crate) fn ratios(&self, differences: &Differences) -> ByFitted<f64> {
        let is_own = *differences == [0.0; INPUTS];
        ByFitted::from_fn(|metric| match self.metrics[metric] {
            own if is_own || own == 0.0 => 1.0,
            // Far from the expansion point, the ratio could change sign.
            own => (1.0 + self.changes(metric, differences).iter().sum::<f64>() / own)
                .clamp(MAX_RATIO.recip(), MAX_RATIO),
        })
    }

    /// Returns the first-order change in the metrics due to a difference in one input.
    pub(crate) fn effect(&self, input: usize, difference: f64) -> ByFitted<f64> {
        ByFitted::from_fn(|metric| self.first[input][metric] * difference)
    }

    /// Returns the largest second-order change among the metrics in the objective, relative to the metric itself.
    fn second_order(&self, differences: &Differences) -> f64 {
        largest_of_metrics(|metric| self.changes(metric, differences)[1] / self.metrics[metric])
    }

    /// Returns the largest relative error of the expanded metrics, compared with the `solved` ones.
    fn error(&self, differences: &Differences, solved: &GaitMetrics) -> f64 {
        let ratios = self.ratios(differences);
        largest_of_metrics(|metric| solved[metric] / self.metrics[metric] - ratios[metric])
    }
}

/// Returns the largest magnitude of `number` over the metrics in the objective, ignoring values that are not finite.
fn largest_of_metrics(number: impl Fn(Metric) -> f64) -> f64 {
    let numbers = Metric::FITTED.into_iter().map(number);
    numbers.filter(|number| number.is_finite()).map(f64::abs).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use trilink_mechanics::Problem;
    use trilink_robot::{Laws, Model, Robot};
    use trilink_tables::config::{Config, GaitInput, SigmaKind};
    use trilink_tables::{Columns as _, TrialRow};

    use super::*;
    use crate::FitInput;
    use crate::objective::Objective;
    use crate::starts::{Start, search_from};

    const SKID_KG_S: [f64; 3] = [80.0, 40.0, 45.0];

    /// Returns a quasi-random number from -1 to 1 (golden-ratio sequence).
    fn scattered(number: usize) -> f64 {
        2.0 * (0.618_034 * (number + 1) as f64).fract() - 1.0
    }

    /// Creates repeated trials at four frequencies, with gaits that differ by up to `spread_rad`.
    fn trials(repeats: usize, spread_rad: f64) -> Vec<Measurement> {
        let config = Config::default();
        let (robot, gait) = config.campaign_setup("kinematic-skewed").expect("the paper's");
        let robot = Robot { skid_kg_s: SKID_KG_S, ..robot };
        let trial = |number: usize| {
            let mut own = gait;
            for (i, joint) in own.joints.iter_mut().flatten().enumerate() {
                let off = |j: usize| 0.02 + spread_rad * scattered(7 * number + 3 * i + j);
                joint.offset_rad += off(0);
                joint.amplitude_rad += off(1);
                joint.phase_rad += off(2);
            }
            let commanded_rad_s = [1.0, 2.5, 4.0, 5.5][number / repeats];
            let omega_rad_s = commanded_rad_s * (1.0 + 0.1 * spread_rad * scattered(number));
            let problem = Problem::new(robot.clone(), own, Laws::SKID_ROLL, omega_rad_s);
            let exact = problem.solve(REFERENCE_ACCURACY).expect("a motion").metrics.to_array();
            let noise = |metric: usize| 1.0 + 0.01 * scattered(5 * number + metric);
            let row = TrialRow {
                trial: format!("{number:03}"),
                omega_rad_s,
                omega_commanded_rad_s: commanded_rad_s,
                metrics: GaitMetrics::from_array(std::array::from_fn(|i| exact[i] * noise(i))),
                ..TrialRow::blank()
            };
            let measurement = Measurement::new(&row, SigmaKind::Raw).expect("a measurement");
            let own = AnyGait::from(own).joints;
            let unknown = measurement.gait;
            let joints = std::array::from_fn(|i| own[i].unwrap_or(unknown[i]));
            Measurement { gait: joints, ..measurement }
        };
        (0..4 * repeats).map(trial).collect()
    }

    fn objective(measurements: Vec<Measurement>, gait_input: GaitInput) -> Objective {
        let config = Config::default();
        let (robot, gait) = config.campaign_setup("kinematic-skewed").expect("the paper's");
        let weights = config.campaign["kinematic-skewed"].weights;
        Objective::new(Laws::SKID_ROLL, robot, gait, weights, gait_input, measurements)
    }

    fn fitted(objective: &Objective) -> Start {
        let input = FitInput::new(&Config::default(), "kinematic-skewed", Model::SKID_ROLL);
        let parameters = input.expect("the paper's").free();
        search_from(objective.evaluator(parameters), vec![90.0, 45.0, 50.0])
    }

    /// Returns the largest relative difference between two fits in their coefficients and objectives.
    fn difference(one: &Start, other: &Start) -> f64 {
        let pairs = one.ended.iter().zip(&other.ended).chain([(&one.cost, &other.cost)]);
        pairs.map(|(one, other)| (one / other - 1.0).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn grouped_trials_are_fitted_as_separate_ones() {
        for gait_input in [GaitInput::Commanded, GaitInput::Measured] {
            let grouped = objective(trials(3, 3e-4), gait_input);
            assert_eq!(grouped.conditions.all.len(), 4);
            let mut separate = grouped.clone();
            separate.conditions =
                Conditions::separate(&grouped.measurements, |of| grouped.gait_of(of));
            assert_eq!(separate.conditions.all.len(), 12);
            let difference = difference(&fitted(&grouped), &fitted(&separate));
            assert!(difference < 1e-6, "{gait_input}: {difference:e}");
        }
    }

    #[test]
    fn copies_of_trials_are_fitted_as_the_originals() {
        let one = trials(2, 3e-4);
        let copies: Vec<Measurement> =
            one.iter().flat_map(|trial| vec![trial.clone(); 24]).collect();
        for gait_input in [GaitInput::Commanded, GaitInput::Measured] {
            let [one, copies] =
                [&one, &copies].map(|trials| fitted(&objective(trials.clone(), gait_input)));
            let difference = difference(&one, &copies);
            assert!(difference < 1e-8, "{gait_input}: {difference:e}");
        }
    }

    #[test]
    fn a_trial_far_from_the_others_is_a_condition_of_its_own() {
        let mut measurements = trials(3, 3e-4);
        measurements[4].gait[0].amplitude_rad += 0.1;
        let conditions = objective(measurements.clone(), GaitInput::Measured).conditions;
        assert_eq!(conditions.all.len(), 5);
        let (own, differences) = conditions.by_trial[4];
        assert_eq!((&conditions.all[own].trials[..], differences), (&[4][..], [0.0; INPUTS]));
        // The commanded gait is the same for all trials.
        assert_eq!(objective(measurements.clone(), GaitInput::Commanded).conditions.all.len(), 4);
        // Trials close to it join its condition.
        let mut others = measurements.clone();
        others.splice(
            4..5,
            [0.0, 0.0, 1e-4].map(|difference_rad| {
                let mut other = measurements[4].clone();
                other.gait[0].amplitude_rad += difference_rad;
                other
            }),
        );
        let conditions = objective(others, GaitInput::Measured).conditions;
        assert_eq!(conditions.all.len(), 5);
        let with_others = conditions.all.iter().find(|condition| condition.trials.contains(&4));
        assert_eq!(with_others.map(|condition| &condition.trials[..]), Some(&[4, 5, 6][..]));
    }
}
