//! Trials of one campaign and commanded frequency are one condition: their motions are one
//! solution, at the medians of their frequencies and, where these drive the model, of their
//! measured gaits, and what its derivatives to second order make of each trial's own. A trial
//! for which that misses more of a metric than [`MISSED`] is of another condition, with those
//! that are near it.

use trilink_mechanics::{Derivatives, MotionError, Problem, REFERENCE_ACCURACY, Solver};
use trilink_robot::metrics::{ByFitted, ByMetric, GaitMetrics, Metric};
use trilink_robot::{Gait, JointCommand};
use trilink_statistics::{median, wrap};

use super::measurement::Measurement;

/// Numbers of a measured gait: offset, amplitude and phase of either joint.
pub(super) const GAIT_NUMBERS: usize = 6;
/// What the motions of a condition differ by: omega, rad/s, and offset, amplitude and phase of either
/// joint, rad.
pub(super) const INPUTS: usize = 1 + GAIT_NUMBERS;
/// Differences of a trial from its condition.
pub(super) type Differences = [f64; INPUTS];
/// Part of a metric that a trial's expansion may miss.
const MISSED: f64 = 1e-6;
/// Part of second order above which an expansion surely misses too much.
const NEAR: f64 = 1e-4;
/// Of a trial's metric over its condition's, at most.
const MOST_RATIO: f64 = 10.0;
/// Steps of the differences that second derivatives are taken from: of omega, relative, and of
/// angles, rad.
const STEP: f64 = 1e-3;

/// Trials with one motion.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Condition {
    pub omega_rad_s: f64,
    /// What drives the model; `None` where it was to be measured and was not.
    pub gait: Option<Gait>,
    pub trials: Vec<usize>,
}

/// The conditions of some measurements.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Conditions {
    pub all: Vec<Condition>,
    /// Of each trial: its condition, and its differences from it.
    pub of_trials: Vec<(usize, Differences)>,
    /// Of each condition: its motion as far as it was expanded, with the robot as configured.
    pub expansions: Vec<Option<Expansion>>,
}

/// The metrics of a condition's motions.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Expansion {
    metrics: GaitMetrics,
    /// Derivatives of each metric.
    first: ByMetric<Differences>,
    second: ByMetric<[Differences; INPUTS]>,
}

impl Conditions {
    /// Those of sorted measurements with the gait and the frequency of each, where the motions are
    /// those of a `problem`.
    pub(crate) fn new(
        measurements: &[Measurement],
        gait_of: impl Fn(&Measurement) -> Option<Gait>,
        problem: impl Fn(Gait, f64) -> Problem,
    ) -> Self {
        let gaits: Vec<Option<Gait>> = measurements.iter().map(gait_of).collect();
        let of_trials = vec![(0, [0.0; INPUTS]); measurements.len()];
        let mut conditions = Self { of_trials, ..Self::default() };
        for trials in Measurement::frequencies(measurements) {
            let (known, unknown): (Vec<usize>, Vec<usize>) =
                trials.into_iter().partition(|&trial| gaits[trial].is_some());
            for trials in [known, unknown].into_iter().filter(|trials| !trials.is_empty()) {
                conditions.join(trials, measurements, &gaits, &problem);
            }
        }
        conditions
    }

    /// Every trial by itself.
    #[cfg(test)]
    pub(crate) fn separate(
        measurements: &[Measurement],
        gait_of: impl Fn(&Measurement) -> Option<Gait>,
    ) -> Self {
        let mut conditions = Self::default();
        for (trial, measurement) in measurements.iter().enumerate() {
            let gait = gait_of(measurement);
            let omega_rad_s = measurement.omega_rad_s;
            conditions.of_trials.push((trial, [0.0; INPUTS]));
            conditions.all.push(Condition { omega_rad_s, gait, trials: vec![trial] });
            conditions.expansions.push(None);
        }
        conditions
    }

