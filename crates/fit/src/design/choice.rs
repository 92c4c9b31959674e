//! Which trials of many to make: all choices where these are few, else one after the other and then by
//! exchange.
//!
//! Reference: V. V. Fedorov, *Theory of Optimal Experiments*, Academic Press 1972, section 3.3;
//! A. C. Atkinson, A. N. Donev and R. D. Tobias, *Optimum Experimental Designs, with SAS*, Oxford 2007,
//! chapter 12.

use argmin::argmin_error;
use argmin::core::{
    Error, Executor, IterState, KV, Problem, Solver, State as _, TerminationReason,
};
use rayon::prelude::*;
use trilink_base::cancel::CancelToken;

use super::AdviceError;

/// Most choices that are all looked at.
const FEW: usize = 6_000;
/// Fall of a score that is none, relative.
const SAME: f64 = 1e-12;

/// A choice of candidates, by their numbers, ascending; one may be there again.
pub(super) type Choice = Vec<usize>;
type State = IterState<Choice, (), (), (), (), f64>;

/// What a choice is worth: the lowest is the best. Any number of candidates has one.
pub(super) trait Score: Sync {
    fn of(&self, choice: &[usize]) -> f64;
}

impl<F: Fn(&[usize]) -> f64 + Sync> Score for F {
    fn of(&self, choice: &[usize]) -> f64 {
        self(choice)
    }
}

/// How many are chosen, of how many candidates, each at most so often.
#[derive(Debug, Clone, Copy)]
pub(super) struct Size {
    pub add: usize,
    pub candidates: usize,
    pub repeats: usize,
}

/// The best choice that was looked at, and whether those are all.
///
/// # Errors
/// There are too few candidates, or the work was cancelled.
pub(super) fn best(
    score: &impl Score,
    size: Size,
    cancel: &CancelToken,
) -> Result<(Choice, bool), AdviceError> {
    let Size { add, candidates, repeats } = size;
    if candidates * repeats < add {
        return Err(format!(
            "--add: found {add}, needed {} at most: each of {candidates} candidates {repeats} times (--repeats)",
            candidates * repeats
        )
        .into());
    }
    let of_allowed = |choice: &[usize]| {
        let count = |of: usize| choice.iter().filter(|other| **other == of).count();
        // With every other choice ruled out the search ends.
        match !cancel.is_cancelled() && choice.iter().all(|of| count(*of) <= repeats) {
            true => score.of(choice),
            false => f64::INFINITY,
        }
    };
    let searched = by_exchange(&of_allowed, candidates, add);
    if choices(candidates, add).is_none_or(|all| all > FEW) {
        cancel.check()?;
        return Ok((searched, false));
    }
    let best = of_all(&of_allowed, candidates, add).unwrap_or(searched);
    cancel.check()?;
    Ok((best, true))
}

/// How many choices there are; `None` of far too many.
fn choices(count: usize, add: usize) -> Option<usize> {
    (0..add).try_fold(1_usize, |all, i| Some(all.checked_mul(count + i)? / (i + 1)))
}

/// The best of all choices.
fn of_all(score: &impl Score, count: usize, add: usize) -> Option<Choice> {
    let all: Vec<Choice> = all_choices(count, add);
    let scores: Vec<f64> = all.par_iter().map(|choice| score.of(choice)).collect();
    let best = (0..all.len()).min_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
    all.into_iter().nth(best)
}

fn all_choices(count: usize, add: usize) -> Vec<Choice> {
    let mut all = vec![Choice::new()];
    for _ in 0..add {
        all = all
            .into_iter()
            .flat_map(|choice| {
                let first = choice.last().copied().unwrap_or(0);
                (first..count).map(move |next| [choice.as_slice(), &[next]].concat())
            })
            .collect();
    }
    all
}

