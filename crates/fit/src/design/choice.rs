//! Selection of the trials of a design: by exhaustive search if there are few choices, otherwise by a greedy search
//! refined by Fedorov's exchange algorithm.
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

/// Maximum number of possible choices of trials for which the search is exhaustive.
const MAX_EXHAUSTIVE: usize = 6_000;
/// Relative decrease in the score below which the exchange algorithm has converged.
const CONVERGED: f64 = 1e-12;

/// Chosen candidates as a multiset: their indices in ascending order, repeated for repeated trials.
pub(super) type Choice = Vec<usize>;
type State = IterState<Choice, (), (), (), (), f64>;

/// Score for a choice of any number of candidates; lower is better.
pub(super) trait Score: Sync {
    fn score(&self, choice: &[usize]) -> f64;
}

impl<F: Fn(&[usize]) -> f64 + Sync> Score for F {
    fn score(&self, choice: &[usize]) -> f64 {
        self(choice)
    }
}

/// Number of trials to add, number of candidates, and maximum number of repeats of each candidate.
#[derive(Debug, Clone, Copy)]
pub(super) struct DesignSize {
    pub add: usize,
    pub candidates: usize,
    pub repeats: usize,
}

/// Returns the best choice found, and whether the search was exhaustive.
///
/// # Errors
/// Returns an error if there are too few candidates or the search is cancelled.
pub(super) fn find_best(
    score: &impl Score,
    size: DesignSize,
    cancel: &CancelToken,
) -> Result<(Choice, bool), AdviceError> {
    let DesignSize { add, candidates, repeats } = size;
    if candidates * repeats < add {
        return Err(format!(
            "--add: found {add}, but at most {} trials can be added: each of the {candidates} candidates up to \
             {repeats} times (--repeats)",
            candidates * repeats
        )
        .into());
    }
    // Infinite for choices with too many repeats and, so that the search ends, for every choice after cancellation.
    let allowed_score = |choice: &[usize]| {
        let is_allowed =
            choice.iter().all(|one| choice.iter().filter(|other| *other == one).count() <= repeats);
        if !cancel.is_cancelled() && is_allowed { score.score(choice) } else { f64::INFINITY }
    };
    let exchanged = search_by_exchange(&allowed_score, candidates, add);
    if count_choices(candidates, add).is_none_or(|all| all > MAX_EXHAUSTIVE) {
        cancel.check()?;
        return Ok((exchanged, false));
    }
    let best = search_all(&allowed_score, candidates, add).unwrap_or(exchanged);
    cancel.check()?;
    Ok((best, true))
}

/// Returns the number of multisets of `add` among `count` candidates, or `None` if it overflows.
fn count_choices(count: usize, add: usize) -> Option<usize> {
    (0..add).try_fold(1_usize, |all, i| Some(all.checked_mul(count + i)? / (i + 1)))
}

/// Returns the choice with the lowest score by exhaustive search; `None` if there are no candidates.
fn search_all(score: &impl Score, count: usize, add: usize) -> Option<Choice> {
    let all: Vec<Choice> = all_choices(count, add);
    let scores: Vec<f64> = all.par_iter().map(|choice| score.score(choice)).collect();
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

/// Adds the best candidate `add` times (greedy search), and then exchanges single candidates until no exchange lowers
/// the score.
fn search_by_exchange(score: &impl Score, count: usize, add: usize) -> Choice {
    let mut choice = Choice::new();
    for _ in 0..add {
        let (next, _) = best_candidate(score, count, |next| [choice.as_slice(), &[next]].concat());
        choice.push(next);
    }
    let cost = score.score(&choice);
    let result = Executor::new(score, Exchange { count })
        .configure(|state| state.param(choice.clone()).cost(cost).max_iters(100))
        .timer(false)
        .ctrlc(false)
        .run();
    let mut best = result.ok().and_then(|of| of.state.param).unwrap_or(choice);
    best.sort_unstable();
    best
}

/// Returns the candidate for which the choice `with(candidate)` has the lowest score (the first one in a tie), and that
/// score.
fn best_candidate(
    score: &impl Score,
    count: usize,
    with: impl Fn(usize) -> Choice + Sync,
) -> (usize, f64) {
    let scores: Vec<f64> =
        (0..count).into_par_iter().map(|candidate| score.score(&with(candidate))).collect();
    let best = (0..count).min_by(|a, b| scores[*a].total_cmp(&scores[*b])).unwrap_or(0);
    (best, scores.get(best).copied().unwrap_or(f64::NAN))
}

/// Fedorov's exchange algorithm: each iteration makes the exchange that lowers the score most.
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
            return Err(argmin_error!(NotInitialized, "no initial choice"));
        };
        let best = (0..choice.len())
            .map(|index| {
                let with = |next| exchange(&choice, index, next);
                (index, best_candidate(score, self.count, with))
            })
            .min_by(|(_, (_, a)), (_, (_, b))| a.total_cmp(b));
        match best {
            Some((index, (next, cost))) if cost < state.cost - CONVERGED * state.cost.abs() => {
                Ok((state.param(exchange(&choice, index, next)).cost(cost), None))
            }
            _ => {
                let state = state.param(choice);
                Ok((state.terminate_with(TerminationReason::SolverConverged), None))
            }
        }
    }
}

/// Returns a choice in which the candidate at `index` is replaced by `next`.
fn exchange(choice: &[usize], index: usize, next: usize) -> Choice {
    let mut exchanged = choice.to_vec();
    exchanged[index] = next;
    exchanged
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_choices_include_repeats() {
        assert_eq!(all_choices(3, 2), [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]]);
        assert_eq!(count_choices(3, 2), Some(6));
        assert_eq!(count_choices(24, 3), Some(2600));
        assert_eq!(count_choices(1000, 40), None);
    }

    #[test]
    fn exchange_finds_a_pair_that_the_greedy_search_misses() {
        // The best single candidate is 2, the best pair 0 and 4.
        let positions = [0.0_f64, 1.0, 2.1, 3.0, 4.0];
        let score = |choice: &[usize]| -> f64 {
            let nearest =
                |at: f64| choice.iter().map(|of| (positions[*of] - at).abs()).fold(9.0, f64::min);
            nearest(0.0) + nearest(4.0)
        };
        assert_eq!(search_by_exchange(&score, 5, 2), [0, 4]);
        let size = |candidates: usize, repeats: usize| DesignSize { add: 2, candidates, repeats };
        let cancel = CancelToken::default();
        assert_eq!(find_best(&score, size(5, 1), &cancel).ok(), Some((vec![0, 4], true)));
        // The score is lowest if candidate 2 is chosen twice.
        let from_middle =
            |choice: &[usize]| -> f64 { choice.iter().map(|of| of.abs_diff(2) as f64).sum() };
        assert_eq!(find_best(&from_middle, size(5, 2), &cancel).ok(), Some((vec![2, 2], true)));
        assert_eq!(find_best(&from_middle, size(5, 1), &cancel).ok(), Some((vec![1, 2], true)));
        assert!(find_best(&from_middle, size(1, 1), &cancel).is_err());
        cancel.cancel();
        let cancelled = find_best(&from_middle, size(5, 1), &cancel);
        assert!(matches!(cancelled, Err(AdviceError::Cancelled(_))), "{cancelled:?}");
    }
}
