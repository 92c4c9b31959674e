//! What the page says first: trials and checks that need a person.

use std::collections::BTreeSet;

use serde::Serialize;

use super::tables::Tables;
use crate::store::{CheckRow, Severity, TrialStatus};

/// A trial that needs a person.
#[derive(Serialize)]
pub struct Trouble<'p> {
    pub trial: &'p str,
    pub status: TrialStatus,
    pub messages: Vec<&'p str>,
}

/// Whether a check found more than what is only worth knowing.
fn needs_a_look(check: &CheckRow) -> bool {
    check.severity > Severity::Info
}

/// Failed trials first.
pub fn troubled(tables: &Tables) -> Vec<Trouble<'_>> {
    let with = |status| {
        tables.trials.iter().filter(move |row| row.status == status).map(|row| {
            let checks = tables.checks.iter().filter(|check| check.trial == row.trial);
            let mut messages: Vec<&str> = checks
                .filter(|check| needs_a_look(check) && !check.message.is_empty())
                .map(|check| check.message.as_str())
                .collect();
            // A trial's message may be the checks' messages in one line.
            let said = messages.iter().any(|message| row.message.contains(message));
            if !row.message.is_empty() {
                if said {
                    messages.clear();
                }
                messages.insert(0, &row.message);
            }
            Trouble { trial: &row.trial, status: row.status, messages }
        })
    };
    with(TrialStatus::Failed).chain(with(TrialStatus::Flagged)).collect()
}

/// What is wrong with a campaign or with the folder as a whole: checks of what is no trial.
pub fn common(tables: &Tables) -> Vec<&CheckRow> {
    let trials: BTreeSet<&str> = tables.trials.iter().map(|row| row.trial.as_str()).collect();
    let checks = tables.checks.iter().filter(|check| needs_a_look(check));
    checks.filter(|check| !trials.contains(check.trial.as_str())).collect()
}

/// What was fitted instead of what is missing, by campaign.
pub fn fit_notes(tables: &Tables) -> BTreeSet<(&str, &str)> {
    let notes = tables.fits.iter().map(|fit| (fit.campaign.as_str(), fit.notes.as_str()));
    notes.filter(|(_, note)| !note.is_empty()).collect()
}
