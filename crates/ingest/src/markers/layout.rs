//! Assigns the markers in a file to links.

use std::collections::BTreeMap;

use trilink_base::body;
use trilink_mocap::Recording;
use trilink_tables::config::{MarkerLayout, toml_key};

use crate::checks::{Check, Finding};
use crate::error::Problem;

/// Minimum number of the layout's markers that must be missing from a file for it to count as a recording of something
/// else; more than half of the layout's markers must also be missing.
const MIN_FOREIGN_MISSING: usize = 3;
/// Maximum number of labels listed in the message on a file that records something other than the robot.
const MAX_SHOWN_LABELS: usize = 12;
/// Number of similar labels suggested in an error message.
const PROPOSALS: usize = 3;
/// Minimum number of other markers on a link that does without a missing one.
const MIN_REMAINING: usize = 3;

/// Marker on a link.
#[derive(Debug, Clone, Copy)]
pub struct LinkMarker {
    /// Index of the marker among the file's labels.
    pub column: usize,
    /// Position in the link frame, mm: x along the tangent t_i, y along the normal n_i.
    pub local_position_mm: [f64; 2],
    /// Height above the floor, mm.
    pub height_mm: f64,
}

/// Markers on each link in a file, by the link's number.
pub(crate) type Layout = Vec<Vec<LinkMarker>>;

/// Finds every marker of the configured layout in the file, either by its full label or, if only one subject has such a
/// marker, by its name without the subject. Returns the first problem as an error.
pub(crate) fn locate(markers: &MarkerLayout, file: &Recording) -> Result<Layout, Problem> {
    let (layout, problems) = locate_all(markers, file);
    problems.into_iter().next().map_or(Ok(layout), Err)
}

/// Finds the markers of the configured layout in the file. A marker that the file does not have is added to it as
/// occluded, and returned as a finding, if its link has enough others.
pub(crate) fn locate_or_occlude(
    markers: &MarkerLayout,
    mut file: Recording,
) -> Result<(Recording, Layout, Option<Finding>), Problem> {
    let (layout, problems) = locate_all(markers, &file);
    let mut sentences = Vec::new();
    for problem in problems {
        match problem {
            Problem::MissingMarker { label, link, hint, .. }
                if layout[link].len() >= MIN_REMAINING =>
            {
                sentences.push(format!("the file has no marker `{label}` of link {link}; {hint}"));
                file = file.with_occluded(label);
            }
            problem => return Err(problem),
        }
    }
    if sentences.is_empty() {
        return Ok((file, layout, None));
    }
    let finding =
        Finding::at_most(Check::MissingMarkers, sentences.len() as f64, sentences.join("; "));
    let layout = locate(markers, &file)?;
    Ok((file, layout, Some(finding)))
}

/// Replaces labels of the file by those of the layout for which they stand, unless the file has these, too.
pub(crate) fn apply_aliases(aliases: &BTreeMap<String, String>, file: &mut Recording) {
    for (found, meant) in aliases {
        // A rigid body has a label for each of its points.
        let point = |i| (body::point_label(found, i), body::point_label(meant, i));
        let own = std::iter::once((found.clone(), meant.clone()));
        for (found, meant) in own.chain((0..body::POINTS).map(point)) {
            if column_of(0, "", &meant, &file.labels).is_err()
                && let Ok(column) = column_of(0, "", &found, &file.labels)
            {
                file.labels[column] = meant;
            }
        }
    }
}

/// Finds the markers of the configured layout in the file. Also returns one problem for each marker that is missing or
/// ambiguous, or a single problem if most markers are missing, because the file then records something else.
pub(crate) fn locate_all(markers: &MarkerLayout, file: &Recording) -> (Layout, Vec<Problem>) {
    let mut layout = vec![Vec::new(); markers.links().len()];
    let mut problems = Vec::new();
    let mut owners: BTreeMap<usize, &str> = BTreeMap::new();
    for (link, configured) in markers.links().into_iter().enumerate() {
        let table = markers.table_of(link);
        for (label, position_mm) in configured {
            let found = column_of(link, &table, label, &file.labels);
            let column = match found {
                Ok(column) => column,
                // One problem stands for all points of a rigid body.
                Err(_) if body::of_point(label).is_some_and(|(_, point)| point > 0) => continue,
                Err(problem) => {
                    problems.push(problem);
                    continue;
                }
            };
            if let Some(first) = owners.insert(column, label) {
                let found = file.labels[column].clone();
                let first = first.to_owned();
                let (second, table) = (label.clone(), markers.table());
                problems.push(Problem::SharedMarker { found, first, second, table });
            }
            let [x, y, height_mm] = *position_mm;
            layout[link].push(LinkMarker { column, local_position_mm: [x, y], height_mm });
        }
    }
    let unknown: Vec<&str> = (0..file.labels.len())
        .filter(|column| !owners.contains_key(column))
        .map(|column| body::name(&file.labels[column]))
        .collect();
    for problem in &mut problems {
        if let Problem::MissingMarker { label, hint, .. } = problem
            && let [found, ..] = most_similar(label, &unknown)[..]
        {
            let found = marker_name(found);
            let alias = toml_key(found);
            *hint = format!(
                "`{found}` is not in the layout: if it is this marker, rename it or add `aliases = {{ {alias} = \
                 \"{label}\" }}` to trials.toml; {hint}"
            );
        }
    }
    let missing =
        problems.iter().filter(|problem| matches!(problem, Problem::MissingMarker { .. })).count();
    let labels = markers.links().into_iter().flat_map(BTreeMap::keys);
    let is_further_point = |label: &str| body::of_point(label).is_some_and(|(_, point)| point > 0);
    let all = labels.filter(|label| !is_further_point(label)).count();
    if missing >= MIN_FOREIGN_MISSING && 2 * missing > all {
        let mut labels: Vec<&str> = file.labels.iter().map(|label| body::name(label)).collect();
        labels.dedup();
        let more = if labels.len() > MAX_SHOWN_LABELS { ", .." } else { "" };
        labels.truncate(MAX_SHOWN_LABELS);
        let labels = format!("`{}`{more}", labels.join("`, `"));
        let table = markers.table();
        problems = vec![Problem::ForeignFile { missing, all, table, labels }];
    }
    (layout, problems)
}