    /// Adds the condition of these trials, and those of the ones that are too far from it: around
    /// the farthest, then around the farthest of what that leaves.
    fn join(
        &mut self,
        trials: Vec<usize>,
        measurements: &[Measurement],
        gaits: &[Option<Gait>],
        problem: &impl Fn(Gait, f64) -> Problem,
    ) {
        let from = |condition: &Condition, trial: usize| {
            condition.differences(measurements[trial].omega_rad_s, gaits[trial].as_ref())
        };
        let mut add = |condition: Condition, expansion| {
            for &trial in &condition.trials {
                self.of_trials[trial] = (self.all.len(), from(&condition, trial));
            }
            if !condition.trials.is_empty() {
                self.all.push(condition);
                self.expansions.push(expansion);
            }
        };
        let mut joined = Condition::of(trials, measurements, gaits);
        let (far, expansion) = joined.expand(measurements, gaits, problem).unzip();
        let mut far = far.unwrap_or_default();
        joined.trials.retain(|trial| !far.contains(trial));
        add(joined, expansion.clone());
        while let (Some(&farthest), Some(expansion)) = (far.first(), &expansion) {
            let mut around = Condition::of(vec![farthest], measurements, gaits);
            let is_near = |trial: &usize| expansion.second_order(&from(&around, *trial)) < NEAR;
            around.trials = far.iter().copied().filter(is_near).collect();
            let (missed, own) = around.expand(measurements, gaits, problem).unzip();
            let missed = missed.unwrap_or_default();
            around.trials.retain(|trial| !missed.contains(trial));
            far.retain(|trial| !around.trials.contains(trial));
            add(around, own);
        }
    }
}

impl Condition {
    /// At the medians of these trials.
    fn of(trials: Vec<usize>, measurements: &[Measurement], gaits: &[Option<Gait>]) -> Self {
        let middle = |of: &dyn Fn(usize) -> f64| median(trials.iter().map(|&k| of(k)).collect());
        let first = trials.first().and_then(|&trial| gaits[trial]);
        let gait = first.map(|first| Gait {
            joints: [0, 1].map(|i| {
                first.joints[i].map(|first| {
                    let joint =
                        |k: usize| gaits[k].and_then(|gait| gait.joints[i]).unwrap_or(first);
                    let phase_rad =
                        first.phase_rad + middle(&|k| wrap(joint(k).phase_rad - first.phase_rad));
                    JointCommand {
                        offset_rad: middle(&|k| joint(k).offset_rad),
                        amplitude_rad: middle(&|k| joint(k).amplitude_rad),
                        phase_rad,
                        second: first.second,
                    }
                })
            }),
        });
        Self { omega_rad_s: middle(&|k| measurements[k].omega_rad_s), gait, trials }
    }

    /// The condition's expansion and the trials that it misses by too much; `None` if all are the
    /// condition or if there is none.
    fn expand(
        &self,
        measurements: &[Measurement],
        gaits: &[Option<Gait>],
        problem: &impl Fn(Gait, f64) -> Problem,
    ) -> Option<(Vec<usize>, Expansion)> {
        let differences = |&trial: &usize| {
            let omega_rad_s = measurements[trial].omega_rad_s;
            (trial, self.differences(omega_rad_s, gaits[trial].as_ref()))
        };
        let mut others: Vec<(usize, Differences)> = self.trials.iter().map(differences).collect();
        others.retain(|(_, differences)| differences.iter().any(|of| *of != 0.0));
        let all: Vec<Differences> = others.iter().map(|(_, differences)| *differences).collect();
        if all.is_empty() {
            return None;
        }
        let mut solver = Solver::default();
        let own = problem(self.gait?, self.omega_rad_s);
        let expansion = Expansion::solve(&mut solver, &own, &all).ok()?;
        let mut is_far = |(trial, differences): &(usize, Differences)| {
            let own = gaits[*trial].map(|gait| problem(gait, measurements[*trial].omega_rad_s));
            let solved = own.and_then(|own| solver.solve(&own, REFERENCE_ACCURACY).ok());
            solved.is_none_or(|metrics| expansion.misses(differences, &metrics) > MISSED)
        };
        // From the one for which the most is of second order.
        let size = |of: &(usize, Differences)| expansion.second_order(&of.1);
        others.sort_by(|a, b| size(b).total_cmp(&size(a)).then(a.0.cmp(&b.0)));
        let far = others.iter().take_while(|trial| is_far(trial));
        Some((far.map(|(trial, _)| *trial).collect(), expansion))
    }

