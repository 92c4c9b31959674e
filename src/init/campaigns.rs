//! Which gaits are one campaign: a robot with one gait, swept over frequency.
//!
//! Commanded joints do the same at every frequency. A passive one does not: its amplitude and phase
//! change, steadily, with the frequency.

use std::collections::BTreeMap;

use nalgebra::Complex;
use trilink_statistics::{extremes, median};

/// Commanded joints do the same within this, degrees.
const SAME_DEG: f64 = 5.0;
/// Frequencies that differ by less than this part are one.
const SAME_PART: f64 = 0.02;
/// What changes with the frequency takes a way of at most so many times its extent.
const STEADY: f64 = 2.0;
/// Frequencies that tell a passive joint from a commanded one beyond doubt.
const CERTAIN: usize = 3;

/// `offset + amplitude cos(phase of the gait + phase)`, degrees.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct JointSwing {
    pub offset_deg: f64,
    pub amplitude_deg: f64,
    /// Of joint 2 against joint 1, which has 0.
    pub phase_deg: f64,
}

impl JointSwing {
    /// Offset and amplitude with phase, as numbers that can be compared.
    fn vector(&self) -> (f64, Complex<f64>) {
        let phase_rad = self.phase_deg.to_radians();
        (self.offset_deg, Complex::from_polar(self.amplitude_deg, phase_rad))
    }

    fn distance_deg(&self, other: &Self) -> f64 {
        let ((offset, swing), (offset2, swing2)) = (self.vector(), other.vector());
        (offset - offset2).abs().max((swing - swing2).norm())
    }

    /// Whatever the phases are.
    fn unphased(&self) -> Self {
        Self { phase_deg: 0.0, ..*self }
    }
}

/// What joints 1 and 2 do in a file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Performed {
    pub omega_rad_s: f64,
    pub joints: [JointSwing; 2],
    /// The words of the file's name, or the campaign that a list of trials names.
    pub name: String,
    pub is_listed: bool,
}

/// Files of one gait.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Group {
    pub name: String,
    /// Indices of the files, by frequency.
    pub files: Vec<usize>,
    /// Medians over the files.
    pub joints: [JointSwing; 2],
    /// By index.
    pub passive: Option<usize>,
    /// What the files leave open.
    pub doubt: Option<String>,
}

