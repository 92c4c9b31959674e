//! The figure of branches: metrics over a parameter, stable motions solid, unstable ones dashed.

use std::collections::BTreeSet;

use trilink_plot::{Figure, Layer, Layout, Panel};
use trilink_robot::metrics::{Bifurcation, BranchKind, GaitMetrics};
use trilink_tables::BranchRow;

use super::ending::{FigureFile, drawn};
use super::figures::FREQUENCY;
use super::series::{AMPLITUDE, DISPLACEMENT, Quantity, SPEED, TURNING};
use super::{ReportError, looks};

/// The drawing of a campaign's branches by a model over a parameter, in the format that a file with
/// this ending has: `svg`, `png` or `pdf`.
///
/// # Errors
/// There is no such format, or nothing can be drawn.
pub fn branches_drawing(
    names: [&str; 3],
    rows: &[BranchRow],
    file: FigureFile<'_>,
) -> Result<Vec<u8>, ReportError> {
    drawn(&figure(names, rows), file)
}

fn figure([campaign, model, parameter]: [&str; 3], rows: &[BranchRow]) -> Figure {
    let axis = if parameter == "omega_rad_s" { FREQUENCY } else { parameter };
    let changes = |quantity: &&Quantity| {
        let values = rows.iter().map(|row| quantity.of(&row.metrics));
        let [low, high] = trilink_statistics::extremes(values);
        high - low > 1e-6
    };
    let quantities = [DISPLACEMENT, SPEED, TURNING, AMPLITUDE];
    let panel = |quantity: &Quantity| {
        let kinds: BTreeSet<BranchKind> = rows.iter().map(|row| row.kind).collect();
        let lines = kinds
            .into_iter()
            .flat_map(|kind| [true, false].map(|is_stable| line(rows, quantity, kind, is_stable)));
        let marks: BTreeSet<Bifurcation> = rows.iter().filter_map(|row| row.bifurcation).collect();
        let marks = marks.into_iter().map(|bifurcation| {
            let met = rows.iter().filter(|row| row.bifurcation == Some(bifurcation));
            let points = met.flat_map(|row| {
                let images = sides(row.kind).iter().map(|side| image(row, *side));
                images.map(|metrics| (row.value, quantity.of(&metrics)))
            });
            Layer::new(bifurcation.name(), points, looks::bifurcation(bifurcation))
        });
        let layers = lines.filter(|line| !line.points.is_empty()).chain(marks).collect();
        Panel::new(quantity.title, axis, quantity.axis_label(), layers)
    };
    let panels = quantities.iter().filter(changes).map(panel).collect();
    let title = format!("Branches of steady motions of {campaign}, {model}, over {parameter}");
    Figure::new("branches", [title, String::new()], &[campaign], Layout::Stack, panels)
}

/// The motions that a row stands for turn to this side, or to the other.
fn sides(kind: BranchKind) -> &'static [f64] {
    if kind == BranchKind::SymmetryBroken { &[1.0, -1.0] } else { &[1.0] }
}

fn image(row: &BranchRow, side: f64) -> GaitMetrics {
    GaitMetrics { dtheta_rad: side * row.metrics.dtheta_rad, ..row.metrics }
}

/// A quantity of all stable or all unstable motions of a kind, with what is between them in both, and
/// with their mirror images.
fn line(rows: &[BranchRow], quantity: &Quantity, kind: BranchKind, is_stable: bool) -> Layer {
    let mut points = Vec::new();
    for side in sides(kind) {
        for (nth, row) in rows.iter().enumerate().filter(|(_, row)| row.kind == kind) {
            let before = nth.checked_sub(1).and_then(|nth| rows.get(nth));
            let beside = [before, rows.get(nth + 1)].into_iter().flatten();
            let mut beside = beside.filter(|of| of.branch == row.branch);
            let is_between =
                row.bifurcation.is_some() || before.is_none_or(|of| of.branch != row.branch);
            let is_one = |of: &BranchRow| of.status.is_stable() == is_stable;
            if is_one(row) || (is_between && beside.any(is_one)) {
                points.push((row.value, quantity.of(&image(row, *side))));
            }
            let is_last = rows.get(nth + 1).is_none_or(|of| of.branch != row.branch);
            if is_last || !is_one(row) {
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
