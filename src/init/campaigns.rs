//! Grouping of files into campaigns: trials of one robot with one gait, swept over frequency.
//!
//! The motion of a commanded joint is the same at every frequency. The amplitude and phase of a passive joint change
//! steadily with the frequency.

use std::collections::BTreeMap;

use nalgebra::Complex;
use trilink_statistics::{extremes, median};

/// Maximum difference between motions of a commanded joint that count as equal, degrees.
const MAX_SAME_DEG: f64 = 5.0;
/// Maximum difference between motions of a joint of a chain that count as equal, relative to the amplitude.
const MAX_SAME_PART: f64 = 0.25;
/// Difference between motions of a joint of a chain that always count as equal, degrees.
const MIN_SAME_DEG: f64 = 1.0;
/// Maximum relative difference between frequencies that count as equal.
const MAX_SAME_FREQUENCY: f64 = 0.02;
/// Maximum value of the following ratio for a joint's motion to count as changing steadily with frequency: the sum of
/// its changes between successive frequencies, divided by its largest change between any two frequencies.
const MAX_STEADY_RATIO: f64 = 2.0;
/// Minimum number of frequencies needed to distinguish a passive joint from a commanded one without doubt.
const MIN_CERTAIN: usize = 3;

/// Motion of a joint, `offset + amplitude cos(phase of the gait + phase)`, in degrees.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct JointSwing {
    pub offset_deg: f64,
    pub amplitude_deg: f64,
    /// Phase relative to joint 1, whose phase is 0.
    pub phase_deg: f64,
}

impl JointSwing {
    /// Returns the offset and the complex amplitude, degrees.
    fn vector(&self) -> (f64, Complex<f64>) {
        let phase_rad = self.phase_deg.to_radians();
        (self.offset_deg, Complex::from_polar(self.amplitude_deg, phase_rad))
    }

    /// Returns the difference in offset or in complex amplitude, whichever is larger, degrees.
    fn distance_deg(&self, other: &Self) -> f64 {
        let (offset, swing) = self.vector();
        let (other_offset, other_swing) = other.vector();
        (offset - other_offset).abs().max((swing - other_swing).norm())
    }

    /// Returns the motion with its phase set to 0.
    fn without_phase(&self) -> Self {
        Self { phase_deg: 0.0, ..*self }
    }
}

/// Measured gait in a file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MeasuredGait {
    pub omega_rad_s: f64,
    /// Motions of the joints from front to rear.
    pub joints: Vec<JointSwing>,
    /// Words in the file's name, or the campaign named in the list of trials.
    pub name: String,
    /// Whether the name is that of a campaign in a list of trials.
    pub is_listed: bool,
}

/// Group of files with the same gait.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Group {
    pub name: String,
    /// Indices of the files in order of frequency.
    pub files: Vec<usize>,
    /// Joint motions: medians over the files.
    pub joints: Vec<JointSwing>,
    /// Indices of the passive joints.
    pub passive: Vec<usize>,
    /// Sentence that explains why it is in doubt whether a joint is passive; `None` if there is no doubt.
    pub doubt: Option<String>,
}

/// Groups files by campaign if a list of trials states it, and otherwise by name and gait.
pub(super) fn groups(files: &[MeasuredGait]) -> Vec<Group> {
    let mut by_name: BTreeMap<(&str, bool), Vec<usize>> = BTreeMap::new();
    for (i, file) in files.iter().enumerate() {
        by_name.entry((&file.name, file.is_listed)).or_default().push(i);
    }
    let mut found = Vec::new();
    for ((name, is_listed), mut indices) in by_name {
        indices.sort_by(|&a, &b| files[a].omega_rad_s.total_cmp(&files[b].omega_rad_s));
        let parts =
            if is_listed { vec![listed_group(files, indices)] } else { split(files, &indices) };
        let count = parts.len();
        for (i, part) in parts.into_iter().enumerate() {
            let name = match (name, count) {
                ("", 1) => "gait".to_owned(),
                ("", _) => format!("gait-{}", i + 1),
                (name, 1) => name.to_owned(),
                (name, _) => format!("{name}-{}", i + 1),
            };
            found.push(Group { name, ..part });
        }
    }
    // Make names distinct that differ only in capitals, or that equal the numbered name of another group.
    for i in 1..found.len() {
        while found[..i].iter().any(|other| other.name.eq_ignore_ascii_case(&found[i].name)) {
            found[i].name.push_str("-b");
        }
    }
    found
}

