//! Trials that need attention, grouped by folder and cause.

use std::collections::HashMap;
use std::fmt;

use serde::Serialize;

use crate::{CheckRow, TrialRow, TrialStatus};

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
        let found = trials.iter().filter(|row| row.status == status);
        Self::group(trials, found.map(|row| (row, row.message.as_str())))
    }

    /// Groups the findings of one check, in the order of the first trial of each group; leaves out findings that do not
    /// concern a single trial.
    pub fn of_check(
        trials: &'r [TrialRow],
        findings: impl IntoIterator<Item = &'r CheckRow>,
    ) -> Vec<Self> {
        let by_name: HashMap<&str, &TrialRow> =
            trials.iter().map(|row| (row.trial.as_str(), row)).collect();
        let found = findings.into_iter().filter_map(|check| {
            Some((*by_name.get(check.trial.as_str())?, check.message.as_str()))
        });
        Self::group(trials, found)
    }

    /// Groups messages about trials by folder and cause.
    fn group(
        trials: &'r [TrialRow],
        found: impl Iterator<Item = (&'r TrialRow, &'r str)>,
    ) -> Vec<Self> {
        let mut groups: Vec<(String, Vec<(&TrialRow, &str)>)> = Vec::new();
        for (row, message) in found {
            let reason = without_numbers(&without_files(message, &row.file));
            let same = |(other, group): &&mut (String, Vec<(&TrialRow, &str)>)| {
                *other == reason && group[0].0.folder == row.folder
            };
            match groups.iter_mut().find(same) {
                Some((_, group)) => group.push((row, message)),
                None => groups.push((reason, vec![(row, message)])),
            }
        }
        let causes = groups.iter().map(|(_, group)| {
            let (TrialRow { folder, file, status, .. }, message) = group[0];
            Self {
                status: *status,
                folder,
                trials: group.iter().map(|(row, _)| row.trial.as_str()).collect(),
                of: trials.iter().filter(|other| other.folder == *folder).count(),
                message: match group.len() {
                    1 => message.to_owned(),
                    _ => without_files(message, file),
                },
            }
        });
        causes.collect()
    }
}

impl fmt::Display for CommonCause<'_> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { folder, trials, of, message, .. } = self;
        match trials[..] {
            [trial] => write!(f, "{trial}: {message}"),
            _ if trials.len() == *of => write!(f, "{folder}: all {of} trials: {message}"),
            _ => write!(f, "{folder}: {} of {of} trials: {message}", trials.len()),
        }
    }
}

/// Returns the messages of several checks, joined by semicolons, without the path of the marker `file`.
fn without_files(messages: &str, file: &str) -> String {
    messages.split("; ").map(|message| without_file(message, file)).collect::<Vec<_>>().join("; ")
}

/// Returns a message about a trial without the path of its marker `file`, with which it may begin.
pub fn without_file<'m>(message: &'m str, file: &str) -> &'m str {
    if file.is_empty() {
        return message;
    }
    message.split_once(&format!("{file}: ")).map_or(message, |(_, rest)| rest)
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
        let file = format!("{trial}.csv");
        let [folder, trial, message] = [folder, trial, message].map(str::to_owned);
        TrialRow { folder, trial, file, message, status: TrialStatus::Failed, ..TrialRow::blank() }
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
                "raw/a: 2 of 3 trials: wrong gait; no marker `M3`, 12 found",
                "3: wrong gait; raw/a/3.csv: no marker `M4`, 12 found",
                "raw/b: all 2 trials: wrong gait; no marker `M3`, 12 found",
            ]
        );
        assert!(CommonCause::find(&rows, TrialStatus::Flagged).is_empty());
    }
}
