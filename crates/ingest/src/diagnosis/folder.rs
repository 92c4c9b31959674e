//! Compares all trials to find marker files that are listed twice or not at all, trials that are unlike their repeats,
//! and campaigns of which most trials need attention for the same reason.

use std::collections::{BTreeMap, BTreeSet};

use serde::Serialize;
use serde_json::Value;
use trilink_base::Named as _;
use trilink_robot::JointCommand;
use trilink_tables::config::{Config, GaitConfig};
use trilink_tables::trial::{ListedTrial, Trial, TrialFolder, TrialFolders, TrialKind};
use trilink_tables::{CheckRow, Severity, TrialRow, TrialStatus, UnlikeRepeats, without_file};

use super::campaigns::{add, fail, find_common_offsets, find_other_campaigns};
use super::heading::flag_slopes;
use crate::Ingested;
use crate::checks::{Check, Finding};
use crate::cycles::summary::blank_row;
use crate::identification::floor::{estimate_slopes, forget_slopes};

/// Configuration and trial lists with which the trials of all folders are compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FolderInput {
    /// Commanded gait of every campaign.
    gaits: BTreeMap<String, CampaignGait>,
    /// Marker files that are missing from the trial list, by folder name.
    unlisted: BTreeMap<String, Vec<String>>,
    /// Number of trials in each folder that had tables but is gone, by folder name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    gone: BTreeMap<String, usize>,
    /// Trials with marker files to be ignored.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ignored: Vec<IgnoredTrial>,
    /// Configured roll resistances of every robot, kg/s.
    roll_kg_s: BTreeMap<String, Vec<f64>>,
}

/// Commanded gait of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct CampaignGait {
    /// Commands of the joints from front to rear; `None` for a joint that is not commanded.
    pub joints: Vec<Option<JointCommand>>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub is_of_chain: bool,
}

/// Trial with a marker file to be ignored.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct IgnoredTrial {
    folder: String,
    id: String,
    trial: Trial,
}

impl FolderInput {
    pub fn new(config: &Config, TrialFolders { folders, ignored, .. }: &TrialFolders) -> Self {
        let gaits = config.campaign.keys().filter_map(|name| {
            let (robot, gait) = config.setup(name)?;
            let joints = gait.joints[..robot.joints()].to_vec();
            Some((name.clone(), CampaignGait { joints, is_of_chain: robot.as_chain().is_some() }))
        });
        let unlisted = folders.iter().map(|folder| (folder.name.clone(), unlisted_files(folder)));
        let roll_kg_s = config.robot.iter().map(|(name, robot)| {
            (name.clone(), robot.to_robot(&GaitConfig::default()).roll_kg_s())
        });
        let ignored = ignored.iter().map(|ListedTrial { folder, id, trial }| IgnoredTrial {
            folder: folders[*folder].name.clone(),
            id: id.clone(),
            trial: trial.clone(),
        });
        Self {
            gaits: gaits.collect(),
            unlisted: unlisted.collect(),
            gone: BTreeMap::new(),
            ignored: ignored.collect(),
            roll_kg_s: roll_kg_s.collect(),
        }
    }

    /// Adds folders that had tables but are gone, with the number of trials in each.
    pub fn with_gone(self, gone: BTreeMap<String, usize>) -> Self {
        Self { gone, ..self }
    }

    /// Returns the names of the folders in a serialised [`FolderInput`]; none if the value is not one.
    pub fn folders(serialised: &Value) -> BTreeSet<String> {
        let folders =
            ["unlisted", "gone"].into_iter().filter_map(|key| serialised[key].as_object());
        folders.flat_map(|folders| folders.keys().cloned()).collect()
    }

    /// Returns the folders of a serialised [`FolderInput`] that are gone, with the number of trials in each.
    pub fn gone(serialised: &Value) -> BTreeMap<String, usize> {
        serde_json::from_value(serialised["gone"].clone()).unwrap_or_default()
    }

