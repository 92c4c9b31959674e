//! Uncertainty of an optimum due to the uncertainty of the model's coefficients.
//!
//! For the coefficients of every refit, searches start at the optima of the fit, so that each optimum is tracked. For
//! every third refit another search starts from an independent point, which may discover a new optimum; new optima are
//! then tracked for all refits.

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::Problem;
use trilink_robot::{AnyRobot, FreeJoint, Joint, Link, SecondHarmonic};
use trilink_statistics::quantiles;
use trilink_tables::{NoIntervalReason, OptimumRow};

use super::commands::Command;
use super::drive::Drive;
use super::landscape::{ACCURACY, Position, ROUGH_ACCURACY};
use super::quadratic::Hessian;
use super::search::LocalOptimum;
use super::{Optimum, Search, are_same, find_local_optimum, normalise_phases, whole_turns};
use crate::Alternatives;

/// Cost difference from the best optimum above which a start is skipped; a search improves on its start by only a small
/// fraction of this difference.
const MAX_COST_DIFFERENCE: f64 = 0.1;
/// Interval between refits with an additional search from an independent point: 3 means every third refit.
const OWN_START_INTERVAL: usize = 3;
/// Maximum number of new optima to track; an optimum for the coefficients of a refit is new if it was not tracked from
/// an optimum for the originally fitted coefficients.
const MAX_NEW_OPTIMA: usize = 3;
/// Minimum difference between two new optima in at least one command, as a fraction of the command's range, for both to
/// be tracked.
const MIN_DISTANCE: f64 = 0.05;
/// Relative excess above which a limit counts as exceeded.
const MAX_EXCESS: f64 = 1e-6;

/// Uncertainty of the optima found by a search.
#[derive(Debug, Clone, PartialEq)]
pub struct Uncertainty {
    /// Number of replicates.
    pub replicates: usize,
    /// Number of replicates without an optimum that is stable and reached from rest.
    pub without: usize,
    /// 95 % confidence interval for the objective at the best optimum.
    pub value: [f64; 2],
    /// Free commands, each with the 95 % confidence interval for its value at the best optimum, rad/s or rad.
    pub commands: Vec<(Command, [f64; 2])>,
    /// 95 % confidence intervals for amplitude and phase of the second harmonic, rad, of each joint or rotor for which
    /// both of its components are free.
    pub seconds: Vec<(Drive, [[f64; 2]; 2])>,
    /// Values of the free commands, rad/s or rad, at the best optimum of each replicate; replicates without an optimum
    /// that is stable and reached from rest are omitted.
    pub replicate_commands: Vec<Vec<f64>>,
    /// For each optimum for the originally fitted coefficients, the number of replicates in which the optimum tracked
    /// from it is the best.
    pub best_in: Vec<usize>,
    /// Number of replicates in which the best optimum was not tracked from any optimum for the originally fitted
    /// coefficients.
    pub another: usize,
    /// Regret: fraction of the objective that is lost by using the best gait for the originally fitted coefficients
    /// instead of the best gait for a replicate's own coefficients; median and 95 % quantile over the replicates.
    pub regret: [f64; 2],
    /// Number of replicates in whose model the best gait for the originally fitted coefficients has no stable motion
    /// that is reached from rest.
    pub not_reached: usize,
    /// Number of replicates in whose model the best gait for the originally fitted coefficients exceeds a limit.
    pub over_limit: usize,
}

/// Best optimum for the coefficients of a refit.
struct ReplicateOptimum {
    best: Option<Best>,
    /// Objective at the best gait for the originally fitted coefficients, evaluated with the coefficients of the refit;
    /// `None` if its motion is not stable or is not reached from rest.
    value_of_fitted: Option<f64>,
    /// Whether the best gait for the originally fitted coefficients exceeds a limit with the coefficients of the refit.
    is_over_limit: bool,
}

struct Best {
    value: f64,
    commands: Vec<f64>,
    /// Index of the optimum for the originally fitted coefficients from which this optimum was tracked; `None` for a
    /// new optimum.
    origin: Option<usize>,
}

/// Starting point of a search.
struct Start {
    /// Index of the optimum for the originally fitted coefficients at which the search starts; `None` for any other
    /// start.
    origin: Option<usize>,
    position: Position,
    /// Hessian at the start; `None` unless the start is an optimum for other coefficients.
    hessian: Option<Hessian>,
}

/// Local optimum that was tracked from a start.
struct TrackedOptimum {
    origin: Option<usize>,
    end: LocalOptimum,
    problem: Problem,
}

