//! Which markers of a file belong to which link.

use std::collections::BTreeMap;

use trilink_mocap::Recording;
use trilink_tables::config::Markers;

use crate::error::Problem;

/// So many missing markers, and most of the layout's, are a file of something else.
const LEAST_FOREIGN: usize = 3;
/// Labels of such a file that are shown.
const SHOWN_LABELS: usize = 12;
/// Labels of the file that an error proposes.
const PROPOSALS: usize = 3;

/// One marker of a link.
#[derive(Debug, Clone, Copy)]
pub struct LinkMarker {
    /// Index among the file's labels.
    pub column: usize,
    /// Place in the link's own frame, x along t_i and y along n_i, mm.
    pub local_position_mm: [f64; 2],
    /// Above the floor, mm.
    pub height_mm: f64,
}

/// The markers of links 0, 1, 2 in a file.
pub(crate) type Layout = [Vec<LinkMarker>; 3];

/// Finds every marker of the configured layout in the file: by its whole label, or else by the
/// part after the subject if only one subject has it. The error is about the first that is not
/// found.
pub(crate) fn locate(markers: &Markers, file: &Recording) -> Result<Layout, Problem> {
    let (layout, problems) = locate_all(markers, file);
    problems.into_iter().next().map_or(Ok(layout), Err)
}

/// The markers that are found, and an error for every one that is not; a single one if most are
/// not there, as in a file of something else.
pub(crate) fn locate_all(markers: &Markers, file: &Recording) -> (Layout, Vec<Problem>) {
    let mut layout = [const { Vec::new() }; 3];
    let mut problems = Vec::new();
    let mut owners: BTreeMap<usize, &str> = BTreeMap::new();
    for (link, configured) in markers.links().into_iter().enumerate() {
        for (label, position_mm) in configured {
            let found = column_of(link, label, &file.labels);
            let Ok(column) = found.map_err(|problem| problems.push(problem)) else { continue };
            if let Some(first) = owners.insert(column, label) {
                let (found, first) = (file.labels[column].clone(), first.to_owned());
                problems.push(Problem::SharedMarker { found, first, second: label.clone() });
            }
            let [x, y, height_mm] = *position_mm;
            layout[link].push(LinkMarker { column, local_position_mm: [x, y], height_mm });
        }
    }
    let missing = problems.iter().filter(|it| matches!(it, Problem::MissingMarker { .. })).count();
    let all = markers.links().into_iter().map(BTreeMap::len).sum();
    if missing >= LEAST_FOREIGN && 2 * missing > all {
        let labels = file.labels.iter().take(SHOWN_LABELS).map(String::as_str).collect::<Vec<_>>();
        let more = if file.labels.len() > SHOWN_LABELS { ", .." } else { "" };
        let labels = format!("`{}`{more}", labels.join("`, `"));
        problems = vec![Problem::ForeignFile { missing, all, labels }];
    }
    (layout, problems)
}

fn column_of(link: usize, label: &str, labels: &[String]) -> Result<usize, Problem> {
    let among = |matches: &dyn Fn(&str) -> bool| -> Vec<usize> {
        (0..labels.len()).filter(|&i| matches(&labels[i])).collect()
    };
    let mut found = among(&|candidate| candidate == label);
    if found.is_empty() {
        found = among(&|candidate| marker_name(candidate) == label);
    }
    let label = label.to_owned();
    match found[..] {
        [column] => Ok(column),
        [] => {
            let hint = proposals(&label, labels);
            Err(Problem::MissingMarker { label, link, hint })
        }
        [first, ..] if found.iter().all(|&i| labels[i] == labels[first]) => {
            Err(Problem::RepeatedLabel { label: labels[first].clone(), link })
        }
        _ => {
            let found = found.iter().map(|&i| labels[i].clone()).collect();
            Err(Problem::AmbiguousMarker { label, link, found })
        }
    }
}

/// A label without its subject.
pub fn marker_name(label: &str) -> &str {
    label.rsplit_once(':').map_or(label, |(_, name)| name)
}

fn proposals(label: &str, labels: &[String]) -> String {
    let likeness = |candidate: &str| {
        let names = strsim::jaro_winkler(marker_name(label), marker_name(candidate));
        names.max(strsim::jaro_winkler(label, candidate))
    };
    let mut ranked: Vec<(f64, &str)> =
        labels.iter().map(|label| (likeness(label), label.as_str())).collect();
    ranked.sort_by(|(a, _), (b, _)| b.total_cmp(a));
    let nearest: Vec<&str> = ranked.iter().take(PROPOSALS).map(|(_, label)| *label).collect();
    format!("the nearest of its {} labels are `{}`", labels.len(), nearest.join("`, `"))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use trilink_mocap::LengthUnit;
    use trilink_mocap::read_markers;

    use super::*;
    use crate::error::TrialFailure;

    /// The markers of the fixture with two subjects that both have a marker `X`.
    fn located(link0: [&str; 2]) -> Result<Layout, TrialFailure> {
        let path = Path::new("../mocap/tests/fixtures/two-subjects.csv");
        let file = read_markers(path, LengthUnit::Mm).unwrap();
        let link0 = link0.into_iter().map(|label| (label.to_owned(), [0.0; 3])).collect();
        let markers = Markers { link0, link1: BTreeMap::new(), link2: BTreeMap::new() };
        locate(&markers, &file).map_err(|problem| problem.of(Path::new("a.csv")))
    }

    #[test]
    fn a_name_that_two_subjects_have_needs_the_subject() {
        assert_eq!(
            located(["X", "Y-2"]).unwrap_err().to_string(),
            "a.csv: found the marker `X` of markers.link0 as `Branch:X`, `Branch_1:X`, \
             needed one of them; the layout must name it `Subject:Marker`"
        );
        let layout = located(["Branch_1:X", "Y-2"]).unwrap();
        assert_eq!(layout[0].iter().map(|marker| marker.column).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn a_marker_cannot_stand_for_two_of_the_layout() {
        assert_eq!(
            located(["Branch_1:Y-2", "Y-2"]).unwrap_err().to_string(),
            "a.csv: found the marker `Branch_1:Y-2` for both `Branch_1:Y-2` and `Y-2` of \
             pipeline.toml's [markers], needed one each"
        );
    }

    #[test]
    fn a_label_that_a_file_has_twice_is_an_error() {
        let labels = ["Snake:M1".to_owned(), "Snake:M1".to_owned()];
        for label in ["M1", "Snake:M1"] {
            let error = column_of(0, label, &labels).unwrap_err().of(Path::new("a.csv"));
            assert_eq!(
                error.to_string(),
                "a.csv: found the label `Snake:M1` more than once, \
                 needed by markers.link0 of pipeline.toml once"
            );
        }
    }
}