/// Clusters files by the motion of a joint; the first file of each cluster is its reference.
fn clusters(files: &[usize], swing: impl Fn(usize) -> JointSwing) -> Vec<Vec<usize>> {
    let mut found: Vec<Vec<usize>> = Vec::new();
    for &file in files {
        let mut near = found
            .iter_mut()
            .filter(|cluster| swing(cluster[0]).distance_deg(&swing(file)) <= MAX_SAME_DEG);
        match near.next() {
            Some(cluster) => cluster.push(file),
            None => found.push(vec![file]),
        }
    }
    found
}

/// Splits files with the same name, sorted by frequency, into groups with the same gait.
fn split(files: &[MeasuredGait], indices: &[usize]) -> Vec<Group> {
    let commanded = commanded_joint(files, indices);
    let swing = |i: usize| files[i].joints[commanded].without_phase();
    let is_chain = files[indices[0]].joints.len() != 2;
    if is_chain && changes_steadily(files, indices, swing) {
        return vec![chain_group(files, indices.to_vec())];
    }
    let groups = clusters(indices, swing).into_iter().flat_map(|cluster| match is_chain {
        false => split_by_other(files, cluster, commanded),
        true => vec![chain_group(files, cluster)],
    });
    groups.collect()
}

/// Returns the joint that is taken as commanded: the one with the fewest distinct motions or, in a tie, with the
/// smallest spread.
fn commanded_joint(files: &[MeasuredGait], indices: &[usize]) -> usize {
    let of_joint = |joint: usize| {
        let swing = |i: usize| files[i].joints[joint].without_phase();
        let [low, high] = extremes(indices.iter().map(|&i| swing(i).offset_deg));
        let offset_spread_deg = high - low;
        let [low, high] = extremes(indices.iter().map(|&i| swing(i).amplitude_deg));
        (clusters(indices, swing).len(), offset_spread_deg + (high - low))
    };
    let joints = (0..files[indices[0]].joints.len()).map(|joint| (joint, of_joint(joint)));
    let fewest = joints.reduce(|one, other| if other.1 < one.1 { other } else { one });
    fewest.map_or(0, |(joint, _)| joint)
}

/// Splits the files `rest`, in which the motion of joint `commanded` is the same, into groups in which the motion of
/// the other joint is the same, too. If the latter motion changes steadily with frequency, the joint is passive, and
/// the files stay in one group.
fn split_by_other(files: &[MeasuredGait], mut rest: Vec<usize>, commanded: usize) -> Vec<Group> {
    let mut found = Vec::new();
    while !rest.is_empty() {
        let other = 1 - commanded;
        let same = clusters(&rest, |i| relative(&files[i], other));
        if same.len() == 1 || is_passive(files, &rest, other) {
            found.push(new_group(files, rest));
            break;
        }
        let largest = (0..same.len()).rev().max_by_key(|&i| same[i].len()).unwrap_or(0);
        let taken = &same[largest];
        rest.retain(|file| !taken.contains(file));
        found.push(new_group(files, taken.clone()));
    }
    found
}

/// Returns the motion of a joint, with its phase replaced by that of joint 2 relative to joint 1.
fn relative(file: &MeasuredGait, joint: usize) -> JointSwing {
    let phase_deg = file.joints[1].phase_deg - file.joints[0].phase_deg;
    JointSwing { phase_deg, ..file.joints[joint] }
}

