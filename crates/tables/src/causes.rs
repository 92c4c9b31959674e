//! Trials that need attention, grouped by folder and cause.

use std::fmt;

use serde::Serialize;

use crate::{TrialRow, TrialStatus};

/// Trials of one folder that need attention for the same reason.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CommonCause<'r> {
    pub status: TrialStatus,
    pub folder: &'r str,
    /// Names of the trials.
    pub trials: Vec<&'r str>,
    /// Number of all trials in the folder.
    pub of: usize,
    /// Message of the first of the trials; without the name of its marker file if there are several trials.
    pub message: String,
}

impl<'r> CommonCause<'r> {
    /// Groups the trials with a status, in the order of the first trial of each group.
    pub fn find(trials: &'r [TrialRow], status: TrialStatus) -> Vec<Self> {
        let mut causes: Vec<(String, Self)> = Vec::new();
        for row in trials.iter().filter(|row| row.status == status) {
            let reason = without_numbers(&without_files(&row.message));
            let same = |(other, cause): &&mut (String, Self)| {
                *other == reason && cause.folder == row.folder
            };
            if let Some((_, cause)) = causes.iter_mut().find(same) {
                cause.trials.push(&row.trial);
                cause.message = without_files(&cause.message);
            } else {
                let of = trials.iter().filter(|other| other.folder == row.folder).count();
                let TrialRow { folder, trial, message, .. } = row;
                let message = message.clone();
                causes.push((reason, Self { status, folder, trials: vec![trial], of, message }));
            }
        }
        causes.into_iter().map(|(_, cause)| cause).collect()
    }
}

impl fmt::Display for CommonCause<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { status, folder, trials, of, message } = self;
        match trials[..] {
            [trial] => write!(f, "{status}: {trial}: {message}"),
            _ if trials.len() == *of => write!(f, "{status}: {folder}: all {of} trials: {message}"),
            _ => write!(f, "{status}: {folder}: {} of {of} trials: {message}", trials.len()),
        }
    }
}

/// Returns the messages of several checks, joined by semicolons, without the name of the marker file.
fn without_files(messages: &str) -> String {
    messages.split("; ").map(without_file).collect::<Vec<_>>().join("; ")
}

/// Returns a message about a trial without the name of the marker file.
pub fn without_file(message: &str) -> &str {
    let endings = [".csv: ", ".tsv: ", ".trc: ", ".c3d: ", ".gz: "];
    let file = endings.into_iter().find_map(|end| message.split_once(end));
    match file {
        Some((file, rest)) if file.contains(['/', '\\']) || !file.contains(' ') => rest,
        _ => message,
    }
}

/// Removes all numbers that are not part of a quoted name from a message.
fn without_numbers(message: &str) -> String {
    let mut is_name = false;
    let mut kept = String::new();
    for c in message.chars() {
        is_name ^= c == '`';
        if is_name || !(c.is_ascii_digit() || "+-.".contains(c)) {
            kept.push(c);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Columns as _;

    fn failed(folder: &str, trial: &str, message: &str) -> TrialRow {
        let [folder, trial, message] = [folder, trial, message].map(str::to_owned);
        TrialRow { folder, trial, message, status: TrialStatus::Failed, ..TrialRow::blank() }
    }

    #[test]
    fn causes_are_told_apart_by_folder_and_names_but_not_by_files_and_numbers() {
        let rows = [
            failed("raw/a", "1", "wrong gait; raw/a/1.csv: no marker `M3`, 12 found"),
            failed("raw/a", "2", "wrong gait; raw/a/2.csv: no marker `M3`, 13 found"),
            failed("raw/a", "3", "wrong gait; raw/a/3.csv: no marker `M4`, 12 found"),
            failed("raw/b", "4", "wrong gait; raw/b/4.csv: no marker `M3`, 12 found"),
            failed("raw/b", "5", "wrong gait; raw/b/5.csv: no marker `M3`, 1.5 found"),
        ];
        let causes = CommonCause::find(&rows, TrialStatus::Failed);
        let lines: Vec<String> = causes.iter().map(CommonCause::to_string).collect();
        assert_eq!(
            lines,
            [
                "failed: raw/a: 2 of 3 trials: wrong gait; no marker `M3`, 12 found",
                "failed: 3: wrong gait; raw/a/3.csv: no marker `M4`, 12 found",
                "failed: raw/b: all 2 trials: wrong gait; no marker `M3`, 12 found",
            ]
        );
        assert!(CommonCause::find(&rows, TrialStatus::Flagged).is_empty());
    }
}