/// Returns starts at the new optima: those that are best for the coefficients of some refit, but were not tracked from
/// an optimum for the originally fitted coefficients.
fn new_optima(tracked: &[Vec<TrackedOptimum>]) -> Vec<Start> {
    let mut starts: Vec<Start> = Vec::new();
    for best in tracked.iter().filter_map(|ends| ends.first()) {
        let LocalOptimum { position, hessian, .. } = &best.end;
        let is_distinct =
            starts.iter().all(|start| (&start.position - position).amax() > MIN_DISTANCE);
        if best.origin.is_none() && starts.len() < MAX_NEW_OPTIMA && is_distinct {
            let (position, hessian) = (position.clone(), Some(hessian.clone()));
            starts.push(Start { origin: None, position, hessian });
        }
    }
    starts
}

impl Uncertainty {
    /// Evaluates the uncertainty of optima, which must be sorted best first; returns `None` if the best one is not
    /// stable or not reached from rest.
    ///
    /// # Errors
    /// Returns an error if the computation is cancelled.
    pub fn new(
        search: &Search,
        optima: &[Optimum],
        alternatives: &Alternatives,
        cancel: &CancelToken,
    ) -> Result<Option<Self>, Cancelled> {
        let candidates: Vec<&Optimum> =
            optima.iter().take_while(|optimum| optimum.is_reachable()).collect();
        let Some(best) = candidates.first().copied() else { return Ok(None) };
        let refits = optimise_refits(search, &candidates, alternatives, cancel)?;
        let limits = |fitted: f64, of: &dyn Fn(&Best) -> f64| {
            let values: Vec<f64> =
                refits.iter().map(|refit| refit.best.as_ref().map_or(f64::NAN, of)).collect();
            alternatives.limits(fitted, &values)
        };
        let commands = search.free.iter().enumerate().map(|(i, command)| {
            let [low, high] = if command.is_phase() {
                [f64::NEG_INFINITY, f64::INFINITY]
            } else {
                command.range(&search.bounds)
            };
            let limits = limits(command.value(&best.problem), &|best| best.commands[i]);
            // NaN (a missing limit) remains NaN.
            (*command, limits.map(|limit| limit.clamp(low, high)))
        });
        let commands = commands.collect();
        let seconds = Drive::all(&best.problem).into_iter().filter_map(|drive| {
            let [Some(in_phase), Some(quadrature)] = drive
                .second_harmonic()?
                .map(|component| search.free.iter().position(|command| *command == component))
            else {
                return None;
            };
            let fitted = drive.angle(&best.problem)?.second();
            let second = |best: &Best| SecondHarmonic {
                in_phase_rad: best.commands[in_phase],
                quadrature_rad: best.commands[quadrature],
            };
            let amplitude = limits(fitted.amplitude_rad(), &|best| second(best).amplitude_rad());
            let phase = limits(fitted.phase_rad(), &|best| {
                let phase_rad = second(best).phase_rad();
                phase_rad + whole_turns(fitted.phase_rad() - phase_rad)
            });
            Some((drive, [amplitude.map(|limit| limit.max(0.0)), phase]))
        });
        let seconds = seconds.collect();
        let value = limits(best.value, &|best| best.value);
        let value = value.map(|limit| limit.clamp(0.0, f64::INFINITY));
        let replicates = &refits[..alternatives.replicates.len()];
        let best_optima: Vec<&Best> =
            replicates.iter().filter_map(|replicate| replicate.best.as_ref()).collect();
        let count_origin =
            |origin: Option<usize>| best_optima.iter().filter(|best| best.origin == origin).count();
        let regrets = replicates.iter().filter_map(|replicate| {
            let best = replicate.best.as_ref()?;
            let loss = search.objective.loss(replicate.value_of_fitted?, best.value);
            // A gait that exceeds a limit may be better than the best one within the limits.
            Some(if replicate.is_over_limit { loss.max(0.0) } else { loss })
        });
        Ok(Some(Self {
            replicates: replicates.len(),
            without: replicates.len() - best_optima.len(),
            value,
            commands,
            seconds,
            replicate_commands: best_optima.iter().map(|best| best.commands.clone()).collect(),
            best_in: (0..candidates.len()).map(|index| count_origin(Some(index))).collect(),
            another: count_origin(None),
            regret: quantiles(regrets.collect(), [0.5, 0.95]),
            not_reached: replicates.iter().filter(|one| one.value_of_fitted.is_none()).count(),
            over_limit: replicates.iter().filter(|one| one.is_over_limit).count(),
        }))
    }