/// Returns whether a joint of two seems passive, that is, whether its motion changes steadily with frequency.
/// `by_frequency` are indices of files, sorted by frequency.
fn is_passive(files: &[MeasuredGait], by_frequency: &[usize], joint: usize) -> bool {
    changes_steadily(files, by_frequency, |i| relative(&files[i], joint))
}

/// Returns whether a motion of the files changes steadily with frequency. `by_frequency` are indices of files, sorted by
/// frequency.
fn changes_steadily(
    files: &[MeasuredGait],
    by_frequency: &[usize],
    swing: impl Fn(usize) -> JointSwing,
) -> bool {
    let apart = |a: usize, b: usize| swing(a).distance_deg(&swing(b));
    let mut path_deg = 0.0;
    let mut extent = 0.0_f64;
    for (i, &file) in by_frequency.iter().enumerate() {
        extent = by_frequency.iter().fold(extent, |extent, &other| extent.max(apart(file, other)));
        let Some(&next) = by_frequency.get(i + 1) else { break };
        let is_same_frequency =
            files[next].omega_rad_s < (1.0 + MAX_SAME_FREQUENCY) * files[file].omega_rad_s;
        if is_same_frequency && apart(file, next) > MAX_SAME_DEG {
            return false;
        }
        path_deg += apart(file, next);
    }
    extent > MAX_SAME_DEG && path_deg <= MAX_STEADY_RATIO * extent
}

/// Creates the group of the files that a list of trials assigns to one campaign, sorted by frequency.
fn listed_group(files: &[MeasuredGait], indices: Vec<usize>) -> Group {
    match files[indices[0]].joints.len() {
        2 => new_group(files, indices),
        _ => chain_group(files, indices),
    }
}

/// Creates a group of files of a chain, which are sorted by frequency. The joints whose motion differs between
/// frequencies are passive.
fn chain_group(files: &[MeasuredGait], indices: Vec<usize>) -> Group {
    let commanded = commanded_joint(files, &indices);
    let joints = (0..files[indices[0]].joints.len()).map(|joint| {
        let swings: Vec<JointSwing> = indices
            .iter()
            .map(|&i| {
                let swing = files[i].joints[joint];
                let phase_deg = swing.phase_deg - files[i].joints[commanded].phase_deg;
                JointSwing { phase_deg, ..swing }
            })
            .collect();
        let median = median_swing(&swings);
        let max_deg = (MAX_SAME_PART * median.amplitude_deg).clamp(MIN_SAME_DEG, MAX_SAME_DEG);
        (median, swings.iter().any(|swing| swing.distance_deg(&median) > max_deg))
    });
    let mut joints: Vec<(JointSwing, bool)> = joints.collect();
    // Phases are relative to the first driven joint.
    let first_deg = joints.iter().find(|(_, changes)| !changes).map_or(0.0, |(of, _)| of.phase_deg);
    for (swing, _) in &mut joints {
        let phase_rad = (swing.phase_deg - first_deg).to_radians();
        swing.phase_deg = trilink_statistics::wrap(phase_rad).to_degrees();
    }
    let passive = joints.iter().enumerate().filter(|(_, (_, changes))| *changes);
    let passive: Vec<usize> = passive.map(|(joint, _)| joint).collect();
    let doubt = match (&passive[..], count_frequencies(files, &indices)) {
        (all, _) if all.len() == joints.len() => Some(
            "the motion of every joint changes with the frequency, so that none is driven; enter the torques, drives or \
             rotors that move the robot"
                .to_owned(),
        ),
        ([], 1) => Some(
            "files of a single frequency do not show whether a joint is driven; change the kind of each joint that is \
             not, and remove its line"
                .to_owned(),
        ),
        ([_, ..], count) if count < MIN_CERTAIN => Some(format!(
            "joints are taken as passive because their motions differ between the {count} frequencies; if the files \
             show two gaits, make two campaigns of them"
        )),
        _ => None,
    };
    let joints = joints.into_iter().map(|(swing, _)| swing).collect();
    Group { name: String::new(), files: indices, joints, passive, doubt }
}

