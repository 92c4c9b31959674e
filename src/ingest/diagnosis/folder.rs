//! What the trials of a folder show together: files that stand in the list twice or not at all,
//! trials of another campaign, and the one reason for which most trials of a campaign need a person.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::gait::off_deg;
use crate::config::{Config, GaitConfig};
use crate::ingest::Ingested;
use crate::ingest::checks::{Check, Finding, GAIT_TOLERANCE_DEG};
use crate::pattern::matches_label;
use crate::stats::{extremes, mean};
use crate::store::{CheckRow, Severity, TrialRow, TrialStatus};
use crate::trial::{TrialKind, TrialList};

/// A gait that the joints follow this well is theirs, degrees.
const FOLLOWED_DEG: f64 = 4.0;
/// Joints whose offsets are off by more than this in all trials are off for one reason, degrees.
const BENT_ALIKE_DEG: f64 = 3.0;
/// Names of marker files end like this, packed or not.
const MARKER_FILES: [&str; 2] = [".csv", ".c3d"];

/// What the trials of a folder are judged by together.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FolderInput {
    /// Of every campaign.
    gaits: BTreeMap<String, GaitConfig>,
    /// Marker files that are not in the list.
    unlisted: Vec<String>,
}

impl FolderInput {
    pub fn new(config: &Config, folder: &Path, list: &TrialList) -> Self {
        let gait = |(name, campaign): (&String, &crate::config::Campaign)| {
            Some((name.clone(), config.gait.get(&campaign.gait)?.clone()))
        };
        let is_listed = |name: &str| {
            list.trial.iter().any(|trial| trial.file == name)
                || list.ignore.iter().any(|pattern| matches_label(pattern, name))
        };
        let is_marker_file = |name: &String| {
            let plain = name.to_ascii_lowercase();
            let plain = plain.strip_suffix(".gz").unwrap_or(&plain);
            MARKER_FILES.iter().any(|end| plain.ends_with(end)) && !name.starts_with('.')
        };
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
        let mut unlisted: Vec<String> =
            names.filter(|name| is_marker_file(name) && !is_listed(name)).collect();
        unlisted.sort();
        Self { gaits: config.campaign.iter().filter_map(gait).collect(), unlisted }
    }

    /// Adds what the trials show together; `contents` has the hash of each trial's marker file, as
    /// far as it was read.
    pub fn diagnose(&self, rows: &mut Ingested, contents: &BTreeMap<String, String>) {
        self.find_other_campaigns(rows);
        find_same_files(rows, contents);
        self.find_common_offsets(rows);
        find_common_reasons(rows);
        if !self.unlisted.is_empty() {
            let (count, names) = (self.unlisted.len(), self.unlisted.join("`, `"));
            let message = format!(
                "{count} marker file{} not in trials.toml: `{names}`; list, remove or name under \
                 ignore = [..] of trials.toml",
                if count == 1 { " is" } else { "s are" }
            );
            let finding = Finding::at_most(Check::Unlisted, count as f64, 0.0, message);
            rows.checks.push(finding.failing().row("folder"));
        }
    }

    fn find_other_campaigns(&self, rows: &mut Ingested) {
        let Ingested { trials, checks, .. } = rows;
        for row in trials.iter_mut().filter(|row| row.kind == TrialKind::Gait) {
            let Some(own) = self.gaits.get(&row.campaign).map(GaitConfig::to_gait) else {
                continue;
            };
            let measured = row.gait.map(|joint| joint.command());
            let commanded = |gait: &crate::robot::Gait| gait.joints.iter().flatten().count();
            // A passive joint may do by chance what another campaign commands.
            if off_deg(measured, &own) <= GAIT_TOLERANCE_DEG {
                continue;
            }
            let follows =
                |(_, gait): &(&String, crate::robot::Gait)| off_deg(measured, gait) <= FOLLOWED_DEG;
            let all = self.gaits.iter().map(|(name, gait)| (name, gait.to_gait()));
            let followed: Vec<_> = all.filter(follows).collect();
            let most = followed.iter().map(|(_, gait)| commanded(gait)).max().unwrap_or(0);
            let names: Vec<&str> = followed
                .iter()
                .filter(|(_, gait)| commanded(gait) == most)
                .map(|(name, _)| name.as_str())
                .collect();
            if names.is_empty() || row.gait.iter().any(|joint| joint.offset_rad.is_nan()) {
                continue;
            }
            let message = format!(
                "the joints do what campaign `{}` commands, not `{}`: is campaign right in \
                 trials.toml, and is the file this trial's?",
                names.join("` or `"),
                row.campaign
            );
            fail(row, checks, Check::OtherCampaign, message);
        }
    }
}

