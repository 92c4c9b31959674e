//! Assignment of markers to links: groups of markers that move rigidly together, three of which form a chain with two
//! joints.

use std::collections::BTreeMap;

use trilink_base::body;
use trilink_ingest::calibrate::{Body, locate_joint, order_links, rigid_groups};
use trilink_ingest::marker_name;
use trilink_mocap::Recording;

/// Maximum RMS distance between the two estimates of a joint's position, one from each of the links that it connects,
/// mm.
const MAX_JOINT_MISFIT_MM: f64 = 5.0;
/// Maximum number of groups of markers, the largest first, among which a chain of three links is searched for.
const MAX_GROUPS: usize = 16;

/// Names of the markers of the middle link and of the two side links; each link's markers are in the order of the file.
pub(super) type Links = [Vec<String>; 3];

/// Returns the markers' names as used in a layout: without the subject (`subject:name`) if no other marker has the same
/// name.
pub(super) fn names(labels: &[String]) -> Vec<String> {
    let names = labels.iter().map(|label| {
        let name = marker_name(label);
        let count = labels.iter().filter(|label| marker_name(label) == name).count();
        if count == 1 { name.to_owned() } else { label.clone() }
    });
    names.collect()
}

/// Returns the links that a file shows, the middle one first, or a message about what it shows instead.
pub(super) fn links(file: &Recording) -> Result<Links, String> {
    let mut groups = rigid_groups(file);
    // The sort is stable: groups of the same size keep their order in the file.
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    groups.truncate(MAX_GROUPS);
    let bodies = groups.into_iter().filter_map(|group| {
        let body = Body::fit(file, &group)?;
        Some((group, body))
    });
    let bodies: Vec<(Vec<usize>, Body)> = bodies.collect();
    let names = names(&file.labels);
    let named = |group: &[usize]| group.iter().map(|&i| names[i].clone()).collect::<Vec<_>>();
    let count = bodies.len();
    let apart = |a: usize, b: usize| {
        locate_joint(&bodies[a].1, &bodies[b].1, &|_| true)
            .map_or(f64::INFINITY, |(_, rms_mm)| rms_mm)
    };
    let mut joints = vec![vec![f64::INFINITY; count]; count];
    for (a, b) in (0..count).flat_map(|b| (0..b).map(move |a| (a, b))) {
        joints[a][b] = apart(a, b);
        joints[b][a] = joints[a][b];
    }
    let ends = |middle: usize| {
        let pairs = (0..count).flat_map(|b| (0..b).map(move |a| (a, b)));
        pairs.filter(move |(a, b)| *a != middle && *b != middle)
    };
    let chains = (0..count).flat_map(|middle| ends(middle).map(move |(a, b)| [middle, a, b]));
    let misfit = |[middle, a, b]: [usize; 3]| joints[middle][a].max(joints[middle][b]);
    let best = chains.min_by(|a, b| misfit(*a).total_cmp(&misfit(*b)));
    let Some(chain) = best.filter(|chain| misfit(*chain) < MAX_JOINT_MISFIT_MM) else {
        let list: Vec<String> =
            bodies.iter().map(|(group, _)| without_points(&named(group)).join(" ")).collect();
        let list = if list.is_empty() { "none".to_owned() } else { list.join("; ") };
        return Err(format!("groups of markers that move rigidly together: {list}"));
    };
    let [middle, a, b] = chain;
    let bodies_of = [middle, a, b].map(|i| bodies[i].1.clone());
    // The middle link is the one whose joints with both others have the smallest misfit.
    let ordered = order_links(file, bodies_of, None).map_err(|problem| problem.to_string())?;
    let [middle, mut first, mut second] = ordered
        .each_ref()
        .map(|body| named(&body.markers.iter().map(|marker| marker.column).collect::<Vec<_>>()));
    if second < first {
        std::mem::swap(&mut first, &mut second);
    }
    Ok([middle, first, second])
}

/// Whether the markers of two side links are named like those of a front link (`F1`, `front-left`) and of a rear link
/// (`R1`, `back-1`).
pub(super) fn are_named(front: &[String], rear: &[String]) -> bool {
    all_start_with(front, &['f']) && all_start_with(rear, &['r', 'b'])
}

/// Whether every name starts with one of these letters, regardless of case.
fn all_start_with(names: &[String], letters: &[char]) -> bool {
    names.iter().all(|name| marker_name(name).to_ascii_lowercase().starts_with(letters))
}

/// Returns the assignment of markers to links that occurs in most files.
pub(super) fn most_common<'l>(found: impl Iterator<Item = &'l Links>) -> Option<Links> {
    let mut counts: BTreeMap<&Links, usize> = BTreeMap::new();
    found.for_each(|links| *counts.entry(links).or_default() += 1);
    let max = counts.values().copied().max()?;
    counts.into_iter().find(|(_, count)| *count == max).map(|(links, _)| links.clone())
}

/// Replaces the labels of the four points of a rigid body by the name of the body, and keeps the labels of markers.
pub(super) fn without_points(names: &[String]) -> Vec<String> {
    let mut names: Vec<String> = names.iter().map(|name| body::name(name).to_owned()).collect();
    names.dedup();
    names
}

/// Returns the columns of the links' markers in a file, or a message about missing markers.
pub(super) fn columns(links: &Links, labels: &[String]) -> Result<[Vec<usize>; 3], String> {
    let all = names(labels);
    let column = |name: &String| {
        let by_label = || labels.iter().position(|label| label == name);
        all.iter().position(|known| known == name).or_else(by_label)
    };
    let missing = links.iter().flatten().filter(|name| column(name).is_none()).cloned();
    let missing = without_points(&missing.collect::<Vec<_>>());
    match missing[..] {
        [] => Ok(links.each_ref().map(|names| names.iter().filter_map(column).collect())),
        _ => Err(format!(
            "the file lacks {} of the robot's {} markers: {}",
            missing.len(),
            links.iter().map(|names| without_points(names).len()).sum::<usize>(),
            missing.join(", ")
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn owned<const N: usize>(names: [&str; N]) -> Vec<String> {
        names.map(str::to_owned).to_vec()
    }

    #[test]
    fn names_of_single_markers_have_no_subject() {
        let labels = owned(["Snake:F1", "Snake:R1", "Idle:R1"]);
        assert_eq!(names(&labels), ["F1", "Snake:R1", "Idle:R1"]);
        let links = [owned(["F1"]), owned(["Idle:R1"]), owned(["R2"])];
        let lacks = columns(&links, &labels).unwrap_err();
        assert_eq!(lacks, "the file lacks 1 of the robot's 3 markers: R2");
        assert!(are_named(&owned(["F1", "front-2"]), &owned(["Snake:R1", "back"])));
        assert!(!are_named(&owned(["F1", "N2"]), &owned(["R1", "R2"])));
    }

    #[test]
    fn the_links_are_those_of_most_files() {
        let links = |last: &str| [owned(["M"]), owned(["F"]), owned([last])];
        let found = [links("R"), links("W"), links("R")];
        assert_eq!(most_common(found.iter()), Some(links("R")));
        assert_eq!(most_common([].into_iter()), None);
    }
}