/// Returns the number of different frequencies of files that are sorted by frequency.
fn count_frequencies(files: &[MeasuredGait], indices: &[usize]) -> usize {
    let mut frequencies: Vec<f64> = indices.iter().map(|&i| files[i].omega_rad_s).collect();
    frequencies.dedup_by(|next, first| *next < (1.0 + MAX_SAME_FREQUENCY) * *first);
    frequencies.len()
}

/// Returns the medians of the offsets, amplitudes and phases of a joint's motions.
fn median_swing(swings: &[JointSwing]) -> JointSwing {
    // The median is taken over differences from the first phase, because angles wrap at half a turn.
    let first_deg = swings[0].phase_deg;
    let wrapped_deg =
        |phase_deg: f64| trilink_statistics::wrap(phase_deg.to_radians()).to_degrees();
    let differences = swings.iter().map(|swing| wrapped_deg(swing.phase_deg - first_deg));
    JointSwing {
        offset_deg: median(swings.iter().map(|swing| swing.offset_deg).collect()),
        amplitude_deg: median(swings.iter().map(|swing| swing.amplitude_deg).collect()),
        phase_deg: wrapped_deg(first_deg + median(differences.collect())),
    }
}

/// Creates a group from files that are sorted by frequency.
fn new_group(files: &[MeasuredGait], indices: Vec<usize>) -> Group {
    // Phases are relative, so that both joints may seem passive; the one with the larger change in amplitude is
    // passive.
    let passive = if is_passive(files, &indices, 0) || is_passive(files, &indices, 1) {
        let [first, second] = [0, 1].map(|joint| {
            let [low, high] =
                extremes(indices.iter().map(|&i| files[i].joints[joint].amplitude_deg));
            high - low
        });
        Some(usize::from(second > first))
    } else {
        None
    };
    let joints = [0, 1].map(|joint| {
        let swings: Vec<JointSwing> = indices.iter().map(|&i| relative(&files[i], joint)).collect();
        let median = median_swing(&swings);
        if joint == 0 || passive.is_some() { median.without_phase() } else { median }
    });
    let doubt = match (passive, count_frequencies(files, &indices)) {
        (None, 1) => Some(
            "files of a single frequency do not show whether a joint is passive; if a joint is \
             passive, remove its line"
                .to_owned(),
        ),
        (Some(joint), count) if count < MIN_CERTAIN => Some(format!(
            "joint {} is taken as passive, because its motion differs between the {count} \
             frequencies; if the files show two gaits, make two campaigns of them",
            joint + 1
        )),
        _ => None,
    };
    let (joints, passive) = (joints.into(), passive.into_iter().collect());
    Group { name: String::new(), files: indices, joints, passive, doubt }
}

/// Returns the words of a file's name without its numbers: `kinematic-skewed` for `kinematic-skewed-3.90-r1`.
pub(super) fn words(stem: &str) -> String {
    let parts = stem.split(|c: char| !c.is_ascii_alphanumeric());
    let is_word = |part: &&str| !part.is_empty() && !part.contains(|c: char| c.is_ascii_digit());
    let words = parts.filter(is_word).map(str::to_ascii_lowercase);
    words.collect::<Vec<_>>().join("-").chars().take(48).collect()
}

