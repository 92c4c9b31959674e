//! Compares the gaits of several trials to find trials that follow another campaign's gait, and joints with the same
//! offset error in all trials of a campaign.

use std::collections::BTreeMap;

use nalgebra::Complex;
use trilink_robot::JointCommand;
use trilink_statistics::{extremes, mean};
use trilink_tables::{CheckRow, TrialRow, TrialStatus};

use super::folder::CampaignGait;
use super::gait::max_deviation_deg;
use crate::Ingested;
use crate::checks::{Check, Finding};
use crate::cycles::summary::measured_joints;

/// Maximum deviation of the joints from a gait that they are considered to follow, degrees.
const FOLLOWED_DEG: f64 = 4.0;
/// Maximum deviation of a passive joint from the motion expected from the campaign's other frequencies, degrees.
const PASSIVE_DEG: f64 = 12.0;
/// Minimum offset error, common to all trials of a campaign, that is attributed to a single cause, degrees.
const MIN_COMMON_OFFSET_DEG: f64 = 3.0;

/// Fails trials whose joints follow the gait of another campaign.
pub(super) fn find_other_campaigns(rows: &mut Ingested, gaits: &BTreeMap<String, CampaignGait>) {
    let Ingested { trials, checks, .. } = rows;
    let others: Vec<Vec<&str>> =
        trials.iter().map(|row| other_campaigns(row, trials, gaits)).collect();
    for (row, names) in trials.iter_mut().zip(others).filter(|(_, names)| !names.is_empty()) {
        let message = format!(
            "the joints follow the command of campaign `{}`, not of `{}`: is `campaign` correct in trials.toml, and \
             does the file belong to this trial?",
            names.join("` or `"),
            row.campaign
        );
        fail(row, checks, Check::OtherCampaign, message);
    }
}

/// Returns the other campaigns whose gait a trial follows instead of its own campaign's gait. None if no joint is
/// commanded.
fn other_campaigns<'g>(
    row: &TrialRow,
    trials: &[TrialRow],
    gaits: &'g BTreeMap<String, CampaignGait>,
) -> Vec<&'g str> {
    let own = gaits.get(&row.campaign).filter(|own| commanded_joints(own) > 0);
    let Some(own) = own else { return Vec::new() };
    if measured_joints(row, own.joints.len()).iter().any(|joint| joint.offset_rad.is_nan()) {
        return Vec::new();
    }
    // A passive joint may move in any way: if the trial follows its own gait, another gait has to command more joints.
    let follows_own = follows(row, own, Check::Gait.limit());
    let min_commanded = if follows_own { commanded_joints(own) + 1 } else { 1 };
    let followed: Vec<(&String, &CampaignGait)> = gaits
        .iter()
        .filter(|(_, gait)| {
            gait.joints.len() == own.joints.len()
                && commanded_joints(gait) >= min_commanded
                && follows(row, gait, FOLLOWED_DEG)
        })
        .filter(|(_, gait)| !follows_own || !is_passive_by_chance(row, own, gait, trials))
        .collect();
    let max_commanded = followed.iter().map(|(_, gait)| commanded_joints(gait)).max().unwrap_or(0);
    followed
        .into_iter()
        .filter(|(_, gait)| commanded_joints(gait) == max_commanded)
        .map(|(name, _)| name.as_str())
        .collect()
}

fn commanded_joints(gait: &CampaignGait) -> usize {
    gait.joints.iter().flatten().count()
}

/// Returns whether the joints of a trial follow a gait to within a tolerance.
fn follows(row: &TrialRow, gait: &CampaignGait, within_deg: f64) -> bool {
    let measured = measured_joints(row, gait.joints.len());
    max_deviation_deg(&measured, &gait.joints) <= within_deg
}

/// Returns whether a trial's passive joints, which follow the gait `other`, do so by chance: whether linear
/// interpolation in frequency between other trials of its own campaign also predicts their motion. Trials that also
/// follow `other` are not used.
fn is_passive_by_chance(
    row: &TrialRow,
    own: &CampaignGait,
    other: &CampaignGait,
    trials: &[TrialRow],
) -> bool {
    let joints = own.joints.iter().zip(&other.joints).enumerate();
    let mut passive = joints.filter(|(_, (own, other))| own.is_none() && other.is_some());
    passive.all(|(joint, _)| is_predicted(row, joint, other, trials))
}

