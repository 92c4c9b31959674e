//! Which markers are which link: those that move rigidly together, where two joints make a chain of
//! three such groups.

use std::collections::BTreeMap;

use trilink_ingest::calibrate::{Body, between, in_order, rigid_groups};
use trilink_ingest::marker_name;
use trilink_mocap::Recording;

/// The two positions of a joint, by the links that it connects, are nearer than this (RMS), mm.
const JOINT_MM: f64 = 5.0;
/// Groups that chains are looked for in, the largest ones.
const MOST_GROUPS: usize = 16;

/// Names of the markers of the middle link and of both others, each in order.
pub(super) type Links = [Vec<String>; 3];

/// The markers' names as a layout has them: without the subject where no other marker is called so.
pub(super) fn names(labels: &[String]) -> Vec<String> {
    let is_only =
        |name: &str| labels.iter().filter(|label| marker_name(label) == name).count() == 1;
    let name = |label: &String| match marker_name(label) {
        name if is_only(name) => name.to_owned(),
        _ => label.clone(),
    };
    labels.iter().map(name).collect()
}

/// The links that a file shows, the middle one first, or what it shows instead.
pub(super) fn links(file: &Recording) -> Result<Links, String> {
    let mut groups = rigid_groups(file);
    // The order of the file decides among groups of one size.
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    groups.truncate(MOST_GROUPS);
    let bodies = groups.into_iter().filter_map(|group| {
        let body = Body::of(file, &group)?;
        Some((group, body))
    });
    let bodies: Vec<(Vec<usize>, Body)> = bodies.collect();
    let names = names(&file.labels);
    let named = |group: &[usize]| group.iter().map(|&i| names[i].clone()).collect::<Vec<_>>();
    let count = bodies.len();
    let apart = |a: usize, b: usize| {
        between(&bodies[a].1, &bodies[b].1, &|_| true).map_or(f64::INFINITY, |(_, rms_mm)| rms_mm)
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
    let Some(chain) = best.filter(|chain| misfit(*chain) < JOINT_MM) else {
        let list: Vec<String> = bodies.iter().map(|(group, _)| named(group).join(" ")).collect();
        let list = if list.is_empty() { "none".to_owned() } else { list.join("; ") };
        return Err(format!("groups of markers that move rigidly together: {list}"));
    };
    let [middle, a, b] = chain;
    let bodies_of = [middle, a, b].map(|i| bodies[i].1.clone());
    // Which of them has a joint with both others is seen in what it leaves apart.
    let ordered = in_order(file, bodies_of, None).map_err(|problem| problem.to_string())?;
    let group =
        |body: &Body| -> Vec<usize> { body.markers.iter().map(|marker| marker.column).collect() };
    let [middle, mut first, mut second] = ordered.each_ref().map(|body| named(&group(body)));
    if second < first {
        std::mem::swap(&mut first, &mut second);
    }
    Ok([middle, first, second])
}

/// Whether two side links' markers are called as the front one's and the rear one's: `F1` or `front-left`,
/// `R1` or `back-1`.
pub(super) fn are_named(front: &[String], rear: &[String]) -> bool {
    let begin = |names: &[String], letters: &[char]| {
        let first = |name: &String| marker_name(name).to_ascii_lowercase().starts_with(letters);
        names.iter().all(first)
    };
    begin(front, &['f']) && begin(rear, &['r', 'b'])
}

/// The links that most files show.
pub(super) fn shown_by_most<'l>(found: impl Iterator<Item = &'l Links>) -> Option<Links> {
    let mut counts: BTreeMap<&Links, usize> = BTreeMap::new();
    found.for_each(|links| *counts.entry(links).or_default() += 1);
    let most = counts.values().copied().max()?;
    counts.into_iter().find(|(_, count)| *count == most).map(|(links, _)| links.clone())
}

/// Columns of the links' markers, two of a link at least, or what a file lacks.
pub(super) fn columns(links: &Links, labels: &[String]) -> Result<[Vec<usize>; 3], String> {
    let all = names(labels);
    let column = |name: &String| {
        let by_name = || labels.iter().position(|label| label == name);
        all.iter().position(|of| of == name).or_else(by_name)
    };
    let missing: Vec<&str> =
        links.iter().flatten().filter(|name| column(name).is_none()).map(String::as_str).collect();
    match missing[..] {
        [] => Ok(links.each_ref().map(|names| names.iter().filter_map(column).collect())),
        _ => Err(format!(
            "lacks {} of the robot's {} markers: {}",
            missing.len(),
            links.iter().flatten().count(),
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
    fn names_are_without_the_subject_where_only_one_marker_is_called_so() {
        let labels = owned(["Snake:F1", "Snake:R1", "Idle:R1"]);
        assert_eq!(names(&labels), ["F1", "Snake:R1", "Idle:R1"]);
        let links = [owned(["F1"]), owned(["Idle:R1"]), owned(["R2"])];
        let lacks = columns(&links, &labels).unwrap_err();
        assert_eq!(lacks, "lacks 1 of the robot's 3 markers: R2");
        assert!(are_named(&owned(["F1", "front-2"]), &owned(["Snake:R1", "back"])));
        assert!(!are_named(&owned(["F1", "N2"]), &owned(["R1", "R2"])));
    }

    #[test]
    fn the_links_are_those_of_most_files() {
        let links = |last: &str| [owned(["M"]), owned(["F"]), owned([last])];
        let found = [links("R"), links("W"), links("R")];
        assert_eq!(shown_by_most(found.iter()), Some(links("R")));
        assert_eq!(shown_by_most([].into_iter()), None);
    }
}