    /// Stores the uncertainty in the corresponding columns of the rows of a robot's optima.
    pub fn fill(&self, rows: &mut [OptimumRow], robot: &AnyRobot) {
        for (rank, row) in rows.iter_mut().enumerate() {
            row.replicates = Some(self.replicates as i64);
            row.best_in = self.best_in.get(rank).map(|count| *count as i64);
            if rank > 0 {
                row.no_interval = Some(NoIntervalReason::NotTheBest.into());
                continue;
            }
            [row.regret_median, row.regret_hi] = self.regret;
            row.not_reached = Some(self.not_reached as i64);
            row.over_limit = Some(self.over_limit as i64);
            for (side, limits) in [&mut row.lower, &mut row.upper].into_iter().enumerate() {
                limits.value = self.value[side];
                for (command, interval) in &self.commands {
                    if let Some(number) = command.number_mut(limits, robot) {
                        *number = interval[side];
                    }
                }
                for (drive, second) in &self.seconds {
                    let Some(numbers) = drive.second_mut(limits, robot) else { continue };
                    for (number, interval) in numbers.into_iter().zip(second) {
                        *number = interval[side];
                    }
                }
            }
        }
    }
}

/// Optimises the gait for the coefficients of each refit, with searches that start at the optima for the originally
/// fitted coefficients (`candidates`), at independent points, and at new optima found for other refits.
fn optimise_refits(
    search: &Search,
    candidates: &[&Optimum],
    alternatives: &Alternatives,
    cancel: &CancelToken,
) -> Result<Vec<ReplicateOptimum>, Cancelled> {
    let searches: Vec<Search> = alternatives
        .all()
        .map(|robot| {
            let problem = Problem { robot: robot.clone(), ..search.problem.clone() };
            Search { problem, ..search.clone() }
        })
        .collect();
    let fitted: Vec<Start> = candidates
        .iter()
        .enumerate()
        .map(|(index, optimum)| Start {
            origin: Some(index),
            position: search.landscape(ROUGH_ACCURACY).position_of(&optimum.problem),
            hessian: optimum.hessian.clone(),
        })
        .collect();
    let mut tracked: Vec<Vec<TrackedOptimum>> = (&searches)
        .into_par_iter()
        .with_max_len(1)
        .enumerate()
        .map(|(index, search)| {
            cancel.check()?;
            let own = index.is_multiple_of(OWN_START_INTERVAL).then(|| {
                let position = search.quasi_random_start(1 + index / OWN_START_INTERVAL);
                Start { origin: None, position, hessian: None }
            });
            let mut ends = Vec::new();
            search.track(fitted.iter().chain(&own), &mut ends);
            Ok(ends)
        })
        .collect::<Result<_, Cancelled>>()?;
    let new = new_optima(&tracked);
    (&searches, &mut tracked)
        .into_par_iter()
        .with_max_len(1)
        .map(|(search, ends)| {
            cancel.check()?;
            search.track(new.iter(), ends);
            Ok(search.select_best(candidates, ends))
        })
        .collect()
}

