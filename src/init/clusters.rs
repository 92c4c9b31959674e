//! Assignment of markers to links: groups of markers that move rigidly together, which form a chain with joints between
//! them.

use std::collections::BTreeMap;

use trilink_base::body;
use trilink_ingest::calibrate::{Body, JointMisfits, MAX_JOINT_MISFIT_MM, rigid_groups};
use trilink_ingest::marker_name;
use trilink_mocap::Recording;
use trilink_robot::MAX_LINKS;

/// Maximum number of groups of markers, the largest first, among which a chain of links is searched for.
const MAX_GROUPS: usize = 16;

/// Names of the markers of the links from front to rear; each link's markers are in the order of the file.
pub(super) type Links = Vec<Vec<String>>;

/// Returns values of the links, given from front to rear, in the order of the links' numbers: first that of the
/// reference link, which is the middle one or, of an even number of links, the one ahead of the middle.
pub(super) fn by_number<T>(links: &[T]) -> impl Iterator<Item = &T> {
    let reference = links.len().saturating_sub(1) / 2;
    let others = links.iter().enumerate().filter(move |(link, _)| *link != reference);
    links.get(reference).into_iter().chain(others.map(|(_, of_link)| of_link))
}

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

/// Returns the links that a file shows, from one end of the robot to the other, or a message about what it shows instead.
pub(super) fn links(file: &Recording) -> Result<Links, String> {
    let mut groups = rigid_groups(file);
    // The sort is stable: groups of the same size keep their order in the file.
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    groups.truncate(MAX_GROUPS);
    let bodies = groups.into_iter().filter_map(|group| {
        let body = Body::fit(file, &group)?;
        Some((group, body))
    });
    let (groups, bodies): (Vec<Vec<usize>>, Vec<Body>) = bodies.unzip();
    let names = names(&file.labels);
    let named = |group: &Vec<usize>| group.iter().map(|&i| names[i].clone()).collect::<Vec<_>>();
    let chain = JointMisfits::new(&bodies).chain(MAX_JOINT_MISFIT_MM);
    if !(2..=MAX_LINKS).contains(&chain.len()) {
        let list: Vec<String> =
            groups.iter().map(|group| without_points(&named(group)).join(" ")).collect();
        let list = if list.is_empty() { "none".to_owned() } else { list.join("; ") };
        return Err(format!("groups of markers that move rigidly together: {list}"));
    }
    let mut links: Links = chain.into_iter().map(|body| named(&groups[body])).collect();
    if links.last() < links.first() {
        links.reverse();
    }
    Ok(links)
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

/// Returns the assignment of markers to links that occurs in most of the files that show the most links. In the other
/// files some joints do not turn.
pub(super) fn most_common<'l>(found: impl Iterator<Item = &'l Links>) -> Option<Links> {
    let mut counts: BTreeMap<Vec<&Vec<String>>, (&Links, usize)> = BTreeMap::new();
    for links in found {
        counts.entry(by_number(links).collect()).or_insert((links, 0)).1 += 1;
    }
    let size = |(links, count): &(&Links, usize)| (links.len(), *count);
    let max = counts.values().map(size).max()?;
    counts.values().find(|one| size(one) == max).map(|(links, _)| (*links).clone())
}

/// Replaces the labels of the four points of a rigid body by the name of the body, and keeps the labels of markers.
pub(super) fn without_points(names: &[String]) -> Vec<String> {
    let mut names: Vec<String> = names.iter().map(|name| body::name(name).to_owned()).collect();
    names.dedup();
    names
}

/// Returns the columns of the links' markers in a file, or a message about missing markers.
pub(super) fn columns(links: &Links, labels: &[String]) -> Result<Vec<Vec<usize>>, String> {
    let all = names(labels);
    let column = |name: &String| {
        let by_label = || labels.iter().position(|label| label == name);
        all.iter().position(|known| known == name).or_else(by_label)
    };
    let missing = links.iter().flatten().filter(|name| column(name).is_none()).cloned();
    let missing = without_points(&missing.collect::<Vec<_>>());
    match missing[..] {
        [] => {
            let columns = |names: &Vec<String>| names.iter().filter_map(column).collect();
            Ok(links.iter().map(columns).collect())
        }
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
        let links = vec![owned(["F1"]), owned(["Idle:R1"]), owned(["R2"])];
        let lacks = columns(&links, &labels).unwrap_err();
        assert_eq!(lacks, "the file lacks 1 of the robot's 3 markers: R2");
        assert!(are_named(&owned(["F1", "front-2"]), &owned(["Snake:R1", "back"])));
        assert!(!are_named(&owned(["F1", "N2"]), &owned(["R1", "R2"])));
    }

    #[test]
    fn the_links_are_those_of_most_files_that_show_them_all() {
        let links = |last: &str| vec![owned(["F"]), owned(["M"]), owned([last])];
        let held = vec![owned(["F", "M"]), owned(["R"])];
        let found = [links("R"), held.clone(), links("W"), held.clone(), held, links("R")];
        assert_eq!(most_common(found.iter()), Some(links("R")));
        assert_eq!(most_common([].into_iter()), None);
        let numbered =
            |count: u8| by_number(&(0..count).collect::<Vec<_>>()).copied().collect::<Vec<_>>();
        assert_eq!([2, 3, 4].map(numbered), [vec![0, 1], vec![1, 0, 2], vec![1, 0, 2, 3]]);
    }
}
