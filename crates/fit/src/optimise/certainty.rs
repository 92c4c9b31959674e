//! How sure an optimum is: what is best with coefficients that may be the true ones as well.
//!
//! With those of every refit the searches begin at the optima of the fit, so that each is followed, with every third at
//! a place of its own, too, so that another may appear, which is then followed with all of them.

use rayon::prelude::*;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_mechanics::Problem;
use trilink_robot::{Robot, SecondHarmonic};
use trilink_statistics::quantiles;
use trilink_tables::{NoIntervalReason, OptimumRow};

use super::commands::Command;
use super::landscape::{Place, ROUGH_ACCURACY};
use super::quadratic::Curvature;
use super::search::End;
use super::{Optimum, Search, are_same, climb, normal, whole_turns};
use crate::Alternatives;

/// By how much more an optimum costs than the best one that is not followed: going to where it has moved gains a small
/// part of that.
const FAR: f64 = 0.1;
/// One in so many is searched from a place of its own, too.
const SPREAD: usize = 3;
/// Most other optima that are followed, and the difference of what varies, as a part of the ranges, of one and another.
const MOST_OTHERS: usize = 3;
const APART: f64 = 0.05;
/// By how much a limit is exceeded, as a part of it, that counts.
const EXCEEDED: f64 = 1e-6;

/// How sure the optima of a search are.
#[derive(Debug, Clone, PartialEq)]
pub struct Certainty {
    /// Replicates, and those of them in which no search found an optimum that counts.
    pub replicates: usize,
    pub without: usize,
    /// 95 % limits of the best: of its value, and of every command that varies.
    pub value: [f64; 2],
    pub commands: Vec<(Command, [f64; 2])>,
    /// Of the second harmonic of each joint of which both parts vary: of its amplitude and its phase, rad.
    pub seconds: [Option<[[f64; 2]; 2]>; 2],
    /// The commands that vary at the best of each replicate that has one.
    pub places: Vec<Vec<f64>>,
    /// Replicates in which each of the fit's optima is the best, and in which another is.
    pub best_in: Vec<usize>,
    pub another: usize,
    /// Part of the objective that is lost with the best gait of the fit: median and 95 % quantile of the
    /// replicates.
    pub regret: [f64; 2],
    /// Replicates with which the robot does not get from rest into a stable motion with that gait, and those
    /// in which that exceeds a limit.
    pub not_reached: usize,
    pub over_limit: usize,
}

/// What is best with other coefficients.
struct Again {
    best: Option<Best>,
    /// What the best gait of the fit comes to, if its motion counts.
    fitted: Option<f64>,
    is_over_limit: bool,
}

struct Best {
    value: f64,
    commands: Vec<f64>,
    /// The optimum of the fit that it follows from.
    follows: Option<usize>,
}

/// Where a search begins: at one of the optima of the fit, with the curvature there, or elsewhere.
struct Start {
    candidate: Option<usize>,
    place: Place,
    curvature: Option<Curvature>,
}

/// Where it has ended.
struct Followed {
    candidate: Option<usize>,
    end: End,
    problem: Problem,
}

/// What is the best with some coefficients, and none of what follows from the optima of the fit.
fn others(followed: &[Vec<Followed>]) -> Vec<Start> {
    let mut others: Vec<Start> = Vec::new();
    let best = followed.iter().filter_map(|ends| ends.first());
    for Followed { end: End { place, curvature, .. }, .. } in
        best.filter(|of| of.candidate.is_none())
    {
        let is_apart = |of: &Start| (of.place - place).amax() > APART;
        if others.len() < MOST_OTHERS && others.iter().all(is_apart) {
            others.push(Start { candidate: None, place: *place, curvature: Some(*curvature) });
        }
    }
    others
}