impl Search {
    /// Adds the local optima found from the given starts to `ends`, and sorts `ends` by cost. A start at an optimum for
    /// other coefficients is skipped if its cost is much higher than that of the best optimum so far.
    fn track<'s>(&self, starts: impl Iterator<Item = &'s Start>, ends: &mut Vec<TrackedOptimum>) {
        let mut landscape = self.landscape(ROUGH_ACCURACY);
        for Start { origin, position, hessian } in starts {
            let best = ends.iter().map(|of| of.end.point.cost).fold(f64::INFINITY, f64::min);
            if hessian.is_some() && best.is_finite() {
                landscape.forget();
                landscape.only_stable = false;
                if landscape.cost(position).is_none_or(|cost| cost > best + MAX_COST_DIFFERENCE) {
                    continue;
                }
            }
            let Some(end) = find_local_optimum(&mut landscape, position.clone(), hessian.clone())
            else {
                continue;
            };
            let problem = normalise_phases(landscape.problem_at(&end.position));
            let is_known = ends
                .iter()
                .any(|of| are_same(&landscape, (&of.end, &of.problem), (&end, &problem)));
            if !is_known {
                ends.push(TrackedOptimum { origin: *origin, end, problem });
            }
        }
        ends.sort_by(|a, b| a.end.point.cost.total_cmp(&b.end.point.cost));
    }

    /// Selects the best reachable optimum among `ends` and the best gait for the originally fitted coefficients (the
    /// first of `candidates`), and evaluates the latter with the coefficients of this search.
    fn select_best(&self, candidates: &[&Optimum], ends: &[TrackedOptimum]) -> ReplicateOptimum {
        // At the accuracy of tracking, a small change of the commands has no measurable effect on the cost.
        let mut accurate = self.landscape(ACCURACY);
        let best = ends.iter().find_map(|TrackedOptimum { origin, end, problem }| {
            let (start, hessian) = (end.position.clone(), Some(end.hessian.clone()));
            let problem = match find_local_optimum(&mut accurate, start, hessian) {
                Some(end) => normalise_phases(accurate.problem_at(&end.position)),
                None => problem.clone(),
            };
            Some((self.reachable_optimum(problem)?, *origin))
        });
        let fitted_problem = &candidates[0].problem;
        let fitted = self.reachable_optimum(self.with_commands_of(fitted_problem));
        let mut landscape = self.landscape(ROUGH_ACCURACY);
        let is_over_limit = landscape
            .evaluate(&landscape.position_of(fitted_problem))
            .is_some_and(|point| point.excess.into_iter().any(|excess| excess > MAX_EXCESS));
        // The tracked optima may not include the fitted gait, because searches may end in motions that are not
        // reachable.
        let best = match (best, &fitted) {
            (Some((best, _)), Some(fitted))
                if !is_over_limit && self.objective.loss(best.value, fitted.value) > 0.0 =>
            {
                Some((fitted.clone(), Some(0)))
            }
            (None, Some(fitted)) if !is_over_limit => Some((fitted.clone(), Some(0))),
            (best, _) => best,
        };
        let best = best.map(|(best, origin)| Best {
            value: best.value,
            commands: self.commands_near(&best.problem, fitted_problem),
            origin,
        });
        ReplicateOptimum { best, value_of_fitted: fitted.map(|fitted| fitted.value), is_over_limit }
    }

    /// Solves a gait's problem; returns `None` if its motion is not stable or is not reached from rest.
    fn reachable_optimum(&self, problem: Problem) -> Option<Optimum> {
        Optimum::new(problem, self.objective, Vec::new(), 0).filter(Optimum::is_reachable)
    }

    /// Returns the problem of this search with the free commands of another problem.
    fn with_commands_of(&self, other: &Problem) -> Problem {
        let mut problem = self.problem.clone();
        for command in &self.free {
            command.set(&mut problem, command.value(other));
        }
        normalise_phases(problem)
    }

    /// Returns the free commands of a gait or of its mirror image, whichever is nearer to another gait; phases are
    /// shifted by whole turns to be nearest to those of the other gait.
    fn commands_near(&self, problem: &Problem, other: &Problem) -> Vec<f64> {
        let offsets: Vec<Command> =
            Drive::all(problem).into_iter().filter_map(Drive::offset).collect();
        let distance = |sign: f64| -> f64 {
            offsets.iter().map(|of| (sign * of.value(problem) - of.value(other)).abs()).sum()
        };
        let sign = if has_mirror_image(&problem.robot) && distance(-1.0) < distance(1.0) {
            -1.0
        } else {
            1.0
        };
        let commands = self.free.iter().map(|command| {
            let value = command.value(problem);
            if command.is_odd() {
                sign * value
            } else if command.is_phase() {
                value + whole_turns(command.value(other) - value)
            } else {
                value
            }
        });
        commands.collect()
    }
}