/// One candidate after the other, each the best, then exchanges of one for another until none is better.
fn by_exchange(score: &impl Score, count: usize, add: usize) -> Choice {
    let mut choice = Choice::new();
    for _ in 0..add {
        let (next, _) = lowest(score, count, |next| [choice.as_slice(), &[next]].concat());
        choice.push(next);
    }
    let cost = score.of(&choice);
    let result = Executor::new(score, Exchange { count })
        .configure(|state| state.param(choice.clone()).cost(cost).max_iters(100))
        .timer(false)
        .ctrlc(false)
        .run();
    let mut best = result.ok().and_then(|of| of.state.param).unwrap_or(choice);
    best.sort_unstable();
    best
}

/// The candidate with which a choice is best, the first of equal ones, and what that is worth.
fn lowest(score: &impl Score, count: usize, with: impl Fn(usize) -> Choice + Sync) -> (usize, f64) {
    let scores: Vec<f64> = (0..count).into_par_iter().map(|of| score.of(&with(of))).collect();
    let best = (0..count).min_by(|a, b| scores[*a].total_cmp(&scores[*b])).unwrap_or(0);
    (best, scores.get(best).copied().unwrap_or(f64::NAN))
}

/// Exchanges the one of a choice that gains most by it.
struct Exchange {
    count: usize,
}

impl<'s, S: Score> Solver<&'s S, State> for Exchange {
    fn name(&self) -> &str {
        "exchange"
    }

    fn next_iter(
        &mut self,
        problem: &mut Problem<&'s S>,
        mut state: State,
    ) -> Result<(State, Option<KV>), Error> {
        let (Some(score), Some(choice)) = (problem.problem, state.take_param()) else {
            return Err(argmin_error!(NotInitialized, "no first choice"));
        };
        let exchanged = |place: usize, next: usize| {
            let mut other = choice.clone();
            other[place] = next;
            other
        };
        let best = (0..choice.len())
            .map(|place| (place, lowest(score, self.count, |next| exchanged(place, next))))
            .min_by(|(_, (_, a)), (_, (_, b))| a.total_cmp(b));
        match best {
            Some((place, (next, cost))) if cost < state.cost - SAME * state.cost.abs() => {
                let next = exchanged(place, next);
                Ok((state.param(next).cost(cost), None))
            }
            _ => {
                let state = state.param(choice);
                Ok((state.terminate_with(TerminationReason::SolverConverged), None))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_choices_are_those_with_repeats() {
        assert_eq!(all_choices(3, 2), [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]]);
        assert_eq!((choices(3, 2), choices(24, 3), choices(1000, 40)), (Some(6), Some(2600), None));
    }

    #[test]
    fn exchange_finds_what_one_after_the_other_misses() {
        // The best single one is 2, the best pair 0 and 4.
        let places = [0.0_f64, 1.0, 2.1, 3.0, 4.0];
        let score = |choice: &[usize]| -> f64 {
            let nearest =
                |at: f64| choice.iter().map(|of| (places[*of] - at).abs()).fold(9.0, f64::min);
            nearest(0.0) + nearest(4.0)
        };
        assert_eq!(by_exchange(&score, 5, 2), [0, 4]);
        let size = |candidates: usize, repeats: usize| Size { add: 2, candidates, repeats };
        let cancel = CancelToken::default();
        assert_eq!(best(&score, size(5, 1), &cancel).ok(), Some((vec![0, 4], true)));
        // The middle alone, twice.
        let middle =
            |choice: &[usize]| -> f64 { choice.iter().map(|of| of.abs_diff(2) as f64).sum() };
        assert_eq!(best(&middle, size(5, 2), &cancel).ok(), Some((vec![2, 2], true)));
        assert_eq!(best(&middle, size(5, 1), &cancel).ok(), Some((vec![1, 2], true)));
        assert!(best(&middle, size(1, 1), &cancel).is_err());
        cancel.cancel();
        let cancelled = best(&middle, size(5, 1), &cancel);
        assert!(matches!(cancelled, Err(AdviceError::Cancelled(_))), "{cancelled:?}");
    }
}