/// The files in groups.
pub(super) fn groups(files: &[Performed]) -> Vec<Group> {
    let mut by_name: BTreeMap<(&str, bool), Vec<usize>> = BTreeMap::new();
    for (i, file) in files.iter().enumerate() {
        by_name.entry((&file.name, file.is_listed)).or_default().push(i);
    }
    let mut found = Vec::new();
    for ((name, is_listed), mut of_name) in by_name {
        of_name.sort_by(|&a, &b| files[a].omega_rad_s.total_cmp(&files[b].omega_rad_s));
        let parts = match is_listed {
            true => vec![whole(files, of_name)],
            false => split(files, &of_name),
        };
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
    // Names that differ in their capitals only, or by a number that another one has.
    for i in 1..found.len() {
        while found[..i].iter().any(|other| other.name.eq_ignore_ascii_case(&found[i].name)) {
            found[i].name.push_str("-b");
        }
    }
    found
}

/// Clusters of files that are near the first of each in what a joint does.
fn clusters(files: &[usize], swing: impl Fn(usize) -> JointSwing) -> Vec<Vec<usize>> {
    let mut found: Vec<Vec<usize>> = Vec::new();
    for &file in files {
        let near = |of: &&mut Vec<usize>| swing(of[0]).distance_deg(&swing(file)) <= SAME_DEG;
        match found.iter_mut().find(near) {
            Some(cluster) => cluster.push(file),
            None => found.push(vec![file]),
        }
    }
    found
}

/// Files of one name, by frequency, in groups of one gait.
fn split(files: &[Performed], of_name: &[usize]) -> Vec<Group> {
    let steady = |joint: usize| {
        let swing = |i: usize| files[i].joints[joint].unphased();
        let spread = |value: &dyn Fn(JointSwing) -> f64| {
            let [low, high] = extremes(of_name.iter().map(|&i| value(swing(i))));
            high - low
        };
        let spread = spread(&|of| of.offset_deg) + spread(&|of| of.amplitude_deg);
        (clusters(of_name, swing), spread)
    };
    // The joint that does the same more often is commanded.
    let [(first, first_deg), (second, second_deg)] = [steady(0), steady(1)];
    let is_first = (first.len(), first_deg) <= (second.len(), second_deg);
    let (commanded, clusters) = if is_first { (0, first) } else { (1, second) };
    clusters.into_iter().flat_map(|files_of| of_joint(files, files_of, commanded)).collect()
}

/// Files in which the commanded joint does the same.
fn of_joint(files: &[Performed], mut rest: Vec<usize>, commanded: usize) -> Vec<Group> {
    let mut found = Vec::new();
    while !rest.is_empty() {
        let other = 1 - commanded;
        let same = clusters(&rest, |i| relative(&files[i], other));
        if same.len() == 1 || is_passive(files, &rest, other) {
            found.push(whole(files, rest));
            break;
        }
        let largest = (0..same.len()).rev().max_by_key(|&i| same[i].len()).unwrap_or(0);
        let taken = &same[largest];
        rest.retain(|file| !taken.contains(file));
        found.push(whole(files, taken.clone()));
    }
    found
}

/// What a joint does, with its phase against the other one.
fn relative(file: &Performed, joint: usize) -> JointSwing {
    let phase_deg = file.joints[1].phase_deg - file.joints[0].phase_deg;
    JointSwing { phase_deg, ..file.joints[joint] }
}

/// Whether a joint does at each frequency something else, and steadily so.
fn is_passive(files: &[Performed], by_frequency: &[usize], joint: usize) -> bool {
    let apart =
        |a: usize, b: usize| relative(&files[a], joint).distance_deg(&relative(&files[b], joint));
    let (mut way, mut extent) = (0.0, 0.0_f64);
    for (i, &file) in by_frequency.iter().enumerate() {
        extent = by_frequency.iter().fold(extent, |extent, &other| extent.max(apart(file, other)));
        let Some(&next) = by_frequency.get(i + 1) else { break };
        let is_one = files[next].omega_rad_s < (1.0 + SAME_PART) * files[file].omega_rad_s;
        if is_one && apart(file, next) > SAME_DEG {
            return false;
        }
        way += apart(file, next);
    }
    extent > SAME_DEG && way <= STEADY * extent
}

/// One group of files, by frequency.
fn whole(files: &[Performed], of: Vec<usize>) -> Group {
    let is_passive = |joint: usize| is_passive(files, &of, joint);
    let spread = |joint: usize| {
        let amplitudes = of.iter().map(|&i| files[i].joints[joint].amplitude_deg);
        let [low, high] = extremes(amplitudes);
        high - low
    };
    // Their phases are against each other: of both the one that changes more otherwise is passive.
    let passive = match (is_passive(0), is_passive(1)) {
        (false, false) => None,
        _ => Some(usize::from(spread(1) > spread(0))),
    };
    let mut frequencies: Vec<f64> = of.iter().map(|&i| files[i].omega_rad_s).collect();
    frequencies.dedup_by(|next, first| *next < (1.0 + SAME_PART) * *first);
    let swings = |joint: usize| {
        let values = |value: &dyn Fn(JointSwing) -> f64| {
            median(of.iter().map(|&i| value(relative(&files[i], joint))).collect())
        };
        // About the first one, so that angles on both sides of half a turn have a median.
        let first_deg = relative(&files[of[0]], joint).phase_deg;
        let off = |deg: f64| trilink_statistics::wrap((deg - first_deg).to_radians()).to_degrees();
        let phase_deg = first_deg + values(&|of| off(of.phase_deg));
        let phase_deg = if joint == 0 || passive.is_some() { 0.0 } else { phase_deg };
        JointSwing {
            offset_deg: values(&|of| of.offset_deg),
            amplitude_deg: values(&|of| of.amplitude_deg),
            phase_deg: trilink_statistics::wrap(phase_deg.to_radians()).to_degrees(),
        }
    };
    let joints = [swings(0), swings(1)];
    let doubt = match (passive, frequencies.len()) {
        (None, 1) => Some(
            "files of one frequency do not show whether a joint is passive; if one is, remove its line"
                .to_owned(),
        ),
        (Some(joint), count) if count < CERTAIN => Some(format!(
            "joint {} is taken for passive, because it does something else at each of {count} \
             frequencies; if these are two gaits, they are two campaigns",
            joint + 1
        )),
        _ => None,
    };
    Group { name: String::new(), files: of, joints, passive, doubt }
}

/// The words of a file's name, without its numbers: `kinematic-skewed` of `kinematic-skewed-3.90-r1`.
pub(super) fn words(stem: &str) -> String {
    let parts = stem.split(|c: char| !c.is_ascii_alphanumeric());
    let is_word = |part: &&str| !part.is_empty() && !part.contains(|c: char| c.is_ascii_digit());
    let words = parts.filter(is_word).map(str::to_ascii_lowercase);
    words.collect::<Vec<_>>().join("-").chars().take(48).collect()
}

/// The number of a file's name that is its frequency: near the measured one, in rad/s or Hz.
pub(super) fn named_omega(stem: &str, measured_rad_s: f64) -> Option<f64> {
    const NEAR: f64 = 0.02;
    let is_number = |c: char| c.is_ascii_digit() || c == '.';
    let numbers = stem.split(|c: char| !is_number(c)).map(|text| text.trim_matches('.'));
    let numbers: Vec<f64> = numbers.filter_map(|text| text.parse().ok()).collect();
    let near = |omega: &f64| (omega / measured_rad_s - 1.0).abs() < NEAR;
    let in_hz = numbers.iter().map(|hz| hz * std::f64::consts::TAU);
    numbers.iter().copied().find(near).or_else(|| in_hz.clone().find(near))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn swing(offset_deg: f64, amplitude_deg: f64, phase_deg: f64) -> JointSwing {
        JointSwing { offset_deg, amplitude_deg, phase_deg }
    }

    fn performed(name: &str, omega_rad_s: f64, joints: [JointSwing; 2]) -> Performed {
        Performed { omega_rad_s, joints, name: name.to_owned(), is_listed: false }
    }

    fn passive(name: &str, omega: f64) -> Performed {
        let phase_deg = -80.0 - 14.0 * omega;
        performed(name, omega, [swing(0.0, 30.0 - 12.0 / omega, phase_deg), swing(0.0, 30.0, 0.0)])
    }

    #[test]
    fn gaits_of_one_name_are_told_apart_and_a_joint_that_changes_with_frequency_is_passive() {
        let frequencies = (1..=12).map(|i| 0.5 * f64::from(i));
        let (level, slanted) = (swing(0.0, 30.0, 0.0), swing(45.0, 30.0, 0.0));
        let rear = |offset| swing(offset, 30.0, -90.0);
        let mut files: Vec<Performed> = Vec::new();
        for omega in frequencies {
            files.push(performed("trial", omega, [level, rear(0.0)]));
            files.push(performed("trial", omega, [slanted, rear(-45.0)]));
            files.push(passive("trial", omega));
        }
        let found = groups(&files);
        let sizes: Vec<_> = found.iter().map(|group| (group.files.len(), group.passive)).collect();
        assert_eq!(sizes.len(), 3, "{found:#?}");
        assert!(sizes.contains(&(12, Some(0))) && sizes.contains(&(12, None)), "{sizes:?}");
        let names: Vec<&str> = found.iter().map(|group| group.name.as_str()).collect();
        assert_eq!(names, ["trial-1", "trial-2", "trial-3"]);
        assert!(found.iter().all(|group| group.doubt.is_none()));
        let bent = found.iter().find(|group| group.joints[0].offset_deg > 40.0).unwrap();
        assert!((bent.joints[1].phase_deg + 90.0).abs() < 1e-9, "{bent:?}");
    }

    #[test]
    fn what_few_files_leave_open_is_said() {
        let one = groups(&[performed("a", 2.0, [swing(0.0, 20.0, 0.0), swing(0.0, 20.0, 60.0)])]);
        assert_eq!((one[0].name.as_str(), one[0].passive), ("a", None));
        assert!(one[0].doubt.as_ref().unwrap().contains("one frequency"));
        let two = groups(&[passive("a", 1.0), passive("a", 3.0)]);
        assert_eq!((two.len(), two[0].passive), (1, Some(0)));
        assert!(two[0].doubt.as_ref().unwrap().contains("2 frequencies"));
    }

    #[test]
    fn names_have_words_and_frequencies() {
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