/// Returns whether the mirror image of a robot is the same robot.
fn has_mirror_image(robot: &AnyRobot) -> bool {
    let Some(chain) = robot.as_chain() else { return true };
    let is_straight = |link: &Link| link.wheel.is_none_or(|wheel| wheel.steer_rad == 0.0);
    let is_relaxed_straight = |joint: &Joint| match joint {
        Joint::Free(FreeJoint { target, .. }) if target.half_range_rad() == 0.0 => {
            target.offset_rad == 0.0
        }
        Joint::Free(_) | Joint::Driven(_) => true,
    };
    chain.links.iter().all(is_straight) && chain.joints.iter().all(is_relaxed_straight)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use trilink_mechanics::Problem;
    use trilink_robot::{Gait, Laws, Robot};
    use trilink_tables::Objective;

    use super::super::SearchResult;
    use super::super::tests::frequency_search;
    use super::*;

    fn semi_passive(skid_kg_s: [f64; 3]) -> Problem {
        let robot = Robot { skid_kg_s, ..Robot::semi_passive() };
        let gait = Gait::passive_symmetric();
        Problem::new(robot, gait, Laws::SKID_ROLL, 3.0)
    }

    /// Applies random errors with the given relative standard deviation to the coefficients.
    fn perturb(skid_kg_s: [f64; 3], deviation: f64, random: &mut ChaCha8Rng) -> [f64; 3] {
        skid_kg_s.map(|coefficient| {
            let normal: f64 = StandardNormal.sample(random);
            coefficient * (deviation * normal).exp()
        })
    }

    fn run(search: &Search) -> SearchResult {
        search.run(&CancelToken::default()).expect("nobody cancels it")
    }

    fn uncertainty(search: &Search, optima: &[Optimum], of: &Alternatives) -> Option<Uncertainty> {
        Uncertainty::new(search, optima, of, &CancelToken::default())
            .expect("the work is not cancelled")
    }

    #[test]
    fn the_interval_contains_the_true_optimum() {
        const TRUTH_KG_S: [f64; 3] = [420.0, 200.0, 70.0];
        let speed_search = |skid_kg_s: [f64; 3]| {
            frequency_search(semi_passive(skid_kg_s), Objective::Speed, [1.0, 8.0])
        };
        let best = |found: &SearchResult| {
            let best = found.best().expect("an optimum");
            (best.value, best.problem.omega_rad_s)
        };
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let (value, omega_rad_s) = best(&run(&speed_search(TRUTH_KG_S)));
        let fitted = perturb(TRUTH_KG_S, 0.03, &mut random);
        let replicate = |_| semi_passive(perturb(fitted, 0.03, &mut random)).robot;
        let alternatives = Alternatives {
            replicates: (0..12).map(replicate).collect(),
            ..Alternatives::default()
        };
        let search = speed_search(fitted);
        let found = run(&search);
        let uncertain =
            uncertainty(&search, &found.optima, &alternatives).expect("the optimum is reachable");
        let is_in = |[low, high]: [f64; 2], value: f64| low < value && value < high;
        assert!(is_in(uncertain.value, value), "{:?} {value}", uncertain.value);
        let [(Command::Omega, limits_rad_s)] = uncertain.commands[..] else {
            panic!("{uncertain:?}")
        };
        assert!(is_in(limits_rad_s, omega_rad_s), "{limits_rad_s:?} {omega_rad_s}");
        assert_eq!(uncertain.replicates, 12, "{uncertain:?}");
        assert_eq!(uncertain.best_in[0], 12, "{uncertain:?}");
        assert_eq!(uncertain.without, 0, "{uncertain:?}");
        let [median, high] = uncertain.regret;
        assert!(-1e-6 < median && median <= high && 0.0 < high && high < 0.01, "{uncertain:?}");
        // The result does not depend on the number of threads.
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        let serial = one.install(|| uncertainty(&search, &found.optima, &alternatives));
        assert_eq!(serial, Some(uncertain));
    }

    #[test]
    fn there_is_no_regret_if_every_replicate_equals_the_fit() {
        let problem = semi_passive([420.0, 200.0, 70.0]);
        let replicates = vec![problem.robot.clone(); 2];
        let alternatives = Alternatives { replicates, ..Alternatives::default() };
        for objective in [Objective::Speed, Objective::WorkPerMetre] {
            let search = frequency_search(problem.clone(), objective, [1.0, 8.0]);
            let found = run(&search);
            let uncertain =
                uncertainty(&search, &found.optima, &alternatives).expect("it is reachable");
            assert!(uncertain.regret.iter().all(|loss| loss.abs() < 1e-9), "{uncertain:?}");
            let [low, high] = uncertain.value.map(|limit| limit / found.optima[0].value - 1.0);
            assert!(low.abs() < 1e-9 && high.abs() < 1e-9, "{uncertain:?}");
            let Uncertainty { not_reached, over_limit, another, .. } = uncertain;
            assert_eq!([not_reached, over_limit, another], [0; 3]);
        }
    }

    #[test]
    fn the_mirror_image_and_phases_nearest_to_another_gait_are_chosen() {
        let problem = Problem { gait: Gait::skewed().into(), ..semi_passive([0.0; 3]) };
        let search = frequency_search(problem, Objective::Speed, [1.0, 8.0]);
        let mut problem = search.problem.clone();
        let search = Search { free: Command::all(&problem), ..search };
        let other = problem.clone();
        for joint in problem.gait.joints.iter_mut().flatten() {
            joint.offset_rad *= -0.9;
            joint.phase_rad += TAU;
        }
        let near = search.commands_near(&problem, &other);
        for (command, value) in search.free.iter().zip(near) {
            let factor = if command.is_offset() { 0.9 } else { 1.0 };
            assert!((value - factor * command.value(&other)).abs() < 1e-12, "{command:?}: {value}");
        }
    }
}