impl Certainty {
    /// Of the optima that a search has found, the best first; `None` if that does not count.
    ///
    /// # Errors
    /// The work was cancelled.
    pub fn new(
        search: &Search,
        optima: &[Optimum],
        alternatives: &Alternatives,
        cancel: &CancelToken,
    ) -> Result<Option<Self>, Cancelled> {
        let candidates: Vec<&Optimum> = optima.iter().take_while(|of| of.counts()).collect();
        let Some(best) = candidates.first().copied() else { return Ok(None) };
        let of_robot = |robot: &Robot| {
            let problem = Problem { robot: robot.clone(), ..search.problem.clone() };
            Search { problem, ..search.clone() }
        };
        let searches: Vec<Search> = alternatives.all().map(of_robot).collect();
        let known = candidates.iter().enumerate().map(|(nth, of)| Start {
            candidate: Some(nth),
            place: search.landscape(ROUGH_ACCURACY).place_of(&of.problem),
            curvature: of.curvature,
        });
        let known: Vec<Start> = known.collect();
        let mut followed: Vec<Vec<Followed>> = (&searches)
            .into_par_iter()
            .with_max_len(1)
            .enumerate()
            .map(|(nth, search)| {
                cancel.check()?;
                let own = nth.is_multiple_of(SPREAD).then(|| {
                    let place = search.spread(1 + nth / SPREAD);
                    Start { candidate: None, place, curvature: None }
                });
                let mut ends = Vec::new();
                search.follow(known.iter().chain(&own), &mut ends);
                Ok(ends)
            })
            .collect::<Result<_, Cancelled>>()?;
        let others = others(&followed);
        let both = (&searches, &mut followed).into_par_iter().with_max_len(1);
        let all: Vec<Again> = both
            .map(|(search, ends)| {
                cancel.check()?;
                search.follow(others.iter(), ends);
                Ok(search.again(&candidates, ends))
            })
            .collect::<Result<_, Cancelled>>()?;
        let limits = |fitted: f64, of: &dyn Fn(&Best) -> f64| {
            let found: Vec<f64> =
                all.iter().map(|again| again.best.as_ref().map_or(f64::NAN, of)).collect();
            alternatives.limits(fitted, &found)
        };
        let commands = search.free.iter().enumerate().map(|(i, command)| {
            let [least, most] = match command.is_phase() {
                true => [f64::NEG_INFINITY, f64::INFINITY],
                false => command.range(&search.bounds),
            };
            let limits = limits(command.value(&best.problem), &|best| best.commands[i]);
            // What is missing stays so.
            (*command, limits.map(|limit| limit.clamp(least, most)))
        });
        let commands = commands.collect();
        let seconds = [0, 1].map(|joint| {
            let nth = |part: Command| search.free.iter().position(|of| *of == part);
            let [Some(in_phase), Some(quadrature)] = Command::parts_of_second(joint).map(nth)
            else {
                return None;
            };
            let fitted = best.problem.gait.joints[joint]?.second();
            let of = |best: &Best| SecondHarmonic {
                in_phase_rad: best.commands[in_phase],
                quadrature_rad: best.commands[quadrature],
            };
            let phase_rad = |best: &Best| {
                of(best).phase_rad() + whole_turns(fitted.phase_rad() - of(best).phase_rad())
            };
            let amplitude = limits(fitted.amplitude_rad(), &|best| of(best).amplitude_rad());
            Some([amplitude.map(|of| of.max(0.0)), limits(fitted.phase_rad(), &phase_rad)])
        });
        let value = limits(best.value, &|best| best.value);
        let value = value.map(|limit| limit.clamp(0.0, f64::INFINITY));
        let replicates = &all[..alternatives.replicates.len()];
        let places =
            replicates.iter().filter_map(|again| Some(again.best.as_ref()?.commands.clone()));
        let count = |is: &dyn Fn(&Again) -> bool| replicates.iter().filter(|of| is(of)).count();
        let follows = |from: Option<usize>| {
            count(&|again| again.best.as_ref().is_some_and(|best| best.follows == from))
        };
        let regrets = replicates.iter().filter_map(|again| {
            let lost = search.objective.loss(again.fitted?, again.best.as_ref()?.value);
            // Beyond a limit there may be more.
            Some(if again.is_over_limit { lost.max(0.0) } else { lost })
        });
        Ok(Some(Self {
            replicates: replicates.len(),
            without: count(&|again| again.best.is_none()),
            value,
            commands,
            seconds,
            places: places.collect(),
            best_in: (0..candidates.len()).map(|nth| follows(Some(nth))).collect(),
            another: follows(None),
            regret: quantiles(regrets.collect(), [0.5, 0.95]),
            not_reached: count(&|again| again.fitted.is_none()),
            over_limit: count(&|again| again.is_over_limit),
        }))
    }

