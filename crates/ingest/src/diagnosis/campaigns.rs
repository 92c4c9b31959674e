//! What the gaits of several trials show: trials of another campaign, and joints that are bent alike
//! in all trials of one.

use std::collections::BTreeMap;

use nalgebra::Complex;
use trilink_robot::Gait;
use trilink_statistics::{extremes, mean};
use trilink_tables::{CheckRow, TrialRow, TrialStatus};

use super::gait::off_deg;
use crate::Ingested;
use crate::checks::{Check, Finding};

/// A gait that the joints follow this well is theirs, degrees.
const FOLLOWED_DEG: f64 = 4.0;
/// A passive joint this far from what it does at its campaign's other frequencies is not passive,
/// degrees.
const FOREIGN_DEG: f64 = 12.0;
/// Joints whose offsets are off by more than this in all trials are off for one reason, degrees.
const BENT_ALIKE_DEG: f64 = 3.0;

/// Fails trials that do what another campaign commands.
pub(super) fn find_other_campaigns(rows: &mut Ingested, gaits: &BTreeMap<String, Gait>) {
    let Ingested { trials, checks, .. } = rows;
    let others: Vec<Vec<&str>> =
        trials.iter().map(|row| other_campaigns(row, trials, gaits)).collect();
    for (row, names) in trials.iter_mut().zip(others).filter(|(_, names)| !names.is_empty()) {
        let message = format!(
            "the joints do what campaign `{}` commands, not `{}`: is campaign right in trials.toml, \
             and is the file this trial's?",
            names.join("` or `"),
            row.campaign
        );
        fail(row, checks, Check::OtherCampaign, message);
    }
}

/// The campaigns whose gait a trial follows instead of its own.
fn other_campaigns<'g>(
    row: &TrialRow,
    trials: &[TrialRow],
    gaits: &'g BTreeMap<String, Gait>,
) -> Vec<&'g str> {
    let Some(own) = gaits.get(&row.campaign) else { return Vec::new() };
    if row.gait.iter().any(|joint| joint.offset_rad.is_nan()) {
        return Vec::new();
    }
    let commanded = |gait: &Gait| gait.joints.iter().flatten().count();
    // A passive joint may do anything.
    let least = if follows(row, own, Check::Gait.limit()) { commanded(own) + 1 } else { 0 };
    let followed = gaits
        .iter()
        .filter(|(_, gait)| commanded(gait) >= least && follows(row, gait, FOLLOWED_DEG))
        .filter(|(_, gait)| least == 0 || !is_passive_by_chance(row, own, gait, trials));
    let followed: Vec<_> = followed.collect();
    let most = followed.iter().map(|(_, gait)| commanded(gait)).max().unwrap_or(0);
    let most_commanded = followed.into_iter().filter(|(_, gait)| commanded(gait) == most);
    most_commanded.map(|(name, _)| name.as_str()).collect()
}

fn follows(row: &TrialRow, gait: &Gait, within_deg: f64) -> bool {
    off_deg(row.gait.map(|joint| joint.command()), gait) <= within_deg
}

/// Whether the passive joint of a trial, which follows the command of `other`, does what the
/// campaign's trials that do not follow it have it do at their frequencies, in proportion.
fn is_passive_by_chance(row: &TrialRow, own: &Gait, other: &Gait, trials: &[TrialRow]) -> bool {
    let Some(joint) = own.passive_joint() else { return true };
    let swing = |row: &TrialRow| {
        let joint = row.gait[joint];
        Complex::from_polar(joint.amplitude_rad, joint.phase_rad)
    };
    let is_known = |of: &&TrialRow| {
        of.campaign == row.campaign && swing(of).re.is_finite() && !follows(of, other, FOLLOWED_DEG)
    };
    let mut known: Vec<&TrialRow> = trials.iter().filter(is_known).collect();
    let distance = |of: &TrialRow| (of.omega_rad_s / row.omega_rad_s).ln().abs();
    known.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    let Some(nearest) = known.first() else { return false };
    let is_other = |of: &&&TrialRow| (of.omega_rad_s / nearest.omega_rad_s - 1.0).abs() > 0.02;
    let Some(next) = known.iter().find(is_other) else { return false };
    let part = (row.omega_rad_s - nearest.omega_rad_s) / (next.omega_rad_s - nearest.omega_rad_s);
    let expected = swing(nearest) + (swing(next) - swing(nearest)) * part;
    (swing(row) - expected).norm().to_degrees() <= FOREIGN_DEG
}