    /// Adds the findings that concern several trials, and a row for each ignored trial. `contents` has the hash of each trial's marker file if the file
    /// was read.
    pub fn diagnose(&self, rows: &mut Ingested, contents: &BTreeMap<String, String>) {
        find_other_campaigns(rows, &self.gaits);
        find_same_files(rows, contents);
        find_common_offsets(rows, &self.gaits);
        find_unlike_repeats(rows);
        estimate_slopes(rows, &self.roll_kg_s);
        flag_slopes(rows);
        find_common_reasons(rows);
        for (folder, unlisted) in self.unlisted.iter().filter(|(_, names)| !names.is_empty()) {
            let count = unlisted.len();
            let names = unlisted.join("`, `");
            let message = format!(
                "{count} marker file{} not listed in trials.toml: `{names}`; list such files in trials.toml, name \
                 them under its key `ignore = [..]`, or remove them",
                if count == 1 { " is" } else { "s are" }
            );
            let finding = Finding::at_most(Check::Unlisted, count as f64, message);
            rows.checks.push(finding.row(&format!("folder {folder}")));
        }
        for (folder, count) in &self.gone {
            let count = *count as f64;
            let message = format!(
                "this folder is gone, and its {count} trials are no longer in the tables: restore it, or remove it \
                 from the configuration and run once with --only"
            );
            let finding = Finding::new(Check::FolderGone, false, count, 0.0, message);
            rows.checks.push(finding.row(&format!("folder {folder}")));
        }
        rows.trials.extend(self.ignored.iter().map(|IgnoredTrial { folder, id, trial }| {
            TrialRow {
                folder: folder.clone(),
                id: id.clone(),
                status: TrialStatus::Ignored,
                message: format!("`ignore` in trials.toml matches {}", trial.file),
                ..blank_row(trial)
            }
        }));
    }
}

/// Returns the marker files of a folder that are missing from its trial list, sorted.
fn unlisted_files(TrialFolder { path, list, .. }: &TrialFolder) -> Vec<String> {
    let names = trilink_mocap::marker_files(path).unwrap_or_default();
    names.into_iter().filter(|name| list.lacks(name)).collect()
}

/// Fails trials whose marker files have identical content. In a copy of a folder, whose trials have the ids and entries
/// of the original, only the copies fail; the folder that is first by name counts as the original.
fn find_same_files(rows: &mut Ingested, contents: &BTreeMap<String, String>) {
    let Ingested { trials, checks, .. } = rows;
    let mut by_content: BTreeMap<&str, Vec<&TrialRow>> = BTreeMap::new();
    for row in trials.iter() {
        if let Some(content) = contents.get(&row.trial) {
            by_content.entry(content).or_default().push(row);
        }
    }
    let messages = trials.iter().map(|row| {
        let content = contents.get(&row.trial)?;
        same_file_message(row, &by_content[content.as_str()])
    });
    let messages: Vec<Option<String>> = messages.collect();
    for (row, message) in trials.iter_mut().zip(messages) {
        if let Some(message) = message {
            fail(row, checks, Check::SameFile, message);
        }
    }
}

/// Returns why a trial fails, given all trials with the content of its marker file; `None` if it does not.
fn same_file_message(row: &TrialRow, same: &[&TrialRow]) -> Option<String> {
    let others: Vec<&TrialRow> =
        same.iter().copied().filter(|other| other.trial != row.trial).collect();
    let is_copied =
        others.iter().all(|other| other.folder != row.folder && entry_of(other) == entry_of(row));
    if is_copied {
        let original = same.iter().min_by_key(|other| &other.folder)?;
        return (original.trial != row.trial).then(|| {
            format!(
                "copy of the trial with this id in folder {}: remove one of the two folders",
                original.folder
            )
        });
    }
    let others: Vec<&str> = others.iter().map(|other| other.trial.as_str()).collect();
    Some(format!(
        "trial `{}` has the same marker file: correct `file` in trials.toml, or remove all but one of these trials",
        others.join("`, `")
    ))
}

/// Returns what the list of trials says about a trial, apart from its day.
fn entry_of(row: &TrialRow) -> (&str, &str, &str, TrialKind, u64) {
    let TrialRow { id, file, campaign, kind, omega_commanded_rad_s, .. } = row;
    (id, file, campaign, *kind, omega_commanded_rad_s.to_bits())
}

/// Flags trials that are unlike their repeats.
fn find_unlike_repeats(rows: &mut Ingested) {
    for found in UnlikeRepeats::find(&rows.trials) {
        let row = &mut rows.trials[found.index];
        let value = row.metrics[found.metric];
        let message = format!(
            "{} is {value:.4}, but the median of the {} trials at {:.2} rad/s on this day is {:.4}, {:.1} robust \
             standard deviations away: was the floor, a wheel or the load different? The fits leave this trial \
             out",
            found.metric.column(),
            found.trials,
            row.frequency_rad_s(),
            found.median,
            found.deviations,
        );
        if row.status == TrialStatus::Ok {
            row.status = TrialStatus::Flagged;
        }
        let finding = Finding::at_most(Check::UnlikeRepeats, found.deviations, message);
        add(row, &mut rows.checks, finding);
    }
}