    /// Fills in what rows of the optima say of it.
    pub fn fill(&self, rows: &mut [OptimumRow]) {
        for (nth, row) in rows.iter_mut().enumerate() {
            row.replicates = Some(self.replicates as i64);
            row.best_in = self.best_in.get(nth).map(|count| *count as i64);
            if nth > 0 {
                row.no_interval = Some(NoIntervalReason::NotTheBest.into());
                continue;
            }
            [row.regret_median, row.regret_hi] = self.regret;
            row.not_reached = Some(self.not_reached as i64);
            row.over_limit = Some(self.over_limit as i64);
            for (side, limits) in [&mut row.lower, &mut row.upper].into_iter().enumerate() {
                limits.value = self.value[side];
                for (command, of) in &self.commands {
                    if let Some(number) = command.number_mut(limits) {
                        *number = of[side];
                    }
                }
                for (joint, second) in self.seconds.iter().enumerate() {
                    let Some([amplitude, phase]) = second else { continue };
                    limits.amplitude2_rad[joint] = amplitude[side];
                    limits.phase2_rad[joint] = phase[side];
                }
            }
        }
    }
}

impl Search {
    /// Adds where searches end. What is far from the best so far where it begins is not searched from, if that is an
    /// optimum of other coefficients.
    fn follow<'s>(&self, starts: impl Iterator<Item = &'s Start>, ends: &mut Vec<Followed>) {
        let mut landscape = self.landscape(ROUGH_ACCURACY);
        for Start { candidate, place, curvature } in starts {
            let best = ends.iter().map(|of| of.end.point.cost).fold(f64::INFINITY, f64::min);
            if curvature.is_some() && best.is_finite() {
                landscape.forget();
                landscape.only_stable = false;
                if landscape.cost(place).is_none_or(|cost| cost > best + FAR) {
                    continue;
                }
            }
            let Some(end) = climb(&mut landscape, *place, *curvature) else { continue };
            let problem = normal(landscape.problem_at(&end.place));
            let is_known = ends
                .iter()
                .any(|of| are_same(&landscape, (&of.end, &of.problem), (&end, &problem)));
            if !is_known {
                ends.push(Followed { candidate: *candidate, end, problem });
            }
        }
        ends.sort_by(|a, b| a.end.point.cost.total_cmp(&b.end.point.cost));
    }

    /// What is best of what was followed, and what the best gait of the fit comes to.
    fn again(&self, candidates: &[&Optimum], ends: &[Followed]) -> Again {
        let fitted =
            |of: &Optimum| Problem { robot: self.problem.robot.clone(), ..of.problem.clone() };
        let reached = |problem: Problem| {
            Optimum::new(problem, self.objective, Vec::new(), 0).filter(Optimum::counts)
        };
        let best = ends.iter().find_map(|of| Some((reached(of.problem.clone())?, of.candidate)));
        let of_fit = reached(fitted(candidates[0]));
        let mut landscape = self.landscape(ROUGH_ACCURACY);
        let is_over_limit = landscape
            .evaluate(&landscape.place_of(&candidates[0].problem))
            .is_some_and(|point| point.excess.into_iter().any(|excess| excess > EXCEEDED));
        let is_better =
            |of: &Optimum, than: &Optimum| self.objective.loss(than.value, of.value) > 0.0;
        // Where the search ended may be a motion that is not reached.
        let best = match (best, &of_fit) {
            (Some((best, _)), Some(of)) if !is_over_limit && is_better(of, &best) => {
                Some((of.clone(), Some(0)))
            }
            (None, Some(of)) if !is_over_limit => Some((of.clone(), Some(0))),
            (best, _) => best,
        };
        let best = best.map(|(best, follows)| Best {
            value: best.value,
            commands: self.commands_near(&best.problem, &candidates[0].problem),
            follows,
        });
        Again { best, fitted: of_fit.map(|of| of.value), is_over_limit }
    }

    /// The commands of a gait, or of its mirror image, and phases a number of turns away, whichever is nearer
    /// to another gait.
    fn commands_near(&self, problem: &Problem, other: &Problem) -> Vec<f64> {
        let far = |sign: f64| -> f64 {
            let joints =
                problem.gait.joints.iter().flatten().zip(other.gait.joints.iter().flatten());
            joints.map(|(a, b)| (sign * a.offset_rad - b.offset_rad).abs()).sum()
        };
        let sign = if far(-1.0) < far(1.0) { -1.0 } else { 1.0 };
        let near = |command: &Command| {
            let (value, there) = (command.value(problem), command.value(other));
            match command {
                _ if command.is_odd() => sign * value,
                _ if command.is_phase() => value + whole_turns(there - value),
                _ => value,
            }
        };
        self.free.iter().map(near).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};
    use trilink_robot::{Gait, Laws};
    use trilink_tables::Objective;

    use super::super::Found;
    use super::super::tests::of_omega;
    use super::*;

    fn semi_passive(skid_kg_s: [f64; 3]) -> Problem {
        let robot = Robot { skid_kg_s, ..Robot::semi_passive() };
        let gait = Gait::passive_symmetric();
        Problem { robot, gait, laws: Laws::SKID_ROLL, omega_rad_s: 3.0 }
    }

    /// Coefficients off by this part, as random as they come.
    fn off(skid_kg_s: [f64; 3], part: f64, random: &mut ChaCha8Rng) -> [f64; 3] {
        skid_kg_s.map(|of| {
            let normal: f64 = StandardNormal.sample(random);
            of * (part * normal).exp()
        })
    }

    fn run(search: &Search) -> Found {
        search.run(&CancelToken::default()).expect("nobody cancels it")
    }

    fn certainty(search: &Search, optima: &[Optimum], of: &Alternatives) -> Option<Certainty> {
        Certainty::new(search, optima, of, &CancelToken::default()).expect("nobody cancels it")
    }

    #[test]
    fn the_interval_has_the_truths_optimum_in_it() {
        const TRUTH_KG_S: [f64; 3] = [420.0, 200.0, 70.0];
        let of =
            |skid_kg_s: [f64; 3]| of_omega(semi_passive(skid_kg_s), Objective::Speed, [1.0, 8.0]);
        let best = |found: &Found| {
            let best = found.best().expect("an optimum");
            (best.value, best.problem.omega_rad_s)
        };
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let (value, omega_rad_s) = best(&run(&of(TRUTH_KG_S)));
        let fitted = off(TRUTH_KG_S, 0.03, &mut random);
        let replicate = |_| semi_passive(off(fitted, 0.03, &mut random)).robot;
        let alternatives = Alternatives {
            replicates: (0..12).map(replicate).collect(),
            ..Alternatives::default()
        };
        let search = of(fitted);
        let found = run(&search);
        let sure = certainty(&search, &found.optima, &alternatives).expect("it counts");
        let is_in = |[low, high]: [f64; 2], value: f64| low < value && value < high;
        assert!(is_in(sure.value, value), "{:?} {value}", sure.value);
        let [(Command::Omega, limits_rad_s)] = sure.commands[..] else { panic!("{sure:?}") };
        assert!(is_in(limits_rad_s, omega_rad_s), "{limits_rad_s:?} {omega_rad_s}");
        assert_eq!((sure.replicates, sure.best_in[0], sure.without), (12, 12, 0), "{sure:?}");
        let [median, most] = sure.regret;
        assert!(-1e-6 < median && median <= most && 0.0 < most && most < 0.01, "{sure:?}");
        // The same with any number of threads.
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        let again = one.install(|| certainty(&search, &found.optima, &alternatives));
        assert_eq!(again, Some(sure));
    }

    #[test]
    fn nothing_is_lost_where_every_replicate_is_the_fit() {
        let problem = semi_passive([420.0, 200.0, 70.0]);
        let replicates = vec![problem.robot.clone(); 2];
        let alternatives = Alternatives { replicates, ..Alternatives::default() };
        for objective in [Objective::Speed, Objective::WorkPerMetre] {
            let search = of_omega(problem.clone(), objective, [1.0, 8.0]);
            let found = run(&search);
            let sure = certainty(&search, &found.optima, &alternatives).expect("it counts");
            assert!(sure.regret.iter().all(|part| part.abs() < 1e-9), "{sure:?}");
            let [low, high] = sure.value.map(|limit| limit / found.optima[0].value - 1.0);
            assert!(low.abs() < 1e-9 && high.abs() < 1e-9, "{sure:?}");
            assert_eq!((sure.not_reached, sure.over_limit, sure.another), (0, 0, 0));
        }
    }

    #[test]
    fn of_two_gaits_that_are_one_the_nearer_numbers_count() {
        let mut problem = Problem { gait: Gait::skewed(), ..semi_passive([0.0; 3]) };
        let search = Search {
            free: Command::all(&problem.gait),
            ..of_omega(problem.clone(), Objective::Speed, [1.0, 8.0])
        };
        let other = problem.clone();
        for joint in problem.gait.joints.iter_mut().flatten() {
            joint.offset_rad *= -0.9;
            joint.phase_rad += TAU;
        }
        let near = search.commands_near(&problem, &other);
        for (command, value) in search.free.iter().zip(near) {
            let part = if command.is_offset() { 0.9 } else { 1.0 };
            assert!((value - part * command.value(&other)).abs() < 1e-12, "{command}: {value}");
        }
    }
}