/// Returns the column of a marker, given the number and the table of its link, which are named in errors.
fn column_of(link: usize, table: &str, label: &str, labels: &[String]) -> Result<usize, Problem> {
    let mut found: Vec<usize> = (0..labels.len()).filter(|&i| labels[i] == label).collect();
    if found.is_empty() {
        found = (0..labels.len()).filter(|&i| marker_name(&labels[i]) == label).collect();
    }
    if let [column] = found[..] {
        return Ok(column);
    }
    let label = body::name(label).to_owned();
    let table = table.to_owned();
    match found[..] {
        [] => {
            let hint = proposals(&label, labels);
            Err(Problem::MissingMarker { label, link, table, hint })
        }
        [first, ..] if found.iter().all(|&i| labels[i] == labels[first]) => {
            Err(Problem::RepeatedLabel { label: body::name(&labels[first]).to_owned(), table })
        }
        _ => {
            let found = found.iter().map(|&i| body::name(&labels[i]).to_owned()).collect();
            Err(Problem::AmbiguousMarker { label, table, found })
        }
    }
}

/// Returns the marker name in a label, without the subject.
pub fn marker_name(label: &str) -> &str {
    label.rsplit_once(':').map_or(label, |(_, name)| name)
}

fn proposals(label: &str, labels: &[String]) -> String {
    let mut all: Vec<&str> = labels.iter().map(|label| body::name(label)).collect();
    all.dedup();
    let nearest = most_similar(label, &all).join("`, `");
    format!("the most similar of the file's {} labels are `{nearest}`", all.len())
}

/// Returns the labels that are most similar to `label`, beginning with the most similar.
fn most_similar<'l>(label: &str, labels: &[&'l str]) -> Vec<&'l str> {
    let similarity = |candidate: &str| {
        let names = strsim::jaro_winkler(marker_name(label), marker_name(candidate));
        names.max(strsim::jaro_winkler(label, candidate))
    };
    let mut ranked: Vec<(f64, &str)> =
        labels.iter().map(|candidate| (similarity(candidate), *candidate)).collect();
    ranked.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    ranked.iter().take(PROPOSALS).map(|(_, label)| *label).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use trilink_mocap::LengthUnit;
    use trilink_mocap::read_markers;
    use trilink_tables::config::Markers;

    use super::*;
    use crate::error::TrialFailure;

    /// Locates two markers on link 0 in a fixture in which two subjects have a marker `X`.
    fn located(link0: [&str; 2]) -> Result<Layout, TrialFailure> {
        let path = Path::new("../mocap/tests/fixtures/two-subjects.csv");
        let file = read_markers(path, LengthUnit::Mm).unwrap();
        let link0 = link0.into_iter().map(|label| (label.to_owned(), [0.0; 3])).collect();
        let markers = Markers { link0, link1: BTreeMap::new(), link2: BTreeMap::new() };
        locate(&(&markers).into(), &file).map_err(|problem| problem.in_file(Path::new("a.csv")))
    }

    #[test]
    fn a_name_that_two_subjects_have_needs_the_subject() {
        assert_eq!(
            located(["X", "Y-2"]).unwrap_err().to_string(),
            "a.csv: the marker `X` of markers.link0 matches the labels `Branch:X`, `Branch_1:X`; replace the label in \
             that table by one of these, in the form `Subject:Marker`"
        );
        let layout = located(["Branch_1:X", "Y-2"]).unwrap();
        assert_eq!(layout[0].iter().map(|marker| marker.column).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn a_marker_cannot_match_two_of_the_layout() {
        assert_eq!(
            located(["Branch_1:Y-2", "Y-2"]).unwrap_err().to_string(),
            "a.csv: the marker `Branch_1:Y-2` matches both `Branch_1:Y-2` and `Y-2` of \
             pipeline.toml's [markers], but each of these entries needs a marker of its own"
        );
    }

    #[test]
    fn a_label_that_a_file_has_twice_is_an_error() {
        let labels = ["Snake:M1".to_owned(), "Snake:M1".to_owned()];
        for label in ["M1", "Snake:M1"] {
            let error = column_of(0, "markers.link0", label, &labels)
                .unwrap_err()
                .in_file(Path::new("a.csv"));
            assert_eq!(
                error.to_string(),
                "a.csv: the file has the label `Snake:M1` more than once, \
                 but markers.link0 of pipeline.toml needs it to be unique"
            );
        }
    }
}
