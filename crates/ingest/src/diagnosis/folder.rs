//! What the trials show together: files that stand in the list twice or not at all, and
//! the one reason for which most trials of a campaign need a person.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::Value;
use trilink_base::Named as _;
use trilink_robot::Gait;
use trilink_tables::config::{Campaign, Config};
use trilink_tables::trial::TrialFolder;
use trilink_tables::{CheckRow, Severity, TrialRow, TrialStatus};

use super::campaigns::{fail, find_common_offsets, find_other_campaigns};
use crate::Ingested;
use crate::checks::{Check, Finding};

/// What the trials of all folders are judged by together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FolderInput {
    /// Of every campaign.
    gaits: BTreeMap<String, Gait>,
    /// Marker files that are not in the list, of every folder by its name.
    unlisted: BTreeMap<String, Vec<String>>,
}

impl FolderInput {
    pub fn new(config: &Config, folders: &[TrialFolder]) -> Self {
        let gait = |(name, campaign): (&String, &Campaign)| {
            Some((name.clone(), config.gait.get(&campaign.gait)?.to_gait()))
        };
        let unlisted = |folder: &TrialFolder| (folder.name.clone(), unlisted(folder));
        Self {
            gaits: config.campaign.iter().filter_map(gait).collect(),
            unlisted: folders.iter().map(unlisted).collect(),
        }
    }

    /// Names of the folders in one that was serialised; none if it is another value.
    pub fn folders(serialised: &Value) -> Vec<String> {
        let unlisted = serialised.get("unlisted").and_then(Value::as_object);
        unlisted.into_iter().flat_map(|folders| folders.keys().cloned()).collect()
    }

    /// Adds what the trials show together; `contents` has the hash of each trial's marker file, as
    /// far as it was read.
    pub fn diagnose(&self, rows: &mut Ingested, contents: &BTreeMap<String, String>) {
        find_other_campaigns(rows, &self.gaits);
        find_same_files(rows, contents);
        find_common_offsets(rows, &self.gaits);
        find_common_reasons(rows);
        for (folder, unlisted) in self.unlisted.iter().filter(|(_, names)| !names.is_empty()) {
            let (count, names) = (unlisted.len(), unlisted.join("`, `"));
            let message = format!(
                "{count} marker file{} not in trials.toml: `{names}`; list, remove or name under \
                 ignore = [..] of trials.toml",
                if count == 1 { " is" } else { "s are" }
            );
            let finding = Finding::at_most(Check::Unlisted, count as f64, message);
            rows.checks.push(finding.row(&format!("folder {folder}")));
        }
    }
}

/// Marker files of a folder that are not in its list, in order.
fn unlisted(TrialFolder { path, list, .. }: &TrialFolder) -> Vec<String> {
    let names = trilink_mocap::marker_files(path).unwrap_or_default();
    names.into_iter().filter(|name| list.lacks(name)).collect()
}

/// Fails trials whose marker files have the same content.
fn find_same_files(rows: &mut Ingested, contents: &BTreeMap<String, String>) {
    let Ingested { trials, checks, .. } = rows;
    let mut by_content: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (trial, content) in contents {
        by_content.entry(content).or_default().push(trial);
    }
    for row in trials {
        let same = contents.get(&row.trial).map(|content| &by_content[content.as_str()]);
        let others: Vec<&str> =
            same.into_iter().flatten().copied().filter(|other| *other != row.trial).collect();
        if !others.is_empty() {
            let message = format!(
                "the marker file is that of `{}`, too: correct file in trials.toml, or remove one \
                 of them",
                others.join("`, `")
            );
            fail(row, checks, Check::SameFile, message);
        }
    }
}

/// Says of each campaign for which reason most of its trials need a person.
fn find_common_reasons(rows: &mut Ingested) {
    let mut campaigns: BTreeMap<&str, Vec<&TrialRow>> = BTreeMap::new();
    for row in rows.trials.iter().filter(|row| !row.campaign.is_empty()) {
        campaigns.entry(&row.campaign).or_default().push(row);
    }
    let mut by_trial: BTreeMap<&str, Vec<&CheckRow>> = BTreeMap::new();
    for check in &rows.checks {
        by_trial.entry(&check.trial).or_default().push(check);
    }
    let mut found = Vec::new();
    for (campaign, trials) in campaigns {
        let mut reasons: BTreeMap<(&str, String), Vec<&CheckRow>> = BTreeMap::new();
        for row in &trials {
            let of_trial = by_trial.get(row.trial.as_str()).into_iter().flatten().copied();
            let worst = of_trial.clone().map(|check| check.severity).max();
            let is_reason = |check: &&CheckRow| {
                Some(check.severity) == worst && check.severity > Severity::Info
            };
            // A trial fails for one of its checks, or for what it says itself.
            let failed = Check::Failed.to_string();
            let mut reasons_of: Vec<&CheckRow> = of_trial.filter(is_reason).collect();
            if reasons_of.iter().any(|check| check.check != failed) {
                reasons_of.retain(|check| check.check != failed);
            }
            for check in reasons_of {
                let reason = (check.check.as_str(), without_numbers(said(check)));
                reasons.entry(reason).or_default().push(check);
            }
        }
        for checks in reasons.into_values().filter(|checks| 2 * checks.len() > trials.len()) {
            if checks.len() < 2 {
                continue;
            }
            let (count, all) = (checks.len() as f64, trials.len() as f64);
            let message = format!("{count} of {all} trials: {}", said(checks[0]));
            let finding = Finding::new(Check::CommonReason, false, count, all, message);
            found.push(finding.row(&format!("campaign {campaign}")));
        }
    }
    rows.checks.extend(found);
}

/// A check's message without the name of the marker file.
fn said(check: &CheckRow) -> &str {
    let message = check.message.as_str();
    let file = [".csv: ", ".c3d: ", ".gz: "].into_iter().find_map(|end| message.split_once(end));
    match file {
        Some((file, rest)) if file.contains(['/', '\\']) || !file.contains(' ') => rest,
        _ => message,
    }
}

fn without_numbers(text: &str) -> String {
    text.chars().filter(|c| !c.is_ascii_digit() && !"+-.".contains(*c)).collect()
}

impl Ingested {
    /// What the trials show together: the checks of a campaign or of a folder.
    pub fn together(&self) -> impl Iterator<Item = &CheckRow> {
        let names = [Check::CommonReason, Check::Unlisted].map(|check| check.to_string());
        self.checks.iter().filter(move |row| names.contains(&row.check))
    }

    /// Whether a trial failed, or the trials together show a mistake.
    pub fn needs_a_person(&self) -> bool {
        let is_failed = |trial: &TrialRow| trial.status == TrialStatus::Failed;
        self.trials.iter().any(is_failed) || self.together().next().is_some()
    }
}

/// The rows of a trial as they were before [`FolderInput::diagnose`].
pub fn undiagnosed(mut rows: Ingested) -> Ingested {
    let is_of_several =
        |row: &CheckRow| Check::of_name(&row.check).is_some_and(Check::is_of_several);
    let before = rows.checks.len();
    rows.checks.retain(|row| !is_of_several(row));
    if rows.checks.len() < before {
        for row in &mut rows.trials {
            let found = rows.checks.iter().filter(|check| check.severity > Severity::Info);
            let messages: Vec<&str> = found.clone().map(|check| check.message.as_str()).collect();
            row.message = messages.join("; ");
            row.status = match found.map(|check| check.severity).max() {
                Some(Severity::Error) => TrialStatus::Failed,
                Some(_) => TrialStatus::Flagged,
                None => TrialStatus::Ok,
            };
        }
    }
    rows
}