    fn differences(&self, omega_rad_s: f64, gait: Option<&Gait>) -> Differences {
        let (Some(own), Some(other)) = (self.gait, gait) else { return [0.0; INPUTS] };
        let mut steps_rad = [[0.0; 3]; 2];
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

    /// What changes of the numbers of a gait amount to: those of a passive joint to nothing.
    pub(crate) fn gait_differences(&self, steps_rad: &[[f64; 3]; 2]) -> Differences {
        let mut differences = [0.0; INPUTS];
        let joints = self.gait.map_or([None; 2], |gait| gait.joints);
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
    /// To first order, from a solution's metrics and derivatives.
    pub(crate) fn new(metrics: &GaitMetrics, derivatives: &Derivatives) -> Self {
        let [joint1, joint2] = derivatives.gait;
        let by_input = [[derivatives.omega].as_slice(), &joint1, &joint2].concat();
        let first = ByMetric::from_fn(|metric| {
            let slope = |input: usize| by_input[input][metric];
            std::array::from_fn(slope).map(|slope| if slope.is_finite() { slope } else { 0.0 })
        });
        Self { metrics: *metrics, first, second: ByMetric::splat([[0.0; INPUTS]; INPUTS]) }
    }

    /// To second order in what these differences are in, which differences of the derivatives tell.
    pub(crate) fn solve(
        solver: &mut Solver,
        problem: &Problem,
        differences: &[Differences],
    ) -> Result<Self, MotionError> {
        let metrics = solver.solve(problem, REFERENCE_ACCURACY)?;
        let mut expansion = Self::new(&metrics, &solver.derivatives()?);
        expansion.add_second_order(solver, problem, differences)?;
        Ok(expansion)
    }

    /// Adds the second order; the solver is left at another motion nearby.
    fn add_second_order(
        &mut self,
        solver: &mut Solver,
        problem: &Problem,
        differences: &[Differences],
    ) -> Result<(), MotionError> {
        for input in 0..INPUTS {
            if differences.iter().all(|of| of[input] == 0.0) {
                continue;
            }
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
                Ok(Self::new(&metrics, &solver.derivatives()?))
            };
            let (above, below) = (slopes(step)?, slopes(-step)?);
            for metric in Metric::ALL {
                for j in 0..INPUTS {
                    let change = above.first[metric][j] - below.first[metric][j];
                    // Half of each of the two that should be equal.
                    let half = 0.5 * change / (2.0 * step);
                    self.second[metric][input][j] += half;
                    self.second[metric][j][input] += half;
                }
            }
        }
        Ok(())
    }

    /// Takes over the second order of another expansion, in proportion to the metrics.
    pub(crate) fn keep_second_order(&mut self, other: Self) {
        self.second = other.second;
        for (metric, second) in self.second.iter_mut() {
            let ratio = self.metrics[metric] / other.metrics[metric];
            if ratio.is_finite() {
                second.as_flattened_mut().iter_mut().for_each(|entry| *entry *= ratio);
            }
        }
    }

    /// What the differences of a trial make of a metric: by the derivatives, and to second order.
    fn changes(&self, metric: Metric, differences: &Differences) -> [f64; 2] {
        let dot = |slopes: &Differences| -> f64 {
            slopes.iter().zip(differences).map(|(slope, difference)| slope * difference).sum()
        };
        let second = self.second[metric].each_ref().map(dot);
        [dot(&self.first[metric]), 0.5 * dot(&second)]
    }

    /// The metrics with these differences, where the condition's own are `metrics`.
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

    /// The metrics that are in the objective over the condition's own.
    pub(crate) fn ratios(&self, differences: &Differences) -> ByFitted<f64> {
        let is_own = *differences == [0.0; INPUTS];
        ByFitted::from_fn(|metric| match self.metrics[metric] {
            own if is_own || own == 0.0 => 1.0,
            // Away from where trials were joined, no ratio turns a metric's sign.
            own => (1.0 + self.changes(metric, differences).iter().sum::<f64>() / own)
                .clamp(MOST_RATIO.recip(), MOST_RATIO),
        })
    }

    /// What a difference of one of the inputs makes of the metrics, to first order.
    pub(crate) fn effect(&self, input: usize, difference: f64) -> ByFitted<f64> {
        ByFitted::from_fn(|metric| self.first[metric][input] * difference)
    }

    /// The largest part of a metric that is of second order.
    fn second_order(&self, differences: &Differences) -> f64 {
        largest_part(|metric| self.changes(metric, differences)[1] / self.metrics[metric])
    }

    /// The largest part of a metric that is not told.
    fn misses(&self, differences: &Differences, solved: &GaitMetrics) -> f64 {
        let ratios = self.ratios(differences);
        largest_part(|metric| solved[metric] / self.metrics[metric] - ratios[metric])
    }
}

/// The largest of the metrics in the objective, of those that are known.
fn largest_part(part: impl Fn(Metric) -> f64) -> f64 {
    let parts = Metric::FITTED.into_iter().map(part);
    parts.filter(|part| part.is_finite()).map(f64::abs).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use trilink_robot::{Laws, Model, Robot};
    use trilink_tables::config::{Config, GaitInput, SigmaKind};
    use trilink_tables::{Columns as _, TrialRow};

    use super::*;
    use crate::FitInput;
    use crate::objective::Objective;
    use crate::starts::{Start, search_from};

    const SKID_KG_S: [f64; 3] = [80.0, 40.0, 45.0];

    /// Numbers in -1 to 1 that repeat themselves late.
    fn scattered(number: usize) -> f64 {
        2.0 * (0.618_034 * (number + 1) as f64).fract() - 1.0
    }

    /// Repeats at some frequencies with gaits that differ by up to `spread_rad`.
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
            let problem =
                Problem { robot: robot.clone(), gait: own, laws: Laws::SKID_ROLL, omega_rad_s };
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
            let joints = own.joints.map(|joint| joint.expect("both are commanded"));
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

    fn difference(one: &Start, other: &Start) -> f64 {
        let both = one.ended.iter().zip(&other.ended).chain([(&one.cost, &other.cost)]);
        both.map(|(one, other)| (one / other - 1.0).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn trials_that_are_joined_are_fitted_as_each_by_itself() {
        for gait_input in [GaitInput::Commanded, GaitInput::Measured] {
            let joined = objective(trials(3, 3e-4), gait_input);
            assert_eq!(joined.conditions.all.len(), 4);
            let mut separate = joined.clone();
            separate.conditions =
                Conditions::separate(&joined.measurements, |of| joined.gait_of(of));
            assert_eq!(separate.conditions.all.len(), 12);
            let off = difference(&fitted(&joined), &fitted(&separate));
            assert!(off < 1e-6, "{gait_input}: {off:e}");
        }
    }

    #[test]
    fn copies_of_trials_are_fitted_as_one_of_each() {
        let one = trials(2, 3e-4);
        let copies: Vec<Measurement> =
            one.iter().flat_map(|trial| vec![trial.clone(); 24]).collect();
        for gait_input in [GaitInput::Commanded, GaitInput::Measured] {
            let [one, copies] =
                [&one, &copies].map(|trials| fitted(&objective(trials.clone(), gait_input)));
            let off = difference(&one, &copies);
            assert!(off < 1e-8, "{gait_input}: {off:e}");
        }
    }

    #[test]
    fn a_trial_that_is_far_off_is_a_condition_of_its_own() {
        let mut measurements = trials(3, 3e-4);
        measurements[4].gait[0].amplitude_rad += 0.1;
        let conditions = objective(measurements.clone(), GaitInput::Measured).conditions;
        assert_eq!(conditions.all.len(), 5);
        let (own, differences) = conditions.of_trials[4];
        assert_eq!((&conditions.all[own].trials[..], differences), (&[4][..], [0.0; INPUTS]));
        // The command has not changed.
        assert_eq!(objective(measurements.clone(), GaitInput::Commanded).conditions.all.len(), 4);
        // With others near it, it is one with them.
        let mut others = measurements.clone();
        others.splice(
            4..5,
            [0.0, 0.0, 1e-4].map(|off_rad| {
                let mut other = measurements[4].clone();
                other.gait[0].amplitude_rad += off_rad;
                other
            }),
        );
        let conditions = objective(others, GaitInput::Measured).conditions;
        assert_eq!(conditions.all.len(), 5);
        let with_others = conditions.all.iter().find(|condition| condition.trials.contains(&4));
        assert_eq!(with_others.map(|condition| &condition.trials[..]), Some(&[4, 5, 6][..]));
    }
}
