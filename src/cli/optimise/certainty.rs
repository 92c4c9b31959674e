//! How sure the optima of a fitted model are.

use serde_json::json;
use trilink_base::cancel::Cancelled;
use trilink_fit::optimise::{Certainty, Command, Found, Search};
use trilink_fit::simulate::{KnownFits, Setup};
use trilink_tables::{NoInterval, NoIntervalReason, Objective, OptimumRow};

use crate::cli::Failure;
use crate::cli::output::write_text;
use crate::cli::table::short;
use crate::interrupt;

/// Replicates that are searched where none are named.
const MOST: usize = 200;

/// How sure what was found is, by so many replicates of the fit at most, or why that is not known.
///
/// # Errors
/// The command was cancelled.
pub(super) fn of(
    setup: &Setup,
    fits: Option<&KnownFits>,
    most: Option<usize>,
    (search, found): (&Search, &Found),
) -> Result<Result<Certainty, NoInterval>, Cancelled> {
    let most = most.unwrap_or(MOST);
    let alternatives = match fits {
        None => Err(NoIntervalReason::NotFitted.into()),
        Some(_) if most == 0 => Err(NoIntervalReason::NoReplicates.into()),
        Some(fits) => setup.alternatives(fits, most),
    };
    Ok(match alternatives {
        Err(why) => Err(why),
        Ok(alternatives) => {
            Certainty::new(search, &found.optima, &alternatives, interrupt::token())?
                .ok_or_else(|| NoIntervalReason::NoOptimum.into())
        }
    })
}

/// Fills in what the rows say of it.
pub(super) fn fill_in(rows: &mut [OptimumRow], certainty: &Result<Certainty, NoInterval>) {
    match certainty {
        Ok(certainty) => certainty.fill(rows),
        Err(why) => rows.iter_mut().for_each(|row| row.no_interval = Some(why.clone())),
    }
}

/// Says it in lines.
pub(super) fn print(objective: Objective, certainty: &Certainty) -> Result<(), Failure> {
    let Certainty { replicates, without, value, commands, best_in, another, .. } = certainty;
    let limits = |name: &str, [low, high]: [f64; 2], unit: &str| {
        format!("{name} {} to {} {unit}", short(low), short(high))
    };
    let of_command = |(command, limits_of): &(Command, [f64; 2])| match command {
        Command::Omega => limits("omega", *limits_of, "rad/s"),
        Command::Joint(..) => {
            limits(&command.to_string(), limits_of.map(f64::to_degrees), "degrees")
        }
    };
    let mut parts = vec![limits(objective.name(), *value, objective.unit())];
    parts.extend(commands.iter().map(of_command));
    let counted = best_in.iter().enumerate().filter(|(_, count)| **count > 0);
    let mut best: Vec<String> =
        counted.map(|(nth, count)| format!("{} in {count}", nth + 1)).collect();
    for (name, count) in [("another", another), ("none", without)] {
        if *count > 0 {
            best.push(format!("{name} in {count}"));
        }
    }
    let text = json!({
        "replicates": replicates,
        "limits": parts,
        "best": best,
        "regret": certainty.regret.map(|part| short(100.0 * part)),
        "not_reached": certainty.not_reached,
        "over_limit": certainty.over_limit,
    });
    write_text(include_str!("../text/certainty.txt"), &text)
}
