//! Uncertainty of the optima of a fitted model.

use serde_json::json;
use trilink_base::cancel::{CancelToken, Cancelled};
use trilink_fit::optimise::{Search, SearchResult, Uncertainty};
use trilink_fit::simulate::{KnownFits, Setup};
use trilink_tables::{NoInterval, NoIntervalReason, OptimumRow};

use crate::cli::Failure;
use crate::cli::output::write_text;
use crate::cli::table::short;

/// Default maximum number of bootstrap replicates for which the search is repeated.
const MAX_REPLICATES: usize = 200;

/// Estimates the uncertainty of the optima from at most `max_replicates` (by default, [`MAX_REPLICATES`]) bootstrap
/// replicates of the fit, or returns the reason why there is no estimate.
///
/// # Errors
/// Returns an error if the command was cancelled.
pub(super) fn estimate(
    setup: &Setup,
    fits: Option<&KnownFits>,
    max_replicates: Option<usize>,
    (search, found): (&Search, &SearchResult),
    cancel: &CancelToken,
) -> Result<Result<Uncertainty, NoInterval>, Cancelled> {
    let max_replicates = max_replicates.unwrap_or(MAX_REPLICATES);
    let alternatives = match fits {
        None => Err(NoIntervalReason::NotFitted.into()),
        Some(_) if max_replicates == 0 => Err(NoIntervalReason::NoReplicates.into()),
        Some(fits) => setup.alternatives(fits, max_replicates),
    };
    Ok(match alternatives {
        Err(why) => Err(why),
        Ok(alternatives) => Uncertainty::new(search, &found.optima, &alternatives, cancel)?
            .ok_or_else(|| NoIntervalReason::NoOptimum.into()),
    })
}

/// Adds to `rows` the uncertainty of the optima or, if it was not estimated, the reason.
pub(super) fn fill_in(
    rows: &mut [OptimumRow],
    certainty: &Result<Uncertainty, NoInterval>,
    search: &Search,
) {
    match certainty {
        Ok(certainty) => certainty.fill(rows, &search.problem.robot),
        Err(why) => rows.iter_mut().for_each(|row| row.no_interval = Some(why.clone())),
    }
}

/// Prints the confidence intervals and, for each optimum, the number of replicates in which it is the best.
pub(super) fn print(search: &Search, certainty: &Uncertainty) -> Result<(), Failure> {
    let Uncertainty { replicates, without, value, commands, best_in, another, .. } = certainty;
    let Search { objective, problem, .. } = search;
    let mut intervals = vec![interval(objective.name(), *value, objective.unit())];
    intervals.extend(commands.iter().map(|(command, limits)| {
        let (unit, scale) = command.unit().shown();
        interval(&command.name(&problem.robot), limits.map(|limit| scale * limit), unit)
    }));
    let counted = best_in.iter().enumerate().filter(|(_, count)| **count > 0);
    let mut best: Vec<String> =
        counted.map(|(nth, count)| format!("gait {} in {count}", nth + 1)).collect();
    for (name, count) in [("another gait", another), ("no gait", without)] {
        if *count > 0 {
            best.push(format!("{name} in {count}"));
        }
    }
    let text = json!({
        "replicates": replicates,
        "limits": intervals,
        "best": best,
        "regret": certainty.regret.map(|loss| short(100.0 * loss)),
        "not_reached": certainty.not_reached,
        "over_limit": certainty.over_limit,
    });
    write_text(include_str!("../text/certainty.txt"), &text)
}

/// Formats the limits of a confidence interval.
fn interval(name: &str, [low, high]: [f64; 2], unit: &str) -> String {
    format!("{name} {} to {} {unit}", short(low), short(high))
}