/// Adds a finding for each campaign of which most trials need attention for the same reason.
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
        // Messages of the trials' worst checks, by check and reason.
        let mut reasons: BTreeMap<(&str, String), Vec<&str>> = BTreeMap::new();
        for row in &trials {
            let of_trial = by_trial.get(row.trial.as_str()).into_iter().flatten().copied();
            let worst = of_trial.clone().map(|check| check.severity).max();
            // A trial fails because of its checks, or because it cannot be processed.
            let failed = Check::Failed.to_string();
            let mut worst_checks: Vec<&CheckRow> = of_trial
                .filter(|check| Some(check.severity) == worst && check.severity > Severity::Info)
                .collect();
            if worst_checks.iter().any(|check| check.check != failed) {
                worst_checks.retain(|check| check.check != failed);
            }
            for check in worst_checks {
                let message = without_file(&check.message, &row.file);
                let reason = (check.check.as_str(), without_numbers(message));
                reasons.entry(reason).or_default().push(message);
            }
        }
        for messages in reasons.into_values().filter(|of| 2 * of.len() > trials.len()) {
            if messages.len() < 2 {
                continue;
            }
            let count = messages.len() as f64;
            let all = trials.len() as f64;
            let message = format!("{count} of {all} trials: {}", messages[0]);
            let finding = Finding::new(Check::CommonReason, false, count, all, message);
            found.push(finding.row(&format!("campaign {campaign}")));
        }
    }
    rows.checks.extend(found);
}

/// Removes all numbers from a message.
fn without_numbers(text: &str) -> String {
    text.chars().filter(|c| !c.is_ascii_digit() && !"+-.".contains(*c)).collect()
}

impl Ingested {
    /// Iterates over the findings that concern a whole campaign or folder.
    pub fn together(&self) -> impl Iterator<Item = &CheckRow> {
        let names = [Check::CommonReason, Check::Unlisted, Check::FolderGone]
            .map(|check| check.to_string());
        self.checks.iter().filter(move |row| names.contains(&row.check))
    }

    /// Returns whether someone has to look at the results, because a trial failed or the trials together show a
    /// mistake.
    pub fn needs_a_person(&self) -> bool {
        let is_failed = |trial: &TrialRow| trial.status == TrialStatus::Failed;
        self.trials.iter().any(is_failed) || self.together().next().is_some()
    }
}

/// Returns the rows without the effects of [`FolderInput::diagnose`].
pub fn without_diagnosis(mut rows: Ingested) -> Ingested {
    let before = rows.checks.len();
    rows.checks.retain(|row| !Check::of_name(&row.check).is_some_and(Check::compares_trials));
    if rows.checks.len() < before {
        rows.trials.iter_mut().for_each(|row| restate(row, &rows.checks));
    }
    forget_slopes(&mut rows);
    rows
}

/// Sets the status and the message of a trial to those that follow from its own checks among `checks`.
pub(crate) fn restate(row: &mut TrialRow, checks: &[CheckRow]) {
    let found =
        checks.iter().filter(|check| check.trial == row.trial && check.severity > Severity::Info);
    let messages: Vec<&str> = found.clone().map(|check| check.message.as_str()).collect();
    row.message = messages.join("; ");
    row.status = match found.map(|check| check.severity).max() {
        Some(Severity::Error) => TrialStatus::Failed,
        Some(_) => TrialStatus::Flagged,
        None => TrialStatus::Ok,
    };
}

#[cfg(test)]
mod tests {
    use trilink_robot::metrics::GaitMetrics;
    use trilink_tables::Columns as _;

    use super::*;

    #[test]
    fn a_trial_unlike_its_repeats_is_flagged_until_it_is_like_them() {
        let trial = |index: u8| TrialRow {
            trial: format!("{index}"),
            status: TrialStatus::Ok,
            omega_commanded_rad_s: f64::from(index / 3),
            metrics: GaitMetrics {
                d_m: 0.1 + 1e-3 * (7.7 * f64::from(index)).sin(),
                ..GaitMetrics::MISSING
            },
            ..TrialRow::blank()
        };
        let trials = (3..21).map(trial).collect();
        let mut rows = Ingested { trials, ..Ingested::default() };
        find_unlike_repeats(&mut rows);
        assert!(rows.checks.is_empty());
        rows.trials[4].metrics.d_m *= 1.4;
        let before = format!("{rows:?}");
        find_unlike_repeats(&mut rows);
        let flagged = rows.trials.iter().filter(|row| row.status == TrialStatus::Flagged);
        let flagged: Vec<&TrialRow> = flagged.collect();
        let [flagged] = flagged.as_slice() else { panic!("{flagged:?}") };
        let start = "d_m is 0.13";
        assert!(flagged.trial == "7" && flagged.message.starts_with(start), "{flagged:?}");
        assert!(flagged.message.contains("the median of the 3 trials at 2.00 rad/s"));
        assert_eq!(rows.checks.len(), 1);
        assert_eq!(format!("{:?}", without_diagnosis(rows)), before);
    }
}