/// Fails trials the joints of which are bent alike in all trials of a campaign: servos miss their
/// angles to both sides.
pub(super) fn find_common_offsets(rows: &mut Ingested, gaits: &BTreeMap<String, Gait>) {
    let Ingested { trials, checks, .. } = rows;
    let mut found = Vec::new();
    for (campaign, gait) in gaits {
        let of_campaign =
            |row: &&TrialRow| row.campaign == *campaign && row.status != TrialStatus::Failed;
        let of_campaign: Vec<&TrialRow> = trials.iter().filter(of_campaign).collect();
        for (joint, command) in gait.joints.iter().enumerate() {
            let Some(command) = command else { continue };
            let off = |row: &&TrialRow| row.gait[joint].offset_rad - command.offset_rad;
            let off_deg: Vec<f64> = of_campaign.iter().map(|row| off(row).to_degrees()).collect();
            let [low, high] = extremes(off_deg.iter().copied());
            if off_deg.len() < 2 || low.max(-high) < BENT_ALIKE_DEG {
                continue;
            }
            let (configured, off_deg) = (command.offset_rad.to_degrees(), mean(off_deg));
            let (count, link) = (of_campaign.len(), joint + 1);
            let message = format!(
                "joint {link}: measured offset {:+.1} deg in all {count} trials, configured \
                 {configured}: is offset_deg right, or are markers.link0 or markers.link{link} \
                 turned? ingest --calibrate with a trial of a gait about straight links tells",
                configured + off_deg
            );
            found.push((campaign.clone(), message));
        }
    }
    for row in trials.iter_mut().filter(|row| row.status != TrialStatus::Failed) {
        let messages: Vec<&str> = found
            .iter()
            .filter(|(campaign, _)| *campaign == row.campaign)
            .map(|(_, message)| message.as_str())
            .collect();
        if !messages.is_empty() {
            fail(row, checks, Check::CommonOffset, messages.join("; "));
        }
    }
}

/// Fails a trial for what others show.
pub(super) fn fail(row: &mut TrialRow, checks: &mut Vec<CheckRow>, check: Check, message: String) {
    row.message = match row.message.is_empty() {
        true => message.clone(),
        false => format!("{message}; {}", row.message),
    };
    row.status = TrialStatus::Failed;
    let finding = Finding::new(check, false, f64::NAN, f64::NAN, message).row(&row.trial);
    // Beside the trial's other checks.
    let after = checks.iter().rposition(|other| other.trial == row.trial);
    checks.insert(after.map_or(checks.len(), |last| last + 1), finding);
}

#[cfg(test)]
mod tests {
    use trilink_tables::trial::TrialKind;
    use trilink_tables::{Columns as _, JointGait};

    use super::*;

    /// A trial with joint 2 as commanded, and joint 1 at a phase.
    fn trial(omega_rad_s: f64, phase_deg: f64) -> TrialRow {
        let joint = |amplitude_deg: f64, phase_deg: f64| JointGait {
            offset_rad: 0.0,
            amplitude_rad: amplitude_deg.to_radians(),
            phase_rad: phase_deg.to_radians(),
            ..JointGait::blank()
        };
        TrialRow {
            trial: omega_rad_s.to_string(),
            campaign: "passive".to_owned(),
            kind: TrialKind::Gait,
            omega_rad_s,
            gait: [joint(29.0, phase_deg), joint(30.0, 0.0)],
            ..TrialRow::blank()
        }
    }

    fn foreign(phases_deg: [f64; 4]) -> Vec<String> {
        let trials = [1.0, 2.0, 3.0, 4.0].into_iter().zip(phases_deg);
        let trials = trials.map(|(omega, phase)| trial(omega, phase)).collect();
        let mut rows = Ingested { trials, ..Ingested::default() };
        let gaits = [("passive", Gait::passive_symmetric()), ("both", Gait::symmetric())];
        find_other_campaigns(&mut rows, &gaits.map(|(name, gait)| (name.to_owned(), gait)).into());
        let failed = rows.trials.into_iter().filter(|row| row.status == TrialStatus::Failed);
        failed.map(|row| row.trial).collect()
    }

    #[test]
    fn a_passive_joint_that_passes_another_command_by_chance_is_the_campaign_s() {
        // Commanded, it would be 90 degrees ahead.
        assert!(foreign([130.0, 110.0, 90.0, 70.0]).is_empty());
        assert!(foreign([89.0, 70.0, 55.0, 45.0]).is_empty());
        assert_eq!(foreign([-80.0, -100.0, 90.0, -140.0]), ["3"]);
        assert_eq!(foreign([90.0, -100.0, 90.0, -140.0]), ["1", "3"]);
        assert_eq!(foreign([90.0; 4]), ["1", "2", "3", "4"]);
    }
}