/// Returns whether linear interpolation in frequency between other trials of the same campaign predicts the motion of a
/// joint. Trials that follow the gait `other` are not used.
fn is_predicted(row: &TrialRow, joint: usize, other: &CampaignGait, trials: &[TrialRow]) -> bool {
    let mut known: Vec<&TrialRow> = trials
        .iter()
        .filter(|trial| {
            trial.campaign == row.campaign
                && swing(trial, joint).re.is_finite()
                && !follows(trial, other, FOLLOWED_DEG)
        })
        .collect();
    known.sort_by(|a, b| {
        let [a, b] = [a, b].map(|trial| (trial.omega_rad_s / row.omega_rad_s).ln().abs());
        a.total_cmp(&b)
    });
    let Some(nearest) = known.first() else { return false };
    let next =
        known.iter().find(|trial| (trial.omega_rad_s / nearest.omega_rad_s - 1.0).abs() > 0.02);
    let Some(next) = next else { return false };
    let position =
        (row.omega_rad_s - nearest.omega_rad_s) / (next.omega_rad_s - nearest.omega_rad_s);
    let expected = swing(nearest, joint) + (swing(next, joint) - swing(nearest, joint)) * position;
    (swing(row, joint) - expected).norm().to_degrees() <= PASSIVE_DEG
}