impl FolderInput {
    /// Finds joints that are bent alike in all trials of a campaign: servos miss their angles to
    /// both sides.
    fn find_common_offsets(&self, rows: &mut Ingested) {
        for (campaign, gait) in &self.gaits {
            let of_campaign =
                |row: &&TrialRow| row.campaign == *campaign && row.status != TrialStatus::Failed;
            let trials: Vec<&TrialRow> = rows.trials.iter().filter(of_campaign).collect();
            let commands = gait.to_gait().joints;
            for (joint, command) in commands.iter().enumerate() {
                let Some(command) = command else { continue };
                let off = |row: &&TrialRow| row.gait[joint].offset_rad - command.offset_rad;
                let off_deg: Vec<f64> = trials.iter().map(|row| off(row).to_degrees()).collect();
                let [low, high] = extremes(off_deg.iter().copied());
                if off_deg.len() < 2 || low.max(-high) < BENT_ALIKE_DEG {
                    continue;
                }
                let (configured, mean) = (command.offset_rad.to_degrees(), mean(off_deg));
                let (count, link) = (trials.len(), joint + 1);
                let message = format!(
                    "joint {link}: measured offset {:+.1} deg in all {count} trials, configured \
                     {configured}: is offset_deg right, or are markers.link0 or markers.link{link} \
                     turned? ingest --calibrate with a trial of a gait about straight links tells",
                    configured + mean
                );
                let finding =
                    Finding::at_most(Check::CommonReason, mean.abs(), BENT_ALIKE_DEG, message);
                rows.checks.push(finding.failing().row(&format!("campaign {campaign}")));
            }
        }
    }
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

/// Fails a trial for what others show.
fn fail(row: &mut TrialRow, checks: &mut Vec<CheckRow>, check: Check, message: String) {
    row.message = match row.message.is_empty() {
        true => message.clone(),
        false => format!("{message}; {}", row.message),
    };
    row.status = TrialStatus::Failed;
    let finding = Finding::new(check, false, f64::NAN, f64::NAN, message).failing().row(&row.trial);
    // Beside the trial's other checks.
    let after = checks.iter().rposition(|other| other.trial == row.trial);
    checks.insert(after.map_or(checks.len(), |last| last + 1), finding);
}

/// Says of each campaign for which reason most of its trials need a person.
fn find_common_reasons(rows: &mut Ingested) {
    let mut campaigns: BTreeMap<&str, Vec<&TrialRow>> = BTreeMap::new();
    for row in rows.trials.iter().filter(|row| !row.campaign.is_empty()) {
        campaigns.entry(&row.campaign).or_default().push(row);
    }
    let mut found = Vec::new();
    for (campaign, trials) in campaigns {
        let mut reasons: BTreeMap<(&str, String), Vec<&CheckRow>> = BTreeMap::new();
        for row in &trials {
            let of_trial = rows.checks.iter().filter(|check| check.trial == row.trial);
            let worst = of_trial.clone().map(|check| check.severity).max();
            let is_reason = |check: &&CheckRow| {
                Some(check.severity) == worst && check.severity > Severity::Info
            };
            for check in of_trial.filter(is_reason) {
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
            let finding = Finding::new(Check::CommonReason, false, count, all, message).failing();
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
    /// What the trials show together: the checks of a campaign or of the folder.
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
    let together = [Check::OtherCampaign, Check::SameFile, Check::CommonReason, Check::Unlisted]
        .map(|check| check.to_string());
    let before = rows.checks.len();
    rows.checks.retain(|row| !together.contains(&row.check));
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