/// Returns the frequency given in a file's name, rad/s: a number near the measured frequency in rad/s or Hz.
pub(super) fn named_omega(stem: &str, measured_rad_s: f64) -> Option<f64> {
    const MAX_RELATIVE_ERROR: f64 = 0.02;
    let numbers = stem.split(|c: char| !c.is_ascii_digit() && c != '.');
    let numbers: Vec<f64> =
        numbers.filter_map(|text| text.trim_matches('.').parse().ok()).collect();
    let in_hz = numbers.iter().map(|hz| hz * std::f64::consts::TAU);
    let mut candidates_rad_s = numbers.iter().copied().chain(in_hz);
    candidates_rad_s.find(|omega| (omega / measured_rad_s - 1.0).abs() < MAX_RELATIVE_ERROR)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn swing(offset_deg: f64, amplitude_deg: f64, phase_deg: f64) -> JointSwing {
        JointSwing { offset_deg, amplitude_deg, phase_deg }
    }

    fn performed(name: &str, omega_rad_s: f64, joints: [JointSwing; 2]) -> MeasuredGait {
        let joints = joints.into();
        MeasuredGait { omega_rad_s, joints, name: name.to_owned(), is_listed: false }
    }

    fn passive(name: &str, omega: f64) -> MeasuredGait {
        let phase_deg = -80.0 - 14.0 * omega;
        performed(name, omega, [swing(0.0, 30.0 - 12.0 / omega, phase_deg), swing(0.0, 30.0, 0.0)])
    }

    #[test]
    fn gaits_of_one_name_are_separated_and_a_joint_that_changes_with_frequency_is_passive() {
        let frequencies = (1..=12).map(|i| 0.5 * f64::from(i));
        let (level, slanted) = (swing(0.0, 30.0, 0.0), swing(45.0, 30.0, 0.0));
        let rear = |offset| swing(offset, 30.0, -90.0);
        let mut files: Vec<MeasuredGait> = Vec::new();
        for omega in frequencies {
            files.push(performed("trial", omega, [level, rear(0.0)]));
            files.push(performed("trial", omega, [slanted, rear(-45.0)]));
            files.push(passive("trial", omega));
        }
        let found = groups(&files);
        let sizes: Vec<_> =
            found.iter().map(|group| (group.files.len(), &group.passive[..])).collect();
        assert_eq!(sizes.len(), 3, "{found:#?}");
        assert!(sizes.contains(&(12, &[0])) && sizes.contains(&(12, &[])), "{sizes:?}");
        let names: Vec<&str> = found.iter().map(|group| group.name.as_str()).collect();
        assert_eq!(names, ["trial-1", "trial-2", "trial-3"]);
        assert!(found.iter().all(|group| group.doubt.is_none()));
        let bent = found.iter().find(|group| group.joints[0].offset_deg > 40.0).unwrap();
        assert!((bent.joints[1].phase_deg + 90.0).abs() < 1e-9, "{bent:?}");
    }

    #[test]
    fn doubts_that_few_files_leave_are_reported() {
        let one = groups(&[performed("a", 2.0, [swing(0.0, 20.0, 0.0), swing(0.0, 20.0, 60.0)])]);
        assert_eq!((one[0].name.as_str(), one[0].passive.first()), ("a", None));
        assert!(one[0].doubt.as_ref().unwrap().contains("a single frequency"));
        let two = groups(&[passive("a", 1.0), passive("a", 3.0)]);
        assert_eq!((two.len(), &two[0].passive[..]), (1, &[0][..]));
        assert!(two[0].doubt.as_ref().unwrap().contains("2 frequencies"));
    }

    #[test]
    fn words_and_frequencies_are_read_from_names() {
        for (stem, expected) in [
            ("kinematic-skewed-3.90-r1", "kinematic-skewed"),
            ("2024-05-12_Trial03", ""),
            ("Snake trial 7", "snake-trial"),
        ] {
            assert_eq!(words(stem), expected);
        }
        assert_eq!(named_omega("skewed-3.90-r1", 3.9002), Some(3.9));
        assert_eq!(named_omega("gait 0.6Hz 2", 3.77), Some(0.6 * std::f64::consts::TAU));
        assert_eq!(named_omega("trial-7", 3.9), None);
    }
}
