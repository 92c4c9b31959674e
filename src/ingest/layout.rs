//! Which markers of a file belong to which link.

use std::path::Path;

use super::TrialFailure;
use crate::config::Markers;
use crate::vicon::MarkerFile;

/// Labels of the file that an error proposes.
const PROPOSALS: usize = 3;

/// One marker of a link.
#[derive(Debug, Clone, Copy)]
pub(super) struct LinkMarker {
    /// Index among the file's labels.
    pub column: usize,
    /// Place in the link's own frame, x along t_i and y along n_i, mm.
    pub place_mm: [f64; 2],
}

/// The markers of links 0, 1, 2 in a file.
pub(super) type Layout = [Vec<LinkMarker>; 3];

/// Finds every marker of the configured layout in the file: by its whole label, or else by the
/// part after the subject if only one subject has it.
pub(super) fn locate(
    path: &Path,
    markers: &Markers,
    file: &MarkerFile,
) -> Result<Layout, TrialFailure> {
    let mut layout = [const { Vec::new() }; 3];
    for (link, configured) in markers.links().into_iter().enumerate() {
        for (label, place) in configured {
            let column = column_of(path, link, label, &file.labels)?;
            layout[link].push(LinkMarker { column, place_mm: [place[0], place[1]] });
        }
    }
    Ok(layout)
}

fn column_of(
    path: &Path,
    link: usize,
    label: &str,
    labels: &[String],
) -> Result<usize, TrialFailure> {
    let among = |matches: &dyn Fn(&str) -> bool| -> Vec<usize> {
        (0..labels.len()).filter(|&i| matches(&labels[i])).collect()
    };
    let mut found = among(&|candidate| candidate == label);
    if found.is_empty() {
        found = among(&|candidate| marker_name(candidate) == label);
    }
    let path = path.to_owned();
    let label = label.to_owned();
    match found[..] {
        [column] => Ok(column),
        [] => {
            let hint = proposals(&label, labels);
            Err(TrialFailure::MissingMarker { path, label, link, hint })
        }
        _ => {
            let found = found.iter().map(|&i| labels[i].clone()).collect();
            Err(TrialFailure::AmbiguousMarker { path, label, link, found })
        }
    }
}

/// A label without its subject.
fn marker_name(label: &str) -> &str {
    label.rsplit_once(':').map_or(label, |(_, name)| name)
}

fn proposals(label: &str, labels: &[String]) -> String {
    let likeness = |candidate: &str| {
        let names = strsim::jaro_winkler(marker_name(label), marker_name(candidate));
        names.max(strsim::jaro_winkler(label, candidate))
    };
    let mut ranked: Vec<&String> = labels.iter().collect();
    ranked.sort_by(|a, b| likeness(b).total_cmp(&likeness(a)));
    let nearest: Vec<&str> = ranked.iter().take(PROPOSALS).map(|label| label.as_str()).collect();
    format!("the nearest of its {} labels are `{}`", labels.len(), nearest.join("`, `"))
}