/// Fails the trials of every campaign in which a joint's offset has the same error in all trials; random servo errors
/// would have both signs.
pub(super) fn find_common_offsets(rows: &mut Ingested, gaits: &BTreeMap<String, CampaignGait>) {
    let Ingested { trials, checks, .. } = rows;
    let mut found = Vec::new();
    for (campaign, gait) in gaits {
        let of_campaign: Vec<&TrialRow> = trials
            .iter()
            .filter(|row| row.campaign == *campaign && row.status.has_metrics())
            .collect();
        for (joint, command) in gait.joints.iter().enumerate() {
            let Some(command) = command else { continue };
            let off_deg: Vec<f64> = of_campaign
                .iter()
                .map(|row| (joint_of(row, joint).offset_rad - command.offset_rad).to_degrees())
                .collect();
            let [low, high] = extremes(off_deg.iter().copied());
            if off_deg.len() < 2 || low.max(-high) < MIN_COMMON_OFFSET_DEG {
                continue;
            }
            let configured = command.offset_rad.to_degrees();
            let off_deg = mean(off_deg);
            let count = of_campaign.len();
            let link = joint + 1;
            let remedy = match gait.is_of_chain {
                true => {
                    "the positions of the markers on one of its two links are rotated".to_owned()
                }
                false => format!(
                    "the positions in markers.link0 or markers.link{link} are rotated. `trilink ingest --calibrate` \
                     with a trial whose gait oscillates about the straight configuration shows which"
                ),
            };
            let message = format!(
                "joint {link}: measured offset {:+.1} deg in all {count} trials, configured {configured}: either \
                 offset_deg is wrong, or {remedy}",
                configured + off_deg
            );
            found.push((campaign.clone(), message));
        }
    }
    for row in trials.iter_mut().filter(|row| row.status.has_metrics()) {
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

/// Fails a trial because of a comparison with other trials: sets its status and adds the failed check.
pub(super) fn fail(row: &mut TrialRow, checks: &mut Vec<CheckRow>, check: Check, message: String) {
    row.status = TrialStatus::Failed;
    add(row, checks, Finding::new(check, false, f64::NAN, f64::NAN, message));
}

/// Adds a finding that compares a trial with others.
pub(super) fn add(row: &mut TrialRow, checks: &mut Vec<CheckRow>, finding: Finding) {
    row.message = if row.message.is_empty() {
        finding.message.clone()
    } else {
        format!("{}; {}", finding.message, row.message)
    };
    insert(&row.trial, checks, &finding);
}

/// Inserts a finding after the trial's other checks.
pub(super) fn insert(trial: &str, checks: &mut Vec<CheckRow>, finding: &Finding) {
    let after = checks.iter().rposition(|other| other.trial == trial);
    checks.insert(after.map_or(checks.len(), |last| last + 1), finding.row(trial));
}

/// Returns the measured motion of a joint; NaN if the trial has none.
fn joint_of(row: &TrialRow, joint: usize) -> JointCommand {
    let unknown = JointCommand::new(f64::NAN, f64::NAN, f64::NAN);
    measured_joints(row, joint + 1).get(joint).copied().unwrap_or(unknown)
}

/// Returns the first harmonic of a joint as a phasor, rad.
fn swing(row: &TrialRow, joint: usize) -> Complex<f64> {
    let joint = joint_of(row, joint);
    Complex::from_polar(joint.amplitude_rad, joint.phase_rad)
}

#[cfg(test)]
mod tests {
    use trilink_robot::Gait;
    use trilink_tables::trial::TrialKind;
    use trilink_tables::{Columns as _, JointGait};

    use super::*;

    /// Returns a trial with joint 2 as commanded and joint 1 at a given phase.
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

    /// Returns the trials, in order of frequency, that are found to follow another campaign's gait.
    fn foreign(phases_deg: [f64; 4]) -> Vec<String> {
        let trials = [1.0, 2.0, 3.0, 4.0].into_iter().zip(phases_deg);
        let trials = trials.map(|(omega, phase)| trial(omega, phase)).collect();
        let mut rows = Ingested { trials, ..Ingested::default() };
        let gaits = [("passive", Gait::passive_symmetric()), ("both", Gait::symmetric())];
        let gaits = gaits.map(|(name, gait)| {
            (name.to_owned(), CampaignGait { joints: gait.joints.to_vec(), is_of_chain: false })
        });
        find_other_campaigns(&mut rows, &gaits.into());
        let failed = rows.trials.into_iter().filter(|row| row.status == TrialStatus::Failed);
        failed.map(|row| row.trial).collect()
    }

    #[test]
    fn a_passive_joint_that_matches_another_command_by_chance_belongs_to_its_campaign() {
        // A commanded joint would lead by 90 degrees.
        assert!(foreign([130.0, 110.0, 90.0, 70.0]).is_empty());
        assert!(foreign([89.0, 70.0, 55.0, 45.0]).is_empty());
        assert_eq!(foreign([-80.0, -100.0, 90.0, -140.0]), ["3"]);
        assert_eq!(foreign([90.0, -100.0, 90.0, -140.0]), ["1", "3"]);
        assert_eq!(foreign([90.0; 4]), ["1", "2", "3", "4"]);
    }

    #[test]
    fn a_trial_of_a_chain_that_follows_another_campaign_fails() {
        let command = |phase_deg: f64| {
            Some(JointCommand::new(0.0, 30_f64.to_radians(), phase_deg.to_radians()))
        };
        let gait = |joints: &[Option<JointCommand>]| CampaignGait {
            joints: joints.to_vec(),
            is_of_chain: true,
        };
        let waves = |step_deg: f64| gait(&[0.0, 1.0, 2.0].map(|joint| command(step_deg * joint)));
        let gaits = BTreeMap::from([
            ("slow".to_owned(), waves(-40.0)),
            ("fast".to_owned(), waves(-80.0)),
            ("elastic".to_owned(), gait(&[None; 3])),
            ("pair".to_owned(), gait(&[command(0.0), command(-80.0)])),
        ]);
        let joint = |phase_deg: f64| JointGait {
            offset_rad: 0.0,
            amplitude_rad: 30_f64.to_radians(),
            phase_rad: phase_deg.to_radians(),
            ..JointGait::blank()
        };
        let names = ["slow", "fast", "elastic"];
        let trials = names.map(|campaign| TrialRow {
            trial: campaign.to_owned(),
            campaign: campaign.to_owned(),
            kind: TrialKind::Gait,
            status: TrialStatus::Ok,
            gait: [joint(0.0), joint(-80.0)],
            more_gait: [joint(-160.0)].into(),
            ..TrialRow::blank()
        });
        let mut rows = Ingested { trials: trials.into(), ..Ingested::default() };
        find_other_campaigns(&mut rows, &gaits);
        assert_eq!(
            rows.trials.iter().map(|row| row.status).collect::<Vec<_>>(),
            [TrialStatus::Failed, TrialStatus::Ok, TrialStatus::Ok]
        );
        assert!(rows.trials[0].message.contains("campaign `fast`"), "{}", rows.trials[0].message);

        let turned = JointGait { offset_rad: 0.1, ..joint(-160.0) };
        let trial = TrialRow { more_gait: [turned].into(), ..rows.trials[1].clone() };
        let mut rows = Ingested { trials: vec![trial; 2], ..Ingested::default() };
        find_common_offsets(&mut rows, &gaits);
        let expected = "joint 3: measured offset +5.7 deg in all 2 trials, configured 0: either offset_deg is wrong, or \
                        the positions of the markers on one of its two links are rotated";
        assert_eq!(rows.trials[0].message, expected);
    }
}
