//! Figure of solution branches: metrics against a parameter, with solid lines for stable motions and dashed lines for
//! unstable ones.

use std::collections::BTreeSet;

use trilink_plot::{Figure, Layer, Layout, Panel};
use trilink_robot::metrics::{Bifurcation, BranchKind, GaitMetrics};
use trilink_tables::BranchRow;

use super::ending::{FigureFile, drawn};
use super::figures::FREQUENCY;
use super::series::{AMPLITUDE, DISPLACEMENT, Quantity, SPEED, TURNING};
use super::{ReportError, looks};

/// Draws the branches of steady-state motions against a parameter, in the format that `file` specifies.
///
/// `names` are the names of the campaign, the model and the parameter.
///
/// # Errors
/// Returns an error if the file's extension is not `svg`, `png` or `pdf`, or if the figure cannot be drawn.
pub fn branches_drawing(
    names: [&str; 3],
    rows: &[BranchRow],
    file: FigureFile<'_>,
) -> Result<Vec<u8>, ReportError> {
    drawn(&figure(names, rows), file)
}

fn figure([campaign, model, parameter]: [&str; 3], rows: &[BranchRow]) -> Figure {
    let axis = if parameter == "omega_rad_s" { FREQUENCY } else { parameter };
    let mut panels = Vec::new();
    for quantity in [DISPLACEMENT, SPEED, TURNING, AMPLITUDE] {
        let values = rows.iter().map(|row| quantity.of(&row.metrics));
        let [low, high] = trilink_statistics::extremes(values);
        if high - low > 1e-6 {
            panels.push(Panel::new(
                quantity.title,
                axis,
                quantity.axis_label(),
                layers(rows, &quantity),
            ));
        }
    }
    let title = format!("Branches of steady motions of {campaign}, {model}, against {parameter}");
    Figure::new("branches", [title, String::new()], &[campaign], Layout::Stack, panels)
}

/// Returns the plot layers of a quantity: the lines of all branches, followed by the markers of the bifurcations.
fn layers(rows: &[BranchRow], quantity: &Quantity) -> Vec<Layer> {
    let kinds: BTreeSet<BranchKind> = rows.iter().map(|row| row.kind).collect();
    let mut layers = Vec::new();
    for kind in kinds {
        layers.extend([true, false].map(|is_stable| line(rows, quantity, kind, is_stable)));
    }
    layers.retain(|line| !line.points.is_empty());
    let bifurcations: BTreeSet<Bifurcation> =
        rows.iter().filter_map(|row| row.bifurcation).collect();
    for bifurcation in bifurcations {
        let at_bifurcation = rows.iter().filter(|row| row.bifurcation == Some(bifurcation));
        let points = at_bifurcation.flat_map(|row| {
            let images = sides(row.kind).iter().map(|side| image(row, *side));
            images.map(|metrics| (row.value, quantity.of(&metrics)))
        });
        layers.push(Layer::new(bifurcation.name(), points, looks::bifurcation(bifurcation)));
    }
    layers
}

/// Returns the signs with which to plot the net rotation of a branch: both signs if the motions have lost their
/// half-period symmetry, because each then has a mirror image.
fn sides(kind: BranchKind) -> &'static [f64] {
    if kind == BranchKind::SymmetryBroken { &[1.0, -1.0] } else { &[1.0] }
}

/// Returns the metrics of the motion in a row (`side` = 1) or of that motion's mirror image (`side` = -1).
fn image(row: &BranchRow, side: f64) -> GaitMetrics {
    GaitMetrics { dtheta_rad: side * row.metrics.dtheta_rad, ..row.metrics }
}

/// Returns the line that plots a quantity for all stable or all unstable motions on branches of one kind, including
/// mirror images.
///
/// Points where stability changes or is undefined (bifurcations and the start of a branch) belong to both the stable
/// and the unstable line.
fn line(rows: &[BranchRow], quantity: &Quantity, kind: BranchKind, is_stable: bool) -> Layer {
    let mut points = Vec::new();
    for side in sides(kind) {
        for (nth, row) in rows.iter().enumerate().filter(|(_, row)| row.kind == kind) {
            let before = nth.checked_sub(1).and_then(|nth| rows.get(nth));
            let neighbours = [before, rows.get(nth + 1)].into_iter().flatten();
            let mut neighbours = neighbours.filter(|other| other.branch == row.branch);
            let is_between =
                row.bifurcation.is_some() || before.is_none_or(|other| other.branch != row.branch);
            let is_shown = |row: &BranchRow| row.status.is_stable() == is_stable;
            if is_shown(row) || (is_between && neighbours.any(is_shown)) {
                points.push((row.value, quantity.of(&image(row, *side))));
            }
            let is_last = rows.get(nth + 1).is_none_or(|next| next.branch != row.branch);
            if is_last || !is_shown(row) {
                points.push((f64::NAN, f64::NAN));
            }
        }
    }
    if points.iter().all(|(x, _)| x.is_nan()) {
        points.clear();
    }
    let stable = if is_stable { "stable" } else { "unstable" };
    Layer::new(&format!("{kind}, {stable}"), points, looks::branch(kind, is_stable))
}
